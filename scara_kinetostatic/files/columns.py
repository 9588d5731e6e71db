"""Columns of a CSV file, as spreadsheets save it: the one reader of every table.

The heading is the first line that is neither empty nor a comment (`#`). It names each column with its unit:
`force_N`, `force [N]` and `force (N)` are the same. The unit is any of the tables here, for every reader; values are
converted to SI, and units of another quantity are refused. Separators are comma, semicolon or tab; with the latter two,
numbers may have a decimal comma. A row that is wrong is an error with its line and column: nothing is dropped silently.

    table = load_table(path, 'force_N,displacement_mm')
    places = table.find(COLUMNS)                        # where each column stands, its unit known
    values = table.read(places)                         # values.numbers['force']: (n,), SI
"""

from __future__ import annotations

import csv
import io
import math
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.atomic import read_file
from scara_kinetostatic.model.arrays import Floats

MAX_BYTES = 64 * 2**20
"""Larger files are refused."""
MAX_ROWS, MAX_CELLS = 200_000, 2_000_000
"""More lines are refused, and more separators: each costs memory."""
MAX_COLUMNS, MAX_HEADING = 1000, 100
"""More columns are refused, and longer headings, which regular expressions take apart."""
LENGTH = {'m': 1.0, 'mm': 1e-3, 'um': 1e-6, 'µm': 1e-6, 'μm': 1e-6}
ANGLE = {'rad': 1.0, 'mrad': 1e-3, 'urad': 1e-6, 'µrad': 1e-6, 'μrad': 1e-6, 'deg': math.pi / 180, '°': math.pi / 180}
FORCE = {'N': 1.0, 'kN': 1e3, 'mN': 1e-3}
TORQUE = {'Nm': 1.0, 'kNm': 1e3, 'mNm': 1e-3}
TIME = {'s': 1.0, 'ms': 1e-3}
SENSE_OR_ANGLE = {'': 1.0, **ANGLE}
"""An angle whose heading may leave out the unit: its sign alone, ±1, or rad."""
FORMULA = ('=', '+', '-', '@', '\t', '\r')
"""A cell that begins so is a formula to a spreadsheet."""
_LINE_ENDS = '\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029'
_NUMBER = re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?\Z')
_HEADING = re.compile(r'(?P<word>.*?)[\s_]*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|[_\s](?P<plain>[^_\s]+))?\Z')


class Column(NamedTuple):
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

    column: Column
    number: int
    factor: float = 1.0


class Values(NamedTuple):
    """What the rows of a table hold, by name of the column.

    Attributes:
        numbers: (n,) each, SI; NaN where a cell is empty.
        others: of columns that hold no numbers, n each; None where a cell is empty.
    """

    numbers: dict[str, Floats]
    others: dict[str, list[Any]]


@dataclass(frozen=True)
class Table:
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

    def find(self, columns: Iterable[Column]) -> dict[str, Place]:
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

    def _missing(self, column: Column, heading: str | None, columns: Sequence[Column]) -> RecordingError:
        if heading is not None:
            problem = f'the column {heading!r} has none of the units of {column.words[0]}'
            return RecordingError(self.source, problem, f'convert or rename it to {" or ".join(column.headings)}')
        got = ', '.join(filter(None, self.heading))[:200]
        names = ','.join(each.headings[0] for each in columns if each.required)
        return RecordingError(
            self.source, f'there is no column {column.headings[0]!r}, got {got}', f'name them {names}'
        )

    def unused(self, places: Mapping[str, Place]) -> list[str]:
        """A note on the columns that are not read; none where there are none."""
        read = {place.number for place in places.values()}
        names = [repr(heading) for index, heading in enumerate(self.heading) if heading and index not in read]
        return [f'columns that are unknown and not used: {", ".join(names)}'] if names else []

    def read(self, places: Mapping[str, Place]) -> Values:
        """The values of the columns.

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
        numbers = {name: np.array(column) for name, column in values.items() if places[name].column.parse is None}
        return Values(numbers, {name: column for name, column in values.items() if name not in numbers})

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
                raise ValueError(f'{cell.strip()[:40]} is too large to be plausible; {hint}')
            if column.positive and value <= 0:
                raise ValueError(f'expected a number above 0, got {cell.strip()[:40]}')
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
        raise ValueError(f'expected a number, got {repr(cell.strip()[:40]) if text else "nothing"}')
    return float(text)


def one_of(choices: Mapping[str, str]) -> Callable[[str], str]:
    """Reads cells that hold one of some words: the value by word, which is in lower case without spaces or dashes."""

    def parse(cell: str) -> str:
        if (text := re.sub(r'[\s_-]', '', cell.lower())) not in choices:
            values = ' or '.join(dict.fromkeys(choices.values()))
            raise ValueError(f'expected {values}, got {cell.strip()[:40]!r}')
        return choices[text]

    return parse


def split_heading(heading: str) -> tuple[str, str]:
    """A heading as its word and its unit, '' where it has none: `force_N`, `force [N]` and `force (N)` alike."""
    match = _HEADING.match(heading)
    assert match  # every text on one line
    return match['word'].strip(), (match['square'] or match['round'] or match['plain'] or '').strip()


def load_table(path: Path, example: str) -> Table:
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


def parse_table(text: str, source: str, example: str) -> Table:
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
        got = f'{len(heading)} columns, the longest heading {longest[:40]!r}'
        raise RecordingError(source, f'{problem}, got {got}', 'shorten the first line')
    if len(rows) < 2:
        raise RecordingError(source, 'there are no rows below the heading', 'give one row for each measurement')
    return Table(source, heading, tuple(rows[1:]), separator != ',')


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
