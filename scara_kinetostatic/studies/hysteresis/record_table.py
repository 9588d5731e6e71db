"""A record of a load and a response from a CSV file, checked row by row; see `files.columns` for what is read.

Columns of a record: the response, the load and the time among any others, chosen by name or by their units.

A heading ends in its unit, `q2_rad` or `torque [Nm]`. A displacement goes with a force, an angle with a torque. A
number after letters, the first of a heading, is that of a joint: the columns of two joints do not go together.

What drives a record: its motion, and the force is predicted, or its load, and the response is predicted.

Driven by its motion is a record of full loops: six sweeps or more between the reversals of the response, of comparable
extent. Driven by its load is one whose load is at rest at first, comes on and goes off again, once or a few times. Full
loops after a rest are those of a load put on again and again where the load keeps to one side of its rest; a motion
back and forth meets it on both.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError, RecordingError, UnsupportedDataError
from scara_kinetostatic.files import columns as units
from scara_kinetostatic.files.columns import Column, Place, Table, load_table, split_heading
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.readings import COLUMNS, DialGaugeReadings, table_readings
from scara_kinetostatic.studies.hysteresis.load_driven.record import (
    CHECK_LOAD,
    CONSTANT_LOAD,
    FEWEST_SAMPLES,
    LoadRecord,
    is_at_rest_first,
    is_constant,
)
from scara_kinetostatic.studies.hysteresis.motion import FEWEST_ROWS, FEWEST_SWEEPS, reversals

RESPONSE, LOAD, TIME = 'response', 'load', 'time'


class Quantity(NamedTuple):
    """A quantity in words, factor to SI by unit, largest plausible size, SI."""

    title: str
    units: Mapping[str, float]
    largest: float


_QUANTITIES = {
    'm': Quantity('a displacement', units.LENGTH, COLUMNS['displacement'].largest),
    'rad': Quantity('an angle', units.ANGLE, 100.0),
    'N': Quantity('a force', units.FORCE, COLUMNS['force'].largest),
    'Nm': Quantity('a torque', units.TORQUE, 1e6),
    's': Quantity('a time', units.TIME, COLUMNS['time'].largest),
}
"""By SI unit."""
_KINDS = {RESPONSE: ('m', 'rad'), LOAD: ('N', 'Nm'), TIME: ('s',)}
_LOAD_OF = {'m': 'N', 'rad': 'Nm'}
_WORDS = {
    RESPONSE: {*COLUMNS['displacement'].words, 'angle', 'rotation', 'response'},
    LOAD: {*COLUMNS['force'].words, 'torque', 'moment'},
    TIME: set(COLUMNS['time'].words),
}
"""Names that say what a column is; they are preferred to others of the same unit."""
_JOINT = re.compile(r'(?<![^\W_])(?P<letters>[^\W\d_]+)[\s_]?(?P<number>\d+)')


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
    def in_table(self) -> Place:
        """The same as a place in a table."""
        return Place(Column(self.heading, (), largest=_QUANTITIES[self.unit].largest), self.place, self.factor)

    @property
    def joint(self) -> int | None:
        """Number of the joint in the heading, if it has one."""
        match = _JOINT.search(self.word)
        is_channel = match is not None and match['letters'] in ('ch', 'channel', 'ai', 'sensor')
        return int(match['number']) if match and not is_channel else None


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
    return all(words & set(COLUMNS[name].words) for name in ('force', 'displacement'))


def _column(heading: str, place: int) -> RecordColumn:
    text = re.sub(r'[\s·*]', '', split_heading(heading)[1])
    for unit, quantity in _QUANTITIES.items():
        if text in quantity.units:
            return RecordColumn(heading, place, unit, quantity.units[text])
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
        got = f'the column is {_QUANTITIES[unit].title} ({unit})' if unit else 'the column has no known unit'
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
    pair = f'{one.heading} is {_QUANTITIES[one.unit].title} and {other.heading} {_QUANTITIES[other.unit].title}'
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
    return ', '.join(unit for si in _KINDS[kind] for unit in _QUANTITIES[si].units if unit.isascii())


def _endings(kind: str) -> str:
    return 'such as displacement_m or angle_rad' if kind == RESPONSE else 'such as force_N or torque_Nm'


def _listed(headings: Sequence[str]) -> str:
    shown = 6
    more = len(headings) - shown
    return ', '.join(headings[:shown]) + (f' and {more} more' if more > 0 else '')


class RecordTable(NamedTuple):
    """A table before it is known what drives it; arrays (n,), SI.

    Attributes:
        source: the file.
        time: s; None where the table has no column of it.
        load: N or Nm.
        response: m or rad.
        load_unit: 'N' or 'Nm'.
        response_unit: 'm' or 'rad'.
        joint: its number in the headings, if there is one.
        notes: remarks on the file.
    """

    source: str
    time: Floats | None
    load: Floats
    response: Floats
    load_unit: str
    response_unit: str
    joint: int | None = None
    notes: tuple[str, ...] = ()

    @property
    def readings(self) -> DialGaugeReadings:
        """As a record driven by its motion: force over displacement, or torque over angle."""
        time = np.nan if self.time is None else self.time
        return replace(DialGaugeReadings.of(self.load, self.response, time=time, source=self.source), notes=self.notes)

    @property
    def load_record(self) -> LoadRecord:
        """As a record driven by its load.

        Raises:
            UnsupportedDataError: see `LoadRecord`, or there are no times.
        """
        if self.time is None or not np.all(np.isfinite(self.time)):
            raise UnsupportedDataError(f'{self.source}: the time of every row is needed', 'add a column time_s')
        return LoadRecord(
            self.source, self.time, self.load, self.response, self.load_unit, self.response_unit, self.notes
        )


def load_record_table(path: str | Path, response: str | None = None, load: str | None = None) -> RecordTable:
    """Reads a record.

    Args:
        path: the file.
        response: heading of the response; None for the one that its name or its unit tells.
        load: heading of the load, likewise.

    Raises:
        ParameterError: a column asked for does not exist, or is no response or load.
        RecordingError: the file cannot be read, columns do not go together, or a row is wrong.
    """
    table = load_table(Path(path), 'time_s,angle_rad,torque_Nm')
    if response is None and load is None and is_gauge_heading(table.heading):
        readings = table_readings(table)
        return RecordTable(
            table.source, readings.time, readings.force, readings.displacement, 'N', 'm', notes=readings.notes
        )
    chosen = choose_columns(table.heading, table.source, response, load)
    values = table.read({kind: column.in_table for kind, column in chosen._asdict().items() if column}).numbers
    if chosen.response.unit == 'rad':
        _check_continuous(values[RESPONSE], chosen.response, table)
    return RecordTable(
        table.source,
        values.get(TIME),
        values[LOAD],
        values[RESPONSE],
        chosen.load.unit,
        chosen.response.unit,
        chosen.response.joint if chosen.response.joint is not None else chosen.load.joint,
    )


def check_alike(tables: list[RecordTable]) -> None:
    """Checks that the records may be of one joint.

    Raises:
        RecordingError: their units or the numbers of their joints differ; the first other one is named.
    """
    first = tables[0]
    for table in tables[1:]:
        if table.load_unit != first.load_unit:
            problem = f'its load is in {table.load_unit}, that of {first.source} in {first.load_unit}'
            raise RecordingError(table.source, problem, 'give records of one joint')
        if None not in (table.joint, first.joint) and table.joint != first.joint:
            problem = f'a record of joint {table.joint}, but {first.source} is one of joint {first.joint}'
            raise RecordingError(table.source, problem, 'give records of one joint, or rename the columns')


def _check_continuous(angle: Floats, column: RecordColumn, table: Table) -> None:
    steps = np.abs(np.diff(angle))
    if np.any(steps > np.pi):
        line = table.rows[int(steps.argmax()) + 1][0]
        problem = f'line {line}: {column.heading} jumps by {steps.max():.3g} rad, more than half a turn'
        raise RecordingError(table.source, problem, 'unwrap the angle, or check the unit of the column')


MOTION = 'motion'


def what_drives(tables: list[RecordTable], driven: str | None = None) -> str:
    """What drives the records.

    Args:
        tables: the records of one call.
        driven: `LOAD` or `MOTION` if it is known; None to see it in the records.

    Returns:
        `LOAD` or `MOTION`.

    Raises:
        ParameterError: the records are of both kinds.
        UnsupportedDataError: a load is constant.
    """
    if driven is not None:
        return driven
    kinds = [_drives(table) for table in tables]
    for table, kind in zip(tables[1:], kinds[1:], strict=True):
        if kind != kinds[0]:
            problem = f'driven by its {kind}, but {tables[0].source} by its {kinds[0]}'
            raise ParameterError(table.source, problem, 'give records of one kind, or say which by --driven')
    return kinds[0]


def _drives(table: RecordTable) -> str:
    at_rest_first = is_at_rest_first(table.load)
    if _has_full_loops(table.response):
        return LOAD if at_rest_first and _keeps_to_one_side(table.load) else MOTION
    if len(table.load) >= FEWEST_SAMPLES and is_constant(table.load):
        raise UnsupportedDataError(f'{table.source}: {CONSTANT_LOAD}', CHECK_LOAD)
    return LOAD if at_rest_first else MOTION


def _has_full_loops(response: Floats) -> bool:
    edges = np.array([0, *reversals(response).tolist(), len(response) - 1])
    sweeps = len(edges) - 1
    if sweeps < FEWEST_SWEEPS or len(response) < FEWEST_ROWS * sweeps:
        return False
    # the median extent is 0.5 of the range where the amplitude grows evenly
    return bool(np.median(np.abs(np.diff(response[edges]))) >= 0.4 * np.ptp(response))


def _keeps_to_one_side(load: Floats) -> bool:
    lowest, highest = np.percentile(load - load[0], (2, 98))  # impacts are left out
    return bool(min(-lowest, highest) < 0.25 * max(-lowest, highest))
