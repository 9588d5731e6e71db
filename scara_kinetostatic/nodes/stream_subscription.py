"""Quality of service of the topics, and a subscription to raw messages at 1 kHz.

A calibration needs every sample: the simulator offers reliable streams with a deep history, and the collector requests
the same. Many drivers offer sensor topics as best effort only, which a reliable subscription does not match; the
subscription then requests best effort.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo

from scara_kinetostatic.nodes.stream_monitor import SequenceMonitor

STREAM_DEPTH = 5000
"""Samples kept while the subscriber is busy: 5 s at 1 kHz."""

RELIABLE_STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=STREAM_DEPTH,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)
"""Joint states and wrenches, both ends."""

BEST_EFFORT_STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=STREAM_DEPTH,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""The same for a publisher that offers best effort only."""

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The last value, delivered to later subscribers, too."""

LATCHED_TOUCHES = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The touches so far, delivered to later subscribers, too."""

DIAGNOSTICS = 10
"""Depth of `/diagnostics`, as everywhere in ROS."""

MOST_AT_ONCE = 200
"""Most messages taken in one callback; then services and timers are served."""


class StreamSubscription:
    """Requests a reliable stream; where a publisher offers best effort only, requests that.

    The middleware reports such a publisher by an "incompatible QoS" event.
    Best effort matches reliable publishers, too, so one step down is enough.

    An executor takes one message per round, and a round costs three times as much as a message. So each round empties
    the queue.

    Args:
        node: on which to subscribe.
        message_type: of the topic.
        topic: its name.
        callback: gets each message as its serialized bytes (CDR), and when the middleware received it, ns of the
            system's clock; 0 where it does not say.
        lost: called with the number of messages missing before one, where the middleware numbers them.

    Attributes:
        topic: its full name, remapped.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        callback: Callable[[bytes, int], None],
        lost: Callable[[int], None],
    ) -> None:
        self._node = node
        self._message_type = message_type
        self._name, self.topic = topic, node.resolve_topic_name(topic)
        self._callback = callback
        self._lost = lost
        self._sequence = self._new_sequence()
        self._retry: Timer | None = None
        self._subscription = self._subscribe(RELIABLE_STREAM, SubscriptionEventCallbacks(incompatible_qos=self._notice))

    def publishers(self) -> list[TopicEndpointInfo]:
        """Who publishes the topic."""
        return list(self._node.get_publishers_info_by_topic(self.topic))

    def _new_sequence(self) -> SequenceMonitor:
        return SequenceMonitor(lambda: self._subscription.get_publisher_count())

    def _subscribe(self, profile: QoSProfile, events: SubscriptionEventCallbacks | None = None) -> Subscription:
        return self._node.create_subscription(
            self._message_type, self._name, self._receive, profile, event_callbacks=events, raw=True
        )

    def _receive(self, message: bytes, info: dict[str, Any]) -> None:
        self._take(message, info)
        with self._subscription.handle:
            for _ in range(MOST_AT_ONCE):
                taken = self._subscription.handle.take_message(self._message_type, True)
                if taken is None:
                    return
                self._take(*taken)

    def _take(self, message: bytes, info: dict[str, Any]) -> None:
        missed = self._sequence.missed(info.get('publication_sequence_number'))
        if missed:
            self._lost(missed)
        self._callback(message, int(info.get('received_timestamp') or 0))

    def _notice(self, event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        self._node.get_logger().info(f'{self.topic}: a publisher offers another {policy}; asking for best effort')
        if self._retry is None:  # Not here: the executor still holds the subscription whose event this is.
            self._retry = self._node.create_timer(0.0, self._step_down)

    def _step_down(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
        self._node.destroy_subscription(self._subscription)
        self._sequence = self._new_sequence()
        self._subscription = self._subscribe(BEST_EFFORT_STREAM)
