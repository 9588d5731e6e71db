"""Names from files as data in every text that another program reads: one function for each kind of place, and `render`.

HTML, SVG and the attributes and text of XML are escaped by Jinja's autoescape and by Matplotlib, YAML and JSON by
their libraries; names on markers are not interpreted. A name is printable and no formula (`Section.word`).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from scara_kinetostatic.errors import one_line

FORMULA = ('=', '+', '-', '@', '\t', '\r')
"""A cell that begins so is a formula to a spreadsheet."""


def comment(line: str) -> str:
    """A line that begins or ends no comment of XML or C, has no trigraph, and in CSV no cell that is a formula."""
    line = re.sub('-(?=-|$)', '- ', one_line(line))
    line = re.sub(r'(?<=/)(?=\*)|(?<=\*)(?=/)|(?<=\?)(?=\?)', ' ', line)
    return re.sub('([,;])(?=[-=+@])', r'\1 ', line)


def xacro(text: str) -> str:
    """A text in which xacro evaluates nothing but the dollar signs themselves."""
    return text.replace('$', "${'$'}")


def csv_cell(text: str) -> str:
    """A cell of text: in quotes where it needs them, and with an apostrophe before what would be a formula."""
    if any(part.startswith(FORMULA) for part in (text, text.lstrip())) and not re.fullmatch(
        r'[-+]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eE][-+]?[0-9]+)?|-?(inf|nan)', text.strip()
    ):
        text = "'" + text
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',;"\r\n\t#') else text


def render(path: Path, *, escape: bool = True, **values: Any) -> str:
    """The text of a Jinja template with its values; one that is missing is an error.

    Args:
        path: the template; it may include others of its folder.
        escape: whether values are escaped as HTML and XML need it.
        values: by name.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(path.parent),
        autoescape=escape,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(path.name).render(**values)
