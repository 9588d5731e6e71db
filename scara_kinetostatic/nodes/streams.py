"""The two topics of a cell as a node hears them: quality of service, reception, frames, and what is wrong with them.

A calibration needs every sample: the simulator offers reliable streams with a deep history, and the collector requests
the same. Many drivers offer sensor topics as best effort only, which a reliable subscription does not match; the
subscription then requests best effort.

`tf2_msgs` is not needed: without it a `frame_id` is judged by its name alone, and no force is turned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from functools import partial
from itertools import islice
from time import monotonic
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.wait_for_message import wait_for_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from scara_kinetostatic.bags.decoding import TF_STATIC, decode_transforms
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NANO
from scara_kinetostatic.nodes.conversion import JointReader, Sample, UnusableMessageError, frame_of, wrench_sample
from scara_kinetostatic.touches.streams import ALTERNATE, WrenchFrame, alternate

try:
    from tf2_msgs.msg import TFMessage as TFMessage
except ImportError:
    TFMessage = None


RELIABLE_STREAM = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
"""Joint states and wrenches, both ends: 5 s at 1 kHz are kept while the subscriber is busy."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""The last value, delivered to later subscribers, too."""
LATCHED_TOUCHES = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""The touches so far, delivered to later subscribers, too."""
QUEUE = 10
"""Messages of other topics that are kept."""
NEWEST = QoSProfile(depth=4, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Matches every publisher; samples that a busy machine has let wait are left out."""


def forget_oldest(touches: dict[tuple[str, str], Any]) -> None:
    """Keeps as many touches as the topic has for one who hears it anew."""
    for key in list(touches)[: -LATCHED_TOUCHES.depth]:
        del touches[key]


class Stream(Enum):
    """The two topics."""

    JOINTS = 'joints'
    WRENCH = 'wrench'


def waiting(subscription: Subscription) -> Iterator[tuple[bytes, dict[str, Any]]]:
    """The messages of a raw subscription that have come already, and what the middleware says of each."""
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            yield taken


def publishers_of(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish a topic, one for each publisher."""
    found = node.get_publishers_info_by_topic(topic)
    return [f'{item.node_namespace.rstrip("/")}/{item.node_name}' for item in found]


class StreamMonitor:
    """Hears one topic and counts its messages; what is wrong with them is said in reports, one a second.

    Args:
        topic: its full name.

    Attributes:
        topic: its full name.
        publishers: full names of the nodes that publish it, one for each publisher.
        joints: of each message since the last report, as `JointReader.joints` says.
        count: messages so far.
        unusable: messages so far that did not hold what is needed.
        parts: messages so far that gave no sample, as joint states of other joints alone.
        lost: messages so far that were published but not received.
        refusal: why the last message could not be used; empty where it could.
        has_moved: whether because a joint that is to be held is elsewhere.
        problem: of the messages until the last report; empty where usable ones came: where several drivers publish
            joint states on one topic, good and unusable ones alternate.
    """

    def __init__(self, topic: str) -> None:
        self.topic, self.problem = topic, ''
        self.publishers: list[str] = []
        self.joints, self._joints_before = set[frozenset[str]](), set[frozenset[str]]()
        self._positions, self._alternate = list[Sequence[float]](), False
        self.count = self.unusable = self.parts = self.lost = 0
        self.refusal, self.has_moved = '', False
        self._number = 0
        self._retry: Timer | None = None
        self._reported, self._others, self._parted = (monotonic(), 0, 0, 0, 0), 0, 0

    def accept(self, *positions: Sequence[float]) -> None:
        """Notes a usable message, with the joint angles that it completes."""
        self.count += 1
        self.refusal, self.has_moved = '', False
        if len(self._positions) < RELIABLE_STREAM.depth:  # between two reports
            self._positions += positions

    def note_part(self, awaited: str) -> None:
        """Notes a message that gives no sample before another joint is heard of."""
        self.count += 1
        self.parts += 1
        self.refusal = self.refusal if self.has_moved else f'nothing yet of {awaited}'

    def refuse(self, problem: str, *, has_moved: bool = False) -> None:
        """Notes a message that cannot be used."""
        self.count += 1
        self.unusable += 1
        self.refusal, self.has_moved = problem, has_moved

    def follow(self, number: int | None, publishers: Callable[[], int]) -> None:
        """Counts the messages missing before one, also those that newer ones displaced from the queue.

        Args:
            number: of the message: a publisher numbers its messages without gaps; None or 0 where the middleware does
                not state it.
            publishers: returns the number of publishers; with several the number does not tell.
        """
        missed = (number or 0) - self._number - 1
        if self._number and missed > 0 and publishers() <= 1:
            self.lost += missed
        self._number = number or 0

    def report(self, expected: bool = True) -> tuple[list[str], dict[str, str]]:
        """What is wrong with the messages since the last report, and the figures by name.

        Args:
            expected: whether there ought to be messages.
        """
        since, *before = self._reported
        self._reported = now, *totals = monotonic(), self.count, self.unusable, self.lost, self.parts
        count, self._others, lost, self._parted = (total - former for total, former in zip(totals, before, strict=True))
        if count > self._others + self._parted:
            self.problem = ''
        elif self._others or self._parted:
            self.problem = self.refusal
        self._alternate, self._positions = alternate(np.array(self._positions).reshape(-1, 2)), []
        if count:
            self._joints_before, self.joints = self.joints, set()
        problems = [self.problem or ('no messages' if expected and not count else '')]
        if lost:
            problems.append(f'{lost} messages lost on the way; this machine or the network is too busy')
        values = {
            'publishers': ', '.join(self.publishers) or 'none',
            'rate [Hz]': f'{count / max(now - since, NANO):.1f}',
            'messages': str(self.count),
            'unusable': str(self.unusable),
            'lost': str(self.lost),
        }
        complaints = [f'{self.topic}: {problem}' for problem in problems if problem]
        return [*complaints, self.mixture()], {f'{self.topic}: {name}': value for name, value in values.items()}

    def mixture(self) -> str:
        """That messages of several robots mix, by the publishers or by the numbers; empty if they do not.

        One publisher for each joint of the arm is no trouble, nor is one of other joints.
        """
        if self.problem or len(self.publishers) <= max(1, len(self.joints | self._joints_before)):
            return f'{self.topic}: {ALTERNATE}' if self._alternate else ''
        several = f'{len(self.publishers)} publishers ({", ".join(sorted(self.publishers))})'
        return f'{self.topic}: {several}, whose messages mix: give each cell a namespace'

    def subscribe(self, node: Node, kind: type, name: str, callback: Callable[[bytes, int, bool], None]) -> None:
        """Requests a reliable stream; where a publisher offers best effort only, requests that.

        The middleware reports such a publisher by an "incompatible QoS" event. Best effort matches reliable publishers,
        too, so one step down is enough. An executor takes one message per round, and a round costs three times as much
        as a message. So each round empties the queue.

        Args:
            node: on which to subscribe.
            kind: of the messages.
            name: of the topic as the node says it.
            callback: gets each message as its serialized bytes (CDR), when the middleware received it, ns of the
                system's clock, 0 where it does not say; and whether more are there already.
        """
        self._node, self._kind, self._name, self._callback = node, kind, name, callback
        self._request(RELIABLE_STREAM, SubscriptionEventCallbacks(incompatible_qos=self._notice))

    def _request(self, profile: QoSProfile, events: SubscriptionEventCallbacks | None = None) -> None:
        self._subscription = self._node.create_subscription(
            self._kind, self._name, self._receive, profile, event_callbacks=events, raw=True
        )

    def _receive(self, message: bytes, info: dict[str, Any]) -> None:
        taken = [(message, info), *islice(waiting(self._subscription), 200)]  # then timers are served
        for left, (each, known) in zip(reversed(range(len(taken))), taken, strict=True):
            self.follow(known.get('publication_sequence_number'), self._subscription.get_publisher_count)
            self._callback(each, int(known.get('received_timestamp') or 0), left > 0)

    def _notice(self, event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        text = f'{self.topic}: a publisher offers another {policy}; asking for best effort'
        self._node.get_logger().info(text)
        if self._retry is None:  # not here: the executor still holds the subscription whose event this is
            self._retry = self._node.create_timer(0.0, self._step_down)

    def _step_down(self) -> None:
        assert self._retry is not None
        self._retry.cancel()
        self._node.destroy_subscription(self._subscription)
        self._request(QoSProfile(depth=RELIABLE_STREAM.depth, reliability=ReliabilityPolicy.BEST_EFFORT))


class FrameCheck:
    """How wrenches are turned into the frame of the cell description, by the fixed transforms on `/tf_static`.

    Args:
        node: on which to subscribe.
        cell: whose sensor it is.
        changed: called with each message of fixed transforms that says something new, as it came, and whether wrenches
            like the last one are turned otherwise by it.

    Attributes:
        last: the last wrench as it came over the wire; empty before the first.
    """

    def __init__(self, node: Node, cell: Cell, changed: Callable[[bytes, bool], None]) -> None:
        self.last = b''
        self._logger, self._stated, self._changed = node.get_logger(), cell.sensor.frame, changed
        self._frame = WrenchFrame(cell, node.get_parameter_or('frame_prefix', Parameter('')).value or '')
        self._known: dict[tuple[str, ...], bytes] = {}
        self._turned: tuple[str, list[list[float]] | None] | None = None
        if TFMessage is None:
            text = 'tf2_msgs is not installed: the frame_id of a wrench is judged by its name, and no force is turned'
            self._logger.info(text)
        else:  # as every node of ROS subscribes to fixed transforms
            profile = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            node.create_subscription(TFMessage, TF_STATIC, self.note, profile, raw=True)

    @property
    def messages(self) -> list[bytes]:
        """The fixed transforms as they came, one message for each set of frames."""
        return list(self._known.values())

    def note(self, message: bytes) -> None:
        """Takes fixed transforms in, a `tf2_msgs/TFMessage` as it came over the wire."""
        try:
            transforms = decode_transforms(message)
        except ValueError as error:
            self._logger.warning(str(error))
            return
        key = tuple(sorted(item.child for item in transforms))
        if self._known.get(key) == message:
            return
        self._known[key] = message
        before = self.turn(self.last) if self.last else None
        for transform in transforms:
            self._frame.add(transform)
        self._turned = None
        self._changed(message, bool(self.last) and self.turn(self.last) != before)

    def turn(self, wrench: bytes) -> list[list[float]] | None:
        """How a wrench is turned, two rows of three; None where it is taken as it comes.

        Args:
            wrench: as it came over the wire.
        """
        self.last = wrench
        frame_id = frame_of(wrench)
        if self._turned is None or self._turned[0] != frame_id:
            turn = self._frame.turn(frame_id)
            self._turned = frame_id, None if turn is None else turn.tolist()
        return self._turned[1]

    def description(self) -> str:
        """How the last wrench is turned, in words."""
        if not self.last:
            return 'no wrench yet'
        frame_id = frame_of(self.last)
        return self._frame.description(frame_id) or f'{frame_id or "no frame_id"}: taken as {self._stated.value}'

    def complaint(self) -> str:
        """How the last wrench contradicts the cell description; empty if it does not."""
        return self._frame.complaint(frame_of(self.last)) if self.last else ''


class CellStreams:
    """The joint states and wrenches of a cell: their samples, their figures, and what is wrong with them.

    Args:
        node: that hears them.
        cell: whose topics they are.
        turned: called where fixed transforms change, see `FrameCheck`.
        judges: whether the node rejects what happens while another joint is not where it is to be held, and so takes
            such joint states; else they cannot be used.

    Attributes:
        monitors: of both topics.
        frame: how wrenches are turned.
    """

    def __init__(self, node: Node, cell: Cell, turned: Callable[[bytes, bool], None], judges: bool = False) -> None:
        self._node, self._cell, self._judges = node, cell, judges
        self._moved = ''  # since the last examination
        self._joints = JointReader(cell.joint_names, cell.other_joints)
        self.frame = FrameCheck(node, cell, turned)
        self.monitors = {
            stream: StreamMonitor(node.resolve_topic_name(topic))
            for stream, topic in zip(Stream, cell.sensor[:2], strict=True)
        }

    def subscribe(self, take: Callable[[Stream, bytes, int, list[Sample]], None]) -> None:
        """Hears both topics.

        Args:
            take: called with the stream, each message as its bytes, when it was received (ns, 0 where unknown), and the
                samples that it completes.
        """

        def receive(stream: Stream, message: bytes, received: int, more: bool) -> None:
            take(stream, message, received, self.samples(stream, message, received, more))

        kinds = zip((JointState, WrenchStamped), self._cell.sensor[:2], strict=True)
        for (kind, topic), (stream, monitor) in zip(kinds, self.monitors.items(), strict=True):
            monitor.subscribe(self._node, kind, topic, partial(receive, stream))

    def samples(self, stream: Stream, message: bytes, received: int = 0, more: bool = False) -> list[Sample]:
        """What a message, which is counted, completes; nothing where it cannot be used, or more has to come.

        Args:
            stream: where it came from.
            message: as its bytes.
            received: when it came, ns; 0: now.
            more: whether the next one is there already.
        """
        monitor = self.monitors[stream]
        try:
            if stream is Stream.WRENCH:
                samples = [wrench_sample(message, self.frame.turn(message))]
                monitor.accept()
                return samples
            samples = self._joints.samples(message, received, more)
        except UnusableMessageError as error:
            monitor.refuse(str(error))
            return []
        finally:
            if stream is Stream.JOINTS:
                monitor.joints.add(self._joints.joints)
        if not samples:
            monitor.note_part(self._joints.parts.awaited)
            return []
        moved = [self._cell.moved_joint(np.array(sample.others)) if sample.others else '' for sample in samples]
        if moved[-1] and not self._judges:
            monitor.refuse(moved[-1], has_moved=True)
            return []
        self._moved = next(filter(None, moved), self._moved)
        angles = [self._cell.angles(np.array(sample[1:3])).tolist() for sample in samples]
        monitor.accept(*angles)
        return [sample._replace(first=q1, second=q2) for sample, (q1, q2) in zip(samples, angles, strict=True)]

    @property
    def topics(self) -> tuple[str, str]:
        """Full names of both topics."""
        return self.monitors[Stream.JOINTS].topic, self.monitors[Stream.WRENCH].topic

    @property
    def is_taken_for_the_example(self) -> bool:
        """Whether a robot other than the simulated one has no cell description but that of the example."""
        robots = {name.rpartition('/')[2] for each in self.monitors.values() for name in each.publishers}
        return not self._node.get_parameter('cell').value and not robots <= {'contact_simulator'}

    def look_at_publishers(self) -> None:
        """Notes who publishes the topics."""
        for monitor in self.monitors.values():
            monitor.publishers = publishers_of(self._node, monitor.topic)

    def examine(self, expected: bool = True) -> tuple[list[str], dict[str, str]]:
        """What is wrong, empty texts for nothing, and the figures by name; once a second. Looks who publishes.

        Args:
            expected: whether there ought to be messages.
        """
        self.look_at_publishers()
        complaints, values = [self.frame.complaint(), self._moved], {'wrench frame': self.frame.description()}
        self._moved = ''
        for monitor in self.monitors.values():
            found, figures = monitor.report(expected)
            complaints += found
            values |= figures
        return complaints, values


def heard_description(topic: str) -> str:
    """The URDF of a robot on a topic, as `robot_state_publisher` publishes it: `std_msgs/msg/String`, latched.

    Raises:
        InputError: the name is none of a topic, or nothing comes within 10 s.
    """
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.ALL)
    try:
        node = rclpy.create_node('cell', context=context)
        found, message = wait_for_message(String, node, topic, qos_profile=LATCHED, time_to_wait=10.0)
    except InvalidTopicNameException as error:
        raise InputError(topic, 'is no name of a topic', 'write it as ros2 topic list does') from error
    finally:
        context.try_shutdown()
    if not found:
        remedy = 'start robot_state_publisher, or give the file by --urdf'
        raise InputError(topic, 'no robot description in 10 s', remedy)
    return str(message.data)
