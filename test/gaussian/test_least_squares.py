"""Linear least squares of a step, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.gaussian import least_squares


def system(seed=0, n=40, k=5):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 2, k)), rng.normal(size=(n, 2))


@pytest.mark.parametrize('damping', [0.0, 0.7])
def test_a_step_is_that_of_the_augmented_system(damping):
    jacobian, residual = system()
    step = least_squares.damped_step(least_squares.compress(jacobian, residual), damping)
    augmented = np.concatenate([jacobian.reshape(-1, 5), np.sqrt(damping) * np.eye(5)])
    expected = np.linalg.lstsq(augmented, np.concatenate([-residual.ravel(), np.zeros(5)]), rcond=None)[0]
    np.testing.assert_allclose(step, expected, rtol=1e-12)


def test_singular_system_takes_the_shortest_step():
    jacobian, residual = system()
    jacobian[:, :, 4] = 2 * jacobian[:, :, 3]
    compressed = least_squares.compress(jacobian, residual)
    step = least_squares.damped_step(compressed, 0.0)
    np.testing.assert_allclose(step[4], 2 * step[3], rtol=1e-9)
    assert np.isfinite(least_squares.covariance(compressed)).all()


def test_weights_act_on_squares():
    jacobian, residual = system()
    weights = np.ones(40)
    weights[::2] = 0.0
    step = least_squares.damped_step(least_squares.compress(jacobian, residual, weights), 0.0)
    half = least_squares.damped_step(least_squares.compress(jacobian[1::2], residual[1::2]), 0.0)
    np.testing.assert_allclose(step, half, rtol=1e-12)
