"""The analysis of records driven by their load as sentences, for a terminal and for the page.

Quantities of records driven by their load, as shown: units, errors of a record, what stays after the load.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.report.quantities import Scale, chance, count, p_equals, shown
from scara_kinetostatic.report.table import NOT_DETERMINED, Table
from scara_kinetostatic.studies.hysteresis.analysis import BY_LOAD, Units
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import (
    LOAD,
    MEMORY,
    TIME,
    VARIABLES,
    Candidate,
    Dependence,
    LoadAnalysis,
    PredictedRecord,
    earlier_half,
)
from scara_kinetostatic.studies.hysteresis.load_driven.fit import Prediction
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, NONE, UNEXPLAINED
from scara_kinetostatic.studies.hysteresis.text import share

_PREFIXES = (('m', 1e3), ('µ', 1e6), ('n', 1e9))
_LEAST = 0.01
"""The smallest quantity shown in a unit; for a smaller one the next prefix is taken."""


class RecordErrors(NamedTuple):
    """Rms errors of the response of one record, held out, m or rad; `after` is NaN where no law is selected."""

    before: float
    after: float


def error_scale(analysis: LoadAnalysis) -> Scale:
    """The unit in which errors of the response are shown."""
    return _scale(analysis.before.held_out_rms, analysis.records[0].response_unit)


def response_scale(analysis: LoadAnalysis) -> Scale:
    """The unit in which responses are shown."""
    return _scale(max(abs(deflection(record)) for record in analysis.records), analysis.records[0].response_unit)


def _scale(size: float, unit: str) -> Scale:
    prefix, per_si = next(((p, f) for p, f in _PREFIXES if size * f >= _LEAST), _PREFIXES[-1])
    return Scale(prefix + unit, per_si)


def explained_share(analysis: LoadAnalysis) -> float:
    """Share of the square of the response, less its mean in each record, that law (6) explains."""
    total = sum(float(np.var(path.response) * len(path.time)) for path in map(LoadPath.in_blocks, analysis.records))
    return 1.0 - analysis.before.whole.square / total if total > 0 else 0.0


def judged(analysis: LoadAnalysis, record: LoadRecord) -> Mask:
    """The samples for the errors, (n,): after unloading, or the later half of a single record."""
    if len(analysis.records) == 1:
        return ~earlier_half(LoadPath(record))
    return np.arange(len(record)) >= record.unloaded


def record_errors(analysis: LoadAnalysis, number: int) -> RecordErrors:
    """Errors of a record predicted from the others, or of the later half of a single one from the earlier."""
    rows = judged(analysis, analysis.records[number])
    before = rms(analysis.before.held_out[number].residual[rows])
    if analysis.selected is None:
        return RecordErrors(before, float('nan'))
    return RecordErrors(before, rms(analysis.selected.held_out[number].residual[rows]))


def response_change(record: LoadRecord) -> Floats:
    """Response less its mean at rest, (n,), m or rad."""
    return np.asarray(record.response - record.response[record.rest].mean())


def remaining(record: LoadRecord) -> float:
    """Response that stays after the load has gone: mean of the last half of what follows, m or rad."""
    after = (record.unloaded + len(record)) // 2
    return float(response_change(record)[after:].mean())


def largest_load(record: LoadRecord) -> float:
    """Largest load, averaged as friction sees it, with its sign, N or Nm."""
    smooth = LoadPath(record).smooth
    return float(smooth[int(np.abs(smooth).argmax())])


def deflection(record: LoadRecord) -> float:
    """Largest mean response to the load, with its sign, m or rad."""
    change = LoadPath.in_blocks(record).response - record.response[record.rest].mean()
    return float(change[int(np.abs(change).argmax())])


def predicted_response(record: LoadRecord, prediction: Prediction) -> Floats:
    """Response by a law, counted from rest, (n,), m or rad."""
    return np.asarray(response_change(record) - prediction.residual)


_PARAMETERS = {
    'compliance': 'compliance p',
    'half_gap': 'half gap g',
    'softening': 'increase of the compliance with the load',
    'slip_compliance': 'compliance of the slipping part',
    'further_compliance': 'compliance of the second slipping part',
    'creep_compliance': 'compliance of the creep',
    'slip_load': 'slip load',
    'further_load': 'added slip load of the second part',
    'friction': 'friction',
    'kinetic_share': 'kinetic over static friction',
    'time_constant': 'time constant',
}


_ZERO = 1e-12
"""Parameters below this, SI, are those of a bound at 0."""


def number(value: float) -> str:
    """Three digits, without exponent; nothing for NaN."""
    return f'{value:.0f}' if abs(value) >= 99.5 else f'{value:.3g}' if math.isfinite(value) else ''


def candidate_table(analysis: LoadAnalysis) -> Table:
    """Law (6) and every candidate: errors after unloading, fitted and held out."""
    rows = tuple(_candidate_row(analysis, each) for each in (analysis.before, *analysis.candidates))
    unit = error_scale(analysis).unit
    return Table(('law', 'parameters', 'fitted', 'held out', 'p', ''), ('', '', unit, unit, '', ''), rows)


def _candidate_row(analysis: LoadAnalysis, each: Candidate) -> tuple[str, ...]:
    scale = error_scale(analysis).per_si
    errors = (number(scale * each.fitted_rms), number(scale * each.held_out_rms))
    p_gain = '' if each.law is analysis.before.law else chance(each.p_gain)
    return (each.law.title, str(len(each.law.names)), *errors, p_gain, _note(analysis, each))


def _note(analysis: LoadAnalysis, each: Candidate) -> str:
    if each.law is analysis.before.law:
        return 'before'
    if analysis.selected is not None and each.law is analysis.selected.law:
        return 'selected'
    if any(each.law is rival.law for rival in analysis.rivals):
        return 'rival'
    return 'better' if each.accepted else 'no better'


def record_table(analysis: LoadAnalysis) -> Table:
    """Each record: its load and response, the errors when it is predicted, the state of friction at its start."""
    response, error = response_scale(analysis), error_scale(analysis)
    memory = next(each for each in analysis.dependence_before if each.variable == MEMORY)
    rows = []
    for place, record in enumerate(analysis.records):
        errors = record_errors(analysis, place)
        moved = (f'{round(response.per_si * each, 3) + 0.0:.3f}' for each in (deflection(record), remaining(record)))
        p_value = memory.by_record[place]
        cells = [record.name, f'{number(largest_load(record))}', *moved]
        cells += [chance(p_value) if math.isfinite(p_value) else NOT_DETERMINED, number(error.per_si * errors.before)]
        cells += [number(error.per_si * errors.after), _state_cell(analysis, place)] if analysis.selected else []
        rows.append(tuple(cells))
    heading = ('file', 'load', 'deflection', 'stays', 'p of no memory', 'before', 'after', 'state at the start')
    units = ('', analysis.records[0].load_unit, response.unit, response.unit, '', error.unit, error.unit, '')
    return Table(heading[: len(rows[0])], units[: len(rows[0])], tuple(rows))


def _state_cell(analysis: LoadAnalysis, place: int) -> str:
    selected = analysis.selected
    if selected is None or not selected.law.has_state:
        return NOT_DETERMINED
    return f'{selected.along[place].state:+.2f}'


def parameter_table(analysis: LoadAnalysis) -> Table:
    """Parameters of law (6) and of the selected law, or of the gap it takes, with their standard deviations."""
    after = analysis.gap if analysis.needs_memory else analysis.selected
    laws = [analysis.before] + ([after] if after else [])
    names = [name for name in _PARAMETERS if any(name in each.parameters for each in laws)]
    rows = tuple((_PARAMETERS[name], *(_value(analysis, each, name) for each in laws)) for name in names)
    last = 'gap that keeps its place' if analysis.needs_memory else 'after'
    return Table(('parameter', 'before', last)[: len(laws) + 1], ('',) * (len(laws) + 1), rows)


def unit_of(analysis: LoadAnalysis, law_unit: str) -> str:
    """The SI unit of a parameter of a law."""
    first = analysis.records[0]
    return law_unit.format(y=first.response_unit, l=first.load_unit)


def _value(analysis: LoadAnalysis, each: Candidate, name: str) -> str:
    if name not in each.parameters:
        return ''
    estimate = each.parameters[name]
    unit = unit_of(analysis, dict(zip(each.law.names, each.law.units, strict=True))[name])
    if max(abs(estimate.value), estimate.std if math.isfinite(estimate.std) else 0.0) < _ZERO:
        return '0'
    return shown(estimate.value, estimate.std, unit).text


def dependence_table(analysis: LoadAnalysis) -> Table:
    """What the residual of law (6) and that of the selected law depend on."""
    after = {each.variable: each for each in analysis.dependence_after}
    rows = []
    for each in analysis.dependence_before:
        cells = [VARIABLES[each.variable], *_dependence(each)]
        rows.append(tuple([*cells, *_dependence(after[each.variable])] if analysis.selected else cells))
    heading = ('residual over', 'before', 'p', 'after', 'p')[: len(rows[0])]
    return Table(heading, ('',) * len(heading), tuple(rows))


def _dependence(each: Dependence) -> tuple[str, str]:
    if not each.is_tested:
        return NOT_DETERMINED, NOT_DETERMINED
    return share(min(each.share, 1.0)), chance(each.p_value)


def prediction_table(analysis: LoadAnalysis, predicted: Sequence[PredictedRecord]) -> Table:
    """Further records, predicted from the moment on at which they are unloaded."""
    scale = error_scale(analysis)
    has_state = analysis.selected is not None and analysis.selected.law.has_state
    rows = tuple(
        (each.record.name, number(scale.per_si * each.before_rms), number(scale.per_si * each.after_rms),
         f'{each.after.state:+.2f}' if has_state else NOT_DETERMINED)
        for each in predicted
    )  # fmt: skip
    heading = ('predicted', 'before', 'after', 'state at the start')
    return Table(heading, ('', scale.unit, scale.unit, ''), rows)


_MEANING = {
    'gap': 'a gap that keeps its place when unloaded: the joint stays where the load left it',
    'softening': 'a softening spring: the compliance increases with the load',
    'friction': 'friction in parallel with the spring: it holds part of the load in either sense',
    'slip': 'slip in series with memory: part of the compliance slips under load and stays when the load has gone',
    'creep': 'creep: the response goes on increasing under a constant load',
}
"""By the family of a law."""
_DEPENDS = {
    MEMORY: 'at rest after the load is not that at rest before it',
    LOAD: 'depends on the load',
    TIME: 'depends on the time under load',
}


_BRIEF = 'No load lasts long enough for a test of the load and of the time under load.'
_UNTESTED = {
    MEMORY: 'In no record does the load come back to rest: whether the response stays then was not tested.',
    LOAD: _BRIEF,
    TIME: _BRIEF,
}
_LEAST_EXPLAINED = 0.1
"""Share of the square of the response that law (6) explains at least where the response follows the load."""


def units(analysis: LoadAnalysis) -> Units:
    """Words and units of the records."""
    return BY_LOAD[analysis.records[0].load_unit]


def driven(analysis: LoadAnalysis) -> str:
    """What drives the records, as a sentence."""
    words = units(analysis)
    return f'Driven by their load: the {words.response} is predicted from the {words.load}.'


def verdict(analysis: LoadAnalysis) -> tuple[str, list[str]]:
    """Headline, and the sentences below it."""
    if analysis.verdict == NONE:
        found = f'No dependence of its residual was found ({p_equals(analysis.p_value)}{_together(analysis)}).'
        headline = 'Law (6), slope and gap, is sufficient'
        if analysis.needs_memory:
            headline = 'Law (6) is sufficient only with a gap that keeps its place when unloaded'
        return headline, [found, *_reservations(analysis), _errors(analysis)]
    first = [_evidence(analysis)]
    if analysis.verdict == UNEXPLAINED or analysis.selected is None:
        return 'Law (6) is not sufficient, and no candidate predicts better', [*first, _errors(analysis)]
    laws = [_MEANING[each.law.family] for each in (analysis.selected, *analysis.rivals)]
    headline = f'Law (6) is not sufficient: {laws[0]}'
    if analysis.verdict == AMBIGUOUS:
        headline = f'Law (6) is not sufficient; these records do not distinguish between {"; and ".join(laws)}'
    return headline, [*first, _errors(analysis), *_state(analysis), *_limits(analysis)]


def _reservations(analysis: LoadAnalysis) -> list[str]:
    """What goes with the result that no dependence was found."""
    sentences = []
    if analysis.needs_memory:
        sentences.append(f'With one that returns to its zero it is not ({p_equals(analysis.p_without_memory)}).')
    sentences += [_UNTESTED[each.variable] for each in analysis.dependence_before if not each.is_tested]
    if explained_share(analysis) < _LEAST_EXPLAINED:
        words = units(analysis)
        sentences.append(f'The {words.response} hardly follows the {words.load}: do the columns belong to one joint?')
    elif len(analysis.records) == 1:
        sentences.append('One record hardly tells slip from a gap; several records of the joint do.')
    return list(dict.fromkeys(sentences))


def _together(analysis: LoadAnalysis) -> str:
    many = len(analysis.records)
    return f', {many} records together' if many > 1 else ''


def _smallest(found: Sequence[Dependence]) -> Dependence:
    return min(found, key=lambda each: each.p_value)


def _evidence(analysis: LoadAnalysis) -> str:
    """What the residual depends on, and how many records show it by themselves."""
    best = _smallest(analysis.dependence_before)
    sentence = f'The residual of law (6) {_DEPENDS[best.variable]} ({p_equals(analysis.p_value)}'
    if len(analysis.records) == 1:
        return f'{sentence}).'
    alone = int(np.sum(np.array(best.by_record) < LEVEL))
    return f'{sentence}{_together(analysis)}; below {100 * LEVEL:g} % in {alone} of them alone).'


def _errors(analysis: LoadAnalysis) -> str:
    scale, selected = error_scale(analysis), analysis.selected
    before = number(scale.per_si * analysis.before.held_out_rms)
    how = 'Each record predicted from the others, the error after unloading'
    if len(analysis.records) == 1:
        how = 'The later half predicted from the earlier half, the error'
    if selected is None:
        return f'{how} of law (6) is {before} {scale.unit} (rms).'
    after = number(scale.per_si * selected.held_out_rms)
    factor = analysis.before.held_out_rms / selected.held_out_rms
    return f'{how} falls from {before} to {after} {scale.unit} (rms), by a factor of {factor:.1f}.'


def _state(analysis: LoadAnalysis) -> list[str]:
    assert analysis.selected is not None
    if not analysis.selected.law.has_state:
        return []
    return [
        "The state in which friction has left the joint is each record's own; it is found from the samples before the "
        'load is gone.'
    ]


def _limits(analysis: LoadAnalysis) -> list[str]:
    if analysis.p_after >= LEVEL:
        return [f'No further dependence of the residual was found ({p_equals(analysis.p_after)}).']
    best = _smallest(analysis.dependence_after)
    return [f'Nor is the selected law complete: its residual {_DEPENDS[best.variable]} ({p_equals(analysis.p_after)}).']


def errors_note(analysis: LoadAnalysis) -> str:
    """What the errors in the tables are."""
    held_out = (
        'predicted with the parameters of the other records; zero and state of friction from its own samples up to'
    )
    if len(analysis.records) == 1:
        return 'Errors: rms of the later half. Held out: predicted by a fit to the earlier half.'
    return f'Errors: rms after unloading. Held out: {held_out} the unloading.'


def sign_note(analysis: LoadAnalysis) -> str:
    """The direction of the response, as compliances are given without a sign."""
    words, along = units(analysis), 'along' if analysis.direction > 0 else 'against'
    return f'The {words.response} changes {along} a positive {words.load}; parameters are magnitudes.'


def text(analysis: LoadAnalysis, predicted: Sequence[PredictedRecord] = ()) -> str:
    """The whole result for a terminal."""
    headline, sentences = verdict(analysis)
    parts = [driven(analysis), headline, '\n'.join(sentences), record_table(analysis).text()]
    parts += [candidate_table(analysis).text(), errors_note(analysis), dependence_table(analysis).text()]
    parts += [parameter_table(analysis).text(), sign_note(analysis)]
    if predicted:
        parts += [PREDICTED, prediction_table(analysis, predicted).text()]
    notes = [note for record in (*analysis.records, *(each.record for each in predicted)) for note in record.notes]
    return '\n\n'.join([*parts, *(f'note: {note}' for note in notes)])


PREDICTED = (
    'Further records, from the moment on at which they are unloaded; what comes before gives their zero and their '
    'state of friction.'
)


def size(analysis: LoadAnalysis) -> str:
    """Size of the records in words."""
    samples = sum(len(record) for record in analysis.records)
    return f'{count(len(analysis.records), "record")}, {count(samples, "sample")}'
