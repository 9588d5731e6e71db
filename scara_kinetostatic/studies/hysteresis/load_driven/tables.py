"""Tables of the analysis of records driven by their load, for a terminal and for the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scara_kinetostatic.report.quantities import chance, shown
from scara_kinetostatic.report.table import NOT_DETERMINED, Table
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import Candidate, LoadAnalysis, PredictedRecord
from scara_kinetostatic.studies.hysteresis.load_driven.dependence import MEMORY, VARIABLES, Dependence
from scara_kinetostatic.studies.hysteresis.load_driven.quantities import (
    deflection,
    error_scale,
    largest_load,
    record_errors,
    remaining,
    response_scale,
)
from scara_kinetostatic.studies.hysteresis.tables import share

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
        cells += [number(error.per_si * errors.after), _state(analysis, place)] if analysis.selected else []
        rows.append(tuple(cells))
    heading = ('file', 'load', 'deflection', 'stays', 'p of no memory', 'before', 'after', 'state at the start')
    units = ('', analysis.records[0].load_unit, response.unit, response.unit, '', error.unit, error.unit, '')
    return Table(heading[: len(rows[0])], units[: len(rows[0])], tuple(rows))


def _state(analysis: LoadAnalysis, place: int) -> str:
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
