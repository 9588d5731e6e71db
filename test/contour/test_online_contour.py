"""The contour while it is traced is that of the whole recording, in bounded memory, and says what it cannot trace."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, DISC, SQUARE, arm

from benchmark.common import normal_error
from scara_kinetostatic.contour.online import OnlineContour
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.slides import Slide, simulate_slides
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.streams import Streams


def slides(*parts: tuple[float, float], outline=DISC, **more) -> Streams:
    planned = [Slide(outline, 15, 0.1, 0.05, begin=a, end=b) for a, b in parts]
    return simulate_slides(CELL, PAPER_ACTUAL, planned, **more)


def polls(online: OnlineContour, streams: Streams, every: float = 0.5) -> Iterator[bool]:
    """Feeds a recording, and polls every so many seconds of it."""
    topics = ((streams.joints.stamp, streams.joints.position), (streams.wrench.stamp, streams.wrench.force))
    rows = sorted(
        (stamp, number, values)
        for number, (stamps, samples) in enumerate(topics)
        for stamp, values in zip(stamps.tolist(), samples.tolist(), strict=True)
    )
    due = rows[0][0] + round(1e9 * every)
    for stamp, number, values in rows:
        (online.add_wrench if number else online.add_joint_state)(stamp, values, stamp)
        if stamp >= due:
            due += round(1e9 * every)
            yield online.poll()
    yield online.poll()


def fed(online: OnlineContour, streams: Streams, every: float = 0.5) -> OnlineContour:
    assert any([*polls(online, streams, every)])
    return online


@pytest.mark.parametrize('outline', [DISC, SQUARE])
def test_round_an_object_in_several_passes(outline) -> None:
    streams = slides((0.0, 0.4), (0.7, 0.35), (0.65, 1.05), outline=outline)
    online = fed(OnlineContour(arm()), streams)
    (joined,) = online.outlines
    assert joined.closed
    (whole,) = trace_contour(streams, arm()).outlines
    assert joined.length == pytest.approx(whole.length, rel=1e-3)
    assert rms(normal_error(outline, joined.points)) < 1.1 * rms(normal_error(outline, whole.points)) + 1e-6
    np.testing.assert_allclose(np.median(joined.std), np.median(whole.std), rtol=0.05)


def test_the_outline_grows_while_the_tip_slides() -> None:
    online, lengths, samples = OnlineContour(arm()), [], []
    for _ in polls(online, slides((0.0, 1.05))):
        lengths.append(sum(outline.length for outline in online.outlines))
        samples.append(len(online._pair.joints.samples.stamp))
        assert len(online.outlines) <= 1
        if online.contour is not None:
            tip, present = online.contour.surface[-1], online.present
            assert present is not None
            assert np.hypot(*(present.points - tip).T).min() < 2e-3
    assert np.all(np.diff(lengths) > -1e-3)
    assert lengths[-1] == pytest.approx(2 * np.pi * 0.06, rel=2e-3)
    assert max(samples) < 5 * 80  # of 11 s at 80 Hz
    assert online.contour is None


def test_a_jump_is_said_and_the_trace_goes_on() -> None:
    """But for what came since the last poll, what was traced before stays."""
    streams = slides((0.0, 0.6))
    position = streams.joints.position.copy()
    position[len(position) // 2 :] += 0.05
    online = OnlineContour(arm())
    for _ in polls(online, replace(streams, joints=replace(streams.joints, position=position))):
        pass
    assert 'the tip jumps by' in online.problem
    online.poll()
    first, second = (outline.length for outline in online.outlines)
    half = 0.3 * 2 * np.pi * 0.06
    assert half - 0.03 < first < half and half - 0.03 < second < half
    assert rms(normal_error(DISC, online.outlines[0].points)) < 2e-5
    assert 'the tip jumps by' in online.problem
    online.clear()
    assert not online.problem and not online.outlines and online.present is None


@pytest.mark.parametrize('force', [2.0])
def test_a_light_contact_is_not_taken_for_the_zero(force: float) -> None:
    online = fed(OnlineContour(arm()), simulate_slides(CELL, PAPER_ACTUAL, [Slide(DISC, force, 0.1, 0.05, end=0.6)]))
    (joined,) = online.outlines
    assert joined.length == pytest.approx(0.6 * 2 * np.pi * 0.06, rel=0.01)
    assert rms(normal_error(DISC, joined.points)) < 5e-5


@pytest.mark.parametrize('bias', [(-8.0, -6.0)])
def test_a_sensor_with_a_large_zero(bias: tuple[float, float]) -> None:
    """Traced by the zero of the free motion at first, without a word."""
    streams = slides((0.0, 0.6))
    online = OnlineContour(arm())
    biased = replace(streams, wrench=replace(streams.wrench, force=streams.wrench.force + np.array(bias)))
    (joined,) = fed(online, biased).outlines
    assert joined.length == pytest.approx(0.6 * 2 * np.pi * 0.06, rel=0.01)
    assert rms(normal_error(DISC, joined.points)) < 2e-5
    assert 'zero' not in online.problem


def test_a_zero_that_drifts_farther_than_a_contact_begins_at() -> None:
    """By 2.4 N while the tip slides; the free motion after it is not taken for contact."""
    planned = [Slide(DISC, 15, 0.1, 0.01, begin=begin, end=begin + 0.2) for begin in (0.0, 0.3)]
    streams = simulate_slides(CELL, PAPER_ACTUAL, planned)
    stamp = streams.wrench.stamp
    drift = np.interp(stamp, stamp[0] + np.array([5, 10]) * 10**9, [0.0, 2.4])[:, None] * [1, 0]
    drifting = replace(streams, wrench=replace(streams.wrench, force=streams.wrench.force + drift))
    online = fed(OnlineContour(arm()), drifting)
    assert [outline.length for outline in online.outlines] == pytest.approx([0.2 * 2 * np.pi * 0.06] * 2, rel=0.02)
    assert rms(normal_error(DISC, online.outlines[1].points)) < 5e-5


def test_a_tare_in_contact_is_corrected_and_said() -> None:
    online = OnlineContour(arm())
    for number, _ in enumerate(polls(online, slides((0.0, 0.3), (0.4, 0.7)))):
        if number == 7:
            assert online.contour is not None
            online.tare(10**9 // 2)
    assert 'the zero of the force was wrong by 1' in online.problem
    assert rms(normal_error(DISC, online.outlines[-1].points)) < 2e-5
    online.restart()  # the outlines stay, and so does what is said of them
    assert 'the zero of the force was wrong by 1' in online.problem
    online.clear()
    assert not online.problem


def test_a_light_slide_under_a_noisy_sensor() -> None:
    planned = [Slide(DISC, 3, 0.1, 0.05, end=0.6)]
    streams = simulate_slides(CELL, PAPER_ACTUAL, planned, sensors=SensorModel(force_noise=1.0))
    (joined,) = fed(OnlineContour(arm()), streams).outlines
    assert joined.length == pytest.approx(0.6 * 2 * np.pi * 0.06, rel=0.02)
    assert rms(normal_error(DISC, joined.points) / joined.std) < 1.3


def test_messages_that_are_late_until_they_end() -> None:
    """The computer hesitates, for both topics alike; stamps of one clock are traced at once."""
    streams, online, rng = slides((0.0, 0.6)), OnlineContour(arm()), np.random.default_rng(0)
    topics = ((streams.joints.stamp, streams.joints.position), (streams.wrench.stamp, streams.wrench.force))
    samples = [
        (stamp, number, values)
        for number, (stamps, samples) in enumerate(topics)
        for stamp, values in zip(stamps.tolist(), samples.tolist(), strict=True)
    ]
    now = min(samples)[0]
    for stamp, number, values in sorted(samples):
        now += round(1e9 * (rng.exponential(2e-3) + (rng.random() < 2e-3) * rng.exponential(1.0)))
        (online.add_wrench if number else online.add_joint_state)(stamp, values, now)
    assert online.poll()
    assert not online.problem
    (joined,) = online.outlines
    assert rms(normal_error(DISC, joined.points)) < 2e-5


def test_a_start_in_contact_is_said() -> None:
    streams = slides((0.0, 0.6))
    middle = int(streams.joints.stamp[0]) + 4 * 10**9
    joints, wrench = streams.joints, streams.wrench
    first, second = np.searchsorted(joints.stamp, middle), np.searchsorted(wrench.stamp, middle)
    joints = replace(joints, stamp=joints.stamp[first:], position=joints.position[first:])
    wrench = replace(wrench, stamp=wrench.stamp[second:], force=wrench.force[second:])
    online = fed(OnlineContour(arm()), replace(streams, joints=joints, wrench=wrench))
    assert 'the zero of the force was wrong by 14.7 N' in online.problem
    np.testing.assert_allclose(online.zero, fed(OnlineContour(arm()), streams).zero, atol=0.1)


@pytest.mark.parametrize('every', [4.0, 100.0])
def test_the_outline_is_complete_however_late_it_is_traced(every: float) -> None:
    (joined,) = fed(OnlineContour(arm()), slides((0.0, 1.05)), every).outlines
    assert joined.closed
    assert joined.length == pytest.approx(2 * np.pi * 0.06, rel=2e-3)


def rested(stamp: np.ndarray, values: np.ndarray, middle: int) -> tuple[np.ndarray, np.ndarray]:
    """A topic that stays as it is for 30 s from a stamp on."""
    at, period, rest = int(np.searchsorted(stamp, middle)), int(np.median(np.diff(stamp))), 30 * 10**9
    between = stamp[at - 1] + period * np.arange(1, rest // period + 1)
    held = np.repeat(values[at - 1 : at], len(between), axis=0)
    return np.concatenate([stamp[:at], between, stamp[at:] + rest]), np.concatenate([values[:at], held, values[at:]])


def test_a_long_rest_in_contact_is_said_and_begins_a_new_outline() -> None:
    streams = slides((0.0, 0.5))
    middle = int(streams.joints.stamp[len(streams.joints.stamp) // 2])
    stamp, position = rested(streams.joints.stamp, streams.joints.position, middle)
    joints = replace(streams.joints, stamp=stamp, position=position)
    stamp, force = rested(streams.wrench.stamp, streams.wrench.force, middle)
    wrench = replace(streams.wrench, stamp=stamp, force=force)
    online, problems = OnlineContour(arm()), set[str]()
    for _ in polls(online, replace(streams, joints=joints, wrench=wrench), 1.0):
        problems.add(online.problem)
        assert len(online._pair.joints.samples.stamp) < 25 * 80
    assert any('does not slide' in problem for problem in problems)
    lengths = [outline.length for outline in online.outlines]
    assert len(lengths) == 2
    assert sum(lengths) == pytest.approx(0.5 * 2 * np.pi * 0.06, abs=5e-3)


def test_the_zero_of_the_force() -> None:
    streams = slides((0.0, 0.2))
    bias = np.array([6.0, -8.0])
    biased = replace(streams, wrench=replace(streams.wrench, force=streams.wrench.force + bias))
    online = fed(OnlineContour(arm()), biased)
    assert online.zero is not None
    assert online.zero == pytest.approx(bias + trace_contour(streams, arm()).zero, abs=0.3)
    (outline,) = online.outlines
    assert rms(normal_error(DISC, outline.points)) < 1.5e-5
    untared = OnlineContour(arm())
    for stamp, values in zip(streams.wrench.stamp[:30].tolist(), [[3.0, 4.0]] * 30, strict=True):
        untared.add_wrench(stamp, values, stamp)
    assert untared.tare(10**9) == pytest.approx([3.0, 4.0])


def test_touches_are_no_slide() -> None:
    online = OnlineContour(arm())
    streams = simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL, 1))
    problems = [online.problem for _ in polls(online, streams)]
    assert not online.outlines
    assert any('does not slide' in problem for problem in problems)
