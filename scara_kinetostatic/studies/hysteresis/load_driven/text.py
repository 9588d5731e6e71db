"""The analysis of records driven by their load as sentences, for a terminal and for the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.report.quantities import count, p_equals
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import LoadAnalysis, PredictedRecord
from scara_kinetostatic.studies.hysteresis.load_driven.dependence import LOAD, MEMORY, TIME, Dependence
from scara_kinetostatic.studies.hysteresis.load_driven.quantities import error_scale, explained_share
from scara_kinetostatic.studies.hysteresis.load_driven.tables import (
    candidate_table,
    dependence_table,
    number,
    parameter_table,
    prediction_table,
    record_table,
)
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, NONE, UNEXPLAINED
from scara_kinetostatic.studies.hysteresis.units import BY_LOAD, Units

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
