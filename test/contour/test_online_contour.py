"""The contour while it is traced is that of the whole recording, in bounded memory, and says what it cannot trace."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from contour.slides import AROUND, CELL, DISC, SQUARE, arm, rested, since, slides, with_force, with_joints

from benchmark.common import normal_error
from scara_kinetostatic.contour.online import OnlineContour
from scara_kinetostatic.contour.result import Polyline
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.interface import compensate
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.cell import Sensor, SensorSign
from scara_kinetostatic.touches.streams import Streams


def samples(streams: Streams) -> list[tuple[int, int, list[float]]]:
    """Both topics in the order of time: stamp, number of the topic, values."""
    topics = ((streams.joints.stamp, streams.joints.position), (streams.wrench.stamp, streams.wrench.force))
    return sorted(
        (stamp, number, values)
        for number, (stamps, rows) in enumerate(topics)
        for stamp, values in zip(stamps.tolist(), rows.tolist(), strict=True)
    )


def polls(online: OnlineContour, streams: Streams, every: float = 0.5) -> Iterator[bool]:
    """Feeds a recording, and polls every so many seconds of it."""
    rows, step = samples(streams), round(1e9 * every)
    due = rows[0][0] + step
    for stamp, number, values in rows:
        (online.add_wrench if number else online.add_joint_state)(stamp, values, stamp)
        if stamp >= due:
            due += step
            yield online.poll()
    yield online.poll()


def fed(streams: Streams, every: float = 0.5) -> OnlineContour:
    online = OnlineContour(arm())
    assert any([*polls(online, streams, every)])
    return online


def check(outline: Polyline, turns: float, error: float, rel: float = 0.01) -> None:
    """Of a part of the disc."""
    assert outline.length == pytest.approx(turns * AROUND, rel=rel)
    assert rms(normal_error(DISC, outline.points)) < error


def test_forces_that_contradict_the_motion_are_said() -> None:
    streams = slides((0.0, 0.3))
    said = 'friction is not negative; check frame and sign of the force sensor'
    assert said in fed(with_force(streams, -streams.wrench.force)).problem
    assert not fed(streams).problem


def test_round_an_object_in_several_passes() -> None:
    streams = slides((0.0, 0.4), (0.7, 0.35), (0.65, 1.05), outline=SQUARE)
    (joined,), (whole,) = fed(streams).outlines, trace_contour(streams, arm()).outlines
    assert joined.closed
    assert joined.length == pytest.approx(whole.length, rel=1e-3)
    assert rms(normal_error(SQUARE, joined.points)) < 1.1 * rms(normal_error(SQUARE, whole.points)) + 1e-6
    np.testing.assert_allclose(np.median(joined.std), np.median(whole.std), rtol=0.05)


def test_the_outline_grows_while_the_tip_slides() -> None:
    online, lengths, kept = OnlineContour(arm()), [], []
    for _ in polls(online, slides((0.0, 1.05))):
        lengths.append(sum(outline.length for outline in online.outlines))
        kept.append(len(online._pair.joints.samples.stamp))
        assert len(online.outlines) <= 1
        if online.contour is not None:
            tip, present = online.contour.surface[-1], online.present
            assert present is not None
            assert np.hypot(*(present.points - tip).T).min() < 2e-3
    assert np.all(np.diff(lengths) > -1e-3)
    assert lengths[-1] == pytest.approx(AROUND, rel=2e-3)
    assert max(kept) < 5 * 80  # of 11 s at 80 Hz
    assert online.contour is None


def test_a_jump_is_said_and_the_trace_goes_on() -> None:
    """But for what came since the last poll, what was traced before stays."""
    streams = slides((0.0, 0.6))
    position = streams.joints.position.copy()
    position[len(position) // 2 :] += 0.05
    online = fed(with_joints(streams, position))
    assert 'the tip jumps by' in online.problem
    online.poll()
    first, second = (outline.length for outline in online.outlines)
    assert 0.3 * AROUND - 0.03 < min(first, second) <= max(first, second) < 0.3 * AROUND
    assert rms(normal_error(DISC, online.outlines[0].points)) < 2e-5
    assert 'the tip jumps by' in online.problem
    online.clear()
    assert not online.problem and not online.outlines and online.present is None


def test_a_light_contact_is_not_taken_for_the_zero() -> None:
    (joined,) = fed(slides((0, 0.6), force=2.0)).outlines
    check(joined, 0.6, 5e-5)


def test_a_zero_that_drifts_farther_than_a_contact_begins_at() -> None:
    """By 2.4 N while the tip slides; the free motion after it is not taken for contact."""
    streams = slides((0.0, 0.2), (0.3, 0.5), speed=0.01)
    stamp = streams.wrench.stamp
    drift = np.interp(stamp, stamp[0] + np.array([5, 10]) * 10**9, [0.0, 2.4])[:, None] * [1, 0]
    for outline in fed(with_force(streams, streams.wrench.force + drift)).outlines:
        check(outline, 0.2, np.inf, 0.02)
    check(outline, 0.2, 5e-5, 0.02)


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


def test_a_start_in_contact_is_said() -> None:
    streams = slides((0.0, 0.6))
    online = fed(since(streams, int(streams.joints.stamp[0]) + 4 * 10**9))
    assert 'the zero of the force was wrong by 14.7 N' in online.problem
    np.testing.assert_allclose(online.zero, fed(streams).zero, atol=0.1)


def test_a_long_rest_in_contact_is_said_and_begins_a_new_outline() -> None:
    online, problems = OnlineContour(arm()), set[str]()
    for _ in polls(online, rested(slides((0.0, 0.5)), 30.0), 1.0):
        problems.add(online.problem)
        assert len(online._pair.joints.samples.stamp) < 25 * 80
    assert any('does not slide' in problem for problem in problems)
    lengths = [outline.length for outline in online.outlines]
    assert len(lengths) == 2
    assert sum(lengths) == pytest.approx(0.5 * AROUND, abs=5e-3)


def test_a_sensor_with_a_large_zero() -> None:
    """Traced by the zero of the free motion at first, without a word."""
    streams, bias = slides((0.0, 0.6)), np.array([6.0, -8.0])
    online = fed(with_force(streams, streams.wrench.force + bias))
    assert online.zero == pytest.approx(bias + trace_contour(streams, arm()).zero, abs=0.3)
    (outline,) = online.outlines
    check(outline, 0.6, 2e-5)
    assert 'zero' not in online.problem
    untared = OnlineContour(arm())
    for stamp in streams.wrench.stamp[:30].tolist():
        untared.add_wrench(stamp, [3.0, 4.0], stamp)
    assert untared.tare(10**9) == pytest.approx([3.0, 4.0])


@pytest.mark.parametrize('sign', SensorSign)
def test_no_zero_is_taken_on_a_known_object(sign: SensorSign) -> None:
    disc, force = CELL.discs[0], [0.0, 25.0]
    online = OnlineContour(arm(), Sensor(sign=sign))
    (joints,) = compensate(arm(), (disc.x, disc.y - disc.radius), force, 'left').joints
    for stamp in range(1, 100):
        online.add_joint_state(stamp, joints, stamp)
        online.add_wrench(stamp, force if sign is SensorSign.ON_OBJECT else [0.0, -25.0], stamp)
    with pytest.raises(UnsupportedDataError, match="presses against 'disc_1' with 25 N"):
        online.tare(10**9)
    assert online.zero is None
