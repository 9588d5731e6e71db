"""Bulk decoding and encoding agree with the general (de)serialiser of `rosbags`, whatever the messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bags.forms import STORE as ROS2
from bags.forms import joint_state as joint_message
from hypothesis import given, settings
from hypothesis import strategies as st

from scara_kinetostatic.bags.decoding import (
    JOINT_STATE,
    STRING,
    WRENCH_STAMPED,
    Batch,
    Decoder,
    Topic,
    decode_string,
    joint_state_messages,
    string_message,
    wrench_messages,
)

finite = st.floats(-1e6, 1e6)
stamps = st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
frames = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=9)


def batch(msgtype: str, payloads: list[bytes]) -> Batch:
    return Batch.from_payloads(Topic('/t', msgtype, 'cdr'), list(range(len(payloads))), payloads)


def joint_state(stamp: tuple[int, int], frame: str, names: list[str], position: list[float], rest: int) -> bytes:
    return joint_message(stamp[0] * 10**9 + stamp[1], names, position, frame, rest).payload


def wrench(stamp: tuple[int, int], frame: str, force: tuple[float, float]) -> bytes:
    types = ROS2.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](*stamp), frame)
    vectors = (types['geometry_msgs/msg/Vector3'](*values) for values in ((*force, 3.0), (4.0, 5.0, 6.0)))
    message = types[WRENCH_STAMPED](header, types['geometry_msgs/msg/Wrench'](*vectors))
    return bytes(ROS2.serialize_cdr(message, WRENCH_STAMPED))


@st.composite
def joint_states(draw: st.DrawFn) -> tuple[tuple[int, int], str, list[str], list[float], int]:
    names = draw(st.permutations(['q1', 'q2', *draw(st.lists(frames, max_size=3))]))
    position = draw(st.lists(finite, min_size=len(names), max_size=len(names)))
    return draw(stamps), draw(frames), list(names), position, draw(st.sampled_from([0, len(names)]))


@given(messages=st.lists(joint_states(), min_size=1, max_size=12))
@settings(max_examples=40, deadline=None)
def test_joint_states_of_any_layout(messages):
    decoder = Decoder(('q1', 'q2'))
    decoder.add(batch(JOINT_STATE, [joint_state(*message) for message in messages]))
    samples = decoder.samples()
    expected = [[position[names.index(name)] for name in ('q1', 'q2')] for _, _, names, position, _ in messages]
    np.testing.assert_array_equal(samples.values, expected)
    assert samples.stamp.tolist() == [stamp[0] * 10**9 + stamp[1] for stamp, *_ in messages]
    assert samples.log_time.tolist() == list(range(len(messages)))
    assert not decoder.dropped


@given(messages=st.lists(st.tuples(stamps, frames, st.tuples(finite, finite)), min_size=1, max_size=12))
@settings(max_examples=40, deadline=None)
def test_wrenches_of_any_layout(messages):
    decoder = Decoder()
    decoder.add(batch(WRENCH_STAMPED, [wrench(*message) for message in messages]))
    samples = decoder.samples()
    np.testing.assert_array_equal(samples.values, [force for _, _, force in messages])
    assert samples.stamp.tolist() == [stamp[0] * 10**9 + stamp[1] for stamp, *_ in messages]


@pytest.mark.parametrize('names', [('joint1', 'joint2'), ('a', 'gelenk_ü'), ('shoulder_pan_joint', 'e')])
def test_encoding_is_what_the_serialiser_writes(names):
    stamp = np.array([1, 1_700_000_000_999_999_999])
    values = np.array([[1.5, -2.5], [3e-9, 4e9]])
    for number, data in enumerate(joint_state_messages(stamp, values, names)):
        message: Any = ROS2.deserialize_cdr(data, JOINT_STATE)
        assert (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec) == stamp[number]
        assert message.name == list(names)
        np.testing.assert_array_equal(message.position, values[number])
        assert len(message.velocity) == len(message.effort) == 0
        assert len(data) == len(ROS2.serialize_cdr(message, JOINT_STATE))
    for number, data in enumerate(wrench_messages(stamp, values, 'tool')):
        message: Any = ROS2.deserialize_cdr(data, WRENCH_STAMPED)
        assert message.header.frame_id == 'tool'
        assert (message.wrench.force.x, message.wrench.force.y, message.wrench.force.z) == (*values[number], 0)
        assert data == bytes(ROS2.serialize_cdr(message, WRENCH_STAMPED))


@given(text=frames)
def test_strings(text):
    data = bytes(ROS2.serialize_cdr(ROS2.types[STRING](data=text), STRING))
    assert decode_string(data) == text
    assert string_message(text) == data


@given(payloads=st.lists(st.binary(max_size=120), max_size=30))
def test_garbage_never_becomes_a_sample_unnoticed(payloads):
    for decoder in (Decoder(('q1', 'q2')), Decoder()):
        decoder.add(batch(JOINT_STATE, payloads))
        samples = decoder.samples()
        assert len(samples.stamp) + sum(decoder.dropped.values()) == len(payloads)
        assert np.all(np.isfinite(samples.values))


def test_broken_off_messages_are_counted():
    whole = joint_state((1, 2), 'base', ['q1', 'q2'], [0.5, 0.25], 2)
    decoder = Decoder(('q1', 'q2'))
    decoder.add(batch(JOINT_STATE, [whole[:size] for size in range(len(whole) + 1)]))
    samples = decoder.samples()
    np.testing.assert_array_equal(np.unique(samples.values, axis=0), [[0.5, 0.25]])
    assert sum(decoder.dropped.values()) + len(samples.stamp) == len(whole) + 1


def test_why_messages_are_dropped():
    def make(names: list[str], position: list[float]) -> bytes:
        return joint_state((1, 0), '', names, position, 0)

    decoder = Decoder(('q1', 'q2'))
    payloads = [
        make(['q2', 'q1'], [2.0, 1.0]),
        make(['q1', 'q2'], []),
        make(['q1', 'q2'], [1.0]),
        make(['q1'], [1.0]),
        make(['gripper'], [1.0]),
        make([], []),
        make(['q1', 'q2'], [np.nan, 1.0]),
        make(['q1', 'q2'], [1.0, -np.inf]),
        make(['q1', 'x', 'q2'], [1.0, np.nan, 2.0]),
        b'\0\x07' + make(['q1', 'q2'], [1.0, 1.0])[2:],
    ]
    decoder.add(batch(JOINT_STATE, payloads))
    samples = decoder.samples()
    np.testing.assert_array_equal(samples.values, [[1, 2], [1, 2]])
    assert decoder.dropped == {
        'without positions': 1,
        'with 2 names and 1 position': 1,
        'without q1 and q2': 2,
        'with values that are not finite': 2,
        'in an encoding other than plain CDR': 1,
    }
    assert decoder.names == {'q1', 'q2', 'gripper', 'x'}


def test_other_joints_are_columns_of_their_own():
    names, wrist = ['q1', 'lift', 'q2', 'wrist'], [0.5, np.nan]
    payloads = [joint_state((k, 0), '', names, [0.1 * k, 0.0, 0.2 * k, at], 0) for k, at in enumerate(wrist)]
    payloads.append(joint_state((2, 0), '', ['q1', 'q2'], [0.3, 0.4], 0))
    decoder = Decoder(('q1', 'q2'), ('wrist', 'not_published'))
    decoder.add(batch(JOINT_STATE, payloads))
    samples = decoder.samples()
    np.testing.assert_allclose(
        samples.values, [[*angles, 0.5, np.nan] for angles in ((0.0, 0.0), (0.1, 0.2), (0.3, 0.4))]
    )
    assert not +decoder.dropped
