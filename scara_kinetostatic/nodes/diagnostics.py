"""The status of a node on `/diagnostics`, once a second.

Its name begins with the full name of the node, `/left/collector: recording`: two cells in two namespaces do not
collide, and `rqt_robot_monitor` groups by namespace. Its `hardware_id` is the cell: the namespace, `scara_kinetostatic`
without one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from scara_kinetostatic.nodes.stream_subscription import DIAGNOSTICS

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
HARDWARE = 'scara_kinetostatic'
"""`hardware_id` of a cell without a namespace."""
_PERIOD = 1.0
"""Between two messages, s."""


class Condition(NamedTuple):
    """The status of a node.

    Attributes:
        level: `OK`, `WARN` or `ERROR`.
        message: one line.
        values: details by name.
    """

    level: bytes
    message: str
    values: dict[str, str]


class DiagnosticsPublisher:
    """Publishes the status of a node.

    Args:
        node: on which to publish.
        title: of the status, after the node's name.
        examine: returns the status; called once a second of wall time, whatever simulated time does.
    """

    def __init__(self, node: Node, title: str, examine: Callable[[], Condition]) -> None:
        self._node = node
        self._name = f'{node.get_fully_qualified_name()}: {title}'
        self._hardware = node.get_namespace().strip('/') or HARDWARE
        self._examine = examine
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', DIAGNOSTICS)
        self._timer = node.create_timer(_PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publishes the present status."""
        condition = self._examine()
        values = [KeyValue(key=key, value=value) for key, value in condition.values.items()]
        status = DiagnosticStatus(
            level=condition.level,
            name=self._name,
            message=condition.message,
            hardware_id=self._hardware,
            values=values,
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
