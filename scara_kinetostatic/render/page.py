"""Self-contained HTML pages from templates that escape whatever the inputs hold."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import jinja2

STYLESHEET = Path(__file__).parent / 'page.css'
"""Of every page; its variables are the colours of the figures."""


@cache
def page_template(path: Path) -> jinja2.Template:
    """The template of a page; it may include files beside it, and the stylesheet.

    Args:
        path: the template.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([path.parent, STYLESHEET.parent]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(path.name)
