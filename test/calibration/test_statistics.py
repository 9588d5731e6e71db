"""The benchmark of the calibration as an estimator: its simulations, figures and targets."""

from __future__ import annotations

import numpy as np
import pytest

from benchmark.common import CELL, NOISE, ROBOTS
from benchmark.statistics.bound import linear
from benchmark.statistics.runs import Task, run_noise, setup_of
from benchmark.statistics.summary import noise_summary
from scara_kinetostatic.calibration.calibrate import calibrate


@pytest.fixture(scope='module')
def noise_runs():
    return run_noise(Task('noise', 'table 2', 'given', 12, range(100)))


@pytest.mark.parametrize('robot', list(ROBOTS))
def test_the_bound_is_the_covariance_that_exact_touches_give(robot):
    setup = setup_of(robot, 12)
    assert len(setup.plan) == 72
    assert np.abs(linear(CELL, setup.truth, setup.exact).misclosure).max() < 1e-12
    found = calibrate(setup.exact, CELL)
    scale = np.outer(setup.bound.std, setup.bound.std)
    np.testing.assert_allclose(found.covariance / scale, setup.bound.covariance / scale, atol=1e-8)


def test_the_ideal_estimate_attains_the_bound_and_lies_beside_the_real_one(noise_runs):
    setup = setup_of('table 2', 12)
    gain = setup.bound.gain * [NOISE.joint, NOISE.joint, NOISE.force, NOISE.force]
    attained = np.einsum('knj,lnj->kl', gain, gain)
    np.testing.assert_allclose(np.diag(attained), np.diag(setup.bound.covariance), rtol=1e-9)
    apart = np.array([(run.error - run.ideal) / setup.bound.std for run in noise_runs])
    assert np.sqrt((apart**2).mean()) < 0.1


def test_efficiency_and_coverage(noise_runs):
    found = noise_summary(noise_runs, setup_of('table 2', 12))
    assert found['runs'] == 100
    assert all(0.97 < ratio < 1.03 for ratio in found['variance_over_ideal_of_same_noise'].values())
    assert all(0.6 < ratio < 1.5 for ratio in found['variance_over_bound'].values())
    assert 0.93 < found['coverage']['normal']['pooled'] < 0.97
    assert 0.94 < found['coverage']['normal_of_same_noise']['pooled'] < 0.96
