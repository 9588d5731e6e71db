"""`hysteresis.json`: the hysteresis analysis as data, SI units; null where a quantity does not exist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.studies.loops.dependence import Dependence
from scara_kinetostatic.studies.loops.fit import effective_count
from scara_kinetostatic.studies.loops.motion import Motion, repeatability
from scara_kinetostatic.studies.loops.record import LOAD, MOTION, Record
from scara_kinetostatic.studies.loops.report import record_errors, unit_of
from scara_kinetostatic.studies.loops.selection import Candidate, LoadStudy, MotionStudy, PredictedRecord, Selection

NAME = 'hysteresis.json'


def hysteresis_document(selections: Sequence[Selection], predicted: Sequence[PredictedRecord] = ()) -> Document:
    """The document of records driven by their motion, one selection each, or of all that are driven by their load."""
    study = selections[0].study
    record = study.records[0]
    units = {'load': record.load_unit, 'response': record.unit('m')}
    head = {'schema': 'scara_kinetostatic/hysteresis/1', 'version': __version__}
    if isinstance(study, MotionStudy):
        records = [
            _motion_record(each, each.study.motion) for each in selections if isinstance(each.study, MotionStudy)
        ]
        return {**head, 'driven': MOTION, 'units': units, 'records': records}
    return {**head, 'driven': LOAD, 'units': units, **_load_content(selections[0], study, predicted)}


def _common(selection: Selection) -> Document:
    selected = selection.selected
    effects = [each.law.effect for each in (selected, *selection.rivals)] if selected else []
    return {
        'verdict': selection.verdict,
        'p_value': selection.p_value,
        'detectable_share': selection.detectable,
        'p_value_after': selection.p_after,
        'law': {'before': selection.before.law.name, 'after': selected.law.name if selected else None},
        'effects': effects[:1],
        'rivals': [effects] if selection.rivals else [],
        'residual_dependence': {
            'before': _dependences(selection.dependence_before),
            'after': _dependences(selection.dependence_after),
        },
    }


def _dependences(found: Sequence[Dependence]) -> Document:
    return {
        each.variable: {
            'share': each.share,
            'detectable_share': each.detectable if each.is_tested else None,
            'p_value': each.p_value if each.is_tested else None,
            **({'p_value_by_record': each.by_record} if each.by_record else {}),
        }
        for each in found
    }


def _parameters(each: Candidate, record: Record) -> Document:
    return {
        name: {'value': estimate.value, 'std': estimate.std, 'unit': unit_of(each.law, name, record)}
        for name, estimate in each.parameters.items()
    }


def _compared(each: Candidate, selection: Selection) -> Document:
    is_before = each is selection.before
    return {
        'name': each.law.name,
        'effect': each.law.effect,
        'p_value': None if is_before else each.p_gain,
        'bic_difference': None if is_before else each.bic,
        'accepted': each.accepted,
    }


def _motion_record(selection: Selection, motion: Motion) -> Document:
    record, selected = motion.record, selection.selected

    def errors(each: Candidate) -> dict[str, float]:
        residual = each.held_out[0].residual
        return {
            'fitted': each.fitted_rms,
            'held_out': each.held_out_rms,
            'later_from_earlier': rms(residual[~motion.earlier]),
            'earlier_from_later': rms(residual[motion.earlier & motion.scored]),
            'held_out_share_of_range': each.held_out_rms / motion.driven_range,
            'held_out_as_displacement': each.held_out_rms * selection.final.whole.values['compliance'],
        }

    laws = [selection.before, *([selected] if selected else [])]
    return {
        'source': record.source,
        'sweeps': motion.sweeps,
        'samples': len(motion),
        'force_range': motion.driven_range,
        'travel': motion.travel,
        **_common(selection),
        'force_error': {'before': errors(selection.before), 'after': errors(selected) if selected else None},
        'repeatability': repeatability(motion),
        'candidates': [
            {**_compared(each, selection), **errors(each), 'values': each.whole.values}
            for each in (selection.before, *selection.candidates)
        ],
        'parameters': {each.law.name: _parameters(each, record) for each in laws},
        'effective_samples_after': effective_count(selection.final.along[0].residual[motion.scored]),
    }


def _load_content(selection: Selection, study: LoadStudy, predicted: Sequence[PredictedRecord]) -> Document:
    selected, unit = selection.selected, study.records[0].unit('m')
    has_state = selection.final.law.has_state

    def errors(each: Candidate) -> dict[str, float]:
        return {'fitted': each.fitted_rms, 'held_out': each.held_out_rms}

    return {
        **_common(selection),
        'p_value_without_memory': selection.p_without_memory,
        'direction': study.direction,
        'response_error': {
            'before': errors(selection.before),
            'after': errors(selected) if selected else None,
            'unit': unit,
        },
        'candidates': [
            {**_compared(each, selection), **errors(each), 'parameters': _parameters(each, study.records[0])}
            for each in (selection.before, *selection.candidates)
        ],
        'records': _load_records(selection, study),
        'predicted': [
            {
                'file': each.record.source,
                'before': each.before_rms,
                'after': each.after_rms,
                'unit': unit,
                'from_s': each.record.time[each.record.judged_from],
                'state': each.after.state if has_state else None,
            }
            for each in predicted
        ],
    }


def _load_records(selection: Selection, study: LoadStudy) -> list[dict[str, Any]]:
    selected, found = selection.selected, []
    before = record_errors(selection, selection.before)
    after = record_errors(selection, selected) if selected else [None] * len(before)
    for k, (record, path, block) in enumerate(zip(study.records, study.paths, study.blocks, strict=True)):
        moved, rests = block.response - record.response[0] + record.response_change[0], record.is_at_rest_first
        found.append(
            {
                'source': record.source,
                'samples': len(record),
                'loaded': record.time[record.rest][-1] if rests else None,
                'judged_from': record.time[record.judged_from],
                'largest_load': path.smooth[int(np.abs(path.smooth).argmax())],
                'deflection': moved[int(np.abs(moved).argmax())],
                'remaining': record.remaining if rests else None,
                'noise': {'load': record.noise(record.load), 'response': record.noise(record.response)},
                'response_error': {'before': before[k], 'after': after[k]},
                'state': selected.along[k].state if selected and selected.law.has_state else None,
            }
        )
    return found
