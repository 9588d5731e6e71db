"""Gaussian knowledge of a state against the dense joint distribution, with random and singular covariances."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.gaussian.information import Gaussian, Information


@pytest.fixture
def scene():
    """Rows (20, 2, 5), residuals, a state of singular covariance, and the covariance of all residuals."""
    rng = np.random.default_rng(0)
    rows, residual, root = rng.normal(size=(20, 2, 5)), rng.normal(size=(20, 2)), rng.normal(size=(5, 3))
    known, flat = Gaussian(root @ rng.normal(size=3), root @ root.T), rows.reshape(40, 5)
    return rows, residual, known, np.eye(40) + flat @ known.covariance @ flat.T


def test_a_change_is_that_of_the_joint_distribution(scene):
    rows, residual, known, spread = scene
    flat, found = rows.reshape(40, 5), known.change(Information.of(rows, residual))
    np.testing.assert_allclose(found.matrix, flat.T @ np.linalg.solve(spread, flat), atol=1e-9)
    off = residual.ravel() - flat @ known.mean
    np.testing.assert_allclose(found.score, flat.T @ np.linalg.solve(spread, off), atol=1e-9)
    statistic, freedoms, change, std, size_std = found.ratio([1, 3])
    block = found.matrix[np.ix_([1, 3], [1, 3])]
    np.testing.assert_allclose(change, np.linalg.solve(block, found.score[[1, 3]]))
    np.testing.assert_allclose(statistic, found.score[[1, 3]] @ change)
    np.testing.assert_allclose(std**2, np.diag(np.linalg.inv(block)))
    along = change / np.linalg.norm(change)
    np.testing.assert_allclose(size_std**2, along @ np.linalg.inv(block) @ along)
    assert freedoms == 2
    assert found.largest_single(range(5)) == pytest.approx(max(found.ratio([k]).statistic for k in range(5)))


def test_a_change_beside_others(scene):
    rows, residual, known, _ = scene
    found = known.change(Information.of(rows, residual))
    free = found.beside(np.eye(5)[:, [0, 2, 4]])  # all others may have changed, too
    inverse = np.linalg.inv(found.matrix)
    np.testing.assert_allclose(free.ratio([1, 3]).std ** 2, np.diag(inverse)[[1, 3]])
    np.testing.assert_allclose(free.ratio([1, 3]).change, (inverse @ found.score)[[1, 3]])
    every = free.ratio(range(5))
    assert every.freedoms == 2 and (np.isnan(every.std) == [True, False, True, False, True]).all()


def test_distances_are_those_of_the_joint_distribution(scene):
    rows, residual, known, spread = scene
    off = residual.ravel() - rows.reshape(40, 5) @ known.mean
    assert known.chi_square(rows, residual) == pytest.approx(off @ np.linalg.solve(spread, off))
    own = [slice(2 * k, 2 * k + 2) for k in range(20)]
    each = [off[k] @ np.linalg.solve(spread[k, k], off[k]) for k in own]
    np.testing.assert_allclose(known.chi_squares(rows, residual), each)


def test_measurements_one_after_the_other_are_all_together(scene):
    rows, residual, known, spread = scene
    flat, one = rows.reshape(40, 5), known
    for row, measured in zip(rows, residual, strict=True):
        one = one.conditioned(row, measured - row @ one.mean)
    gain = known.covariance @ flat.T @ np.linalg.inv(spread)
    np.testing.assert_allclose(one.covariance, known.covariance - gain @ flat @ known.covariance, atol=1e-10)
    np.testing.assert_allclose(one.mean, known.mean + gain @ (residual.ravel() - flat @ known.mean), atol=1e-10)


def test_weights_and_fading(scene):
    rows, residual, *_ = scene
    weight = np.r_[np.full(8, 0.5), np.ones(12)]
    first, last = Information.of(rows[:8], residual[:8]), Information.of(rows[8:], residual[8:])
    for one, other in zip(Information.of(rows, residual, weight), first.plus(last, 0.5), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
