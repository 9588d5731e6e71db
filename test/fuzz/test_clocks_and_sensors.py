"""Clocks that are set while the collector records, and sensors that freeze: what it reported is what is found again."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from benchmark.common import CELL
from scara_kinetostatic.bags.cdr import joint_state_messages, wrench_messages
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 1_000_000_000
RATE = 40
STREAMS = simulate_streams(
    CELL, PAPER_ACTUAL, default_plan(CELL, per_disc=3), sensors=SensorModel(joint_rate=RATE, wrench_rate=RATE)
)
START = int(STREAMS.joints.stamp[0])
TOUCHES = 18


class Collected(NamedTuple):
    """What was reported while recording: touches, accepted ones."""

    found: int
    accepted: int


def collect(folder: Path, joints: np.ndarray, wrench: np.ndarray, *, log_too: bool) -> tuple[Collected, str]:
    """Records the streams with other header stamps, and finds their touches meanwhile, as the collector does."""
    bag, detector = BagWriter(folder, CELL, log_time=START), OnlineDetector(CELL)
    angles = joint_state_messages(joints, STREAMS.joints.position, CELL.joint_names)
    forces = wrench_messages(wrench, STREAMS.wrench.force, 'base')
    times = np.concatenate([STREAMS.joints.stamp, STREAMS.wrench.stamp])
    found = accepted = 0
    for count, place in enumerate(np.argsort(times, kind='stable').tolist()):
        row = place - len(joints)
        stamp = int(joints[place] if row < 0 else wrench[row])
        log_time = stamp if log_too else int(times[place])
        if row < 0:
            bag.write_joint_state(angles[place], log_time)
            detector.add_joint_state(stamp, STREAMS.joints.position[place], log_time)
        else:
            bag.write_wrench(forces[row], log_time)
            detector.add_wrench(stamp, STREAMS.wrench.force[row], log_time)
        if count % (RATE // 5) == 0:
            news = detector.poll()
            found, accepted = found + news.found, accepted + len(news.touches)
    news = detector.finish()
    bag.close()
    return Collected(found + news.found, accepted + len(news.touches)), detector.clock_warning


@pytest.mark.parametrize('log_too', [True, False], ids=['clock of the computer', 'clock of the robot'])
@pytest.mark.parametrize('step', [-0.5, -3600.0, 5.0])
def test_a_clock_that_is_set_is_refused(tmp_path: Path, step: float, log_too: bool) -> None:
    """In the middle of a touch: what was reported before stays; a step ahead of all times is a pause."""
    first = START + round(13.3 * SECOND)
    shift = round(step * SECOND)
    stamps = [np.where(stamp >= first, stamp + shift, stamp) for stamp in (STREAMS.joints.stamp, STREAMS.wrench.stamp)]
    reported, warning = collect(tmp_path / 'bag', *stamps, log_too=log_too)
    if step > 0 and log_too:
        again = find_touches(read_streams(tmp_path / 'bag', CELL), CELL)
        assert TOUCHES - 1 <= len(again.touches) == reported.accepted
        assert warning == ''
        return
    with pytest.raises(RecordingError, match=r'`header\.stamp` of /joint_states steps .*sensor\.time_offset'):
        read_streams(tmp_path / 'bag', CELL)
    before = find_touches(STREAMS, CELL).touches.time < 13.3
    assert int(before.sum()) - 1 <= reported.accepted <= int(before.sum())
    assert 'steps back' in warning if step < 0 else 'steps ahead' in warning


@pytest.mark.parametrize('which', ['joint', 'force'])
def test_touches_with_a_frozen_sensor_are_rejected_by_name(which: str) -> None:
    """From the middle of a touch on, for good: the touches before it stay."""
    size = np.hypot(*STREAMS.wrench.force.T)
    moment = int(STREAMS.wrench.stamp[np.flatnonzero((size > 20) & (STREAMS.wrench.stamp > START + 20 * SECOND))[5]])
    joints, wrench = STREAMS.joints, STREAMS.wrench
    if which == 'joint':
        joints = JointStream(joints.stamp, _held(joints.position, int(np.searchsorted(joints.stamp, moment))))
    else:
        wrench = WrenchStream(wrench.stamp, _held(wrench.force, int(np.searchsorted(wrench.stamp, moment))))
    detection = find_touches(Streams('frozen', joints, wrench), CELL)
    whole = find_touches(STREAMS, CELL)
    before = int(np.sum(whole.touches.time < 1e-9 * (moment - START) - 1.0))
    assert 4 <= before <= len(detection.touches) <= before + 1
    assert any(f'the {which} reading' in item.reason and 'frozen' in item.reason for item in detection.rejected)


def _held(values: np.ndarray, place: int) -> np.ndarray:
    held = values.copy()
    held[place:] = held[place]
    return held
