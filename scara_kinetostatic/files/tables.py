"""Tables as CSV, as spreadsheets save it: the one reader of every table; tables of touches, of poses and of states.

The heading is the first line that is neither empty nor a comment (`#`). It names each column with its unit:
`force_N`, `force [N]` and `force (N)` are the same. The unit is any of the tables here, for every reader; values are
converted to SI, and units of another quantity are refused. Separators are comma, semicolon or tab; with the latter two,
numbers may have a decimal comma. A row that is wrong is an error with its line and column: nothing is dropped silently.

    table = load_table(path, 'force_N,displacement_mm')
    places = table.find(COLUMNS)                        # where each column stands, its unit known
    values = table.read(places)                         # values['force']: (n,), SI

**Touches**, one in each row:

    q1_rad,q2_rad,fx_N,fy_N,object,time_s,approach1,approach2

The first four are needed: joint angles, and the force on the object in the base frame; or, with `fx_tool_N, fy_tool_N`
in place of `fx_N, fy_N`, in that of the tool, which link 2 carries. The others are optional, as columns and as cells:

- `object`: name of the touched object; where it is absent, it is found as in a recording (`touches.detection`);
- `time_s`: time of the touch; absent: unknown, so that drift cannot be identified;
- `approach1`, `approach2`: each joint's last movement before the hold, rad, or only its sign, as 1 or -1; absent: 0,
  unknown, so that hysteresis cannot be identified, and friction only of one object that turns all forces to one side.

Unknown columns, and rows without joint angles and force, are named in a note and not used, so that a table of residuals
can be read as a table of touches; so are rows in which one of these is NaN or infinite, unless most are.

**Poses and states** are extended by columns of results. `compensate` reads `x_m, y_m, fx_N, fy_N` and optional `elbow`
(``left`` or ``right``), `locate` reads `q1_rad, q2_rad, fx_N, fy_N`; both may have `time_s`, and `approach1,
approach2`, as a table of touches. Other columns are handed on as they are, unless a result has their name; numbers that
are read, with a decimal point and in SI units.
"""

from __future__ import annotations

import csv
import io
import math
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError, some_of
from scara_kinetostatic.files.atomic import MIB, read_file
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import MICRO, MILLI

MAX_BYTES = 64 * MIB
"""Larger files are refused."""
MAX_ROWS, MAX_CELLS = 200_000, 2_000_000
"""More lines are refused, and more separators: each costs memory."""
MAX_COLUMNS, MAX_HEADING = 1000, 100
"""More columns are refused, and longer headings, which regular expressions take apart."""
_SMALL = {'': 1.0, 'm': MILLI, 'u': MICRO, 'µ': MICRO, 'μ': MICRO}
_LARGE = {'': 1.0, 'k': 1 / MILLI, 'm': MILLI}
LENGTH = {f'{prefix}m': factor for prefix, factor in _SMALL.items()}
ANGLE = {f'{prefix}rad': factor for prefix, factor in _SMALL.items()} | dict.fromkeys(('deg', '°'), math.radians(1))
FORCE = {f'{prefix}N': factor for prefix, factor in _LARGE.items()}
TORQUE = {f'{unit}m': factor for unit, factor in FORCE.items()}
TIME = {'s': 1.0, 'ms': MILLI}
SENSE_OR_ANGLE = {'': 1.0, **ANGLE}
"""An angle whose heading may leave out the unit: its sign alone, ±1, or rad."""
FORMULA = ('=', '+', '-', '@', '\t', '\r')
"""A cell that begins so is a formula to a spreadsheet."""
_LINE_ENDS = '\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029'
_NUMBER = re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?\Z')
_HEADING = re.compile(r'(?P<word>.*?)[\s_]*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|[_\s](?P<plain>[^_\s]+))?\Z')


class Field(NamedTuple):
    """A column that a table may have.

    Attributes:
        name: key of its values.
        words: what a heading may call it, in lower case, without the unit; the first one is used in messages.
        units: factor to SI by unit; empty for a column without a unit. A key '' is that of a heading without one.
        required: whether the table must have it.
        blank: whether cells may be empty.
        largest: largest plausible size, SI.
        hint: the likeliest mistake behind a larger one under a heading in the SI unit.
        positive: whether numbers must be above 0.
        parse: reads a cell of a column that holds no numbers; raises ValueError.
    """

    name: str
    words: tuple[str, ...]
    units: Mapping[str, float] = {}
    required: bool = False
    blank: bool = False
    largest: float = math.inf
    hint: str = 'check the unit'
    positive: bool = False
    parse: Callable[[str], Any] | None = None

    @property
    def headings(self) -> list[str]:
        """What a heading should be, one for each unit."""
        return [f'{self.words[0]}_{unit}'.rstrip('_') for unit in self.units if unit.isascii()] or [self.words[0]]


class Place(NamedTuple):
    """Where a column stands in a table.

    Attributes:
        column: the column.
        number: of the column, from 0.
        factor: of its unit, to SI.
    """

    column: Field
    number: int
    factor: float = 1.0


@dataclass(frozen=True)
class Sheet:
    """The cells of a table.

    Attributes:
        source: the file.
        heading: of each column, without the spaces around it.
        rows: those with something in them: line number and cells.
        decimal_comma: whether numbers may have one.
    """

    source: str
    heading: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool

    def find(self, columns: Iterable[Field]) -> dict[str, Place]:
        """Where the columns stand, by name, in the order of the table; without those that it does not have.

        Raises:
            RecordingError: a column is missing or there twice, or its unit is missing or another one.
        """
        columns = tuple(columns)
        places: dict[str, Place] = {}
        wrong: dict[str, str] = {}
        for index, heading in enumerate(self.heading):
            word, unit = split_heading(heading)
            key = re.sub(r'\s+', '_', heading.lower())
            column = next((each for each in columns if not each.units and key in each.words), None)
            column = column or next((each for each in columns if each.units and word.lower() in each.words), None)
            if column is None:
                continue
            # the SI unit in any case: no prefix is mistaken for it
            is_si = unit.lower() in (known.lower() for known, factor in column.units.items() if factor == 1)
            factor = column.units.get(unit, 1.0 if is_si or not column.units else None)
            if factor is None:
                wrong.setdefault(column.name, heading)
                continue
            if column.name in places:
                both = f'{self.heading[places[column.name].number]!r} and {heading!r}'
                raise RecordingError(self.source, f'two columns of {column.name}, {both}', 'leave one out')
            places[column.name] = Place(column, index, factor)
        for column in columns:
            if column.name not in places and (column.required or column.name in wrong):
                raise self._missing(column, wrong.get(column.name), columns)
        return places

    def _missing(self, column: Field, heading: str | None, columns: Sequence[Field]) -> RecordingError:
        if heading is not None:
            problem = f'the column {heading!r} has none of the units of {column.words[0]}'
            return RecordingError(self.source, problem, f'convert or rename it to {" or ".join(column.headings)}')
        got = ', '.join(filter(None, self.heading))
        names = ','.join(each.headings[0] for each in columns if each.required)
        return RecordingError(
            self.source, f'there is no column {column.headings[0]!r}, got {got:.200}', f'name them {names}'
        )

    def unused(self, places: Mapping[str, Place]) -> list[str]:
        """A note on the columns that are not read; none where there are none."""
        read = {place.number for place in places.values()}
        names = [repr(heading) for index, heading in enumerate(self.heading) if heading and index not in read]
        return [f'columns that are unknown and not used: {", ".join(names)}'] if names else []

    def read(self, places: Mapping[str, Place]) -> dict[str, Any]:
        """The values of the columns by name.

        Returns:
            Of columns of numbers, (n,) each, SI, NaN where a cell is empty; of others a list, None where one is empty.

        Raises:
            RecordingError: a row is wrong; it names the line and the column, and how many others are wrong.
        """
        values: dict[str, list[Any]] = {name: [] for name in places}
        wrong: list[tuple[int, str]] = []
        for line, cells in self.rows:
            try:
                if any(cell.strip() for cell in cells[len(self.heading) :]):
                    hint = '' if self.decimal_comma else ' (a decimal comma needs semicolons between the columns)'
                    raise ValueError(f'expected {len(self.heading)} columns, got {len(cells)}{hint}')
                for name, place in places.items():
                    values[name].append(self._value(cells, place))
            except ValueError as error:
                wrong.append((line, str(error)))
        if wrong:
            (line, problem), *others = wrong
            also = f'; wrong rows besides: {len(others)}' if others else ''
            remedy = 'correct the table, or begin the line with # to leave it out'
            raise RecordingError(self.source, f'line {line}: {problem}{also}', remedy)
        return {name: cells if places[name].column.parse else np.array(cells) for name, cells in values.items()}

    def _value(self, cells: Sequence[str], place: Place) -> Any:
        cell = cells[place.number] if place.number < len(cells) else ''
        column = place.column
        try:
            if column.blank and not cell.strip():
                return math.nan if column.parse is None else None
            if column.parse is not None:
                return column.parse(cell)
            value = _number(cell, self.decimal_comma) * place.factor
            if not abs(value) <= column.largest:
                hint = column.hint if place.factor == 1 else 'check the unit'
                raise ValueError(f'{_start(cell)} is too large to be plausible; {hint}')
            if column.positive and value <= 0:
                raise ValueError(f'expected a number above 0, got {_start(cell)}')
        except ValueError as error:
            raise ValueError(f'{self.heading[place.number]}: {error}') from error
        return value


def _number(cell: str, decimal_comma: bool) -> float:
    """The number in a cell; infinite where it is too large for a float.

    Raises:
        ValueError: it holds none; the message says what was expected.
    """
    text = plain(cell)
    if decimal_comma and text.count(',') == 1 and '.' not in text:
        text = text.replace(',', '.')
    if not _NUMBER.match(text):
        raise ValueError(f'expected a number, got {repr(_start(cell)) if text else "nothing"}')
    return float(text)


def one_of(choices: Mapping[str, str]) -> Callable[[str], str]:
    """Reads cells that hold one of some words: the value by word, which is in lower case without spaces or dashes."""

    def parse(cell: str) -> str:
        if (text := re.sub(r'[\s_-]', '', cell.lower())) not in choices:
            values = ' or '.join(dict.fromkeys(choices.values()))
            raise ValueError(f'expected {values}, got {_start(cell)!r}')
        return choices[text]

    return parse


def split_heading(heading: str) -> tuple[str, str]:
    """A heading as its word and its unit, '' where it has none: `force_N`, `force [N]` and `force (N)` alike."""
    match = _HEADING.match(heading)
    assert match  # every text on one line
    return match['word'].strip(), (match['square'] or match['round'] or match['plain'] or '').strip()


def load_table(path: Path, example: str) -> Sheet:
    """Read a CSV file: UTF-8, UTF-16 with its byte-order mark, or Latin-1.

    Args:
        path: the file.
        example: of a heading, for messages.

    Raises:
        RecordingError: the file cannot be read, is too large, is no text, or has no heading or no rows.
    """
    return parse_table(_decoded(read_file(path, RecordingError, MAX_BYTES, 'CSV'), path), str(path), example)


def _decoded(data: bytes, path: Path) -> str:
    if data[:2] == b'PK' or data[:4] == b'\xd0\xcf\x11\xe0':
        raise RecordingError(path, 'expected CSV, got a spreadsheet', 'save it as CSV')
    try:
        text = data.decode('utf-16' if data[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else 'utf-8-sig')
    except UnicodeDecodeError:
        text = data.decode('latin-1')  # old spreadsheets; µ is the only letter that matters
    if '\0' in text:
        raise RecordingError(path, 'expected CSV text, got binary data', 'save the table as CSV UTF-8')
    return text


def parse_table(text: str, source: str, example: str) -> Sheet:
    """The cells in a text.

    Args:
        text: of the table.
        source: its file, for messages.
        example: of a heading, for messages.

    Raises:
        RecordingError: it is too large, there is no heading, no row below it, or a quote is not closed.
    """
    if max(map(text.count, _LINE_ENDS)) > MAX_ROWS or max(map(text.count, ',;\t')) > MAX_CELLS:
        raise RecordingError(source, f'expected at most {MAX_ROWS} rows and {MAX_CELLS} cells', 'split the table')
    lines = text.splitlines()
    first = next((k for k, line in enumerate(lines) if line.strip(' \t,;') and not line.startswith('#')), len(lines))
    separator = next((sign for sign in ';\t' if first < len(lines) and sign in lines[first]), ',')
    reader = csv.reader(io.StringIO('\n'.join(lines[first:])), delimiter=separator, strict=True)
    try:
        rows = [(first + reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        line = first + reader.line_num
        raise RecordingError(source, f'line {line}: not CSV: {error}', 'check the quotes') from error
    rows = [(line, cells) for line, cells in rows if not cells[0].lstrip().startswith('#')]
    if not rows:
        raise RecordingError(source, 'the file is empty', f'begin with a line such as {example}')
    heading = tuple(cell.strip() for cell in rows[0][1])
    longest = max(heading, key=len)
    if len(heading) > MAX_COLUMNS or len(longest) > MAX_HEADING:
        problem = f'expected at most {MAX_COLUMNS} columns with headings of {MAX_HEADING} characters'
        got = f'{len(heading)} columns, the longest heading {_start(longest)!r}'
        raise RecordingError(source, f'{problem}, got {got}', 'shorten the first line')
    if len(rows) < 2:
        raise RecordingError(source, 'there are no rows below the heading', 'give one row for each measurement')
    return Sheet(source, heading, tuple(rows[1:]), separator != ',')


def _start(cell: str) -> str:
    """What a message shows of a cell."""
    return cell.strip()[:40]


def plain(cell: str) -> str:
    """A cell without what spreadsheets put around a number."""
    return cell.strip().replace('\N{MINUS SIGN}', '-').replace('\N{NO-BREAK SPACE}', '').strip()


def csv_lines(columns: Mapping[str, Sequence[str]]) -> str:
    """A CSV text of columns of equal length by name."""
    lines = [','.join(columns), *(','.join(row) for row in zip(*columns.values(), strict=True))]
    return '\n'.join(lines) + '\n'


def csv_cell(text: str) -> str:
    """A cell of text: in quotes where it needs them, and with an apostrophe before what would be a formula."""
    if any(part.startswith(FORMULA) for part in (text, text.lstrip())) and not re.fullmatch(
        r'[-+]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eE][-+]?[0-9]+)?|-?(inf|nan)', text.strip()
    ):
        text = "'" + text
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',;"\r\n\t#') else text


_LARGEST_ANGLE = 30.0
COLUMNS = {
    column.name: column
    for column in (
        *(Field(f'{q}_rad', (q,), ANGLE, True, largest=_LARGEST_ANGLE, hint=f'name it {q}_deg where it is in degrees')
          for q in ('q1', 'q2')),
        *(Field(f'{x}_m', (x,), LENGTH, True, largest=100.0, hint=f'name it {x}_mm where it is in mm')
          for x in ('x', 'y')),
        *(Field(f'{f}_N', (f,), FORCE, True, largest=1e5) for f in ('fx', 'fy', 'fx_tool', 'fy_tool')),
        Field('elbow', ('elbow',), parse=one_of({'left': 'left', 'right': 'right'})),
        Field('time_s', ('time',), TIME, largest=1e12),
        *(Field(name, (name,), SENSE_OR_ANGLE, largest=_LARGEST_ANGLE) for name in ('approach1', 'approach2')),
        Field('object', ('object',), parse=str.strip),
    )
}  # fmt: skip
POSES, STATES = ('x_m', 'y_m', 'fx_N', 'fy_N'), ('q1_rad', 'q2_rad', 'fx_N', 'fy_N')
"""Columns that a table of poses, and one of states or touches, must have."""
EXAMPLE = ','.join(STATES)
TOOL_STATES = (*STATES[:2], 'fx_tool_N', 'fy_tool_N')
"""Those of a table of touches whose forces are in the frame of the tool."""
_NOT_FINITE = re.compile(r'[-+]?(nan|inf)', re.IGNORECASE)


class TouchTable(NamedTuple):
    """The rows of a table of touches.

    Attributes:
        joints: readings of the joints, (n, 2), rad.
        force: on the object, base frame, (n, 2), N; in that of the tool where `frame` is.
        objects: name of the touched object, n of them; empty where the table does not say.
        time: since the first touch, (n,), s; 0 where unknown.
        approach: each joint's last movement, (n, 2), rad or sign; 0 where unknown.
        lines: line number of each row, (n,).
        source: the file.
        notes: what is odd about it, one sentence each.
        frame: that of the forces.
    """

    joints: Floats
    force: Floats
    objects: tuple[str, ...]
    time: Floats
    approach: Floats
    lines: tuple[int, ...]
    source: str
    notes: tuple[str, ...] = ()
    frame: SensorFrame = SensorFrame.BASE


def is_touch_table(path: str | Path) -> bool:
    """Whether a path names a table rather than a recording: by its suffix, in any case."""
    return Path(path).suffix.lower() == '.csv' and not Path(path).is_dir()


def _places(table: Sheet, needed: Sequence[str], besides: Sequence[str], *, blank: bool) -> dict[str, Place]:
    """Where the columns are; the cells of those besides the needed ones may be empty if `blank`."""
    known = [COLUMNS[name] for name in needed]
    known += [COLUMNS[name]._replace(blank=blank and bool(COLUMNS[name].units)) for name in besides]
    places = table.find(known)
    if ('approach1' in places) != ('approach2' in places):
        raise RecordingError(table.source, 'there is one of approach1 and approach2', 'give both, or none')
    return places


def load_touch_table(path: str | Path) -> TouchTable:
    """Read a table of touches.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return _touches(load_table(Path(path), EXAMPLE))


def _touches(table: Sheet) -> TouchTable:
    words = {split_heading(heading)[0].lower() for heading in table.heading}
    states = TOOL_STATES if 'fx_tool' in words and 'fx' not in words else STATES
    places = _places(table, states, ('time_s', 'approach1', 'approach2', 'object'), blank=True)
    notes = table.unused(places)
    needed = [places[name].number for name in states]
    cells_of = ((line, [cells[k] for k in needed if k < len(cells)]) for line, cells in table.rows)
    wrong = dict.fromkeys(line for line, cells in cells_of if any(_NOT_FINITE.match(plain(cell)) for cell in cells))
    if wrong:
        some = f'rows, line {some_of(list(map(str, wrong)))}; not used'
        notes.append(f'not finite: {len(wrong)} of {len(table.rows)} {some}')
        if 2 * len(wrong) > len(table.rows):
            raise RecordingError(table.source, notes[-1], 'see what writes the table')
    table = replace(table, rows=tuple(row for row in table.rows if row[0] not in wrong))
    filled = [any(cells[k].strip() for k in needed if k < len(cells)) for _, cells in table.rows]
    if not any(filled):
        raise RecordingError(table.source, f'no row has a number in {EXAMPLE}', 'give one row per touch')
    empty = [line for (line, _), full in zip(table.rows, filled, strict=True) if not full]
    if empty:  # such as those of rejected touches
        more = f' and {len(empty) - 1} more' if len(empty) > 1 else ''
        notes.append(f'line {empty[0]}{more}: no joint angles and no force; not used')
    table = replace(table, rows=tuple(row for row, full in zip(table.rows, filled, strict=True) if full))
    values = table.read(places)
    time = values.get('time_s', np.zeros(len(table.rows)))
    unknown = np.isnan(time)
    if unknown.any() and not unknown.all():
        raise RecordingError(table.source, 'time_s: some cells are empty', 'give the time of every touch, or of none')
    approach = [values.get(name, np.zeros(len(time))) for name in ('approach1', 'approach2')]
    return TouchTable(
        joints=np.stack([values[name] for name in states[:2]], axis=-1),
        force=np.stack([values[name] for name in states[2:]], axis=-1),
        objects=tuple(values.get('object', [''] * len(time))),
        time=np.zeros(len(time)) if unknown.any() else time - time.min(),
        approach=np.nan_to_num(np.stack(approach, axis=-1), nan=0.0),
        lines=tuple(line for line, _ in table.rows),
        source=table.source,
        notes=tuple(notes),
        frame=SensorFrame.TOOL if states is TOOL_STATES else SensorFrame.BASE,
    )


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The rows of a table.

    Attributes:
        source: the file.
        values: the numbers by column, (n,) each.
        elbows: of each row, ``left`` or ``right``; None where the table does not say.
        heading: names of all its columns, in their order, without those that are empty throughout; of those that were
            converted, that of the SI unit.
        cells: text of all cells, row by row; numbers that were read have a decimal point, and are in SI units.
    """

    source: Path
    values: Mapping[str, Floats]
    elbows: tuple[str, ...] | None
    heading: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]

    def __len__(self) -> int:
        return len(self.cells)

    def pair(self, first: str, second: str) -> Floats:
        """Two columns, (n, 2)."""
        return np.stack([self.values[first], self.values[second]], axis=-1)

    @property
    def force(self) -> Floats:
        """F, (n, 2), N."""
        return self.pair('fx_N', 'fy_N')

    @property
    def time(self) -> Floats | None:
        """(n,), s; None where the table does not say."""
        return self.values.get('time_s')

    @property
    def approach(self) -> Floats | None:
        """Last movement of each joint, (n, 2), rad or its sense; None where the table does not say."""
        return self.pair('approach1', 'approach2') if 'approach1' in self.values else None

    def text_with(self, results: Mapping[str, NDArray[Any]]) -> str:
        """The table with columns of results, (n,) each, behind its own."""
        kept = [place for place, name in enumerate(self.heading) if name not in results]
        heading = [*(csv_cell(self.heading[place]) for place in kept), *results]
        texts = zip(*(map(str, column.tolist()) for column in results.values()), strict=True)
        rows = zip(self.cells, texts, strict=True)
        lines = [','.join((*(csv_cell(cells[place]) for place in kept), *text)) for cells, text in rows]
        return '\n'.join([','.join(heading), *lines, ''])


def load_pose_table(path: Path, needed: Sequence[str]) -> PoseTable:
    """Read a table.

    Args:
        path: the file.
        needed: `POSES` or `STATES`.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    table = load_table(path, ','.join(needed))
    places = _places(table, needed, ('elbow', 'time_s', 'approach1', 'approach2'), blank=False)
    read = table.read(places)
    numbers = {name: values for name, values in read.items() if isinstance(values, np.ndarray)}
    width = len(table.heading)
    texts = [[*cells[:width], *[''] * (width - len(cells))] for _, cells in table.rows]
    headings = list(table.heading)
    for name, values in numbers.items():
        _, k, factor = places[name]
        headings[k] = headings[k] if factor == 1 else name
        for row, value in zip(texts, values.tolist(), strict=True):
            row[k] = plain(row[k]).replace(',', '.') if factor == 1 else f'{value:.15g}'
    kept = [k for k, heading in enumerate(headings) if heading or any(row[k].strip() for row in texts)]
    return PoseTable(
        path,
        numbers,
        tuple(read['elbow']) if 'elbow' in read else None,
        tuple(headings[k] for k in kept),
        tuple(tuple(row[k] for k in kept) for row in texts),
    )
