"""Rows of a linear model with errors of variance 1: what is left of them beside others, and what each decides.

With B an orthonormal basis of the fitted columns, the block of a measurement on the diagonal of the hat matrix is
H = B_k B_kᵀ; with C the covariance of the fit and J its rows, J C Jᵀ. Its larger eigenvalue is the **leverage**: at 1
no other measurement checks this one. A fit without the measurement would leave (I - H)⁻¹ of its residual.

Columns N of unknown errors e ~ N(0, I) are eliminated by M = (I + N Nᵀ)^(-1/2), columns without a prior by projection.

Source: Cook and Weisberg, Residuals and Influence in Regression (1982), chapter 2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask

_NO_RANK = 1e-9
"""Part of a unit column below which a direction adds no rank."""
_LEAST_LEFT = 1e-6
"""Of I - H; less is that of a measurement which alone determines a value."""


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
        explained: decrease of its sum of squares, of each.
        rank: independent directions of each.
        part: largest part of a unit column of each that is independent of the fit.
    """

    explained: list[float]
    rank: list[int]
    part: list[float]

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
        part = np.sqrt(np.minimum(values.max(axis=1, initial=0.0), 1.0))
        return cls(explained.sum(axis=1).tolist(), independent.sum(axis=1).tolist(), part.tolist())


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
