"""Analysis of records driven by their load: law (6), the law selected, the errors of both on records not in the fit.

Each record is predicted with the parameters fitted to all others; its own samples, until the load has gone for good,
give only its zero and its initial state of friction. With a single record, its later half is predicted from the
earlier one.

Candidates are compared with law (6) on the held-out residuals in blocks of `SMOOTHING` from the load's coming on: a
one-sided Pitman-Morgan test of the variances of two correlated residuals, with the effective number of independent
blocks. A record with a load far beyond those of all others is not compared: they do not determine its prediction. A
candidate is accepted if the residual of law (6), in each of its forms, depends on something and if the candidate
predicts better than law (6) (Bonferroni over the candidates). The accepted candidate with the smallest BIC of the fit
to all records is selected. Its rivals are the accepted ones of other families that do not predict significantly worse.

Checks that records driven by their load go together: units, and the sense in which the response follows the load.

What the residual of law (6) depends on, from means of half a second, in which vibrations average out.

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

from scara_kinetostatic.errors import RecordingError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.load_driven.fit import LoadFit, Moments, Prediction, fit, moments, predict
from scara_kinetostatic.studies.hysteresis.load_driven.laws import BACKLASH_FORMS, CANDIDATES, GAP_FORMS, Law
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.load_driven.record import UNLOADED_BELOW, LoadRecord
from scara_kinetostatic.studies.hysteresis.model_selection import (
    AMBIGUOUS,
    BIC_GAIN,
    EXPLAINED,
    LEVEL,
    NONE,
    UNEXPLAINED,
    effective_count,
)

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


_OPPOSITE = 0.9
"""Correlation of response and load from which on a record has a sense of its own; opposite ones do not go together."""


def check_units(records: Sequence[LoadRecord]) -> None:
    """Checks that records go together.

    Raises:
        UnsupportedDataError: the units differ.
    """
    for record in records[1:]:
        if record.load_unit != records[0].load_unit:
            pairs = [f'{each.name} is in {each.response_unit} and {each.load_unit}' for each in (records[0], record)]
            raise UnsupportedDataError(', '.join(pairs), 'give records of one joint')


def check_sense(records: Sequence[LoadRecord], direction: float | None = None) -> None:
    """Checks that, until the unloading, the response follows the load in one sense.

    Args:
        records: with the same units.
        direction: +1 or -1, the sense that is right; None for that of most of the records.

    Raises:
        RecordingError: a record follows in the opposite sense.
    """
    follows = [_correlation(LoadPath.in_blocks(record)) for record in records]
    along, against = ([sense * each > _OPPOSITE for each in follows] for sense in (1.0, -1.0))
    if direction is None:
        direction = 1.0 if sum(along) >= sum(against) else -1.0
        if not (any(along) and any(against)):
            return
    opposite = against if direction > 0 else along
    if any(opposite):
        problem = 'its response follows the load in the opposite sense of the other records'
        raise RecordingError(
            records[opposite.index(True)].source, problem, 'give records of one joint, or reverse a sign'
        )


def _correlation(path: LoadPath) -> float:
    """Of the response with the load until the unloading; 0 where the response is constant."""
    load, response = path.load[path.known], path.response[path.known]
    return float(np.corrcoef(load, response)[0, 1]) if np.ptp(response) > 0 and np.ptp(load) > 0 else 0.0


_FAR_BEYOND = 1.5
"""A record whose load is larger than that of every other by this factor is not predicted but extrapolated."""


class Candidate(NamedTuple):
    """A law on all records.

    Attributes:
        law: the law.
        whole: fitted to all records.
        along: the law along each record, zero and state from its samples before the load is gone for good.
        held_out: each record predicted by the fit to the others; with one record, its later half by the earlier.
        fitted_rms: rms residual of `whole` after unloading, all records, m or rad.
        held_out_rms: the same of `held_out`.
        parameters: with standard deviations by the delete-one-record jackknife; NaN with one record.
        p_gain: p-value of no better prediction than that of law (6); 1 for law (6).
        accepted: whether it predicts better.
    """

    law: Law
    whole: LoadFit
    along: tuple[Prediction, ...]
    held_out: tuple[Prediction, ...]
    fitted_rms: float
    held_out_rms: float
    parameters: dict[str, Estimate]
    p_gain: float = 1.0
    accepted: bool = False


class LoadAnalysis(NamedTuple):
    """Result of all records.

    Attributes:
        records: in the order given.
        direction: +1 or -1: sign of the response to a positive load.
        before: law (6).
        candidates: each compared with law (6).
        selected: the candidate selected; None if none is accepted.
        rivals: accepted candidates of other families that do not predict significantly worse.
        dependence_before: of the residual of law (6), in the form that leaves least.
        p_without_memory: p-value of law (6) without a gap that keeps its place, in the form that leaves least.
        dependence_after: of the residual of the selected law, or of law (6).
        verdict: none, explained, ambiguous or unexplained, as for records driven by their motion.
    """

    records: tuple[LoadRecord, ...]
    direction: float
    before: Candidate
    candidates: tuple[Candidate, ...]
    selected: Candidate | None
    rivals: tuple[Candidate, ...]
    dependence_before: tuple[Dependence, ...]
    p_without_memory: float
    dependence_after: tuple[Dependence, ...]
    verdict: str

    @property
    def p_value(self) -> float:
        """p-value of law (6) as a sufficient law."""
        return p_independent(self.dependence_before)

    @property
    def needs_memory(self) -> bool:
        """Whether law (6) is sufficient only with a gap that keeps its place when unloaded."""
        return self.verdict == NONE and self.p_without_memory < LEVEL

    @property
    def gap(self) -> Candidate:
        """The gap that keeps its place, the first of the candidates."""
        return self.candidates[0]

    @property
    def p_after(self) -> float:
        """p-value of the selected law as a sufficient law."""
        return p_independent(self.dependence_after)


class PredictedRecord(NamedTuple):
    """A record predicted from others.

    Attributes:
        record: the record.
        before: by law (6).
        after: by the law selected; by law (6) if none is.
        before_rms: rms error of the response from the unloading on, m or rad.
        after_rms: the same by the law selected.
    """

    record: LoadRecord
    before: Prediction
    after: Prediction
    before_rms: float
    after_rms: float


class _Study:
    """The records as arrays, in blocks for fits and as measured for predictions."""

    def __init__(self, records: Sequence[LoadRecord]) -> None:
        self.paths = [LoadPath(record) for record in records]
        self.blocks = [LoadPath.in_blocks(record) for record in records]
        self.size = max(path.size for path in self.paths)
        joint = sum(float(np.dot(p.response - p.response.mean(), p.load - p.load.mean())) for p in self.blocks)
        self.direction = 1.0 if joint >= 0 else -1.0

    def moments(self, law: Law) -> list[Moments]:
        """Moments of all records."""
        return [moments(law, block, np.ones(len(block.time), dtype=bool), self.size) for block in self.blocks]

    def fit(self, law: Law, grids: Sequence[Moments], warm_start: LoadFit | None = None) -> LoadFit:
        """The law fitted to some records."""
        return fit(law, grids, self.size, self.direction, warm_start)

    def forms(self) -> tuple[list[LoadFit], list[LoadFit]]:
        """Law (6) in all its forms, without and with the memory of the gap, fitted to all records."""
        without, with_memory = (
            [self.fit(law, self.moments(law)) for law in laws] for laws in (BACKLASH_FORMS, GAP_FORMS)
        )
        return without, with_memory

    def along(self, fitted: LoadFit) -> tuple[Prediction, ...]:
        """A fitted law along all records."""
        return tuple(predict(fitted, path, path.known) for path in self.paths)

    def candidate(self, law: Law) -> Candidate:
        """The law fitted to all records and held out from each."""
        grids = self.moments(law)
        whole = self.fit(law, grids)
        along = self.along(whole)
        if len(grids) == 1:
            held_out, std = self._later_half(law), np.full(len(law.names), np.nan)
        else:
            fits = [self.fit(law, grids[:k] + grids[k + 1 :], _without(whole, k)) for k in range(len(grids))]
            held_out = tuple(predict(each, path, path.known) for each, path in zip(fits, self.paths, strict=True))
            several = np.array([list(each.values.values()) for each in fits])
            std = np.sqrt((len(fits) - 1) / len(fits) * ((several - several.mean(axis=0)) ** 2).sum(axis=0))
        parameters = {
            name: Estimate(value, float(each)) for (name, value), each in zip(whole.values.items(), std, strict=True)
        }
        return Candidate(law, whole, along, held_out, self._rms(along), self._rms(held_out), parameters)

    def _later_half(self, law: Law) -> tuple[Prediction, ...]:
        block, path = self.blocks[0], self.paths[0]
        earlier = self.fit(law, [moments(law, block, earlier_half(block), self.size)])
        return (predict(earlier, path, earlier_half(path)),)

    def judged(self, path: LoadPath) -> Mask:
        """The samples for the errors: after unloading, or the later half of a single record."""
        return ~earlier_half(path) if len(self.paths) == 1 else ~path.known

    def _rms(self, predictions: Sequence[Prediction]) -> float:
        pairs = zip(predictions, self.paths, strict=True)
        return rms(np.concatenate([each.residual[self.judged(path)] for each, path in pairs]))

    def compared_blocks(self, candidate: Candidate) -> list[Floats]:
        """Held-out residuals of the samples compared, of each record compared, as means of blocks."""
        rows = [~earlier_half(path) if len(self.paths) == 1 else ~path.rest for path in self.paths]
        found = self._in_blocks(candidate.held_out, rows)
        return [each for each, path in zip(found, self.paths, strict=True) if not self._extrapolated(path)]

    def fitted_blocks(self, candidate: Candidate) -> list[Floats]:
        """Residuals of the fit to all records under load and after it, as means of blocks."""
        zeros, found = candidate.whole, []
        for state, path in zip(zeros.states.tolist(), self.paths, strict=True):
            model = path.response - zeros.direction * candidate.law.basis(path, zeros.shape, state) @ zeros.amplitudes
            found.append(Prediction(state, 0.0, model - model.mean()))
        return self._in_blocks(found, [~path.rest for path in self.paths])

    def _in_blocks(self, predictions: Sequence[Prediction], rows: Sequence[Mask]) -> list[Floats]:
        found = []
        for each, block, which in zip(predictions, self.blocks, rows, strict=True):
            residual = each.residual[which]
            count = len(residual) // block.block
            found.append(residual[: count * block.block].reshape(count, block.block).mean(axis=1))
        return found

    def _extrapolated(self, path: LoadPath) -> bool:
        return all(path.size > _FAR_BEYOND * other.size for other in self.paths if other is not path) and self.several

    @property
    def several(self) -> bool:
        """Whether there is more than one record."""
        return len(self.paths) > 1


def analyse_load_driven(records: Sequence[LoadRecord]) -> LoadAnalysis:
    """Analyses records of one joint that are driven by their load.

    Args:
        records: with the same units.

    Raises:
        RecordingError: the response of a record changes in the opposite sense of the others.
        UnsupportedDataError: the units differ, or law (6) cannot be tested in any record.
    """
    check_units(records)
    study = _Study(records)
    check_sense(records)
    forms = study.forms()
    without_memory, with_memory = (_most_sufficient(study, several) for several in forms)
    dependence_before = max(without_memory, with_memory, key=p_independent)
    if not any(each.is_tested for each in dependence_before):
        problem = 'the load neither comes back to rest nor lasts long enough for a test of law (6)'
        raise UnsupportedDataError(f'{records[0].source}: {problem}', 'record some seconds at rest after the load')
    best = [min(several, key=lambda each: each.square).law for several in forms]
    before, *candidates = (study.candidate(law) for law in (*best, *CANDIDATES))
    sufficient = p_independent(dependence_before) >= LEVEL
    compared = tuple(_compared(study, each, before, sufficient) for each in candidates)
    accepted = [each for each in compared if each.accepted]
    selected = _select(study, accepted)
    rivals = tuple(_rivals(study, accepted, selected)) if selected else ()
    verdict = AMBIGUOUS if rivals else EXPLAINED
    if selected is None:
        verdict = NONE if sufficient else UNEXPLAINED
    return LoadAnalysis(
        records=tuple(records),
        direction=study.direction,
        before=before,
        candidates=compared,
        selected=selected,
        rivals=rivals,
        dependence_before=dependence_before,
        p_without_memory=p_independent(without_memory),
        dependence_after=_dependences(study, selected.along) if selected else dependence_before,
        verdict=verdict,
    )


def p_sufficient(records: Sequence[LoadRecord]) -> float:
    """p-value of law (6) as a sufficient law of some records, without the search for another one."""
    study = _Study(records)
    return max(p_independent(_most_sufficient(study, several)) for several in study.forms())


def predict_records(analysis: LoadAnalysis, others: Sequence[LoadRecord]) -> tuple[PredictedRecord, ...]:
    """Predicts further records, each from the moment on at which it is unloaded.

    Args:
        analysis: of the records that give the parameters.
        others: to be predicted; what comes before they are unloaded gives their zero and their state of friction.

    Raises:
        RecordingError: the response of a record changes in the opposite sense of the others.
        UnsupportedDataError: the units differ.
    """
    check_units([*analysis.records, *others])
    check_sense(others, analysis.direction)
    found = []
    for record in others:
        path = LoadPath(record)
        before = predict(analysis.before.whole, path, path.known)
        after = predict((analysis.selected or analysis.before).whole, path, path.known)
        errors = [rms(each.residual[~path.known]) for each in (before, after)]
        found.append(PredictedRecord(record, before, after, errors[0], errors[1]))
    return tuple(found)


def earlier_half(path: LoadPath) -> Mask:
    """The samples of the first half of the time."""
    return np.asarray(path.time < (path.time[0] + path.time[-1]) / 2)


def _without(whole: LoadFit, record: int) -> LoadFit:
    return whole._replace(states=np.delete(whole.states, record))


def _most_sufficient(study: _Study, forms: Sequence[LoadFit]) -> tuple[Dependence, ...]:
    """Dependence of the residual of the form of law (6) that explains the records best."""
    return max((_dependences(study, study.along(each)) for each in forms), key=p_independent)


def _dependences(study: _Study, along: Sequence[Prediction]) -> tuple[Dependence, ...]:
    return dependences(study.paths, [each.residual for each in along])


def _compared(study: _Study, candidate: Candidate, before: Candidate, sufficient: bool) -> Candidate:
    p_gain = _p_better(study, candidate, before)
    better = candidate.held_out_rms < before.held_out_rms and p_gain < LEVEL / (1 + len(CANDIDATES))
    return candidate._replace(p_gain=p_gain, accepted=better and not sufficient)


def _p_better(study: _Study, one: Candidate, other: Candidate) -> float:
    """p-value of one law predicting no better than another: Pitman and Morgan's test of two correlated variances."""
    residuals = [study.compared_blocks(each) for each in (one, other)]
    smaller, larger = (np.concatenate(each) for each in residuals)
    count = min(sum(effective_count(part, 0.0) for part in each) for each in residuals)
    total, difference = smaller + larger, larger - smaller
    norm = float(np.sqrt((total @ total) * (difference @ difference)))
    if not norm > 0 or count <= 3:
        return 1.0
    correlation = min(max(float(total @ difference) / norm, -1 + 1e-12), 1 - 1e-12)
    return float(stats.t.sf(correlation * np.sqrt((count - 2) / (1 - correlation**2)), count - 2))


def _select(study: _Study, accepted: Sequence[Candidate]) -> Candidate | None:
    """The candidate with the smallest BIC; a simpler one of its family if the difference is no evidence."""
    if not accepted:
        return None
    residuals = {each.law.name: study.fitted_blocks(each) for each in accepted}
    squares = {name: sum(float(part @ part) for part in parts) for name, parts in residuals.items()}
    best = min(squares, key=lambda name: squares[name])
    count = sum(effective_count(part, 0.0) for part in residuals[best])

    def bic(each: Candidate) -> float:
        square = max(squares[each.law.name], 1e-300)
        return float(count * np.log(square) + len(each.law.names) * np.log(count))

    least = min(accepted, key=bic)
    family = [each for each in accepted if each.law.family == least.law.family]
    return next(each for each in family if bic(each) - bic(least) < BIC_GAIN)


def _rivals(study: _Study, accepted: Sequence[Candidate], selected: Candidate) -> list[Candidate]:
    others = [each for each in accepted if each.law.family != selected.law.family]
    return [each for each in others if _p_better(study, selected, each) >= LEVEL]
