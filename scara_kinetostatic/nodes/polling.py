"""Subscriptions that are polled: at 1 kHz, a round of the executor costs more than the messages that it brings."""

from __future__ import annotations

from collections.abc import Iterator
from time import monotonic
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription

SERVE = 0.04
"""Between two rounds for timers and services, s."""


class PolledGroup(CallbackGroup):
    """Of subscriptions that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to end."""


class PollingExecutor(SingleThreadedExecutor):
    """Calls `poll` of its node in each round, and now and then what waits besides."""

    def __init__(self) -> None:
        super().__init__()
        self._polled: Any = None
        self._next = 0.0

    def add_node(self, node: Node) -> bool:
        """The one node."""
        self._polled = node
        return bool(super().add_node(node))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """One round; returns at once."""
        if timeout_sec:
            self._polled.poll()
        if not timeout_sec or monotonic() >= self._next:
            self._next = monotonic() + SERVE
            super().spin_once(timeout_sec=0)


def waiting(subscription: Subscription) -> Iterator[bytes]:
    """The messages of a raw subscription that have come already."""
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            yield taken[0]
