"""Sizes of random effects and noise levels against the dense restricted likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize
from scipy.linalg import lstsq

from scara_kinetostatic.gaussian.variance_components import (
    at_levels,
    estimate_levels,
    estimate_sizes,
    inverse_roots,
    penalised,
    posterior,
    size_prior,
    weights_of,
)

N, GROUP = 30, np.array([0, 0, 0, 1, 1, -1])
PART = np.tile(np.diag([1.0, 0.0]), (N, 1, 1))


def drawn(seed=0):
    """Fitted columns, columns with a prior, a residual with sizes 2, 0.5 and 1, and a known value."""
    rng = np.random.default_rng(seed)
    fitted, columns = rng.normal(size=(2 * N, 3)), rng.normal(size=(2 * N, 6))
    residual = columns @ (np.array([2, 2, 2, 0.5, 0.5, 1]) * rng.normal(size=6)) + rng.normal(size=2 * N)
    return fitted, columns, residual, (np.array([[0.0, 3.0, 0.0]]), np.array([0.2]))


def dense(fitted, columns, residual, known, levels, weights):
    """-2 log restricted likelihood but for 2 log |det| of what does not depend on sizes, and the estimate by V."""
    variance = np.kron(np.eye(N), np.diag(levels)) + (columns * weights**2) @ columns.T
    variance = np.block([[variance, np.zeros((2 * N, 1))], [np.zeros((1, 2 * N)), np.eye(1)]])
    rows, values = np.concatenate([fitted, known[0]]), np.concatenate([residual, known[1]])
    inverse = np.linalg.inv(variance)
    information = rows.T @ inverse @ rows
    y = np.linalg.solve(information, rows.T @ inverse @ values)
    left = values - rows @ y
    value = np.linalg.slogdet(variance)[1] + np.linalg.slogdet(information)[1] + left @ inverse @ left
    return value, -y, np.linalg.inv(information), -weights * (columns.T @ (inverse @ left)[: 2 * N])


def test_the_likelihood_and_the_estimate_are_those_of_the_dense_covariance():
    fitted, columns, residual, known = drawn()
    levels = np.array([1.5, 0.7])
    inner = at_levels(inverse_roots(PART, levels), fitted, columns, residual, known)
    values = []
    for weights in (np.full(6, 0.3), np.array([2, 2, 2, 0.5, 0.5, 1.0])):
        expected, y, covariance, u = dense(fitted, columns, residual, known, levels, weights)
        values.append((penalised(inner, weights)[0], expected))
        found = posterior(inner, weights)
        np.testing.assert_allclose(found[0], y, atol=1e-10)
        np.testing.assert_allclose(found[1], u, atol=1e-10)
        np.testing.assert_allclose(found[2][:3, :3], covariance, atol=1e-10)
    np.testing.assert_allclose(np.diff(values, axis=0)[0][0], np.diff(values, axis=0)[0][1], rtol=1e-9)
    left = lstsq(np.concatenate([fitted, known[0]]), np.concatenate([residual, known[1]]))[1]
    unit = at_levels(inverse_roots(PART, np.ones(2)), fitted, columns, residual, known)
    assert penalised(unit, np.zeros(6))[0] == pytest.approx(float(left))  # without columns the sum of squares


def test_sizes_are_the_likeliest():
    fitted, columns, residual, known = drawn()
    inner, freedoms = at_levels(inverse_roots(PART, np.ones(2)), fitted, columns, residual, known), np.full(3, 4.0)
    logs, variance = estimate_sizes(inner, GROUP, np.zeros(3), freedoms)

    def deviance(at):
        return penalised(inner, weights_of(GROUP, at))[0] + size_prior(at, freedoms)[0]

    best = optimize.minimize(deviance, np.zeros(3), method='Nelder-Mead', options={'xatol': 1e-6, 'fatol': 1e-9})
    assert deviance(logs) < best.fun + 0.02 and (variance > 0).all()
    held, _ = estimate_sizes(inner, GROUP, np.ones(3), freedoms, held=True)
    np.testing.assert_array_equal(held, 1.0)


def test_noise_levels_become_the_likeliest():
    fitted, columns, residual, known = drawn(3)
    residual *= 0.8
    weights, levels = weights_of(GROUP, np.log([2.0, 0.5, 1.0])), np.ones(2)
    for _ in range(200):
        inverse = inverse_roots(PART, levels)
        inner = at_levels(inverse, fitted, columns, residual, known)
        levels = estimate_levels(inner, inverse, PART, levels, weights)
    best = optimize.minimize(
        lambda at: dense(fitted, columns, residual, known, np.exp(at), weights)[0], np.zeros(2), method='Nelder-Mead'
    )
    np.testing.assert_allclose(levels, np.exp(best.x), rtol=1e-3)
