"""What measured loops show as data: `loops.json`, SI units; null where there is no number."""

from __future__ import annotations

import math
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.render.json_file import Document
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisStudy, Record
from scara_kinetostatic.studies.hysteresis.dependence import Dependence
from scara_kinetostatic.studies.hysteresis.laws import BACKLASH, Law
from scara_kinetostatic.studies.hysteresis.leave_one_out import Transfer
from scara_kinetostatic.studies.hysteresis.model_selection import Comparison, Score

NAME = 'loops.json'
SCHEMA = 'scara_kinetostatic/loops/1'


def hysteresis_document(study: HysteresisStudy) -> Document:
    """The document."""
    return {
        'schema': SCHEMA,
        'version': __version__,
        'records': [_record(record) for record in study.records],
        'refined_as_another': [
            {
                'source': study.records[each.record].source,
                'as': study.records[each.other].source,
                'force_error': _errors(each.score, study.records[each.record]),
            }
            for each in study.borrowed
        ],
        'predicted_from_the_others': [_transfer(each, study) for each in study.transfers],
    }


def _record(record: Record) -> dict[str, Any]:
    choice, motion = record.choice, record.motion
    errors = {'before': choice.before, 'after': choice.winner, 'refined': choice.after}
    return {
        'source': record.source,
        'sweeps': motion.sweeps,
        'samples': len(motion),
        'force_range': motion.force_range,
        'travel': motion.travel,
        'verdict': choice.verdict,
        'p_value': choice.p_value,
        'effects': [] if choice.winner is None else [choice.winner.law.name],
        'rivals': [[choice.winner.law.name, *choice.rivals]] if choice.winner and choice.rivals else [],
        'refinements': choice.after.law.name.split('+')[1:],
        'force_error': {name: score and _errors(score, record) for name, score in errors.items()},
        'repeatability': _number(record.repeatability),
        'candidates': [
            _candidate(choice.before, record),
            {**_candidate(choice.told, record), 'told_the_force_at_every_reversal': True},
            *(_compared(each, record) for each in choice.candidates),
        ],
        'refinement_steps': [[_compared(each, record) for each in step] for step in choice.refinements],
        'parameters': {
            law: {name: _estimate(name, estimate, record) for name, estimate in found.items()}
            for law, found in record.parameters.items()
        },
        'residual_depends_on': {'before': _dependences(choice.structure), 'after': _dependences(choice.left)},
        'p_value_after': choice.p_left,
        'independent_samples_after': record.independent,
        'notes': list(record.notes),
    }


def _errors(score: Score, record: Record) -> dict[str, float]:
    return {
        'fitted': score.train_rms,
        'held_out': score.held_out_rms,
        'later_from_earlier': score.later_rms,
        'earlier_from_later': score.earlier_rms,
        'held_out_part_of_range': score.held_out_rms / record.motion.force_range,
        'held_out_as_displacement': score.held_out_rms * record.compliance,
    }


def _candidate(score: Score, record: Record) -> dict[str, Any]:
    values = {name: float(value) for name, value in score.whole.values.items()}
    return {'name': score.law.name, **_errors(score, record), 'values': values}


def _compared(each: Comparison, record: Record) -> dict[str, Any]:
    more = {'p_value': each.p_gain, 'bic_difference': each.bic, 'accepted': bool(each.accepted)}
    return {**_candidate(each.score, record), **more}


def _estimate(name: str, estimate: Estimate, record: Record) -> dict[str, Any]:
    laws: list[Law] = [record.choice.after.law, BACKLASH]
    unit = next(each.unit for law in laws for each in law.parameters if each.name == name)
    return {'value': estimate.value, 'std': _number(estimate.std), 'unit': unit}


def _dependences(found: tuple[Dependence, ...]) -> dict[str, Any]:
    return {each.variable: {'share': each.share, 'p_value': each.p_value} for each in found}


def _transfer(each: Transfer, study: HysteresisStudy) -> dict[str, Any]:
    return {
        'source': study.records[each.record].source,
        'tension': each.tension,
        'force_error': {
            'before': each.before,
            'after_by_tension': each.after,
            'after_slip_shown': each.shown,
            'own_fit': each.own,
        },
        'slip_force': {'by_tension': list(each.slips), 'own': list(each.own_slips)},
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
