"""Touches found while the samples come in are those found afterwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, Scene

from scara_kinetostatic.model.cell import SensorFrame, SensorSign
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.clock import Samples, on_one_clock
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

PLAN = default_plan(CELL, per_disc=5)
TOOL_REACTION = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=SensorSign.ON_ROBOT))


def feed(streams, cell, every=20, end=True):
    """Every answer of an online detector that found something, with the stamp at which it came."""
    detector = OnlineDetector(cell)
    stamps = np.concatenate([streams.joints.stamp, streams.wrench.stamp])
    values = np.concatenate([streams.joints.position, streams.wrench.force])
    of_joints = np.arange(len(stamps)) < len(streams.joints.stamp)
    answers = []
    for number, place in enumerate(np.argsort(stamps, kind='stable')):
        add = detector.add_joint_state if of_joints[place] else detector.add_wrench
        add(int(stamps[place]), values[place])
        if number % every == 0:
            answers.append((int(stamps[place]), detector.poll()))
    if end:
        answers.append((int(stamps.max()), detector.finish()))
    return detector, [(stamp, answer) for stamp, answer in answers if answer.found]


@pytest.mark.parametrize(
    ('cell', 'every'), [(TOOL_REACTION, 1), (CELL, 20), (CELL, 1000)], ids=['tool', 'base', 'rare']
)
def test_online_is_offline(cell, every):
    plan = default_plan(CELL, per_disc=3, preload=0.3).select(np.arange(8 if every == 1 else 18))
    streams = simulate_streams(cell, PAPER_MEASURED, plan, seed=4)
    offline = find_touches(streams, cell)
    detector, answers = feed(streams, cell, every)
    online = TouchSet.concatenate([answer.touches for _, answer in answers])
    assert detector.found == offline.found == len(plan)
    np.testing.assert_array_equal(online.index, offline.touches.index)
    np.testing.assert_array_equal(online.disc, offline.touches.disc)
    np.testing.assert_allclose(online.joints, offline.touches.joints, rtol=0, atol=1e-8)
    np.testing.assert_allclose(online.force, offline.touches.force, rtol=0, atol=0.005)
    np.testing.assert_allclose(online.approach, offline.touches.approach, rtol=0, atol=1e-6)
    np.testing.assert_allclose(online.press, offline.touches.press, rtol=0.05, atol=1e-6)


def test_touches_are_reported_soon_after_the_retraction():
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN, seed=2)
    ends = [episode.contact[1] for episode in find_touches(streams, CELL).episodes]
    start = min(streams.joints.stamp[0], streams.wrench.stamp[0])
    _, answers = feed(streams, CELL, 10, end=False)
    delays = [1e-9 * (stamp - start) - ends[episode.index] for stamp, answer in answers for episode in answer.episodes]
    assert len(delays) == len(PLAN)
    assert max(delays[2:]) < 0.75


def test_rejected_touches_are_reported_once():
    scene = Scene().touches(3).touch(0, 30, 25.0, hold=0.1).touches(3)
    detector, answers = feed(scene.streams(), CELL)
    rejected = [rejection for _, answer in answers for rejection in answer.rejected]
    assert detector.found == 7
    assert [rejection.index for rejection in rejected] == [3]
    assert rejected[0].reason.startswith('hold too short')


def test_long_run_keeps_little():
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN)
    detector, answers = feed(streams, CELL, 200)
    assert sum(answer.found for _, answer in answers) == len(PLAN)
    stamps = detector._pair.wrench.samples.stamp
    assert 1e-9 * (stamps[-1] - stamps[0]) < 45.0


def test_nothing_to_report():
    detector = OnlineDetector(CELL)
    assert detector.poll().found == 0
    detector.add_wrench(1, (0.0, 0.0))
    assert detector.poll().found == detector.finish().found == detector.found == 0


SECOND = 10**9
CLOCKS = {
    **{f'{offset:+g} s apart': (0, round(offset * SECOND)) for offset in (-5, -1, -0.5, 0.5, 1, 5)},
    'joints without stamp': (None, 0),
    'forces without stamp': (0, None),
    'both without stamp': (None, None),
    'joints since 1970': (-START, 0),
    'both since 1970': (-START, -START),
    'one clock': (0, 0),
}


def stamped(received, offset):
    return np.zeros_like(received) if offset is None else received + offset


def test_samples_dropped_by_a_restart_are_not_looked_at():
    detector = OnlineDetector(CELL)
    detector.add_joint_state(START, (0.1, 0.2))
    detector.add_wrench(START, (0.0, 0.0))
    detector.restart()
    assert detector.poll().found == 0
    detector.add_wrench(START + 10**7, (0.0, 0.0))
    assert detector.poll().found == 0


@pytest.mark.parametrize('offsets', CLOCKS.values(), ids=list(CLOCKS))
def test_clocks_are_judged_live_as_in_a_recording(offsets):
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN.select(np.arange(6)), seed=4, start=START)
    rng = np.random.default_rng(1)
    topics, values = [], (streams.joints.position, streams.wrench.force)
    for stamp, offset, value in zip((streams.joints.stamp, streams.wrench.stamp), offsets, values, strict=True):
        late = np.sort(stamp + rng.integers(0, 1_000_000, len(stamp)))
        topics.append(Samples(stamped(stamp, offset), late, value))
    (joints, wrench), _ = on_one_clock('recorded', 'jw', topics, [], None)
    recorded = Streams('recorded', JointStream(*joints), WrenchStream(*wrench))
    offline = find_touches(recorded, CELL)
    detector, found = OnlineDetector(CELL), []
    arrival = np.concatenate([topic.log_time for topic in topics])
    for number, place in enumerate(np.argsort(arrival, kind='stable').tolist()):
        of_joints = place < len(topics[0].stamp)
        topic, row = (topics[0], place) if of_joints else (topics[1], place - len(topics[0].stamp))
        add = detector.add_joint_state if of_joints else detector.add_wrench
        add(int(topic.stamp[row]), topic.values[row].tolist(), int(topic.log_time[row]))
        if number % 100 == 0:
            found.append(detector.poll())
    found.append(detector.finish())
    assert not found[-1].found, 'reported when they end, not at the end of the streams'
    online = TouchSet.concatenate([answer.touches for answer in found if answer.found])
    assert detector.found == offline.found == len(offline.touches) == 6
    np.testing.assert_array_equal(online.index, offline.touches.index)
    np.testing.assert_allclose(online.joints, offline.touches.joints, rtol=0, atol=1e-8)
    np.testing.assert_allclose(online.force, offline.touches.force, rtol=0, atol=0.01)
    apart = offsets not in ((0, 0), (-START, -START))
    assert bool(detector.clock_warning) is apart


def test_a_stamp_far_ahead_loses_no_touch():
    streams = Scene().touches(3).streams()
    stamp = streams.wrench.stamp.copy()
    stamp[len(stamp) // 2] += 3600 * SECOND
    spoiled = replace(streams, wrench=WrenchStream(stamp, streams.wrench.force))
    detector, _ = feed(spoiled, CELL)
    assert detector.found == find_touches(streams, CELL).found == 3


@pytest.mark.parametrize('standstill', [False, True])
def test_an_idle_feed_keeps_no_more_than_the_horizon(standstill):
    """Nothing is touched, with stamps that run on or stand still."""
    most = 35_000
    detector = OnlineDetector(CELL, most=most)
    for number in range(2 * most):
        stamp = START if standstill else START + number * SECOND // 1000
        detector.add_joint_state(stamp, (0.5, 0.7), stamp)
        detector.add_wrench(stamp, (0.0, 0.01 * (number % 2)), stamp)
        if number % 500 == 0:
            detector.poll()
    assert max(len(buffer.samples.stamp) for buffer in detector._pair.buffers) <= most
    if not standstill:
        assert len(detector._pair.wrench.samples.stamp) < 32_000
