"""Stamps in disorder: mended where that is safe, refused where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags.forms import CELL, T0, assert_same, force_messages, joint_messages, make_streams, write_mcap

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 1_000_000_000


def record(
    path: Path, joints: np.ndarray, wrench: np.ndarray, log_joints: np.ndarray, log_wrench: np.ndarray
) -> Streams:
    """A recording with the given header stamps and recording times, read again."""
    made = make_streams(len(joints), len(wrench))
    made = Streams('x', JointStream(joints, made.joints.position), WrenchStream(wrench, made.wrench.force))
    items = [item._replace(log_time=int(t)) for item, t in zip(joint_messages(made), log_joints, strict=True)]
    items += [item._replace(log_time=int(t)) for item, t in zip(force_messages(made), log_wrench, strict=True)]
    write_mcap(path / 'a.mcap', sorted(items, key=lambda item: item.log_time))
    return read_streams(path / 'a.mcap', CELL)


@pytest.fixture
def stamps() -> tuple[np.ndarray, np.ndarray]:
    made = make_streams()
    return made.joints.stamp, made.wrench.stamp


def test_header_stamps_count_not_log_times(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    rng = np.random.default_rng(0)
    late = [np.sort(stamp + rng.integers(5_000_000, 20_000_000, len(stamp))) for stamp in stamps]
    read = record(tmp_path, joints, wrench, *late)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    assert read.warnings == ()


@pytest.mark.parametrize('constant', [0, T0])
def test_missing_stamps_fall_back_to_log_times(
    tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray], constant: int
) -> None:
    """On both topics, since the two must share one clock."""
    joints, wrench = stamps
    read = record(tmp_path, np.full_like(joints, constant), wrench, joints + 5, wrench + 9)
    np.testing.assert_array_equal(read.joints.stamp, joints + 5)
    np.testing.assert_array_equal(read.wrench.stamp, wrench + 9)
    assert len(read.warnings) == 1
    assert 'the recording times were used instead' in read.warnings[0]


def test_no_time_at_all(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    with pytest.raises(
        RecordingError, match=r'`header.stamp` of /joint_states is zero or constant, and all were recorded at once'
    ):
        record(tmp_path, joints * 0, wrench * 0, joints * 0, wrench * 0)


def test_a_few_messages_without_stamp(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    some = joints.copy()
    some[[3, 77]] = 0
    read = record(tmp_path, some, wrench, joints, wrench)
    np.testing.assert_array_equal(read.joints.stamp, np.delete(joints, [3, 77]))
    assert read.warnings == ('/joint_states: 2 messages dropped whose stamp is zero or far off those around it',)


def test_one_stamp_far_off(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    wild = wrench.copy()
    wild[50] += 3600 * SECOND
    read = record(tmp_path, joints, wild, joints, wrench)
    np.testing.assert_array_equal(read.wrench.stamp, np.delete(wrench, 50))
    assert read.warnings == ('/wrench: 1 message dropped whose stamp is zero or far off those around it',)


def test_strays_at_the_ends_and_a_long_pause(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = (np.where(stamp > stamp[150], stamp + 3600 * SECOND, stamp) for stamp in stamps)
    wild = joints.copy()
    wild[[0, -1]] = 0
    read = record(tmp_path, wild, wrench, joints, wrench)
    np.testing.assert_array_equal(read.joints.stamp, joints[1:-1])
    np.testing.assert_array_equal(read.wrench.stamp, wrench)
    assert read.warnings == ('/joint_states: 2 messages dropped whose stamp is zero or far off those around it',)


def test_disorder_is_sorted(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    swapped = joints.copy()
    swapped[[10, 11]] = swapped[[11, 10]]
    read = record(tmp_path, swapped, wrench, joints, wrench)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    expected = make_streams().joints.position
    expected[[10, 11]] = expected[[11, 10]]
    np.testing.assert_array_equal(read.joints.position, expected)
    assert read.warnings == ('/joint_states: 1 message out of order, sorted',)


def test_repeated_stamps_are_dropped(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    repeated = wrench.copy()
    repeated[[20, 21]] = repeated[19]
    read = record(tmp_path, joints, repeated, joints, wrench)
    np.testing.assert_array_equal(read.wrench.stamp, np.delete(wrench, [20, 21]))
    np.testing.assert_array_equal(read.wrench.force, np.delete(make_streams().wrench.force, [20, 21], axis=0))
    assert read.warnings == ('/wrench: 2 messages dropped whose stamp is that of another',)


def test_a_clock_that_was_reset(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    """As when a simulation restarts while the recording times run on, or the computer's clock is set."""
    joints, wrench = stamps
    reset = joints.copy()
    reset[150:] -= 2 * SECOND
    refusal = r'`header.stamp` of /joint_states steps back by 1\.99 s; record in one run.*sensor\.time_offset'
    with pytest.raises(RecordingError, match=refusal):
        record(tmp_path, reset, wrench, joints, wrench)
    made = make_streams()
    made = Streams('x', JointStream(reset, made.joints.position), made.wrench)
    write_mcap(tmp_path / 'b.mcap', [*joint_messages(made), *force_messages(made)])
    with pytest.raises(RecordingError, match=refusal):
        read_streams(tmp_path / 'b.mcap', CELL)


def test_topics_on_different_clocks(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    read = record(tmp_path, joints, wrench - T0 + 5 * SECOND, joints + 3, wrench + 4)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    np.testing.assert_allclose(read.wrench.stamp - T0, wrench - T0, rtol=0, atol=1000)
    assert len(read.warnings) == 1
    assert 'comes from clocks that differ by 1.7e+09 s: the stamps of /wrench were shifted' in read.warnings[0]


def test_a_simulated_clock_is_fine(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    """Both topics on simulated time, recorded in real time, faster or slower."""
    joints, wrench = (SECOND + (stamp - T0) * 45 for stamp in stamps)  # 160 s
    read = record(tmp_path, joints, wrench, T0 + joints // 5, T0 + wrench // 5)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    np.testing.assert_array_equal(read.wrench.stamp, wrench)
    assert read.warnings == ()


def test_order_in_the_file_does_not_matter(tmp_path: Path) -> None:
    streams = make_streams()
    write_mcap(tmp_path / 'a.mcap', [*force_messages(streams), *joint_messages(streams)])
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert_same(read, streams)
    assert not read.joints.position.flags.writeable
    assert not read.wrench.stamp.flags.writeable


def slow(stamps: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The same over some 160 s."""
    joints, wrench = (T0 + (stamp - T0) * 45 for stamp in stamps)
    return joints, wrench


def test_clocks_that_drift_apart(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = slow(stamps)
    with pytest.raises(RecordingError, match=r'drift apart, by 1\.5\d s; .*sensor\.time_offset'):
        record(tmp_path, joints + (joints - T0) // 100, wrench, joints, wrench)


def test_a_stated_offset_is_added(tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]) -> None:
    joints, wrench = stamps
    record(tmp_path, joints, wrench - 2 * SECOND, joints, wrench - 2 * SECOND)
    cell = replace(CELL, sensor=CELL.sensor._replace(time_offset=2.0))
    read = read_streams(tmp_path / 'a.mcap', cell)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    np.testing.assert_array_equal(read.wrench.stamp, wrench)
    assert read.warnings == ()


@pytest.mark.parametrize('every', [1, 4])
def test_a_recorder_that_writes_in_bursts_is_not_believed(
    tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray], every: int
) -> None:
    joints, wrench = slow(stamps)
    burst = wrench + every * SECOND - (wrench - T0) % (every * SECOND)
    read = record(tmp_path, joints, wrench, joints, burst)
    np.testing.assert_array_equal(read.wrench.stamp, wrench)
    assert read.warnings == ()


def test_a_recorder_that_stood_still_and_catches_up_is_not_believed(tmp_path: Path) -> None:
    """One topic waits longer in its queue than the other, for a twentieth of the time."""
    joints = T0 + np.arange(600) * SECOND // 5
    wrench = T0 + np.arange(800) * 3 * SECOND // 20
    at = T0 + 40 * SECOND
    late = np.where((wrench > at) & (wrench < at + 12 * SECOND), at + 6 * SECOND + (wrench - at) // 2, wrench)
    read = record(tmp_path, joints, wrench, joints, late)
    np.testing.assert_array_equal(read.joints.stamp, joints)
    np.testing.assert_array_equal(read.wrench.stamp, wrench)
    assert read.warnings == ()


def test_clocks_apart_are_seen_though_messages_are_taken_several_at_a_time(
    tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]
) -> None:
    joints, wrench = stamps[0][:280], stamps[1][:280]
    taken = [np.repeat(stamp[3::4], 4) + np.tile(np.arange(4), 70) * 1000 for stamp in (joints, wrench)]
    read = record(tmp_path, joints, wrench + 3 * SECOND, *taken)
    assert 'comes from clocks that differ by 3 s' in read.warnings[0]


def test_clocks_apart_are_seen_in_a_short_recording_of_a_busy_machine(
    tmp_path: Path, stamps: tuple[np.ndarray, np.ndarray]
) -> None:
    """Both topics are received late, by up to 0.6 s, at the same moments; the lag of each by itself varies too much."""
    joints, wrench = stamps
    late = [stamp + (np.sin((stamp - T0) / SECOND) ** 2 * 0.6 * SECOND).astype(np.int64) for stamp in stamps]
    read = record(tmp_path, joints, wrench, *late)
    assert read.warnings == ()
    (tmp_path / 'apart').mkdir()
    read = record(tmp_path / 'apart', joints, wrench + SECOND // 2, *late)
    assert 'comes from clocks that differ by 0.5 s' in read.warnings[0]
    np.testing.assert_allclose(read.wrench.stamp - joints[0], wrench - joints[0], rtol=0, atol=1_000_000)
