"""Files of a fixed form, from Jinja templates beside the code that fills them in."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def render(path: Path, *, escape: bool = True, **values: Any) -> str:
    """The text of a template with its values; one that is missing is an error.

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
