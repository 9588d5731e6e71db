"""`hysteresis.html`: one self-contained page with the hysteresis analysis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.figure import style
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.studies.hysteresis import figures, tables, text
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, Record
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, UNEXPLAINED

NAME = 'hysteresis.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(analysis: HysteresisAnalysis) -> str:
    """The page."""
    with style():
        records = [_record(record, f'loop{k}') for k, record in enumerate(analysis.records)]
        prediction = figures.prediction_picture(analysis, 'prediction') if analysis.leave_one_out else None
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[record.source for record in analysis.records],
        summary=tables.summary_table(analysis),
        driven=text.in_words(text.DRIVEN, analysis.units),
        units=analysis.units,
        errors=text.in_words(text.ERRORS, analysis.units),
        records=records,
        prediction=prediction,
        prediction_sentences=[text.in_words(text.PREDICTION, analysis.units), *text.prediction_sentences(analysis)]
        if analysis.leave_one_out
        else [],
        prediction_table=tables.prediction_table(analysis),
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
        'loop': figures.loop_picture(record, f'{name}_record'),
        'residual': figures.residual_picture(record, f'{name}_residual'),
        'candidates': tables.candidate_table(record),
        'dependences': tables.dependence_table(record),
        'parameters': tables.parameter_table(record),
    }


def _level(record: Record) -> str:
    """Colour of the verdict: good only for a single law whose residual is noise."""
    selection = record.selection
    if selection.verdict == UNEXPLAINED:
        return 'bad'
    incomplete = selection.verdict == AMBIGUOUS or text.is_correlated(record) or selection.p_after < LEVEL
    return 'caution' if incomplete else 'good'
