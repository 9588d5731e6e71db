"""Tables of loads and displacements: those of a dial gauge and a force gauge, section 5.2, and continuous records.

A table of a dial gauge holds loads point by point, run by run, or a record of loops.

The columns of a record are the response, the load and the time among any others, chosen by name or by their units
(`files.columns`). A displacement goes with a force, an angle with a torque. A heading such as `q2_rad` or `tau2_ext_Nm`
tells the number of its joint: the columns of two joints do not go together. A column such as `commanded_Nm` says what
drives.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError, RecordingError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Place, Table, load_table, one_of, split_heading
from scara_kinetostatic.model.arrays import Floats, Indices, read_only
from scara_kinetostatic.studies.loops.record import LOAD, MOTION, Record

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
"""Where the dial gauge touches: the end-effector, or the end of link 2, where the gripper does not contribute."""


@dataclass(frozen=True)
class Readings:
    """Rows of one run, in the order in which they were taken: one part, one place of the gauge, one direction.

    Attributes:
        force: load along the direction, of either sign, (n,), N.
        displacement: of the point that the gauge touches, positive along the positive force, (n,), m.
        cycle: number of the load cycle, (n,); NaN where none is given.
        line: of the file, (n,), from 1.
        part: one of `PARTS`.
        gauge_at: `TIP` or `LINK`; if empty the `TIP` for a gripper, the `LINK` for a joint.
        direction: of the positive load, rad; NaN if none is given.
        lever: arm of the load about the joint, m; NaN for the gripper.
        source: name of the file.
    """

    force: Floats
    displacement: Floats
    cycle: Floats = field(default_factory=lambda: np.array(math.nan))
    line: Indices = field(default_factory=lambda: np.array(0))
    part: str = GRIPPER
    gauge_at: str = ''
    direction: float = math.nan
    lever: float = math.nan
    source: str = 'readings'

    def __post_init__(self) -> None:
        for name in ('force', 'displacement', 'cycle', 'line'):
            array = np.array(np.broadcast_to(getattr(self, name), np.shape(self.force)))
            object.__setattr__(self, name, read_only(array))
        if not self.gauge_at:
            object.__setattr__(self, 'gauge_at', TIP if self.part == GRIPPER else LINK)

    def __len__(self) -> int:
        return len(self.force)

    @property
    def name(self) -> str:
        """What was loaded, for messages."""
        part = self.part.replace('joint', 'joint ')
        return part if math.isnan(self.direction) else f'{part} at {math.degrees(self.direction):g}°'


class GaugeTable(NamedTuple):
    """What a table holds: its runs in the order in which they begin, or its record of loops; remarks."""

    runs: tuple[Readings, ...]
    record: Record | None = None
    notes: tuple[str, ...] = ()


COLUMNS = (
    Column('force', ('force', 'load', 'f'), columns.FORCE, True, largest=1e6),
    Column('displacement', ('displacement', 'deflection', 'gauge', 'ds', 'δs'), columns.LENGTH, True, largest=0.5),
    Column(
        'direction', ('direction', 'angle'), columns.ANGLE, blank=True,
        largest=4 * math.pi + 1e-9, hint='give an angle within two turns',
    ),
    Column('lever', ('lever', 'arm'), columns.LENGTH, blank=True, largest=10.0, positive=True),
    Column('time', ('time', 't'), columns.TIME, blank=True, largest=1e12),
    Column('cycle', ('cycle',), blank=True, largest=1e6),
    Column(
        'part', ('part', 'joint'), blank=True,
        parse=one_of({GRIPPER: GRIPPER, 'joint1': JOINT1, 'joint2': JOINT2, '1': JOINT1, '2': JOINT2}),
    ),
    Column('gauge_at', ('gauge_at',), blank=True, parse=one_of({TIP: TIP, LINK: LINK})),
)  # fmt: skip
_OF_RUN = ('part', 'gauge_at', 'direction', 'lever')
_ABSENT = {**dict.fromkeys(('direction', 'lever', 'time', 'cycle'), math.nan), 'part': GRIPPER, 'gauge_at': ''}


def load_readings(path: str | Path, **defaults: str | float) -> GaugeTable:
    """Reads a table of readings.

    Args:
        path: the file.
        defaults: by name of an optional column, the value where it is missing, or a cell of it is empty; SI.

    Raises:
        ParameterError: the rows of a joint have no lever.
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
        UnsupportedDataError: the time of a record of loops does not rise, or its load never changes.
    """
    return table_readings(load_table(Path(path), 'force_N,displacement_mm'), **defaults)


def table_readings(table: Table, **defaults: str | float) -> GaugeTable:
    """The readings in a table; see `load_readings`."""
    places = table.find(COLUMNS)
    values = table.read(places)
    cells: dict[str, list[Any]] = {name: list(several) for name, several in (values.numbers | values.others).items()}
    for name, default in (_ABSENT | defaults).items():
        given = cells.get(name, [None] * len(table.rows))
        cells[name] = [default if cell is None or cell != cell else cell for cell in given]  # NaN is an empty one
    notes = tuple(f'{table.source}: {note}' for note in table.unused(places))
    if not np.isnan(cells['time']).any() and np.isnan(cells['cycle'] + cells['direction']).all():
        time, force, displacement = (np.array(cells[name]) for name in ('time', 'force', 'displacement'))
        return GaugeTable((), Record(table.source, time, force, displacement, 'N'), notes)
    cells['line'] = [line for line, _ in table.rows]
    runs: dict[tuple[Any, ...], list[int]] = {}
    for row, (part, gauge_at, direction, lever) in enumerate(zip(*(cells[name] for name in _OF_RUN), strict=True)):
        if part != GRIPPER and math.isnan(lever):
            where = f'{table.source}: line {table.rows[row][0]}'
            raise ParameterError(where, 'a joint needs its lever', 'add a column lever_m, or give --lever')
        own = (str(round(direction, 6)), str(round(lever, 9)) if part != GRIPPER else '')
        runs.setdefault((part, gauge_at, *own), []).append(row)
    return GaugeTable(tuple(_run(table.source, cells, rows) for rows in runs.values()), None, notes)


def _run(source: str, cells: dict[str, list[Any]], rows: list[int]) -> Readings:
    """One run, from the numbers of its rows."""
    force, displacement, cycle, line = (
        np.array(cells[name])[rows] for name in ('force', 'displacement', 'cycle', 'line')
    )
    first = {name: cells[name][rows[0]] for name in _OF_RUN}
    lever = math.nan if first['part'] == GRIPPER else first['lever']
    return Readings(force, displacement, cycle, line, **{**first, 'lever': lever}, source=source)


_QUANTITIES = {
    'm': (columns.LENGTH, 0.5),
    'rad': (columns.ANGLE, 100.0),
    'N': (columns.FORCE, 1e6),
    'Nm': (columns.TORQUE, 1e6),
    's': (columns.TIME, 1e12),
}
"""By SI unit: factor to it by unit, and the largest plausible size."""
_RESPONSES = ('displacement', 'deflection', 'response', 'angle', 'rotation')
_KINDS = {
    'load': (('N', 'Nm'), ('force', 'load', 'f', 'torque', 'moment'), 'force_N or torque_Nm'),
    'response': (('m', 'rad'), _RESPONSES, 'displacement_m or angle_rad'),
    'time': (('s',), ('time', 't'), 'time_s'),
}
"""What a column may be: its SI units, words that are preferred to others of the same unit, an example."""


class RecordColumn(NamedTuple):
    """A column: its heading, its number from 0, its SI unit, the factor to it."""

    heading: str
    number: int
    unit: str
    factor: float

    @property
    def joint(self) -> int | None:
        """Number of the joint in the heading, if it has one."""
        match = re.search(r'(?:joint|axis|angle|torque|tau|q)[ _]?(\d+)', self.heading.lower())
        return int(match[1]) if match else None

    def goes_with(self, other: RecordColumn) -> bool:
        """Whether they are a displacement and a force, or an angle and a torque."""
        return {self.unit, other.unit} in ({'m', 'N'}, {'rad', 'Nm'})


def choose_columns(
    headings: Sequence[str], where: str, response: str | None = None, load: str | None = None
) -> dict[str, RecordColumn]:
    """The columns of a record by kind: load, response and time.

    Args:
        headings: of the table.
        where: the file, for messages.
        response: heading of the response; None for the only one, or the one with a name such as `angle_rad`.
        load: heading of the load, likewise; its quantity must go with that of the response.

    Raises:
        ParameterError: the table has no such column of a response or a load.
        RecordingError: a column is not given and cannot be told, or the two do not go together.
    """
    known = []
    for number, heading in enumerate(headings):
        unit = re.sub(r'[\s·*]', '', split_heading(heading)[1])
        sizes = ((si, factors[unit]) for si, (factors, _) in _QUANTITIES.items() if unit in factors)
        known += [RecordColumn(heading, number, si, factor) for si, factor in sizes]
    names = {'load': load, 'response': response, 'time': None}
    chosen: dict[str, RecordColumn] = {}
    for kind in sorted(names, key=lambda kind: names[kind] is None):  # those named come first
        units, words, example = _KINDS[kind]
        fitting, name = [column for column in known if column.unit in units], names[kind]
        if name is not None:
            found = [column for column in fitting if column.heading == name.strip()]
            if len(found) != 1:
                problem = f'expected one column of {where} with this name and a unit of a {kind}, got {len(found)}'
                remedy = f'choose {_listed(fitting)}' if fitting else f'name one {example}'
                raise ParameterError(f'--{kind} {name}', problem, remedy)
        else:
            other = None if kind == 'time' else next(iter(chosen.values()), None)
            fitting = [column for column in fitting if other is None or column.goes_with(other)]
            found = [column for column in fitting if split_heading(column.heading)[0].lower() in words]
            found = fitting if len(fitting) == 1 else found
            if len(found) != 1 and fitting:
                remedy = 'leave all but one out' if kind == 'time' else f'choose one by --{kind}'
                problem = f'{len(fitting)} columns may be the {kind}: {_listed(fitting)}'
                raise RecordingError(where, problem, remedy)
            if not found:
                goes_with = f' that goes with {other.heading}' if other else ''
                problem = f'there is no column of the {kind}{goes_with}'
                raise RecordingError(where, problem, f'name one with its unit, such as {example}')
        chosen[kind] = found[0]
    one, other = chosen['response'], chosen['load']
    if not one.goes_with(other):
        problem = f'the units of {one.heading} and {other.heading} do not go together'
        remedy = 'give an angle with a torque (rad, Nm), or a displacement with a force (m, N)'
        raise RecordingError(where, problem, remedy)
    if None not in (one.joint, other.joint) and one.joint != other.joint:
        problem = f'{one.heading} and {other.heading} are columns of two joints, {one.joint} and {other.joint}'
        raise RecordingError(where, problem, 'choose those of one joint, or rename one if they do belong together')
    return chosen


def _listed(several: Sequence[RecordColumn]) -> str:
    return ', '.join(column.heading for column in several[:6]) + (' …' if len(several) > 6 else '')


def load_record(path: str | Path, response: str | None = None, load: str | None = None) -> Record:
    """Reads a record.

    Args:
        path: the file.
        response: heading of the response; None for the one that its name or its unit tells.
        load: heading of the load, likewise.

    Raises:
        ParameterError: a column asked for does not exist, or is no response or load.
        RecordingError: the file cannot be read, columns do not go together, or a row is wrong.
        UnsupportedDataError: see `Record`.
    """
    table = load_table(Path(path), 'time_s,angle_rad,torque_Nm')
    chosen = choose_columns(table.heading, table.source, response, load)
    places = {
        kind: Place(Column(kind, (), largest=_QUANTITIES[column.unit][1]), column.number, column.factor)
        for kind, column in chosen.items()
    }
    values = table.read(places).numbers
    steps = np.abs(np.diff(values['response'], prepend=values['response'][0]))
    if chosen['response'].unit == 'rad' and steps.max() > np.pi:
        line = table.rows[int(steps.argmax())][0]
        problem = f'line {line}: {chosen["response"].heading} jumps by {steps.max():.3g} rad, more than half a turn'
        raise RecordingError(table.source, problem, 'unwrap the angle, or check the unit of the column')
    joint = chosen['response'].joint if chosen['response'].joint is not None else chosen['load'].joint
    commanded = {split_heading(each)[1] for each in table.heading if each.lower().startswith('command')}
    drivers = ((LOAD, 'load'), (MOTION, 'response'))
    stated = [driver for driver, kind in drivers if commanded & set(_QUANTITIES[chosen[kind].unit][0])]
    driven_by = stated[0] if stated else ''
    return Record(table.source, **values, load_unit=chosen['load'].unit, joint=joint, driven_by=driven_by)
