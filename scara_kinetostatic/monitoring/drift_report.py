"""The state of the drift monitor as one line and as plain JSON values."""

from __future__ import annotations

from pathlib import PurePath
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.monitoring.drift import Alarm, DriftMonitor
from scara_kinetostatic.monitoring.hypotheses import change_title
from scara_kinetostatic.render.json_file import Document

SCHEMA = 'scara_kinetostatic/drift/1'


class SinceTouch(NamedTuple):
    """The first touch after a change, as estimated.

    Attributes:
        recording: in which it is.
        number: in the recording.
    """

    recording: str
    number: str


def alarm_line(alarm: Alarm, since: SinceTouch | None) -> str:
    """An alarm in one line.

    Args:
        alarm: the alarm.
        since: its first touch, where it is known.
    """
    best = alarm.best
    others = f'; or {"; ".join(change_title(name) for name in alarm.rivals[:3])}' if alarm.rivals else ''
    when = 'from the first touch on'
    if since is not None and alarm.since:
        when = f'since touch {since.number} of {PurePath(since.recording).name}'
    elif alarm.since:
        when = f'after {alarm.since} touches'
    what = f'{best.hypothesis.title} ({best.text})'
    if not alarm.is_explained:
        return f'the calibration no longer holds, {when}: no single part explains it, the largest is: {what}'
    return f'the calibration no longer holds, {when}: {what}{others}'


def drift_document(monitor: DriftMonitor, assumptions: str, alarm: Alarm | None, since: SinceTouch | None) -> Document:
    """The state of a monitor; `alarm` is the one that stands, `since` its first touch."""
    return {
        'schema': SCHEMA,
        'calibration': monitor.record.source,
        'created': monitor.record.created,
        'touches': monitor.count,
        'statistic': monitor.statistic,
        'threshold': monitor.threshold,
        'assumptions': assumptions,
        'alarm': None if alarm is None else _alarm(alarm, since),
    }


def _alarm(alarm: Alarm, since: SinceTouch | None) -> Document:
    """SI units; None for what is not determined."""
    best = alarm.best
    return {
        'touch': alarm.touch,
        'since': alarm.since,
        'since_touch': None if since is None else since._asdict(),
        'statistic': alarm.statistic,
        'changed': best.name,
        'change': list(best.change),
        'std': [std if np.isfinite(std) else None for std in best.std],
        'values': list(best.hypothesis.values),
        'units': list(best.hypothesis.units),
        'rivals': list(alarm.rivals),
        'explained': alarm.is_explained,
        'message': alarm_line(alarm, since),
    }
