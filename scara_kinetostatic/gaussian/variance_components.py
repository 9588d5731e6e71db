"""Variance components of a linear model by restricted likelihood (REML).

Columns may have the prior N(0, τ²), one τ for each group, and the noise two levels: both are estimated by restricted
likelihood, with what has no prior projected off: the sizes by Fisher scoring, the levels each by its sum of squares
over its redundancy (Förstner's step), which stays where the likelihood is stationary.

Sources: Patterson and Thompson, Biometrika 58 (1971) 545, and Harville, J. Am. Stat. Assoc. 72 (1977) 320; Koch,
Parameter Estimation and Hypothesis Testing in Linear Models (1999), section 3.6, for Förstner's step.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from scara_kinetostatic.gaussian.linear_model import Projected, blocks
from scara_kinetostatic.model.arrays import Floats, Indices

_LARGEST_STEP = 1.5
"""Of log τ."""
_STEPS = 12
"""Of Fisher scoring."""


def size_prior(logs: Floats, freedoms: Floats) -> tuple[float, Floats, Floats]:
    """-2 log density of the sizes in log τ, (g + 1,), and its first two derivatives by each log(τ_g / τ_0) and log τ_0.

    τ_g / τ_0 and τ_0 are half-t with scale 1 and degrees of freedom (g + 1,).
    """
    off = np.append(logs[:-1] - logs[-1], logs[-1])
    square = np.exp(2 * off)
    share, more = square / (freedoms + square), freedoms + 1
    value = more * np.log1p(square / freedoms) - 2 * off
    return float(value.sum()), 2 * more * share - 2, 4 * more * share * (1 - share)


def inverse_roots(part: Floats, levels: Floats) -> Floats:
    """L⁻¹ of each measurement, (n, d, d), with L Lᵀ the sum of a part of its variance, (n, d, d), and the rest of the
    identity, each multiplied by its level.
    """
    return np.linalg.inv(np.linalg.cholesky(levels[0] * part + levels[1] * (np.eye(part.shape[1]) - part)))


def at_levels(
    inverse: Floats, fitted: Floats, columns: Floats, residual: Floats, known: tuple[Floats, Floats]
) -> Projected:
    """The problem in the metric of noise levels, with rows of known values and their residuals behind, projected off J.

    Args:
        inverse: as of `inverse_roots`.
        fitted: J, (n d, b).
        columns: with a prior, (n d, c).
        residual: (n d,).
        known: rows of the fitted values, (p, b), and residuals, (p,).
    """
    every = np.concatenate([fitted, columns, residual[:, None]], axis=1)
    every = (inverse @ every.reshape(*inverse.shape[:2], -1)).reshape(every.shape)
    b = fitted.shape[1]
    behind = np.zeros((len(known[0]), every.shape[1]))
    behind[:, :b], behind[:, -1] = known
    every = np.concatenate([every, behind])
    return Projected.of(every[:, :b], every[:, b:])


def penalised(inner: Projected, weights: Floats) -> tuple[float, Floats, Floats]:
    """-2 log restricted likelihood, up to a constant, at sizes of the columns, (c,); the covariance of their values in
    these units, (c, c), and the values negated, (c,).
    """
    matrix = np.eye(len(weights)) + weights[:, None] * inner.gram * weights
    factor = linalg.cholesky(matrix, lower=True, check_finite=False)
    inverse = linalg.lapack.dpotri(factor, lower=1)[0] if len(factor) else factor
    inverse = inverse + np.tril(inverse, -1).T
    h = weights * inner.projected
    effects = inverse @ h
    return float(2 * np.log(np.diag(factor)).sum() + inner.square - h @ effects), inverse, effects


def posterior(inner: Projected, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """y, u and their covariance at sizes of the columns, (c,)."""
    _, inverse, effects = penalised(inner, weights)
    by_fitted = np.linalg.solve(inner.triangle, inner.of_columns * weights)
    y = -linalg.solve_triangular(inner.triangle, inner.of_residual, check_finite=False) + by_fitted @ effects
    root = linalg.solve_triangular(inner.triangle, np.eye(len(y)), check_finite=False)
    crossed = -by_fitted @ inverse
    return y, -effects, np.block([[root @ root.T - crossed @ by_fitted.T, crossed], [crossed.T, inverse]])


def weights_of(group: Indices, logs: Floats) -> Floats:
    """Sizes of columns of groups with log τ (g + 1,), (c,): 1 where the group is -1."""
    return np.where(group >= 0, np.exp(logs[group]), 1.0)


def estimate_sizes(
    inner: Projected, group: Indices, start: Floats, freedoms: Floats, *, held: bool = False
) -> tuple[Floats, Floats]:
    """Log τ of the groups and log τ_0, (g + 1,), and their variances, at given noise levels; `group` of each column.

    Where they are `held` they are those to begin with, and the variances those to be expected.
    """
    count = len(start) - 1
    member = (group[:, None] == np.arange(count)).astype(float)

    def value(logs: Floats) -> tuple[float, Floats, Floats]:
        deviance, inverse, effects = penalised(inner, weights_of(group, logs))
        return deviance + size_prior(logs, freedoms)[0], np.eye(len(inverse)) - inverse, effects

    logs, (lowest, part, effects) = start, value(start)
    for _ in range(_STEPS):
        _, slope, curve = size_prior(logs, freedoms)
        gradient = np.append(slope[:count], slope[-1] - slope[:-1].sum())
        hessian = np.diag(np.append(curve[:count], curve.sum()))
        hessian[-1, :-1] = hessian[:-1, -1] = -curve[:count]
        gradient[:-1] += 2 * member.T @ (np.diag(part) - effects**2)
        hessian[:-1, :-1] += 4 * member.T @ np.square(part) @ member
        if held:
            break
        step = -np.linalg.solve(hessian + 1e-3 * np.eye(count + 1), gradient)
        step *= min(1.0, _LARGEST_STEP / np.abs(step).max())
        for _ in range(5):
            tried = value(logs + step)
            if tried[0] <= lowest:
                break
            step = step / 3
        else:
            break
        decrease, logs, (lowest, part, effects) = lowest - tried[0], logs + step, tried
        if decrease < 0.01:
            break
    # the Hessian is that of -2 log likelihood, where the last step began
    return logs, 2 * np.diag(np.linalg.inv(hessian))


def estimate_levels(inner: Projected, inverse: Floats, part: Floats, levels: Floats, weights: Floats) -> Floats:
    """The noise levels after one step at given sizes, (2,), each multiplied by yᵀP V_k P y / tr(P V_k): where they stay
    the restricted likelihood is stationary. `inverse`, `part` and `levels` as of `inverse_roots`.
    """
    n, d = part.shape[:2]
    scaled = inner.columns * weights
    factor = np.linalg.cholesky(np.eye(len(weights)) + scaled.T @ scaled)
    rows = np.linalg.solve(factor, scaled.T).T
    rest = (inner.residual - rows @ (rows.T @ inner.residual))[: n * d].reshape(n, d)
    taken = np.concatenate([inner.base, rows], axis=1)[: n * d].reshape(n, d, -1)
    kept = np.eye(d) - blocks(taken)
    found = levels.copy()
    for k, one in enumerate((part, np.eye(d) - part)):
        whitened = levels[k] * inverse @ one @ inverse.swapaxes(1, 2)
        found[k] *= np.einsum('ni,nij,nj->', rest, whitened, rest) / np.einsum('nij,nji->', whitened, kept)
    return np.clip(found, 1e-4, 2.0)
