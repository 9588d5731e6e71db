"""The outcome on a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.render.quantities import shown
from scara_kinetostatic.report import messages as words
from scara_kinetostatic.report.parameter_rows import STATUS, Row, parameter_rows

WIDTH = 100
MOST_REJECTED = 12


def text_report(outcome: Outcome) -> str:
    """The table of parameters and what to think of it."""
    verdict = words.verdict(outcome)
    lines = [f'{verdict.headline}.', *_wrapped(verdict.sentences, '  '), '']
    lines += _table(parameter_rows(outcome.final))
    lines += _effects(outcome.diagnosis.found)
    lines += ['', *_facts(outcome)]
    lines += _rejected(outcome)
    if outcome.warnings:
        lines += ['', 'About the recording:', *_wrapped(outcome.warnings, '  ')]
    return '\n'.join(lines) + '\n'


def _table(rows: list[Row]) -> list[str]:
    width = {
        field: max(len(getattr(row, field)) for row in rows) for field in ('name', 'nominal', 'value', 'std', 'unit')
    }
    value, std = max(width['value'], 10), max(width['std'], 3)
    nominal = max(width['nominal'], 7)
    head = f'{"":{width["name"]}}  {"nominal":>{nominal}}  {"calibrated":>{value}}   {"std":<{std}}'
    lines = [head.rstrip()]
    for row in rows:
        sign = '±' if row.std else ' '
        note = f'{row.unit:{width["unit"]}}  {STATUS[row.status] or row.description}'
        numbers = f'{row.nominal:>{nominal}}  {row.value:>{value}} {sign} {row.std:<{std}}'
        lines.append(f'{row.name:{width["name"]}}  {numbers}  {note}'.rstrip())
    return lines


def _effects(found: Sequence[Found]) -> list[str]:
    """What the extended model has beyond the twelve."""
    lines = ['', 'beyond the twelve parameters'] if found else []
    for item in found:
        lines += _wrapped(
            [words.effect_name(item.effect) + ('' if item.in_every_model else ', or a rival of it')], '  '
        )
        if not isinstance(item.effect, Unnamed):
            lines += [f'    {v.name}  {shown(v.value, v.std, v.unit).text}  {v.meaning}'[:WIDTH] for v in item.values]
    return lines


def _facts(outcome: Outcome) -> list[str]:
    c = outcome.final
    facts = {
        'touches': f'{int(c.used.sum())} used of {outcome.found} found',
        'force error': words.force_errors(outcome),
        'tip error': words.tip_errors(outcome),
        'bent': words.bent(outcome),
        'chi-square': words.fit_quality(outcome),
        'noise': words.noise(outcome),
        'determined': ' '.join(words.identifiability(outcome)),
    }
    lines = []
    for name, text in ((name, text) for name, text in facts.items() if text):
        lines += textwrap.wrap(text, WIDTH, initial_indent=f'{name:13}', subsequent_indent=' ' * 13)
    return lines


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
        lines += textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent + '  ') or []
    return lines
