"""The live contour is that of the whole recording, in bounded memory, and says what it cannot trace."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, DISC, SQUARE, arm

from scara_kinetostatic.contour.live import LiveContour
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.sliding.slide import Slide
from scara_kinetostatic.simulation.sliding.streams import simulate_slides
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.streams import Streams


def slides(*parts: tuple[float, float], outline=DISC, **more) -> Streams:
    planned = [Slide(outline, 15, 0.1, 0.05, begin=a, end=b) for a, b in parts]
    return simulate_slides(CELL, PAPER_ACTUAL, planned, **more)


def polls(live: LiveContour, streams: Streams, every: float = 0.5) -> Iterator[bool]:
    """Feeds a recording, and polls every so many seconds of it."""
    topics = ((streams.joints.stamp, streams.joints.position), (streams.wrench.stamp, streams.wrench.force))
    rows = sorted(
        (stamp, number, values)
        for number, (stamps, samples) in enumerate(topics)
        for stamp, values in zip(stamps.tolist(), samples.tolist(), strict=True)
    )
    due = rows[0][0] + round(1e9 * every)
    for stamp, number, values in rows:
        (live.add_wrench if number else live.add_joint_state)(stamp, values, stamp)
        if stamp >= due:
            due += round(1e9 * every)
            yield live.poll()
    yield live.poll()


def fed(live: LiveContour, streams: Streams) -> LiveContour:
    assert any([*polls(live, streams)])
    return live


@pytest.mark.parametrize('outline', [DISC, SQUARE])
def test_round_an_object_in_several_passes(outline) -> None:
    streams = slides((0.0, 0.4), (0.7, 0.35), (0.65, 1.05), outline=outline)
    live = fed(LiveContour(arm()), streams)
    (joined,) = live.outlines
    assert joined.closed
    (whole,) = trace_contour(streams, arm()).outlines
    assert joined.length == pytest.approx(whole.length, rel=1e-3)
    assert rms(outline.normal_error(joined.points)) < 1.1 * rms(outline.normal_error(whole.points)) + 1e-6
    np.testing.assert_allclose(np.median(joined.std), np.median(whole.std), rtol=0.05)


def test_the_outline_grows_while_the_tip_slides() -> None:
    live, lengths, samples = LiveContour(arm()), [], []
    for _ in polls(live, slides((0.0, 1.05))):
        lengths.append(sum(outline.length for outline in live.outlines))
        samples.append(len(live._pair.joints.samples.stamp))
        assert len(live.outlines) <= 1
        if live.contour is not None:
            tip, present = live.contour.surface[-1], live.present
            assert present is not None
            assert np.hypot(*(present.points - tip).T).min() < 2e-3
    assert np.all(np.diff(lengths) > -1e-3)
    assert lengths[-1] == pytest.approx(2 * np.pi * 0.06, rel=2e-3)
    assert max(samples) < 5 * 80  # of 11 s at 80 Hz
    assert live.contour is None


def test_outlines_are_forgotten_beyond_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('scara_kinetostatic.contour.live.MOST_NODES', 250)
    live = fed(LiveContour(arm()), slides((0.0, 0.3), (0.5, 0.8)))
    assert live.forgotten == 1
    (left,) = live.outlines
    assert DISC.normal_error(left.points).max() < 1e-4
    live.clear()
    assert not live.outlines and live.forgotten == 0 and live.present is None


def test_a_jump_is_said_and_the_trace_goes_on() -> None:
    streams = slides((0.0, 0.6))
    position = streams.joints.position.copy()
    position[len(position) // 2 :] += 0.05
    live, problems = LiveContour(arm()), set[str]()
    for _ in polls(live, replace(streams, joints=replace(streams.joints, position=position))):
        problems.add(live.problem)
    assert any('the tip jumps by' in problem for problem in problems)
    assert len(live.outlines) == 2


def rested(stamp: np.ndarray, values: np.ndarray, middle: int) -> tuple[np.ndarray, np.ndarray]:
    """A topic that stays as it is for 30 s from a stamp on."""
    at, period, rest = int(np.searchsorted(stamp, middle)), int(np.median(np.diff(stamp))), 30 * 10**9
    between = stamp[at - 1] + period * np.arange(1, rest // period + 1)
    held = np.repeat(values[at - 1 : at], len(between), axis=0)
    return np.concatenate([stamp[:at], between, stamp[at:] + rest]), np.concatenate([values[:at], held, values[at:]])


def test_a_rest_in_contact_is_said_and_does_not_break_the_outline() -> None:
    streams = slides((0.0, 0.5))
    middle = int(streams.joints.stamp[len(streams.joints.stamp) // 2])
    stamp, position = rested(streams.joints.stamp, streams.joints.position, middle)
    joints = replace(streams.joints, stamp=stamp, position=position)
    stamp, force = rested(streams.wrench.stamp, streams.wrench.force, middle)
    wrench = replace(streams.wrench, stamp=stamp, force=force)
    live, problems = LiveContour(arm()), set[str]()
    for _ in polls(live, replace(streams, joints=joints, wrench=wrench), 1.0):
        problems.add(live.problem)
        assert len(live._pair.joints.samples.stamp) < 25 * 80
    assert any('does not slide' in problem for problem in problems)
    (joined,) = live.outlines
    assert joined.length == pytest.approx(0.5 * 2 * np.pi * 0.06, abs=2e-3)


def test_the_zero_of_the_force() -> None:
    streams = slides((0.0, 0.2))
    bias = np.array([6.0, -8.0])
    biased = replace(streams, wrench=replace(streams.wrench, force=streams.wrench.force + bias))
    live = fed(LiveContour(arm()), biased)
    assert live.zero is not None
    assert live.zero == pytest.approx(bias + trace_contour(streams, arm()).zero, abs=0.3)
    (outline,) = live.outlines
    assert rms(DISC.normal_error(outline.points)) < 1.5e-5
    untared = LiveContour(arm())
    for stamp, values in zip(streams.wrench.stamp[:30].tolist(), [[3.0, 4.0]] * 30, strict=True):
        untared.add_wrench(stamp, values, stamp)
    assert untared.tare(10**9) == pytest.approx([3.0, 4.0])


def test_touches_are_no_slide() -> None:
    live = LiveContour(arm())
    streams = simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL, 1))
    problems = [live.problem for _ in polls(live, streams)]
    assert not live.outlines
    assert any('does not slide' in problem for problem in problems)
