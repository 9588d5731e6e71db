"""Gap and slope from a continuous record of force–displacement loops, reversal by reversal.

After a reversal the force decreases along an elastic branch, hardly changes inside the backlash, increases along the
other elastic branch, and reaches a plateau where the joint slips. With distance d since the reversal and force f, both
positive along the new motion:

- the level is the force inside the backlash, where f changes least on the way up; friction and the sensor's zero make
  it differ from 0. Both lines are extended to it. There is one level per loop and sense.
- each branch is the straight line d = a + p f through the samples within a window of force, given by two shares of the
  way from the level to the plateau; p of the branch after the gap is the compliance.
- the gap is the distance between both lines at the level.

Standard deviations come from the residuals of the lines, pooled over the reversals of one sense: they contain the noise
of the readings and the deviations of the branches from straight lines. Where the reversals of a sense are inconsistent
(χ²), the variance between them is added to that of the mean. The definitional uncertainty (VIM 2.27) is half the range
of the means over other windows of the lines; it is common to all reversals and not contained in their scatter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.loops.estimates import (
    CombinedEstimate,
    Estimate,
    LeastSquares,
    combine_estimates,
    least_squares,
)
from scara_kinetostatic.studies.loops.record import Record, reversals

_WINDOW = (0.15, 0.55)
"""Shares of the way from the level to the plateau between which a branch is fitted by a straight line."""
_OTHER_WINDOWS = ((0.1, 0.5), (0.2, 0.6), (0.1, 0.6), (0.2, 0.5))
"""Windows for the definitional uncertainty."""


class Reversal(NamedTuple):
    """One reversal.

    Attributes:
        time: s.
        displacement: where, m.
        force: at the reversal, positive along the motion before it, N.
        gap: m.
        compliance: slope of the branch after the gap, m/N.
        unloading_compliance: slope of the branch before it, m/N.
        samples: on the branches before and after the gap.
        crossings: distance since the reversal at which the lines before and after the gap meet the level, m.
    """

    time: float
    displacement: float
    force: float
    gap: Estimate
    compliance: Estimate
    unloading_compliance: Estimate
    samples: tuple[int, int]
    crossings: tuple[float, float]


class Rejected(NamedTuple):
    """A reversal that cannot be used: its time, s, and the reason."""

    time: float
    reason: str


class Sense(NamedTuple):
    """All reversals of one sense of a loop.

    Attributes:
        sense: +1 where the displacement rises after the reversal.
        gap_force: force inside the backlash, in the sign of the record, N.
        slip_force: force at which the joint slips, in the sign of the record, N.
        residual_std: standard deviation of the residuals of the branches before and after the gap, m.
        gap: mean over the reversals, with a test of their consistency, m.
        compliance: likewise, m/N.
        reversals: in order.
    """

    sense: int
    gap_force: float
    slip_force: float
    residual_std: tuple[float, float]
    gap: CombinedEstimate
    compliance: CombinedEstimate
    reversals: tuple[Reversal, ...]

    @property
    def name(self) -> str:
        """Of the motion after the reversals."""
        return 'rising' if self.sense > 0 else 'falling'


class LoopAnalysis(NamedTuple):
    """Result of a continuous record: senses with two reversals or more, and reversals not used."""

    record: Record
    senses: tuple[Sense, ...]
    rejected: tuple[Rejected, ...]


class _Sweep(NamedTuple):
    """The samples from one reversal to the next: distance since the reversal, m, and force, positive along the motion,
    N, (n,) each; time, s, and displacement, m, at the reversal; sense of the motion, +1 or -1.
    """

    distance: Floats
    force: Floats
    time: float
    displacement: float
    sense: int


def analyse_loops(record: Record) -> LoopAnalysis:
    """Gap and slope at the reversals of a continuous record.

    Raises:
        UnsupportedDataError: no sense has two reversals that can be used.
    """
    sweeps, rejected = list(_sweeps(record)), list[Rejected]()
    senses = _analyse(sweeps, _WINDOW, rejected)
    if not senses:
        why = f': {rejected[0].reason}' if rejected else ''
        problem = f'{record.source}: no two reversals of a sense have a gap between two elastic branches{why}'
        raise UnsupportedDataError(problem, 'record more full loops, at a higher sampling rate')
    others = [each for window in _OTHER_WINDOWS for each in _analyse(sweeps, window, [])]
    for k, sense in enumerate(senses):
        same = [sense, *(each for each in others if each.sense == sense.sense)]
        for name in ('gap', 'compliance') if len(same) > 1 else ():
            spread = float(np.ptp([getattr(each, name).value for each in same])) / 2
            widened = getattr(sense, name)._replace(definitional_uncertainty=spread)
            senses[k] = senses[k]._replace(**{name: widened})
    return LoopAnalysis(record, tuple(senses), tuple(sorted(rejected)))


def _sweeps(record: Record) -> Iterator[_Sweep]:
    """The record cut at the reversals, without what comes before the first."""
    for first, last in pairwise([*reversals(record.response).tolist(), len(record) - 1]):
        displacement = record.response[first : last + 1]
        sense = 1 if displacement[-1] > displacement[0] else -1
        distance, along = sense * (displacement - displacement[0]), sense * record.load[first : last + 1]
        yield _Sweep(distance, along, float(record.time[first]), float(displacement[0]), sense)


def _analyse(sweeps: Sequence[_Sweep], window: tuple[float, float], rejected: list[Rejected]) -> list[Sense]:
    """Result for each sense, with lines fitted within a window; the reversals that are not used are added."""
    by_sense = {sense: [sweep for sweep in sweeps if sweep.sense == sense] for sense in (1, -1)}
    plateaus = {sense: _plateau(own) for sense, own in by_sense.items()}
    senses: list[Sense] = []
    for sense, own in by_sense.items() if np.isfinite(sum(plateaus.values())) else ():
        levels = np.array([_level(sweep, plateaus[sense]) for sweep in own])
        level = float(np.nanmedian(levels)) if np.any(np.isfinite(levels)) else np.nan
        pairs = [_fit_pair(sweep, level, -plateaus[-sense], plateaus[sense], window) for sweep in own]
        rejected += [
            Rejected(sweep.time, pair) for sweep, pair in zip(own, pairs, strict=True) if isinstance(pair, str)
        ]
        used = [(sweep, pair) for sweep, pair in zip(own, pairs, strict=True) if not isinstance(pair, str)]
        lines = [*zip(*(pair for _, pair in used), strict=True)]
        dof = [sum(line.dof for line in several) for several in lines]
        if len(used) < 2 or not all(dof):
            rejected += [Rejected(sweep.time, 'too few reversals of its sense') for sweep, _ in used]
            continue
        rss = [sum(float(line.residual @ line.residual) for line in several) for several in lines]
        sigma = float(np.sqrt(rss[0] / dof[0])), float(np.sqrt(rss[1] / dof[1]))
        found = tuple(_as_reversal(*each, sigma) for each in used)
        gap, compliance = (
            combine_estimates([getattr(each, name) for each in found], dof[1]) for name in ('gap', 'compliance')
        )
        senses.append(Sense(sense, sense * level, sense * plateaus[sense], sigma, gap, compliance, found))
    return senses


def _plateau(sweeps: Sequence[_Sweep]) -> float:
    """Force of slip, N: the median over the sweeps of the median over the second half of each."""
    medians = [float(np.median(s.force[s.distance > s.distance[-1] / 2])) for s in sweeps if s.distance[-1] > 0]
    return float(np.median(medians)) if medians else np.nan


def _level(sweep: _Sweep, plateau: float) -> float:
    """Force inside the backlash, N: where it changes least over a sixth of the way up to 75 % of the plateau."""
    risen = np.flatnonzero(sweep.force >= 0.75 * plateau)
    if not len(risen) or risen[0] < 2:
        return np.nan
    grid = np.linspace(0.0, sweep.distance[risen[0]], 601)
    force = np.interp(grid, np.maximum.accumulate(sweep.distance[: risen[0] + 1]), sweep.force[: risen[0] + 1])
    width = len(grid) // 6
    start = int(np.argmin(force[width:] - force[:-width]))
    return float(force[start : start + width + 1].mean())


def _fit_pair(
    sweep: _Sweep, level: float, bottom: float, top: float, window: tuple[float, float]
) -> tuple[LeastSquares, LeastSquares] | str:
    """The lines before and after the gap, or the reason why they cannot be fitted."""
    if not bottom < level < top:
        return 'no gap between two branches'
    if sweep.force[0] > 0.6 * bottom:
        return 'no full loop: the force before it did not reach the plateau'
    first = np.flatnonzero(sweep.force > level + window[1] * (top - level))
    force = sweep.force[: first[0]] if len(first) else sweep.force
    pair = []
    for end, name in ((bottom, 'before'), (top, 'after')):
        share = (force - level) / (end - level)
        rows = np.flatnonzero((share >= window[0]) & (share <= window[1]))
        if len(rows) < 2:
            return f'{len(rows)} samples on the elastic branch {name} the gap'
        if np.ptp(share[rows]) < 0.6 * (window[1] - window[0]) * (1 - 1 / len(rows)):
            return f'the branch {name} the gap is not complete'
        pair.append(least_squares(np.stack([np.ones(len(rows)), force[rows] - level], axis=1), sweep.distance[rows]))
    return pair[0], pair[1]


def _as_reversal(sweep: _Sweep, pair: tuple[LeastSquares, LeastSquares], sigma: Sequence[float]) -> Reversal:
    """Gap and slopes of a sweep from its lines; `sigma`: residual standard deviation before and after the gap, m."""
    before, after = (line._replace(sigma=std) for line, std in zip(pair, sigma, strict=True))
    begins, slope = np.eye(2)
    start, end = before.of(begins, 'm'), after.of(begins, 'm')
    return Reversal(
        time=sweep.time,
        displacement=sweep.displacement,
        force=-float(sweep.force[0]),
        gap=end.plus(-start.value, start.std),
        compliance=after.of(slope, 'm/N'),
        unloading_compliance=before.of(slope, 'm/N'),
        samples=(len(before.residual), len(after.residual)),
        crossings=(start.value, end.value),
    )
