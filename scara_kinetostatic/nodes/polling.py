"""Subscriptions that are polled: at 1 kHz, a round of the executor costs more than the messages that it brings."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from time import monotonic
from typing import Any, Protocol

from rclpy._rclpy_pybind11 import WaitSet
from rclpy.callback_groups import CallbackGroup
from rclpy.constants import S_TO_NS
from rclpy.executors import ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.subscription import Subscription

SERVE = 0.25
"""Between two rounds for timers and services, s; the next round follows with the next message while they wait."""

YOUNG = 10_000
"""New objects that wait for a search for garbage, which takes milliseconds; a sample leaves none."""


class Polled(Protocol):
    """A node whose messages are polled.

    Attributes:
        awaited: the subscription whose messages end the wait.
    """

    awaited: Subscription

    def poll(self) -> None:
        """Takes what has come."""


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
    """Waits for one subscription of its node, calls `poll`, and now and then what waits besides.

    The wait is on one entity, and its set is made once; an executor makes one of all entities in each round.
    """

    def __init__(self) -> None:
        super().__init__()
        self._polled: Any = None
        self._wait_set: Any = None
        self._next = 0.0

    def add_node(self, node: Node) -> bool:
        """The one node, a `Polled`; what was made before it stays, and is not searched for garbage any more."""
        self._polled, self._wait_set = node, WaitSet(1, 0, 0, 0, 0, 0, self._context.handle)
        gc.freeze()
        gc.set_threshold(YOUNG)
        return bool(super().add_node(node))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """One round."""
        if timeout_sec:
            self._wait(min(timeout_sec, SERVE))
            self._polled.poll()
        if not timeout_sec or monotonic() >= self._next:
            self._next = monotonic() + (0.0 if self._serve() else SERVE)

    def _serve(self) -> bool:
        """One callback of what waits besides; whether there was one."""
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
        except (TimeoutException, ShutdownException):
            return False
        handler()
        if (error := handler.exception()) is not None:
            raise error
        return True

    def _wait(self, timeout: float) -> None:
        with self._polled.awaited.handle:
            self._wait_set.clear_entities()
            self._wait_set.add_subscription(self._polled.awaited.handle)
            self._wait_set.wait(int(timeout * S_TO_NS))


def waiting(subscription: Subscription) -> Iterator[bytes]:
    """The messages of a raw subscription that have come already."""
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            yield taken[0]
