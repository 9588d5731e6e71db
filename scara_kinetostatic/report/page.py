"""How results are shown: one form of a report, one way to the terminal, one to a page, one to JSON, for every verb.

A verb makes a `Report` from its result; figures are drawn when the page is made, so that text alone draws none:

    from functools import partial

    from scara_kinetostatic.report.page import Figure, Note, Report, Section, Table, Verdict
    from scara_kinetostatic.report.page import as_page, as_text, json_text

    def drift_report(drift: Drift) -> Report:
        return Report(
            title='Drift of a calibration',
            answer=Verdict('The arm has not changed', 'good', ('No parameter moved by more than its uncertainty.',)),
            source='monday.mcap, tuesday.mcap',
            blocks=(
                'A paragraph, on the terminal and on the page.',
                Section('Parameters', (Table(('name', 'change'), ('', 'mm'), rows), Note('± is one std. deviation'))),
                Section('Over time', (Figure(partial(drift_picture, drift), 'Change of each parameter.'),)),
            ),
            remarks=drift.warnings,
            footer='all numbers in full in drift.json',
        )

    print(as_text(report))            # no figures, no notes; a section with nothing left is left out
    page = as_page(report)            # one file of HTML
    text = json_text({'schema': 'scara_kinetostatic/drift/1', 'parameters': drift.parameters})

`json_text` takes dataclasses, named tuples, arrays, enums and times as they are, and writes null for a number that is
not finite. A block for one of the two alone is in ``Section('', (…), shown='page')`` or ``'terminal'``; one that few
need is ``folded``. Values become text by `model.quantities.shown`; pictures SVG by `figure.as_svg`.
"""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import datetime, timezone
from enum import Enum
from functools import partial
from itertools import groupby
from operator import add
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.model.quantities import NOT_DETERMINED as NOT_DETERMINED

_NUMBER = re.compile(
    rf'(below |[<>≤≥] ?)?[-−+±(]?\d[\d.e+−±\-/…%() ]*|{NOT_DETERMINED}|not determined|nothing|[-−]?inf|nan'
)


class Table(NamedTuple):
    """A table, all text.

    Attributes:
        heading: one word or phrase per column.
        units: of the columns, empty where there is none; () where no column has one.
        rows: one cell per column; in a row with fewer cells the last one extends over the columns that remain.
        title: above it; empty for none.
        levels: of each row ``good``, ``caution``, ``bad``, ``faint`` or nothing; the colour on a page. Empty if no
            row has one.
    """

    heading: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    title: str = ''
    levels: tuple[str, ...] = ()

    def is_number(self, column: int) -> bool:
        """Whether a column holds numbers only; these are set to the right."""
        cells = [row[column] for row in self.rows if self._is_single(row, column) and row[column]]
        return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)

    def lines(self) -> list[str]:
        """The table as aligned lines: heading, units if there are any, rows.

        Text is set to the left, numbers to the right, a value with its standard deviation at the ±.
        """
        above = (line for line in (self.heading, self.units) if any(line))
        lines = [list(line) for line in (*above, *self.rows)]
        for column in range(len(self.heading)):
            own = [line for line in lines if self._is_single(line, column)]
            for line, cell in zip(own, _padded([line[column] for line in own], self.is_number(column)), strict=True):
                line[column] = cell
        return ['  '.join(line).rstrip() for line in lines]

    def text(self) -> str:
        """The same lines as one text."""
        return '\n'.join(self.lines())

    def _is_single(self, row: tuple[str, ...] | list[str], column: int) -> bool:
        """Whether a row has a cell for this column alone."""
        return column < len(row) - (len(row) < len(self.heading))


def _padded(cells: list[str], number: bool) -> list[str]:
    """The cells of one column at equal width."""
    if number and any(' ± ' in cell for cell in cells):
        parts = [cell.partition(' ± ') for cell in cells]
        before = max(len(value) for value, _, _ in parts)
        cells = [f'{value:>{before}}{sign}{std}' for value, sign, std in parts]
        number = False
    width = max((len(cell) for cell in cells), default=0)
    return [cell.rjust(width) if number else cell.ljust(width) for cell in cells]


Level = Literal['', 'good', 'caution', 'bad']
"""How an answer is marked on a page."""


class Note(NamedTuple):
    """A remark in small print, such as how a table is to be read; on the page alone."""

    text: str


class Items(NamedTuple):
    """Lines of a list, below a sentence that leads to it."""

    lines: tuple[str, ...]
    lead: str = ''


class Fact(NamedTuple):
    """One of the few numbers that matter most: what it is, the number with its unit, a remark."""

    title: str
    value: str
    unit: str = ''
    remark: str = ''


class Facts(NamedTuple):
    """Numbers side by side."""

    facts: tuple[Fact, ...]


class Figure(NamedTuple):
    """A picture, on the page alone.

    Attributes:
        draw: gives the SVG element (`figure.as_svg`); called once, while the page is made.
        caption: below it.
        title: above it.
    """

    draw: Callable[[], Markup]
    caption: str = ''
    title: str = ''


class Figures(NamedTuple):
    """Pictures side by side, with one caption for all."""

    figures: tuple[Figure, ...]
    caption: str = ''


class Legend(NamedTuple):
    """Signs of figures with their colours and what they mean; on the page alone."""

    entries: tuple[tuple[str, str, str], ...]


class Verdict(NamedTuple):
    """An answer in one line, the sentences that support it, and what to do."""

    headline: str
    level: Level = ''
    sentences: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        title: empty for none.
        blocks: what it holds; of sections within a section the titles are smaller.
        shown: on the terminal and on the page, or on one of them alone.
        folded: on the screen its title alone is shown until it is opened; on paper it is open.
    """

    title: str
    blocks: tuple[Block, ...]
    shown: Literal['both', 'page', 'terminal'] = 'both'
    folded: bool = False


Block = str | Note | Items | Facts | Figure | Figures | Legend | Table | Verdict | Section  # a `str` is a paragraph


@dataclass(frozen=True)
class Report:
    """A result, ready to be shown.

    Attributes:
        title: what was done; the heading of the page.
        answer: the first thing that is read.
        blocks: all else, in the order in which it is read.
        source: from which files.
        head: what else is known of the circumstances, name and value.
        remarks: on the input, one sentence each.
        footer: last line of the page, such as where all numbers are.
    """

    title: str
    answer: Verdict
    blocks: tuple[Block, ...] = ()
    source: str = ''
    head: tuple[tuple[str, str], ...] = ()
    remarks: tuple[str, ...] = ()
    footer: str = ''


_WIDTH = 100
"""Of a line, characters; tables are as wide as they need."""


def as_text(report: Report) -> str:
    """The report as text, without figures and notes; a part begins after an empty line."""
    parts = [_verdict(report.answer), *_parts(report.blocks)]
    if report.remarks:
        parts.append(wrapped((f'note: {remark}' for remark in report.remarks), ''))
    return '\n\n'.join('\n'.join(lines) for lines in parts if lines) + '\n'


def wrapped(sentences: Iterable[str], indent: str) -> list[str]:
    """Lines of sentences, each on lines of its own; of one that is long all but the first are indented."""
    lines = []
    for text in sentences:
        lines += textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent + '  ')
    return lines


def _parts(blocks: Iterable[Block]) -> list[list[str]]:
    """The lines of each part; sentences that follow one another, and a title and what it stands over, are one."""
    parts: list[list[str]] = []
    present = [block for block in blocks if isinstance(block, Section) or _lines(block)]
    for are_sentences, group in groupby(present, lambda block: isinstance(block, str)):
        if are_sentences:
            parts.append([line for block in group for line in _lines(block)])
            continue
        for block in group:
            if isinstance(block, Section):
                inner = [] if block.shown == 'page' else _parts(block.blocks)
                if inner and block.title:
                    inner[0] = [*wrapped([block.title], ''), *inner[0]]
                parts += inner
            else:
                parts.append(_lines(block))
    return parts


def _lines(block: Block) -> list[str]:
    """Nothing for what is on the page alone."""
    if isinstance(block, str):
        return wrapped([block], '')
    if isinstance(block, Table):
        return [*wrapped([block.title], '')] * bool(block.title) + block.lines()
    if isinstance(block, Items):
        return [*wrapped([block.lead], ''), *wrapped((f'- {line}' for line in block.lines), '  ')]
    if isinstance(block, Verdict):
        return _verdict(block)
    return _facts(block) if isinstance(block, Facts) else []


def _verdict(verdict: Verdict) -> list[str]:
    actions = (f'To do: {action}.' for action in verdict.actions)
    return [*wrapped([verdict.headline], ''), *wrapped((*verdict.sentences, *actions), '  ')]


def _facts(block: Facts) -> list[str]:
    lines = []
    indent = 2 + max(len(fact.title) for fact in block.facts)
    for fact in block.facts:
        text = f'{fact.value} {fact.unit}'.strip() + (f'; {fact.remark}' if fact.remark else '')
        lines += textwrap.wrap(text, _WIDTH, initial_indent=fact.title.ljust(indent), subsequent_indent=' ' * indent)
    return lines


def sentence(text: str) -> str:
    """The text with a capital, unless it starts with a name, and a full stop."""
    text = text.strip()
    first = text.split(' ', 1)[0]
    if first.isalpha() and first.islower():
        text = text[0].upper() + text[1:]
    return text if text.endswith('.') else f'{text}.'


def drawn(block: Block) -> Block:
    """The same with its figures drawn, so that another process can show it."""
    from scara_kinetostatic.report.figure import style

    if isinstance(block, Section):
        return replace(block, blocks=tuple(map(drawn, block.blocks)))
    with style():
        return block._replace(draw=partial(Markup, block.draw())) if isinstance(block, Figure) else block


def as_page(report: Report) -> str:
    """The page, with all figures drawn."""
    from scara_kinetostatic.files.atomic import render
    from scara_kinetostatic.report.figure import style

    template = Path(__file__).with_name('report.html.j2')
    css = Markup(template.with_name('page.css').read_text(encoding='utf-8'))
    with style():
        return render(template, report=report, version=__version__, as_sentence=sentence, css=css)


Document = dict[str, Any]
"""Values by key: whatever `plain` takes."""
_JSON_WIDTH = 160
"""Of a line, characters."""
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def json_text(document: Document) -> str:
    """The document as JSON that every reader accepts (`plain`), short lists and objects on one line.

    Raises:
        TypeError: a value in it has no form in JSON.
    """
    return _forms(plain(document), '')[1] + '\n'


def plain(value: Any) -> Any:
    """Plain JSON values: dataclasses and named tuples become objects, arrays lists, enums their values, times UTC.

    A number that is not finite becomes None.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Enum):
        return plain(value.value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple) and hasattr(value, '_fields'):
        return {name: plain(item) for name, item in zip(value._fields, value, strict=True)}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, datetime):
        return utc(value)
    raise TypeError(f'{type(value).__name__} has no form in JSON')


def utc(time: datetime) -> str:
    """A date and time in UTC: ``2026-11-21T14:03:22Z``."""
    return time.astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')


def _forms(value: Any, indent: str) -> tuple[str, str]:
    """A value on one line, and as it is written: on one line what fits there, and every list of numbers."""
    if not isinstance(value, (dict, list)) or not value:
        return (flat := _ENCODER.encode(value)), flat
    if isinstance(value, list) and all(isinstance(item, (int, float)) for item in value):
        return (flat := _ENCODER.encode(value)), flat
    opening, closing = '{}' if isinstance(value, dict) else '[]'
    keys = [f'{_ENCODER.encode(key)}: ' for key in value] if isinstance(value, dict) else [''] * len(value)
    deeper, items = indent + '  ', value.values() if isinstance(value, dict) else value
    flats, written = zip(*(_forms(item, deeper) for item in items), strict=True)
    flat = opening + ', '.join(map(add, keys, flats)) + closing
    if indent and len(indent) + len(flat) <= _JSON_WIDTH:
        return flat, flat
    return flat, f'{opening}\n{deeper}' + f',\n{deeper}'.join(map(add, keys, written)) + f'\n{indent}{closing}'
