"""What is left of rows beside others, tests and leverages, against dense linear algebra with random matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from scara_kinetostatic.gaussian.linear_model import (
    Additions,
    Marginal,
    Projected,
    blocks,
    independent_part,
    left_out,
    leverage,
    orthonormal,
)
from scara_kinetostatic.gaussian.p_values import as_rare, f_test, p_values


def test_rows_are_whitened_for_unknown_errors():
    columns, rows = np.random.default_rng(2).standard_normal((9, 3)), np.arange(9.0)
    m = Marginal.of(columns, 9).apply(np.eye(9))
    np.testing.assert_allclose(m @ (np.eye(9) + columns @ columns.T) @ m.T, np.eye(9), atol=1e-12)
    assert Marginal.of(None, 9).apply(rows) is rows


def test_what_is_left_is_orthogonal_to_the_fitted_columns():
    rng = np.random.default_rng(3)
    fitted, columns, residual = rng.normal(size=(30, 4)), rng.normal(size=(30, 3)), rng.normal(size=30)
    found = Projected.of(fitted, np.column_stack([columns, residual]))
    off = np.eye(30) - fitted @ np.linalg.pinv(fitted)
    np.testing.assert_allclose(found.columns, off @ columns, atol=1e-12)
    np.testing.assert_allclose(found.gram, columns.T @ off @ columns, atol=1e-12)
    np.testing.assert_allclose(found.projected, columns.T @ off @ residual, atol=1e-12)
    np.testing.assert_allclose(found.square, residual @ off @ residual)
    np.testing.assert_allclose(found.base @ found.triangle, fitted, atol=1e-12)
    np.testing.assert_allclose(np.linalg.solve(found.triangle, found.of_residual), np.linalg.pinv(fitted) @ residual)


def test_a_basis_has_the_rank_of_its_columns():
    columns = np.random.default_rng(4).normal(size=(12, 3)) * [1.0, 1e-8, 1e6]
    every = np.column_stack([columns, columns @ [1.0, 2e8, 0.0], np.zeros(12)])
    basis = orthonormal(every)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(basis @ (basis.T @ columns), columns, rtol=1e-7)
    assert orthonormal(columns[:, 1:2]).shape == (12, 1)


def test_a_direction_counts_where_it_is_independent_and_not_made_by_noise():
    base, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(20, 6)))
    fit, columns = base[:, :2], base[:, [0, 2, 3]] @ np.array([[1.0, 0, 1], [0.1, 0, 0], [0, 5, 0]])
    assert independent_part(fit, columns, 0.05).shape == (20, 2)
    assert independent_part(fit, columns, 0.2).shape == (20, 1)
    noise = np.zeros_like(columns)
    noise[:, 0] = 0.08 * base[:, 5]
    assert independent_part(fit, columns, 0.05, noise).shape == (20, 2)
    assert independent_part(fit, columns, 0.05, noise, 0.5).shape == (20, 1)
    assert independent_part(fit, 0 * columns, 0.05).shape == (20, 0)


@pytest.mark.parametrize('noise', [0.0, 0.08])
def test_what_columns_add_is_what_their_independent_directions_explain(noise):
    random = np.random.default_rng(6)
    base = np.linalg.qr(random.normal(size=(20, 4)))[0]
    columns, residual = random.normal(size=(2, 20, 3)), random.normal(size=20)
    columns[1, :, 2] = columns[1] @ [1.0, 0.5, 0.0] + base @ random.normal(size=4)  # two directions
    changed = noise * random.normal(size=columns.shape)
    left = columns - base @ (base.T @ columns)
    y = residual - base @ (base.T @ residual)
    inner = [x.transpose(0, 2, 1) @ x for x in (left, columns, changed)]
    found = Additions.of(inner[0], left.transpose(0, 2, 1) @ y, inner[1], 0.05, inner[2], 0.01)
    for own, more, explained, rank in zip(columns, changed, found.explained, found.rank, strict=True):
        unit = independent_part(base, own, 0.05, more, 0.01)
        assert unit.shape[1] == rank
        assert explained == pytest.approx(np.square(unit.T @ y).sum())
    scaled = np.linalg.norm(left, axis=1) / np.linalg.norm(columns, axis=1)
    assert ((found.part >= scaled.max(axis=1)) & (np.array(found.part) <= 1)).all()
    assert (found.rank == [3, 2]) == (noise == 0.0)


def test_f_test_is_that_of_the_textbook():
    """Against a regression by hand: two columns, beside three that are in the fit already."""
    rng = np.random.default_rng(4)
    design, values = rng.normal(size=(40, 5)), rng.normal(size=40)
    values += 0.4 * design[:, 4]
    base, _ = np.linalg.qr(design[:, :3])
    residual = values - base @ (base.T @ values)
    before = float(residual @ residual)
    after = np.linalg.lstsq(design, values, rcond=None)[1][0]
    expected = stats.f.sf((before - after) / 2 / (after / 35), 2, 35)
    assert f_test(before - after, 2, before, 40, 37) == pytest.approx((expected, 1 - after / before))
    assert f_test(0.0, 0, before, 40, 37) is None
    assert f_test(before - after, 2, before, 40, 2) is None
    assert f_test(0.0, 2, 0.0, 40, 37) is None
    expected = stats.f.sf((before - after) / 2 / 4.0, 2, 35)  # where the noise is known to be larger
    assert f_test(before - after, 2, before, 40, 37, 4.0) == pytest.approx((expected, 1 - after / before))


def test_chi_square_is_that_of_known_or_estimated_noise():
    assert p_values(7.0, 3, np.inf) == pytest.approx(stats.chi2.sf(7.0, 3))
    assert p_values(7.0, 3, 12.0) == pytest.approx(stats.f.sf(7.0 / 3, 3, 12))
    assert (p_values(np.ones(2), 0, 12.0) == 1).all()
    assert as_rare(20.0, 1, np.inf) == 20.0
    assert p_values(as_rare(20.0, 1, 50.0), 1, 50.0) == pytest.approx(stats.chi2.sf(20.0, 1))


def test_leverages_and_residuals_without_a_measurement_are_those_of_refits():
    rng = np.random.default_rng(6)
    rows, values = rng.normal(size=(15, 2, 4)), rng.normal(size=(15, 2))
    flat = rows.reshape(30, 4)
    covariance = np.linalg.inv(flat.T @ flat)
    hat = flat @ covariance @ flat.T
    own = [np.linalg.eigvalsh(hat[2 * k : 2 * k + 2, 2 * k : 2 * k + 2])[-1] for k in range(15)]
    basis = np.linalg.qr(flat)[0].reshape(15, 2, 4)
    np.testing.assert_allclose(leverage(rows, covariance), own)
    np.testing.assert_allclose(leverage(basis), own)
    both = blocks(rows, np.array([covariance, 2 * covariance]))
    np.testing.assert_allclose(both, [blocks(basis), 2 * blocks(basis)], atol=1e-12)
    residual = (values.ravel() - hat @ values.ravel()).reshape(15, 2)
    for k, found in enumerate(left_out(basis, residual)):
        kept = np.arange(15) != k
        fit = np.linalg.lstsq(rows[kept].reshape(28, 4), values[kept].ravel(), rcond=None)[0]
        np.testing.assert_allclose(found, values[k] - rows[k] @ fit, rtol=1e-9)
