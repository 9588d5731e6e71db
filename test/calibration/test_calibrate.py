"""The calibration as a whole, on simulated touches."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from calibration.studies import CELL, EXACT, NOISE, touches, z_scores

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.errors import InputError, ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import GripperSign, Noise, Sensor, SensorFrame
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters

ROBOTS = (PAPER_ACTUAL, PAPER_MEASURED)
UNKNOWN = replace(CELL, noise=None)
PRINTED = replace(CELL, gripper_sign=GripperSign.PAPER)
TOOL = replace(CELL, sensor=Sensor(frame=SensorFrame.TOOL))


@pytest.mark.parametrize(
    ('robot', 'cell'), [*product(ROBOTS, (CELL, UNKNOWN)), (PAPER_ACTUAL, PRINTED), (PAPER_ACTUAL, TOOL)]
)
def test_exact_touches_give_back_the_truth(robot, cell):
    found = calibrate(touches(robot, noise=EXACT, cell=cell), cell)
    np.testing.assert_allclose(found.parameters.as_array(), robot.as_array(), rtol=1e-6)
    assert (found.iterations <= 15, found.used.all(), found.termination) == (True, True, Termination.CONVERGED)
    assert found.force_error < 1e-9
    assert np.hypot(*found.nominal_residual.T).mean() > 10


def test_a_fit_whose_steps_lower_nothing_ends_early():
    """One radius is 5 mm off: no model of twelve parameters is near, and steps lead from one bad touch to the next."""
    first = CELL.discs[0]._replace(radius=CELL.discs[0].radius + 5e-3)
    found = calibrate(touches(PAPER_ACTUAL, cell=replace(CELL, discs=(first, *CELL.discs[1:]))), CELL)
    assert found.termination is Termination.STALLED
    assert found.iterations < 60


def test_a_warm_start_with_touches_that_the_stated_noise_leaves_out():
    """One touch presses with 0.5 N: without a stated noise it is rejected by the fit, with 0.3 N before it."""
    found = touches(PAPER_ACTUAL, noise=NOISE)
    force = found.force.copy()
    force[3] *= 0.5 / np.linalg.norm(force[3])
    found = replace(found, force=force)
    begin = calibrate(found, UNKNOWN)
    warm_start = WarmStart(begin.model, begin.noise, begin.used)
    again = calibrate(found, CELL, warm_start=warm_start)
    assert len(again.touches) == len(begin.touches) - 1 == len(found) - 1
    assert again.used.all()
    direct = calibrate(found, CELL)
    np.testing.assert_allclose(again.parameters.as_array(), direct.parameters.as_array(), atol=1e-7)


@pytest.mark.parametrize('robot', ROBOTS)
def test_touches_adjusted_from_a_fit_close_by_are_where_they_are_from_the_measured_ones(robot):
    fit = calibrate(touches(robot, noise=NOISE), CELL)
    assert np.isfinite(fit.projection.distance).all()
    moved = fit.model.with_array(fit.model.as_array() + 3 * fit.std)
    from_fit, anew = fit.changed(model=moved).projection, replace(fit, model=moved).projection
    np.testing.assert_allclose(from_fit.distance, anew.distance, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(from_fit.adjusted.joints, anew.adjusted.joints, atol=1e-8)


@pytest.mark.parametrize(('robot', 'cell'), [(PAPER_ACTUAL, CELL), (PAPER_MEASURED, UNKNOWN), (PAPER_ACTUAL, TOOL)])
def test_standard_deviations_are_right(robot, cell):
    scores, found = z_scores(robot, range(100, 120), cell=cell)
    assert 0.85 < np.sqrt((scores**2).mean()) < 1.15
    assert np.abs(scores).max() < 5
    assert abs(np.mean([c.reduced_chi_square for c in found]) - 1) < 0.1
    assert not any(c.rejected for c in found)


def test_noise_is_estimated():
    true = Noise(joint=2e-5, force=0.15)
    found = [calibrate(touches(PAPER_ACTUAL, seed, noise=true), UNKNOWN) for seed in range(6)]
    assert {c.noise_source for c in found} == {'estimated'}
    np.testing.assert_allclose(np.mean([c.noise[:2] for c in found], axis=0), true[:2], rtol=0.15)


def test_understated_noise_does_not_give_small_sigmas():
    worse = Noise(joint=3e-5, force=0.9)
    data = touches(PAPER_ACTUAL, 3, noise=worse)
    given, right = calibrate(data, CELL), calibrate(data, replace(CELL, noise=worse))
    assert given.reduced_chi_square > 5
    np.testing.assert_allclose(given.std, right.std, rtol=0.2)


def test_joints_that_were_homed_again_by_a_turn_are_the_same():
    made = touches(PAPER_ACTUAL, noise=NOISE)
    turns = np.where(np.arange(len(made))[:, None] < 10, [1, -1], [0, 1])
    one, other = calibrate(made, CELL), calibrate(made.replace(joints=made.joints + 2 * np.pi * turns), CELL)
    np.testing.assert_allclose(other.parameters.as_array(), one.parameters.as_array(), rtol=0, atol=1e-9)
    assert other.used.all() == one.used.all()


def test_starts_far_off_reach_the_same_optimum():
    data = touches(PAPER_ACTUAL, 5)
    reference = calibrate(data, CELL)
    rng = np.random.default_rng(0)
    for _ in range(4):
        x = PAPER_ACTUAL.as_array() + rng.uniform(-1, 1, 12) * ([0.02, 0.02, 0.0524, 0.02, 0.0524, 0.02] + [0] * 6)
        x[6:9] *= 5 ** rng.uniform(-1, 1, 3)
        x[9:] = rng.uniform(0, 5e-4, 3)
        found = calibrate(data, replace(CELL, nominal=Parameters.from_array(x)))
        assert np.abs((found.parameters.as_array() - reference.parameters.as_array()) / reference.std).max() < 1e-3


def test_one_force_level_ties_gripper_compliance_and_backlash():
    for robot in ROBOTS:
        found = calibrate(touches(robot, levels=(40.0,)), UNKNOWN)
        assert found.identifiability.confounded == (('p_ee', 'g_ee'),)
        assert found.base_rank == 11
    for seed in range(2):
        found = calibrate(touches(PAPER_ACTUAL, seed, levels=(40.0,), postures=(1,)), CELL)
        known = found.identifiability
        assert (known.rank, known.confounded) == (11, (('p_ee', 'g_ee'),))
        assert found.status['p_ee'] == found.status['g_ee'] == 'confounded'
        assert np.isnan(found.std_of('p_ee')) and 'force' in known.advice
        (combination,) = known.combinations
        assert combination.text.startswith('g_ee + ')
        truth = PAPER_ACTUAL.g_ee + float(combination.text.split()[2]) * PAPER_ACTUAL.p_ee
        assert abs(combination.value - truth) < 4 * combination.std
        z = (found.parameters.as_array() - PAPER_ACTUAL.as_array()) / found.std
        assert np.nanmax(np.abs(z)) < 5 and np.isfinite(z).sum() == 10


def test_one_disc_ties_the_lengths_together():
    data = touches(PAPER_ACTUAL, 1)
    found = calibrate(data.select(data.disc == 0), CELL)
    assert found.identifiability.rank == 11 and found.force_error < 1.0
    assert {'l1', 'l2'} <= set(found.identifiability.confounded[0])


def test_bad_touches_are_rejected_by_index_and_the_rest_is_unharmed():
    for seed in range(3):
        data, rng = touches(PAPER_ACTUAL, seed), np.random.default_rng(seed)
        bad = np.sort(rng.choice(len(data), 7, replace=False))
        force, joints = data.force.copy(), data.joints.copy()
        force[bad[:2]] += 8 * rng.choice([-1, 1], (2, 2))
        force[bad[2]] *= 1.5
        joints[bad[3:]] += 2e-3 * rng.choice([-1, 1], (4, 2))
        found = calibrate(data.replace(force=force, joints=joints), CELL)
        assert [item.index for item in found.rejected] == bad.tolist()
        assert found.used.sum() + len(found.rejected) == len(data)
        assert all('standard deviations' in item.reason for item in found.rejected)
        assert np.abs((found.parameters.as_array() - PAPER_ACTUAL.as_array()) / found.std).max() < 5


def test_a_wrong_disc_is_structure_and_not_a_third_of_the_touches_bad():
    moved = replace(CELL, discs=(CELL.discs[0]._replace(radius=0.151), *CELL.discs[1:]))
    found = calibrate(touches(PAPER_ACTUAL, 2), moved)
    assert found.used.all() and found.reduced_chi_square > 5


def test_fixed_parameters_stay():
    found = calibrate(touches(PAPER_ACTUAL, 1), CELL, fixed={'x0': PAPER_ACTUAL.x0, 'p1': PAPER_ACTUAL.p1})
    assert (found.parameters.x0, found.parameters.p1) == (PAPER_ACTUAL.x0, PAPER_ACTUAL.p1)
    assert (found.status['p1'], found.std_of('p1'), found.identifiability.rank) == ('fixed', 0, 10)


def alike():
    """One touch, again and again."""
    same, rng = touches(PAPER_ACTUAL).select(np.zeros(36, dtype=int)), np.random.default_rng(0)
    joints, force = (rng.normal(size=(36, 2)) * level for level in NOISE[:2])
    return same.replace(joints=same.joints + joints, force=same.force + force)


@pytest.mark.parametrize(
    ('data', 'error', 'words'),
    [
        (touches(PAPER_ACTUAL).select(np.arange(6)), UnsupportedDataError, '6 touches'),
        (alike(), UnsupportedDataError, 'alike'),
        (touches(PAPER_ACTUAL, 2, levels=(0.1, 0.2, 0.4)), UnsupportedDataError, 'parameters'),
        (touches(PAPER_ACTUAL).replace(disc=np.full(72, 5)), ParameterError, 'disc'),
    ],
)
def test_touches_that_support_nothing(data, error, words):
    with pytest.raises(error, match=words):
        calibrate(data, CELL)


@pytest.mark.parametrize(
    ('fixed', 'words'),
    [
        ({'p3': 1.0}, "'p3'"),
        (PAPER_ACTUAL.as_dict(), 'all twelve'),
        ({'l1': -0.3}, 'l1'),
        ({'l1': np.nan}, 'l1: expected a finite number, got nan'),
        ({'l1': 330.0}, 'l1=330: is 330 m from its nominal value; give it in m, not in mm'),
    ],
)
def test_senselessly_fixed(fixed, words):
    with pytest.raises(ParameterError, match=words):
        calibrate(touches(PAPER_ACTUAL), CELL, fixed=fixed)


@pytest.mark.parametrize(('cell', 'other'), [(CELL, TOOL), (TOOL, CELL)])
def test_a_wrong_sign_or_frame_is_refused(cell, other):
    data = touches(PAPER_ACTUAL, cell=cell)
    half = data.force * np.where(np.arange(len(data)) % 2, 1, -1)[:, None]
    for given, wrong in ((data, other), (data.replace(force=-data.force), cell), (data.replace(force=half), cell)):
        with pytest.raises(InputError, match='do not point from the tip to the discs'):
            calibrate(given, wrong)


def test_held_out_error_is_a_little_above_the_fitted_one():
    found = calibrate(touches(PAPER_ACTUAL, 4), CELL)
    held_out = held_out_force_error(found)
    assert held_out.folds == 5
    assert found.force_error < held_out.force_error < 1.5 * found.force_error


def test_a_noise_that_does_not_show_is_not_taken_for_none():
    """With soft joints and gripper the force error hides that of the joints."""
    for seed in range(3):
        noise = calibrate(touches(PAPER_MEASURED, seed, levels=(10.0, 25.0), postures=(1,)), UNKNOWN).noise
        assert 2e-6 < noise.joint < 5e-5 and 0.15 < noise.force < 0.5


def test_faint_touches_and_repeated_readings_are_left_out_by_name():
    data = touches(PAPER_ACTUAL, 1)
    force = data.force.copy()
    force[3], force[4] = 0.0, [0.5, 0.2]
    again = data.replace(force=force).select(np.r_[np.arange(72), 10])
    again = again.replace(index=np.arange(73))
    found = calibrate(again, CELL)
    assert [item.index for item in found.rejected] == [3, 4, 72]
    assert 'same reading as touch 10' in found.rejected[2].reason
    assert '0.54 N' in found.rejected[1].reason


def test_many_touches_settle_though_some_lie_at_the_edge_of_a_dead_band():
    for seed in range(2):
        found = calibrate(touches(PAPER_MEASURED, seed, per_disc=36), CELL)
        assert found.termination is Termination.CONVERGED and found.iterations < 80


def few_of_one_disc(seed):
    data = touches(PAPER_MEASURED, seed, levels=(40.0,))
    return PAPER_MEASURED, data.select(data.disc == seed % 3), UNKNOWN


def few_of_all(seed):
    chosen = np.random.default_rng(seed).permutation(72)[:9]
    return PAPER_ACTUAL, touches(PAPER_ACTUAL, seed).select(chosen), CELL


@pytest.mark.parametrize(('few', 'seeds'), [(few_of_one_disc, 3), (few_of_all, 8)])
def test_few_touches_do_not_bend_what_is_called_estimated(few, seeds):
    for seed in range(seeds):
        robot, data, cell = few(seed)
        found = calibrate(data, cell)
        z = (found.parameters.as_array() - robot.as_array()) / found.std
        assert np.nanmax(np.abs(z), initial=0.0) < 5
