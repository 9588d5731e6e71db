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
from scara_kinetostatic.monitoring.history import Entry
from scara_kinetostatic.monitoring.page import Part, html_page
from scara_kinetostatic.render.figure import FAINT, INK, MICRO, WARN, as_svg, new_figure, style
from scara_kinetostatic.render.quantities import count
from scara_kinetostatic.render.table import NOT_DETERMINED, Table

PAGE_NAME = 'history.html'
_SIGMAS = 2.0
"""Length of an error bar, standard uncertainties."""


def history_table(entries: Sequence[Entry], changes: Sequence[Change | None]) -> Table:
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
        for entry, change in zip(entries, changes, strict=True)
    ]
    return Table(('', 'robot', 'measured', 'grade', 'tip, k = 2', 'since the one before'), ('',) * 6, tuple(rows))


def history_page(entries: Sequence[Entry], changes: Sequence[Change | None]) -> str:
    """The page: of each robot the calibrations and the trend of every parameter."""
    parts = []
    with style():
        for number, robot in enumerate(dict.fromkeys(entry.robot for entry in entries)):
            own = [k for k, entry in enumerate(entries) if entry.robot == robot]
            its, theirs = [entries[k] for k in own], [changes[k] for k in own]
            changed = [change for change in theirs if change is not None and change.has_changed]
            text = f'{count(len(its), "calibration")}, {count(len(changed), "change")} beyond the uncertainty.'
            tables = (('Calibrations', history_table(its, theirs), ''),)
            caption = (
                'Value less that of the first calibration; bars: two total standard uncertainties, thick: by noise. '
                'Errors of the cell that all share move all points alike. Red: changed since the one before (p < 0.01).'
            )
            figures = ((_trends(its, theirs, f'trend{number}'), caption),)
            parts.append(Part(robot, text, 'caution' if changed else 'good', (), tables, figures))
    return html_page('History of calibrations', f'{len(entries)} calibrations', parts, 'the SQLite file')


def _trends(entries: Sequence[Entry], changes: Sequence[Change | None], name: str) -> Markup:
    figure, panels = new_figure(760, 760, 4, 3, sharex=True)
    days = _days([entry.measured for entry in entries])
    for axes, parameter in zip(panels, NAMES, strict=True):
        rows = [entry.record.document['parameters'][parameter] for entry in entries]
        changed = np.array([_has_changed(parameter, change) for change in changes])
        unit = UNITS[parameter]
        values = MICRO * np.array([row['value'] - rows[0]['value'] for row in rows])
        for key, width, colour in (('std', 0.8, FAINT), ('std_noise', 2.4, INK)):
            stds = _SIGMAS * MICRO * np.array([np.nan if row[key] is None else row[key] for row in rows])
            axes.errorbar(days, values, stds, fmt='none', ecolor=colour, elinewidth=width)
        axes.plot(days, values, 'o', color=INK, markersize=3)
        axes.plot(days[changed], values[changed], 'o', color=WARN, markersize=4)
        axes.set_title(f'{parameter} [µ{unit}]')
    for axes in panels[-3:]:
        axes.set_xlabel('days since the first')
    return as_svg(figure, name, 'every parameter over time')


def _days(dates: Sequence[str]) -> Floats:
    """Days since the first date, (n,); numbers in turn where a date is not one."""
    try:
        times = [datetime.strptime(date, '%Y-%m-%dT%H:%M:%SZ') for date in dates]
    except ValueError:
        return np.arange(float(len(dates)))
    return np.array([(time - times[0]).total_seconds() / 86400 for time in times])


def _has_changed(parameter: str, change: Change | None) -> bool:
    """Whether the calibrations differ, and this value does."""
    if change is None or not change.has_changed:
        return False
    return any(item.name == parameter and item.p_value < LEVEL for item in change.parameters)
