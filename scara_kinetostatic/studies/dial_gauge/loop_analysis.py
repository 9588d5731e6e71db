"""Gap and slope from a continuous record of force–displacement loops, reversal by reversal.

The evaluation of one reversal is in `reversals`. Standard deviations come from the residuals of the lines, pooled over
the reversals of one sense: they contain the noise of the readings and the deviations of the branches from straight
lines. Where the reversals of a sense are inconsistent (χ²), the variance between them is added to that of the mean. In
addition:

- trends: regression of gap and slope on the speed in the gap, and on time;
- repeatability: standard deviation among reversals at the same place after the same motion;
- definitional uncertainty (VIM 2.27): half the range of the means over other windows of the lines. It is common to all
  reversals and not contained in their scatter.

One reversal of a force–displacement loop: two elastic branches as straight lines, and the gap between them.

After a reversal the force decreases along an elastic branch, hardly changes inside the backlash, increases along the
other elastic branch, and reaches a plateau where the joint slips. With distance d since the reversal and force f, both
positive along the new motion:

- the level is the force inside the backlash, where f changes least over a share `_FLAT` of the way up; friction and the
  sensor's zero make it differ from 0. Both lines are extended to it. There is one level per loop and sense.
- each branch is the straight line d = a + p f through the samples within a window of force, given by two shares of the
  way from the level to the plateau; p of the branch after the gap is the compliance.
- the gap is the distance between both lines at the level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.signal import find_peaks

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.statistics import CombinedEstimate, Estimate, combine_estimates

_FLAT = 1 / 6
"""Share of the way up over which the smallest change of the force is sought."""
_RISEN = 0.75
"""Share of the plateau at which the way up ends."""
PROMINENCE = 0.03
"""Smallest prominence of a reversal, as a share of the range of the displacement."""
_FEWEST_SAMPLES = 2
"""Samples needed for a line; its uncertainty comes from the scatter pooled over all reversals of its sense."""
_COVERED = 0.6
"""Share of a window that the samples must cover."""
_SLIPPED = 0.6
"""Share of the plateau that the force must have reached before a reversal; otherwise it is not a full loop."""


class Reversal(NamedTuple):
    """One reversal.

    Attributes:
        time: s.
        displacement: where, m.
        sense: +1 if the displacement rises afterwards.
        speed: in the middle of the gap, m/s.
        force: at the reversal, positive along the motion before it, N.
        gap: m.
        compliance: after the gap, m/N.
        unloading: compliance before the gap, m/N.
        samples: number in the windows before and after the gap.
        crossings: distances from the reversal at which both lines meet the level, m.
    """

    time: float
    displacement: float
    sense: int
    speed: float
    force: float
    gap: Estimate
    compliance: Estimate
    unloading: Estimate
    samples: tuple[int, int]
    crossings: tuple[float, float]


class Sweep(NamedTuple):
    """The samples from one reversal to the next.

    Attributes:
        time: (n,), s.
        distance: since the reversal, (n,), m.
        force: positive along the motion, (n,), N.
        place: displacement at the reversal, m.
        sense: of the motion, +1 or -1.
    """

    time: Floats
    distance: Floats
    force: Floats
    place: float
    sense: int


class Line(NamedTuple):
    """The line d = a + p (f - level): a, p, their unscaled covariance, residual sum of squares, number of samples."""

    a: float
    p: float
    unscaled: Floats
    rss: float
    samples: int


def find_sweeps(time: Floats, displacement: Floats, force: Floats) -> list[Sweep]:
    """The record cut at the reversals, without what comes before the first."""
    least = PROMINENCE * float(np.ptp(displacement))
    peaks = [find_peaks(sign * displacement, prominence=least)[0] for sign in (1, -1)] if least > 0 else [[], []]
    turns = np.sort(np.concatenate(peaks)).astype(int)
    sweeps = []
    for first, last in zip(turns, [*turns[1:], len(time) - 1][: len(turns)], strict=True):
        rows = slice(first, last + 1)
        sense = 1 if displacement[last] > displacement[first] else -1
        distance, along = sense * (displacement[rows] - displacement[first]), sense * force[rows]
        sweeps.append(Sweep(time[rows], distance, along, float(displacement[first]), sense))
    return sweeps


def find_plateau(sweeps: list[Sweep]) -> float:
    """Force of slip, N: the median over the sweeps of the median over the second half of each."""
    medians = [float(np.median(s.force[s.distance > s.distance[-1] / 2])) for s in sweeps if s.distance[-1] > 0]
    return float(np.median(medians)) if medians else np.nan


def find_level(sweep: Sweep, plateau: float) -> float:
    """Force inside the backlash, N: where it changes least on the way up to the plateau."""
    risen = np.flatnonzero(sweep.force >= _RISEN * plateau)
    if not len(risen) or risen[0] < 2:
        return np.nan
    grid = np.linspace(0.0, sweep.distance[risen[0]], 601)
    force = np.interp(grid, np.maximum.accumulate(sweep.distance[: risen[0] + 1]), sweep.force[: risen[0] + 1])
    width = int(_FLAT * len(grid))
    start = int(np.argmin(force[width:] - force[:-width]))
    return float(force[start : start + width + 1].mean())


def fit_pair(
    sweep: Sweep, level: float, bottom: float, top: float, window: tuple[float, float]
) -> tuple[Line, Line] | str:
    """The lines before and after the gap, or the reason why they cannot be fitted."""
    if not bottom < level < top:
        return 'no gap between two branches'
    if sweep.force[0] > _SLIPPED * bottom:
        return 'no full loop: the force before it did not reach the plateau'
    first = np.flatnonzero(sweep.force > level + window[1] * (top - level))
    rise = slice(0, int(first[0])) if len(first) else slice(0, len(sweep.force))
    pair = []
    for end, name in ((bottom, 'before'), (top, 'after')):
        part = (sweep.force[rise] - level) / (end - level)
        rows = np.flatnonzero((part >= window[0]) & (part <= window[1]))
        if len(rows) < _FEWEST_SAMPLES:
            return f'{len(rows)} samples on the elastic branch {name} the gap'
        if np.ptp(part[rows]) < _COVERED * (window[1] - window[0]) * (1 - 1 / len(rows)):
            return f'the branch {name} the gap is not complete'
        pair.append(_line(sweep.force[rise][rows] - level, sweep.distance[rise][rows]))
    return pair[0], pair[1]


def _line(force: Floats, distance: Floats) -> Line:
    design = np.stack([np.ones_like(force), force], axis=1)
    basis, triangle = np.linalg.qr(design)
    inverse = np.linalg.inv(triangle)
    a, p = inverse @ (basis.T @ distance)
    residual = distance - basis @ (basis.T @ distance)
    return Line(float(a), float(p), inverse @ inverse.T, float(residual @ residual), len(force))


def pooled(lines: list[Line]) -> float:
    """Standard deviation of the residuals of several lines, m; NaN without degrees of freedom."""
    dof = sum(line.samples - 2 for line in lines)
    return float(np.sqrt(sum(line.rss for line in lines) / dof)) if dof > 0 else np.nan


def as_reversal(sweep: Sweep, before: Line, after: Line, sigma: tuple[float, float]) -> Reversal:
    """Gap and slopes of a sweep from its lines; `sigma`: residual standard deviation before and after the gap, m."""
    scale = np.array(sigma)
    std = np.sqrt(np.array([np.diag(before.unscaled), np.diag(after.unscaled)])) * scale[:, None]
    middle = (before.a + after.a) / 2
    speed = np.interp(middle, np.maximum.accumulate(sweep.distance), np.gradient(sweep.distance, sweep.time))
    return Reversal(
        time=float(sweep.time[0]),
        displacement=sweep.place,
        sense=sweep.sense,
        speed=float(speed),
        force=-float(sweep.force[0]),
        gap=Estimate(after.a - before.a, float(np.hypot(*std[:, 0]))),
        compliance=Estimate(after.p, float(std[1, 1])),
        unloading=Estimate(before.p, float(std[0, 1])),
        samples=(before.samples, after.samples),
        crossings=(before.a, after.a),
    )


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
