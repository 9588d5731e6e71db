"""Pure functions of one solver step: compression by QR, damped steps by SVD, robust weights.

The system J y = -r of 2n rows is first compressed to the triangle R of
its QR factorisation, block by block, so that memory stays bounded and JᵀJ is never
formed; the singular value decomposition of R then gives any damped step, the
covariance and the null space.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BLOCK = 16384
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


def compress(derivative: Floats, residual: Floats, weights: Floats | None = None) -> Compressed:
    """QR of [J, -r] in blocks of rows, then SVD of the triangle.

    Args:
        derivative: J, (n, 2, k).
        residual: r, (n, 2).
        weights: weight of each touch in the sum of squares, (n,); None for 1.
    """
    n, k = len(derivative), derivative.shape[2]
    triangles = []
    for start in range(0, n, BLOCK):
        part = slice(start, start + BLOCK)
        rows = np.concatenate([derivative[part], -residual[part, :, None]], axis=2)
        if weights is not None:
            rows *= np.sqrt(weights[part])[:, None, None]
        triangles.append(_triangle(rows.reshape(-1, k + 1)))
    triangle = triangles[0] if len(triangles) == 1 else _triangle(np.concatenate(triangles))
    u, values, vt = np.linalg.svd(triangle[:k, :k], full_matrices=False)
    return Compressed(u.T @ triangle[:k, k], values, vt.T)


def _triangle(rows: Floats) -> Floats:
    """R of a QR factorisation; square even if there are fewer rows than columns."""
    missing = rows.shape[1] - len(rows)
    if missing > 0:
        rows = np.concatenate([rows, np.zeros((missing, rows.shape[1]))])
    return np.asarray(np.linalg.qr(rows, mode='r'))


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
    return max(1.0, float(np.median(distance)) / MEDIAN_CHI2)


def robust_weights(distance: Floats, scale: float) -> Floats:
    """Cauchy weights 1 / (1 + d²/(c s)): far touches pull less the farther they are."""
    return 1 / (1 + distance / (CAUCHY * scale))


def robust_cost(distance: Floats, scale: float) -> float:
    """The sum whose minimum `robust_weights` seek: c s log(1 + d²/(c s))."""
    return float(CAUCHY * scale * np.log1p(distance / (CAUCHY * scale)).sum())
