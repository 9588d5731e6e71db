"""Linear least squares as the solver needs it: compression by QR, damped steps and covariance by SVD, robust loss.

The system J y = -r of 2n rows is compressed to the triangle R of its QR factorisation, so that JᵀJ is never formed; the
singular value decomposition of R gives any damped step, the covariance and the null space.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from scara_kinetostatic.model.arrays import Floats, Mask

_CAUCHY = 6.0
"""Squared distance, in units of the typical one, at which a touch's weight is halved."""


class Compressed(NamedTuple):
    """A least-squares system after QR and SVD: all that further steps need.

    Attributes:
        left: Uᵀ Qᵀ (-r), (k,).
        values: singular values, (k,), largest first.
        right: V, (k, k), by columns.
    """

    left: Floats
    values: Floats
    right: Floats


def compress(
    derivative: Floats,
    residual: Floats,
    weights: Floats | None = None,
    basis: Floats | None = None,
    prior: Floats | None = None,
) -> Compressed:
    """QR of [J, -r], then SVD of the triangle.

    Args:
        derivative: J, (n, 2, k).
        residual: r, (n, 2).
        weights: weight of each touch in the sum of squares, (n,); None for 1.
        basis: (k, m), to use J basis instead of J; None for the identity.
        prior: rows [J, -r] of what is known besides, (p, k + 1); None for nothing.

    Raises:
        LinAlgError: J is not finite.
    """
    n, _, k = derivative.shape
    rows = np.empty((k + 1, 2, n))  # transposed: in the order in which LAPACK takes it without a copy
    rows[:k], rows[k] = derivative.transpose(2, 1, 0), -residual.T
    if weights is not None:
        rows *= np.sqrt(weights)
        rows[:, :, weights == 0] = 0.0  # not finite, it may be without weight
    triangle = upper_triangle(rows.reshape(k + 1, -1).T, overwrite=True)
    if prior is not None:
        triangle = upper_triangle(np.concatenate([triangle, prior]))
    system = triangle[:k, :k] if basis is None else triangle[:k, :k] @ basis
    u, values, vt, trouble = lapack.dgesvd(system, full_matrices=False)
    if trouble:
        raise np.linalg.LinAlgError('the singular value decomposition does not converge')
    return Compressed(u.T @ triangle[:k, k], values, vt.T)


def upper_triangle(rows: Floats, overwrite: bool = False) -> Floats:
    """R of a QR factorisation of rows (m, k), (k, k); square even if there are fewer rows than columns."""
    m, k = rows.shape
    if m < k:
        rows = np.concatenate([rows, np.zeros((k - m, k))])
    return np.asarray(lapack.dgeqrf(rows, overwrite_a=overwrite)[0][:k] * _upper(k))


@cache
def _upper(k: int) -> Floats:
    return np.triu(np.ones((k, k)))


def _significant(system: Compressed) -> Mask:
    # smaller ones are zero but for rounding
    return np.asarray(system.values > 1e-11 * system.values[:1])


def damped_step(system: Compressed, damping: float) -> Floats:
    """The Levenberg–Marquardt step argmin ‖J y + r‖² + damping ‖y‖²; of least norm where J is singular.

    Args:
        system: the compressed system.
        damping: 0 for the Gauss–Newton step.

    Returns:
        y, (k,).
    """
    s, significant = system.values, _significant(system)
    gain = np.divide(s, s * s + damping, out=np.zeros_like(s), where=significant)
    return system.right @ (gain * system.left)


def covariance(system: Compressed, least: float = 0.0) -> Floats:
    """(JᵀJ)⁺, (k, k), without the directions whose singular value is below `least`."""
    s, significant = system.values, _significant(system) & (system.values >= least)
    root = system.right * np.divide(1.0, s, out=np.zeros_like(s), where=significant)
    return root @ root.T


def typical_scale(distance: Floats) -> float:
    """Scale of the squared distances (n,): their median over that of chi-square, 1 at least."""
    half = len(distance) // 2
    middle = np.partition(distance, [(len(distance) - 1) // 2, half])
    # the median of chi-square with 2 degrees of freedom is 2 ln 2
    return max(1.0, float(middle[(len(distance) - 1) // 2] + middle[half]) / 2 / (2 * np.log(2)))


def robust_weights(distance: Floats, scale: float) -> Floats:
    """Weights of Cauchy's loss, 1 / (1 + d²/(c s)), for squared distances d², (n,), and their scale s."""
    return 1 / (1 + distance / (_CAUCHY * scale))


def robust_cost(distance: Floats, scale: float) -> float:
    """Cauchy's loss, the sum of c s log(1 + d²/(c s)); see `robust_weights`."""
    return float(_CAUCHY * scale * np.log1p(distance / (_CAUCHY * scale)).sum())
