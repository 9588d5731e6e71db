"""Least squares of the readings, and the combination of several estimates with a test of their consistency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats

FALSE_ALARM_LEVEL = 0.01
"""p-value below which a difference is significant. Several tests of the same data share it (Bonferroni)."""


class Estimate(NamedTuple):
    """A value with its standard deviation, in an SI unit."""

    value: float
    std: float
    unit: str = ''

    def over(self, divisor: float, unit: str = '') -> Estimate:
        """Divided by a number above 0, which may change the unit; a gap over 2 is the g of (6) and (7)."""
        return Estimate(self.value / divisor, self.std / divisor, unit or self.unit)

    def plus(self, value: float, std: float) -> Estimate:
        """With an independent quantity of the same unit added."""
        return self._replace(value=self.value + value, std=float(np.hypot(self.std, std)))


def mean(estimates: Sequence[Estimate]) -> Estimate:
    """The unweighted mean of independent estimates."""
    values, std, units = zip(*estimates, strict=True)
    return Estimate(float(np.mean(values)), float(np.linalg.norm(std)) / len(values), units[0])


class LeastSquares(NamedTuple):
    """A least-squares fit y = X β + e.

    Attributes:
        beta: coefficients β, (k,).
        unscaled: (XᵀX)⁻¹, (k, k).
        basis: orthonormal basis of the columns of X, (n, k).
        residual: (n,).
        sigma: standard deviation of y; at least `floor`.
        floor: smallest standard deviation that the arithmetic or the resolution allows.
        dof: degrees of freedom.
    """

    beta: Floats
    unscaled: Floats
    basis: Floats
    residual: Floats
    sigma: float
    floor: float
    dof: int

    def of(self, row: Floats, unit: str) -> Estimate:
        """A linear function of the coefficients, `row` (k,), with its standard deviation."""
        return Estimate(float(row @ self.beta), self.sigma * float(np.sqrt(row @ self.unscaled @ row)), unit)


def least_squares(design: Floats, values: Floats) -> LeastSquares:
    """Least squares of values y, (n,), with a design X, (n, k).

    Raises:
        UnsupportedDataError: linearly dependent columns.
    """
    scale, dof = np.linalg.norm(design, axis=0), len(values) - design.shape[1]
    basis, triangle = np.linalg.qr(design / scale)
    if np.abs(np.diag(triangle)).min() < 1e-8:
        raise UnsupportedDataError('one sense of the load has a single level', 'take two or more loads in each sense')
    inverse, along = np.linalg.inv(triangle) / scale[:, None], basis.T @ values
    residual = values - basis @ along
    floor = 1e-9 * float(np.abs(values).max())  # below it residuals are rounding errors of the arithmetic
    sigma = max(float(np.sqrt(residual @ residual / max(dof, 1))), floor)
    return LeastSquares(inverse @ along, inverse @ inverse.T, basis, residual, sigma, floor, dof)


def find_resolution(displacement: Floats) -> float:
    """Resolution of the gauge: the largest of 1, 2, 5 × 10ⁿ m of which all readings are multiples; 0 if below 10 nm."""
    for step in (digit * 10.0**exponent for exponent in range(-3, -9, -1) for digit in (5, 2, 1)):
        if np.all(np.abs(displacement / step - np.round(displacement / step)) < 1e-5):
            return step
    return 0.0


class CombinedEstimate(NamedTuple):
    """Weighted mean of several estimates of one quantity, and a test of their consistency.

    Attributes:
        value: weighted mean.
        std: of the mean; where the estimates are inconsistent the variance between them is included.
        chi_square: of the estimates about their mean.
        degrees_of_freedom: number of estimates less one.
        p_value: of consistency; takes into account that the standard deviations are estimates themselves.
        between_std: standard deviation between the estimates beyond their own (Paule and Mandel).
        unit: of value and standard deviations.
        definitional_uncertainty: what the choice of a definition adds, common to all estimates; NaN where none is.
    """

    value: float
    std: float
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    between_std: float
    unit: str
    definitional_uncertainty: float = float('nan')

    @property
    def estimate(self) -> Estimate:
        """The mean with its standard deviation."""
        return Estimate(self.value, self.std, self.unit)


def _between_variance(values: Floats, std: Floats) -> float:
    """The variance to be added to those of estimates for χ² to equal its expectation.

    Source: Paule and Mandel, J. Res. Nat. Bur. Standards 87 (1982) 377.
    """

    def surplus(variance: float) -> float:
        weight = 1 / (std**2 + variance)
        return float(weight @ (values - np.average(values, weights=weight)) ** 2) - (len(values) - 1)

    if surplus(0.0) <= 0:
        return 0.0
    return float(optimize.brentq(surplus, 0.0, float(values.var(ddof=1)), xtol=1e-40, rtol=1e-12))


def combine_estimates(estimates: Sequence[Estimate], dof: Floats | float) -> CombinedEstimate:
    """Weighted mean and test of consistency of several estimates.

    The test is an F-test where the standard deviations have a common scale, else that of Welch (1951). Estimates are
    inconsistent below a p-value of 1 %; then the variance between them is added to their own.

    Args:
        estimates: n of 2 or more.
        dof: degrees of freedom of each standard deviation, (n,), if each was estimated separately; a single number
            if all come from one common estimate.
    """
    values, std = (np.array([each[k] for each in estimates]) for k in (0, 1))
    count, weight = len(values), 1 / std**2
    centre = float(np.average(values, weights=weight))
    chi_square = float(weight @ (values - centre) ** 2)
    ratio, denominator = chi_square / (count - 1), dof
    if np.ndim(dof):
        unevenness = float((((1 - weight / weight.sum()) ** 2) / dof).sum())
        ratio /= 1 + 2 * (count - 2) / (count**2 - 1) * unevenness
        denominator = (count**2 - 1) / (3 * unevenness)
    p_value = float(stats.f.sf(ratio, count - 1, denominator))
    between = _between_variance(values, std)
    if p_value < FALSE_ALARM_LEVEL:
        weight = 1 / (std**2 + between)
        centre = float(np.average(values, weights=weight))
    mean_std, unit = float(1 / np.sqrt(weight.sum())), estimates[0].unit
    return CombinedEstimate(centre, mean_std, chi_square, count - 1, p_value, float(np.sqrt(between)), unit)
