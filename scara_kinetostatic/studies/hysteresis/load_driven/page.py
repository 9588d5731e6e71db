"""`hysteresis.html` of records driven by their load: one self-contained page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.report.figure import style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.quantities import p_equals
from scara_kinetostatic.studies.hysteresis.load_driven import figures, tables, text
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import LoadAnalysis, PredictedRecord
from scara_kinetostatic.studies.hysteresis.load_driven.fit import Prediction
from scara_kinetostatic.studies.hysteresis.load_driven.quantities import (
    error_scale,
    judged,
    record_errors,
    response_change,
    response_scale,
)
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, UNEXPLAINED

_TEMPLATE = Path(__file__).parent / 'page.html.j2'
_POINTS = 500
"""Points of a curve, at most; more are averaged."""
_OPEN = 4
"""So many records are shown at once, the others on demand."""


def html_text(analysis: LoadAnalysis, predicted: Sequence[PredictedRecord] = ()) -> str:
    """The page."""
    headline, sentences = text.verdict(analysis)
    with style():
        shown = [_record(analysis, number) for number in _most_telling(analysis)]
        others = [_predicted(analysis, each, f'other{k}') for k, each in enumerate(predicted)]
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[record.source for record in analysis.records],
        driven=text.driven(analysis),
        units=text.units(analysis),
        size=text.size(analysis),
        level=_level(analysis),
        headline=headline,
        sentences=sentences,
        facts=_facts(analysis),
        notes=[note for each in (*analysis.records, *(each.record for each in predicted)) for note in each.notes],
        record_table=tables.record_table(analysis),
        single=len(analysis.records) == 1,
        records=shown,
        open=_OPEN,
        selected=analysis.selected is not None,
        state=analysis.selected is not None and analysis.selected.law.has_state,
        errors=text.errors_note(analysis),
        candidates=tables.candidate_table(analysis),
        dependences=tables.dependence_table(analysis),
        sign_note=text.sign_note(analysis),
        parameters=tables.parameter_table(analysis),
        predicted_note=text.PREDICTED,
        prediction_table=tables.prediction_table(analysis, predicted) if predicted else None,
        predicted=others,
    )


def _level(analysis: LoadAnalysis) -> str:
    """Colour of the verdict: good only for one law whose residual shows no dependence; of law (6), without memory."""
    if analysis.verdict == UNEXPLAINED:
        return 'bad'
    open_ = analysis.verdict == AMBIGUOUS or analysis.needs_memory or analysis.p_after < LEVEL
    return 'caution' if open_ else 'good'


def _facts(analysis: LoadAnalysis) -> list[tuple[str, str, str]]:
    """Value, unit and meaning of what matters most."""
    scale, selected = error_scale(analysis), analysis.selected
    before = tables.number(scale.per_si * analysis.before.held_out_rms)
    after = f' → {tables.number(scale.per_si * selected.held_out_rms)}' if selected else ''
    held_out = 'later half, predicted' if len(analysis.records) == 1 else 'after unloading, record by record held out'
    of_law = 'law (6) → selected law' if selected else 'law (6)'
    return [
        (before + after, scale.unit, f'rms error {held_out}: {of_law}'),
        (p_equals(analysis.p_value), '', 'p-value of law (6) as a sufficient law'),
        *([(p_equals(analysis.p_after), '', 'p-value of the selected law as a sufficient law')] if selected else []),
    ]


def _most_telling(analysis: LoadAnalysis) -> list[int]:
    """The records, that with the largest error of law (6) first."""
    errors = [record_errors(analysis, number).before for number in range(len(analysis.records))]
    return sorted(range(len(errors)), key=lambda number: -errors[number])


def _record(analysis: LoadAnalysis, number: int) -> dict[str, Any]:
    record, selected = analysis.records[number], analysis.selected
    after = selected.held_out[number] if selected else None
    start = float(record.time[int(judged(analysis, record).argmax())])
    return _pictures(analysis, record, analysis.before.held_out[number], after, start, f'record{number}')


def _predicted(analysis: LoadAnalysis, each: PredictedRecord, name: str) -> dict[str, Any]:
    after = each.after if analysis.selected else None
    return _pictures(analysis, each.record, each.before, after, float(each.record.time[each.record.unloaded]), name)


def _pictures(
    analysis: LoadAnalysis, record: LoadRecord, before: Prediction, after: Prediction | None, start: float, name: str
) -> dict[str, Any]:
    curve = figures.Curve(
        _averaged(record.time),
        _averaged(record.load_change),
        _averaged(response_change(record)),
        _averaged(before.residual),
        None if after is None else _averaged(after.residual),
        start,
        response_scale(analysis),
        error_scale(analysis),
    )
    words = text.units(analysis)
    return {
        'name': record.name,
        'response': figures.response_picture(curve, words, f'{name}_response'),
        'residual': figures.residual_picture(curve, f'{name}_residual'),
    }


def _averaged(values: Floats) -> Floats:
    block = -(-len(values) // _POINTS)
    count = len(values) // block
    return np.asarray(values[: count * block].reshape(count, block).mean(axis=1))
