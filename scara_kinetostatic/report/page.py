"""A report as one self-contained HTML page; every value is escaped."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from scara_kinetostatic import __version__
from scara_kinetostatic.report.content import Report
from scara_kinetostatic.report.text import sentence

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
