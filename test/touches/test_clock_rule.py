"""Clocks of the two topics: late messages, differences, steps, drifts; no touch gets the force of another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, feed, topics_of

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.clock import Samples, longest_wait, on_one_clock
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 10**9
STREAMS = simulate_streams(CELL, PAPER_MEASURED, default_plan(CELL, per_disc=2), seed=4, start=START)
TRUE = find_touches(STREAMS, CELL).touches
TOPICS = ('/joint_states', '/wrench')


def pauses(rng: np.random.Generator, longest: float) -> list[tuple[int, int]]:
    """When the computer does nothing, about a third of the time, ns."""
    found, time = [], START
    while time < START + 60 * SECOND:
        time += round(rng.exponential(longest) * SECOND)
        length = round(rng.uniform(0.05, longest) * SECOND)
        found.append((time, time + length))
        time += length
    return found


def received(stamp: np.ndarray, rng: np.random.Generator, waits: list[tuple[int, int]], capacity: float) -> np.ndarray:
    """When the messages are received that wait in a queue; `capacity` times as fast as they come."""
    time = stamp + rng.integers(100_000, 1_500_000, len(stamp))
    for begin, end in waits:
        time = np.where((time >= begin) & (time < end), end, time)
    apart = np.arange(len(stamp)) * np.median(np.diff(stamp)) / capacity
    return (np.maximum.accumulate(time - START - apart) + apart).astype(np.int64) + START


def late_topics(seed: int, offsets: tuple[int | None, int | None], capacity: float, longest: float) -> list[Samples]:
    """Both topics as a busy computer receives them; None for an offset: without stamps."""
    rng = np.random.default_rng(seed)
    common = pauses(rng, longest)
    topics = []
    for topic in topics_of(STREAMS, *offsets):
        own = sorted(common + pauses(rng, longest)) if longest > 1 else common
        topics.append(topic._replace(log_time=received(topic.log_time, rng, own, capacity)))
    return topics


def offline(topics: list[Samples], warnings: list[str], offset: float | None = None):
    (joints, wrench), _ = on_one_clock('recorded', TOPICS, topics, warnings, offset)
    return find_touches(Streams('recorded', JointStream(*joints), WrenchStream(*wrench)), CELL)


def live(topics: list[Samples], cell=CELL) -> tuple[OnlineDetector, list]:
    detector = OnlineDetector(cell, topics=TOPICS)
    answers = [answer for _, answer in feed(detector, topics, 40)]
    return detector, [*answers, detector.finish()]


def wrong(touches) -> int:
    """Touches with joint angles and force of different true touches."""
    true = np.abs(touches.joints[:, None] - TRUE.joints).sum(axis=2).argmin(axis=1)
    return int(np.sum(np.abs(touches.force - TRUE.force[true]).max(axis=1, initial=0) > 0.5))


@pytest.mark.parametrize(('offset', 'seed'), [(-5.0, 1), (0.0, 2), (0.5, 3)])
def test_clocks_apart_are_told_from_messages_that_come_late(seed, offset):
    """By up to 4 s, a third of the time; live as in the recording."""
    topics = late_topics(seed, (0, round(offset * SECOND)), 50.0, 4.0)
    warnings: list[str] = []
    recorded = offline(topics, warnings)
    assert len(recorded.touches) == len(TRUE)
    np.testing.assert_allclose(recorded.touches.force, TRUE.force, rtol=0, atol=0.05)
    assert warnings == [
        f'`header.stamp` of /joint_states and /wrench comes from clocks that differ by {abs(offset):.3g} s: '
        'the stamps of /wrench were shifted'
    ] * bool(offset)
    detector, answers = live(topics)
    assert detector.found == recorded.found
    assert sum(len(answer.touches) for answer in answers) == len(TRUE)
    assert not sum(wrong(answer.touches) for answer in answers)
    assert bool(detector.clock_warning) is bool(offset)


def test_on_a_computer_that_hardly_keeps_up():
    """Late nearly all the time: stamps of one clock are right; a difference of clocks is refused, live as well."""
    recorded = offline(late_topics(0, (0, 0), 1.3, 4.0), [])
    np.testing.assert_allclose(recorded.touches.force, TRUE.force, rtol=0, atol=0.05)
    topics = late_topics(0, (0, 5 * SECOND), 1.3, 4.0)
    try:
        assert wrong(offline(topics, []).touches) == 0
    except RecordingError as error:
        assert 'or messages of one topic came late' in error.problem
        assert 'sensor.time_offset' in error.remedy
    detector, answers = live(topics, replace(CELL, sensor=CELL.sensor._replace(time_offset=-5.0)))
    assert sum(len(answer.touches) for answer in answers) == len(TRUE) == len(offline(topics, [], -5.0).touches)
    assert not sum(wrong(answer.touches) for answer in answers)
    assert detector.clock_warning == ''


@pytest.mark.parametrize('offsets', [(None, 0), (0, None), (None, None)])
def test_without_stamps_nothing_may_have_waited(offsets):
    topics = late_topics(0, offsets, 50.0, 4.0)
    with pytest.raises(RecordingError, match=r'is zero or constant, and messages of \S+ were received .* late'):
        offline(topics, [])
    detector, answers = live(topics)
    assert not sum(wrong(answer.touches) for answer in answers)
    assert 'in a burst' in detector.clock_warning


def test_a_computer_that_keeps_up_does_not_let_messages_wait():
    """Regular, irregular, several at a time, lost ones, other rates; without a pause that is made up for."""
    rng = np.random.default_rng(0)
    regular = 0.01 * np.arange(4000)
    several = np.repeat(regular[4::5], 5)
    rates = np.cumsum(np.concatenate([np.full(6000, 0.01), np.full(7500, 0.008)]))
    irregular = np.cumsum(rng.exponential(0.01, 12_000))
    lost = np.delete(regular, slice(1000, 1800))
    for seconds in (regular, np.sort(regular + rng.uniform(0, 0.005, 4000)), several, rates, irregular, lost):
        assert longest_wait(START + (seconds * SECOND).astype(np.int64)) == 0


HUNDRED = START + np.arange(6000) * SECOND // 100


def judged(one: np.ndarray, other: np.ndarray, received_one: np.ndarray, received_other: np.ndarray):
    """The clock of two topics, and the warnings."""
    values = np.zeros((len(one), 2))
    warnings: list[str] = []
    topics = [Samples(one, received_one, values), Samples(other, received_other, values)]
    return on_one_clock('x', ('a', 'b'), topics, warnings, None)[1], warnings


def test_a_stray_stamp_is_no_difference_of_the_clocks():
    stray = HUNDRED.copy()
    stray[[700, 3000]] += 9 * SECOND // 10
    clock, warnings = judged(stray, HUNDRED, HUNDRED + 1000, HUNDRED + 1000)
    assert clock == (False, 0, '', True)
    assert warnings == ['a: 2 messages dropped whose stamp is zero or far off those around it']


@pytest.mark.parametrize('speed', [0.6, 1.0])
@pytest.mark.parametrize('part', [slice(0, 1000), slice(5000, 6000), slice(2000, 4500)])
def test_a_topic_that_is_late_for_a_while_is_no_other_clock(speed, part):
    """Also where time is simulated, or a bag is played, faster or slower than recorded."""
    received_at = START + ((HUNDRED - START) / speed).astype(np.int64)
    late = received_at.copy()
    late[part] += 6 * SECOND // 10
    late = np.maximum.accumulate(late)
    for one, other in ((received_at, late), (late, received_at)):
        assert judged(HUNDRED, HUNDRED, one, other) == ((False, 0, '', True), [])


@pytest.mark.parametrize('speed', [0.4, 3.0])
@pytest.mark.parametrize('apart', [-100 * SECOND, 0, 3 * SECOND])
def test_clocks_that_differ_in_a_bag_played_fast_or_slowly_are_refused(speed, apart):
    """What is a short delay in real time is a long one by the stamps."""
    played = START + ((HUNDRED - START) / speed).astype(np.int64)
    if not apart:
        assert judged(HUNDRED, HUNDRED, played, played)[0].offset == 0
        return
    with pytest.raises(RecordingError, match=r'time is simulated or a bag was played; .*sensor\.time_offset'):
        judged(HUNDRED, HUNDRED + apart, played, played)


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize(('at', 'by', 'problem'), [(0.2, -0.9, 'back'), (0.5, 2.0, 'ahead'), (0.8, 0.9, 'ahead')])
def test_a_clock_that_steps_is_refused_though_the_computer_hesitates(at, by, problem, late):
    received_at = HUNDRED.copy()
    for begin in range(4, 60, 7) if late else ():
        waits = (received_at >= START + begin * SECOND) & (received_at < START + begin * SECOND + SECOND // 3)
        received_at = np.where(waits, START + begin * SECOND + SECOND // 3, received_at)
    stepped = np.where(np.arange(6000) > at * 6000, HUNDRED + round(by * SECOND), HUNDRED)
    for streams in ((stepped, HUNDRED), (HUNDRED, stepped)):
        with pytest.raises(RecordingError, match=rf'steps {problem} by \d.*sensor\.time_offset'):
            judged(*streams, received_at, received_at)


@pytest.mark.parametrize('share', [-0.02, 0.01])
def test_clocks_that_drift_apart_are_refused(share):
    drifting = HUNDRED + ((HUNDRED - START) * share).astype(np.int64)
    with pytest.raises(RecordingError, match=r'drift apart, by [01]\.\d+ s; .*sensor\.time_offset'):
        judged(HUNDRED, drifting, HUNDRED, HUNDRED)
    little = HUNDRED + ((HUNDRED - START) * share / 10).astype(np.int64)
    assert judged(HUNDRED, little, HUNDRED, HUNDRED)[0].offset == 0


@pytest.mark.parametrize('step', [-7, 5])
def test_a_step_is_refused_live_and_touches_before_it_stay(step):
    topics = topics_of(STREAMS)
    for topic in topics:
        topic.stamp[topic.stamp > START + 20 * SECOND] += step * SECOND
    detector, answers = live(topics)
    ends = [touch < 1e-9 * (20 * SECOND) for touch in TRUE.time.tolist()]
    assert sum(ends) - 1 <= sum(len(answer.touches) for answer in answers) <= sum(ends)
    assert not sum(wrong(answer.touches) for answer in answers)
    assert f'steps {"back" if step < 0 else "ahead"} by' in detector.clock_warning
    assert 'record in one run' in detector.clock_warning


def test_memory_of_the_load_and_clocks_outlive_a_restart():
    topics, detector = topics_of(STREAMS, wrench=-20 * SECOND), OnlineDetector(CELL, topics=TOPICS)
    answers = feed(detector, [topic.select(slice(0, len(topic.stamp) // 2)) for topic in topics])
    assert answers or detector.finish().found
    moved = detector._memory.stamp
    assert moved > START
    detector.restart()
    feed(detector, [topic.select(slice(len(topic.stamp) // 2, None)) for topic in topics], every=10**6)
    assert detector.finish().found
    assert moved < detector._memory.stamp < START + 60 * SECOND
    assert 'differ by 20 s' in detector.clock_warning
