"""What a report holds: an answer in one line, sentences, tables and figures, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from markupsafe import Markup

from scara_kinetostatic.report.table import Table

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
