"""Readings of a dial gauge and a force gauge: the rows of the experiments of section 5.2, and their CSV files.

The displacement is positive along the positive force.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Table, csv_lines, load_table, one_of, parse_table, plain
from scara_kinetostatic.model.arrays import Floats

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
_GAUGE_PLACES = (TIP, LINK)
"""Where the dial gauge touches: the end-effector, or the end of link 2, where the gripper does not contribute."""


@dataclass(frozen=True)
class DialGaugeReadings:
    """Rows in the order in which they were taken; every array (n,), read-only.

    Attributes:
        force: load along the direction, of either sign, N.
        displacement: of the point that the gauge touches, along the same direction, m.
        part: one of `PARTS` per row.
        gauge_at: `TIP` or `LINK` per row.
        direction: of the positive load, rad; NaN where none is given.
        lever: arm of the load about the joint, m; NaN where none is given.
        cycle: number of the load cycle; -1 where none is given.
        time: s; NaN where none is given.
        source: index of the row's file in `sources`.
        line: its line there, from 1; 0 if it comes from no file.
        sources: names of the files.
        notes: remarks on the files.

    Raises:
        ParameterError: lengths differ, a force or displacement is not finite, or a part or place is unknown.
    """

    force: Floats
    displacement: Floats
    part: NDArray[np.str_]
    gauge_at: NDArray[np.str_]
    direction: Floats
    lever: Floats
    cycle: NDArray[np.int64]
    time: Floats
    source: NDArray[np.int64]
    line: NDArray[np.int64]
    sources: tuple[str, ...] = ('readings',)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = np.array(getattr(self, name))
            if array.shape != np.shape(self.force):
                raise ParameterError(name, f'expected as many values as forces, {len(self.force)}, got {array.shape}')
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in ('force', 'displacement'):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ParameterError(name, 'expected finite numbers')
        for name, words in (('part', PARTS), ('gauge_at', _GAUGE_PLACES)):
            if not np.all(np.isin(getattr(self, name), words)):
                raise ParameterError(name, f'expected one of {" ".join(words)}')

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def of(
        cls,
        force: ArrayLike,
        displacement: ArrayLike,
        *,
        part: ArrayLike = GRIPPER,
        gauge_at: ArrayLike | None = None,
        direction: ArrayLike = np.nan,
        lever: ArrayLike = np.nan,
        cycle: ArrayLike = -1,
        time: ArrayLike = np.nan,
        source: str = 'readings',
    ) -> DialGaugeReadings:
        """From arrays, or one value for all rows; `gauge_at`: by default `TIP` for the gripper, `LINK` for a joint."""
        force = np.asarray(force, dtype=float)
        parts = np.broadcast_to(np.asarray(part), force.shape)
        defaults = np.where(parts == GRIPPER, TIP, LINK)

        def column(value: ArrayLike) -> NDArray[Any]:
            return np.broadcast_to(np.asarray(value), force.shape)

        return cls(
            force,
            np.asarray(displacement, dtype=float),
            parts,
            defaults if gauge_at is None else column(gauge_at),
            column(direction),
            column(lever),
            column(cycle),
            column(time),
            source=np.zeros(force.shape, dtype=np.int64),
            line=np.zeros(force.shape, dtype=np.int64),
            sources=(source,),
        )

    def select(self, rows: ArrayLike) -> DialGaugeReadings:
        """Some of the rows, by mask or index."""
        return replace(self, **{name: getattr(self, name)[np.asarray(rows)] for name in _ARRAYS})


_ARRAYS = tuple(field.name for field in fields(DialGaugeReadings) if field.name not in ('sources', 'notes'))


def join(all_readings: Iterable[DialGaugeReadings]) -> DialGaugeReadings:
    """Readings one after the other."""
    several = list(all_readings)
    shift = np.cumsum([0, *(len(readings.sources) for readings in several)])
    arrays = {name: np.concatenate([getattr(readings, name) for readings in several]) for name in _ARRAYS}
    arrays['source'] = np.concatenate([r.source + shift[k] for k, r in enumerate(several)])
    return DialGaugeReadings(
        **arrays,
        sources=tuple(name for readings in several for name in readings.sources),
        notes=tuple(note for readings in several for note in readings.notes),
    )


class TableDefaults(NamedTuple):
    """Values for missing columns and empty cells: part, lever in m, direction in rad, place of the gauge."""

    part: str = GRIPPER
    lever: float = math.nan
    direction: float = math.nan
    gauge_at: str | None = None


def load_readings(path: str | Path, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """Reads a table of readings.

    Args:
        path: the file.
        defaults: values where a column is missing, or a cell of an optional one is empty.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return table_readings(load_table(Path(path), EXAMPLE), defaults)


def parse_readings(text: str, where: str, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a text.

    Args:
        text: of the table.
        where: its file, for messages.
        defaults: see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    return table_readings(parse_table(text, where, EXAMPLE), defaults)


EXAMPLE = 'force_N,displacement_mm'


def _cycle(cell: str) -> int:
    if not re.fullmatch(r'\d{1,6}([.,]0*)?', plain(cell)):
        raise ValueError(f'expected the number of a cycle, got {cell.strip()[:40]!r}')
    return int(re.split('[.,]', plain(cell))[0])


COLUMNS = {
    column.name: column
    for column in (
        Column('force', ('force', 'load', 'f'), columns.FORCE, True, largest=1e6),
        Column('displacement', ('displacement', 'deflection', 'gauge', 'ds', 'δs'), columns.LENGTH, True, largest=0.5),
        Column(
            'direction',
            ('direction', 'angle'),
            columns.ANGLE,
            blank=True,
            largest=4 * math.pi + 1e-9,
            hint='give an angle within two turns',
        ),
        Column('lever', ('lever', 'arm'), columns.LENGTH, blank=True, largest=10.0, positive=True),
        Column('time', ('time', 't'), columns.TIME, blank=True, largest=1e12),
        Column('cycle', ('cycle',), blank=True, parse=_cycle),
        Column(
            'part',
            ('part', 'joint'),
            blank=True,
            parse=one_of({GRIPPER: GRIPPER, 'joint1': JOINT1, 'joint2': JOINT2, '1': JOINT1, '2': JOINT2}),
        ),
        Column('gauge_at', ('gauge_at', 'seat'), blank=True, parse=one_of({TIP: TIP, LINK: LINK})),
    )
}
"""Those of a table of readings, by name."""


def table_readings(table: Table, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a table.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    places = table.find(COLUMNS.values())
    numbers, others = table.read(places)
    count = len(table.rows)
    absent = np.full(count, np.nan)

    def number(name: str, instead: float) -> Floats:
        values = numbers.get(name, absent)
        return np.where(np.isnan(values), instead, values)

    def other(name: str, instead: Any) -> list[Any]:
        return [instead if value is None else value for value in others.get(name, [None] * count)]

    parts = other('part', defaults.part)
    at = zip(other('gauge_at', defaults.gauge_at), parts, strict=True)
    return DialGaugeReadings(
        force=numbers['force'],
        displacement=numbers['displacement'],
        part=np.array(parts, dtype=np.str_),
        gauge_at=np.array([place or (TIP if part == GRIPPER else LINK) for place, part in at], dtype=np.str_),
        direction=number('direction', defaults.direction),
        lever=number('lever', defaults.lever),
        cycle=np.array(other('cycle', -1), dtype=np.int64),
        time=number('time', math.nan),
        source=np.zeros(count, dtype=np.int64),
        line=np.array([line for line, _ in table.rows], dtype=np.int64),
        sources=(table.source,),
        notes=tuple(f'{table.source}: {note}' for note in table.unused(places)),
    )


def dump_readings(readings: DialGaugeReadings) -> str:
    """The readings as a table that `parse_readings` reads; columns without any value are left out."""
    names = {
        'force_N': readings.force,
        'displacement_um': 1e6 * readings.displacement,
        'direction_deg': np.degrees(readings.direction),
        'lever_m': readings.lever,
        'time_s': readings.time,
    }
    table = {
        name: [f'{value:.9g}' if np.isfinite(value) else '' for value in values.tolist()]
        for name, values in names.items()
        if np.any(np.isfinite(values))
    }
    if np.any(readings.cycle >= 0):
        table['cycle'] = ['' if number < 0 else str(number) for number in readings.cycle.tolist()]
    return csv_lines(table | {'part': readings.part.tolist(), 'gauge_at': readings.gauge_at.tolist()})
