"""The simulated cell with effects beyond the base model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effects.scenes import EFFECTS, LABELS, plausible
from simulation.oval_disc import OvalDisc

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise, SensorFrame, SensorSign
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, true_force
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.simulation.motion import Phase, Trajectory
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import find_touches

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3))
PLAN = default_plan(CELL, per_disc=8, preload=0.3)
FEW = PLAN.select(np.arange(2, len(PLAN), 7))
EXACT = Noise(0.0, 0.0)
PLAIN = simulate_touches(CELL, PAPER_MEASURED, PLAN, EXACT)
QUIET = SensorModel(EXACT, force_noise=0.0, resolution=0.0)
OVAL = OvalDisc.of(1, 'disc_2')
EVERY = pytest.mark.parametrize(
    ('effect', 'values'),
    [*((effect, plausible(effect)) for effect in EFFECTS), (OVAL, (1e-4, -5e-5))],
    ids=[*LABELS, 'oval_disc'],
)


STREAMED = (
    'contact_friction', 'sensor_rotation', 'sensor_bias', 'encoder_gain[joint1]', 'transmission_error[joint2]',
    'joint_hysteresis[joint1]', 'joint_slip[joint2]', 'contact_compliance', 'object_position[disc_2]', 'thermal_drift',
)  # fmt: skip
"""Of every kind one: sensor, encoder, transmission, memory, contact, object, time."""


def with_effects(effects, values, robot=PAPER_ACTUAL):
    ends = np.cumsum([len(effect.parameters) for effect in effects])[:-1]
    return ExtendedModel(robot, tuple(effects), tuple(np.split(np.ravel(values), ends)))


def of(label):
    return EFFECTS[LABELS.index(label)]


@EVERY
def test_touches_obey_the_extended_model_under_the_planned_force(effect, values):
    truth = with_effects([effect], values, PAPER_MEASURED)
    touches = simulate_touches(CELL, truth, PLAN, EXACT)
    true = true_force(truth, touches.force, TouchMetadata.of(touches))
    discs = CELL.centers[PLAN.disc], CELL.radii[PLAN.disc]
    found = contact(truth, touches.joints, *discs, warm_start=true, metadata=TouchMetadata.of(touches))
    assert found.solved.all()
    np.testing.assert_allclose(found.force, true, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*true.T), PLAN.force, rtol=1e-12)
    assert np.abs(np.hstack([touches.joints - PLAIN.joints, touches.force - PLAIN.force])).max() > 1e-7


@pytest.mark.parametrize('label', STREAMED)
def test_touches_found_in_the_streams_are_those_without(label):
    truth = with_effects([of(label)], plausible(of(label)))
    found = find_touches(simulate_streams(CELL, truth, FEW, sensors=QUIET), CELL)
    made = simulate_touches(CELL, truth, FEW, EXACT)
    assert found.found == len(found.touches) == len(FEW)
    assert not found.warnings
    np.testing.assert_array_equal(found.touches.disc, made.disc)
    np.testing.assert_allclose(found.touches.joints, made.joints, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.touches.force, made.force, rtol=0, atol=1e-3)
    np.testing.assert_allclose(found.touches.time, made.time, atol=0.1)
    clear = np.abs(made.press) > 4e-5
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(np.sign(found.touches.press[clear]), np.sign(made.press[clear]))
    np.testing.assert_allclose(found.touches.press, made.press, rtol=0.2, atol=3e-5)


@pytest.mark.parametrize('label', ['contact_compliance', 'object_radius[disc_2]', 'encoder_gain[joint1]'])
def test_the_force_rises_and_falls_steadily_and_is_zero_in_free_motion(label):
    truth = with_effects([of(label)], plausible(of(label)))
    motion = Trajectory(CELL, truth, PLAN)
    time = np.linspace(0.0, motion.duration, 20_000)
    instant = motion.state_at(time)
    assert np.abs(np.diff(instant.joints, axis=0)).max() < 9.0 * (time[1] - time[0])
    load = np.hypot(*instant.force.T)
    assert np.all(load[(instant.phase == Phase.TRAVEL) | (instant.phase == Phase.PAUSE)] == 0)
    held = instant.phase == Phase.HOLD
    np.testing.assert_allclose(instant.force[held], motion.hold_force[instant.touch[held]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(instant.relative_force, load / np.hypot(*motion.hold_force.T)[instant.touch])
    assert instant.relative_force.max() == pytest.approx(1.3, rel=1e-3)
    assert np.abs(np.diff(load)).max() < 500.0 * (time[1] - time[0]) + 0.2
    disc = PLAN.disc[instant.touch[::20]]
    metadata = motion.metadata.select(instant.touch[::20])
    expected = contact(truth, instant.joints[::20], CELL.centers[disc], CELL.radii[disc], metadata=metadata)
    warm_start = expected.solved & ~np.isin(instant.phase[::20], [Phase.TRAVEL, Phase.PAUSE])
    assert warm_start.mean() > 0.4
    np.testing.assert_allclose(instant.force[::20][warm_start], expected.force[warm_start], rtol=0, atol=1e-9)


def test_effects_at_their_start_change_nothing():
    start = [value for effect in EFFECTS for value in effect.start]
    touches, plain = (simulate_touches(CELL, of, PLAN) for of in (with_effects(EFFECTS, start), PAPER_ACTUAL))
    np.testing.assert_array_equal(touches.joints, plain.joints)
    np.testing.assert_allclose(touches.force, plain.force, rtol=0, atol=1e-9)
    np.testing.assert_allclose(touches.press, plain.press, rtol=0, atol=1e-15)


def test_several_effects_at_once_take_their_values_in_turn():
    labels = ('object_radius[disc_1]', 'transmission_error[joint2]', 'sensor_bias')
    effects, values = [of(label) for label in labels], [7e-5, 1e-4, 0.7, 7.3, 1.0, -0.7]
    truth = with_effects(effects, values)
    touches = simulate_touches(CELL, truth, PLAN, EXACT)
    without_bias = simulate_touches(CELL, with_effects(effects[:2], values[:4]), PLAN, EXACT)
    np.testing.assert_array_equal(touches.joints, without_bias.joints)
    np.testing.assert_allclose(touches.force - without_bias.force, np.tile([1.0, -0.7], (len(PLAN), 1)), atol=1e-9)


@pytest.mark.parametrize('frame', list(SensorFrame))
@pytest.mark.parametrize('sign', list(SensorSign))
def test_errors_of_the_sensor_are_in_its_frame_and_grow_with_the_load(frame, sign):
    declared = replace(CELL, sensor=CELL.sensor._replace(frame=frame, sign=sign))
    truth = with_effects([of('sensor_bias'), of('sensor_rotation')], [1.0, -0.7, 0.05])
    zero = np.array([0.4, 0.3])
    sensors = replace(QUIET, bias=tuple(zero), jitter=0.0)
    streams = simulate_streams(declared, truth, PLAN, sensors=sensors)
    motion = Trajectory(declared, truth, PLAN)
    instant = motion.state_at(1e-9 * (streams.wrench.stamp - streams.joints.stamp[0]))
    force, side = streams.wrench.force - zero, -1.0 if sign is SensorSign.ON_ROBOT else 1.0
    np.testing.assert_allclose(force[instant.relative_force == 0], 0.0, atol=1e-12)
    true = instant.force
    if frame is SensorFrame.TOOL:
        true = rotate(true, -(instant.joints.sum(axis=1) + PAPER_ACTUAL.theta1 + PAPER_ACTUAL.theta2))
    turned = rotate(true, np.full(len(true), 0.05))
    np.testing.assert_allclose(side * force, turned + instant.relative_force[:, None] * (1.0, -0.7), atol=1e-9)
    found = find_touches(streams, declared).touches
    np.testing.assert_allclose(found.force, simulate_touches(declared, truth, PLAN, EXACT).force, atol=1e-3)


def test_an_effect_that_leaves_no_touch_is_refused():
    truth = with_effects([of('object_position[disc_2]')], [-0.3, 0.0])
    with pytest.raises(UnsupportedDataError, match="cannot reach touch 0 of the plan, on 'disc_2'"):
        simulate_touches(CELL, truth, PLAN.select(PLAN.disc == 1).select(np.arange(1)))
