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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge import run_checks
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.run_checks import Check
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate, LeastSquares, find_resolution, least_squares

Ints = NDArray[np.int64]

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
        run_checks.slope_difference(solution, count),
        *run_checks.shapes(solution, readings, used, passes),
        *run_checks.zero_drift(solution, cycle, complete, count),
    ]
    repeats, gap_between = run_checks.gap_repeatability(solution, contrasts, np.bincount(passes[used]))
    more, slope_between = run_checks.slope_repeatability(solution, force, displacement, passes[used], sense)
    residual = np.full(len(used), np.nan)
    residual[used] = solution.residual
    row_p = np.ones(len(used))
    row_p[used] = run_checks.row_p_values(solution)
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
