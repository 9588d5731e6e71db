"""Compliance or gap over the direction: a test of isotropy, and the ellipse with its principal values.

The compliance along u of the general gripper (7) is uᵀPu; the gap of an elliptical dead zone is √(uᵀWu). Both are even
functions of the direction with two orthogonal principal axes,

    q(φ) = major cos²(φ - axis) + minor sin²(φ - axis),     q the compliance, or the square of the gap.

A gauge along u measures the symmetric part of P only; displacements across u (p12 - p21) are not measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.statistics import CombinedEstimate, Estimate, combine_estimates

_FEWEST_AXES = 3
"""Axes needed for the three coefficients of an ellipse."""
_CLEAR = 4.0
"""Smallest gap, in standard deviations, whose square is used."""


class Ellipse(NamedTuple):
    """Principal values over the direction.

    Attributes:
        major: the largest.
        minor: the smallest.
        axis: direction of the largest, rad, in [0, π); its std is infinite where both are equal.
        chi_square: of the values about the ellipse.
        degrees_of_freedom: number of values less three.
        p_value: of the ellipse as a sufficient description; NaN without degrees of freedom.
        coefficients: m, a, b of q = m + a cos 2φ + b sin 2φ.
        covariance: of the coefficients, (3, 3).
        power: 1 if q is the value, 2 if it is the square.
    """

    major: Estimate
    minor: Estimate
    axis: Estimate
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    coefficients: Floats
    covariance: Floats
    power: int

    def at(self, direction: float) -> Estimate:
        """The value along a direction, rad."""
        row = np.array([1.0, np.cos(2 * direction), np.sin(2 * direction)])
        q, std = float(row @ self.coefficients), float(np.sqrt(row @ self.covariance @ row))
        return Estimate(q, std) if self.power == 1 else Estimate(float(np.sqrt(max(q, 0.0))), _root_std(q, std))


class DirectionMap(NamedTuple):
    """One quantity over the direction.

    Attributes:
        direction: rad, (n,).
        value: (n,).
        std: (n,).
        mean: unweighted mean over the directions, as in the paper.
        isotropy: test of equal values in all directions.
        ellipse: None for fewer than three axes, or where a gap is not significantly above 0.
    """

    direction: Floats
    value: Floats
    std: Floats
    mean: Estimate
    isotropy: CombinedEstimate
    ellipse: Ellipse | None


def direction_map(direction: Floats, value: Floats, std: Floats, dof: Floats, power: int) -> DirectionMap:
    """The map of one quantity.

    Args:
        direction: rad, (n,), n of 2 or more.
        value: (n,).
        std: (n,).
        dof: degrees of freedom of each std, (n,).
        power: 1 for a compliance, 2 for a gap.
    """
    mean = Estimate(float(value.mean()), float(np.sqrt((std**2).sum())) / len(value))
    ellipse = _fit_ellipse(direction, value, std, dof, power)
    return DirectionMap(direction, value, std, mean, combine_estimates(value, std, dof), ellipse)


def _fit_ellipse(direction: Floats, value: Floats, std: Floats, dof: Floats, power: int) -> Ellipse | None:
    """Principal values by weighted least squares; see `direction_map`, `Ellipse`."""
    axes = len(np.unique(np.round(np.mod(direction, np.pi), 3) % np.round(np.pi, 3)))
    if axes < _FEWEST_AXES or (power == 2 and np.any(value < _CLEAR * std)):
        return None
    q = value**power
    if power == 2:
        q = q - std**2  # the square of a noisy value is too large by its variance
    design = np.stack([np.ones_like(direction), np.cos(2 * direction), np.sin(2 * direction)], axis=1)
    q_std = std if power == 1 else 2 * value * std
    for _ in range(3):  # weights from the fitted values, which are less noisy than the measured ones
        coefficients, covariance = _weighted(design, q, q_std)
        fitted = design @ coefficients
        if power == 2:
            q_std = 2 * np.sqrt(np.maximum(fitted, (0.1 * value) ** 2)) * std
    chi_square = float((((q - fitted) / q_std) ** 2).sum())
    left = len(value) - 3
    p_value = float(stats.f.sf(chi_square / left, left, float(np.sum(dof)))) if left > 0 else np.nan
    ends = _principal(coefficients, covariance, power)
    return Ellipse(*ends, chi_square, left, p_value, coefficients, covariance, power)


def _weighted(design: Floats, q: Floats, std: Floats) -> tuple[Floats, Floats]:
    basis, triangle = np.linalg.qr(design / std[:, None])
    inverse = np.linalg.inv(triangle)
    return inverse @ (basis.T @ (q / std)), inverse @ inverse.T


def _principal(coefficients: Floats, covariance: Floats, power: int) -> tuple[Estimate, Estimate, Estimate]:
    mean, a, b = coefficients
    radius = float(np.hypot(a, b))
    unit = np.array([a, b]) / radius if radius > 0 else np.array([1.0, 0.0])
    ends = []
    for sign in (1.0, -1.0):
        row = np.array([1.0, *(sign * unit)])
        q, std = mean + sign * radius, float(np.sqrt(row @ covariance @ row))
        ends.append(Estimate(float(q), std) if power == 1 else Estimate(float(np.sqrt(max(q, 0.0))), _root_std(q, std)))
    across = np.array([0.0, -unit[1], unit[0]])
    turn = float(np.sqrt(across @ covariance @ across)) / (2 * radius) if radius > 0 else np.inf
    return ends[0], ends[1], Estimate(float(np.mod(np.arctan2(b, a) / 2, np.pi)), turn)


def _root_std(q: float, std: float) -> float:
    return std / (2 * float(np.sqrt(q))) if q > std else float(np.sqrt(std))
