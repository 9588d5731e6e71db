"""The contour is the true surface, as uncertain as it says; what is no slide is refused or left out."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from contour.slides import CELL, DISC, OBJECTS, SQUARE, arm, rested, since, slides, traced, with_force, with_joints

from benchmark.common import normal_error
from scara_kinetostatic.contour.fits import fit_shape
from scara_kinetostatic.contour.result import remarks_on
from scara_kinetostatic.contour.trace import trace_contour, trace_signals
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.cell import SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import forward, inverse, posture
from scara_kinetostatic.model.outline import Surfaces
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import Circle, Slide, polygon
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.streams import as_signals

DISC_CENTER = np.array([0.2, 0.3])
NOISY = SensorModel(force_noise=1.0)


@pytest.mark.parametrize('outline', OBJECTS.values(), ids=OBJECTS)
def test_surface_of_an_unknown_object(outline):
    contour = traced((0, 1.05), outline=outline)
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
    assert any('extrapolated' in warning for warning in remarks_on(replace(contour, force=4 * contour.force), arm()))


def test_without_errors_of_sensors_and_calibration():
    outline = DISC
    exact = replace(arm(), model=replace(arm().model, parameters=PAPER_ACTUAL))
    contour = trace_contour(slides((0, 1), outline=outline, sensors=SensorModel.ideal(200)), exact)
    error = normal_error(outline, contour.surface)
    assert rms(error) < 3e-6
    assert np.abs(error).max() < 2e-5
    assert contour.friction.coefficient == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize('sign', list(SensorSign))
def test_sensor_in_the_tool_frame_and_a_tip_without_radius(sign):
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=sign), tip_radius=None)
    contour = trace_contour(
        slides((0, 0.4), cell=cell), replace(arm(), cell=replace(CELL, tip_radius=None)), cell.sensor
    )
    assert rms(normal_error(DISC, contour.surface)) < 1.2e-5
    assert any('no radius of the tip' in warning for warning in contour.warnings)


def test_the_uncertainty_covers_the_error_at_sharp_edges():
    corners = [[0.10, 0.30], [0.20, 0.30], [0.20, 0.40], [0.10, 0.40]]
    square = polygon(corners)
    contour = traced((0.2, 0.3), outline=square, speed=0.01)
    edge = np.hypot(*(contour.surface - corners[1]).T) < 2e-3
    inside = np.abs(normal_error(square, contour.surface)) < 1.96 * contour.std_normal
    assert edge.sum() > 8
    assert inside[edge].mean() > 0.85
    assert contour.std_normal[edge].max() > 5e-5
    assert np.median(contour.std_normal[~edge]) < 8e-6


def test_the_uncertainty_covers_joint_states_far_apart():
    contour = traced((0, 1.02), outline=SQUARE, speed=0.02, sensors=replace(SensorModel(), joint_rate=10.0))
    error = np.abs(normal_error(SQUARE, contour.surface)) / contour.std_normal
    assert error.max() < 4
    assert np.mean(error < 1.96) > 0.9
    assert any('mm apart: what lies between is not seen' in warning for warning in contour.warnings)


class Hole(NamedTuple):
    """The inside of a round hole around the middle of the disc."""

    radius: float
    is_closed: bool = True

    def surfaces(self, tip_radius: float) -> Surfaces:
        """Where the tip is in contact."""
        center, normal = np.array([[0.2, 0.3]]), np.array([[1.0, 0.0]])
        radii = np.array([tip_radius - self.radius])
        return Surfaces(np.zeros(1, dtype=int), center, radii, np.zeros((1, 2)), normal, np.array([np.pi]))


@pytest.mark.parametrize(('radius', 'speed'), [(0.04, 0.05), (0.0075, 0.01)])
def test_inside_of_a_hole(radius, speed):
    hole = Hole(radius)
    contour = traced((0, 1.05), outline=hole, speed=speed)
    assert rms(normal_error(hole, contour.surface)) < 1e-5
    assert np.median(contour.std_normal) < 1e-5
    assert np.all(((contour.surface - DISC_CENTER) * contour.normal).sum(axis=1) < 0)
    assert contour.friction.coefficient == pytest.approx(0.1, abs=3 * contour.friction.std)
    (joined,) = contour.outlines
    assert joined.closed
    fit = fit_shape(contour, arm(), 'circle').value('radius')
    assert fit.value == pytest.approx(radius, abs=4 * fit.std)
    assert not contour.warnings


def test_an_inner_corner_hardly_wider_than_the_tip_is_said():
    corner = polygon([[0.10, 0.36], [0.18, 0.36], [0.18, 0.28]], 0.0051, closed=False)
    contour = traced((0, 1), outline=corner, speed=0.03)
    (warning,) = contour.warnings
    assert 'an inner corner is hardly wider than the tip' in warning
    assert np.all(np.hypot(*(contour.surface[contour.inner_corner] - (0.18, 0.36)).T) < 8e-3)
    assert np.all(np.abs(normal_error(corner, contour.surface)) < 4 * contour.std_normal)


def test_travel_in_both_directions_separates_friction_from_a_turned_sensor():
    turned, streams = 0.03, slides((0.0, 1.02), (1.0, 0.0))
    c, s = np.cos(turned), np.sin(turned)
    contour = trace_contour(with_force(streams, streams.wrench.force @ np.array([[c, s], [-s, c]])), arm())
    friction = contour.friction
    assert friction.coefficient == pytest.approx(0.1, abs=3 * friction.std)
    assert friction.rotation == pytest.approx(turned, abs=3 * friction.rotation_std)
    (joined,) = contour.outlines
    assert (joined.closed, joined.passes) == (True, (0, 1))


def test_gaps_are_left_open_and_objects_stay_apart():
    two = traced((0.0, 0.4), (0.5, 0.7), outline=SQUARE)
    assert [outline.closed for outline in two.outlines] == [False, False]
    objects = tuple(
        Slide(Circle(*each), 15, 0.1, 0.05, end=1.05) for each in (((0.2, 0.3), 0.03), ((-0.2, 0.35), 0.04))
    )
    apart = trace_contour(simulate_streams(CELL, PAPER_ACTUAL, objects), arm())
    assert [outline.closed for outline in apart.outlines] == [True, True]
    assert apart.outlines[0].length == pytest.approx(2 * np.pi * 0.04, rel=1e-3)


def test_stick_is_left_out():
    streams = slides((0, 0.5))
    moving, contour = trace_contour(streams, arm()), trace_contour(rested(streams, 2.0), arm())
    assert len(contour) == pytest.approx(len(moving), abs=12)
    assert contour.passes.max() == 0


def test_a_pause_of_the_force_is_not_bridged():
    streams = slides((0, 0.5))
    stamp, force = streams.wrench.stamp, streams.wrench.force
    middle = stamp[len(stamp) // 2]
    kept = (stamp < middle) | (stamp > middle + 10**9)
    wrench = replace(streams.wrench, stamp=stamp[kept], force=force[kept])
    contour = trace_contour(replace(streams, wrench=wrench), arm())
    begin = 1e-9 * float(middle - min(stamp[0], streams.joints.stamp[0]))
    assert not np.any((contour.time > begin + 0.05) & (contour.time < begin + 0.95))
    assert contour.passes.max() == 1


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
    return with_joints(with_force(streams, force), position)


def test_short_losses_of_contact_under_a_noisy_sensor():
    streams = slides((0, 0.6), force=2.5, sensors=SensorModel(force_noise=1.0, joint_rate=200, wrench_rate=200))
    contour = trace_contour(lifted(streams, 0.15, 1e-3), arm())
    error = normal_error(DISC, contour.surface)
    assert np.abs(error).max() < 4e-4
    assert np.abs(error / contour.std_normal).max() < 5


def test_a_turning_joint_under_a_noisy_sensor():
    """The torque of a joint passes zero along a straight edge; the noise is that of its dead band, too."""
    contour = traced((0, 1.02), outline=SQUARE, force=3, friction=0.5, sensors=NOISY)
    error = normal_error(SQUARE, contour.surface) / contour.std_normal
    assert rms(error) < 1.3 and np.abs(error).max() < 6


WRONG = {
    'sign': ([[-1, 0], [0, -1]], 'turned: sensor.sign: on_robot would agree'),
    'frame': (None, 'turned: sensor.frame: base would agree'),
    'axes swapped': ([[0, 1], [1, 0]], 'check frame and sign'),
    'sign of x': ([[-1, 0], [0, 1]], 'check frame and sign'),
    'turned by 90°': ([[0, -1], [1, 0]], 'check frame and sign'),
}


@pytest.mark.parametrize('parts', [((0, 1),), ((0.4, 0.1),), ((0, 0.4), (0.4, 0))], ids=['round', 'part', 'back'])
@pytest.mark.parametrize('friction', [0.0, 0.1])
@pytest.mark.parametrize(('matrix', 'remedy'), WRONG.values(), ids=WRONG)
def test_forces_that_contradict_the_motion(matrix, remedy, friction, parts):
    streams = slides(*parts, friction=friction)
    sensor = CELL.sensor if matrix else CELL.sensor._replace(frame=SensorFrame.TOOL)
    wrong = with_force(streams, streams.wrench.force @ np.array(matrix).T) if matrix else streams
    with pytest.raises(UnsupportedDataError, match=remedy):
        trace_contour(wrong, arm(), sensor)


def test_friction_is_not_negative():
    """Also where no motion into contact shows the sign; 0 within its uncertainty is right."""
    streams = slides((0, 0.3))
    zero = streams.wrench.force[:100].mean(axis=0)
    samples = as_signals(streams, CELL)
    with_sign = [trace_signals(samples, '', arm(), CELL.sensor._replace(sign=sign), 0.005, zero) for sign in SensorSign]
    middle = since(streams, streams.joints.stamp[len(streams.joints.stamp) // 2])
    for sign, whole in zip(SensorSign, with_sign, strict=True):
        sensor = CELL.sensor._replace(sign=sign)
        later = trace_signals(as_signals(middle, CELL), '', arm(), sensor, 0.005, zero)
        wrong = sign is SensorSign.ON_ROBOT
        assert ('against the motion' in whole.contradiction) == wrong
        assert ('friction would be -0.1' in later.contradiction) == wrong


@pytest.mark.parametrize('friction', [0.0, 0.1, 0.8])
@pytest.mark.parametrize('turned', [0.0, 0.03])
def test_right_forces_contradict_nothing(friction, turned):
    """In both directions, with a sensor that is turned a little."""
    c, s = np.cos(turned), np.sin(turned)
    for parts in (((0, 1.02),), ((0.9, 0.2),), ((0, 0.4), (0.4, 0))):
        streams = slides(*parts, friction=friction, outline=SQUARE)
        contour = trace_contour(with_force(streams, streams.wrench.force @ np.array([[c, s], [-s, c]])), arm())
        assert not contour.contradiction


def test_a_slide_whose_force_turns_is_left_out():
    """The other one stays."""
    streams = slides((0.0, 0.3), (0.4, 0.6))
    whole = trace_contour(streams, arm())
    second = 1e-9 * (streams.wrench.stamp - streams.joints.stamp[0]) > whole.time[whole.passes == 1][0] - 0.5
    force = streams.wrench.force - whole.zero
    turned = np.where(second[:, None], force @ [[0.0, 1.0], [-1.0, 0.0]], force) + whole.zero
    contour = trace_contour(with_force(streams, turned), arm())
    assert len(contour.outlines) == 1 and contour.time.max() < whole.time[whole.passes == 1][0]
    assert rms(normal_error(DISC, contour.surface)) < 1.5e-5
    assert any('points left out: the force is not across' in warning for warning in contour.warnings)


def test_a_force_that_is_hardly_seen_is_said():
    """Whatever is left of the outline: passes of single points, too."""
    contour = traced((0, 0.6), force=1.2, sensors=SensorModel(force_noise=1.0, wrench_rate=500))
    assert any('from which on contact is seen' in warning for warning in contour.warnings)
    assert sum(outline.length for outline in contour.outlines) > 0


def test_the_zero_of_the_sensor_is_that_of_begin_and_end():
    """However large it is."""
    streams, bias = slides((0, 1)), np.array([-8.0, -6.0])
    contour, expected = (trace_contour(with_force(streams, streams.wrench.force + b), arm()) for b in (bias, 0.0))
    np.testing.assert_allclose(contour.zero - expected.zero, bias, atol=1e-9)
    np.testing.assert_allclose(contour.surface, expected.surface, atol=1e-9)
    size = np.hypot(*(streams.wrench.force - streams.wrench.force[:40].mean(axis=0)).T)
    begins = streams.wrench.stamp[int(np.argmax(size > 10)) + 200]
    with pytest.raises(UnsupportedDataError, match='it begins in contact: later the force is 12'):
        trace_contour(since(streams, begins), arm())


def test_what_is_no_slide_is_refused():
    streams = slides((0, 0.3))
    free = streams.wrench.force[:40].mean(axis=0) + 0.0 * streams.wrench.force
    jumping = streams.joints.position.copy()
    jumping[len(jumping) // 2 :] += 0.02
    still = slides((0, 1), outline=polygon([[0.2, 0.3], [0.2003, 0.3]], closed=False), speed=0.01)
    for bad, message in (
        (with_force(streams, free), 'touches nothing'),
        (with_joints(streams, jumping), r'the tip jumps by .* mm, in contact, at'),
        (still, 'does not slide'),
    ):
        with pytest.raises(UnsupportedDataError, match=message):
            trace_contour(bad, arm())
