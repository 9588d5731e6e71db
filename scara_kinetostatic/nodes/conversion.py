"""Messages to numbers and back; nothing else in the package takes a ROS message apart."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

NANOSECONDS = 1_000_000_000


class Sample(NamedTuple):
    """Two numbers with the stamp of their header: q1, q2 in rad, or fx, fy in N."""

    stamp_ns: int
    first: float
    second: float


class UnusableMessageError(Exception):
    """A message that does not hold what is needed; the text says what it lacks."""


def stamp_of(nanoseconds: int) -> Time:
    """The time as a message."""
    return Time(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def joint_state(sample: Sample, names: Sequence[str]) -> JointState:
    """A message with both joint angles."""
    message = JointState(name=list(names), position=[sample.first, sample.second])
    message.header.stamp = stamp_of(sample.stamp_ns)
    return message


def wrench(sample: Sample, frame_id: str) -> WrenchStamped:
    """A message with the force in the plane; all else is 0."""
    message = WrenchStamped()
    message.header.frame_id = frame_id
    message.header.stamp = stamp_of(sample.stamp_ns)
    message.wrench.force.x = sample.first
    message.wrench.force.y = sample.second
    return message


def joint_sample(serialized: bytes, names: Sequence[str]) -> Sample:
    """Both joint angles, found by name.

    Args:
        serialized: a `JointState` as it came over the wire.
        names: of q1 and q2.

    Raises:
        UnusableMessageError: a joint is missing, or has no position, or none that is a finite number.
    """
    message = deserialize_message(serialized, JointState)
    position = dict(zip(message.name, message.position, strict=False))
    missing = [name for name in names if name not in position]
    if missing:
        raise UnusableMessageError(
            f'expected positions of {" and ".join(names)}, got {len(message.position)} positions of '
            f'{" ".join(message.name) or "no joints"}'
        )
    return _finite(Sample(_nanoseconds(message.header.stamp), position[names[0]], position[names[1]]))


def wrench_sample(serialized: bytes) -> Sample:
    """The force in the plane, as the sensor gives it.

    Args:
        serialized: a `WrenchStamped` as it came over the wire.

    Raises:
        UnusableMessageError: the force is not finite.
    """
    message = deserialize_message(serialized, WrenchStamped)
    return _finite(Sample(_nanoseconds(message.header.stamp), message.wrench.force.x, message.wrench.force.y))


def _finite(sample: Sample) -> Sample:
    if not (isfinite(sample.first) and isfinite(sample.second)):
        raise UnusableMessageError(f'expected finite numbers, got {sample.first} and {sample.second}')
    return sample


def _nanoseconds(stamp: Time) -> int:
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)
