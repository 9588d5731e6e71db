"""A comparison of calibrations as JSON, as text and as a page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scara_kinetostatic import __version__
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.monitoring.comparison import LEVEL, Change
from scara_kinetostatic.monitoring.difference import ParameterChange
from scara_kinetostatic.monitoring.hypotheses import Explanation, change_title
from scara_kinetostatic.monitoring.page import Part, explanation_table, html_page, number
from scara_kinetostatic.render.json_file import Document
from scara_kinetostatic.render.quantities import chance, p_equals, shown
from scara_kinetostatic.render.table import Table
from scara_kinetostatic.report.messages import sentence

NAME, PAGE_NAME = 'comparison.json', 'comparison.html'
SCHEMA = 'scara_kinetostatic/comparison/1'


def comparison_document(changes: Sequence[Change]) -> Document:
    """All numbers; SI units, None for what is not determined."""
    return {'schema': SCHEMA, 'version': __version__, 'changes': [_change(change) for change in changes]}


def _change(c: Change) -> Document:
    return {
        'from': {'path': c.before.source, 'created': c.before.created},
        'to': {'path': c.after.source, 'created': c.after.created},
        'changed': c.has_changed,
        'p_value': c.p_value,
        'chi_square': c.chi_square,
        'degrees_of_freedom': c.degrees_of_freedom,
        'parameters': {p.name: _parameter(p) for p in c.parameters},
        'tip_change': {'rms': _or_none(c.tip), 'largest': _or_none(c.largest_tip)},
        'part': None if not c.has_changed else explanation_document(c.ranking[0]),
        'rivals': list(c.rivals) if c.has_changed else [],
        'remaining_p_value': c.remaining_p_value if c.has_changed else None,
        'candidates': [explanation_document(item) for item in c.ranking],
        'effects': {
            'only_from': list(c.only_before),
            'only_to': list(c.only_after),
            'not_compared': list(c.not_compared),
        },
        'notes': list(c.notes),
    }


def _parameter(p: ParameterChange) -> Document:
    return {
        'from': p.before,
        'to': p.after,
        'change': p.change,
        'std': _or_none(p.std),
        'std_independent': _or_none(p.std_independent),
        'z': _or_none(p.z),
        'p_value': _or_none(p.p_value),
        'unit': p.unit,
    }


def explanation_document(item: Explanation) -> Document:
    """A hypothesis with its evidence."""
    h = item.hypothesis
    rows = zip(h.values, item.change, item.std, h.units, strict=True)
    return {
        'name': item.name,
        'title': h.title,
        'statistic': item.statistic,
        'score': item.score,
        'change': [
            {'name': name, 'value': value, 'std': _or_none(std), 'unit': unit} for name, value, std, unit in rows
        ],
    }


def _or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def comparison_text(changes: Sequence[Change]) -> str:
    """As text for a terminal."""
    parts = []
    for change in changes:
        lines = [f'{change.before.source} → {change.after.source}', f'{verdict(change)}.']
        lines += [f'  {sentence}.' for sentence in sentences(change)]
        parts.append('\n'.join([*lines, '', parameter_table(change).text()]))
    return '\n\n'.join(parts)


def verdict(change: Change) -> str:
    """One line: whether anything changed, and what most likely."""
    if not change.has_changed:
        except_for = f', but {", ".join(change.not_compared)} cannot be compared' if change.not_compared else ''
        return f'No change beyond the uncertainty ({p_equals(change.p_value)}){except_for}'
    if change.remaining_p_value < LEVEL:
        return f'Changed ({p_equals(change.p_value)}); no single part explains it'
    return f'Changed ({p_equals(change.p_value)}): {change.ranking[0].hypothesis.title}'


def sentences(change: Change) -> list[str]:
    """The rest of the verdict."""
    tip = f'The predicted tip moved by {quantity(change.tip, "m")} (rms), {quantity(change.largest_tip, "m")} at most'
    found = [f'{tip}, at the touches of the second calibration']
    if change.has_changed:
        if change.remaining_p_value < LEVEL:
            best = change.ranking[0].hypothesis.title
            found.append(f'The largest part of it: {best}; what it leaves is significant, too')
        if change.rivals:
            found.append(f'About as likely: {"; ".join(change_title(name) for name in change.rivals)}')
    for effects, which in ((change.only_before, 'first'), (change.only_after, 'second')):
        if effects:
            found.append(f'Only the {which} calibration has {", ".join(effects)}')
    return found + [sentence(note).rstrip('.') for note in change.notes]


def _p_value(p_value: float) -> str:
    return chance(p_value) if p_value < 1 else number(p_value, '.2g')


def parameter_table(change: Change) -> Table:
    """One row per value."""
    rows = []
    for p in change.parameters:
        difference = shown(p.change, p.std, p.unit)
        before, after = (shown(value, p.std, p.unit) for value in (p.before, p.after))
        values = (f'{item.value} {item.unit}' for item in (before, after))
        rows.append((p.name, *values, difference.text, number(p.z, '+.1f'), _p_value(p.p_value)))
    return Table(('', 'from', 'to', 'change ± 1 σ', 'z', 'p'), ('',) * 6, tuple(rows))


_COMMON = (
    'σ of the change: errors that both calibrations share, such as those of the discs’ places, are counted only as far '
    'as they do not cancel. z: change in σ; p: of one value alone, two-sided.'
)


def comparison_page(changes: Sequence[Change]) -> str:
    """The page."""
    parts = []
    for change in changes:
        tables = [('Parameters', parameter_table(change), _COMMON)]
        if change.has_changed:
            note = 'Chi-square that each hypothesis explains, of ' + f'{change.chi_square:.1f} in all.'
            tables.append(('What changed', explanation_table(change.ranking, change.rivals), note))
        heading = f'{change.before.source} → {change.after.source}' if len(changes) > 1 else ''
        level = 'caution' if change.has_changed or change.not_compared else 'good'
        texts = tuple(f'{sentence}.' for sentence in sentences(change))
        parts.append(Part(heading, f'{verdict(change)}.', level, texts, tuple(tables)))
    names = [changes[0].before.source, *(change.after.source for change in changes)]
    return html_page('What changed between calibrations', ', '.join(names), parts, NAME)
