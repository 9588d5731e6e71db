"""Tests of one run against its model: straight lines with one gap.

Each test has its own p-value. Where the cycles scatter more than the readings within them (p < `_SCATTER_LEVEL`), the
variance between the cycles is added to that of the result.

- slope_difference: slope of the positive less that of the negative sense;
- hysteresis: displacement while the load is removed less that while it is applied, at the same load;
- curvature: deviation of the lines from their chords, positive where the displacement grows faster than the load;
- zero_drift: drift of the gauge's zero per cycle; if it is steady, half of it is contained in the gap;
- gap_repeatability, slope_repeatability: standard deviation between the cycles beyond that of the readings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate, LeastSquares, between_variance

Ints = NDArray[np.int64]

_SCATTER_LEVEL = 0.01


class Check(NamedTuple):
    """One test of a run.

    Attributes:
        name: see the module.
        value: estimate of the deviation.
        std: its standard deviation; NaN for the repeatabilities.
        unit: m or m/N.
        p_value: of no deviation.
    """

    name: str
    value: float
    std: float
    unit: str
    p_value: float


def slope_difference(solution: LeastSquares, count: int) -> Check:
    """Whether both senses have the same slope; `count` is the number of passes."""
    row = np.zeros(count + 2)
    row[count:] = (-1.0, 1.0)
    return _student('slope_difference', solution.of(row), 'm/N', solution.dof)


def _student(name: str, estimate: Estimate, unit: str, dof: int) -> Check:
    p_value = 2 * float(stats.t.sf(abs(estimate.value) / estimate.std, dof))
    return Check(name, estimate.value, estimate.std, unit, p_value)


def shapes(
    solution: LeastSquares, readings: DialGaugeReadings, used: NDArray[np.bool_], passes: Ints
) -> list[Check | None]:
    """Hysteresis and curvature, each tested by one additional column; None where the run does not determine it."""
    force = readings.force[used]
    sense = np.sign(force)
    branch = np.zeros(len(force))
    for number in np.unique(passes[used]):
        rows = np.flatnonzero(passes[used] == number)
        size = np.abs(force[rows])
        top = np.flatnonzero(size >= size.max() * (1 - 1e-6))
        branch[rows[: top[0]]], branch[rows[top[-1] + 1 :]] = -0.5, 0.5
    span = float(np.ptp(np.abs(force)))
    both = np.any(branch < 0) and np.any(branch > 0)
    return [
        _added(solution, 'hysteresis', sense * branch, 1.0) if both else None,
        _added(solution, 'curvature', sense * force**2, span**2 / 4),
    ]


def _added(solution: LeastSquares, name: str, column: Floats, factor: float) -> Check | None:
    """Coefficient of one additional column, times a factor; None where the run does not determine it."""
    dof = solution.dof - 1
    new = column - solution.basis @ (solution.basis.T @ column)
    square = float(new @ new)
    if dof < 1 or square < 1e-8 * float(column @ column):
        return None
    value = float(new @ solution.residual) / square
    rest = solution.residual - value * new
    sigma = max(float(np.sqrt(rest @ rest / dof)), solution.floor)
    return _student(name, Estimate(factor * value, factor * sigma / float(np.sqrt(square))), 'm', dof)


def zero_drift(solution: LeastSquares, cycle: Ints, complete: Ints, count: int) -> list[Check]:
    """Drift of the mean of both lines with the number of the cycle."""
    if len(complete) < 2:
        return []
    order = np.arange(len(complete)) - (len(complete) - 1) / 2
    row = np.zeros(count + 2)
    for place, number in zip(order, complete, strict=True):
        row[:count] += np.where(cycle == number, place / 2, 0.0) / float(order @ order)
    return [_student('zero_drift', solution.of(row), 'm', solution.dof)]


def gap_repeatability(solution: LeastSquares, contrasts: Floats, rows: Ints) -> tuple[list[Check], float]:
    """Whether the gap is the same in every cycle, and the variance between cycles if it is not.

    Args:
        solution: of the run.
        contrasts: the gap of each cycle as a linear function of the coefficients, (c, k).
        rows: number of rows of each pass, (k,).
    """
    dof = len(contrasts) - 1
    if dof < 1:
        return [], 0.0
    steps = np.diff(contrasts, axis=0)
    change = steps @ solution.beta
    square = float(change @ np.linalg.solve(steps @ solution.unscaled @ steps.T, change))
    p_value = float(stats.f.sf(square / dof / solution.sigma**2, dof, solution.dof))
    gaps = contrasts @ solution.beta
    own = solution.sigma * np.sqrt((contrasts[:, : len(rows)] ** 2) @ (1 / rows))  # the slopes' part is common to all
    variance = between_variance(gaps - gaps.mean(), own, dof)
    check = Check('gap_repeatability', float(np.sqrt(variance)), np.nan, 'm', p_value)
    return [check], variance if p_value < _SCATTER_LEVEL else 0.0


def slope_repeatability(
    solution: LeastSquares, force: Floats, displacement: Floats, passes: Ints, sense: Ints
) -> tuple[list[Check], float]:
    """Whether the slope is the same in every pass of a sense, and the variance between passes if it is not."""
    slopes, factors = _pass_slopes(force, displacement, passes, len(sense))
    known = np.isfinite(factors)
    dof = int(known.sum()) - 2
    if dof < 1:
        return [], 0.0
    excess = (slopes - np.where(sense > 0, solution.beta[-1], solution.beta[-2]))[known]
    own = solution.sigma * factors[known]
    p_value = float(stats.f.sf(float(((excess / own) ** 2).sum()) / dof, dof, solution.dof))
    variance = between_variance(excess, own, dof)
    check = Check('slope_repeatability', float(np.sqrt(variance)), np.nan, 'm/N', p_value)
    return [check], variance if p_value < _SCATTER_LEVEL else 0.0


def _pass_slopes(force: Floats, displacement: Floats, passes: Ints, count: int) -> tuple[Floats, Floats]:
    """Slope of each pass alone, and its standard deviation for σ = 1; NaN for a pass with a single load."""
    slopes, factors = np.full(count, np.nan), np.full(count, np.nan)
    for number in range(count):
        x, y = force[passes == number], displacement[passes == number]
        squares = float(((x - x.mean()) ** 2).sum())
        if squares > 1e-12 * float(x @ x):
            slopes[number] = float((x - x.mean()) @ y) / squares
            factors[number] = 1 / np.sqrt(squares)
    return slopes, factors


def row_p_values(solution: LeastSquares) -> Floats:
    """p-value of each row from its externally studentised residual, (n,); 1 with too few degrees of freedom."""
    if solution.dof < 3:
        return np.ones(len(solution.residual))
    free = np.maximum(1 - (solution.basis**2).sum(axis=1), 1e-12)
    standard = solution.residual / solution.sigma / np.sqrt(free)
    left = np.maximum(solution.dof - standard**2, 1e-12)
    student = standard * np.sqrt((solution.dof - 1) / left)
    return 2 * stats.t.sf(np.abs(student), solution.dof - 1)
