"""The topics on which the collector publishes touches, and their lines in its log."""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import UInt32

from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes.judged_touch import JudgedTouch
from scara_kinetostatic.nodes.session import Session
from scara_kinetostatic.nodes.stream_subscription import LATCHED, LATCHED_TOUCHES


class TouchTopics:
    """`~/touches`, their number, and `~/touch`, each as it is judged.

    Args:
        node: that publishes them.
        frame: of the forces.
    """

    def __init__(self, node: Node, frame: SensorFrame) -> None:
        self._name, self._frame, self._logger = node.get_fully_qualified_name(), frame.value, node.get_logger()
        self._number = node.create_publisher(UInt32, '~/touches', LATCHED)
        self._touch = node.create_publisher(DiagnosticArray, '~/touch', LATCHED_TOUCHES)

    def publish(self, session: Session, judged: Sequence[JudgedTouch] = ()) -> None:
        """Publishes touches of a recording, and how many it has; logs them."""
        for touch in judged:
            self._touch.publish(touch.message(self._name, str(session.folder), self._frame))
            if touch.reason:
                self._logger.warning(touch.line)
            else:
                self._logger.info(touch.line)
        self._number.publish(UInt32(data=session.touches))
