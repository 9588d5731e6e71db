"""Fit of one run: straight lines, their slopes and the gap between them, with uncertainties and checks.

A pass is one sense of load in one cycle: loads applied, then removed. The model of a run is

    ΔS = a_cs + p_s F + e,      e ~ N(0, σ²),

an intercept for every pass (c: cycle, s: sense), since the gauge may be set anew, and a slope for each sense. The
compliance is the weighted mean of the two slopes; the gap is the mean over the cycles of a_c+ - a_c-, the distance of
the two lines of a cycle at zero force. σ is estimated from the residuals of all passes of the run together.

Rows without load contain no information about the gap: inside the backlash the part may be anywhere. They are shown,
but not used.

The resolution of the gauge limits the uncertainty where the part repeats better: σ is at least resolution / √12, and
where it is below 0.38 times the resolution, the same load gives the same rounding error, so that only rows with
different loads count as independent. The resolution is estimated from the readings.

Each check of the model has its own p-value. Where the cycles scatter more than the readings within them (p < 1 %), the
variance between the cycles is added to that of the result.

- slope_difference: slope of the positive less that of the negative sense;
- hysteresis: displacement while the load is removed less that while it is applied, at the same load;
- curvature: deviation of the lines from their chords, positive where the displacement grows faster than the load;
- zero_drift: drift of the gauge's zero per cycle; if it is steady, half of it is contained in the gap;
- gap_repeatability, slope_repeatability: standard deviation between the cycles beyond that of the readings.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.studies.loops.estimates import (
    FALSE_ALARM_LEVEL,
    Estimate,
    LeastSquares,
    find_resolution,
    least_squares,
)
from scara_kinetostatic.studies.loops.readings import Readings

ZERO_BAND = 0.02
"""Share of the largest load of a run up to which a load counts as none."""


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
    used: Mask
    lines: Floats
    cycle_gaps: Floats
    residual: Floats
    checks: tuple[Check, ...]
    row_p: Floats


def find_passes(readings: Readings, zero_band: float = ZERO_BAND) -> tuple[Indices, Floats, Floats]:
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
    sense, cycle = np.sign(force[loaded]), readings.cycle[loaded]
    if np.any(np.isnan(cycle)):
        cycle = np.cumsum(np.diff(sense, prepend=sense[:1]) != 0) // 2
    keys, number = np.unique(np.stack([cycle, -sense], axis=1), axis=0, return_inverse=True)
    passes = np.full(len(force), -1, dtype=np.intp)
    passes[loaded] = number.reshape(-1)
    return passes, keys[:, 0], -keys[:, 1]


def fit_run(readings: Readings, zero_band: float = ZERO_BAND) -> RunFit:
    """Slopes and gap of one run.

    Args:
        readings: rows of one run, in order.
        zero_band: share of the largest load up to which a load counts as none.

    Raises:
        UnsupportedDataError: loads in one sense only, too few rows, or one load only.
    """
    passes, cycle, sense = find_passes(readings, zero_band)
    used, count = passes >= 0, len(sense)
    complete = [number for number in np.unique(cycle) if np.count_nonzero(cycle == number) == 2]
    if not complete:
        lacking = 'there is no reversal of the load' if count else 'there is no load'
        raise UnsupportedDataError(lacking, 'load and unload in both senses, in the same cycle')
    force, displacement, passes = readings.force[used], readings.displacement[used], passes[used]
    positive = sense[passes] > 0
    design = np.column_stack([passes[:, None] == np.arange(count), force * ~positive, force * positive])
    if len(force) <= count + 2:
        problem = f'{len(force)} rows under load are too few, this run needs {count + 3} or more'
        raise UnsupportedDataError(problem, 'take more loads in each sense')
    solution, resolution = least_squares(design, displacement), find_resolution(readings.displacement)
    sigma = max(solution.sigma, resolution / np.sqrt(12))
    if solution.sigma < 0.38 * resolution:
        least = sigma * float(np.sqrt(len(force) / len(np.unique(np.abs(force)))))
        solution = solution._replace(sigma=least, floor=least)
    # linear functions of the coefficients, which are the intercepts, the negative and the positive slope
    unit = np.eye(count + 2)
    slopes = solution.of(unit[-2], 'm/N'), solution.of(unit[-1], 'm/N')
    weight = 1 / np.diag(solution.unscaled)[-2:]  # the two slopes are independent
    gaps = np.array([[*np.where(cycle == number, sense, 0), 0, 0] for number in complete], dtype=float)
    gap_check = _gap_repeatability(solution, gaps, np.bincount(passes))
    slope_check = _slope_repeatability(solution, force, displacement, passes, sense)
    checks = (
        _student('slope_difference', solution.of(unit[-1] - unit[-2], 'm/N'), solution.dof),
        *_shape_checks(solution, force, passes),
        _zero_drift(solution, gaps),
        gap_check,
        slope_check,
    )
    residual, row_p = np.full(len(used), np.nan), np.ones(len(used))
    residual[used], row_p[used] = solution.residual, _row_p_values(solution)
    return RunFit(
        compliance=solution.of(weight @ unit[-2:] / weight.sum(), 'm/N').plus(0.0, _between(slope_check, count)),
        gap=solution.of(gaps.mean(axis=0), 'm').plus(0.0, _between(gap_check, len(gaps))),
        slopes=slopes,
        sigma=sigma,
        resolution=resolution,
        degrees_of_freedom=solution.dof,
        used=used,
        lines=np.stack([sense, solution.beta[:count], np.where(sense > 0, slopes[1].value, slopes[0].value)], axis=1),
        cycle_gaps=gaps @ solution.beta,
        residual=residual,
        checks=tuple(check for check in checks if check),
        row_p=row_p,
    )


def _between(repeatability: Check | None, count: int) -> float:
    """What the scatter between cycles adds to the std of a mean, where it is more than that of the readings."""
    if repeatability is None or repeatability.p_value >= FALSE_ALARM_LEVEL:
        return 0.0
    return repeatability.value / float(np.sqrt(count))


def _student(name: str, estimate: Estimate, dof: int) -> Check:
    return Check(name, *estimate, 2 * float(stats.t.sf(abs(estimate.value) / estimate.std, dof)))


def _zero_drift(solution: LeastSquares, gaps: Floats) -> Check | None:
    """Drift of the mean of both lines with the number of the cycle."""
    if len(gaps) < 2:
        return None
    order = np.arange(len(gaps)) - (len(gaps) - 1) / 2
    return _student('zero_drift', solution.of(order @ np.abs(gaps) / 2 / (order @ order), 'm'), solution.dof)


def _shape_checks(solution: LeastSquares, force: Floats, passes: Indices) -> Iterator[Check]:
    """Hysteresis and curvature, each the coefficient of one additional column; not where the run lacks it."""
    branch, size, dof = np.zeros(len(force)), np.abs(force), solution.dof - 1
    for number in np.unique(passes):
        rows = np.flatnonzero(passes == number)
        top = np.flatnonzero(size[rows] >= size[rows].max() * (1 - 1e-6))
        branch[rows[: top[0]]], branch[rows[top[-1] + 1 :]] = -0.5, 0.5
    both = np.any(branch < 0) and np.any(branch > 0)
    columns = {
        'hysteresis': (np.sign(force) * branch * both, 1.0),
        'curvature': (np.sign(force) * force**2, float(np.ptp(size)) ** 2 / 4),
    }
    for name, (column, factor) in columns.items():
        new = column - solution.basis @ (solution.basis.T @ column)
        square = float(new @ new)
        if dof >= 1 and square > 1e-8 * float(column @ column):
            value = float(new @ solution.residual) / square
            rest = solution.residual - value * new
            sigma = max(float(np.sqrt(rest @ rest / dof)), solution.floor)
            yield _student(name, Estimate(factor * value, factor * sigma / float(np.sqrt(square)), 'm'), dof)


def _gap_repeatability(solution: LeastSquares, gaps: Floats, rows: Indices) -> Check | None:
    """Whether the gap is the same in every cycle; `rows`: number of rows of each pass, (k,)."""
    values = gaps @ solution.beta
    std = solution.sigma * np.sqrt((gaps[:, : len(rows)] ** 2) @ (1 / rows))  # the slopes' part is common to all
    centre = np.average(values, weights=1 / std**2)
    return _repeatability('gap_repeatability', 'm', (values - centre) / std, std, len(gaps) - 1, solution.dof)


def _slope_repeatability(
    solution: LeastSquares, force: Floats, displacement: Floats, passes: Indices, sense: Floats
) -> Check | None:
    """Whether the slope is the same in every pass of a sense; a pass with a single load has none."""
    off, std = [], []
    for number, sign in enumerate(sense):
        x, y = force[passes == number], displacement[passes == number]
        squares = float(((x - x.mean()) ** 2).sum())
        if squares > 1e-12 * float(x @ x):
            slope = float((x - x.mean()) @ y) / squares
            std.append(solution.sigma / np.sqrt(squares))
            off.append((slope - solution.beta[-1 if sign > 0 else -2]) / std[-1])
    return _repeatability('slope_repeatability', 'm/N', np.array(off), np.array(std), len(off) - 2, solution.dof)


def _repeatability(name: str, unit: str, off: Floats, std: Floats, dof: int, of_sigma: int) -> Check | None:
    """F-test of what several estimates are off, in units of their std; the value is what they scatter beyond it."""
    if dof < 1:
        return None
    chi_square = float(off @ off)
    between = float(np.sqrt(max(chi_square / dof - 1, 0.0) * (std**2).mean()))
    return Check(name, between, np.nan, unit, float(stats.f.sf(chi_square / dof, dof, of_sigma)))


def _row_p_values(solution: LeastSquares) -> Floats:
    """p-value of each row from its externally studentised residual, (n,); 1 with too few degrees of freedom."""
    if solution.dof < 3:
        return np.ones(len(solution.residual))
    free = np.maximum(1 - (solution.basis**2).sum(axis=1), 1e-12)
    standard = solution.residual / solution.sigma / np.sqrt(free)
    left = np.maximum(solution.dof - standard**2, 1e-12)
    student = standard * np.sqrt((solution.dof - 1) / left)
    return 2 * stats.t.sf(np.abs(student), solution.dof - 1)
