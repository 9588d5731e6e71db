"""Gap and slope from a continuous record of force–displacement loops, reversal by reversal.

The evaluation of one reversal is in `reversals`. Standard deviations come from the residuals of the lines, pooled over
the reversals of one sense: they contain the noise of the readings and the deviations of the branches from straight
lines. Where the reversals of a sense are inconsistent (χ²), the variance between them is added to that of the mean. In
addition:

- trends: regression of gap and slope on the speed in the gap, and on time;
- repeatability: standard deviation among reversals at the same place after the same motion;
- definitional uncertainty (VIM 2.27): half the range of the means over other windows of the lines. It is common to all
  reversals and not contained in their scatter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.reversals import (
    Line,
    Reversal,
    Sweep,
    as_reversal,
    find_level,
    find_plateau,
    find_sweeps,
    fit_pair,
    pooled,
)
from scara_kinetostatic.studies.dial_gauge.statistics import CombinedEstimate, Estimate, combine_estimates

_Window = tuple[float, float]

_WINDOW = (0.15, 0.55)
"""Shares of the way from the level to the plateau between which a branch is fitted by a straight line."""
_OTHER_WINDOWS = ((0.1, 0.5), (0.2, 0.6), (0.1, 0.6), (0.2, 0.5))
"""Windows for the definitional uncertainty."""
_SAME_PLACE = 0.01
"""Reversals closer than this share of the largest displacement are at the same place."""
_STILL_ROWS, _STILL_TRAVEL = 64, 1e-3
"""Rows of a stretch at standstill, and its largest range of displacement as a share of that of the record."""


class Rejected(NamedTuple):
    """A reversal that cannot be used: its time, s, and the reason."""

    time: float
    reason: str


class Trend(NamedTuple):
    """Linear regression of one quantity on a variable.

    Attributes:
        quantity: 'gap' or 'compliance'.
        variable: 'speed' or 'time'.
        slope: SI, with its standard deviation from the residuals.
        p_value: of no trend.
        residual_std: standard deviation of the residuals, SI.
    """

    quantity: str
    variable: str
    slope: Estimate
    p_value: float
    residual_std: float


class Sense(NamedTuple):
    """All reversals of one sense of a loop.

    Attributes:
        sense: +1 where the displacement rises after the reversal.
        level: force inside the backlash, in the sign of the record, N.
        plateau: force at which the joint slips, in the sign of the record, N.
        sigma: residual standard deviation of the branches before and after the gap, m.
        gap: mean with test of consistency; None for fewer than two reversals.
        compliance: likewise.
        trends: of both, on speed and time; empty for fewer than four reversals.
        repeatability: standard deviation of gap and compliance among reversals at the same place; NaN without any.
        definitional_uncertainty: half the range of their means over `_OTHER_WINDOWS`.
        reversals: in order.
    """

    sense: int
    level: float
    plateau: float
    sigma: tuple[float, float]
    gap: CombinedEstimate | None
    compliance: CombinedEstimate | None
    trends: tuple[Trend, ...]
    repeatability: tuple[float, float]
    definitional_uncertainty: tuple[float, float]
    reversals: tuple[Reversal, ...]


class LoopAnalysis(NamedTuple):
    """Result of a record of loops.

    Attributes:
        senses: rising, falling; those with a reversal.
        rejected: reversals not used.
        noise: standard deviation of displacement (m) and force (N) at standstill; NaN without standstill.
    """

    senses: tuple[Sense, ...]
    rejected: tuple[Rejected, ...]
    noise: tuple[float, float]

    @property
    def reversals(self) -> tuple[Reversal, ...]:
        """All of them, in order of time."""
        return tuple(sorted((each for sense in self.senses for each in sense.reversals), key=lambda each: each.time))


def analyse_loops(time: Floats, displacement: Floats, force: Floats, window: _Window = _WINDOW) -> LoopAnalysis:
    """Gap and slope at the reversals.

    Args:
        time: rising, (n,), s.
        displacement: (n,), m.
        force: (n,), N.
        window: shares of the way from the level to the plateau between which the lines are fitted.

    Raises:
        UnsupportedDataError: the time does not increase, or no reversal can be used.
    """
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise UnsupportedDataError('the time does not rise from row to row', 'give the rows in the order of time')
    sweeps = find_sweeps(time, displacement, force)
    senses, rejected = _senses(sweeps, window)
    if not senses:
        why = f': {rejected[0].reason}' if rejected else ''
        raise UnsupportedDataError(
            f'no reversal has a gap between two elastic branches{why}', 'record full loops at a higher sampling rate'
        )
    others = [_senses(sweeps, other)[0] for other in _OTHER_WINDOWS]
    senses = [sense._replace(definitional_uncertainty=_definitional_uncertainty(sense, others)) for sense in senses]
    return LoopAnalysis(tuple(senses), tuple(sorted(rejected)), _noise_at_standstill(time, displacement, force))


def _senses(sweeps: list[Sweep], window: _Window) -> tuple[list[Sense], list[Rejected]]:
    senses, rejected = [], []
    plateaus = {sense: find_plateau([sweep for sweep in sweeps if sweep.sense == sense]) for sense in (1, -1)}
    if np.isfinite(plateaus[1] + plateaus[-1]):
        for sense in (1, -1):
            found, lost = _sense(sense, [sweep for sweep in sweeps if sweep.sense == sense], plateaus, window)
            senses += [found] if found.reversals else []
            rejected += lost
    return senses, rejected


def _sense(
    sense: int, sweeps: list[Sweep], plateaus: dict[int, float], window: _Window
) -> tuple[Sense, list[Rejected]]:
    """Result for one sense, from both lines of every sweep."""
    levels = [find_level(sweep, plateaus[sense]) for sweep in sweeps]
    level = float(np.nanmedian(levels)) if np.any(np.isfinite(levels)) else np.nan
    lines: list[tuple[Sweep, Line, Line]] = []
    rejected = []
    for sweep in sweeps:
        pair = fit_pair(sweep, level, -plateaus[-sense], plateaus[sense], window)
        if isinstance(pair, str):
            rejected.append(Rejected(float(sweep.time[0]), pair))
        else:
            lines.append((sweep, *pair))
    sigma = (pooled([line for _, line, _ in lines]), pooled([line for _, _, line in lines]))
    reversals = tuple(as_reversal(sweep, before, after, sigma) for sweep, before, after in lines)
    dof = float(sum(line.samples - 2 for _, _, line in lines))
    gap, compliance = (_agree(reversals, name, dof) for name in ('gap', 'compliance'))
    values = {name: np.array([getattr(each, name).value for each in reversals]) for name in ('gap', 'compliance')}
    found = Sense(
        sense=sense,
        level=sense * level,
        plateau=sense * plateaus[sense],
        sigma=sigma,
        gap=gap,
        compliance=compliance,
        trends=_trends(reversals, values),
        repeatability=(_repeatability(reversals, values['gap']), _repeatability(reversals, values['compliance'])),
        definitional_uncertainty=(np.nan, np.nan),
        reversals=reversals,
    )
    return found, rejected


def _agree(reversals: tuple[Reversal, ...], name: str, dof: float) -> CombinedEstimate | None:
    if len(reversals) < 2 or dof < 1:
        return None
    values, std = np.array([getattr(each, name) for each in reversals]).T
    return combine_estimates(values, std, dof)


def _trends(reversals: tuple[Reversal, ...], values: dict[str, Floats]) -> tuple[Trend, ...]:
    if len(reversals) < 4:
        return ()
    found = []
    for name, y in values.items():
        for variable in ('speed', 'time'):
            x = np.array([getattr(each, variable) for each in reversals])
            x = x - x.mean()
            square, dof = float(x @ x), len(x) - 2
            if square == 0:
                continue
            slope = float(x @ y) / square
            rest = y - y.mean() - slope * x
            residual_std = float(np.sqrt(rest @ rest / dof))
            std = residual_std / float(np.sqrt(square))
            p_value = 2 * float(stats.t.sf(abs(slope) / std, dof)) if std > 0 else float(slope == 0)
            found.append(Trend(name, variable, Estimate(slope, std), p_value, residual_std))
    return tuple(found)


def _repeatability(reversals: tuple[Reversal, ...], values: Floats) -> float:
    """Pooled standard deviation among successive reversals of one sense at the same place."""
    if not reversals:
        return np.nan
    place = np.array([each.displacement for each in reversals])
    limit = _SAME_PLACE * float(np.abs(place).max())
    square, dof, start = 0.0, 0, 0
    for end in range(1, len(place) + 1):
        if end == len(place) or abs(place[end] - place[start]) > limit:
            group = values[start:end]
            square, dof = square + float(((group - group.mean()) ** 2).sum()), dof + len(group) - 1
            start = end
    return float(np.sqrt(square / dof)) if dof else np.nan


def _definitional_uncertainty(sense: Sense, others: list[list[Sense]]) -> tuple[float, float]:
    """Half the range of the means over all windows, gap and compliance; NaN where no other window has a result."""
    halves = []
    for name in ('gap', 'compliance'):
        same = [each for senses in others for each in senses if each.sense == sense.sense]
        tests = [getattr(each, name) for each in (sense, *same)]
        means = [test.mean for test in tests if test is not None]
        halves.append(float(np.ptp(means)) / 2 if len(means) > 1 else np.nan)
    return halves[0], halves[1]


def _noise_at_standstill(time: Floats, displacement: Floats, force: Floats) -> tuple[float, float]:
    """Noise of displacement (m) and force (N): residuals about a straight line in the stretch of least motion."""
    rows = _STILL_ROWS
    if len(time) < 4 * rows:
        return np.nan, np.nan
    starts = np.arange(0, len(time) - rows + 1, rows // 4)
    travel = np.array([np.ptp(displacement[k : k + rows]) for k in starts])
    if travel.min() > _STILL_TRAVEL * np.ptp(displacement):
        return np.nan, np.nan
    still = slice(starts[travel.argmin()], starts[travel.argmin()] + rows)
    line = np.stack([np.ones(rows), time[still] - time[still].mean()], axis=1)
    residuals = [y - line @ np.linalg.lstsq(line, y, rcond=None)[0] for y in (displacement[still], force[still])]
    noise = [float(np.sqrt(each @ each / (rows - 2))) for each in residuals]
    return noise[0], noise[1]
