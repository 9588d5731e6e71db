"""Stamps in disorder: mended where that is safe, refused where it is not. The law itself: `touches.test_clock_rule`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags.forms import CELL, T0, force_messages, joint_messages, make_streams, write_mcap

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 1_000_000_000
MADE = make_streams()
JOINTS, WRENCH = MADE.joints.stamp, MADE.wrench.stamp
STRAY = 'dropped whose stamp is zero or far off those around it'


def record(path: Path, joints: np.ndarray, wrench: np.ndarray, *log_times: np.ndarray) -> Streams:
    """A recording with the given header stamps and recording times, by default those, topic by topic, read again."""
    made = make_streams(len(joints), len(wrench))
    made = Streams('x', JointStream(joints, made.joints.position), WrenchStream(wrench, made.wrench.force))
    items = [*joint_messages(made), *force_messages(made)]
    times = np.concatenate(log_times or (joints, wrench)).tolist()
    items = [item._replace(log_time=time) for item, time in zip(items, times, strict=True)]
    write_mcap(path / 'a.mcap', sorted(items, key=lambda item: item.log_time) if log_times else items)
    return read_streams(path / 'a.mcap', CELL)


@pytest.mark.parametrize('constant', [0, T0])
def test_missing_stamps_fall_back_to_log_times(tmp_path, constant):
    """On both topics, since the two must share one clock."""
    read = record(tmp_path, np.full_like(JOINTS, constant), WRENCH, JOINTS + 5, WRENCH + 9)
    np.testing.assert_array_equal(read.joints.stamp, JOINTS + 5)
    np.testing.assert_array_equal(read.wrench.stamp, WRENCH + 9)
    (warning,) = read.warnings
    assert 'the recording times were used instead' in warning


def test_stamps_since_boot_are_stamps(tmp_path):
    """Bag times are another clock, which nobody needs."""
    boot = T0 - 5 * SECOND
    read = record(tmp_path, JOINTS - boot, WRENCH - boot, JOINTS, WRENCH)
    np.testing.assert_array_equal(read.joints.stamp, JOINTS - boot)
    np.testing.assert_array_equal(read.wrench.stamp, WRENCH - boot)
    assert read.warnings == ()


def put(places: list[int], *values: int) -> Callable[[np.ndarray], np.ndarray]:
    def change(stamp: np.ndarray) -> np.ndarray:
        stamp = stamp.copy()
        stamp[places] = values
        return stamp

    return change


@pytest.mark.parametrize(
    ('joints', 'wrench', 'lost', 'order', 'warning'),
    [
        (put([3, 77], 0), None, [3, 77], [], f'/joint_states: 2 messages {STRAY}'),
        (put([0, -1], 0), None, [0, -1], [], f'/joint_states: 2 messages {STRAY}'),
        (None, put([50], int(WRENCH[50]) + 3600 * SECOND), [50], [], f'/wrench: 1 message {STRAY}'),
        (put([10, 11], *JOINTS[[11, 10]]), None, [], [10, 11], '/joint_states: 1 message out of order, sorted'),
        (
            None, put([20, 21], WRENCH[19]), [20, 21], [],
            '/wrench: 2 messages dropped whose stamp is that of another',
        ),
    ],
)  # fmt: skip
def test_stamps_that_are_mended(tmp_path, joints, wrench, lost, order, warning):
    read = record(tmp_path, joints(JOINTS) if joints else JOINTS, wrench(WRENCH) if wrench else WRENCH, JOINTS, WRENCH)
    for changed, stream, stamp, values, original in (
        (joints, read.joints.stamp, JOINTS, read.joints.position, MADE.joints.position),
        (wrench, read.wrench.stamp, WRENCH, read.wrench.force, MADE.wrench.force),
    ):
        expected = original.copy()
        expected[order if changed else []] = original[order[::-1] if changed else []]
        np.testing.assert_array_equal(stream, np.delete(stamp, lost if changed else []))
        np.testing.assert_array_equal(values, np.delete(expected, lost if changed else [], axis=0))
    assert read.warnings == (warning,)


def test_stamps_that_are_refused(tmp_path):
    said = '`header.stamp` of /joint_states {}.*sensor.time_offset'
    with pytest.raises(RecordingError, match=said.format('is zero or constant, and all were recorded at once')):
        record(tmp_path, JOINTS * 0, WRENCH * 0, JOINTS * 0, WRENCH * 0)
    restarted = np.where(JOINTS[150] > JOINTS, JOINTS, JOINTS - 2 * SECOND)  # a simulation; recording times run on
    with pytest.raises(RecordingError, match=said.format(r'steps back by 1\.99 s; record')):
        record(tmp_path, restarted, WRENCH, JOINTS, WRENCH)


def test_a_stated_offset_is_added(tmp_path):
    record(tmp_path, JOINTS, WRENCH - 2 * SECOND)
    cell = replace(CELL, sensor=CELL.sensor._replace(time_offset=2.0))
    read = read_streams(tmp_path / 'a.mcap', cell)
    np.testing.assert_array_equal(read.joints.stamp, JOINTS)
    np.testing.assert_array_equal(read.wrench.stamp, WRENCH)
    assert read.warnings == ()
