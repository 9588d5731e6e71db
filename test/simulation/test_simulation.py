"""The simulated cell obeys the model at every instant; its sensors do what they say."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.simulation.motion import Phase, Timing, Trajectory
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import START, SensorModel, simulate_streams, simulate_touches

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3))
PLAN = default_plan(CELL)
BEYOND = default_plan(CELL, preload=0.3)
SMALL = PLAN.select(np.arange(12))


@pytest.mark.parametrize('truth', [PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL], ids=['actual', 'measured', 'nominal'])
@pytest.mark.parametrize('plan', [PLAN, BEYOND], ids=['plain', 'beyond'])
def test_force_is_that_of_the_model_all_along(truth, plan):
    motion = Trajectory(CELL, truth, plan)
    instant = motion.state_at(np.sort(np.random.default_rng(0).uniform(0, motion.duration, 4000)))
    warm_start = instant.phase >= Phase.APPROACH
    disc = plan.disc[instant.touch[warm_start]]
    expected = contact(truth, instant.joints[warm_start], CELL.centers[disc], CELL.radii[disc]).force
    np.testing.assert_allclose(instant.force[warm_start], expected, rtol=0, atol=5e-6)
    assert np.all(instant.force[~warm_start] == 0)


def test_holds_are_as_planned():
    motion = Trajectory(CELL, PAPER_ACTUAL, PLAN)
    joints, force = motion.state_at(motion.hold_time)[:2]
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), PLAN.force, rtol=1e-12)
    np.testing.assert_array_equal(joints, motion.hold_joints)
    np.testing.assert_array_equal(posture(PAPER_ACTUAL, joints), PLAN.posture)
    np.testing.assert_allclose(force / PLAN.force[:, None], -PLAN.normal(), atol=1e-12)
    assert np.all(motion.state_at(motion.hold_time).phase == Phase.HOLD)
    free = forward(PAPER_ACTUAL, motion.free_joints) - CELL.centers[PLAN.disc]
    np.testing.assert_allclose(np.linalg.norm(free, axis=1), CELL.radii[PLAN.disc] + 0.018, atol=1e-9)


def test_preload_peaks_eases_and_leaves_the_holds():
    motion, plain = Trajectory(CELL, PAPER_ACTUAL, BEYOND), Trajectory(CELL, PAPER_ACTUAL, PLAN)
    np.testing.assert_array_equal(motion.hold_joints, plain.hold_joints)
    assert not np.any(plain.state_at(np.linspace(0.0, 60.0, 20_000)).phase == Phase.EASE)
    ease = motion.knots[:, Phase.HOLD] - motion.knots[:, Phase.EASE]
    np.testing.assert_allclose(ease, np.where(BEYOND.preload > 0, Timing().ease, 0.0), atol=1e-9)
    beyond = BEYOND.preload > 0
    peak = motion.state_at(motion.knots[beyond, Phase.EASE])
    assert np.all(peak.phase == Phase.EASE)
    np.testing.assert_allclose(np.linalg.norm(peak.force, axis=1), 1.3 * BEYOND.force[beyond], rtol=1e-12)
    np.testing.assert_allclose(peak.joints, motion.peak_joints[beyond], atol=1e-12)
    held = motion.state_at(motion.hold_time)
    assert np.all(held.phase == Phase.HOLD)
    np.testing.assert_array_equal(held.joints, motion.hold_joints)


def test_unreachable_for_the_simulated_robot():
    with pytest.raises(UnsupportedDataError, match='cannot reach touch'):
        Trajectory(CELL, PAPER_ACTUAL.replace(l2=0.1), PLAN)
    with pytest.raises(UnsupportedDataError, match='no touch'):
        Trajectory(CELL, PAPER_ACTUAL, PLAN.select(np.zeros(len(PLAN), dtype=bool)))


@pytest.mark.parametrize(
    ('kind', 'wrong'),
    [
        *((Timing, wrong) for wrong in ({'hold': 0.0}, {'press': -1.0}, {'speed': np.inf})),
        *((SensorModel, wrong) for wrong in ({'joint_rate': 0.0}, {'force_noise': -1.0}, {'bias': (np.nan, 0.0)})),
    ],
)
def test_senseless_timing_and_sensors(kind, wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        kind(**wrong)


def test_stamps_are_irregular_and_increase():
    streams = simulate_streams(CELL, PAPER_ACTUAL, SMALL)
    for stamp, rate in ((streams.joints.stamp, 80.0), (streams.wrench.stamp, 98.0)):
        steps = 1e-9 * np.diff(stamp)
        assert stamp.dtype == np.int64
        assert stamp[0] >= START
        assert np.all(steps > 0)
        assert np.median(steps) == pytest.approx(1 / rate, rel=0.05)
        assert np.std(steps) > 0.05 / rate
        assert 2.0 / rate < steps.max() < 0.1
    assert not np.any(np.isin(streams.joints.stamp, streams.wrench.stamp))


def test_joints_at_rest_repeat_to_the_last_bit():
    streams = simulate_streams(CELL, PAPER_ACTUAL, SMALL)
    motion = Trajectory(CELL, PAPER_ACTUAL, SMALL)
    instant = motion.state_at(1e-9 * (streams.joints.stamp - START))
    held = streams.joints.position[(instant.phase == Phase.HOLD) & (instant.touch == 5)]
    assert len(held) > 30
    assert np.all(held == held[0])


def test_repeatability_is_the_noise_of_the_touches():
    errors = []
    exact = simulate_touches(CELL, PAPER_ACTUAL, PLAN, Noise(0.0, 0.0))
    for seed in range(6):
        noisy = simulate_touches(CELL, PAPER_ACTUAL, PLAN, seed=seed)
        errors.append(np.hstack([noisy.joints - exact.joints, noisy.force - exact.force]))
    scatter = np.concatenate(errors).std(axis=0)
    np.testing.assert_allclose(scatter, [1e-5, 1e-5, 0.3, 0.3], rtol=0.06)
