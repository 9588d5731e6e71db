"""Markers as a picture, from above, for pages that RViz cannot be in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from scara_kinetostatic.report.figure import Margins, as_svg, new_figure
from scara_kinetostatic.report.markers import Primitive

_WIDTH = 920.0
_MARGIN = 0.02
"""Around everything, m."""


def marker_picture(scene: Sequence[Primitive]) -> Markup:
    """All primitives in the plane, in the order of their height; sizes as they are in RViz."""
    ordered = sorted(scene, key=lambda item: item.points[0][2])
    low, high = _extent(ordered)
    height = _WIDTH * float((high - low)[1] / (high - low)[0])
    figure, (axes,) = new_figure(_WIDTH, height, margins=Margins(0, 0, 0, 0))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    scale = _WIDTH / float((high - low)[0])
    for order, primitive in enumerate(ordered):
        _draw(axes, primitive, scale, order)
    return as_svg(figure, 'markers', 'the markers of the visualizer from above')


def _extent(scene: Sequence[Primitive]) -> tuple[np.ndarray, np.ndarray]:
    """Lower left and upper right corner of everything."""
    low, high = [], []
    for item in scene:
        points = np.array(item.points)[:, :2]
        half = np.full(2, item.size / 2)
        if item.shape == 'text':
            half[0] *= 0.6 * len(item.text)
        low.append(points.min(axis=0) - half)
        high.append(points.max(axis=0) + half)
    return np.min(low, axis=0) - _MARGIN, np.max(high, axis=0) + _MARGIN


def _draw(axes: Axes, item: Primitive, scale: float, order: int) -> None:
    """One primitive; `scale` is pixels per metre."""
    x, y = np.array(item.points)[:, :2].T
    colour = item.colour
    if item.shape in ('cylinder', 'dot'):
        axes.add_patch(Circle((x[0], y[0]), item.size / 2, facecolor=colour, lw=0, zorder=order))
    elif item.shape == 'strip':
        axes.plot(x, y, color=colour, lw=item.size * scale, solid_capstyle='round', zorder=order)
    elif item.shape == 'text':
        size = item.size * scale
        text = axes.text(x[0], y[0], item.text, ha='center', va='center', color=colour, fontsize=size, zorder=order)
        text.set_parse_math(False)
    else:
        width = item.size
        axes.arrow(
            x[0], y[0], x[1] - x[0], y[1] - y[0], width=width, head_width=3 * width, head_length=4 * width,
            length_includes_head=True, facecolor=colour, lw=0, zorder=order,
        )  # fmt: skip
