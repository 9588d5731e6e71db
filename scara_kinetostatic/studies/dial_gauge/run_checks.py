"""Questions put to one run of a gauge experiment: does it obey straight lines with one gap.

Each is a test with its own p-value. Where the cycles scatter more than the readings within them
(p < `SCATTER_LEVEL`), the standard deviation is that of the cycles: the variance between them is added.

- senses: slope of the positive minus that of the negative sense;
- hysteresis: how much further the part is displaced while the load is removed than while it is applied;
- curvature: bow of the lines, positive where the deflection grows faster than the load;
- zero_drift: how far the gauge's zero moves from cycle to cycle; if it moves steadily, half of that is in the gap;
- gap_repeats, slope_repeats: scatter between cycles, the value being the standard deviation between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate, Solution, between_variance

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SCATTER_LEVEL = 0.01


class Check(NamedTuple):
    """One question put to a run.

    Attributes:
        name: see the module.
        value: size of the effect.
        std: its standard deviation; NaN for the repeats.
        unit: m or m/N.
        p_value: of no effect.
    """

    name: str
    value: float
    std: float
    unit: str
    p_value: float


def senses(solution: Solution, count: int) -> Check:
    """Whether both senses have the same slope; `count` is the number of passes."""
    row = np.zeros(count + 2)
    row[count:] = (-1.0, 1.0)
    return _student('senses', solution.of(row), 'm/N', solution.dof)


def _student(name: str, estimate: Estimate, unit: str, dof: int) -> Check:
    p_value = 2 * float(stats.t.sf(abs(estimate.value) / estimate.std, dof))
    return Check(name, estimate.value, estimate.std, unit, p_value)


def shapes(
    solution: Solution, readings: DialGaugeReadings, used: NDArray[np.bool_], passes: Ints
) -> list[Check | None]:
    """Hysteresis and curvature: each one column more."""
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


def _added(solution: Solution, name: str, column: Floats, factor: float) -> Check | None:
    """The coefficient of one more column, times a factor; None where the run cannot tell it."""
    dof = solution.dof - 1
    new = column - solution.basis @ (solution.basis.T @ column)
    square = float(new @ new)
    if dof < 1 or square < 1e-8 * float(column @ column):
        return None
    value = float(new @ solution.residual) / square
    rest = solution.residual - value * new
    sigma = max(float(np.sqrt(rest @ rest / dof)), solution.floor)
    return _student(name, Estimate(factor * value, factor * sigma / float(np.sqrt(square))), 'm', dof)


def drift(solution: Solution, cycle: Ints, complete: Ints, count: int) -> list[Check]:
    """How the middle between both lines moves with the number of the cycle."""
    if len(complete) < 2:
        return []
    order = np.arange(len(complete)) - (len(complete) - 1) / 2
    row = np.zeros(count + 2)
    for place, number in zip(order, complete, strict=True):
        row[:count] += np.where(cycle == number, place / 2, 0.0) / float(order @ order)
    return [_student('zero_drift', solution.of(row), 'm', solution.dof)]


def gap_repeats(solution: Solution, contrasts: Floats, rows: Ints) -> tuple[list[Check], float]:
    """Whether the gap is the same in every cycle; the variance between cycles, if it is not.

    Args:
        solution: of the run.
        contrasts: the gap of each cycle as a function of the coefficients, (c, k).
        rows: number of rows of each pass.
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
    check = Check('gap_repeats', float(np.sqrt(variance)), np.nan, 'm', p_value)
    return [check], variance if p_value < SCATTER_LEVEL else 0.0


def slope_repeats(
    solution: Solution, force: Floats, moved: Floats, passes: Ints, sense: Ints
) -> tuple[list[Check], float]:
    """Whether the slope is the same in every pass of a sense; the variance between passes, if it is not."""
    slopes, factors = _pass_slopes(force, moved, passes, len(sense))
    known = np.isfinite(factors)
    dof = int(known.sum()) - 2
    if dof < 1:
        return [], 0.0
    excess = (slopes - np.where(sense > 0, solution.beta[-1], solution.beta[-2]))[known]
    own = solution.sigma * factors[known]
    p_value = float(stats.f.sf(float(((excess / own) ** 2).sum()) / dof, dof, solution.dof))
    variance = between_variance(excess, own, dof)
    check = Check('slope_repeats', float(np.sqrt(variance)), np.nan, 'm/N', p_value)
    return [check], variance if p_value < SCATTER_LEVEL else 0.0


def _pass_slopes(force: Floats, moved: Floats, passes: Ints, count: int) -> tuple[Floats, Floats]:
    """Slope of each pass by itself, and its standard deviation for σ = 1; NaN where there is but one load."""
    slopes, factors = np.full(count, np.nan), np.full(count, np.nan)
    for number in range(count):
        x, y = force[passes == number], moved[passes == number]
        spread = float(((x - x.mean()) ** 2).sum())
        if spread > 1e-12 * float(x @ x):
            slopes[number] = float((x - x.mean()) @ y) / spread
            factors[number] = 1 / np.sqrt(spread)
    return slopes, factors


def expected(solution: Solution) -> Floats:
    """p-value of each row from its residual, studentized with σ of the other rows; 1 where they are too few."""
    if solution.dof < 3:
        return np.ones(len(solution.residual))
    free = np.maximum(1 - (solution.basis**2).sum(axis=1), 1e-12)
    standard = solution.residual / solution.sigma / np.sqrt(free)
    left = np.maximum(solution.dof - standard**2, 1e-12)
    student = standard * np.sqrt((solution.dof - 1) / left)
    return 2 * stats.t.sf(np.abs(student), solution.dof - 1)
