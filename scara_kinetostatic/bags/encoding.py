"""Encoding: arrays to the bytes of messages, whole streams at once; the inverse of `decoding`.

Also the description of topics in a recording: message definitions, type hashes and quality of service.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.typesys import Stores, get_typestore

from scara_kinetostatic.bags.messages import JOINT_STATE, STRING, WRENCH_STAMPED
from scara_kinetostatic.bags.transforms import TF_MESSAGE, TF_STATIC
from scara_kinetostatic.files.cell_file import CELL_TOPIC
from scara_kinetostatic.model.cell import Cell

DISCARD_TOPIC = '/discarded_touch'
"""Carries, for each touch that was discarded while recording, `{"touch": 5, "stamp": 1700…, "received": 1700…}`: its
number, the middle of its hold by the clock of the streams, and when that was received, ns."""
OfferedQos: TypeAlias = Qos
"""Quality of service that a publisher offers."""
_FOREVER = QosTime(9223372036, 854775807)


class Channel(NamedTuple):
    """A topic to be written.

    Attributes:
        topic: its name.
        msgtype: its type.
        definition: the type's text with all it depends on (`ros2msg`).
        digest: the type's hash (REP 2011).
        qos: quality of service to be offered when the recording is played.
    """

    topic: str
    msgtype: str
    definition: str
    digest: str
    qos: Qos


def channels(cell: Cell, topics: tuple[str, str] | None = None) -> tuple[Channel, Channel, Channel]:
    """The topics of a recording of a cell: its description, joint states, wrenches.

    Args:
        cell: the cell.
        topics: names of the last two as recorded; by default those of the cell, in the root namespace.
    """
    joint_states, wrench = topics or cell.sensor.topics
    return (
        _channel(CELL_TOPIC, STRING, QosDurability.TRANSIENT_LOCAL, 1),
        _channel(joint_states, JOINT_STATE, QosDurability.VOLATILE, 10),
        _channel(wrench, WRENCH_STAMPED, QosDurability.VOLATILE, 10),
    )


def offered_qos(
    reliability: str, durability: str, liveliness: str, deadline: int, lifespan: int, lease: int
) -> OfferedQos:
    """Quality of service by the names of its policies, as the ROS graph has it; history and depth are not in the graph.

    Args:
        reliability: `RELIABLE` or `BEST_EFFORT`.
        durability: `VOLATILE` or `TRANSIENT_LOCAL`.
        liveliness: `AUTOMATIC` or `MANUAL_BY_TOPIC`.
        deadline: ns.
        lifespan: ns.
        lease: duration of the liveliness, ns.
    """
    return Qos(
        QosHistory.UNKNOWN,
        0,
        getattr(QosReliability, reliability, QosReliability.UNKNOWN),
        getattr(QosDurability, durability, QosDurability.UNKNOWN),
        _time(deadline),
        _time(lifespan),
        getattr(QosLiveliness, liveliness, QosLiveliness.UNKNOWN),
        _time(lease),
        False,
    )


def _time(nanoseconds: int) -> QosTime:
    return QosTime(*divmod(nanoseconds, 1_000_000_000))


def discard_channel() -> Channel:
    """The topic on which a collector records that a touch is discarded."""
    return _channel(DISCARD_TOPIC, STRING, QosDurability.VOLATILE, 10)


def transform_channel() -> Channel:
    """The topic of the fixed transforms."""
    return _channel(TF_STATIC, TF_MESSAGE, QosDurability.TRANSIENT_LOCAL, 100)


def _channel(topic: str, msgtype: str, durability: QosDurability, depth: int) -> Channel:
    definition, digest = _definition(msgtype)
    qos = Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )
    return Channel(topic, msgtype, definition, digest, qos)


@lru_cache
def _definition(msgtype: str) -> tuple[str, str]:
    store = get_typestore(Stores.ROS2_JAZZY)
    return store.generate_msgdef(msgtype, ros_version=2)[0], store.hash_rihs01(msgtype)


class _Template:
    """Builds one message field by field; the inverse of the decoder's cursor."""

    def __init__(self, *, ros1: bool) -> None:
        self.data = bytearray(4 if ros1 else b'\0\1\0\0')
        self.origin = 0 if ros1 else 4

    def align(self, size: int) -> None:
        if self.origin:
            self.data += bytes(-(len(self.data) - self.origin) % size)

    def count(self, value: int) -> None:
        self.align(4)
        self.data += struct.pack('<I', value)

    def text(self, value: str) -> None:
        content = value.encode() + (b'\0' if self.origin else b'')
        self.count(len(content))
        self.data += content

    def doubles(self, count: int) -> int:
        self.align(8)
        start = len(self.data)
        self.data += bytes(8 * count)
        return start


def joint_state_messages(
    stamp: NDArray[np.int64], position: NDArray[np.float64], names: tuple[str, str], *, ros1: bool = False
) -> list[bytes]:
    """`JointState` messages without velocity and effort.

    Args:
        stamp: header stamps, (n,), ns.
        position: q1, q2, (n, 2), rad.
        names: joint names of q1 and q2.
        ros1: in ROS 1's format instead of CDR.

    Returns:
        n messages.
    """
    template = _Template(ros1=ros1)
    template.data += bytes(8)
    template.text('')
    template.count(len(names))
    for name in names:
        template.text(name)
    template.count(2)
    start = template.doubles(2)
    template.count(0)
    template.count(0)
    return _filled(template, stamp, start, position)


def wrench_messages(
    stamp: NDArray[np.int64], force: NDArray[np.float64], frame_id: str, *, ros1: bool = False
) -> list[bytes]:
    """`WrenchStamped` messages with a force in the plane.

    Args:
        stamp: header stamps, (n,), ns.
        force: fx, fy, (n, 2), N.
        frame_id: of the header.
        ros1: in ROS 1's format instead of CDR.

    Returns:
        n messages.
    """
    template = _Template(ros1=ros1)
    template.data += bytes(8)
    template.text(frame_id)
    return _filled(template, stamp, template.doubles(6), force)


def string_message(text: str, *, ros1: bool = False) -> bytes:
    """A `std_msgs/msg/String`."""
    template = _Template(ros1=ros1)
    if ros1:
        template.data.clear()
    template.text(text)
    return bytes(template.data)


def _filled(template: _Template, stamp: NDArray[np.int64], start: int, values: NDArray[np.float64]) -> list[bytes]:
    size = len(template.data)
    seconds, nanoseconds = np.divmod(np.asarray(stamp, dtype=np.int64), 1_000_000_000)
    rows = np.tile(np.frombuffer(bytes(template.data), np.uint8), (len(stamp), 1))
    rows[:, 4:12] = np.stack([seconds, nanoseconds], axis=1).astype('<u4').view(np.uint8)
    rows[:, start : start + 16] = np.ascontiguousarray(values, dtype='<f8').view(np.uint8)
    data = rows.tobytes()
    return [data[at : at + size] for at in range(0, len(data), size)]
