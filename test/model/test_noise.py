"""Noise per axis and noise that grows with the force: its covariance, what the fit makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL, Noise, Sensor, SensorFrame, force_covariance
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

BY_AXIS = Noise((1e-5, 4e-5), (0.6, 0.15), 0.01)


def test_covariance_of_the_force_is_the_turned_one_of_the_axes():
    force = np.random.default_rng(0).normal(0, 30, (50, 2))
    along, crossed, across = force_covariance(BY_AXIS, force)
    for f, found in zip(force, np.stack([along, crossed, crossed, across], axis=1).reshape(-1, 2, 2), strict=True):
        x, y = f / np.hypot(*f)
        turn = np.array([[x, -y], [y, x]])  # columns: along, across
        own = np.diag(np.square(BY_AXIS.force_levels)) + 0.01**2 * (f @ f) * np.eye(2)
        np.testing.assert_allclose(found, turn.T @ own @ turn, rtol=1e-12)


@pytest.mark.parametrize('frame', SensorFrame)
def test_simulated_errors_are_those_of_the_axes_of_the_sensor(frame):
    cell = replace(PAPER_CELL, sensor=Sensor(frame=frame), noise=BY_AXIS)
    plan = default_plan(cell, 300)
    exact, noisy = (simulate_touches(cell, PAPER_ACTUAL, plan, noise) for noise in (Noise(0, 0), BY_AXIS))
    errors, size = noisy.force - exact.force, np.hypot(*exact.force.T)
    for axis, level in enumerate(BY_AXIS.force_levels):
        assert np.std(errors[:, axis] / np.hypot(level, 0.01 * size)) == pytest.approx(1, abs=0.1)
    assert np.std(noisy.joints - exact.joints, axis=0) == pytest.approx(BY_AXIS.joint_levels, rel=0.1)


@pytest.mark.parametrize('frame', SensorFrame)
def test_fit_with_stated_noise_by_axis_is_weighted_by_it(frame):
    cell = replace(PAPER_CELL, sensor=Sensor(frame=frame), noise=BY_AXIS)
    plain = replace(cell, noise=Noise(BY_AXIS.joint_rms, BY_AXIS.force_rms))
    plan, z, better = default_plan(cell, 12), [], []
    for seed in range(8):
        data = simulate_touches(cell, PAPER_ACTUAL, plan, BY_AXIS, seed)
        found = calibrate(data, cell)
        assert (found.noise, found.noise_source) == (BY_AXIS, 'given')
        z.append((found.parameters.as_array() - PAPER_ACTUAL.as_array()) / found.std)
        better.append(found.std / calibrate(data, plain).std)
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.3)
    assert np.median(better) < 0.96


@pytest.mark.parametrize(
    'noise', [Noise((1e-5, 0.0), 0.3), Noise(1e-5, (0.3, -0.1)), Noise(1e-5, 0.3, -0.01), Noise((1e-5,), 0.3)]
)
def test_impossible_noise_is_refused(noise):
    with pytest.raises(ParameterError, match='noise'):
        replace(PAPER_CELL, noise=noise)


def test_levels_given_as_lists_are_pairs():
    cell = replace(PAPER_CELL, noise=Noise([1e-5, 2e-5], np.array([0.3, 0.2])))
    assert cell.noise == Noise((1e-5, 2e-5), (0.3, 0.2))
