"""Figures as SVG with the colours and the font of the page around them.

A figure is drawn in stand-in colours; in the SVG they become CSS variables, so that one picture serves a light and
a dark page. Sizes are pixels of the page. Nothing goes through pyplot: figures may be drawn in any thread.
"""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from scara_kinetostatic.model.parameters import IN_MICRO as IN_MICRO

INK, FAINT, LINE, PAPER, WARN = '#010203', '#040506', '#070809', '#0a0b0c', '#0d0e0f'
SERIES = ('#100001', '#100002', '#100003', '#100004', '#100005', '#100006')
"""Stand-ins of the six colours of the discs (Okabe and Ito's, safe for the colour-blind)."""
COLOURS = {
    **{INK: 'var(--ink)', FAINT: 'var(--faint)', LINE: 'var(--line)', PAPER: 'var(--paper)', WARN: 'var(--warn)'},
    **{stand_in: f'var(--c{number})' for number, stand_in in enumerate(SERIES, 1)},
}
THIN, THICK = 0.7, 2.0
"""Widths of lines beside the usual one, pixels."""
_PER_INCH = 72.0
_STYLE: dict[Any, Any] = {
    **dict.fromkeys(('text.color', 'axes.labelcolor'), INK),
    **dict.fromkeys(('axes.edgecolor', 'grid.color', 'xtick.color', 'ytick.color'), LINE),
    **dict.fromkeys(('xtick.labelcolor', 'ytick.labelcolor'), FAINT),
    **dict.fromkeys(('axes.facecolor', 'figure.facecolor', 'svg.fonttype'), 'none'),
    **dict.fromkeys(('axes.spines.top', 'axes.spines.right', 'axes.formatter.useoffset'), False),
    **dict.fromkeys(('axes.grid', 'axes.axisbelow'), True),
    **dict.fromkeys(('font.size', 'axes.titlesize'), 12.5),
    **dict.fromkeys(('xtick.labelsize', 'ytick.labelsize'), 11.5),
    'font.family': ['DejaVu Sans'],
    'axes.titlelocation': 'left',
    'axes.titley': 1.0,
    'grid.linewidth': THIN,
    **dict.fromkeys(('lines.linewidth', 'lines.markeredgewidth', 'patch.linewidth'), 1.2),
}


class Mark(NamedTuple):
    """The mark of the touches of one disc: a colour and, for the colour-blind, a shape."""

    colour: str
    shape: str
    sign: str


def mark(disc: int) -> Mark:
    """The mark of a disc by its number in the cell."""
    turn, place = divmod(disc, len(SERIES))
    shape, sign = (('o', '●'), ('s', '■'), ('^', '▲'), ('D', '◆'), ('v', '▼'), ('p', '⬟'))[(place + turn) % len(SERIES)]
    return Mark(SERIES[place], shape, sign)


@contextmanager
def style() -> Iterator[None]:
    """The context in which figures are drawn; the user's matplotlibrc has no influence."""
    logging.getLogger('matplotlib.font_manager').setLevel(logging.ERROR)
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


class Margins(NamedTuple):
    """Margins around the axes, pixels."""

    left: float = 66.0
    right: float = 10.0
    bottom: float = 48.0
    top: float = 10.0


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1, margins: Margins | None = None, **more: Any
) -> tuple[Figure, list[Axes]]:
    """An empty figure with a grid of axes, listed row by row.

    Args:
        width: of the figure, pixels.
        height: of it, pixels.
        rows: of axes.
        columns: of axes.
        margins: around all axes; None to compute them, which takes as long as drawing the figure.
        more: for `Figure.subplots`.
    """
    layout: Any = None if margins else 'constrained'
    figure = Figure(figsize=(width / _PER_INCH, height / _PER_INCH), dpi=_PER_INCH, layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False, **more)
    if margins:
        figure.subplots_adjust(
            left=margins.left / width,
            right=1 - margins.right / width,
            bottom=margins.bottom / height,
            top=1 - margins.top / height,
            hspace=0.12,
        )
    return figure, list(axes.ravel())


def as_svg(figure: Figure, name: str, description: str) -> Markup:
    """The figure as an SVG element.

    Args:
        figure: what to draw.
        name: makes its identifiers unique on the page.
        description: text for screen readers; it is not escaped, so nothing from the input.
    """
    stream = io.StringIO()
    canvas: Any = FigureCanvasSVG(figure)
    with mpl.rc_context({'svg.hashsalt': name}), warnings.catch_warnings():
        warnings.filterwarnings('ignore', message='Glyph')  # the page has its own font
        canvas.print_svg(stream, metadata={'Date': None, 'Creator': None})
    svg = re.sub(r'<metadata>.*?</metadata>', '', stream.getvalue(), flags=re.DOTALL)
    numbered = 'figure|axes|patch|line2d|text|matplotlib.axis|xtick|ytick|legend|[a-z]*collection|quadcontourset|quiver'
    svg = re.sub(rf' id="(?:{numbered})_[^"]*"', '', svg, flags=re.IGNORECASE)
    head, rest = svg[svg.index('<svg') :].split('>', 1)
    box = re.search(r'viewBox="[^"]*"', head)
    width = figure.get_figwidth() * _PER_INCH
    size = f'style="max-width: {width:.0f}px; min-width: {0.68 * width:.0f}px"'  # where it is wider, it scrolls
    head = f'<svg {box.group() if box else ""} {size} role="img" aria-label="{description}"'
    svg = f'{head}>{rest}'
    for stand_in, variable in COLOURS.items():
        svg = svg.replace(stand_in, variable)
    return Markup(svg)
