"""Waiting for what nodes in other threads and processes do."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep

from rclpy.node import Node
from rclpy.publisher import Publisher
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient

WAIT = 300.0
"""After so long a test hangs, s; what it waits for comes at once on an idle machine."""


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether a condition comes true."""
    end = monotonic() + WAIT
    while not condition() and monotonic() < end:
        sleep(0.02)
    return condition()


def meet(node: Node, *publishers: Publisher) -> None:
    """Waits until each publisher and the subscription of a cell's node know each other: then nothing is missed."""

    def met() -> bool:
        heard = {item._subscription.topic_name: item._subscription for item in node._streams.monitors.values()}
        return all(one.get_subscription_count() and heard[one.topic_name].get_publisher_count() for one in publishers)

    assert eventually(met)


def trigger(client: DemoClient, service: str) -> Trigger.Response:
    """The answer of a service."""
    return client.call(service, Trigger, Trigger.Request(), WAIT)
