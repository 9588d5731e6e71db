"""Pictures of a page as files of their own, with the colours of the light page."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from markupsafe import Markup

from scara_kinetostatic import report
from scara_kinetostatic.report.figure import COLOURS

_FONT = 'system-ui, -apple-system, Segoe UI, Noto Sans, DejaVu Sans, sans-serif'


@cache
def light_colours() -> dict[str, str]:
    """Colour of the light page by stand-in, for figures outside a page; hexadecimal."""
    css = (Path(report.__file__).parent / 'page.css').read_text(encoding='utf-8')
    colours = dict(re.findall(r'(--[\w-]+):\s*(#[0-9a-fA-F]+)', css[: css.index('@media')]))
    return {stand_in: colours[variable[4:-1]] for stand_in, variable in COLOURS.items()}


def svg_file(picture: Markup) -> str:
    """The text of an SVG file: the colours of the light page and its type written in, on white."""
    text = str(picture)
    for stand_in, colour in light_colours().items():
        text = text.replace(COLOURS[stand_in], colour)
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text)
    assert box is not None
    head, rest = text.split('>', 1)
    if 'xmlns=' not in head:
        names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        head = head.replace('<svg', f'<svg {names}')
    head += f' width="{box[1]}" height="{box[2]}" font-family="{_FONT}"'
    return f'{head}><rect width="100%" height="100%" fill="#ffffff"/>{rest}\n'
