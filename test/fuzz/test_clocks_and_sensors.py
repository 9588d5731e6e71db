"""Clocks that are set while the collector records, and sensors that freeze: what it reported is what is found again."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from benchmark.common import CELL
from scara_kinetostatic.bags.encoding import joint_state_messages, wrench_messages
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.sensors import SensorModel
from scara_kinetostatic.simulation.streams import simulate_streams
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


def collect(folder: Path, joints: np.ndarray, wrench: np.ndarray, *, log_too: bool) -> Collected:
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
            detector.add_joint_state(stamp, STREAMS.joints.position[place])
        else:
            bag.write_wrench(forces[row], log_time)
            detector.add_wrench(stamp, STREAMS.wrench.force[row])
        if count % (RATE // 5) == 0:
            news = detector.poll()
            found, accepted = found + news.found, accepted + len(news.touches)
    news = detector.finish()
    bag.close()
    return Collected(found + news.found, accepted + len(news.touches))


@pytest.mark.parametrize('log_too', [True, False], ids=['clock of the computer', 'clock of the robot'])
@pytest.mark.parametrize('step', [-0.3, -1.5, -3600.0, 5.0, 3e7])
def test_no_reported_touch_is_lost_when_a_clock_is_set(tmp_path: Path, step: float, log_too: bool) -> None:
    """In the middle of a touch, and back again in the middle of another."""
    first, second = (START + round(share * SECOND) for share in (13.3, 31.7))
    shift = round(step * SECOND)
    stamps = [
        np.where((stamp >= first) & (stamp < second), stamp + shift, stamp)
        for stamp in (STREAMS.joints.stamp, STREAMS.wrench.stamp)
    ]
    reported = collect(tmp_path / 'bag', *stamps, log_too=log_too)
    streams = read_streams(tmp_path / 'bag', CELL)
    again = find_touches(streams, CELL)
    assert len(again.touches) >= reported.accepted >= TOUCHES - 4
    assert again.found >= TOUCHES - 2
    assert streams.warnings, 'one of the two steps runs back'


def test_the_parts_keep_forces_beside_their_angles(tmp_path: Path) -> None:
    cut = START + 20 * SECOND
    joints, wrench = (
        np.where(stamp >= cut, stamp - 7 * SECOND, stamp) for stamp in (STREAMS.joints.stamp, STREAMS.wrench.stamp)
    )
    collect(tmp_path / 'bag', joints, wrench, log_too=True)
    streams = read_streams(tmp_path / 'bag', CELL)
    assert 'the parts were placed one after another' in streams.warnings[0]
    moved = streams.joints.stamp - STREAMS.joints.stamp
    assert set(moved[STREAMS.joints.stamp < cut].tolist()) == {0}
    (later,) = set(moved[STREAMS.joints.stamp >= cut].tolist())
    assert 0.9 * SECOND < later <= SECOND
    assert set((streams.wrench.stamp - STREAMS.wrench.stamp).tolist()) == {0, later}


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
