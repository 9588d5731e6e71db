"""A report for a terminal, and as one self-contained HTML page in which every value is escaped."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.content import Block, Facts, Items, Report, Section, Verdict
from scara_kinetostatic.report.table import Table

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


_UNIT = (
    r'(?<=\d) (?=(?:mm|µm|m|N|Nm|rad|mrad|µrad|°|σ|%)[\s,;.:)<])'
    r'|(?<=±) (?=\d)|(?<=\b[kp]) (?=(?:=|&lt;) )|(?<=[kp] =) (?=\d)|(?<=p &lt;) (?=\d)'
)
"""The blank between them, and those of ``± 2``, ``k = 2`` and ``p < 0.01``."""


def as_page(report: Report) -> str:
    """The page, with all figures drawn."""
    from scara_kinetostatic.report.figure import style

    with style():
        page = _template().render(report=report, version=__version__)
    return re.sub(_UNIT, '\u00a0', page)  # a number and its unit stay on one line


@cache
def _template() -> Any:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters['sentence'] = sentence
    environment.filters['kind'] = lambda block: type(block).__name__
    return environment.get_template('report.html.j2')
