"""Rows of a linear model with errors of variance 1: what is left of them beside others, and what each decides.

With B an orthonormal basis of the fitted columns, the block of a measurement on the diagonal of the hat matrix is
H = B_k B_kᵀ; with C the covariance of the fit and J its rows, J C Jᵀ. Its larger eigenvalue is the **leverage**: at 1
no other measurement checks this one. A fit without the measurement would leave (I - H)⁻¹ of its residual.

Columns N of unknown errors e ~ N(0, I) are eliminated by M = (I + N Nᵀ)^(-1/2), columns without a prior by projection.

**Variance components.** Columns may have the prior N(0, τ²), one τ for each group, and the noise two levels: both are
estimated by restricted likelihood, with what has no prior projected off: the sizes by Fisher scoring, the levels each
by its sum of squares over its redundancy (Förstner's step), which stays where the likelihood is stationary.

Sources: Cook and Weisberg, Residuals and Influence in Regression (1982), chapter 2; Patterson and Thompson, Biometrika
58 (1971) 545, and Harville, J. Am. Stat. Assoc. 72 (1977) 320, for restricted likelihood; Koch, Parameter Estimation
and Hypothesis Testing in Linear Models (1999), section 3.6, for Förstner's step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.special import chdtrc, fdtrc, fdtri

from scara_kinetostatic.model.arrays import Floats, Indices, Mask

_NO_RANK = 1e-9
"""Part of a unit column below which a direction adds no rank."""
_LEAST_LEFT = 1e-6
"""Of I - H; less is that of a measurement which alone determines a value."""
_TINY = 1e-300
"""Keeps quotients finite."""


class Marginal(NamedTuple):
    """M = (I + N Nᵀ)^(-1/2): whitened rows, once more whitened for what unknown errors add to their covariance.

    Attributes:
        basis: orthonormal basis of the columns of N, (m, r).
        shrink: eigenvalues of M in it less 1, (r,).
    """

    basis: Floats
    shrink: Floats

    @classmethod
    def of(cls, columns: Floats | None, rows: int) -> Marginal:
        """M of N, (m, k), in units of the standard uncertainties; the identity where N is None."""
        if columns is None or not columns.shape[1]:
            return cls(np.zeros((rows, 0)), np.zeros(0))
        basis, singular, _ = np.linalg.svd(columns, full_matrices=False)
        return cls(basis, 1 / np.sqrt(1 + singular**2) - 1)

    @property
    def part(self) -> Floats:
        """Roots of the eigenvalues of I - M² in the basis, (r,)."""
        return np.asarray(np.sqrt(-self.shrink * (2 + self.shrink)))

    def apply(self, rows: Floats) -> Floats:
        """M times a vector (m,) or columns (m, k)."""
        if not self.shrink.size:
            return rows
        return np.asarray(rows + (self.basis * self.shrink) @ (self.basis.T @ rows))


class Projected(NamedTuple):
    """Columns and a residual less their projections on fitted columns J = Q R, which have no prior.

    Attributes:
        base: Q, (m, b).
        triangle: R, (b, b).
        columns: what is left of the columns, (m, c).
        residual: what is left of the residual, (m,).
        gram: inner products of these columns, (c, c).
        projected: those with the residual, (c,).
        of_columns: the columns along Q, (b, c).
        of_residual: the residual along it, (b,).
        square: that of what is left of the residual.
    """

    base: Floats
    triangle: Floats
    columns: Floats
    residual: Floats
    gram: Floats
    projected: Floats
    of_columns: Floats
    of_residual: Floats
    square: float

    @classmethod
    def of(cls, fitted: Floats, beside: Floats) -> Projected:
        """Of J, (m, b), and columns with the residual as the last, (m, c + 1)."""
        base, triangle = np.linalg.qr(fitted)
        along = base.T @ beside
        rest, c = beside - base @ along, beside.shape[1] - 1
        x, y = rest[:, :c], rest[:, c]
        return cls(base, triangle, x, y, x.T @ x, x.T @ y, along[:, :c], along[:, c], float(y @ y))


def orthonormal(columns: Floats) -> Floats:
    """Orthonormal basis of the space of columns (m, k), (m, ≤ k)."""
    scale = np.linalg.norm(columns, axis=0)
    u, values, _ = np.linalg.svd(columns[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(u[:, values > _NO_RANK])


def independent_part(
    base: Floats, columns: Floats, least: float, noise: Floats | None = None, most_noise: float = 1.0
) -> Floats:
    """Orthonormal basis of what columns add to a fit, (m, ≤ k).

    Args:
        base: orthonormal basis of the fit's columns, (m, r).
        columns: of what is added, (m, k).
        least: part of a unit column that must be independent of the fit.
        noise: their change by one standard deviation of the noise of what they depend on, (m, k); None for nothing.
        most_noise: share of its square up to which a direction may be made by that.
    """
    scale = inverse_sizes(np.square(columns).sum(axis=0))
    columns = columns * scale
    left, made = columns - base @ (base.T @ columns), None if noise is None else (noise * scale).T @ (noise * scale)
    square, vectors, independent = _directions(left.T @ left, least, made, most_noise)
    return np.asarray(left @ (vectors[:, independent] / np.sqrt(square[independent])))


class Additions(NamedTuple):
    """What groups of columns, as wide as each other, add to a fit by themselves.

    Attributes:
        explained: decrease of its sum of squares, (k,).
        rank: independent directions, (k,).
        part: largest part of a unit column that is independent of the fit, (k,).
    """

    explained: Floats
    rank: Indices
    part: Floats

    @classmethod
    def of(
        cls,
        gram: Floats,
        projected: Floats,
        square: Floats,
        least: float,
        made: Floats | None = None,
        most_noise: float = 1.0,
    ) -> Additions:
        """Of inner products of what is left of the columns beside the fit, (k, w, w), and of that with the residual,
        (k, w), and of the columns themselves, (k, w, w).

        `least` and `most_noise` as of `independent_part`; `made`: inner products of their changes by noise, (k, w, w).
        """
        scale = inverse_sizes(np.diagonal(square, axis1=1, axis2=2))
        both = scale[:, :, None] * scale[:, None, :]
        made = None if made is None else made * both
        values, vectors, independent = _directions(gram * both, least, made, most_noise)
        along = np.einsum('kij,ki->kj', vectors, projected * scale)
        explained = np.divide(along**2, values, out=np.zeros_like(values), where=independent)
        part = np.sqrt(np.clip(values.max(axis=1, initial=0.0), 0.0, 1.0))
        return cls(explained.sum(axis=1), independent.sum(axis=1), part)


def inverse_sizes(square: Floats) -> Floats:
    """Of columns by their squares; 0 of those that are 0."""
    return np.sqrt(np.divide(1.0, square, out=np.zeros_like(square), where=square > 0))


def _directions(gram: Floats, least: float, made: Floats | None, most_noise: float) -> tuple[Floats, Floats, Mask]:
    """Eigenvalues and eigenvectors of (..., w, w), and which of them are independent and not made by noise."""
    square, vectors = np.linalg.eigh(gram)
    independent = square > least**2
    if made is not None:
        independent &= (vectors * (made @ vectors)).sum(axis=-2) <= most_noise * square
    return square, vectors, independent


def f_test(
    explained: float, rank: int, total: float, rows: int, freedoms: int, least: float = 0.0
) -> tuple[float, float] | None:
    """p-value of "the columns explain nothing", and the part of the sum of squares that they explain; None if they add
    nothing testable.

    Args:
        explained: the decrease of the sum of squares.
        rank: of what they add to the fit.
        total: sum of squares of the fit.
        rows: of whitened measurements.
        freedoms: degrees of freedom without them.
        least: mean square that the residual has at least.
    """
    if rank == 0 or freedoms <= rank or total < 1e-8 * rows:  # whitened, less is rounding
        return None
    ratio = (explained / rank) / max((total - explained) / (freedoms - rank), least, _TINY)
    return float(fdtrc(rank, freedoms - rank, ratio)), explained / total


def p_values(chi_square: Floats | float, freedoms: int, noise_freedoms: float) -> Floats:
    """Probability of a larger chi-square by chance.

    Args:
        chi_square: one or several, any shape.
        freedoms: degrees of freedom of each; without any, 1 is returned.
        noise_freedoms: those of the noise; infinite where it is known, and the F distribution takes the place of χ².
    """
    if not freedoms:
        return np.ones(np.shape(chi_square))
    if np.isinf(noise_freedoms):
        return np.asarray(chdtrc(freedoms, chi_square))
    return np.asarray(fdtrc(freedoms, noise_freedoms, np.asarray(chi_square) / freedoms))


def as_rare(chi_square: float, freedoms: int, noise_freedoms: float) -> float:
    """What is exceeded as rarely as a chi-square where the noise is known; `noise_freedoms` as in `p_values`."""
    if np.isinf(noise_freedoms):
        return chi_square
    return float(freedoms * fdtri(freedoms, noise_freedoms, 1.0 - chdtrc(freedoms, chi_square)))


def blocks(rows: Floats, covariance: Floats | None = None) -> Floats:
    """J C Jᵀ of each measurement, (…, n, d, d), of rows (n, d, k) and a covariance (…, k, k); None for the identity."""
    moved = rows
    if covariance is not None:
        flat = rows.reshape(-1, rows.shape[-1]) @ covariance
        moved = flat.reshape(*flat.shape[:-2], *rows.shape)
    return np.asarray(moved @ rows.swapaxes(-1, -2))


def leverage(rows: Floats, covariance: Floats | None = None) -> Floats:
    """Leverage of each measurement, (n,); `rows` and `covariance` as of `blocks`, or an orthonormal basis and None."""
    return np.asarray(np.linalg.eigvalsh(blocks(rows, covariance))[:, -1])


def left_out(basis: Floats, residual: Floats) -> Floats:
    """Residuals (n, d), each as a fit without that measurement would leave it.

    Args:
        basis: orthonormal, of the fitted columns, (n, d, k).
        residual: of the fit, (n, d).
    """
    values, vectors = np.linalg.eigh(np.eye(residual.shape[1]) - blocks(basis))
    turned = (residual[:, None] @ vectors)[:, 0] / np.maximum(values, _LEAST_LEFT)
    return np.asarray((vectors @ turned[..., None])[..., 0])


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
