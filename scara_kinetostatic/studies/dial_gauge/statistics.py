"""Straight lines by least squares, and what a gauge's steps do to them.

Whether values agree within their standard deviations, and by how much they do not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from scara_kinetostatic.errors import UnsupportedDataError

Floats = NDArray[np.float64]

ROUNDING = 1e-9
"""Residuals below this part of the largest displacement are rounding."""


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    std: float


class Solution(NamedTuple):
    """Least squares: coefficients, (XᵀX)⁻¹, basis of the columns, residual, σ and its least, degrees of freedom."""

    beta: Floats
    unscaled: Floats
    basis: Floats
    residual: Floats
    sigma: float
    floor: float
    dof: int

    def of(self, row: Floats) -> Estimate:
        """A linear function of the coefficients."""
        return Estimate(float(row @ self.beta), self.sigma * float(np.sqrt(row @ self.unscaled @ row)))


def solve(design: Floats, moved: Floats) -> Solution:
    """Least squares of one run.

    Args:
        design: (n, k).
        moved: displacement, (n,), m.

    Raises:
        UnsupportedDataError: too few rows, or columns that cannot be told apart.
    """
    dof = len(moved) - design.shape[1]
    if dof < 1:
        need = design.shape[1] + 1
        raise UnsupportedDataError(
            f'{len(moved)} rows under load are too few, this run needs {need} or more', 'take more loads in each sense'
        )
    scale = np.linalg.norm(design, axis=0)
    basis, triangle = np.linalg.qr(design / scale)
    if np.abs(np.diag(triangle)).min() < 1e-8:
        raise UnsupportedDataError('one sense of the load has a single level', 'take two or more loads in each sense')
    inverse = np.linalg.inv(triangle) / scale[:, None]
    beta = inverse @ (basis.T @ moved)
    residual = moved - basis @ (basis.T @ moved)
    sigma = float(np.sqrt(residual @ residual / dof))
    floor = ROUNDING * float(np.abs(moved).max())
    return Solution(beta, inverse @ inverse.T, basis, residual, max(sigma, floor), floor, dof)


def find_step(displacement: Floats) -> float:
    """The largest of 1, 2, 5, 10, … × 10ⁿ m of which all readings are multiples; 0 if it is below 10 nm."""
    for exponent in range(-3, -9, -1):
        for digit in (5, 2, 1):
            multiple = displacement / (digit * 10.0**exponent)
            if np.all(np.abs(multiple - np.round(multiple)) < 1e-5):
                return digit * 10.0**exponent
    return 0.0


class Agreement(NamedTuple):
    """Whether several values are one and the same.

    Attributes:
        mean: weighted mean.
        std: of the mean; the variance between the values is in it where they do not agree.
        chi_square: of the values about their mean.
        degrees_of_freedom: values less one.
        p_value: that they agree; minds that the standard deviations are estimates themselves.
        between: standard deviation between the values beyond their own, m or m/N.
    """

    mean: float
    std: float
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    between: float


def between_variance(excess: Floats, std: Floats, dof: int) -> float:
    """The variance that has to be added for χ² of the deviations to be its expectation (Paule and Mandel).

    Args:
        excess: deviations from the mean, (n,).
        std: standard deviation of each, (n,).
        dof: expected χ².
    """

    def surplus(variance: float) -> float:
        return float((excess**2 / (std**2 + variance)).sum()) - dof

    if surplus(0.0) <= 0:
        return 0.0
    return float(optimize.brentq(surplus, 0.0, float(excess @ excess) / dof, xtol=1e-40, rtol=1e-10))


def agreement(values: Floats, std: Floats, dof: Floats | float, level: float = 0.01) -> Agreement:
    """Test and mean of several values.

    Args:
        values: (n,), n of 2 or more.
        std: standard deviation of each, (n,).
        dof: degrees of freedom of each standard deviation, (n,), if each was estimated by itself; a single number
            if all come from one common estimate; infinite if they are known.
        level: below this p-value the variance between is added to that of the mean.
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
    return Agreement(mean, float(1 / np.sqrt(weight.sum())), chi_square, count - 1, p_value, float(np.sqrt(between)))


def _p_value(chi_square: float, weight: Floats, dof: Floats | float) -> float:
    """That the values agree: F where the standard deviations have a common scale, else Welch's (1951) test."""
    count = len(weight)
    ratio = chi_square / (count - 1)
    if np.ndim(dof) == 0:
        return float(stats.f.sf(ratio, count - 1, dof) if np.isfinite(dof) else stats.chi2.sf(chi_square, count - 1))
    bend = float((((1 - weight / weight.sum()) ** 2) / dof).sum())
    ratio /= 1 + 2 * (count - 2) / (count**2 - 1) * bend
    return float(stats.f.sf(ratio, count - 1, (count**2 - 1) / (3 * bend)))


def _between(values: Floats, std: Floats) -> float:
    """Paule and Mandel's variance with the mean weighted anew."""

    def surplus(variance: float) -> float:
        weight = 1 / (std**2 + variance)
        mean = np.average(values, weights=weight)
        return float(weight @ (values - mean) ** 2) - (len(values) - 1)

    if surplus(0.0) <= 0:
        return 0.0
    top = float(np.var(values, ddof=1)) * 4 + float(std.max()) ** 2
    return float(optimize.brentq(surplus, 0.0, top, xtol=1e-40, rtol=1e-10))
