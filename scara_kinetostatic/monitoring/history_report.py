"""A history of calibrations as text and as a page with the trend of every parameter."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
from markupsafe import Markup

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.monitoring.comparison import LEVEL, Change
from scara_kinetostatic.monitoring.comparison_report import verdict
from scara_kinetostatic.monitoring.page import Part, html_page
from scara_kinetostatic.monitoring.trend import Trend
from scara_kinetostatic.render.figure import FAINT, INK, MICRO, WARN, as_svg, new_figure, style
from scara_kinetostatic.render.quantities import count
from scara_kinetostatic.render.table import NOT_DETERMINED, Table

PAGE_NAME = 'history.html'
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
            figures = ((_figure(trend, f'trend{number}'), _CAPTION),)
            level = 'caution' if changed or trend.has_crept else 'good'
            parts.append(Part(trend.robot, text, level, texts, tables, figures))
    return html_page('History of calibrations', count(total, 'calibration'), parts, 'the SQLite file')


_CAPTION = (
    'Value less that of the first calibration; bars: two total standard uncertainties, thick: by noise. '
    'Errors of the cell that all share move all points alike. Red: changed since the one before (p < 0.01).'
)


_IN_TURN = 'calibrations in turn'


def _figure(trend: Trend, name: str) -> Markup:
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
