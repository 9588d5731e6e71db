"""Comparison, verification and history of calibrations: as JSON, for the terminal and as a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime, timedelta
from functools import partial

import numpy as np
from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.quantities import SCALES, Shown, chance, count, micrometres, p_equals, scale_of, shown
from scara_kinetostatic.monitoring.change import Causes, change_title
from scara_kinetostatic.monitoring.comparison import LEVEL, Change, ParameterChange
from scara_kinetostatic.monitoring.history import Trend
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.verification import Verification
from scara_kinetostatic.report.figure import FAINT, IN_MICRO, INK, PAPER, WARN, as_svg, new_figure
from scara_kinetostatic.report.page import (
    NOT_DETERMINED,
    Block,
    Document,
    Figure,
    Note,
    Report,
    Section,
    Table,
    Verdict,
    sentence,
)
from scara_kinetostatic.results.report import answer

_SIDE = 760
"""Of the picture of a trend, pixels."""


def causes_document(causes: Causes) -> Document:
    """What may have changed, with its evidence; nulls where nothing has."""
    candidates = []
    for item in causes.ranking:
        rows = zip(item.values, item.change, item.std, item.units, strict=True)
        changes = [dict(zip(('name', 'value', 'std', 'unit'), row, strict=True)) for row in rows]
        known = {key: getattr(item, key) for key in ('name', 'title', 'statistic', 'score')}
        distance = dict(zip(('value', 'std', 'unit'), (*item.distance, 'm'), strict=True)) if item.distance else None
        candidates.append({**known, 'change': changes, 'distance': distance})
    best, remaining = (candidates[0], causes.remaining_p_value) if candidates else (None, None)
    return {'part': best, 'rivals': causes.rivals, 'remaining_p_value': remaining, 'candidates': candidates}


def _causes(causes: Causes) -> list[Block]:
    """The rivals of the likeliest change, and on the page the eight likeliest."""
    if not causes.ranking:
        return []
    rows = []
    for number, item in enumerate(causes.ranking[:8]):
        remark = 'best' if number == 0 else 'about as likely' if item.name in causes.rivals else ''
        rows.append((item.title, f'{item.statistic:.4g}', str(len(item.change)), item.text, remark))
    table = Table(('what changed', 'explains', 'values', 'by', ''), ('', 'chi-square', '', '', ''), tuple(rows))
    rivals = [f'About as likely: {"; ".join(map(change_title, causes.rivals))}.'] if causes.rivals else []
    return [*rivals, Section('What may have changed', (table,), shown='page')]


def comparison_document(changes: Sequence[Change]) -> Document:
    """All numbers; SI units."""
    return {'schema': 'scara_kinetostatic/comparison/1', 'version': __version__, 'changes': [*map(_change, changes)]}


def _change(c: Change) -> Document:
    parameters = {}
    for p in c.parameters:
        stated = {'from': _stated(c.before, p.name), 'to': _stated(c.after, p.name)}
        change = {key: getattr(p, key) for key in ('change', 'std', 'z', 'p_value', 'unit')}
        parameters[p.name] = {**stated, 'joint_fit': {'from': p.before, 'to': p.after}, **change}
    return {
        'from': {'path': c.before.source, 'created': c.before.created},
        'to': {'path': c.after.source, 'created': c.after.created},
        'changed': c.has_changed,
        **{key: getattr(c, key) for key in ('p_value', 'chi_square', 'degrees_of_freedom', 'notes')},
        'parameters': parameters,
        'tip_change': {'rms': c.tip, 'largest': c.largest_tip},
        **causes_document(c.causes),
        'effects': {'only_from': c.only_before, 'only_to': c.only_after, 'not_compared': c.not_compared},
    }


def comparison_report(changes: Sequence[Change]) -> Report:
    """The changes between calibrations for the terminal and for `comparison.html`."""
    common = 'Change: fitted with the touches of both, the errors that they share, such as those of the discs’ places, '
    common += 'and the effects of the one that has more; so it is not just the difference of the values. '
    common += 'z: change in σ; p: of one value alone, two-sided.'
    sections = []
    for change in changes:
        blocks: tuple[Block, ...] = (_answer(change), parameter_table(change), *_causes(change.causes), Note(common))
        sections.append(Section(f'{change.before.source} → {change.after.source}', blocks))
    changed = f'{sum(change.has_changed for change in changes)} of {count(len(changes), "comparison")}'
    is_doubtful = any(_answer(change).level == 'caution' for change in changes)
    answer = Verdict(f'{changed} beyond the uncertainty', 'caution' if is_doubtful else 'good')
    if len(changes) == 1:
        answer, sections = _answer(changes[0]), [Section('', sections[0].blocks[1:])]
    source = ', '.join([changes[0].before.source, *(change.after.source for change in changes)])
    footer = 'all numbers in full in comparison.json'
    return Report('What changed between calibrations', answer, tuple(sections), source, footer=footer)


def verdict(change: Change) -> str:
    """One line: whether anything changed, and what most likely."""
    if not change.has_changed:
        except_for = f', but {", ".join(change.not_compared)} cannot be compared' if change.not_compared else ''
        return f'No change beyond the uncertainty ({p_equals(change.p_value)}){except_for}'
    return f'Changed ({p_equals(change.p_value)}): {change.causes.title(LEVEL)}'


def _answer(change: Change) -> Verdict:
    tip = f'The predicted tip moved by {micrometres(change.tip)} µm (rms), {micrometres(change.largest_tip)} µm at most'
    found = [f'{tip}, at the touches of the second calibration.']
    for effects, which in ((change.only_before, 'first'), (change.only_after, 'second')):
        found += [f'Only the {which} calibration has {", ".join(effects)}.'] if effects else []
    is_doubtful = change.has_changed or change.not_compared
    return Verdict(f'{verdict(change)}.', 'caution' if is_doubtful else 'good', (*found, *map(sentence, change.notes)))


def _stated(record: CalibrationRecord, name: str) -> float | None:
    """The value in the file of a calibration; None of an effect that it has not."""
    return float(record.values[record.place(name)]) if name in record.arm.model.names else None


def _shown(value: float | None, p: ParameterChange) -> Shown:
    """A value with the digits of its change, in the unit of its parameter; empty for None."""
    scale = SCALES.get(p.name) or scale_of(max(abs(p.before), abs(p.after)), p.unit)
    return Shown('', '', '') if value is None else shown(value, p.std, p.unit, {p.unit: scale})


def parameter_table(change: Change) -> Table:
    """One row per value: as the files have it, and its change."""
    rows = []
    for p in change.parameters:
        stated = _stated(change.before, p.name), _stated(change.after, p.name)
        before, after, moved = (_shown(value, p) for value in (*stated, p.change))
        z, p_value = (f'{p.z:+.1f}', chance(p.p_value)) if np.isfinite(p.z) else (NOT_DETERMINED,) * 2
        rows.append((p.name, before.value, after.value, moved._replace(unit='').text, moved.unit, z, p_value))
    heading = '', 'from', 'to', 'change ± 1 σ', '', 'z', 'p'
    return Table(heading, ('',) * len(heading), tuple(rows))


def verification_document(v: Verification) -> Document:
    """All numbers; SI units."""
    return {
        'schema': 'scara_kinetostatic/verification/1',
        'version': __version__,
        'calibration': {'path': v.record.source, 'created': v.record.created, 'grade': v.record.arm.grade},
        'recordings': [{**item._asdict(), 'part_of_calibration': item.path in v.seen} for item in v.recordings],
        **asdict(v.assessment),
        **{key: getattr(v, key) for key in ('tip_error', 'expected', 'p_value', 'warnings')},
        'without_outlying': {'p_value': v.others.p_value, 'tip_error': v.others_tip_error} if v.few_outlie else None,
        'chi_square': {'value': v.test.chi_square, 'degrees_of_freedom': v.test.freedoms},
        'touches': {
            'used': v.touches,
            'of_the_calibration': v.repeated,
            'rejected': v.rejected,
            'outlying': v.outlying,
            'index': v.numbers,
            'tip_error': v.tip_errors,
            'expected': v.test.expected,
        },
        'independent': not v.seen and not v.repeated,
        **causes_document(v.causes),
    }


def verification_report(v: Verification) -> Report:
    """A verification for the terminal and for `verification.html`."""
    rows = {
        'touches': str(v.touches),
        'tip error, rms': f'{micrometres(v.tip_error)} µm',
        'expected from noise and uncertainty': f'{micrometres(v.expected)} µm',
        'chi-square': f'{v.test.chi_square:.4g}, {v.test.freedoms} degrees of freedom',
        'p-value': chance(v.p_value),
    } | ({'p-value without the outliers': chance(v.others.p_value)} if v.few_outlie else {})
    heading = 'error of the tip: distance of the predicted tip from the surface', ''
    summary = Table(heading, ('', ''), tuple(rows.items()))
    caption = 'Error of the predicted tip along the contact normal; grey: two standard deviations expected. '
    caption += 'Red: outliers; a touch can be one by the direction of its force alone.'
    return Report(
        'Verification of a calibration',
        answer(v.assessment, v.tolerance, 'Confirmed'),
        (summary, *_causes(v.causes), Figure(partial(_touch_picture, v), caption)),
        source=f'{v.record.source}, verified with {", ".join(item.path for item in v.recordings)}',
        remarks=v.warnings,
        footer='all numbers in full in verification.json',
    )


def _touch_picture(v: Verification) -> Markup:
    """Error of the predicted tip, touch by touch, by their numbers in the recordings."""
    order = np.argsort(v.numbers, kind='stable')
    touches, errors, expected = v.numbers[order], IN_MICRO * v.tip_errors[order], IN_MICRO * v.test.expected[order]
    outlies = np.isin(touches, [item.index for item in v.outlying])
    figure, (axes,) = new_figure(640, 260)
    axes.fill_between(touches, -2 * expected, 2 * expected, color=FAINT, alpha=0.2, linewidth=0, step='mid')
    axes.plot(touches[~outlies], errors[~outlies], 'o', color=INK, markersize=3)
    axes.plot(touches[outlies], errors[outlies], 'o', color=WARN, markersize=4)
    axes.set(xlabel='touch', ylabel='error of the tip [µm]')
    return as_svg(figure, 'tip_error', 'error of the predicted tip, touch by touch')


def history_report(trends: Sequence[Trend], picture: str = 'trend') -> Report:
    """A history for the terminal and for `history.html`: of each robot the calibrations, and the trend."""
    caption = 'Value less that of the first calibration; bars: two total standard uncertainties, thick: by noise. '
    caption += 'Errors of the cell that all share move all points alike. Red: changed since the one before (p < 0.01).'
    heading = '', 'measured', 'grade', 'tip, 95 %', 'since the one before'
    sections, doubtful = [], []
    for number, trend in enumerate(trends):
        changed = f'{count(len(trend.changed), "change")} beyond the uncertainty'
        lines = [f'{count(len(trend.entries), "calibration")}, {changed}.']
        if trend.slow is not None:
            lines.append(f'From number {trend.since} to number {trend.entries[-1].number}: {verdict(trend.slow)}.')
        rows = []
        for entry, change in zip(trend.entries, trend.changes, strict=True):
            measured = entry.record.measured.replace('T', ' ').replace('Z', ' UTC')
            worst = (entry.record.document.get('tip_uncertainty') or {}).get('worst')
            tip = NOT_DETERMINED if worst is None else f'{micrometres(worst)} µm'
            since = 'first' if change is None else verdict(change)
            rows.append((str(entry.number), measured, entry.record.arm.grade, tip, since))
        table = Table(heading, ('',) * len(heading), tuple(rows))
        figure = Figure(partial(_trend_picture, trend, f'{picture}{number}'), caption)
        sections.append(Section(trend.robot, (*lines, table, figure)))
        doubtful += [trend.robot] if trend.changed or trend.has_crept else []
    total = count(sum(len(trend.entries) for trend in trends), 'calibration')
    answer = f'{total}; changed: {", ".join(doubtful)}' if doubtful else f'{total}; none has changed'
    return Report('History of calibrations', Verdict(answer, 'caution' if doubtful else 'good'), tuple(sections))


def _trend_picture(trend: Trend, name: str) -> Markup:
    figure, panels = new_figure(_SIDE, _SIDE, 4, 3, sharex=True)
    times = [datetime.strptime(entry.record.measured, '%Y-%m-%dT%H:%M:%SZ') for entry in trend.entries]
    days = np.array([(time - times[0]) / timedelta(days=1) for time in times])
    for place, (axes, parameter) in enumerate(zip(panels, NAMES, strict=True)):
        rows = [entry.record.document['parameters'][parameter] for entry in trend.entries]
        moved = [c is not None and c.has_changed and c.parameters[place].p_value < LEVEL for c in trend.changes]
        unit, per_si = SCALES[parameter]
        values = per_si * np.array([row['value'] - rows[0]['value'] for row in rows])
        for key, width, colour in (('std', 0.8, FAINT), ('std_noise', 2.4, INK)):
            stds = 2 * per_si * np.array([np.nan if row[key] is None else row[key] for row in rows])
            axes.errorbar(days, values, stds, fmt='none', ecolor=colour, elinewidth=width)
        axes.plot(days, values, 'o', color=INK, markerfacecolor=PAPER, zorder=3)
        axes.plot(days[moved], values[moved], 'o', color=WARN, zorder=3)
        axes.set_title(f'{parameter}  [{unit}]')
    for axes in panels[-3:]:
        axes.set_xlabel('days since the first')
    return as_svg(figure, name, 'every parameter over time')
