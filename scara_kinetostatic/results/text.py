"""The outcome as text for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from scara_kinetostatic.assessment.grade import Assessment
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.report.quantities import shown
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.results import messages
from scara_kinetostatic.results.budget_table import largest_of_tip, tip_sentences
from scara_kinetostatic.results.parameter_rows import STATUS, Row, parameter_rows

_WIDTH = 100
"""Of a line, characters."""
MOST_REJECTED = 12
"""So many rejected touches are listed."""
_INDENT = 13


def text_report(outcome: Outcome) -> str:
    """Assessment, verdict, parameters, effects, errors, rejected touches."""
    verdict = messages.verdict(outcome)
    lines = [*_assessment(outcome.assessment), '']
    lines += [*_wrapped([f'{verdict.headline}.'], ''), *_wrapped(verdict.sentences, '  '), '']
    lines += _parameters(parameter_rows(outcome.final))
    lines += _effects(outcome.diagnosis.found)
    lines += ['', *_facts(outcome)]
    lines += _budget(outcome)
    lines += _rejected(outcome)
    if outcome.warnings:
        lines += ['', 'About the recording:', *_wrapped(outcome.warnings, '  ')]
    return '\n'.join(lines) + '\n'


def _assessment(assessment: Assessment) -> list[str]:
    """Grade and first reason, then the other reasons and what to do."""
    lines = _wrapped([f'{messages.ANSWERS[assessment.grade]}: {assessment.reasons[0]}.'], '')
    lines += _wrapped((f'- {messages.sentence(reason)}' for reason in assessment.reasons[1:]), '  ')
    return lines + _wrapped((f'To do: {action}.' for action in assessment.actions), '  ')


def _parameters(rows: Sequence[Row]) -> list[str]:
    cells = tuple(
        (
            row.name,
            row.nominal,
            f'{row.value} ± {row.std}' if row.std else row.value,
            row.unit,
            STATUS[row.status] or row.description,
        )
        for row in rows
    )
    return Table(('', 'nominal', 'estimate ± 1 σ', '', ''), ('',) * 5, cells).lines()


def _effects(found: Sequence[Found]) -> list[str]:
    """The effects of the extended model with their values; those of a fitted curve have no meaning by themselves."""
    lines = ['', 'added to the base model'] if found else []
    for item in found:
        note = ' (possible, not proved)' if item.is_possible else ''
        note = note if item.in_every_model else ' (one of several possible causes)'
        label = f'  {item.effect.label}' if item.effect.is_physical else ''
        lines += _wrapped([item.effect.title + note + label], '  ')
        if item.effect.is_physical and item.values:
            rows = tuple((f'    {v.name}', shown(v.value, v.std, v.unit).text, v.meaning) for v in item.values)
            lines += [line[:_WIDTH] for line in Table(('',) * 3, ('',) * 3, rows).lines()[1:]]
    return lines


def _facts(outcome: Outcome) -> list[str]:
    c = outcome.final
    facts = {
        'touches': f'{int(c.used.sum())} used of {outcome.found} found',
        'force error': messages.force_errors(outcome),
        'tip error': messages.tip_errors(outcome),
        'bias': messages.bias(outcome),
        'chi-square': messages.fit_quality(outcome),
        'noise': messages.noise(outcome),
        'determined': ' '.join(messages.identifiability(outcome)),
    }
    lines = []
    for name, text in ((name, text) for name, text in facts.items() if text):
        lines += textwrap.wrap(text, _WIDTH, initial_indent=f'{name:{_INDENT}}', subsequent_indent=' ' * _INDENT)
    return lines


def _budget(outcome: Outcome) -> list[str]:
    """Uncertainty of the tip and what contributes most to it, where uncertainties are declared or a tolerance is."""
    table, cell = largest_of_tip(outcome), outcome.final.cell
    if DeclaredErrors.of(cell) is None and cell.tolerance is None:
        return []
    sentences = _wrapped((f'{text}.' for text in tip_sentences(outcome)), '')
    return ['', *sentences, *([] if table is None else table.lines())]


def _rejected(outcome: Outcome) -> list[str]:
    if not outcome.rejected:
        return []
    lines = ['', f'Not used ({len(outcome.rejected)}):']
    lines += _wrapped((f'touch {item.index}: {item.reason}' for item in outcome.rejected[:MOST_REJECTED]), '  ')
    if len(outcome.rejected) > MOST_REJECTED:
        lines.append(f'  and {len(outcome.rejected) - MOST_REJECTED} more, see the report')
    return lines


def _wrapped(sentences: Iterable[str], indent: str) -> list[str]:
    lines = []
    for text in sentences:
        lines += textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent + '  ') or []
    return lines
