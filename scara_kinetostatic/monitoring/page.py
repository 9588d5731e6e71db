"""Pages of monitoring: parts with a verdict, figures and tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.monitoring.hypotheses import Explanation
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.render.table import NOT_DETERMINED, Table

_TEMPLATE = Path(__file__).with_name('page.html.j2')
LEVELS = {'fit': 'good', 'caution': 'caution', 'unfit': 'bad'}
"""Colour of a verdict by grade."""
_SHOWN = 8
"""So many hypotheses are listed."""


class Part(NamedTuple):
    """A section of a page.

    Attributes:
        heading: empty for none.
        verdict: one line; empty for none.
        level: ``good``, ``caution`` or ``bad``.
        sentences: below the verdict.
        tables: heading, table, note of each.
        figures: with their captions.
    """

    heading: str = ''
    verdict: str = ''
    level: str = 'good'
    sentences: tuple[str, ...] = ()
    tables: tuple[tuple[str, Table, str], ...] = ()
    figures: tuple[tuple[Markup, str], ...] = ()


def html_page(title: str, source: str, parts: Sequence[Part], json_name: str) -> str:
    """One self-contained page.

    Args:
        title: its heading.
        source: below it, the files.
        parts: its sections.
        json_name: of the file with all numbers.
    """
    template = page_template(_TEMPLATE)
    return template.render(version=__version__, title=title, source=source, parts=parts, json_name=json_name)


def explanation_table(ranking: Sequence[Explanation], rivals: Sequence[str]) -> Table:
    """The hypotheses of what changed, the best first."""
    rows = []
    for number, item in enumerate(ranking[:_SHOWN]):
        remark = 'best' if number == 0 else 'rival' if item.name in rivals else ''
        rows.append((item.hypothesis.title, f'{item.statistic:.1f}', str(len(item.change)), item.text, remark))
    return Table(('what changed', 'explains', 'values', 'by', ''), ('', 'chi-square', '', '', ''), tuple(rows))


def number(value: float, digits: str) -> str:
    """A number as text, a dash where there is none."""
    return format(value, digits) if value == value else NOT_DETERMINED
