"""`loops.html`: one self-contained page on what measured loops show beyond slope and gap."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.render.figure import style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.studies.dial_gauge.text import Table
from scara_kinetostatic.studies.hysteresis import figures as pictures
from scara_kinetostatic.studies.hysteresis import tables
from scara_kinetostatic.studies.hysteresis import text as words
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisStudy, Record
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, UNEXPLAINED

NAME = 'loops.html'
_TEMPLATE = Path(__file__).parent / 'page.html.j2'


def html_text(study: HysteresisStudy) -> str:
    """The page."""
    with style():
        records = [_record(record, f'loop{k}') for k, record in enumerate(study.records)]
        transfer = pictures.transfer_picture(study, 'transfer') if study.transfers else None
    return page_template(_TEMPLATE).render(
        version=__version__,
        sources=[record.source for record in study.records],
        summary=_table(tables.summary_table(study)),
        errors=words.ERRORS,
        records=records,
        transfer=transfer,
        transfer_words=[words.TRANSFER, *words.transfer_sentences(study)] if study.transfers else [],
        transfer_table=_table(tables.transfer_table(study)),
        notes=[note for record in study.records for note in record.notes],
    )


def _record(record: Record, name: str) -> dict[str, Any]:
    headline, sentences = words.verdict(record)
    return {
        'source': record.source,
        'what': words.sweeps(record),
        'level': _level(record),
        'headline': headline,
        'sentences': sentences,
        'loop': pictures.loop_picture(record, f'{name}_record'),
        'residual': pictures.residual_picture(record, f'{name}_residual'),
        'candidates': _table(tables.candidate_table(record)),
        'refinements': _table(tables.refinement_table(record)) if record.choice.refinements else None,
        'dependences': _table(tables.dependence_table(record)),
        'parameters': _table(tables.parameter_table(record)),
    }


def _level(record: Record) -> str:
    """Good only where nothing is left."""
    if record.choice.verdict == UNEXPLAINED:
        return 'bad'
    open_still = record.choice.verdict == AMBIGUOUS or words.structured(record) or record.choice.p_left < LEVEL
    return 'caution' if open_still else 'good'


def _table(table: Table) -> dict[str, Any]:
    numbers = [tables.is_number(table, k) for k in range(len(table.heading))]
    return {
        'columns': list(zip(table.heading, table.units, numbers, strict=True)),
        'rows': table.rows,
        'numbers': numbers,
    }
