"""Fit of one run: straight lines, their slopes and the gap between them, with uncertainties.

A pass is one sense of load in one cycle: loads applied, then removed. The model of a run is

    ΔS = a_cs + p_s F + e,      e ~ N(0, σ²),

an intercept for every pass (c: cycle, s: sense), since the gauge may be set anew, and a slope for each sense. The
compliance is the weighted mean of the two slopes; the gap is the mean over the cycles of a_c+ - a_c-, the distance of
the two lines of a cycle at zero force. σ is estimated from the residuals of all passes of the run together.

Rows without load contain no information about the gap: inside the backlash the part may be anywhere. They are shown,
but not used.

The resolution of the gauge limits the uncertainty where the part repeats better: σ is at least resolution / √12, and
where it is below `_COARSE` times the resolution, the same load gives the same rounding error, so that only rows with
different loads count as independent. The resolution is estimated from the readings.

Tests of a run are in `run_checks`.

Tests of one run against its model: straight lines with one gap.

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

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import (
    Estimate,
    LeastSquares,
    between_variance,
    find_resolution,
    least_squares,
)

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


ZERO_BAND = 0.02
"""Share of the largest load of a run up to which a load counts as none."""
_COARSE = 0.38
"""Standard deviation of the readings, in resolutions, below which equal loads have equal rounding errors."""


class RunFit(NamedTuple):
    """Result of one run.

    Attributes:
        compliance: slope, m/N.
        gap: jump of ΔS at zero force, m; half of it is g of (6) and (7).
        slopes: of the negative and the positive sense, m/N.
        sigma: standard deviation of a reading, from the residuals, m.
        resolution: of the gauge as estimated from the readings, m; 0 where they show none.
        degrees_of_freedom: of sigma.
        used: rows used, (n,).
        passes: number of the pass of each row, (n,), -1 where not used.
        lines: sense, intercept (m), slope (m/N) of each pass, (k, 3).
        cycle_gaps: gap of each cycle, (c,), m.
        residual: (n,), m, NaN where not used.
        checks: tests that the run allows.
        row_p: p-value of each row's residual, (n,), 1 where not used.
    """

    compliance: Estimate
    gap: Estimate
    slopes: tuple[Estimate, Estimate]
    sigma: float
    resolution: float
    degrees_of_freedom: int
    used: NDArray[np.bool_]
    passes: Ints
    lines: Floats
    cycle_gaps: Floats
    residual: Floats
    checks: tuple[Check, ...]
    row_p: Floats


def find_passes(readings: DialGaugeReadings, zero_band: float = ZERO_BAND) -> tuple[Ints, Ints, Ints]:
    """The pass to which each row belongs.

    Args:
        readings: one run, in order.
        zero_band: share of the largest load up to which a load counts as none.

    Returns:
        Pass of each row, (n,), -1 where there is no load; cycle (k,) and sense (k,) of each pass. Without
        a column of cycles a pass ends where the sense changes, and two passes make a cycle.
    """
    force = readings.force
    loaded = np.flatnonzero(np.abs(force) > zero_band * np.abs(force).max(initial=0.0))
    sense = np.sign(force[loaded]).astype(np.int64)
    cycle = readings.cycle[loaded]
    if np.any(cycle < 0):
        cycle = np.cumsum(np.diff(sense, prepend=sense[:1]) != 0) // 2
    keys, number = np.unique(np.stack([cycle, -sense], axis=1), axis=0, return_inverse=True)
    passes = np.full(len(force), -1, dtype=np.int64)
    passes[loaded] = number.reshape(-1)
    return passes, keys[:, 0], -keys[:, 1]


def fit_run(readings: DialGaugeReadings, zero_band: float = ZERO_BAND) -> RunFit:
    """Slopes and gap of one run.

    Args:
        readings: rows of one run, in order.
        zero_band: share of the largest load up to which a load counts as none.

    Raises:
        UnsupportedDataError: loads in one sense only, too few rows, or one load only.
    """
    passes, cycle, sense = find_passes(readings, zero_band)
    used = passes >= 0
    complete = np.array([number for number in np.unique(cycle) if np.count_nonzero(cycle == number) == 2])
    if not len(complete):
        lacking = 'there is no reversal of the load' if len(cycle) else 'there is no load'
        raise UnsupportedDataError(lacking, 'load and unload in both senses, in the same cycle')
    force, displacement = readings.force[used], readings.displacement[used]
    design = _design(force, passes[used], sense)
    solution, resolution = least_squares(design, displacement), find_resolution(readings.displacement)
    sigma = max(solution.sigma, resolution / np.sqrt(12))
    if solution.sigma < _COARSE * resolution:
        least = sigma * float(np.sqrt(len(force) / len(np.unique(np.abs(force)))))
        solution = solution._replace(sigma=least, floor=least)
    count = len(sense)
    slopes = tuple(solution.of(np.eye(count + 2)[count + k]) for k in (0, 1))
    contrasts = np.zeros((len(complete), count + 2))
    for row, number in zip(contrasts, complete, strict=True):
        row[:count] = np.where(cycle == number, sense, 0)
    checks = [
        slope_difference(solution, count),
        *shapes(solution, readings, used, passes),
        *zero_drift(solution, cycle, complete, count),
    ]
    repeats, gap_between = gap_repeatability(solution, contrasts, np.bincount(passes[used]))
    more, slope_between = slope_repeatability(solution, force, displacement, passes[used], sense)
    residual = np.full(len(used), np.nan)
    residual[used] = solution.residual
    row_p = np.ones(len(used))
    row_p[used] = row_p_values(solution)
    return RunFit(
        compliance=_widened(_compliance(solution, count), slope_between / count),
        gap=_widened(solution.of(contrasts.mean(axis=0)), gap_between / len(complete)),
        slopes=(slopes[0], slopes[1]),
        sigma=sigma,
        resolution=resolution,
        degrees_of_freedom=solution.dof,
        used=used,
        passes=passes,
        lines=np.stack([sense, solution.beta[:count], np.where(sense > 0, slopes[1].value, slopes[0].value)], axis=1),
        cycle_gaps=contrasts @ solution.beta,
        residual=residual,
        checks=(*(check for check in checks if check is not None), *repeats, *more),
        row_p=row_p,
    )


def _design(force: Floats, passes: Ints, sense: Ints) -> Floats:
    """Columns: an indicator of each pass, then the force where it is negative, then where it is positive."""
    indicators = (passes[:, None] == np.arange(len(sense))).astype(float)
    positive = sense[passes] > 0
    return np.column_stack([indicators, np.where(positive, 0.0, force), np.where(positive, force, 0.0)])


def _compliance(solution: LeastSquares, count: int) -> Estimate:
    """Mean of both slopes, weighted by the inverses of their variances; the two are independent."""
    variance = np.diag(solution.unscaled)[count:]
    row = np.zeros(count + 2)
    row[count:] = (1 / variance) / (1 / variance).sum()
    return solution.of(row)


def _widened(estimate: Estimate, variance: float) -> Estimate:
    return Estimate(estimate.value, float(np.hypot(estimate.std, np.sqrt(variance))))
