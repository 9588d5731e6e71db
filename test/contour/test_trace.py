"""The contour is the true surface, as uncertain as it says; what is no slide is refused or left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, DISC, OBJECTS, SQUARE, arm

from benchmark.common import normal_error
from scara_kinetostatic.contour.fits import fit_shape
from scara_kinetostatic.contour.trace import Course, _across, trace_contour
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.cell import SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import forward, inverse, posture
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.slides import Arc, Outline, Slide, circle, polygon, simulate_slides
from scara_kinetostatic.simulation.streams import SensorModel

DISC_CENTER = np.array([0.2, 0.3])
EXACT = replace(arm(), model=replace(arm().model, parameters=PAPER_ACTUAL))
"""An arm whose calibration is without error."""


def slide_along(outline, *, cell=CELL, seed=0, sensors=None, **more):
    slide = Slide(outline, **{'force': 15, 'friction': 0.1, 'speed': 0.05, **more})
    return simulate_slides(cell, PAPER_ACTUAL, [slide], seed=seed, sensors=sensors)


@pytest.mark.parametrize('outline', OBJECTS.values(), ids=OBJECTS)
def test_surface_of_an_unknown_object(outline):
    contour = trace_contour(slide_along(outline, end=1.05), arm())
    error = normal_error(outline, contour.surface)
    assert rms(error) < 2 * rms(contour.std_normal)
    assert np.mean(np.abs(error) < 1.96 * contour.std_normal) > 0.85
    nominal = forward(CELL.nominal, contour.joints) - CELL.tip_radius * contour.normal
    assert rms(normal_error(outline, nominal)) > 100 * rms(error)
    (joined,) = contour.outlines
    assert joined.closed
    assert rms(normal_error(outline, joined.points)) < 2 * rms(contour.std_normal)
    assert np.mean(normal_error(outline, contour.surface + 1e-3 * contour.normal) > 9e-4) == 1.0
    assert contour.friction.coefficient == pytest.approx(0.1, abs=3 * contour.friction.std)
    assert not contour.warnings


@pytest.mark.parametrize('outline', [DISC, OBJECTS['ellipse']])
def test_without_errors_of_sensors_and_calibration(outline):
    contour = trace_contour(slide_along(outline, sensors=SensorModel.ideal(200)), EXACT)
    error = normal_error(outline, contour.surface)
    assert rms(error) < 3e-6
    assert np.abs(error).max() < 2e-5
    assert contour.friction.coefficient == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize('sign', list(SensorSign))
def test_sensor_in_the_tool_frame(sign):
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=sign))
    streams = slide_along(DISC, cell=cell, end=0.4)
    contour = trace_contour(streams, arm(), cell.sensor)
    assert rms(normal_error(DISC, contour.surface)) < 1.2e-5


@pytest.mark.parametrize('speed', [0.05, 0.01])
def test_the_uncertainty_covers_the_error_at_sharp_edges(speed):
    corners = [[0.10, 0.30], [0.20, 0.30], [0.20, 0.40], [0.10, 0.40]]
    square = polygon(corners)
    contour = trace_contour(slide_along(square, speed=speed, begin=0.15, end=0.35), arm())
    edge = np.hypot(*(contour.surface - corners[1]).T) < 2e-3
    inside = np.abs(normal_error(square, contour.surface)) < 1.96 * contour.std_normal
    assert edge.sum() > 8
    assert inside[edge].mean() > 0.85
    assert contour.std_normal[edge].max() > 5e-5
    assert np.median(contour.std_normal[~edge]) < 8e-6


def test_the_uncertainty_covers_joint_states_far_apart():
    sparse = replace(SensorModel(), joint_rate=10.0)
    contour = trace_contour(slide_along(SQUARE, speed=0.02, end=1.02, sensors=sparse), arm())
    error = np.abs(normal_error(SQUARE, contour.surface)) / contour.std_normal
    assert error.max() < 4
    assert np.mean(error < 1.96) > 0.9
    assert any('mm apart: what lies between is not seen' in warning for warning in contour.warnings)


@pytest.mark.parametrize(('radius', 'speed'), [(0.04, 0.05), (0.0075, 0.01)])
def test_inside_of_a_hole(radius, speed):
    hole = Outline((Arc((0.2, 0.3), (-radius, -radius), np.pi, 0.0, -2 * np.pi),), closed=True)
    contour = trace_contour(slide_along(hole, speed=speed, end=1.05), arm())
    error = normal_error(hole, contour.surface)
    assert rms(error) < 1e-5
    assert np.median(contour.std_normal) < 1e-5
    assert np.all(((contour.surface - (0.2, 0.3)) * contour.normal).sum(axis=1) < 0)
    assert contour.friction.coefficient == pytest.approx(0.1, abs=3 * contour.friction.std)
    (joined,) = contour.outlines
    assert joined.closed
    fit = fit_shape(contour, arm(), 'circle').value('radius')
    assert fit.value == pytest.approx(radius, abs=4 * fit.std)
    assert not contour.warnings


def test_an_inner_corner_hardly_wider_than_the_tip_is_said():
    corner = polygon([[0.10, 0.36], [0.18, 0.36], [0.18, 0.28]], 0.0051, closed=False)
    contour = trace_contour(slide_along(corner, speed=0.03), arm())
    assert contour.warnings == (
        'an inner corner is hardly wider than the tip: there the outline has the radius of the tip, the object may be '
        'sharper',
    )
    assert np.all(np.hypot(*(contour.surface[contour.inner_corner] - (0.18, 0.36)).T) < 8e-3)
    error = np.abs(normal_error(corner, contour.surface))
    assert np.all(error < 4 * contour.std_normal)


def test_travel_in_both_directions_separates_friction_from_a_turned_sensor():
    turned = 0.03
    slides = [Slide(DISC, 15, 0.1, 0.05, begin=a, end=b) for a, b in ((0.0, 1.02), (1.0, 0.0))]
    streams = simulate_slides(CELL, PAPER_ACTUAL, slides)
    c, s = np.cos(turned), np.sin(turned)
    force = streams.wrench.force @ np.array([[c, s], [-s, c]])
    contour = trace_contour(replace(streams, wrench=replace(streams.wrench, force=force)), arm())
    friction = contour.friction
    assert friction.coefficient == pytest.approx(0.1, abs=3 * friction.std)
    assert friction.rotation == pytest.approx(turned, abs=3 * friction.rotation_std)
    (joined,) = contour.outlines
    assert joined.closed
    assert joined.passes == (0, 1)


def test_passes_are_joined_and_gaps_left_open():
    parts = ((0.0, 0.4), (0.35, 0.7), (0.65, 1.05))
    slides = [Slide(SQUARE, 15, 0.1, 0.05, begin=a, end=b) for a, b in parts]
    whole = trace_contour(simulate_slides(CELL, PAPER_ACTUAL, slides), arm())
    (joined,) = whole.outlines
    assert joined.closed
    assert joined.passes == (0, 1, 2)
    assert joined.length == pytest.approx(0.4 - 8 * 0.01 + 2 * np.pi * 0.01, rel=2e-3)
    assert whole.lost > 1
    two = trace_contour(simulate_slides(CELL, PAPER_ACTUAL, (slides[0], replace(slides[1], begin=0.5))), arm())
    assert [outline.closed for outline in two.outlines] == [False, False]
    here, there = circle((0.2, 0.3), 0.03), circle((-0.2, 0.35), 0.04)
    objects = [Slide(outline, 15, 0.1, 0.05, end=1.05) for outline in (here, there)]
    apart = trace_contour(simulate_slides(CELL, PAPER_ACTUAL, objects), arm())
    assert [outline.closed for outline in apart.outlines] == [True, True]
    assert apart.outlines[0].length == pytest.approx(2 * np.pi * 0.04, rel=1e-3)


def test_stick_is_left_out():
    streams = slide_along(DISC, end=0.5)
    moving = trace_contour(streams, arm())
    assert 0.3 < moving.stuck < 1.2
    stamp, position = streams.joints.stamp, streams.joints.position
    middle = len(stamp) // 2
    pause = 2 * 10**9
    rows = np.arange(160)
    stopped = np.concatenate([stamp[:middle], stamp[middle] + rows * (pause // 160), stamp[middle:] + pause])
    joints = np.concatenate(
        [position[:middle], np.repeat(position[middle : middle + 1], 160, axis=0), position[middle:]]
    )
    at = np.searchsorted(streams.wrench.stamp, stamp[middle])
    rest = streams.wrench.stamp[at] + np.arange(196) * (pause // 196)
    wrench = np.concatenate([streams.wrench.stamp[:at], rest, streams.wrench.stamp[at:] + pause])
    force = np.concatenate(
        [
            streams.wrench.force[:at],
            np.repeat(streams.wrench.force[at : at + 1], 196, axis=0),
            streams.wrench.force[at:],
        ]
    )
    streams = replace(
        streams,
        joints=replace(streams.joints, stamp=stopped, position=joints),
        wrench=replace(streams.wrench, stamp=wrench, force=force),
    )
    contour = trace_contour(streams, arm())
    assert contour.stuck == pytest.approx(moving.stuck + 2.0, abs=0.2)
    assert len(contour) == pytest.approx(len(moving), abs=12)
    assert contour.passes.max() == 0


def test_a_pause_of_the_force_is_not_bridged():
    streams = slide_along(DISC, end=0.5)
    stamp, force = streams.wrench.stamp, streams.wrench.force
    middle = stamp[len(stamp) // 2]
    kept = (stamp < middle) | (stamp > middle + 10**9)
    contour = trace_contour(
        replace(streams, wrench=replace(streams.wrench, stamp=stamp[kept], force=force[kept])), arm()
    )
    since = 1e-9 * float(middle - min(stamp[0], streams.joints.stamp[0]))
    assert not np.any((contour.time > since + 0.05) & (contour.time < since + 0.95))
    assert contour.passes.max() == 1


def test_no_radius_of_the_tip_is_said():
    cell = replace(CELL, tip_radius=None)
    streams = simulate_slides(cell, PAPER_ACTUAL, [Slide(DISC, 15, 0.1, 0.05, end=0.3)])
    contour = trace_contour(streams, replace(arm(), cell=cell))
    assert any('no radius of the tip' in warning for warning in contour.warnings)
    assert rms(normal_error(DISC, contour.surface)) < 1.2e-5


def test_a_force_beyond_the_calibration_is_said():
    contour = trace_contour(slide_along(DISC, end=0.2, force=60), arm())
    assert any('extrapolated' in warning for warning in contour.warnings)


def test_a_light_slide_under_a_noisy_sensor():
    """Three times the noise of a sample: one outline, as uncertain as it says."""
    errors = []
    for seed in range(2):
        streams = slide_along(DISC, end=0.5, force=3, seed=seed, sensors=SensorModel(force_noise=1.0))
        contour = trace_contour(streams, arm(seed))
        assert len(contour.outlines) == 1
        assert contour.lost < 0.1
        errors.append(normal_error(DISC, contour.surface) / contour.std_normal)
    assert 0.5 < rms(np.concatenate(errors)) < 1.3


def lifted(streams, duration, height):
    """The same with the tip lifted off the disc for so long, five times, the force the noise alone."""
    random, start = np.random.default_rng(0), streams.joints.stamp[0]
    force, position = streams.wrench.force.copy(), streams.joints.position.copy()
    for begin in (3.0, 4.0, 5.0, 6.0, 7.0):
        times = [1e-9 * (topic.stamp - start) - begin for topic in (streams.wrench, streams.joints)]
        wrench, joints = ((time >= 0) & (time < duration) for time in times)
        force[wrench] = force[:100].mean(axis=0) + random.normal(0, 1, (wrench.sum(), 2))
        tip = forward(PAPER_ACTUAL, position[joints])
        outward = (tip - DISC_CENTER) / np.hypot(*(tip - DISC_CENTER).T)[:, None]
        up = height * np.sin(np.pi * times[1][joints] / duration)[:, None]
        position[joints] = inverse(PAPER_ACTUAL, tip + up * outward, posture(PAPER_ACTUAL, position[joints]))
    wrench, joints = replace(streams.wrench, force=force), replace(streams.joints, position=position)
    return replace(streams, wrench=wrench, joints=joints)


@pytest.mark.parametrize(('duration', 'height'), [(0.08, 5e-4), (0.15, 1e-3)])
def test_short_losses_of_contact_under_a_noisy_sensor(duration, height):
    sensors = SensorModel(force_noise=1.0, joint_rate=200, wrench_rate=200)
    contour = trace_contour(lifted(slide_along(DISC, end=0.6, force=2.5, sensors=sensors), duration, height), arm())
    error = normal_error(DISC, contour.surface)
    assert np.abs(error).max() < 4e-4
    assert np.abs(error / contour.std_normal).max() < 5


def test_a_turning_joint_under_a_noisy_sensor():
    """The torque of a joint passes zero along a straight edge; the noise is that of its dead band, too."""
    slide = slide_along(SQUARE, end=1.02, force=3, friction=0.5, sensors=SensorModel(force_noise=1.0))
    contour = trace_contour(slide, arm())
    error = normal_error(SQUARE, contour.surface) / contour.std_normal
    assert rms(error) < 1.3 and np.abs(error).max() < 6


def test_a_slide_whose_force_turns_is_left_out():
    """The other one stays."""
    slides = [Slide(DISC, 15, 0.1, 0.05, begin=a, end=b) for a, b in ((0.0, 0.3), (0.4, 0.6))]
    streams = simulate_slides(CELL, PAPER_ACTUAL, slides)
    whole = trace_contour(streams, arm())
    second = 1e-9 * (streams.wrench.stamp - streams.joints.stamp[0]) > whole.time[whole.passes == 1][0] - 0.5
    force = streams.wrench.force - whole.zero
    turned = np.where(second[:, None], force @ [[0.0, 1.0], [-1.0, 0.0]], force) + whole.zero
    contour = trace_contour(replace(streams, wrench=replace(streams.wrench, force=turned)), arm())
    assert len(contour.outlines) == 1 and contour.time.max() < whole.time[whole.passes == 1][0]
    assert rms(normal_error(DISC, contour.surface)) < 1.5e-5
    assert any('points left out: the force is not across' in warning for warning in contour.warnings)


@pytest.mark.parametrize('seed', [0])
def test_a_force_that_is_hardly_seen_is_said(seed):
    """Whatever is left of the outline: passes of single points, too."""
    streams = slide_along(DISC, end=0.6, force=1.2, seed=seed, sensors=SensorModel(force_noise=1.0, wrench_rate=500))
    contour = trace_contour(streams, arm())
    assert any('from which on contact is seen' in warning for warning in contour.warnings)
    assert sum(outline.length for outline in contour.outlines) > 0


@pytest.mark.parametrize('bias', [(-8.0, -6.0)])
def test_a_sensor_with_a_large_zero(bias):
    """Begin and end say that it is no contact."""
    streams = slide_along(DISC)
    biased = replace(streams, wrench=replace(streams.wrench, force=streams.wrench.force + np.array(bias)))
    expected, contour = trace_contour(streams, arm()), trace_contour(biased, arm())
    np.testing.assert_allclose(contour.zero - expected.zero, bias, atol=1e-9)
    np.testing.assert_allclose(contour.surface, expected.surface, atol=1e-9)


def test_a_recording_that_begins_in_contact():
    streams = slide_along(DISC)
    first = int(np.argmax(np.hypot(*(streams.wrench.force - streams.wrench.force[:40].mean(axis=0)).T) > 10)) + 200
    start = streams.wrench.stamp[first]
    wrench = replace(streams.wrench, stamp=streams.wrench.stamp[first:], force=streams.wrench.force[first:])
    later = np.searchsorted(streams.joints.stamp, start)
    joints = replace(streams.joints, stamp=streams.joints.stamp[later:], position=streams.joints.position[later:])
    with pytest.raises(UnsupportedDataError, match='it begins in contact: later the force is 12'):
        trace_contour(replace(streams, joints=joints, wrench=wrench), arm())


def test_what_is_no_slide_is_refused():
    streams = slide_along(DISC, end=0.3)
    free = replace(streams.wrench, force=streams.wrench.force[:40].mean(axis=0) + 0.0 * streams.wrench.force)
    with pytest.raises(UnsupportedDataError, match='touches nothing'):
        trace_contour(replace(streams, wrench=free), arm())
    position = streams.joints.position.copy()
    position[len(position) // 2 :] += 0.02
    with pytest.raises(UnsupportedDataError, match=r'the tip jumps by .* mm, in contact, at'):
        trace_contour(replace(streams, joints=replace(streams.joints, position=position)), arm())
    still = slide_along(polygon([[0.2, 0.3], [0.2003, 0.3]], closed=False), speed=0.01)
    with pytest.raises(UnsupportedDataError, match='does not slide'):
        trace_contour(still, arm())


@pytest.mark.parametrize(('bad', 'kept'), [(0, 100), (10, 90), (20, 50)])
def test_a_pass_whose_forces_are_not_across_its_motion_is_left_out(bad, kept):
    """Two passes of 50 points; at some of the second the force is along the motion."""
    normal, flat = np.tile([0.0, 1.0], (100, 1)), np.zeros(100)
    course = Course(normal, np.tile([1.0, 0.0], (100, 1)), flat, flat, flat, flat, flat.astype(bool))
    force = -10.0 * normal
    force[50 : 50 + bad] = [10.0, 0.0]
    assert _across(course, force, np.repeat([0, 1], 50), 'here').sum() == kept
