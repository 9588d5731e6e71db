"""One run of a gauge experiment: straight lines, their slopes and the gap between them, with uncertainties.

A pass is one sense of load in one cycle: loads applied, then removed. The model of a run is

    ΔS = a_cs + p_s F + e,      e ~ N(0, σ²),

an intercept for every pass (c: cycle, s: sense), since a gauge may be set anew, and a slope for each sense. The
compliance is the weighted mean of the two slopes; the gap is the mean over the cycles of a_c+ - a_c-, what the
two lines of a cycle leave between them at zero force. σ comes from the residuals of all passes of the run together.

Rows without load say nothing about the gap: inside its backlash the part stays wherever it was left. They
are shown, but not used.

**Checks.** Each is a test with its own p-value. Where the cycles scatter more than the readings within them
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

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.experiments.gauge_statistics import between_variance
from scara_kinetostatic.recording.gauge_readings import GaugeReadings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ZERO_BAND = 0.02
"""Loads below this part of the largest of the run count as none."""
SCATTER_LEVEL = 0.01
ROUNDING = 1e-9
"""Residuals below this part of the largest displacement are rounding."""


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


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    std: float


class RunFit(NamedTuple):
    """What one run says.

    Attributes:
        compliance: slope, m/N.
        gap: jump of ΔS at zero force, m; half of it is g of (6) and (7).
        slopes: of the negative and the positive sense, m/N.
        sigma: standard deviation of a reading, from the residuals, m.
        degrees_of_freedom: of sigma.
        used: rows used, (n,).
        passes: number of the pass of each row, (n,), -1 where not used.
        lines: sense, intercept (m), slope (m/N) of each pass, (k, 3).
        cycle_gaps: gap of each cycle, (c,), m.
        residual: (n,), m, NaN where not used.
        checks: those that the run allows.
        row_p: of each row, that the others expect it, (n,), 1 where not used.
    """

    compliance: Estimate
    gap: Estimate
    slopes: tuple[Estimate, Estimate]
    sigma: float
    degrees_of_freedom: int
    used: NDArray[np.bool_]
    passes: Ints
    lines: Floats
    cycle_gaps: Floats
    residual: Floats
    checks: tuple[Check, ...]
    row_p: Floats


class _Solution(NamedTuple):
    """Least squares: coefficients, (XᵀX)⁻¹, basis of the columns, residual, σ, degrees of freedom."""

    beta: Floats
    unscaled: Floats
    basis: Floats
    residual: Floats
    sigma: float
    dof: int

    def of(self, row: Floats) -> Estimate:
        """A linear function of the coefficients."""
        return Estimate(float(row @ self.beta), self.sigma * float(np.sqrt(row @ self.unscaled @ row)))


def find_passes(readings: GaugeReadings, zero_band: float = ZERO_BAND) -> tuple[Ints, Ints, Ints]:
    """Which pass each row belongs to.

    Args:
        readings: one run, in order.
        zero_band: part of the largest load that counts as none.

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


def fit_run(readings: GaugeReadings, zero_band: float = ZERO_BAND) -> RunFit:
    """Slopes and gap of one run.

    Args:
        readings: rows of one run, in order.
        zero_band: part of the largest load that counts as none.

    Raises:
        UnsupportedDataError: loads in one sense only, too few rows, or one load only.
    """
    passes, cycle, sense = find_passes(readings, zero_band)
    used = passes >= 0
    complete = np.array([number for number in np.unique(cycle) if np.count_nonzero(cycle == number) == 2])
    if not len(complete):
        lacking = 'there is no reversal of the load' if len(cycle) else 'there is no load'
        raise UnsupportedDataError(lacking, 'load and unload in both senses, in the same cycle')
    force, moved = readings.force[used], readings.displacement[used]
    design = _design(force, passes[used], sense)
    solution = _solve(design, moved)
    count = len(sense)
    slopes = tuple(solution.of(np.eye(count + 2)[count + k]) for k in (0, 1))
    contrasts = np.zeros((len(complete), count + 2))
    for row, number in zip(contrasts, complete, strict=True):
        row[:count] = np.where(cycle == number, sense, 0)
    checks = [
        _senses(solution, count),
        *_shapes(solution, readings, used, passes),
        *_drift(solution, cycle, complete, count),
    ]
    gap_repeats, gap_between = _gap_repeats(solution, contrasts, np.bincount(passes[used]))
    slope_repeats, slope_between = _slope_repeats(solution, force, moved, passes[used], sense)
    residual = np.full(len(used), np.nan)
    residual[used] = solution.residual
    row_p = np.ones(len(used))
    row_p[used] = _expected(solution)
    return RunFit(
        compliance=_widened(_compliance(solution, count), slope_between / count),
        gap=_widened(solution.of(contrasts.mean(axis=0)), gap_between / len(complete)),
        slopes=(slopes[0], slopes[1]),
        sigma=solution.sigma,
        degrees_of_freedom=solution.dof,
        used=used,
        passes=passes,
        lines=np.stack([sense, solution.beta[:count], np.where(sense > 0, slopes[1].value, slopes[0].value)], axis=1),
        cycle_gaps=contrasts @ solution.beta,
        residual=residual,
        checks=(*(check for check in checks if check is not None), *gap_repeats, *slope_repeats),
        row_p=row_p,
    )


def _design(force: Floats, passes: Ints, sense: Ints) -> Floats:
    """Columns: an indicator of each pass, then the force where it is negative, then where it is positive."""
    indicators = (passes[:, None] == np.arange(len(sense))).astype(float)
    positive = sense[passes] > 0
    return np.column_stack([indicators, np.where(positive, 0.0, force), np.where(positive, force, 0.0)])


def _solve(design: Floats, moved: Floats) -> _Solution:
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
    return _Solution(beta, inverse @ inverse.T, basis, residual, max(sigma, ROUNDING * np.abs(moved).max()), dof)


def _compliance(solution: _Solution, count: int) -> Estimate:
    """Mean of both slopes, weighted with their own variances, which are independent of each other."""
    variance = np.diag(solution.unscaled)[count:]
    row = np.zeros(count + 2)
    row[count:] = (1 / variance) / (1 / variance).sum()
    return solution.of(row)


def _widened(estimate: Estimate, variance: float) -> Estimate:
    return Estimate(estimate.value, float(np.hypot(estimate.std, np.sqrt(variance))))


def _senses(solution: _Solution, count: int) -> Check:
    row = np.zeros(count + 2)
    row[count:] = (-1.0, 1.0)
    return _student('senses', solution.of(row), 'm/N', solution.dof)


def _student(name: str, estimate: Estimate, unit: str, dof: int) -> Check:
    p_value = 2 * float(stats.t.sf(abs(estimate.value) / estimate.std, dof))
    return Check(name, estimate.value, estimate.std, unit, p_value)


def _shapes(solution: _Solution, readings: GaugeReadings, used: NDArray[np.bool_], passes: Ints) -> list[Check | None]:
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


def _added(solution: _Solution, name: str, column: Floats, factor: float) -> Check | None:
    """The coefficient of one more column, times a factor; None where the run cannot tell it."""
    dof = solution.dof - 1
    new = column - solution.basis @ (solution.basis.T @ column)
    square = float(new @ new)
    if dof < 1 or square < 1e-8 * float(column @ column):
        return None
    value = float(new @ solution.residual) / square
    rest = solution.residual - value * new
    floor = ROUNDING * float(np.abs(solution.beta).max())
    std = max(float(np.sqrt(rest @ rest / dof / square)), floor / np.sqrt(square))
    return _student(name, Estimate(factor * value, factor * std), 'm', dof)


def _drift(solution: _Solution, cycle: Ints, complete: Ints, count: int) -> list[Check]:
    """How the middle between both lines moves with the number of the cycle."""
    if len(complete) < 2:
        return []
    order = np.arange(len(complete)) - (len(complete) - 1) / 2
    row = np.zeros(count + 2)
    for place, number in zip(order, complete, strict=True):
        row[:count] += np.where(cycle == number, place / 2, 0.0) / float(order @ order)
    return [_student('zero_drift', solution.of(row), 'm', solution.dof)]


def _gap_repeats(solution: _Solution, contrasts: Floats, rows: Ints) -> tuple[list[Check], float]:
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


def _slope_repeats(
    solution: _Solution, force: Floats, moved: Floats, passes: Ints, sense: Ints
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


def _expected(solution: _Solution) -> Floats:
    """p-value of each row from its residual, studentized with σ of the other rows; 1 where they are too few."""
    if solution.dof < 3:
        return np.ones(len(solution.residual))
    free = np.maximum(1 - (solution.basis**2).sum(axis=1), 1e-12)
    standard = solution.residual / solution.sigma / np.sqrt(free)
    left = np.maximum(solution.dof - standard**2, 1e-12)
    student = standard * np.sqrt((solution.dof - 1) / left)
    return 2 * stats.t.sf(np.abs(student), solution.dof - 1)
