"""Touches found while the samples come in are those found afterwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, TOOL_REACTION, Scene, feed, same_touches, topics_of

from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.clock import on_one_clock
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

PLAN = default_plan(CELL, per_disc=4)


def fed(streams, cell, every=20):
    """A detector that has heard the streams to their end, and its answers."""
    detector = OnlineDetector(cell)
    answers = [answer for _, answer in feed(detector, topics_of(streams), every)]
    return detector, [*answers, detector.finish()]


@pytest.mark.parametrize(('cell', 'every'), [(TOOL_REACTION, 1), (CELL, 1000)], ids=['often', 'rare'])
def test_online_is_offline(cell, every):
    plan = default_plan(CELL, per_disc=3, preload=0.3).select(np.arange(8 if every == 1 else 18))
    streams = simulate_streams(cell, PAPER_MEASURED, plan, seed=4)
    offline = find_touches(streams, cell)
    detector, answers = fed(streams, cell, every)
    online = TouchSet.concatenate([answer.touches for answer in answers if answer.found])
    assert detector.found == offline.found == len(plan)
    same_touches(online, offline.touches)
    np.testing.assert_allclose(online.approach, offline.touches.approach, rtol=0, atol=1e-6)
    np.testing.assert_allclose(online.press, offline.touches.press, rtol=0.05, atol=1e-6)


def test_touches_are_reported_soon_after_the_retraction():
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN.select(np.arange(10)), seed=2)
    ends = [episode.contact[1] for episode in find_touches(streams, CELL).episodes]
    start = min(streams.joints.stamp[0], streams.wrench.stamp[0])
    answers = feed(OnlineDetector(CELL), topics_of(streams), 10)
    delays = [1e-9 * (stamp - start) - ends[episode.index] for stamp, answer in answers for episode in answer.episodes]
    assert len(delays) == 10
    assert max(delays[2:]) < 0.75


SECOND = 10**9
CLOCKS = {'joints without stamp': (None, 0), 'both without stamp': (None, None), 'joints since 1970': (-START, 0)}


@pytest.mark.parametrize('offsets', CLOCKS.values(), ids=list(CLOCKS))
def test_clocks_are_judged_live_as_in_a_recording(offsets):
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN.select(np.arange(6)), seed=4, start=START)
    rng = np.random.default_rng(1)
    topics = [
        topic._replace(log_time=np.sort(topic.log_time + rng.integers(0, 1_000_000, len(topic.log_time))))
        for topic in topics_of(streams, *offsets)
    ]
    (joints, wrench), _ = on_one_clock('recorded', 'jw', topics, [], None)
    recorded = Streams('recorded', JointStream(*joints), WrenchStream(*wrench))
    offline = find_touches(recorded, CELL)
    detector = OnlineDetector(CELL)
    found = [answer.touches for _, answer in feed(detector, topics, 100)]
    assert not detector.finish().found, 'reported when they end, not at the end of the streams'
    assert detector.found == offline.found == len(offline.touches) == 6
    same_touches(TouchSet.concatenate(found), offline.touches, force=0.01)
    assert detector.clock_warning


def test_a_stamp_far_ahead_loses_no_touch():
    streams = Scene().touches(3).streams()
    stamp = streams.wrench.stamp.copy()
    stamp[len(stamp) // 2] += 3600 * SECOND
    spoiled = replace(streams, wrench=WrenchStream(stamp, streams.wrench.force))
    detector, _ = fed(spoiled, CELL)
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
