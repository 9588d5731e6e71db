"""A continuous record of force–displacement loops: gap and slope reversal by reversal, and whether they agree.

How each reversal is read stands in `gauge_reversals`. Standard deviations come from the residuals of the lines,
pooled over the reversals of one sense: they hold the noise of the readings and whatever of the branch is not
straight. Where the reversals of a sense do not agree within them (χ²), the variance between is added
to the mean's. Three things help to see why, or what agreement is worth:

- trends: gap and slope against the speed in the gap, and against time;
- repeatability: the scatter among reversals at the same place after the same motion;
- definition: how far the means move when the window of the lines is another one. No scatter tells of it, since it moves
  all reversals alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.errors import UnsupportedDataError
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
from scara_kinetostatic.studies.dial_gauge.statistics import Agreement, Estimate, agreement

Floats = NDArray[np.float64]
Window = tuple[float, float]

WINDOW = (0.15, 0.55)
"""Parts of the way from the level to the plateau between which a branch counts as straight."""
OTHER_WINDOWS = ((0.1, 0.5), (0.2, 0.6), (0.1, 0.6), (0.2, 0.5))
TREND_LEVEL = 0.01
_SAME_PLACE = 0.01


class Rejected(NamedTuple):
    """A reversal that cannot be used: when, and why."""

    time: float
    reason: str


class Trend(NamedTuple):
    """A straight line of one quantity over another.

    Attributes:
        quantity: 'gap' or 'compliance'.
        over: 'speed' or 'time'.
        slope: SI, with its standard deviation from the scatter about the line.
        p_value: of no trend.
        left: scatter about the line, standard deviation.
    """

    quantity: str
    over: str
    slope: Estimate
    p_value: float
    left: float


class Sense(NamedTuple):
    """All reversals of one sense of a loop.

    Attributes:
        sense: +1 where the displacement rises after the reversal.
        level: force inside the backlash, in the sign of the record, N.
        plateau: force at which it slips, in the sign of the record, N.
        sigma: residual standard deviation of the branches before and after the gap, m.
        gap: mean, and whether the reversals agree on it; None for fewer than two.
        compliance: likewise.
        trends: of both, over speed and time; empty for fewer than four reversals.
        repeatability: scatter of gap and compliance among reversals at the same place; NaN if there are none.
        definition: half the range of their means over `OTHER_WINDOWS`.
        reversals: in order.
    """

    sense: int
    level: float
    plateau: float
    sigma: tuple[float, float]
    gap: Agreement | None
    compliance: Agreement | None
    trends: tuple[Trend, ...]
    repeatability: tuple[float, float]
    definition: tuple[float, float]
    reversals: tuple[Reversal, ...]


class LoopAnalysis(NamedTuple):
    """What a record of loops says.

    Attributes:
        senses: rising, falling; those that have a reversal.
        rejected: reversals not used.
        noise: standard deviation of displacement (m) and force (N) while it stands still; NaN if it never does.
    """

    senses: tuple[Sense, ...]
    rejected: tuple[Rejected, ...]
    noise: tuple[float, float]

    @property
    def reversals(self) -> tuple[Reversal, ...]:
        """All of them, in order of time."""
        return tuple(sorted((each for sense in self.senses for each in sense.reversals), key=lambda each: each.time))


def analyse_loops(time: Floats, displacement: Floats, force: Floats, window: Window = WINDOW) -> LoopAnalysis:
    """Gap and slope at the reversals.

    Args:
        time: rising, (n,), s.
        displacement: (n,), m.
        force: (n,), N.
        window: part of the way from the level to the plateau that counts as elastic.

    Raises:
        UnsupportedDataError: the time does not rise, or no reversal can be used.
    """
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise UnsupportedDataError('the time does not rise from row to row', 'give the record in its order')
    sweeps = find_sweeps(time, displacement, force)
    senses, rejected = _senses(sweeps, window)
    if not senses:
        why = f': {rejected[0].reason}' if rejected else ''
        raise UnsupportedDataError(
            f'no reversal shows a gap between two elastic branches{why}', 'record full loops, sampled more densely'
        )
    others = [_senses(sweeps, other)[0] for other in OTHER_WINDOWS]
    senses = [sense._replace(definition=_definition(sense, others)) for sense in senses]
    return LoopAnalysis(tuple(senses), tuple(sorted(rejected)), _still(time, displacement, force))


def _senses(sweeps: list[Sweep], window: Window) -> tuple[list[Sense], list[Rejected]]:
    senses, rejected = [], []
    plateaus = {sense: find_plateau([sweep for sweep in sweeps if sweep.sense == sense]) for sense in (1, -1)}
    if np.isfinite(plateaus[1] + plateaus[-1]):
        for sense in (1, -1):
            found, lost = _sense(sense, [sweep for sweep in sweeps if sweep.sense == sense], plateaus, window)
            senses += [found] if found.reversals else []
            rejected += lost
    return senses, rejected


def _sense(sense: int, sweeps: list[Sweep], plateaus: dict[int, float], window: Window) -> tuple[Sense, list[Rejected]]:
    """Both lines of every sweep of one sense, and what they say."""
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
        definition=(np.nan, np.nan),
        reversals=reversals,
    )
    return found, rejected


def _agree(reversals: tuple[Reversal, ...], name: str, dof: float) -> Agreement | None:
    if len(reversals) < 2 or dof < 1:
        return None
    values, std = np.array([getattr(each, name) for each in reversals]).T
    return agreement(values, std, dof)


def _trends(reversals: tuple[Reversal, ...], values: dict[str, Floats]) -> tuple[Trend, ...]:
    if len(reversals) < 4:
        return ()
    found = []
    for name, y in values.items():
        for over in ('speed', 'time'):
            x = np.array([getattr(each, over) for each in reversals])
            x = x - x.mean()
            square, dof = float(x @ x), len(x) - 2
            if square == 0:
                continue
            slope = float(x @ y) / square
            rest = y - y.mean() - slope * x
            left = float(np.sqrt(rest @ rest / dof))
            std = left / float(np.sqrt(square))
            p_value = 2 * float(stats.t.sf(abs(slope) / std, dof)) if std > 0 else float(slope == 0)
            found.append(Trend(name, over, Estimate(slope, std), p_value, left))
    return tuple(found)


def _repeatability(reversals: tuple[Reversal, ...], values: Floats) -> float:
    """Pooled scatter among successive reversals of one sense at the same place."""
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


def _definition(sense: Sense, others: list[list[Sense]]) -> tuple[float, float]:
    """Half the range of the means over all windows, gap and compliance; NaN where another window finds nothing."""
    spreads = []
    for name in ('gap', 'compliance'):
        same = [each for senses in others for each in senses if each.sense == sense.sense]
        tests = [getattr(each, name) for each in (sense, *same)]
        means = [test.mean for test in tests if test is not None]
        spreads.append(float(np.ptp(means)) / 2 if len(means) > 1 else np.nan)
    return spreads[0], spreads[1]


def _still(time: Floats, displacement: Floats, force: Floats, rows: int = 64) -> tuple[float, float]:
    """Noise of the readings, from the stillest stretch, a straight line taken off."""
    if len(time) < 4 * rows:
        return np.nan, np.nan
    starts = np.arange(0, len(time) - rows + 1, rows // 4)
    travel = np.array([np.ptp(displacement[k : k + rows]) for k in starts])
    if travel.min() > 1e-3 * np.ptp(displacement):
        return np.nan, np.nan
    still = slice(starts[travel.argmin()], starts[travel.argmin()] + rows)
    line = np.stack([np.ones(rows), time[still] - time[still].mean()], axis=1)
    left = [y - line @ np.linalg.lstsq(line, y, rcond=None)[0] for y in (displacement[still], force[still])]
    noise = [float(np.sqrt(each @ each / (rows - 2))) for each in left]
    return noise[0], noise[1]
