"""What the residual of a law depends on.

In loops: curves fitted to half of the cycles, tested on the other half. The residual of the odd cycles is
averaged in bins of a variable; this curve predicts the residual of the even cycles, and the other way round. The share
of the squared residual that it explains measures the dependence. The p-value is that of a one-sided t-test of the
correlation between residual and curve over the sweeps (the smaller of both halves, doubled). It assumes that for a
sufficient law the residuals of different sweeps are independent with a symmetric distribution; within a sweep they may
be correlated. What drives alone cannot explain hysteresis: where a variable explains more together with the sense of
the motion, no elastic law is sufficient.

Under a load from rest to rest: from means of half a second, in which vibrations average out.

- memory: the residual at rest after the load less that before it. The load is the same, so a law without memory
  predicts zero. t-test of the block means of each record.
- load, time under load: slopes of the residual of the blocks under load, from one regression of each record. t-tests
  with the effective number of independent blocks.

Differences count against their scatter and 1 % of the range of the response: no law holds better where the load goes
through zero.

The detection limit is the share of the squared residual that a test would have found with a probability of `POWER`,
from the scatter that it met. The p-values of the records are combined by Fisher's method, -2 Σ ln p ~ χ² with twice as
many degrees of freedom as records, so that evidence adds up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.loops.fit import effective_count
from scara_kinetostatic.studies.loops.record import (
    FEWEST_ROWS,
    LEVEL,
    LOAD,
    MOTION,
    UNLOADED_BELOW,
    RecordPath,
    block_means,
)

_BINS = 16
POWER = 0.9
_Test = tuple[float, float, float]
_UNTESTED = float('nan'), 0.0, 0.0
_OF_LOOPS = {
    MOTION: ('displacement', 'displacement_sense', 'speed', 'distance_sense', 'time'),
    LOAD: ('load', 'load_sense', 'speed', 'distance_sense', 'time'),
}
"""By what drives; with the sense of the motion or not."""
_OF_LOAD = ('memory', 'load', 'time')
VARIABLES = {
    'displacement': 'the {response}',
    'displacement_sense': 'the {response} and the sense of motion',
    'speed': 'the speed',
    'distance_sense': 'the distance since the reversal and the sense of motion',
    'time': 'the time',
    'memory': 'the load before',
    'load': 'the load',
    'load_sense': 'the load and the sense in which it changes',
}
"""In words; memory: the residual at rest after the load is not that at rest before it."""


class Dependence(NamedTuple):
    """Dependence on one variable.

    Attributes:
        variable: a key of `VARIABLES`.
        share: explained share of the squared residual, for a motion on the half held out; below 0 if it increases.
        p_value: of no dependence, all records together; NaN where it could not be tested.
        detectable_share: share that the test would have found with a probability of `POWER`; NaN likewise.
        p_value_by_record: of each record driven by its load; NaN where it could not be tested.
    """

    variable: str
    share: float
    p_value: float
    detectable_share: float
    p_value_by_record: tuple[float, ...] = ()

    @property
    def is_tested(self) -> bool:
        """Whether it could be tested in any record."""
        return bool(np.isfinite(self.p_value))


def p_independent(found: Sequence[Dependence]) -> float:
    """p-value of no dependence on any variable (Bonferroni)."""
    return min([1.0, *(len(found) * each.p_value for each in found if each.is_tested)])


def dependences(paths: Sequence[RecordPath], residuals: Sequence[Floats], in_loops: bool) -> tuple[Dependence, ...]:
    """Dependence on all variables, in decreasing order of the explained share.

    Args:
        paths: the records as measured.
        residuals: of each, (n,), m or rad; N or Nm where the motion drives.
        in_loops: whether it is tested in loops: a record that is not in loops does not count, nor does a first sweep.
    """
    test = _in_loops if in_loops else _from_rest_to_rest
    tested = [test(path, residual) for path, residual in zip(paths, residuals, strict=True)]
    is_motion, total, found = paths[0].driven_by == MOTION, sum(square for square, _ in tested), []
    for name in _OF_LOOPS[paths[0].driven_by] if in_loops else _OF_LOAD:
        each = [by_variable.get(name, (np.nan, 0.0, 1.0)) for _, by_variable in tested]
        p_values, explained, detectable = zip(*each, strict=True)
        p_value, share = _fisher(p_values), sum(explained) / total if total > 0 else 0.0
        limit = sum(detectable) / total if total > 0 else 0.0
        limit = min(detectable) if in_loops else min(limit, 1.0) if p_value >= 0 else np.nan
        found.append(Dependence(name, share, p_value, limit, () if is_motion else p_values))
    return tuple(sorted(found, key=lambda each: -each.share))


def _fisher(p_values: Sequence[float]) -> float:
    """p-value of all together; NaN where there is none."""
    finite = [p for p in p_values if np.isfinite(p)]
    if len(finite) < 2:
        return finite[0] if finite else float('nan')
    return float(stats.chi2.sf(-2 * np.log(np.maximum(finite, 1e-300)).sum(), 2 * len(finite)))


def _in_loops(path: RecordPath, residual: Floats) -> tuple[float, dict[str, _Test]]:
    """Sum of squares; p-value, explained part of it, and share that would have been found, by variable."""
    if not path.in_loops:
        return 0.0, {}
    rows, odd, found = path.scored, path.sweep // 2 % 2 == 1, {}
    square = float((residual[rows] ** 2).sum())
    for variable in _OF_LOOPS[path.driven_by]:
        word = variable.removesuffix('_sense')
        values: Floats = path.driver if word in ('displacement', 'load') else getattr(path, word)
        steps = _BINS * (values - values.min()) / (np.ptp(values) or 1.0)
        place = np.minimum(steps.astype(np.int64), _BINS - 1)
        place += _BINS * (path.sense > 0) if variable.endswith('_sense') else 0
        unexplained, p_values, detectable = residual.copy(), [], []
        for fitted in (odd & rows, ~odd & rows):
            held_out = rows & ~fitted
            count, total = (
                np.bincount(place[fitted], weights=weights, minlength=2 * _BINS) for weights in (None, residual[fitted])
            )
            curve = (total / np.maximum(count, 1))[place]  # mean of each bin; 0 for an empty one
            unexplained[held_out] -= curve[held_out]
            sums = [
                np.bincount(path.sweep[held_out], weights=values[held_out], minlength=path.sweeps)
                for values in (residual * curve, residual**2, curve**2, np.ones(len(path.time)))
            ]
            size = np.sqrt(sums[1] * sums[2])
            counts = (size > 0) & (sums[3] >= FEWEST_ROWS)
            alike = sums[0][counts] / size[counts]
            p_values.append(p_positive(alike))
            limit = 1.0
            if len(alike) > 1:  # the square of the mean correlation that the test would have found
                quantiles = _quantiles(len(alike) - 1, len(_OF_LOOPS[path.driven_by]))
                limit = min(1.0, float(quantiles**2 * alike.var(ddof=1) / len(alike)))
            detectable.append(limit)
        explained = square - float((unexplained[rows] ** 2).sum())
        found[variable] = min(1.0, 2 * min(p_values)), explained, min(detectable)
    return square, found


def p_positive(values: Floats) -> float:
    """p-value of a mean of zero or less, one-sided t-test."""
    if len(values) < 2 or not np.ptp(values) > 0:
        return 1.0
    return float(stats.ttest_1samp(values, 0.0, alternative='greater').pvalue)


def _from_rest_to_rest(path: RecordPath, residual: Floats) -> tuple[float, dict[str, _Test]]:
    """Sum of squares of the block means less that at rest; p-value, explained and detectable part of it by variable."""
    loaded = path.known & (np.abs(path.smooth) >= UNLOADED_BELOW * path.size)
    before, after = (_blocks(path, residual, rows) for rows in (path.rest, _at_rest_again(path)))
    under_load, loads, times = (_blocks(path, values, loaded) for values in (residual, np.abs(path.driver), path.time))
    rest = before.mean() if len(before) else 0.0
    square = sum(float((means - rest) @ (means - rest)) for means in (before, after, under_load))
    tolerance = 0.01 * float(np.ptp(path.driven))
    slopes = _slopes(under_load, loads, times, tolerance)
    return square, dict(zip(_OF_LOAD, (_difference(before, after, tolerance), *slopes), strict=True))


def _at_rest_again(path: RecordPath) -> Mask:
    """The samples at rest after the load, without 0.25 s of settling, or half of them if that is less."""
    quiet = np.abs(path.smooth) < max(0.05 * path.size, 4.0 * path.record.noise(path.record.load))
    after = np.flatnonzero(~path.known & (np.cumsum(~quiet[::-1])[::-1] == 0))
    settling = min(round(0.25 / float(np.median(np.diff(path.time)))), len(after) // 2)
    return np.isin(np.arange(len(quiet)), after[settling:])


def _blocks(path: RecordPath, values: Floats, rows: Mask) -> Floats:
    """Means of the blocks that lie in rows; a block does not cross an end of a stretch."""
    block = path.long_block(int(rows.sum()))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    found = [block_means(values[first:last], block) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    return np.concatenate([*found, np.empty(0)])


def _quantiles(free: float, tests: int = len(_OF_LOAD)) -> float:
    """Standard deviations of a quantity that one of so many tests, each of them double, would have found."""
    return float(stats.t.isf(LEVEL / (4 * tests), free) + stats.t.isf(1 - POWER, free))


def _difference(before: Floats, after: Floats, tolerance: float) -> _Test:
    """p-value of equal means, and the sums of squares that the difference explains, and that would have been found."""
    if min(len(before), len(after)) < 2:
        return _UNTESTED
    difference = float(after.mean() - before.mean())
    parts = [float(each.var(ddof=1)) / len(each) for each in (before, after)]
    variance = sum(parts) + tolerance**2
    free = variance**2 / max(sum(p**2 / (len(v) - 1) for p, v in zip(parts, (before, after), strict=True)), 1e-300)
    p_value = 2 * float(stats.t.sf(abs(difference) / np.sqrt(variance), min(free, 1e6)))
    found = _quantiles(min(free, 1e6)) ** 2 * variance * len(after)
    return p_value, difference**2 * len(after), found


def _slopes(residual: Floats, load: Floats, time: Floats, tolerance: float) -> list[_Test]:
    """p-values of no slope over load and over time, and the sums of squares as for `_difference`."""
    count = len(residual)
    if count < 6 or not np.ptp(residual) > 0:  # two slopes and their scatter
        return [_UNTESTED] * 2
    design = np.column_stack([np.ones(count), load - load.mean(), time - time.mean()])
    design[:, 1:] /= np.maximum(np.abs(design[:, 1:]).max(axis=0), 1e-300)
    beta, _, rank, _ = np.linalg.lstsq(design, residual, rcond=1e-6)
    if rank < 3:
        return [_UNTESTED] * 2
    left = residual - design @ beta
    free = max(effective_count(left) - 3.0, 1.0) if np.ptp(left) > 0 else count - 3.0
    variance = float(left @ left) / free * np.diagonal(np.linalg.inv(design.T @ design)) + tolerance**2
    sizes = np.diagonal(design.T @ design)
    p_values = 2 * stats.t.sf(np.abs(beta) / np.sqrt(variance), free)
    detectable = _quantiles(free) ** 2 * variance * sizes
    return [(float(p_values[k]), float(beta[k] ** 2 * sizes[k]), float(detectable[k])) for k in (1, 2)]
