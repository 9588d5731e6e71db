"""`hysteresis.json`: the hysteresis analysis as data, SI units; null where a quantity does not exist."""

from __future__ import annotations

import math
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, LeaveOneOut, Record
from scara_kinetostatic.studies.hysteresis.laws import BACKLASH, Law
from scara_kinetostatic.studies.hysteresis.model_selection import Comparison, CrossValidation, Dependence

NAME = 'hysteresis.json'
SCHEMA = 'scara_kinetostatic/hysteresis/1'


def hysteresis_document(analysis: HysteresisAnalysis) -> Document:
    """The document."""
    return {
        'schema': SCHEMA,
        'version': __version__,
        'driven': 'motion',
        'units': {'load': analysis.units.si_unit('N'), 'response': analysis.units.si_unit('m')},
        'records': [_record(record) for record in analysis.records],
        'leave_one_out': [_leave_one_out(each, analysis) for each in analysis.leave_one_out],
    }


def _record(record: Record) -> dict[str, Any]:
    selection, motion = record.selection, record.motion
    errors = {'before': selection.before, 'after': selection.selected}
    return {
        'source': record.source,
        'sweeps': motion.sweeps,
        'samples': len(motion),
        'force_range': motion.force_range,
        'travel': motion.travel,
        'verdict': selection.verdict,
        'p_value': selection.p_value,
        'effects': [] if selection.selected is None else [selection.selected.law.name],
        'rivals': [[selection.selected.law.name, *selection.rivals]] if selection.selected and selection.rivals else [],
        'force_error': {name: score and _errors(score, record) for name, score in errors.items()},
        'repeatability': _number(record.repeatability),
        'candidates': [
            _candidate(selection.before, record),
            {**_candidate(selection.with_reset, record), 'reset_at_reversals': True},
            *(_compared(each, record) for each in selection.candidates),
        ],
        'parameters': {
            law: {name: _estimate(name, estimate, record) for name, estimate in found.items()}
            for law, found in record.parameters.items()
        },
        'residual_dependence': {
            'before': _dependences(selection.dependence_before),
            'after': _dependences(selection.dependence_after),
        },
        'p_value_after': selection.p_after,
        'effective_samples_after': record.independent,
        'notes': list(record.notes),
    }


def _errors(score: CrossValidation, record: Record) -> dict[str, float]:
    return {
        'fitted': score.train_rms,
        'held_out': score.held_out_rms,
        'later_from_earlier': score.later_rms,
        'earlier_from_later': score.earlier_rms,
        'held_out_share_of_range': score.held_out_rms / record.motion.force_range,
        'held_out_as_displacement': score.held_out_rms * record.compliance,
    }


def _candidate(score: CrossValidation, record: Record) -> dict[str, Any]:
    values = {name: float(value) for name, value in score.whole.values.items()}
    return {'name': score.law.name, **_errors(score, record), 'values': values}


def _compared(each: Comparison, record: Record) -> dict[str, Any]:
    more = {'p_value': each.p_gain, 'bic_difference': each.bic, 'accepted': bool(each.accepted)}
    return {**_candidate(each.score, record), **more}


def _estimate(name: str, estimate: Estimate, record: Record) -> dict[str, Any]:
    laws: list[Law] = [record.selection.final.law, BACKLASH]
    unit = next(each.unit for law in laws for each in law.parameters if each.name == name)
    return {'value': estimate.value, 'std': _number(estimate.std), 'unit': record.units.si_unit(unit)}


def _dependences(found: tuple[Dependence, ...]) -> dict[str, Any]:
    return {each.variable: {'share': each.share, 'p_value': each.p_value} for each in found}


def _leave_one_out(each: LeaveOneOut, analysis: HysteresisAnalysis) -> dict[str, Any]:
    return {
        'source': analysis.records[each.record].source,
        'tension': each.tension,
        'force_error': {
            'backlash_law': each.backlash,
            'slip_by_tension': each.by_tension,
            'slip_identified': each.identified,
            'own_fit': each.own,
        },
        'slip_force': {'by_tension': list(each.slips), 'own': list(each.own_slips)},
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
