"""Least squares of the readings, and the combination of several estimates with a test of their consistency."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats

_ROUNDING = 1e-9
"""Share of the largest displacement below which residuals are rounding errors of the arithmetic."""
FALSE_ALARM_LEVEL = 0.01
"""p-value below which a difference is significant. Several tests of the same data share it (Bonferroni)."""


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    std: float


class LeastSquares(NamedTuple):
    """A least-squares fit y = X β + e.

    Attributes:
        beta: coefficients β, (k,).
        unscaled: (XᵀX)⁻¹, (k, k).
        basis: orthonormal basis of the columns of X, (n, k).
        residual: (n,), m.
        sigma: standard deviation of a reading, m; at least `floor`.
        floor: smallest standard deviation that the arithmetic or the resolution allows, m.
        dof: degrees of freedom.
    """

    beta: Floats
    unscaled: Floats
    basis: Floats
    residual: Floats
    sigma: float
    floor: float
    dof: int

    def of(self, row: Floats) -> Estimate:
        """A linear function of the coefficients, `row` (k,), with its standard deviation."""
        return Estimate(float(row @ self.beta), self.sigma * float(np.sqrt(row @ self.unscaled @ row)))


def least_squares(design: Floats, displacement: Floats) -> LeastSquares:
    """Least squares of one run.

    Args:
        design: X, (n, k).
        displacement: y, (n,), m.

    Raises:
        UnsupportedDataError: too few rows, or linearly dependent columns.
    """
    dof = len(displacement) - design.shape[1]
    if dof < 1:
        need = design.shape[1] + 1
        raise UnsupportedDataError(
            f'{len(displacement)} rows under load are too few, this run needs {need} or more',
            'take more loads in each sense',
        )
    scale = np.linalg.norm(design, axis=0)
    basis, triangle = np.linalg.qr(design / scale)
    if np.abs(np.diag(triangle)).min() < 1e-8:
        raise UnsupportedDataError('one sense of the load has a single level', 'take two or more loads in each sense')
    inverse = np.linalg.inv(triangle) / scale[:, None]
    beta = inverse @ (basis.T @ displacement)
    residual = displacement - basis @ (basis.T @ displacement)
    sigma = float(np.sqrt(residual @ residual / dof))
    floor = _ROUNDING * float(np.abs(displacement).max())
    return LeastSquares(beta, inverse @ inverse.T, basis, residual, max(sigma, floor), floor, dof)


def find_resolution(displacement: Floats) -> float:
    """Resolution of the gauge: the largest of 1, 2, 5 × 10ⁿ m of which all readings are multiples; 0 if below 10 nm."""
    for exponent in range(-3, -9, -1):
        for digit in (5, 2, 1):
            multiple = displacement / (digit * 10.0**exponent)
            if np.all(np.abs(multiple - np.round(multiple)) < 1e-5):
                return digit * 10.0**exponent
    return 0.0


class CombinedEstimate(NamedTuple):
    """Weighted mean of several estimates of one quantity, and a test of their consistency.

    Attributes:
        mean: weighted mean.
        std: of the mean; where the estimates are inconsistent the variance between them is included.
        chi_square: of the estimates about their mean.
        degrees_of_freedom: number of estimates less one.
        p_value: of consistency; takes into account that the standard deviations are estimates themselves.
        between: standard deviation between the estimates beyond their own (Paule and Mandel), m or m/N.
    """

    mean: float
    std: float
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    between: float


def between_variance(excess: Floats, std: Floats, dof: int) -> float:
    """The variance to be added for χ² of the deviations to equal its expectation (Paule and Mandel).

    Args:
        excess: deviations from the mean, (n,).
        std: standard deviation of each, (n,).
        dof: expected χ².

    Source: Paule and Mandel, J. Res. Nat. Bur. Standards 87 (1982) 377.
    """

    def surplus(variance: float) -> float:
        return float((excess**2 / (std**2 + variance)).sum()) - dof

    if surplus(0.0) <= 0:
        return 0.0
    return float(optimize.brentq(surplus, 0.0, float(excess @ excess) / dof, xtol=1e-40, rtol=1e-10))


def combine_estimates(values: Floats, std: Floats, dof: Floats | float, level: float = 0.01) -> CombinedEstimate:
    """Weighted mean and test of consistency of several estimates.

    Args:
        values: (n,), n of 2 or more.
        std: standard deviation of each, (n,).
        dof: degrees of freedom of each standard deviation, (n,), if each was estimated separately; a single number
            if all come from one common estimate; infinite if they are known.
        level: below this p-value the estimates are inconsistent, and the variance between them is added to their own.
    """
    count = len(values)
    weight = 1 / std**2
    mean = float(np.average(values, weights=weight))
    chi_square = float(weight @ (values - mean) ** 2)
    p_value = _p_value(chi_square, weight, dof)
    between = _between(values, std)
    if p_value < level:
        weight = 1 / (std**2 + between)
        mean = float(np.average(values, weights=weight))
    return CombinedEstimate(
        mean, float(1 / np.sqrt(weight.sum())), chi_square, count - 1, p_value, float(np.sqrt(between))
    )


def _p_value(chi_square: float, weight: Floats, dof: Floats | float) -> float:
    """p-value of consistency: F-test where the standard deviations have a common scale, else Welch's (1951) test."""
    count = len(weight)
    ratio = chi_square / (count - 1)
    if np.ndim(dof) == 0:
        return float(stats.f.sf(ratio, count - 1, dof) if np.isfinite(dof) else stats.chi2.sf(chi_square, count - 1))
    unevenness = float((((1 - weight / weight.sum()) ** 2) / dof).sum())
    ratio /= 1 + 2 * (count - 2) / (count**2 - 1) * unevenness
    return float(stats.f.sf(ratio, count - 1, (count**2 - 1) / (3 * unevenness)))


def _between(values: Floats, std: Floats) -> float:
    """Paule and Mandel's variance between, the mean weighted with it."""

    def surplus(variance: float) -> float:
        weight = 1 / (std**2 + variance)
        mean = np.average(values, weights=weight)
        return float(weight @ (values - mean) ** 2) - (len(values) - 1)

    if surplus(0.0) <= 0:
        return 0.0
    top = float(np.var(values, ddof=1)) * 4 + float(std.max()) ** 2
    return float(optimize.brentq(surplus, 0.0, top, xtol=1e-40, rtol=1e-10))
