"""Whether values agree within their standard deviations, and by how much they do not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Floats = NDArray[np.float64]


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
