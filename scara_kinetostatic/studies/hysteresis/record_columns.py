"""Columns of a record: the response, the load and the time among any others, chosen by name or by their units.

A heading ends in its unit, `q2_rad` or `torque [Nm]`. A displacement goes with a force, an angle with a torque. A
number after letters, the first of a heading, is that of a joint: the columns of two joints do not go together.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from scara_kinetostatic.errors import ParameterError, RecordingError
from scara_kinetostatic.studies.dial_gauge.table_columns import QUANTITIES, split_heading

RESPONSE, LOAD, TIME = 'response', 'load', 'time'
_DEGREE = math.pi / 180
_UNITS = {
    'm': QUANTITIES['displacement'].units,
    'rad': {'rad': 1.0, 'mrad': 1e-3, 'urad': 1e-6, 'µrad': 1e-6, 'μrad': 1e-6, **dict.fromkeys(('deg', '°'), _DEGREE)},
    'N': QUANTITIES['force'].units,
    'Nm': {'Nm': 1.0, 'kNm': 1e3, 'mNm': 1e-3},
    's': QUANTITIES['time'].units,
}
"""Factor to SI by unit, by SI unit."""
LARGEST = {'rad': 100.0, 'Nm': 1e6} | {
    unit: QUANTITIES[name].largest for unit, name in (('m', 'displacement'), ('N', 'force'), ('s', 'time'))
}
"""Largest plausible magnitude by SI unit."""
_KINDS = {RESPONSE: ('m', 'rad'), LOAD: ('N', 'Nm'), TIME: ('s',)}
_LOAD_OF = {'m': 'N', 'rad': 'Nm'}
_QUANTITY = {'m': 'a displacement', 'rad': 'an angle', 'N': 'a force', 'Nm': 'a torque', 's': 'a time'}
_GAUGE_DISPLACEMENT = frozenset(QUANTITIES['displacement'].names)
_GAUGE_FORCE = frozenset(QUANTITIES['force'].names)
_WORDS = {
    RESPONSE: _GAUGE_DISPLACEMENT | {'angle', 'rotation', 'response'},
    LOAD: _GAUGE_FORCE | {'torque', 'moment'},
    TIME: frozenset(QUANTITIES['time'].names),
}
"""Names that say what a column is; they are preferred to others of the same unit."""
_EXAMPLE = {RESPONSE: 'displacement_m or angle_rad', LOAD: 'force_N or torque_Nm', TIME: 'time_s'}
_JOINT = re.compile(r'(?<![^\W_])(?P<letters>[^\W\d_]+)[\s_]?(?P<number>\d+)')
_CHANNELS = ('ch', 'channel', 'ai', 'sensor')
"""Letters whose number is that of a channel, not of a joint."""
_SHOWN = 6
"""So many headings are listed."""


class RecordColumn(NamedTuple):
    """One column.

    Attributes:
        heading: as in the file.
        place: number of the column, from 0.
        unit: SI, '' where the heading has none that is known.
        factor: to SI.
    """

    heading: str
    place: int
    unit: str = ''
    factor: float = 1.0

    @property
    def word(self) -> str:
        """The heading without its unit, in lower case."""
        return split_heading(self.heading)[0].strip().lower()

    @property
    def joint(self) -> int | None:
        """Number of the joint in the heading, if it has one."""
        match = _JOINT.search(self.word)
        return int(match['number']) if match and match['letters'] not in _CHANNELS else None


class RecordColumns(NamedTuple):
    """The columns of a record; `time` is None where the table has none."""

    response: RecordColumn
    load: RecordColumn
    time: RecordColumn | None


def choose_columns(
    cells: Sequence[str], where: str, response: str | None = None, load: str | None = None
) -> RecordColumns:
    """The columns of a record.

    Args:
        cells: of the heading.
        where: the file, for messages.
        response: heading of the response; None for the only one, or the one with a name such as `angle_rad`.
        load: heading of the load, likewise; its quantity must go with that of the response.

    Raises:
        ParameterError: a column asked for does not exist, or its unit is not one of a response or a load.
        RecordingError: a column is not given and cannot be told, or the two do not go together.
    """
    columns = [_column(cell.strip(), place) for place, cell in enumerate(cells) if cell.strip()]
    named = {
        kind: None if heading is None else _named(columns, kind, heading, where)
        for kind, heading in ((RESPONSE, response), (LOAD, load))
    }
    for kind, other in ((RESPONSE, LOAD), (LOAD, RESPONSE)):
        if named[kind] is None:
            named[kind] = _only(columns, kind, named[other], where)
    found = RecordColumns(_known(named[RESPONSE]), _known(named[LOAD]), _time(columns, where))
    _check_units(found, where)
    _check_joints(found, columns, where)
    return found


def is_gauge_heading(cells: Sequence[str]) -> bool:
    """Whether the table names a force and a displacement as a table of dial gauge readings does."""
    columns = [_column(cell.strip(), place) for place, cell in enumerate(cells) if cell.strip() != 'gauge_at']
    words = {column.word for column in columns if column.unit not in ('rad', 'Nm')}
    return bool(words & _GAUGE_FORCE) and bool(words & _GAUGE_DISPLACEMENT)


def _column(heading: str, place: int) -> RecordColumn:
    text = re.sub(r'[\s·*]', '', split_heading(heading)[1])
    for unit, factors in _UNITS.items():
        if text in factors:
            return RecordColumn(heading, place, unit, factors[text])
    return RecordColumn(heading, place)


def _named(columns: Sequence[RecordColumn], kind: str, heading: str, where: str) -> RecordColumn:
    option = f'--{kind} {heading}'
    found = [column for column in columns if column.heading == heading.strip()]
    if not found:
        raise ParameterError(option, f'{where} has no such column', _likely(columns, kind, heading))
    if len(found) > 1:
        raise ParameterError(option, f'{where} has {len(found)} columns of this name', 'rename all but one')
    if found[0].unit not in _KINDS[kind]:
        unit = found[0].unit
        got = f'the column is {_QUANTITY[unit]} ({unit})' if unit else 'the column has no known unit'
        swapped = unit and unit not in _KINDS[TIME]
        remedy = 'exchange --response and --load' if swapped else f'choose or rename a column: {_endings(kind)}'
        raise ParameterError(option, f'{where}: {got}; expected {_expected(kind)}', remedy)
    return found[0]


def _likely(columns: Sequence[RecordColumn], kind: str, heading: str) -> str:
    """The columns of that kind which resemble the heading, or else all of them, as a remedy."""
    headings = [column.heading for column in columns if column.unit in _KINDS[kind]]
    lower = {each.lower(): each for each in headings}
    close = [lower[each] for each in difflib.get_close_matches(heading.lower(), lower, 3, 0.5)]
    if close:
        return f'did you mean {" or ".join(close)}?'
    return f'its columns of this kind are {_listed(headings)}' if headings else f'add one, {_endings(kind)}'


def _only(columns: Sequence[RecordColumn], kind: str, other: RecordColumn | None, where: str) -> RecordColumn:
    """The only column of a kind, or the one whose name says so."""
    units = _KINDS[kind]
    if other is not None:
        units = (_LOAD_OF[other.unit],) if kind == LOAD else tuple(u for u in units if _LOAD_OF[u] == other.unit)
    found = [column for column in columns if column.unit in units]
    chosen = found if len(found) == 1 else [column for column in found if column.word in _WORDS[kind]]
    if len(chosen) == 1:
        return chosen[0]
    if found:
        problem = f'{len(found)} columns may be the {kind}: {_listed([column.heading for column in found])}'
        raise RecordingError(where, problem, f'choose one by --{kind}')
    wrong = [column for column in columns if column.unit in _KINDS[kind]]
    if other is not None and wrong:
        raise _units_error(other, wrong[0], where)
    got = _listed([column.heading for column in columns]) or 'nothing'
    goes_with = '' if other is None else f' that goes with {other.heading}'
    raise RecordingError(
        where, f'there is no column of the {kind}{goes_with}, got {got}', f'name one with its unit, {_endings(kind)}'
    )


def _time(columns: Sequence[RecordColumn], where: str) -> RecordColumn | None:
    found = [column for column in columns if column.unit == 's']
    chosen = [column for column in found if column.word in _WORDS[TIME]] or found
    if len(chosen) > 1:
        raise RecordingError(
            where, f'two columns of time, {chosen[0].heading} and {chosen[1].heading}', 'leave one out'
        )
    return chosen[0] if chosen else None


def _known(column: RecordColumn | None) -> RecordColumn:
    assert column is not None
    return column


def _check_units(found: RecordColumns, where: str) -> None:
    response, load = found.response, found.load
    if _LOAD_OF[response.unit] != load.unit:
        raise _units_error(response, load, where)


def _units_error(one: RecordColumn, other: RecordColumn, where: str) -> RecordingError:
    pair = f'{one.heading} is {_QUANTITY[one.unit]} and {other.heading} {_QUANTITY[other.unit]}'
    remedy = 'give an angle with a torque (rad, Nm), or a displacement with a force (m, N)'
    return RecordingError(where, f'these units do not go together: {pair}', remedy)


def _check_joints(found: RecordColumns, columns: Sequence[RecordColumn], where: str) -> None:
    response, load = found.response, found.load
    if response.joint is None or load.joint is None or response.joint == load.joint:
        return
    own = re.sub(r'\d+', str(response.joint), load.heading, count=1)
    choose = f'choose --load {own}' if any(each.heading == own for each in columns) else 'choose those of one joint'
    problem = f'{response.heading} and {load.heading} are columns of two joints, {response.joint} and {load.joint}'
    raise RecordingError(where, problem, f'{choose}, or rename one if they do belong together')


def _expected(kind: str) -> str:
    return ', '.join(unit for si in _KINDS[kind] for unit in _UNITS[si] if unit.isascii())


def _endings(kind: str) -> str:
    return f'such as {_EXAMPLE[kind]}'


def _listed(headings: Sequence[str]) -> str:
    more = len(headings) - _SHOWN
    return ', '.join(headings[:_SHOWN]) + (f' and {more} more' if more > 0 else '')
