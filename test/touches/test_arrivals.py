"""Messages that are received late, as on a computer that does too much: no touch gets the force of another."""

from __future__ import annotations

import numpy as np
import pytest
from touches.scenes import CELL, START

from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.arrivals import Samples, least_lags, received_late
from scara_kinetostatic.touches.buffer import StreamPair
from scara_kinetostatic.touches.clock import Judgement, KnownClocks, judge_clocks
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
    streams = ((STREAMS.joints.stamp, STREAMS.joints.position), (STREAMS.wrench.stamp, STREAMS.wrench.force))
    for (stamp, values), offset in zip(streams, offsets, strict=True):
        own = sorted(common + pauses(rng, longest)) if longest > 1 else common
        header = np.zeros_like(stamp) if offset is None else stamp + offset
        topics.append(Samples(header, received(stamp, rng, own, capacity), values))
    return topics


def offline(topics: list[Samples], warnings: list[str]):
    joints, wrench = judge_clocks('recorded', dict(zip(TOPICS, topics, strict=True)), warnings).topics
    return find_touches(Streams('recorded', JointStream(*joints), WrenchStream(*wrench)), CELL)


def live(topics: list[Samples]) -> tuple[OnlineDetector, list]:
    detector, answers = OnlineDetector(CELL, topics=TOPICS), []
    events = [
        (int(time), which, int(stamp), value)
        for which, topic in enumerate(topics)
        for stamp, time, value in zip(topic.stamp, topic.log_time, topic.values.tolist(), strict=True)
    ]
    polled = 0
    for time, which, stamp, value in sorted(events):
        (detector.add_wrench if which else detector.add_joint_state)(stamp, value, time)
        if time - polled > SECOND // 5:
            answers.append(detector.poll())
            polled = time
    return detector, [*answers, detector.finish()]


def wrong(touches) -> int:
    """Touches with joint angles and force of different true touches."""
    true = np.abs(touches.joints[:, None] - TRUE.joints).sum(axis=2).argmin(axis=1)
    return int(np.sum(np.abs(touches.force - TRUE.force[true]).max(axis=1, initial=0) > 0.5))


@pytest.mark.parametrize('capacity', [50.0, 1.3])
@pytest.mark.parametrize('offset', [-5.0, 0.0, 0.5, 5.0])
@pytest.mark.parametrize('seed', [1, 2])
def test_clocks_apart_are_told_from_messages_that_come_late(seed, offset, capacity):
    """By up to 4 s, most of the time; live as in the recording."""
    topics = late_topics(seed, (0, round(offset * SECOND)), capacity, 4.0)
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


@pytest.mark.parametrize('longest', [0.5, 4.0])
@pytest.mark.parametrize('offsets', [(None, 0), (0, None), (None, None)])
def test_without_stamps_what_came_late_is_not_used(offsets, longest):
    rejected = 0
    for seed in range(8):
        topics = late_topics(seed, offsets, 50.0, longest)
        warnings: list[str] = []
        recorded = offline(topics, warnings)
        assert wrong(recorded.touches) == 0
        rejected += len(TRUE) - len(recorded.touches)
        assert any('dropped that were received late' in text for text in warnings)
        assert any('some forces may belong to other joint angles' in text for text in warnings)
        _, answers = live(topics)
        assert not sum(wrong(answer.touches) for answer in answers)
    assert rejected > 8


def test_on_a_computer_that_keeps_up_no_message_is_late():
    for seed, period in enumerate((0.001, 0.01, 0.04)):
        rng = np.random.default_rng(seed)
        time = START + (period * SECOND * np.arange(4000)).astype(np.int64)
        jitter = np.sort(time + rng.integers(0, 5_000_000, len(time)))
        several = np.repeat(time[4::5], 5)[: len(time)] + np.arange(len(time[4::5]) * 5) % 5 * 1000
        lost = np.delete(time, slice(1000, 1800))
        for received_at in (time, jitter, several, lost):
            samples = Samples(np.zeros_like(received_at), received_at, np.zeros((len(received_at), 2)))
            assert not received_late(samples).any()


def test_what_waited_for_the_first_message_is_late():
    """The recorder begins, and receives what was sent during the last 2 s at once."""
    time = START + np.arange(4000) * SECOND // 100
    samples = Samples(time * 0, np.maximum(time, START + 2 * SECOND), np.zeros((4000, 2)))
    late = received_late(samples)
    assert np.all(late[:190])
    assert not np.any(late[201:])


def as_stamped(judged: Judgement) -> bool:
    """Whether the stamps are as they were."""
    return not (judged.by_log_time or judged.joined or any(judged.known.shifts))


def test_a_stray_stamp_is_no_difference_of_the_clocks():
    time = START + np.arange(3000) * SECOND // 100
    stray = time.copy()
    stray[[700, -1]] += 9 * SECOND // 10
    one, other = (Samples(stamp, time + 1000, np.zeros((3000, 2))) for stamp in (stray, time))
    judged = judge_clocks('x', {'a': one, 'b': other}, [])
    assert as_stamped(judged)
    assert judged.shifts == (0, 0)


def test_a_difference_found_too_early_is_taken_back():
    """One topic comes late at first; later samples show that the clocks are one."""
    time = START + np.arange(400) * SECOND // 100
    values = np.zeros((400, 2))
    early = {'a': Samples(time, time + SECOND, values), 'b': Samples(time, time, values)}
    judged = judge_clocks('x', early, warnings := [], KnownClocks())
    assert judged.shifts == (SECOND, 0)
    assert 'differ by 1 s: the stamps of a were shifted' in warnings[0]
    later = time + 4 * SECOND
    streams = {'a': Samples(later + judged.shifts[0], later, values), 'b': Samples(later, later, values)}
    again = judge_clocks('x', streams, warnings := [], judged.known)
    assert again.shifts == (-SECOND, 0)
    assert as_stamped(again)
    assert warnings == []


def test_clocks_that_step_while_messages_are_on_time():
    time = START + np.arange(6000) * SECOND // 100
    values = np.zeros((6000, 2))
    stepped = np.where(np.arange(6000) > 4000, time + 9 * SECOND // 10, time)
    lags = least_lags(Samples(stepped, time, values), Samples(time, time, values))
    assert lags.drift(0) == 9 * SECOND // 10
    late = received(time, np.random.default_rng(0), [(START + 10 * SECOND, START + 14 * SECOND)], 1.02)
    assert least_lags(Samples(time, late, values), Samples(time, time, values)).drift(0) == 0


HUNDRED = START + np.arange(6000) * SECOND // 100


def judged(one: np.ndarray, other: np.ndarray, received_one: np.ndarray, received_other: np.ndarray):
    values = np.zeros((len(one), 2))
    warnings: list[str] = []
    topics = {'a': Samples(one, received_one, values), 'b': Samples(other, received_other, values)}
    return judge_clocks('x', topics, warnings), warnings


@pytest.mark.parametrize('speed', [0.6, 0.9, 0.95, 1.0, 1.05, 1.5])
@pytest.mark.parametrize('part', [slice(0, 1000), slice(5000, 6000), slice(2000, 4500)])
def test_a_topic_that_is_late_for_a_while_is_no_other_clock(speed, part):
    """Also where time is simulated, or a bag is played, faster or slower than recorded."""
    received = START + ((HUNDRED - START) / speed).astype(np.int64)
    late = received.copy()
    late[part] += 6 * SECOND // 10
    late = np.maximum.accumulate(late)
    for one, other in ((received, late), (late, received)):
        found, warnings = judged(HUNDRED, HUNDRED, one, other)
        assert as_stamped(found)
        assert warnings == []


@pytest.mark.parametrize('speed', [0.1, 0.4, 3.0, 10.0])
@pytest.mark.parametrize('apart', [-100 * SECOND, -3 * SECOND, 0, 3 * SECOND])
def test_doubt_where_clocks_differ_in_a_bag_played_fast_or_slowly(speed, apart):
    """Published every 10 ms of real time, with a hesitation of each topic; nothing is shifted."""
    played = START + ((HUNDRED - START) / speed).astype(np.int64)
    played = START + (played - START) // (SECOND // 100) * (SECOND // 100)
    received = [played, played.copy()]
    for times, first in zip(received, (1000, 4000), strict=True):
        times[first : first + round(20 * speed) + 1] += SECOND // 5
    found, warnings = judged(HUNDRED, HUNDRED + apart, *(np.maximum.accumulate(times) for times in received))
    assert as_stamped(found)
    assert len(warnings) == (apart != 0)
    if apart:
        assert 'or one of them was late: they were recorded at another speed' in warnings[0]
        seconds = float(warnings[0].partition('differ by ')[2].partition(' s')[0])
        assert seconds == pytest.approx(abs(apart) / SECOND, abs=0.02 * max(speed, 1.0))


@pytest.mark.parametrize('seconds', [12, 60, 3600])
@pytest.mark.parametrize(('at', 'by'), [(0.2, -0.9), (0.5, 2.0), (0.8, 0.9)])
def test_a_clock_that_steps_is_found_though_the_computer_hesitates(seconds, at, by):
    time = START + np.arange(50 * seconds) * SECOND // 50
    rng = np.random.default_rng(seconds)
    received_at = time.copy()
    for begin in rng.uniform(0, seconds, seconds // 5):
        start = START + round(begin * SECOND)
        waits = (received_at >= start) & (received_at < start + SECOND // 3)
        received_at = np.where(waits, start + SECOND // 3, received_at)
    stepped = np.where(np.arange(len(time)) > at * len(time), time + round(by * SECOND), time)
    found, warnings = judged(stepped, time, received_at, received_at)
    assert found.by_log_time
    assert 'drift apart' in warnings[0]


def test_a_clock_that_loses_is_followed_with_few_samples_kept():
    pair = StreamPair(TOPICS, 100_000)
    for number, time in enumerate(HUNDRED.tolist()):
        pair.joints.append(time, time, (0.0, 0.0))
        pair.wrench.append(time - (SECOND // 2 if number > 3000 else 0), time, (0.0, 0.0))
        if number % 20 == 19:
            found = pair.judged()
            assert found is not None
            if pair.is_sure(found):
                pair.correct(found)
            for buffer in pair.buffers:
                buffer.drop_before(buffer.now - 3 * SECOND)
    assert 'differ by 0.5 s: the stamps of /wrench were shifted' in pair.problem
    assert pair.joints.now == pair.wrench.now


def test_memory_of_the_load_and_clocks_outlive_a_restart():
    joints = Samples(STREAMS.joints.stamp, STREAMS.joints.stamp, STREAMS.joints.position)
    wrench = Samples(STREAMS.wrench.stamp - 20 * SECOND, STREAMS.wrench.stamp, STREAMS.wrench.force)
    detector = OnlineDetector(CELL, topics=TOPICS)
    half = [Samples(*(column[: len(column) // 2] for column in topic)) for topic in (joints, wrench)]
    for topic, add in zip(half, (detector.add_joint_state, detector.add_wrench), strict=True):
        for stamp, time, value in zip(*topic, strict=True):
            add(int(stamp), value.tolist(), int(time))
    assert detector.finish().found
    moved = detector._memory.stamp
    assert moved > START
    detector.restart()
    for topic, kept, add in zip((joints, wrench), half, (detector.add_joint_state, detector.add_wrench), strict=True):
        for stamp, time, value in zip(*(column[len(kept.stamp) :] for column in topic), strict=True):
            add(int(stamp), value.tolist(), int(time))
    assert detector.finish().found
    assert moved < detector._memory.stamp < START + 60 * SECOND
    assert 'differ by 20 s' in detector.clock_warning


def test_other_rates_without_stamps_are_not_late():
    """A sleep loop that runs slower under load, two rates, batches of which some are lost."""
    phases = np.concatenate([np.full(2000, period) for period in (0.0102, 0.0108) * 3])
    rates = np.concatenate([np.full(6000, 0.01), np.full(7500, 0.008)])
    batches = np.repeat(np.delete(np.arange(9, 6000, 10), slice(200, 206)), 10) * 0.01
    irregular = np.cumsum(np.random.default_rng(0).exponential(0.01, 12_000))
    for seconds in (np.cumsum(phases), np.cumsum(rates), batches, irregular):
        time = START + (seconds * SECOND).astype(np.int64)
        assert not received_late(Samples(time * 0, time, np.zeros((len(time), 2)))).any()


def test_a_long_recording_without_stamps_of_the_forces_is_found_live():
    """Longer than what is kept."""
    joints = Samples(STREAMS.joints.stamp, STREAMS.joints.stamp, STREAMS.joints.position)
    wrench = Samples(0 * STREAMS.wrench.stamp, STREAMS.wrench.stamp, STREAMS.wrench.force)
    _, answers = live([joints, wrench])
    assert sum(len(answer.touches) for answer in answers) == len(TRUE)
    assert sum(bool(answer.found) for answer in answers) >= len(TRUE) - 1
