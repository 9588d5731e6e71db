"""Self-contained HTML pages from templates; every value is escaped."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import jinja2

from scara_kinetostatic.render.figure import STYLESHEET


@cache
def page_template(path: Path) -> jinja2.Template:
    """The template of a page; it may include files beside it, the stylesheet and the macro `show_table`.

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
