"""`hysteresis.json` of records driven by their load: the analysis as data, SI units; null where there is no value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.studies.hysteresis.document import SCHEMA
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import (
    Candidate,
    Dependence,
    LoadAnalysis,
    PredictedRecord,
)
from scara_kinetostatic.studies.hysteresis.load_driven.text import (
    deflection,
    largest_load,
    record_errors,
    remaining,
    unit_of,
)


def load_driven_document(analysis: LoadAnalysis, predicted: Sequence[PredictedRecord] = ()) -> Document:
    """The document."""
    selected, first = analysis.selected, analysis.records[0]
    families = [each.law.family for each in (selected, *analysis.rivals)] if selected else []
    return {
        'schema': SCHEMA,
        'version': __version__,
        'driven': 'load',
        'units': {'load': first.load_unit, 'response': first.response_unit},
        'verdict': analysis.verdict,
        'p_value': analysis.p_value,
        'p_value_without_memory': analysis.p_without_memory,
        'p_value_after': analysis.p_after,
        'effects': families[:1],
        'rivals': [families] if analysis.rivals else [],
        'law': {'before': analysis.before.law.name, 'after': selected.law.name if selected else None},
        'direction': analysis.direction,
        'response_error': {
            'before': _errors(analysis.before),
            'after': _errors(selected) if selected else None,
            'unit': first.response_unit,
        },
        'candidates': [_candidate(analysis, each) for each in (analysis.before, *analysis.candidates)],
        'residual_dependence': {
            'before': _dependences(analysis.dependence_before),
            'after': _dependences(analysis.dependence_after),
        },
        'records': [_record(analysis, number) for number in range(len(analysis.records))],
        'predicted': [
            {
                'file': each.record.source,
                'before': each.before_rms,
                'after': each.after_rms,
                'unit': each.record.response_unit,
                'state': each.after.state if selected and selected.law.has_state else None,
                'unloaded': float(each.record.time[each.record.unloaded]),
            }
            for each in predicted
        ],
        'notes': [note for each in (*analysis.records, *(each.record for each in predicted)) for note in each.notes],
    }


def _errors(each: Candidate) -> dict[str, float]:
    return {'fitted': each.fitted_rms, 'held_out': each.held_out_rms}


def _candidate(analysis: LoadAnalysis, each: Candidate) -> dict[str, Any]:
    units = dict(zip(each.law.names, each.law.units, strict=True))
    return {
        'name': each.law.name,
        'effect': each.law.family,
        **_errors(each),
        'p_value': None if each.law is analysis.before.law else each.p_gain,
        'accepted': bool(each.accepted),
        'parameters': {
            name: {'value': estimate.value, 'std': _number(estimate.std), 'unit': unit_of(analysis, units[name])}
            for name, estimate in each.parameters.items()
        },
    }


def _dependences(found: Sequence[Dependence]) -> dict[str, Any]:
    return {
        each.variable: {
            'share': each.share,
            'p_value': each.p_value if each.is_tested else None,
            'p_value_by_record': [_number(value) for value in each.by_record],
        }
        for each in found
    }


def _record(analysis: LoadAnalysis, number: int) -> dict[str, Any]:
    record, selected = analysis.records[number], analysis.selected
    errors = record_errors(analysis, number)
    return {
        'source': record.source,
        'samples': len(record),
        'loaded': float(record.time[record.rest][-1]),
        'unloaded': float(record.time[record.unloaded]),
        'largest_load': largest_load(record),
        'deflection': deflection(record),
        'remaining': remaining(record),
        'noise': {'load': record.load_noise, 'response': record.response_noise},
        'response_error': {'before': errors.before, 'after': _number(errors.after)},
        'state': selected.along[number].state if selected and selected.law.has_state else None,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
