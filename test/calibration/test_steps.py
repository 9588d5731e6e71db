"""The pure functions of a step."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration import steps


def system(seed=0, n=40, k=5):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 2, k)), rng.normal(size=(n, 2))


def test_undamped_step_is_least_squares():
    jacobian, residual = system()
    step = steps.damped_step(steps.compress(jacobian, residual), 0.0)
    expected = np.linalg.lstsq(jacobian.reshape(-1, 5), -residual.ravel(), rcond=None)[0]
    np.testing.assert_allclose(step, expected, rtol=1e-12)


def test_damped_step_is_the_augmented_system():
    jacobian, residual = system()
    step = steps.damped_step(steps.compress(jacobian, residual), 0.7)
    augmented = np.concatenate([jacobian.reshape(-1, 5), np.sqrt(0.7) * np.eye(5)])
    expected = np.linalg.lstsq(augmented, np.concatenate([-residual.ravel(), np.zeros(5)]), rcond=None)[0]
    np.testing.assert_allclose(step, expected, rtol=1e-12)


def test_blocks_of_rows_change_nothing(monkeypatch):
    jacobian, residual = system(n=100)
    whole = steps.compress(jacobian, residual)
    monkeypatch.setattr(steps, 'BLOCK', 7)
    parts = steps.compress(jacobian, residual)
    np.testing.assert_allclose(parts.values, whole.values, rtol=1e-12)
    np.testing.assert_allclose(steps.damped_step(parts, 0.0), steps.damped_step(whole, 0.0), rtol=1e-12)


def test_singular_system_takes_the_shortest_step():
    jacobian, residual = system()
    jacobian[:, :, 4] = 2 * jacobian[:, :, 3]
    compressed = steps.compress(jacobian, residual)
    step = steps.damped_step(compressed, 0.0)
    np.testing.assert_allclose(step[4], 2 * step[3], rtol=1e-9)
    assert np.isfinite(steps.covariance(compressed)).all()


def test_weights_act_on_squares():
    jacobian, residual = system()
    weights = np.ones(40)
    weights[::2] = 0.0
    step = steps.damped_step(steps.compress(jacobian, residual, weights), 0.0)
    half = steps.damped_step(steps.compress(jacobian[1::2], residual[1::2]), 0.0)
    np.testing.assert_allclose(step, half, rtol=1e-12)
