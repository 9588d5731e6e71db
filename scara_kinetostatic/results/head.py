"""The head of the page: what was calibrated, by whom, when, from which recordings; and the three numbers."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.conformity import Decision, conformity
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.assessment.tolerance import NOT_STATED
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.report.quantities import count

_NOT_STATED = 'not stated'
_ALWAYS = ('robot', 'cell', 'sensor', 'operator')
"""Shown in every head, stated or not."""
_PARTS = {'robot': 'serial_number', 'sensor': 'sensor_serial_number'}
"""A thing and its serial number share a line."""
_TITLES = {'laboratory': 'Laboratory', 'location': 'Place', 'certificate': 'Certificate No.', 'sensor': 'Force sensor'}
_DECISIONS = {
    Decision.CONFORMS: 'shown',
    Decision.UNDECIDED: 'neither shown nor excluded',
    Decision.DOES_NOT_CONFORM: 'excluded',
}
"""What is decided about the tolerance (ISO 14253-1), in words."""
_YEAR_OF_CLOCKS = 2001
"""A recording that starts before has stamps of a simulated clock."""


class Entry(NamedTuple):
    """One line of the head; `is_stated` is False where the cell description does not say."""

    title: str
    text: str
    is_stated: bool = True


class Source(NamedTuple):
    """One recording, ready to print."""

    path: str
    start: str
    sha256: str
    turned: str = ''


class Number(NamedTuple):
    """One of the three numbers: what it is, the number with its unit, and a remark."""

    title: str
    value: str
    unit: str
    remark: str


def entries(outcome: Outcome) -> list[Entry]:
    """What the cell description says of robot, cell, sensor and people, and the date."""
    given = outcome.final.cell.identification.given()
    found = [Entry('Date', date_text(outcome.created))]
    for name in (*_ALWAYS, *(name for name in given if name not in _ALWAYS and name not in _PARTS.values())):
        serial = given.get(_PARTS.get(name, ''), '')
        parts = [given.get(name, ''), f'serial No. {serial}' if serial else '']
        text = ', '.join(filter(None, parts))
        found.append(Entry(_TITLES.get(name, name.capitalize()), text or _NOT_STATED, bool(text)))
    return found


def recordings(outcome: Outcome) -> list[Source]:
    """The recordings with their checksums; paths alone where these are unknown."""
    known = [Source(item.path, _start(item.start), item.sha256, item.turned) for item in outcome.recordings]
    return known or [Source(path, '', '') for path in outcome.sources]


def _start(start: datetime | None) -> str:
    if start is None:
        return ''
    return date_text(start) if start.year >= _YEAR_OF_CLOCKS else 'simulated clock'


def date_text(time: datetime) -> str:
    """Date and time of the day: ``2026-11-21 14:03 UTC``."""
    return time.astimezone(timezone.utc).strftime('%Y-%m-%d %H:%M UTC')


def numbers(outcome: Outcome) -> list[Number]:
    """Error of the tip before and after; its uncertainty against the tolerance; force error on held-out touches."""
    compared = outcome.comparison
    final, folds = compared.extended, outcome.extended_held_out.folds
    tip = Number(
        'Tip error, before → after',
        f'{_mm(compared.nominal_tip)} → {_mm(final.tip.held_out)}',
        'mm',
        'rms distance from the touched circles: nominal → calibrated, each touch by a fit without it; '
        f'{_mm(final.tip.fitted)} mm in the fit, {_mm(final.tip.noise)} mm is expected from noise',
    )
    held_out = Number(
        'Force error on held-out touches',
        f'{final.held_out:.3g}',
        'N',
        f'touches not used in the fit, {count(folds, "fold")}; {final.force_error:.3g} N in the fit, '
        f'{compared.nominal:.3g} N with nominal parameters',
    )
    return [tip, _uncertainty(outcome), held_out]


def _uncertainty(outcome: Outcome) -> Number:
    """The largest expanded uncertainty of the tip against the tolerance, and whether it conforms."""
    c, tip = outcome.final, outcome.tip_uncertainty
    found, tolerance = conformity(c, tip), c.cell.tolerance
    title = 'Tip uncertainty' if tolerance is None else 'Tip uncertainty against tolerance'
    allowed = 'no tolerance is stated' if tolerance is None else f'tolerance {_mm(tolerance)} mm'
    if not np.isfinite(tip.worst):
        return Number(title, 'not determined', '', f'by these touches; {allowed}')
    parts = [f'largest expanded uncertainty (k = {COVERAGE_FACTOR:g}) in the workspace']
    if np.isfinite(tip.worst_touched):
        parts[0] += f', {_mm(tip.worst_touched)} mm between the touches'
    if tip.undetermined > 0:
        parts.append(f'not determined in {100 * tip.undetermined:.0f} % of it')
    value = _mm(tip.worst)
    if found is None:
        parts.append(allowed)
    else:
        value = f'{value} of {_mm(found.tolerance)}'
        parts.append(f'conformity {_decision(outcome, found.decision)}')
    return Number(title, value, 'mm', '; '.join(parts))


def _decision(outcome: Outcome, decision: Decision) -> str:
    """What is said of conformity: as much as the uncertainties contain."""
    if decision is Decision.CONFORMS and outcome.diagnosis.verdict == 'unexplained':
        return NOT_STATED
    if decision is Decision.CONFORMS and DeclaredErrors.of(outcome.final.cell) is None:
        return 'shown as far as noise goes: no uncertainties of discs and sensor are declared'
    return _DECISIONS[decision]


def _mm(metres: float) -> str:
    return f'{1e3 * metres:.3g}'
