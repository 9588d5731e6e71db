"""Selection of a law by cross-validation: fitted to a part of the data, tested on the rest.

Of a single record either half of its loops is predicted by a fit to the other one; from rest to rest, the later half
from the earlier one. Driven by its motion it is judged by itself, by all samples but those of the first sweep; driven
by its load, by the later half. Standard deviations: delete-one-cycle jackknife, since residuals within a cycle are
correlated; delete-one-sweep of a load, as few of its cycles are large.

Driven by their load, several records of one joint are judged together: each is predicted with the parameters fitted to
all others; its own samples, up to `Record.judged_from`, give only its zero and its initial state of friction. Standard
deviations: delete-one-record jackknife.

**Two laws** are compared in loops sweep by sweep, in a single record over both halves: a one-sided t-test of the
logarithms of the ratios of their mean squares, which assumes independent sweeps and normal logarithms. From rest to
rest they are compared on the held-out residuals in blocks of `SMOOTHING` from the load's coming on: a one-sided
Pitman-Morgan test of the variances of two correlated residuals, with the effective number of independent blocks. A
record with a load far beyond those of all others is not compared: they do not determine its prediction.

**A candidate** is accepted if it predicts better than law (6) in the rms and in BIC, and one of them does so in the
test at half of the level, shared among the candidates (Bonferroni): once law (6) is rejected, all that are better
compete. BIC counts the effective number of samples n / (1 + 2 Σρ), ρ being the autocorrelations of the residual of the
law that fits best. The accepted candidate with the smallest BIC is selected, of several forms of one effect the
simplest within 2; its rivals are the accepted ones of other effects that do not predict significantly worse.

**Law (6) is sufficient** if no candidate is accepted, its residual depends on no variable (the other half of the
level), and its error is below `MATERIAL` of the range, or each such test would have found a share of 50 %
of the squared residual and no candidate has a held-out error below 80 % of its own; otherwise the records
decide nothing. Below `MATERIAL` only a dependence counts against law (6): a candidate may be better by the form alone
that its gap has near zero load.

**What the residual of a law depends on.** In loops: curves fitted to half of the cycles, tested on the other half. The
residual of the odd cycles is averaged in bins of a variable; this curve predicts the residual of the even cycles, and
the other way round. The share of the squared residual that it explains measures the dependence. The p-value is that of
a one-sided t-test of the correlation between residual and curve over the sweeps (the smaller of both halves, doubled).
It assumes that for a sufficient law the residuals of different sweeps are independent with a symmetric distribution;
within a sweep they may be correlated. What drives alone cannot explain hysteresis: where a variable explains more
together with the sense of the motion, no elastic law is sufficient.

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
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.errors import RecordingError, UnsupportedDataError
from scara_kinetostatic.model.arrays import TINY, Floats, Mask, effective_count, rms
from scara_kinetostatic.studies.loops.fit import FitSamples, FittedLaw, PredictedRecord, evaluate, fit_law, predict
from scara_kinetostatic.studies.loops.laws import FAMILIES, PARAMETERS, RecordLaw
from scara_kinetostatic.studies.loops.record import FEWEST_ROWS, LEVEL, LOAD, MOTION, Record, RecordPath, block_means

_BINS, _ROUNDING = 16, 1e-12
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


class ResidualDependence(NamedTuple):
    """Dependence on one variable.

    Attributes:
        variable: a key of `VARIABLES`.
        share: explained share of the squared residual, for a motion on the half held out; below 0 if it increases.
        p_value: of no dependence, all records together; NaN where it could not be tested.
        detectable_share: share that the test would have found with a probability of `POWER`; NaN likewise.
    """

    variable: str
    share: float
    p_value: float
    detectable_share: float

    @property
    def is_tested(self) -> bool:
        """Whether it could be tested in any record."""
        return bool(np.isfinite(self.p_value))


def p_independent(found: Sequence[ResidualDependence]) -> float:
    """p-value of no dependence on any variable (Bonferroni)."""
    return min([1.0, *(len(found) * each.p_value for each in found if each.is_tested)])


def _fisher(p_values: Sequence[float]) -> float:
    """p-value of all together; NaN where there is none."""
    finite = [p for p in p_values if np.isfinite(p)]
    if len(finite) < 2:
        return finite[0] if finite else float('nan')
    return float(stats.chi2.sf(-2 * np.log(np.maximum(finite, TINY)).sum(), 2 * len(finite)))


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
            count, total = (np.bincount(place[fitted], w, 2 * _BINS) for w in (None, residual[fitted]))
            curve = (total / np.maximum(count, 1))[place]  # mean of each bin; 0 for an empty one
            unexplained[held_out] -= curve[held_out]
            terms = (residual * curve, residual**2, curve**2, np.ones(len(path.time)))
            sums = [np.bincount(path.sweep[held_out], values[held_out], path.sweeps) for values in terms]
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
    # at rest after the load, without 0.25 s of settling, or half of the samples if that is less
    quiet = np.abs(path.smooth) < max(0.05 * path.size, 4.0 * path.record.noise(path.record.load))
    later = np.flatnonzero(~path.known & (np.cumsum(~quiet[::-1])[::-1] == 0))
    settling = min(round(0.25 / float(np.median(np.diff(path.time)))), len(later) // 2)
    at_rest_again = np.isin(np.arange(len(quiet)), later[settling:])
    before, after = (_blocks(path, residual, rows) for rows in (path.rest, at_rest_again))
    under_load, loads, times = (
        _blocks(path, values, path.loaded) for values in (residual, np.abs(path.driver), path.time)
    )
    rest = before.mean() if len(before) else 0.0
    square = sum(float((means - rest) @ (means - rest)) for means in (before, after, under_load))
    tolerance = 0.01 * float(np.ptp(path.driven))
    slopes = _slopes(under_load, loads, times, tolerance)
    return square, dict(zip(_OF_LOAD, (_difference(before, after, tolerance), *slopes), strict=True))


def _blocks(path: RecordPath, values: Floats, rows: Mask) -> Floats:
    """Means of the blocks that lie in rows; a block does not cross an end of a stretch."""
    block = path.long_block(int(rows.sum()))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    found = [block_means(values[first:last], block) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    return np.concatenate([*found, np.empty(0)])


def _quantiles(free: float, tests: int = len(_OF_LOAD)) -> float:
    """Standard deviations of a quantity that one of so many tests, each of them double, would have found."""
    return float(stats.t.isf(LEVEL / (4 * tests), free) + stats.t.isf(1 - POWER, free))


def _tested(found: float, variance: float, free: float, size: float) -> _Test:
    """p-value of a quantity being 0, and the sums of squares, `size` times its square, that it explains, and that would
    have been found.
    """
    p_value = 2 * float(stats.t.sf(abs(found) / np.sqrt(variance), free))
    return p_value, found**2 * size, _quantiles(free) ** 2 * variance * size


def _difference(before: Floats, after: Floats, tolerance: float) -> _Test:
    """Of equal means."""
    if min(len(before), len(after)) < 2:
        return _UNTESTED
    parts = [float(each.var(ddof=1)) / len(each) for each in (before, after)]
    variance = sum(parts) + tolerance**2
    free = variance**2 / max(sum(p**2 / (len(v) - 1) for p, v in zip(parts, (before, after), strict=True)), TINY)
    return _tested(float(after.mean() - before.mean()), variance, min(free, 1e6), len(after))


def _slopes(residual: Floats, load: Floats, time: Floats, tolerance: float) -> list[_Test]:
    """Of no slope over load and over time."""
    count = len(residual)
    if count < 6 or not np.ptp(residual) > 0:  # two slopes and their scatter
        return [_UNTESTED] * 2
    design = np.column_stack([np.ones(count), load - load.mean(), time - time.mean()])
    design[:, 1:] /= np.maximum(np.abs(design[:, 1:]).max(axis=0), TINY)
    beta, _, rank, _ = np.linalg.lstsq(design, residual, rcond=1e-6)
    if rank < 3:
        return [_UNTESTED] * 2
    left, squares = residual - design @ beta, design.T @ design
    free = max(effective_count(left) - 3.0, 1.0) if np.ptp(left) > 0 else count - 3.0
    variance = float(left @ left) / free * np.diagonal(np.linalg.inv(squares)) + tolerance**2
    return [_tested(float(beta[k]), float(variance[k]), free, float(squares[k, k])) for k in (1, 2)]


BIC_GAIN = 2.0
"""Smallest decrease of BIC that is evidence."""
MATERIAL = 0.05
"""Held-out error of law (6) over the range of what is predicted, below which only a dependence counts against it."""
NONE, EXPLAINED, AMBIGUOUS, UNEXPLAINED, UNDECIDED = 'none', 'explained', 'ambiguous', 'unexplained', 'undecided'


class UncertainValue(NamedTuple):
    """A value with its standard deviation, in an SI unit."""

    value: float
    std: float
    unit: str = ''

    def over(self, divisor: float, unit: str = '') -> UncertainValue:
        """Divided by a number above 0, which may change the unit; a gap over 2 is the g of (6) and (7)."""
        return UncertainValue(self.value / divisor, self.std / divisor, unit or self.unit)

    def plus(self, value: float, std: float) -> UncertainValue:
        """With an independent quantity of the same unit added."""
        return self._replace(value=self.value + value, std=float(np.hypot(self.std, std)))


class TestedLaw(NamedTuple):
    """A law on the records.

    Attributes:
        law: the law.
        whole: fitted to all samples.
        along: the law so fitted along each record.
        held_out: each record predicted by fits that have not seen what is judged.
        fitted_rms: rms residual of what was fitted, of the samples judged.
        held_out_rms: the same of what was held out.
        parameters: with standard deviations; NaN where there are none.
        p_gain: p-value of no better prediction than that of law (6); NaN for law (6).
        bic: difference in BIC to law (6); NaN for law (6).
        accepted: whether it is better by all criteria.
    """

    law: RecordLaw
    whole: FittedLaw
    along: tuple[PredictedRecord, ...]
    held_out: tuple[PredictedRecord, ...]
    fitted_rms: float
    held_out_rms: float
    parameters: dict[str, UncertainValue]
    p_gain: float = float('nan')
    bic: float = float('nan')
    accepted: bool = False


class Study:
    """One record driven by its motion, or records of one joint driven by their load.

    Attributes:
        records: the records.
        driven_by: `MOTION` or `LOAD`.
        paths: of each record, as measured.
        blocks: the same as means of blocks, for fits.
        judged: the samples for the errors, of each path.
        in_loops: whether any record is: what is tested sweep by sweep is tested in these.
        direction: +1 or -1: sign of what is driven under a positive driver.
        laws: compared with law (6); those of what drives unless told.

    Raises:
        RecordingError: the response of a record changes in the opposite sense of the others.
        UnsupportedDataError: a record is not of full loops, or does not go from rest to rest.
    """

    def __init__(
        self, records: Sequence[Record], driven_by: str = LOAD, laws: Sequence[RecordLaw] | None = None
    ) -> None:
        self.records, self.driven_by = tuple(records), driven_by
        self.paths = tuple(RecordPath(record, driven_by) for record in records)
        self.blocks = [RecordPath(record, driven_by, in_blocks=True) for record in records]
        self.size = max(path.size for path in self.paths)
        joint = sum(float(np.dot(p.driven - p.driven.mean(), p.driver - p.driver.mean())) for p in self.blocks)
        self.direction = 1.0 if joint >= 0 else -1.0
        for path in (*self.paths, *self.blocks):
            path.direction = self.direction
        check_sense(self.blocks)
        self.is_single = len(records) == 1
        self.in_loops = any(path.in_loops for path in self.paths)
        if driven_by == MOTION:
            self.judged = tuple(path.scored for path in self.paths)
        else:
            self.judged = tuple(~path.earlier if self.is_single else ~path.known for path in self.paths)
        self._forms, self._gap_forms, own = FAMILIES[driven_by]
        self.laws = tuple(own if laws is None else laws)

    def law6(self) -> tuple[TestedLaw, tuple[ResidualDependence, ...], float]:
        """Law (6), the dependence of its residual in the form that leaves least, its p-value without memory.

        The best form of a gap that keeps its place is added to the laws that are compared.

        Raises:
            UnsupportedDataError: law (6) cannot be tested in any record.
        """
        law, without = self._best_form(self._forms)
        found = without
        if self._gap_forms:
            gap, with_memory = self._best_form(self._gap_forms)
            found = max(without, with_memory, key=p_independent)
            self.laws = (gap, *self.laws)
        if not any(each.is_tested for each in found):
            problem = 'the load neither comes back to rest nor lasts long enough for a test of law (6)'
            remedy = 'record some seconds at rest after the load'
            raise UnsupportedDataError(f'{self.records[0].source}: {problem}', remedy)
        return self.candidate(law), found, p_independent(without)

    def _best_form(self, laws: Sequence[RecordLaw]) -> tuple[RecordLaw, tuple[ResidualDependence, ...]]:
        """Of several forms the one of the least squares, and the dependence of that which explains best."""
        fits = [fit_law(self._moments(law)) for law in laws]
        found = [self.dependences(self._along(fitted)) for fitted in fits]
        return min(fits, key=lambda each: each.square).law, max(found, key=p_independent)

    def candidate(self, law: RecordLaw) -> TestedLaw:
        """The law fitted to all records and held out from each."""
        moments = self._moments(law)
        whole = fit_law(moments)
        fits = []
        for k in () if self.is_single else range(len(moments)):
            warm_start = whole._replace(states=np.delete(whole.states, k))
            fits.append(fit_law(moments[:k] + moments[k + 1 :], warm_start))
        held_out = tuple(predict(each, path, path.known) for each, path in zip(fits, self.paths, strict=False))
        held_out, along = held_out or (self._halves(law),), self._along(whole)
        parameters = self._with_std(whole, fits)
        return TestedLaw(law, whole, along, held_out, self._rms(along), self._rms(held_out), parameters)

    def _halves(self, law: RecordLaw) -> PredictedRecord:
        """Each half of a single record predicted by a fit to the other one; from rest to rest the later one alone."""
        (path,), (block,) = self.paths, self.blocks
        pairs = zip(block.halves, path.halves, strict=True)
        found = [predict(fit_law([FitSamples(law, block, rows, self.size)]), path, known) for rows, known in pairs]
        return found[0]._replace(residual=np.where(path.earlier, found[-1].residual, found[0].residual))

    def with_std(self, candidate: TestedLaw) -> TestedLaw:
        """Parameters with their standard deviations; of several records they are there."""
        if not (self.is_single and self.in_loops):
            return candidate
        (path,), (block,), whole = self.paths, self.blocks, candidate.whole
        parts = block.sweep // 2 if path.driven_by == MOTION else block.sweep
        kept = [FitSamples(candidate.law, block, parts != each, self.size) for each in np.unique(parts)]
        return candidate._replace(parameters=self._with_std(whole, [fit_law([one], whole, near=True) for one in kept]))

    def dependences(self, along: Sequence[PredictedRecord]) -> tuple[ResidualDependence, ...]:
        """Dependence of the residual along the records on all variables, in decreasing order of the explained share.

        Where any record is in loops, one that is not does not count, nor does a first sweep.
        """
        test, names = (_in_loops, _OF_LOOPS[self.driven_by]) if self.in_loops else (_from_rest_to_rest, _OF_LOAD)
        tested = [test(path, each.residual) for path, each in zip(self.paths, along, strict=True)]
        total, found = sum(square for square, _ in tested), []
        for name in names:
            each = [by_variable.get(name, (np.nan, 0.0, 1.0)) for _, by_variable in tested]
            p_values, explained, detectable = zip(*each, strict=True)
            p_value, share = _fisher(p_values), sum(explained) / total if total > 0 else 0.0
            limit = sum(detectable) / total if total > 0 else 0.0
            limit = min(detectable) if self.in_loops else min(limit, 1.0) if p_value >= 0 else np.nan
            found.append(ResidualDependence(name, share, p_value, limit))
        return tuple(sorted(found, key=lambda each: -each.share))

    def p_better(self, one: TestedLaw, other: TestedLaw) -> float:
        """p-value of one law predicting no better than another."""
        if not self.in_loops:
            return self._p_by_blocks(one, other)
        ratios = []  # from the mean squares of the sweeps of the records in loops
        for path, *both in zip(self.paths, one.held_out, other.held_out, strict=True):
            if path.in_loops:
                rows = path.scored if self.is_single else ~path.known
                size = np.bincount(path.sweep[rows], minlength=path.sweeps)
                tiny, enough = _ROUNDING * float(np.ptp(path.driven)) ** 2 * size, size >= FEWEST_ROWS
                squares = (np.bincount(path.sweep[rows], each.residual[rows] ** 2, path.sweeps) for each in both)
                better, worse = (each[enough] + tiny[enough] for each in squares)
                ratios.append(np.log(worse / better))
        return p_positive(np.concatenate(ratios))

    def _p_by_blocks(self, one: TestedLaw, other: TestedLaw) -> float:
        """From rest to rest, by Pitman and Morgan's test."""
        rows = [~path.earlier if self.is_single else ~path.rest for path in self.paths]
        sizes = sorted(path.size for path in self.paths)  # a load far beyond those of all others is left out
        compared = [k for k, path in enumerate(self.paths) if self.is_single or path.size <= 1.5 * sizes[-2]]
        in_blocks = [self._in_blocks([part.residual for part in each.held_out], rows) for each in (one, other)]
        residuals = [[parts[k] for k in compared] for parts in in_blocks]
        smaller, larger = map(np.concatenate, residuals)
        count = min(sum(effective_count(part, 0.0) for part in each) for each in residuals)
        total, difference = smaller + larger, larger - smaller
        norm = float(np.sqrt((total @ total) * (difference @ difference)))
        if not norm > 0 or count <= 3:
            return 1.0
        correlation = min(max(float(total @ difference) / norm, -1 + _ROUNDING), 1 - _ROUNDING)
        return float(stats.t.sf(correlation * np.sqrt((count - 2) / (1 - correlation**2)), count - 2))

    def misfit(self, candidate: TestedLaw) -> str:
        """In loops of several records, the one on which the law of all errs most beside a law of its own, in words;
        empty where it errs on each by less than 5 % of its range, or less than 2.5 times as much.
        """
        found = list[tuple[float, str]]()
        parts = zip(self._moments(candidate.law), self.paths, candidate.along, candidate.whole.states, strict=True)
        for part, path, along, state in parts if self.in_loops and not self.is_single else ():
            own = fit_law([part], candidate.whole._replace(states=np.array([state])), near=True)
            alone, together = rms(predict(own, path, path.known).residual), rms(along.residual)
            if together > max(2.5 * alone, MATERIAL * np.ptp(path.driven)):
                found.append((together / alone, path.record.source))
        if not found:
            return ''
        ratio, source = max(found)
        return (
            f'On {source} the law of all records errs {ratio:.1f} times as much as one of its own: '
            f'are they of one joint? What is predicted may err as much.'
        )

    def fitted_blocks(self, candidate: TestedLaw) -> list[Floats]:
        """Residuals of the fit to all records, of a load from its coming on, as means of blocks."""
        found = []
        for state, path in zip(candidate.whole.states.tolist(), self.paths, strict=True):
            residual = path.driven - evaluate(candidate.whole, path, state)
            found.append(residual - residual.mean())
        rows = [path.scored if self.driven_by == MOTION else ~path.rest for path in self.paths]
        return self._in_blocks(found, rows)

    def _with_std(self, whole: FittedLaw, without: Sequence[FittedLaw]) -> dict[str, UncertainValue]:
        """Parameters with their standard deviations from the fits without one part each; NaN without fits."""
        share, found = (len(without) - 1) / max(len(without), 1), {}
        for name, value in whole.reported.items():
            several = np.array([each.reported[name] for each in without])
            std = float(np.sqrt(share * ((several - several.mean()) ** 2).sum())) if without else np.nan
            found[name] = UncertainValue(value, std, self.records[0].unit(PARAMETERS[name][1]))
        return found

    def _moments(self, law: RecordLaw) -> list[FitSamples]:
        return [FitSamples(law, block, np.ones(len(block.time), dtype=bool), self.size) for block in self.blocks]

    def _along(self, fitted: FittedLaw) -> tuple[PredictedRecord, ...]:
        return tuple(predict(fitted, path, path.known) for path in self.paths)

    def _rms(self, predictions: Sequence[PredictedRecord]) -> float:
        return rms(np.concatenate([each.residual[rows] for each, rows in zip(predictions, self.judged, strict=True)]))

    def _in_blocks(self, residuals: Sequence[Floats], rows: Sequence[Mask]) -> list[Floats]:
        parts = zip(residuals, self.blocks, rows, strict=True)
        return [block_means(residual[which], block.block) for residual, block, which in parts]


def check_sense(paths: Sequence[RecordPath], direction: float | None = None) -> None:
    """Checks that, until the unloading, the response follows the load in one sense.

    Args:
        paths: in blocks.
        direction: +1 or -1, the sense that is right; None for that of most of the records.

    Raises:
        RecordingError: a record follows in the opposite sense, with a correlation above 0.9.
    """
    with np.errstate(invalid='ignore', divide='ignore'):  # a response that is constant until the unloading has no sense
        follows = [np.corrcoef(path.driver[path.known], path.driven[path.known])[0, 1] for path in paths]
    certain = np.where(np.abs(follows) > 0.9, np.sign(follows), 0.0)
    right = direction or (1.0 if certain.sum() >= 0 else -1.0)
    for path, sense in zip(paths, certain.tolist(), strict=True):
        if sense == -right and (direction or np.any(certain == right)):
            problem = 'its response follows the load in the opposite sense of the other records'
            raise RecordingError(path.record.source, problem, 'give records of one joint, or reverse a sign')


class Judged(NamedTuple):
    """A record predicted by law (6) and by the selected law, law (6) if none is, by fits that have not seen it.

    Attributes:
        path: the record as measured.
        rows: samples for the errors, (n,).
        before: by law (6).
        after: by the selected law.
        state: of friction at the start, by the selected law fitted to all records; NaN of a law without memory.
    """

    path: RecordPath
    rows: Mask
    before: PredictedRecord
    after: PredictedRecord
    state: float

    @property
    def before_rms(self) -> float:
        """Rms error of law (6)."""
        return rms(self.before.residual[self.rows])

    @property
    def after_rms(self) -> float:
        """Rms error of the selected law."""
        return rms(self.after.residual[self.rows])


class Selection(NamedTuple):
    """Model selection on a record driven by its motion, or on all records driven by their load.

    Attributes:
        study: the records.
        before: law (6).
        candidates: each compared with law (6).
        selected: the candidate selected; None if none is accepted.
        rivals: accepted candidates of other effects that do not predict significantly worse.
        dependence_before: of the residual of law (6), for a load in the form that leaves least.
        p_without_memory: p-value of law (6) without a gap that keeps its place.
        dependence_after: of the residual of the selected law, or of law (6).
        verdict: none (law (6) is sufficient), explained (one law selected), ambiguous (with rivals), unexplained
            (the residual of law (6) depends on a variable, but no candidate is accepted), undecided (the records could
            not show that it is not sufficient).
        misfit: on which record the law stated does not hold (`Study.misfit`); empty where it holds on all.
    """

    study: Study
    before: TestedLaw
    candidates: tuple[TestedLaw, ...]
    selected: TestedLaw | None
    rivals: tuple[TestedLaw, ...]
    dependence_before: tuple[ResidualDependence, ...]
    p_without_memory: float
    dependence_after: tuple[ResidualDependence, ...]
    verdict: str
    misfit: str = ''

    @property
    def final(self) -> TestedLaw:
        """The selected law, or law (6) if none is selected."""
        return self.selected or self.before

    @property
    def is_complete(self) -> bool:
        """Whether the residual of the law that is stated was not found to depend on anything."""
        return self.p_after >= LEVEL / 2

    def stated(self, candidate: TestedLaw) -> dict[str, UncertainValue]:
        """The parameters of a law; without standard deviations where no law is complete: they are then no compliance
        and no gap of the joint.
        """
        if self.is_complete:
            return candidate.parameters
        return {name: each._replace(std=np.nan) for name, each in candidate.parameters.items()}

    @property
    def judged(self) -> tuple[Judged, ...]:
        """The records, each held out."""
        laws, states = (self.before.held_out, self.final.held_out), [each.state for each in self.final.along]
        return tuple(map(Judged, self.study.paths, self.study.judged, *laws, states))

    @property
    def p_value(self) -> float:
        """p-value of law (6) as a sufficient law."""
        return p_independent(self.dependence_before)

    @property
    def p_after(self) -> float:
        """p-value of the selected law as a sufficient law."""
        return p_independent(self.dependence_after)

    @property
    def detectable(self) -> float:
        """Share of the squared residual of law (6) that each test would have found; 1 where there was none."""
        return max((each.detectable_share for each in self.dependence_before if each.is_tested), default=1.0)

    @property
    def share_of_range(self) -> float:
        """Held-out error of law (6) over the range of what is predicted."""
        return self.before.held_out_rms / self._range

    @property
    def final_share(self) -> float:
        """The same of the law stated."""
        return self.final.held_out_rms / self._range

    @property
    def _range(self) -> float:
        return max(float(np.ptp(each.driven)) for each in self.study.paths)

    def is_clearly_smaller(self, candidate: TestedLaw) -> bool:
        """Whether its held-out error is clearly below that of law (6): below 80 % of it."""
        return candidate.held_out_rms < 0.8 * self.before.held_out_rms

    @property
    def needs_memory(self) -> bool:
        """Whether law (6) is sufficient only with a gap that keeps its place when unloaded."""
        return self.verdict == NONE and self.p_without_memory < LEVEL / 2


def analyse(records: Sequence[Record], driven: str) -> tuple[Selection, ...]:
    """One selection for each record driven by its motion, or one for all records driven by their load.

    Args:
        records: of one joint.
        driven: `MOTION` or `LOAD`.

    Raises:
        RecordingError: see `Study`.
        UnsupportedDataError: a record is not of full loops, or does not go from rest to rest; it is named.
    """
    if driven == MOTION:
        return tuple(map(select_model, [Study([record], MOTION) for record in records]))
    study = Study(records)
    selection = select_model(study)
    return (selection._replace(misfit=study.misfit(selection.final)),)


def analyse_both(records: Sequence[Record], looks: str) -> tuple[tuple[Selection, ...], tuple[Selection, ...]]:
    """Records of which nothing states what drives them, as driven by that by which the law errs less on what it has not
    seen (`Selection.final_share`) or which holds on all, and by the other; nothing for that where they cannot be driven
    by it.

    Args:
        records: of one joint.
        looks: what they look driven by.

    Raises:
        RecordingError, UnsupportedDataError: neither can be; as `analyse`, by what they look driven by.
    """
    found = list[tuple[Selection, ...]]()
    for driven in (MOTION, LOAD):
        with suppress(RecordingError, UnsupportedDataError):
            found.append(analyse(records, driven))
    found = found or [analyse(records, looks)]
    better, *worse = sorted(found, key=lambda some: (bool(some[0].misfit), max(each.final_share for each in some)))
    return better, worse[0] if worse else ()


def select_model(study: Study) -> Selection:
    """Selects the law that records need beyond law (6)."""
    before, dependence, p_without_memory = study.law6()
    is_independent = p_independent(dependence) >= LEVEL / 2
    candidates = [study.candidate(law) for law in study.laws]
    blocks = [study.fitted_blocks(each) for each in (before, *candidates)]
    squares = [sum(float(part @ part) for part in parts) for parts in blocks]
    count = sum(effective_count(part) for part in blocks[int(np.argmin(squares))])
    sizes = np.array([each.law.size for each in (before, *candidates)])
    bic = count * np.log(np.maximum(squares, TINY)) + np.log(count) * sizes
    found = Selection(study, before, (), None, (), dependence, p_without_memory, dependence, NONE)
    compared, significant = [], False
    for each, own in zip(candidates, bic[1:], strict=True):
        p_gain, gain = study.p_better(each, before), float(own - bic[0])
        better = each.held_out_rms < before.held_out_rms and gain < -BIC_GAIN
        significant |= better and p_gain < LEVEL / (2 * len(candidates))
        compared.append(each._replace(p_gain=p_gain, bic=gain, accepted=better))
    significant &= not is_independent or found.share_of_range > MATERIAL
    compared = [each._replace(accepted=each.accepted and significant) for each in compared]
    accepted = [each for each in compared if each.accepted]
    selected, rivals = None, []
    if accepted:
        least = min(accepted, key=lambda each: each.bic)
        forms = (each for each in accepted if each.law.effect == least.law.effect)
        selected = next(each for each in forms if each.bic - least.bic < BIC_GAIN)
        others = (each for each in accepted if each.law.effect != least.law.effect)
        rivals = [each for each in others if study.p_better(selected, each) >= LEVEL]
    verdict = AMBIGUOUS if rivals else EXPLAINED if selected else NONE if is_independent else UNEXPLAINED
    if verdict == NONE and found.share_of_range > MATERIAL:
        is_open = found.detectable > 0.5 or any(map(found.is_clearly_smaller, compared))
        verdict = UNDECIDED if is_open else NONE
    return found._replace(
        before=study.with_std(before),
        candidates=tuple(compared),
        selected=selected and study.with_std(selected),
        rivals=tuple(rivals),
        dependence_after=study.dependences(selected.along) if selected else dependence,
        verdict=verdict,
    )


def predict_records(selection: Selection, others: Sequence[Record]) -> tuple[Judged, ...]:
    """Predicts further records driven by their load, each from `Record.judged_from` on.

    Args:
        selection: of the records that give the parameters.
        others: to be predicted; what comes before gives their zero and their state of friction.

    Raises:
        RecordingError: the response of a record changes in the opposite sense of the others.
        UnsupportedDataError: a record does not go from rest to rest.
    """
    direction = selection.study.direction
    check_sense([RecordPath(record, in_blocks=True) for record in others], direction)
    found = []
    for record in others:
        path = RecordPath(record, direction=direction)
        before, after = (predict(each.whole, path, path.known) for each in (selection.before, selection.final))
        found.append(Judged(path, ~path.known, before, after, after.state))
    return tuple(found)
