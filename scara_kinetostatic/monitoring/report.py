"""Pages of monitoring: parts with a verdict, figures and tables.

A comparison of calibrations as JSON, as text and as a page.

A verification as JSON, as text and as a page.

A history of calibrations as text and as a page with the trend of every parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.monitoring.comparison import LEVEL, Change, ParameterChange
from scara_kinetostatic.monitoring.history import Trend
from scara_kinetostatic.monitoring.hypotheses import Explanation, change_title
from scara_kinetostatic.monitoring.linear import QUANTILE
from scara_kinetostatic.monitoring.verification import POWER, Detectable, Outlying, Verification
from scara_kinetostatic.report.figure import FAINT, INK, MICRO, WARN, as_svg, new_figure, style
from scara_kinetostatic.report.json_file import Document, utc
from scara_kinetostatic.report.page import page_template
from scara_kinetostatic.report.quantities import chance, count, p_equals, shown
from scara_kinetostatic.report.table import NOT_DETERMINED, Table
from scara_kinetostatic.results.messages import ANSWERS, sentence

_TEMPLATE = Path(__file__).with_name('page.html.j2')
LEVELS = {'fit': 'good', 'caution': 'caution', 'unfit': 'bad'}
"""Colour of a verdict by grade."""
_SHOWN = 8
"""So many hypotheses are listed."""


class Part(NamedTuple):
    """A section of a page.

    Attributes:
        heading: empty for none.
        verdict: one line; empty for none.
        level: ``good``, ``caution`` or ``bad``.
        sentences: below the verdict.
        tables: heading, table, note of each.
        figures: with their captions.
    """

    heading: str = ''
    verdict: str = ''
    level: str = 'good'
    sentences: tuple[str, ...] = ()
    tables: tuple[tuple[str, Table, str], ...] = ()
    figures: tuple[tuple[Markup, str], ...] = ()


def html_page(title: str, source: str, parts: Sequence[Part], json_name: str) -> str:
    """One self-contained page.

    Args:
        title: its heading.
        source: below it, the files.
        parts: its sections.
        json_name: of the file with all numbers.
    """
    template = page_template(_TEMPLATE)
    return template.render(version=__version__, title=title, source=source, parts=parts, json_name=json_name)


def explanation_table(ranking: Sequence[Explanation], rivals: Sequence[str]) -> Table:
    """The hypotheses of what changed, the best first."""
    rows = []
    for number, item in enumerate(ranking[:_SHOWN]):
        remark = 'best' if number == 0 else 'rival' if item.name in rivals else ''
        rows.append((item.hypothesis.title, f'{item.statistic:.1f}', str(len(item.change)), item.text, remark))
    return Table(('what changed', 'explains', 'values', 'by', ''), ('', 'chi-square', '', '', ''), tuple(rows))


def number(value: float, digits: str) -> str:
    """A number as text, a dash where there is none."""
    return format(value, digits) if value == value else NOT_DETERMINED


def comparison_document(changes: Sequence[Change]) -> Document:
    """All numbers; SI units, None for what is not determined."""
    return {
        'schema': 'scara_kinetostatic/comparison/1',
        'version': __version__,
        'changes': [_change(change) for change in changes],
    }


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
    return html_page('What changed between calibrations', ', '.join(names), parts, 'comparison.json')


_LISTED = 20
"""Outliers on the page."""


def verification_document(v: Verification) -> Document:
    """All numbers; SI units."""
    return {
        'schema': 'scara_kinetostatic/verification/1',
        'version': __version__,
        'calibration': {'path': v.record.source, 'created': v.record.created, 'grade': v.record.arm.grade},
        'recordings': [
            {
                'path': item.path,
                'sha256': item.sha256,
                'start': None if item.start is None else utc(item.start),
                'part_of_calibration': item.path in v.seen,
            }
            for item in v.recordings
        ],
        'grade': v.assessment.grade.value,
        'reasons': list(v.assessment.reasons),
        'actions': list(v.assessment.actions),
        'tip_error': v.tip_error,
        'expected': v.expected,
        'nominal_tip_error': v.nominal_tip_error,
        'p_value': v.p_value,
        'without_outlying': {'p_value': v.others_p_value, 'tip_error': v.others_tip_error} if v.few_outlie else None,
        'chi_square': {
            'value': v.chi_square,
            'degrees_of_freedom': v.degrees_of_freedom,
            'quantile': v.quantile,
            'probability': QUANTILE,
        },
        'touches': {
            'used': v.touches,
            'of_the_calibration': v.repeated,
            'rejected': [{'index': item.index, 'reason': item.reason} for item in v.rejected],
            'outlying': [_outlying(item) for item in v.outlying],
            'index': v.numbers.tolist(),
            'tip_error': v.tip_errors.tolist(),
            'expected': v.expected_errors.tolist(),
        },
        'detectable': {d.name: _detectable(d) for d in v.detectable},
        'independent': not v.seen and not v.repeated,
        'part': explanation_document(v.ranking[0]) if v.ranking else None,
        'rivals': list(v.rivals),
        'remaining_p_value': v.remaining_p_value if v.ranking else None,
        'candidates': [explanation_document(item) for item in v.ranking],
        'warnings': list(v.warnings),
    }


def _detectable(item: Detectable) -> Document:
    seen = np.isfinite(item.change)
    return {'change': item.change if seen else None, 'unit': item.unit, 'tip': item.tip if seen else None}


def _outlying(item: Outlying) -> Document:
    return {'index': item.touch, **{name: getattr(item, name) for name in ('object', 'distance', 'tip_error')}}


def verification_text(v: Verification) -> str:
    """As text for a terminal."""
    a = v.assessment
    lines = [f'{ANSWERS[a.grade]}: {a.reasons[0]}.', *(f'  - {sentence(reason)}' for reason in a.reasons[1:])]
    lines += [f'  To do: {action}.' for action in a.actions]
    lines += ['', *summary_table(v).lines()[1:]]  # there is no heading
    if v.rivals:
        lines += ['', f'About as likely: {"; ".join(change_title(name) for name in v.rivals)}.']
    return '\n'.join([*lines, *(f'note: {warning}' for warning in v.warnings)])


def summary_table(v: Verification) -> Table:
    """The numbers of the verification."""
    rows = (
        ('touches', str(v.touches)),
        ('tip error, rms', quantity(v.tip_error, 'm')),
        ('expected from noise and uncertainty', quantity(v.expected, 'm')),
        ('with the nominal parameters', quantity(v.nominal_tip_error, 'm')),
        ('chi-square', f'{v.chi_square:.1f}, {v.degrees_of_freedom} degrees of freedom'),
        (f'its {100 * QUANTILE:.0f} % quantile', f'{v.quantile:.1f}'),
        ('p-value', p_equals(v.p_value).removeprefix('p = ').removeprefix('p ')),
        *((('largest change not seen', v.detectable[0].text),) if v.detectable else ()),
        *((('without the outliers', p_equals(v.others_p_value)),) if v.few_outlie else ()),
    )
    return Table(('', ''), ('', ''), rows)


def verification_page(v: Verification) -> str:
    """The page."""
    a = v.assessment
    texts = [*(sentence(reason) for reason in a.reasons[1:]), *(f'To do: {action}.' for action in a.actions)]
    tables = [('Numbers', summary_table(v), 'The error of the tip: distance of the predicted tip from the circle.')]
    if v.ranking:
        tables.append(('What may have changed', explanation_table(v.ranking, v.rivals), ''))
    if v.outlying:
        tables.append(_outlying_table(v.outlying))
    tables.append(('What these touches show', _detectable_table(v.detectable), _SHOWN_NOTE))
    caption = (
        'Error of the predicted tip along the contact normal; grey: two standard deviations expected. '
        'Red: outliers, which may be by the direction of the force.'
    )
    figures = ((_figure(v), caption),)
    part = Part('', f'{ANSWERS[a.grade]}: {a.reasons[0]}.', LEVELS[a.grade.value], tuple(texts), tuple(tables), figures)
    source = f'{v.record.source}, verified with {", ".join(item.path for item in v.recordings)}'
    return html_page('Verification of a calibration', source, [part], 'verification.json')


_SHOWN_NOTE = (
    f'The smallest change of each parameter by itself that these touches show with {100 * POWER:.0f} % probability, '
    'and by how much it moves the tip at the touches of the calibration. Smaller changes may go unseen.'
)


def _detectable_table(found: Sequence[Detectable]) -> Table:
    rows = []
    for item in found:
        seen = np.isfinite(item.change)
        numbers = (quantity(item.change, item.unit), quantity(item.tip, 'm')) if seen else (NOT_DETERMINED,) * 2
        rows.append((item.name, *numbers))
    return Table(('parameter', 'change', 'tip, rms'), ('',) * 3, tuple(rows))


def _outlying_table(outlying: Sequence[Outlying]) -> tuple[str, Table, str]:
    """The outliers, those farthest from their prediction."""
    worst = sorted(sorted(outlying, key=lambda o: -o.distance)[:_LISTED])
    rows = tuple((str(o.touch), o.object, f'{o.distance:.1f}', f'{MICRO * o.tip_error:.0f}') for o in worst)
    note = f'The {_LISTED} farthest of {len(outlying)}.' if len(outlying) > _LISTED else ''
    return 'Outliers', Table(('touch', 'object', 'distance', 'tip'), ('', '', 'σ', 'µm'), rows), note


def _figure(v: Verification) -> Markup:
    """Error of the predicted tip, touch by touch, by their numbers in the recordings."""
    order = np.argsort(v.numbers, kind='stable')
    touches, errors, expected = v.numbers[order], MICRO * v.tip_errors[order], MICRO * v.expected_errors[order]
    outlies = np.isin(touches, [item.touch for item in v.outlying])
    with style():
        figure, (axes,) = new_figure(640, 260)
        axes.fill_between(touches, -2 * expected, 2 * expected, color=FAINT, alpha=0.2, linewidth=0, step='mid')
        axes.plot(touches[~outlies], errors[~outlies], 'o', color=INK, markersize=3)
        axes.plot(touches[outlies], errors[outlies], 'o', color=WARN, markersize=4)
        axes.set_xlabel('touch')
        axes.set_ylabel('error of the tip [µm]')
        return as_svg(figure, 'tip_error', 'error of the predicted tip, touch by touch')


_SIGMAS = 2.0
"""Length of an error bar, standard uncertainties."""


def history_table(trends: Sequence[Trend]) -> Table:
    """One row per calibration."""
    rows = [
        (
            str(entry.number),
            entry.robot,
            entry.measured,
            entry.grade,
            NOT_DETERMINED if entry.worst_tip is None else quantity(entry.worst_tip, 'm'),
            'first' if change is None else verdict(change),
        )
        for trend in trends
        for entry, change in zip(trend.entries, trend.changes, strict=True)
    ]
    return Table(('', 'robot', 'measured', 'grade', 'tip, k = 2', 'since the one before'), ('',) * 6, tuple(rows))


def history_text(trends: Sequence[Trend]) -> str:
    """As text for a terminal."""
    slow = [f'{trend.robot}: {sentence}' for trend in trends for sentence in slow_sentences(trend)]
    return '\n'.join([history_table(trends).text(), *([''] if slow else []), *slow])


def slow_sentences(trend: Trend) -> list[str]:
    """What many small steps add up to; empty where there are fewer than two."""
    if trend.slow is None:
        return []
    change = verdict(trend.slow)
    return [f'from number {trend.since} to number {trend.entries[-1].number}: {change[0].lower()}{change[1:]}.']


_CHANCE = 'p is below 0.01 in one of 100 comparisons of a robot that has not changed.'


def history_page(trends: Sequence[Trend]) -> str:
    """The page: of each robot the calibrations and the trend of every parameter."""
    parts, total = [], sum(len(trend.entries) for trend in trends)
    with style():
        for number, trend in enumerate(trends):
            changed = trend.changed
            found = f'{count(len(changed), "change")} beyond the uncertainty'
            found += ' from one to the next, but a slow one' if trend.has_crept else ''
            text = f'{count(len(trend.entries), "calibration")}, {found}.'
            slow = [sentence[0].upper() + sentence[1:] for sentence in slow_sentences(trend)]
            texts = (*slow, *([_CHANCE] if changed else []))
            tables = (('Calibrations', history_table([trend]), ''),)
            figures = ((_trend_figure(trend, f'trend{number}'), _CAPTION),)
            level = 'caution' if changed or trend.has_crept else 'good'
            parts.append(Part(trend.robot, text, level, texts, tables, figures))
    return html_page('History of calibrations', count(total, 'calibration'), parts, 'the SQLite file')


_CAPTION = (
    'Value less that of the first calibration; bars: two total standard uncertainties, thick: by noise. '
    'Errors of the cell that all share move all points alike. Red: changed since the one before (p < 0.01).'
)


_IN_TURN = 'calibrations in turn'


def _trend_figure(trend: Trend, name: str) -> Markup:
    figure, panels = new_figure(760, 760, 4, 3, sharex=True)
    days, label = _axis([entry.measured for entry in trend.entries])
    for axes, parameter in zip(panels, NAMES, strict=True):
        rows = [entry.record.document['parameters'][parameter] for entry in trend.entries]
        changed = np.array([_has_changed(parameter, change) for change in trend.changes])
        unit = UNITS[parameter]
        values = MICRO * np.array([row['value'] - rows[0]['value'] for row in rows])
        for key, width, colour in (('std', 0.8, FAINT), ('std_noise', 2.4, INK)):
            stds = _SIGMAS * MICRO * np.array([np.nan if row[key] is None else row[key] for row in rows])
            axes.errorbar(days, values, stds, fmt='none', ecolor=colour, elinewidth=width)
        axes.plot(days, values, 'o', color=INK, markersize=3)
        axes.plot(days[changed], values[changed], 'o', color=WARN, markersize=4)
        axes.set_title(f'{parameter} [µ{unit}]')
    for axes in panels[-3:]:
        axes.set_xlabel(label)
        if label == _IN_TURN:
            axes.set_xticks(days[:: -(-len(days) // 6)])
    return as_svg(figure, name, 'every parameter over time')


def _axis(dates: Sequence[str]) -> tuple[Floats, str]:
    """Days since the first date, (n,), with their label; numbers in turn where dates are missing or all the same."""
    try:
        times = [datetime.strptime(date, '%Y-%m-%dT%H:%M:%SZ') for date in dates]
    except ValueError:
        times = []
    if len(set(times)) < 2:
        return np.arange(1.0, len(dates) + 1), _IN_TURN
    return np.array([(time - times[0]).total_seconds() / 86400 for time in times]), 'days since the first'


def _has_changed(parameter: str, change: Change | None) -> bool:
    """Whether the calibrations differ, and this value does."""
    if change is None or not change.has_changed:
        return False
    return any(item.name == parameter and item.p_value < LEVEL for item in change.parameters)
