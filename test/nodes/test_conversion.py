"""Reading messages from their bytes gives what deserializing them gives."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.conversion import JointReader, Sample, UnusableMessageError, frame_of, wrench_sample

NAMES = ('joint1', 'joint2')
STAMP = 1_700_000_000_123_456_789


def joints(names: list[str], position: list[float], frame: str = '') -> bytes:
    message = JointState(name=names, position=position, velocity=[1.0] * len(position))
    message.header.frame_id = frame
    message.header.stamp = conversion.stamp_of(STAMP)
    return bytes(serialize_message(message))


@pytest.mark.parametrize('frame', ['', 'b', 'base', 'tool0', 'länger als sonst'])
def test_a_wrench(frame: str) -> None:
    message = conversion.wrench((STAMP, 1.5, -2.5), frame)
    assert wrench_sample(bytes(serialize_message(message))) == Sample(STAMP, 1.5, -2.5)
    assert frame_of(bytes(serialize_message(message))) == frame


@pytest.mark.parametrize('frame', ['', 'b', 'base', 'tool0'])
@pytest.mark.parametrize(
    ('names', 'position'),
    [
        (['joint1', 'joint2'], [0.25, -0.5]),
        (['joint2', 'lift', 'joint1'], [-0.5, 7.0, 0.25]),
        (['a', 'bc', 'joint1', 'defgh', 'joint2'], [1.0, 2.0, 0.25, 3.0, -0.5]),
    ],
)
def test_joint_angles_by_name(frame: str, names: list[str], position: list[float]) -> None:
    assert JointReader(NAMES).sample(joints(names, position, frame)) == Sample(STAMP, 0.25, -0.5)


@pytest.mark.parametrize(
    ('names', 'position', 'said'),
    [
        ([], [], 'got 0 positions of no joints'),
        (['joint1', 'joint2'], [1.0], 'got 1 positions of joint1 joint2'),
        (['shoulder', 'elbow'], [1.0, 2.0], 'got 2 positions of shoulder elbow'),
        (['joint1', 'joint2'], [nan, 2.0], 'expected plausible numbers'),
        (['joint1', 'joint2'], [1.7e308, 2.0], 'expected plausible numbers'),
    ],
)
def test_joint_states_that_cannot_be_used(names: list[str], position: list[float], said: str) -> None:
    with pytest.raises(UnusableMessageError, match=said):
        JointReader(NAMES).sample(joints(names, position))


def test_a_message_that_is_cut_off() -> None:
    whole = joints(['joint1', 'joint2'], [0.25, -0.5])
    needed = len(whole) - 4 - 4 - 2 * 8 - 8
    for length in range(4, needed):
        with pytest.raises(UnusableMessageError):
            JointReader(NAMES).sample(whole[:length])
    whole = bytes(serialize_message(WrenchStamped()))
    for length in range(4, len(whole)):
        with pytest.raises(UnusableMessageError, match='cut off'):
            wrench_sample(whole[:length])
    with pytest.raises(UnusableMessageError):
        JointReader(NAMES).sample(b'\0\1\0\0' + b'\xff' * 60)


def test_times_before_1970() -> None:
    message = JointState(name=list(NAMES), position=[1.0, 2.0])
    message.header.stamp.sec, message.header.stamp.nanosec = -1, 5
    sample = JointReader(NAMES).sample(bytes(serialize_message(message)))
    assert sample == Sample(-999_999_995, 1.0, 2.0)


def test_other_joints_are_found_by_name() -> None:
    message = joints([*NAMES, 'wrist'], [0.25, -0.5, 0.3])
    sample = JointReader(NAMES, ('lift', 'wrist')).sample(message)
    assert sample is not None
    assert sample[1:3] == (0.25, -0.5)
    assert np.isnan(sample.others[0])
    assert sample.others[1] == 0.3
