"""Touches as a table: CSV with one row per touch, checked row by row.

    q1_rad,q2_rad,fx_N,fy_N,object,time_s,approach1,approach2

The first four are needed: joint angles, and the force on the object in the base frame. The others are optional, as
columns and as cells:

- `object`: name of the touched object; where it is absent, it is found as in a recording (`touches.association`);
- `time_s`: time of the touch; absent: unknown, so that drift cannot be identified;
- `approach1`, `approach2`: each joint's last movement before the hold, rad, or only its sign, as 1 or -1; absent: 0,
  unknown, so that hysteresis and friction cannot be identified.

Unknown columns, and rows without joint angles and force, are named in a note and not used, so that a table of residuals
can be read as a table of touches. See `csv_text` for separators, decimal commas and encodings.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.csv_text import (
    CsvRows,
    raise_wrong_rows,
    read_csv_text,
    read_number,
    split_rows,
    too_many_cells,
)
from scara_kinetostatic.model.arrays import Floats

SUFFIX = '.csv'
NEEDED = ('q1_rad', 'q2_rad', 'fx_N', 'fy_N')
OPTIONAL = ('time_s', 'approach1', 'approach2')
OBJECT = 'object'
EXAMPLE = ','.join(NEEDED)
LARGEST = {
    'q1_rad': 30.0,
    'q2_rad': 30.0,
    'fx_N': 1e5,
    'fy_N': 1e5,
    'time_s': 1e12,
    'approach1': 30.0,
    'approach2': 30.0,
}
"""Beyond this a number is not plausible in its unit."""
_MOST_DEGREES = 1080.0
"""An angle beyond what is plausible in rad, but not beyond this, seems to be in degrees."""
_QUANTITIES = {
    'q1': ('q1_rad', 'joint angles in rad'),
    'q2': ('q2_rad', 'joint angles in rad'),
    'fx': ('fx_N', 'forces in N'),
    'fy': ('fy_N', 'forces in N'),
    'time': ('time_s', 'times in s'),
}
_OTHER_UNITS = {
    'deg', 'degs', 'degree', 'degrees', '°', 'grad', 'gon', 'rev', 'turn', 'mrad', 'urad', 'µrad', 'μrad',
    'kn', 'mn', 'un', 'µn', 'μn', 'dan', 'lb', 'lbf', 'lbs', 'kg', 'kgf', 'kp', 'g', 'ozf',
    'ms', 'us', 'µs', 'μs', 'ns', 'min', 'h', 'd',
}  # fmt: skip
"""Units that are not those of a table; a heading that ends in anything else is another quantity."""
_UNITS = frozenset(name.partition('_')[2].lower() for name, _ in _QUANTITIES.values())
_HEADING = re.compile(r'(?P<word>[a-z]+[12]?)[\s_]*[\[(]?\s*(?P<unit>[^\])]*?)\s*[\])]?\Z', re.IGNORECASE)


class TouchTable(NamedTuple):
    """The rows of a table of touches.

    Attributes:
        joints: Q, (n, 2), rad.
        force: on the object, base frame, (n, 2), N.
        objects: name of the touched object, n of them; empty where the table does not say.
        time: since the first touch, (n,), s; 0 where unknown.
        approach: each joint's last movement, (n, 2), rad or sign; 0 where unknown.
        lines: line number of each row, (n,).
        source: the file.
        notes: what is odd about it, one sentence each.
    """

    joints: Floats
    force: Floats
    objects: tuple[str, ...]
    time: Floats
    approach: Floats
    lines: tuple[int, ...]
    source: str
    notes: tuple[str, ...] = ()


def is_touch_table(path: str | Path) -> bool:
    """Whether a path names a table rather than a recording: by its suffix, in any case."""
    return Path(path).suffix.lower() == SUFFIX and not Path(path).is_dir()


def load_touch_table(path: str | Path) -> TouchTable:
    """Read a table of touches.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return parse_touch_table(read_csv_text(Path(path)), str(path))


def parse_touch_table(text: str, where: str) -> TouchTable:
    """The touches in a text.

    Args:
        text: of the table.
        where: its file, for messages.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    rows = split_rows(text, where, EXAMPLE)
    columns, unknown = _columns(rows.heading, where)
    rows, empty = _without_empty_rows(rows, columns, where)
    values, objects = _values(rows, columns, where)
    n = len(rows.body)
    time = values.get('time_s', np.zeros(n))
    return TouchTable(
        joints=np.stack([values['q1_rad'], values['q2_rad']], axis=-1),
        force=np.stack([values['fx_N'], values['fy_N']], axis=-1),
        objects=objects,
        time=time - time.min(),
        approach=np.stack([values.get(name, np.zeros(n)) for name in ('approach1', 'approach2')], axis=-1),
        lines=tuple(line for line, _ in rows.body),
        source=where,
        notes=(*_unknown_columns(unknown), *_empty_rows(empty)),
    )


def _columns(heading: Sequence[str], where: str) -> tuple[dict[str, int], list[str]]:
    """The number of each column by name, and the headings that are not known.

    Raises:
        RecordingError: a unit is wrong, or a column is missing or comes twice.
    """
    columns: dict[str, int] = {}
    unknown = []
    for place, cell in enumerate(heading):
        name = _name(cell.strip(), where)
        if name is None:
            unknown += [cell.strip()] if cell.strip() else []
        elif name in columns:
            both = f'{heading[columns[name]].strip()!r} and {cell.strip()!r}'
            raise RecordingError(where, f'two columns of {name}, {both}', 'leave one out')
        else:
            columns[name] = place
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        got = ', '.join(cell.strip() for cell in heading if cell.strip())
        raise RecordingError(where, f'there is no column {missing[0]!r}, got {got[:200]}', f'name them {EXAMPLE}')
    if ('approach1' in columns) != ('approach2' in columns):
        raise RecordingError(where, 'there is one of approach1 and approach2', 'give both, or none')
    return columns, unknown


def _name(heading: str, where: str) -> str | None:
    """The name of a column; None for one that is not known.

    Raises:
        RecordingError: it is a known quantity in another known unit, or in none.
    """
    lower = heading.lower()
    if lower in (OBJECT, 'approach1', 'approach2'):
        return lower
    match = _HEADING.match(heading)
    known = _QUANTITIES.get(match['word'].lower()) if match else None
    if match is None or known is None:
        return None
    name, what = known
    unit = match['unit'].lower()
    if unit != name.partition('_')[2].lower():
        if unit and unit not in _OTHER_UNITS and unit not in _UNITS:
            return None
        got = f'the unit {match["unit"]!r}' if match['unit'] else 'no unit'
        raise RecordingError(where, f'the column {heading!r} has {got}', f'give {what}, and name it {name}')
    return name


def _unknown_columns(names: Sequence[str]) -> list[str]:
    """A note on columns that are not used; none where there are none."""
    if len(names) < 2:
        return [f'the column {name!r} is unknown and not used' for name in names]
    return [f'the columns {", ".join(map(repr, names))} are unknown and not used']


def _without_empty_rows(rows: CsvRows, columns: Mapping[str, int], where: str) -> tuple[CsvRows, list[int]]:
    """The rows with a joint angle or force, and the line numbers of the others, such as those of rejected touches.

    Raises:
        RecordingError: no row has one.
    """
    needed = [columns[name] for name in NEEDED]
    filled = [any(cells[place].strip() for place in needed if place < len(cells)) for _, cells in rows.body]
    if not any(filled):
        raise RecordingError(where, f'no row has a number in {EXAMPLE}', 'give one row per touch')
    body = [row for row, keep in zip(rows.body, filled, strict=True) if keep]
    return rows._replace(body=body), [line for (line, _), keep in zip(rows.body, filled, strict=True) if not keep]


def _empty_rows(lines: Sequence[int]) -> list[str]:
    """A note on rows that are not used; none where there are none."""
    if not lines:
        return []
    more = f' and {len(lines) - 1} more' if len(lines) > 1 else ''
    return [f'line {lines[0]}{more}: no joint angles and no force; not used']


def _values(rows: CsvRows, columns: Mapping[str, int], where: str) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """The numbers by column, and the objects.

    Raises:
        RecordingError: a row is wrong; it names the line and the column, and the lines of others.
    """
    numbers: dict[str, list[float]] = {name: [] for name in columns if name != OBJECT}
    objects: list[str] = []
    wrong: list[tuple[int, str]] = []
    for line, cells in rows.body:
        problem = too_many_cells(cells, len(rows.heading), rows.decimal_comma)
        for name, place in columns.items():
            cell = cells[place] if place < len(cells) else ''
            if name == OBJECT:
                objects.append(cell.strip())
            elif not problem:
                value, problem = _number(cell, name, rows.decimal_comma)
                numbers[name].append(value)
        if problem:
            wrong.append((line, problem))
    if wrong:
        _check_degrees(numbers, rows.body[0][0], where)
    raise_wrong_rows(where, wrong)
    blank = [name for name, values in numbers.items() if np.isnan(values).any()]
    if 'time_s' in blank:  # some of the touches without a time: none has one
        if not np.isnan(numbers['time_s']).all():
            raise RecordingError(where, 'time_s: some cells are empty', 'give the time of every touch, or of none')
        del numbers['time_s']
    arrays = {name: np.nan_to_num(np.array(values), nan=0.0) for name, values in numbers.items()}
    return arrays, tuple(objects) if objects else ('',) * len(rows.body)


def _check_degrees(numbers: Mapping[str, Sequence[float]], first: int, where: str) -> None:
    """Refuse a table with angles in degrees: most of a column are beyond a turn in rad, none beyond three in degrees.

    Raises:
        RecordingError: names the columns and the number in the line `first`.
    """
    sizes = {name: np.abs(numbers[name]) for name in ('q1_rad', 'q2_rad')}
    columns = [name for name, size in sizes.items() if len(size) and np.median(size) > 2 * np.pi]
    if columns and all(sizes[name].max() <= _MOST_DEGREES for name in columns):
        verb = 'seems' if len(columns) == 1 else 'seem'
        shown = f'line {first}: {numbers[columns[0]][0]:.4g}'
        problem = f'{" and ".join(columns)} {verb} to be in degrees ({shown})'
        raise RecordingError(where, problem, f'give rad: multiply by {np.deg2rad(1.0):.6g}')


def _number(cell: str, name: str, decimal_comma: bool) -> tuple[float, str]:
    """The number in a cell, NaN where an optional one is empty, and what is wrong with it; empty if nothing is."""
    if name in OPTIONAL and not cell.strip():
        return float('nan'), ''
    try:
        value = read_number(cell, decimal_comma)
    except ValueError as error:
        return 0.0, f'{name}: {error}'
    if abs(value) > LARGEST[name]:
        degrees = name.endswith('_rad') and abs(value) <= _MOST_DEGREES
        unit = 'it seems to be in degrees, not in rad' if degrees else 'check the unit'
        return value, f'{name}: {cell.strip()[:40]} is not plausible; {unit}'
    return value, ''


def dump_touch_table(table: TouchTable) -> str:
    """A text that `parse_touch_table` reads back, to the last bit; columns without any content are left out."""
    columns: dict[str, list[str]] = {
        'q1_rad': _texts(table.joints[:, 0]),
        'q2_rad': _texts(table.joints[:, 1]),
        'fx_N': _texts(table.force[:, 0]),
        'fy_N': _texts(table.force[:, 1]),
    }
    if any(table.objects):
        columns[OBJECT] = [quoted(name) for name in table.objects]
    if table.time.any():
        columns['time_s'] = _texts(table.time)
    if table.approach.any():
        columns |= {f'approach{k + 1}': _texts(table.approach[:, k]) for k in (0, 1)}
    return csv_lines(columns)


def csv_lines(columns: Mapping[str, Sequence[str]]) -> str:
    """A CSV text of columns of equal length by name."""
    lines = [','.join(columns), *(','.join(row) for row in zip(*columns.values(), strict=True))]
    return '\n'.join(lines) + '\n'


def quoted(text: str) -> str:
    """A cell of text, in quotes where it needs them."""
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',;"\n\t#') else text


def _texts(values: Floats) -> list[str]:
    """Numbers in the shortest form that gives them back."""
    return [repr(value) for value in values.tolist()]
