"""Waiting for what nodes in other threads and processes do."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from scara_kinetostatic.nodes.streams import LATCHED

WAIT = 300.0
"""After so long a test hangs, s; what it waits for comes at once on an idle machine."""


class Bench:
    """A node of a cell and one that plays all others, spun in turn in this thread.

    Attributes:
        node: as given.
        robot: the one that plays.
        statuses: what was said on `/diagnostics`.
    """

    def __init__(self, node: Any) -> None:
        self.node, self.robot = node, rclpy.create_node('robot', namespace=node.get_namespace())
        self.statuses: list[DiagnosticStatus] = []
        self.on(DiagnosticArray, '/diagnostics', lambda array: self.statuses.extend(array.status), 10)
        self._executor = SingleThreadedExecutor()
        for one in (self.node, self.robot):
            self._executor.add_node(one)

    def on(self, kind: type, topic: str, take: Callable[[Any], object], profile: QoSProfile | int = LATCHED) -> None:
        self.robot.create_subscription(kind, topic, take, profile)

    def hear(self, kind: type, topic: str, profile: QoSProfile | int = LATCHED) -> list[Any]:
        """What comes on a topic, in the order of time."""
        heard: list[Any] = []
        self.on(kind, topic, heard.append, profile)
        return heard

    def wait(self, until: Callable[[], Any], step: Callable[[], object] = lambda: None) -> None:
        """Until a condition holds, with a step before each look at what has come."""
        end = monotonic() + WAIT
        while not until():
            step()
            self._executor.spin_once(timeout_sec=0.02)
            said = [(status.level, status.message) for status in self.statuses[-1:]]
            assert monotonic() < end, (said, getattr(self.node, '_absence', str)())

    def meet(self, *publishers: Publisher) -> None:
        """Waits until each publisher and the subscription of the node know each other: then nothing is missed."""
        heard = {item._subscription.topic_name: item._subscription for item in self.node._streams.monitors.values()}
        for one in publishers:
            self.wait(lambda: one.get_subscription_count() and heard[one.topic_name].get_publisher_count())  # noqa: B023

    def call(
        self, service: str, step: Callable[[], object] = lambda: None, kind: Any = Trigger, request: Any = None
    ) -> Any:
        """The answer of a service."""
        client = self.robot.create_client(kind, service)
        self.wait(client.service_is_ready, step)
        future = client.call_async(request or kind.Request())
        self.wait(future.done, step)
        return future.result()

    def set(self, name: str, value: object) -> str:
        """Sets a parameter from outside; returns why it was refused, empty if it was not."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        service = f'{self.node.get_fully_qualified_name()}/set_parameters'
        (result,) = self.call(service, kind=SetParameters, request=request).results
        return '' if result.successful else result.reason

    def says(self, text: str, level: bytes) -> Callable[[], bool]:
        """Whether the last status does."""
        return lambda: any(text in one.message and one.level == level for one in self.statuses[-1:])

    def value(self, key: str) -> str:
        """A value of the last status."""
        return next((item.value for one in self.statuses[-1:] for item in one.values if item.key == key), '')

    def close(self) -> None:
        self._executor.shutdown()
        self.robot.destroy_node()
        self.node.close()
        self.node.destroy_node()
