"""Pure functions of one solver step: compression by QR, damped steps by SVD, robust weights.

The system J y = -r of 2n rows is first compressed to the triangle R of
its QR factorisation, block by block, so that memory stays bounded and JᵀJ is never
formed; the singular value decomposition of R then gives any damped step, the
covariance and the null space.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Floats = NDArray[np.float64]

BLOCK = 4096
RANK_TOLERANCE = 1e-11
CAUCHY = 6.0
"""Squared distance, in units of the typical one, at which a touch's weight is halved."""
MEDIAN_CHI2 = 2 * np.log(2)
"""Median of chi-square with 2 degrees of freedom."""


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
    derivative: Floats, residual: Floats, weights: Floats | None = None, basis: Floats | None = None
) -> Compressed:
    """QR of [J, -r] in blocks of rows, then SVD of the triangle.

    Args:
        derivative: J, (n, 2, k).
        residual: r, (n, 2).
        weights: weight of each touch in the sum of squares, (n,); None for 1.
        basis: (k, m), what stands for J is then J basis; None for the identity.

    Raises:
        LinAlgError: J is not finite.
    """
    n, k = len(derivative), derivative.shape[2]
    roots = None if weights is None else np.sqrt(weights)
    triangles = []
    for start in range(0, n, BLOCK):
        part = slice(start, start + BLOCK)
        triangles.append(_triangle(derivative[part], residual[part], None if roots is None else roots[part]))
    triangle = triangles[0] if len(triangles) == 1 else upper_triangle(np.concatenate(triangles))
    system = triangle[:k, :k] if basis is None else triangle[:k, :k] @ basis
    u, values, vt, trouble = lapack.dgesvd(system, full_matrices=False)
    if trouble:
        raise np.linalg.LinAlgError('the singular values do not converge')
    return Compressed(u.T @ triangle[:k, k], values, vt.T)


def _triangle(derivative: Floats, residual: Floats, roots: Floats | None) -> Floats:
    """R of the QR factorisation of the rows [J, -r], each touch's times its root, (k + 1, k + 1)."""
    n, _, k = derivative.shape
    rows = np.empty((k + 1, 2, n))  # transposed: in the order in which LAPACK takes it without a copy
    rows[:k], rows[k] = derivative.transpose(2, 1, 0), -residual.T
    if roots is not None:
        rows *= roots
    return upper_triangle(rows.reshape(k + 1, 2 * n).T, overwrite=True)


def upper_triangle(rows: Floats, overwrite: bool = False) -> Floats:
    """R of a QR factorisation of rows (m, k), (k, k); square even if there are fewer rows than columns."""
    m, k = rows.shape
    if m < k:
        rows = np.concatenate([rows, np.zeros((k - m, k))])
    return np.asarray(lapack.dgeqrf(rows, overwrite_a=overwrite)[0][:k] * _upper(k))


@cache
def _upper(k: int) -> Floats:
    return np.triu(np.ones((k, k)))


def _seen(system: Compressed) -> NDArray[np.bool_]:
    return np.asarray(system.values > RANK_TOLERANCE * max(system.values.max(initial=0.0), np.finfo(float).tiny))


def damped_step(system: Compressed, damping: float) -> Floats:
    """The Levenberg–Marquardt step argmin ‖J y + r‖² + damping ‖y‖²; of least norm where J is singular.

    Args:
        system: the compressed system.
        damping: 0 for the Gauss–Newton step.

    Returns:
        y, (k,).
    """
    s, seen = system.values, _seen(system)
    gain = np.where(seen, s / np.where(seen, s * s + damping, 1.0), 0.0)
    return system.right @ (gain * system.left)


def predicted_shift(system: Compressed, step: Floats) -> float:
    """‖J y‖: by how many standard deviations a step moves the predictions, all touches together."""
    return float(np.linalg.norm(system.values * (system.right.T @ step)))


def covariance(system: Compressed, least: float = 0.0) -> Floats:
    """(JᵀJ)⁺, (k, k), without the directions whose singular value is below `least`."""
    s, seen = system.values, _seen(system) & (system.values >= least)
    root = system.right * np.where(seen, 1 / np.where(seen, s, 1.0), 0.0)
    return root @ root.T


def typical_scale(distance: Floats) -> float:
    """How far the bulk of touches is off: median squared distance over its expectation, 1 or more."""
    half = len(distance) // 2
    middle = np.partition(distance, [(len(distance) - 1) // 2, half])
    return max(1.0, float(middle[(len(distance) - 1) // 2] + middle[half]) / 2 / MEDIAN_CHI2)


def robust_weights(distance: Floats, scale: float) -> Floats:
    """Cauchy weights 1 / (1 + d²/(c s)): far touches pull less the farther they are."""
    return 1 / (1 + distance / (CAUCHY * scale))


def robust_cost(distance: Floats, scale: float) -> float:
    """The sum whose minimum `robust_weights` seek: c s log(1 + d²/(c s))."""
    return float(CAUCHY * scale * np.log1p(distance / (CAUCHY * scale)).sum())
