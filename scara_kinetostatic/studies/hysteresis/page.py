"""`hysteresis.html`: one self-contained page with the hysteresis analysis.

Figures of the hysteresis analysis: laws over the loop, residuals over the distance, leave-one-out predictions.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.report.figure import FAINT, INK, SERIES, as_svg, style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.studies.hysteresis import text
from scara_kinetostatic.studies.hysteresis.analysis import IDENTIFICATION_SWEEPS, HysteresisAnalysis, Record
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, UNEXPLAINED, CrossValidation
from scara_kinetostatic.studies.hysteresis.motion import Rows
from scara_kinetostatic.studies.hysteresis.text import force

WIDTH = 920.0
_RISING, _FALLING = SERIES[0], SERIES[1]
_BEFORE, _AFTER = SERIES[1], SERIES[0]


def loop_picture(record: Record, name: str) -> Markup:
    """The later half of the sweeps, measured, and each law as fitted to the earlier half.

    Args:
        record: what to show.
        name: identifier of the picture on the page.
    """
    figure, panels = _panels(380)
    motion, selection = record.motion, record.selection
    rows = ~motion.earlier
    shown = [(selection.before, _BEFORE, 'law (6)')]
    after = [(selection.selected, _AFTER, 'selected law')] if selection.selected is not None else []
    milli, kilo = _factors(record)
    for axes, laws in zip(panels, (shown, after), strict=True):
        axes.plot(milli * motion.displacement[rows], kilo * motion.force[rows], color=INK, lw=0.8, label='measured')
        for score, colour, label in laws:
            predicted = motion.force - score.halves[0].residual
            axes.plot(milli * motion.displacement[rows], kilo * predicted[rows], color=colour, lw=1.4, label=label)
        axes.set(xlabel=_response_label(record))
        _legend(axes)
    panels[0].set(ylabel=_load_label(record))
    words = f'{record.units.load} over {record.units.response}'
    return as_svg(figure, name, f'{words} of the sweeps held out, measured and predicted')


def residual_picture(record: Record, name: str) -> Markup:
    """Held-out residual over the distance since the reversal: law (6), and the selected law."""
    figure, panels = _panels(330)
    selection = record.selection
    for axes, score, label in zip(panels, (selection.before, selection.final), ('before', 'after'), strict=True):
        _residual(axes, record, score)
        axes.axhline(0, color=FAINT, lw=0.9)
        axes.set(xlabel=f'distance since the reversal  [{record.units.unit("mm")}]')
        axes.set_title(f'{label}: rms {force(score.held_out_rms)} {record.units.unit("N")}')
    panels[0].set(ylabel=f'held-out residual  [{record.units.unit("kN")}]')
    return as_svg(figure, name, 'residual on sweeps held out over the distance since the reversal, before and after')


def _residual(axes: Axes, record: Record, score: CrossValidation) -> None:
    motion, (milli, kilo) = record.motion, _factors(record)
    for sense, colour, label in ((1, _RISING, 'rising'), (-1, _FALLING, 'falling')):
        first = True
        for k in np.flatnonzero(motion.sense[motion.edges[:-1]] == sense):
            if k == 0:
                continue
            rows = slice(motion.edges[k], motion.edges[k + 1])
            distance = milli * motion.distance[rows]
            axes.plot(distance, kilo * score.held_out[rows], color=colour, lw=0.8, label=label if first else None)
            first = False
    _legend(axes)


def prediction_picture(analysis: HysteresisAnalysis, name: str) -> Markup:
    """Each record as predicted from the others."""
    columns = len(analysis.leave_one_out)
    figure = Figure(figsize=(WIDTH / 72, 330 / 72), dpi=72, layout='constrained')
    panels = figure.subplots(1, columns, squeeze=False)[0]
    for axes, each in zip(panels, analysis.leave_one_out, strict=True):
        record = analysis.records[each.record]
        _both(axes, record, each.residual, record.motion.sweep >= IDENTIFICATION_SWEEPS)
        axes.set(xlabel=_response_label(record))
        axes.set_title(f'{each.tension:g} from the others: rms {force(each.by_tension)} {record.units.unit("N")}')
    panels[0].set(ylabel=_load_label(analysis.records[0]))
    words = f'{analysis.units.load} over {analysis.units.response}'
    return as_svg(figure, name, f'{words} of each record, measured and predicted from the others')


def _both(axes: Axes, record: Record, residual: Floats, rows: Rows) -> None:
    motion, (milli, kilo) = record.motion, _factors(record)
    displacement, measured = milli * motion.displacement[rows], kilo * motion.force[rows]
    axes.plot(displacement, measured, color=INK, lw=0.8, label='measured')
    axes.plot(displacement, measured - kilo * residual[rows], color=_AFTER, lw=1.4, label='predicted')
    _legend(axes)


def _factors(record: Record) -> tuple[float, float]:
    return record.units.factor('mm', 1e3), record.units.factor('kN', 1e-3)


def _response_label(record: Record) -> str:
    return f'{record.units.response}  [{record.units.unit("mm")}]'


def _load_label(record: Record) -> str:
    return f'{record.units.load}  [{record.units.unit("kN")}]'


def _panels(height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH / 72, height / 72), dpi=72, layout='constrained')
    return figure, list(figure.subplots(1, 2, sharey=True))


def _legend(axes: Axes) -> None:
    axes.legend(frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.15), ncols=3, handlelength=1.4)


NAME = 'hysteresis.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(analysis: HysteresisAnalysis) -> str:
    """The page."""
    with style():
        records = [_record(record, f'loop{k}') for k, record in enumerate(analysis.records)]
        prediction = prediction_picture(analysis, 'prediction') if analysis.leave_one_out else None
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[record.source for record in analysis.records],
        summary=text.summary_table(analysis),
        driven=text.in_words(text.DRIVEN, analysis.units),
        units=analysis.units,
        errors=text.in_words(text.ERRORS, analysis.units),
        records=records,
        prediction=prediction,
        prediction_sentences=[text.in_words(text.PREDICTION, analysis.units), *text.prediction_sentences(analysis)]
        if analysis.leave_one_out
        else [],
        prediction_table=text.prediction_table(analysis),
        notes=[note for record in analysis.records for note in record.notes],
    )


def _record(record: Record, name: str) -> dict[str, Any]:
    headline, sentences = text.verdict(record)
    return {
        'name': record.name,
        'source': record.source,
        'size': text.sweeps(record),
        'level': _level(record),
        'headline': headline,
        'sentences': sentences,
        'loop': loop_picture(record, f'{name}_record'),
        'residual': residual_picture(record, f'{name}_residual'),
        'candidates': text.candidate_table(record),
        'dependences': text.dependence_table(record),
        'parameters': text.parameter_table(record),
    }


def _level(record: Record) -> str:
    """Colour of the verdict: good only for a single law whose residual is noise."""
    selection = record.selection
    if selection.verdict == UNEXPLAINED:
        return 'bad'
    incomplete = selection.verdict == AMBIGUOUS or text.is_correlated(record) or selection.p_after < LEVEL
    return 'caution' if incomplete else 'good'
