"""`hysteresis.html` of records driven by their load: one self-contained page.

Figures of records driven by their load: the response over the load, and the residual over time.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.report.figure import FAINT, INK, LINE, SERIES, Margins, as_svg, new_figure, style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.quantities import Scale, p_equals
from scara_kinetostatic.studies.hysteresis.analysis import Units
from scara_kinetostatic.studies.hysteresis.load_driven import text
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import LoadAnalysis, PredictedRecord
from scara_kinetostatic.studies.hysteresis.load_driven.fit import Prediction
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord
from scara_kinetostatic.studies.hysteresis.load_driven.text import (
    error_scale,
    judged,
    record_errors,
    response_change,
    response_scale,
)
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, UNEXPLAINED

WIDTH, HEIGHT = 450.0, 300.0
_MARGINS = Margins(left=64, right=8, bottom=74, top=12)
_BEFORE, _AFTER = SERIES[1], SERIES[0]


class Curve(NamedTuple):
    """What the figures show of one record; arrays (n,), counted from rest.

    Attributes:
        time: s.
        load: N or Nm.
        response: m or rad.
        before: residual of law (6), m or rad.
        after: that of the selected law; None where none is selected.
        unloaded: time from which on the residual is judged, s.
        response_scale: unit of the response.
        error_scale: unit of the residuals.
    """

    time: Floats
    load: Floats
    response: Floats
    before: Floats
    after: Floats | None
    unloaded: float
    response_scale: Scale
    error_scale: Scale


def response_picture(curve: Curve, units: Units, name: str) -> Markup:
    """Response over load: measured, law (6), and the selected law.

    Args:
        curve: of one record.
        units: force and displacement, or torque and angle.
        name: identifier of the picture on the page.
    """
    figure, (axes,) = new_figure(WIDTH, HEIGHT, margins=_MARGINS)
    axes.plot(curve.load, curve.response_scale.per_si * curve.response, color=INK, lw=0.8, label='measured')
    for residual, colour, label in _laws(curve):
        predicted = curve.response_scale.per_si * (curve.response - residual)
        axes.plot(curve.load, predicted, color=colour, lw=1.5, label=label)
    axes.set(xlabel=f'{units.load}  [{units.si_unit("N")}]', ylabel=f'{units.response}  [{curve.response_scale.unit}]')
    _legend(axes)
    return as_svg(figure, name, f'{units.response} over {units.load}, measured and by both laws')


def residual_picture(curve: Curve, name: str) -> Markup:
    """Residual over time of law (6) and of the selected law, the predicted part shaded; arguments as above."""
    figure, (axes,) = new_figure(WIDTH, HEIGHT, margins=_MARGINS)
    axes.axvspan(curve.unloaded, curve.time[-1], color=LINE, lw=0, alpha=0.5)
    axes.axhline(0, color=FAINT, lw=0.9)
    for residual, colour, label in _laws(curve):
        axes.plot(curve.time, curve.error_scale.per_si * residual, color=colour, lw=1.0, label=label)
    axes.set(xlabel='time  [s]', ylabel=f'residual  [{curve.error_scale.unit}]')
    axes.set_xlim(curve.time[0], curve.time[-1])
    _legend(axes)
    return as_svg(figure, name, 'residual over time of both laws; the part after the load has gone is shaded')


def _laws(curve: Curve) -> list[tuple[Floats, str, str]]:
    laws = [(curve.before, _BEFORE, 'law (6)')]
    return laws if curve.after is None else [*laws, (np.asarray(curve.after), _AFTER, 'selected law')]


def _legend(axes: Axes) -> None:
    axes.legend(frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.19), ncols=3, handlelength=1.4)


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
        record_table=text.record_table(analysis),
        single=len(analysis.records) == 1,
        records=shown,
        open=_OPEN,
        selected=analysis.selected is not None,
        state=analysis.selected is not None and analysis.selected.law.has_state,
        errors=text.errors_note(analysis),
        candidates=text.candidate_table(analysis),
        dependences=text.dependence_table(analysis),
        sign_note=text.sign_note(analysis),
        parameters=text.parameter_table(analysis),
        predicted_note=text.PREDICTED,
        prediction_table=text.prediction_table(analysis, predicted) if predicted else None,
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
    before = text.number(scale.per_si * analysis.before.held_out_rms)
    after = f' → {text.number(scale.per_si * selected.held_out_rms)}' if selected else ''
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
    curve = Curve(
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
        'response': response_picture(curve, words, f'{name}_response'),
        'residual': residual_picture(curve, f'{name}_residual'),
    }


def _averaged(values: Floats) -> Floats:
    block = -(-len(values) // _POINTS)
    count = len(values) // block
    return np.asarray(values[: count * block].reshape(count, block).mean(axis=1))
