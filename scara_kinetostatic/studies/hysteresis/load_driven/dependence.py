"""What the residual of law (6) depends on, from means of half a second, in which vibrations average out.

- memory: the residual at rest after the load less that before it. The load is the same, so a law without memory
  predicts zero. t-test of the block means of each record.
- load, time under load: slopes of the residual of the blocks under load, from one regression of each record. t-tests
  with the effective number of independent blocks.

Differences count against their scatter and `_TOLERANCE`. The p-values of the records are combined by Fisher's method,
-2 Σ ln p ~ χ² with twice as many degrees of freedom as records, so that evidence adds up; the smallest of the three
combined ones counts three times (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.load_driven.record import UNLOADED_BELOW
from scara_kinetostatic.studies.hysteresis.model_selection import effective_count

MEMORY, LOAD, TIME = 'memory', 'load', 'time'
VARIABLES = {
    MEMORY: 'the load before: at rest after loading it is not that at rest before',
    LOAD: 'the load',
    TIME: 'time under load',
}
_FEWEST_LOADED = 6
"""Blocks under load, for two slopes and their scatter."""
_AT_REST = 0.05
"""Loads below this share of the largest, or below 4 standard deviations of the noise, are rest."""
_SETTLING = 0.25
"""Time after the load has come to rest again that does not count, s; at most half of the rest."""
_TOLERANCE = 0.01
"""Standard uncertainty of every difference, as a share of the range of the response: no law holds better where the load
goes through zero."""
_SMALLEST_P = 1e-300


class Dependence(NamedTuple):
    """Dependence on one variable.

    Attributes:
        variable: a key of `VARIABLES`.
        share: part of the sum of squares of the block means, less that at rest, that it explains.
        p_value: of no dependence, all records together.
        by_record: the same of each record; NaN where it could not be tested.
    """

    variable: str
    share: float
    p_value: float
    by_record: tuple[float, ...]

    @property
    def is_tested(self) -> bool:
        """Whether it could be tested in any record; if not, `p_value` is 1."""
        return bool(np.any(np.isfinite(self.by_record)))


def dependences(paths: Sequence[LoadPath], residuals: Sequence[Floats]) -> tuple[Dependence, ...]:
    """Dependence on all variables, in decreasing order of the explained share.

    Args:
        paths: the records as measured.
        residuals: of each record, (n,), m or rad.
    """
    tested = [_record(path, residual) for path, residual in zip(paths, residuals, strict=True)]
    total = sum(each.square for each in tested)
    found = []
    for variable in VARIABLES:
        p_values = tuple(each.p_values[variable] for each in tested)
        explained = sum(each.explained[variable] for each in tested)
        found.append(Dependence(variable, explained / total if total > 0 else 0.0, _fisher(p_values), p_values))
    return tuple(sorted(found, key=lambda each: -each.share))


def p_independent(found: Sequence[Dependence]) -> float:
    """p-value of no dependence on any variable (Bonferroni)."""
    return min(1.0, len(found) * min(each.p_value for each in found))


class _Tested(NamedTuple):
    square: float
    explained: dict[str, float]
    p_values: dict[str, float]


def _record(path: LoadPath, residual: Floats) -> _Tested:
    after = _at_rest_again(path)
    loaded = path.known & (np.abs(path.smooth) >= UNLOADED_BELOW * path.size)
    before_means, after_means = (_blocks(path, residual, rows) for rows in (path.rest, after))
    loaded_means, loads, times = (_blocks(path, values, loaded) for values in (residual, np.abs(path.load), path.time))
    rest = before_means.mean() if len(before_means) else 0.0
    square = sum(float((means - rest) @ (means - rest)) for means in (before_means, after_means, loaded_means))
    tolerance = _TOLERANCE * float(np.ptp(path.response))
    p_memory, memory = _difference(before_means, after_means, tolerance)
    (p_load, load), (p_time, time) = _slopes(loaded_means, loads, times, tolerance)
    return _Tested(square, {MEMORY: memory, LOAD: load, TIME: time}, {MEMORY: p_memory, LOAD: p_load, TIME: p_time})


def _at_rest_again(path: LoadPath) -> Mask:
    """The samples at rest after the load, without the settling."""
    quiet = np.abs(path.smooth) < max(_AT_REST * path.size, 4.0 * path.record.load_noise)
    after = np.flatnonzero(~path.known & (np.cumsum(~quiet[::-1])[::-1] == 0))
    settling = min(round(_SETTLING / float(np.median(np.diff(path.time)))), len(after) // 2)
    return np.isin(np.arange(len(quiet)), after[settling:])


def _blocks(path: LoadPath, values: Floats, rows: Mask) -> Floats:
    """Means of the blocks that lie in rows; a block does not cross an end of a stretch."""
    samples = path.long_block(int(rows.sum()))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    found = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        count = (last - first) // samples
        found.append(values[first : first + count * samples].reshape(count, samples).mean(axis=1))
    return np.concatenate(found) if found else np.empty(0)


def _difference(before: Floats, after: Floats, tolerance: float) -> tuple[float, float]:
    """p-value of equal means, and the sum of squares that the difference explains."""
    if min(len(before), len(after)) < 2:
        return float('nan'), 0.0
    difference = float(after.mean() - before.mean())
    parts = [float(each.var(ddof=1)) / len(each) for each in (before, after)]
    variance = sum(parts) + tolerance**2
    free = variance**2 / max(sum(p**2 / (len(v) - 1) for p, v in zip(parts, (before, after), strict=True)), 1e-300)
    p_value = 2 * float(stats.t.sf(abs(difference) / np.sqrt(variance), min(free, 1e6)))
    return p_value, difference**2 * len(after)


def _slopes(
    residual: Floats, load: Floats, time: Floats, tolerance: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """p-values of no slope over load and over time, and the sums of squares that they explain."""
    count = len(residual)
    if count < _FEWEST_LOADED or not np.ptp(residual) > 0:
        return (float('nan'), 0.0), (float('nan'), 0.0)
    design = np.column_stack([np.ones(count), load - load.mean(), time - time.mean()])
    design[:, 1:] /= np.maximum(np.abs(design[:, 1:]).max(axis=0), 1e-300)
    beta, _, rank, _ = np.linalg.lstsq(design, residual, rcond=1e-6)
    if rank < 3:
        return (float('nan'), 0.0), (float('nan'), 0.0)
    left = residual - design @ beta
    free = max(effective_count(left) - 3.0, 1.0) if np.ptp(left) > 0 else count - 3.0
    variance = float(left @ left) / free * np.diagonal(np.linalg.inv(design.T @ design))
    t_values = np.abs(beta) / np.sqrt(variance + tolerance**2)
    found = [
        (float(2 * stats.t.sf(t_values[k], free)), float(beta[k] ** 2 * design[:, k] @ design[:, k])) for k in (1, 2)
    ]
    return found[0], found[1]


def _fisher(p_values: Sequence[float]) -> float:
    tested = np.array([max(p, _SMALLEST_P) for p in p_values if np.isfinite(p)])
    if not len(tested):
        return 1.0
    return float(stats.chi2.sf(-2 * np.log(tested).sum(), 2 * len(tested)))
