"""The picture of the cell: discs, arm, touches, forces."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle
from numpy.typing import NDArray

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.render.figure import FAINT, INK, LINE, PAPER, WARN, Margins, as_svg, mark, new_figure

Floats = NDArray[np.float64]

_WIDTH = 920.0
_LONGEST_ARROW = 0.14
"""Of the largest force, as a part of the arm's length."""


def cell_picture(c: Calibration) -> Markup:
    """The cell from above, in the base frame."""
    tip, elbow, base = _arm(c)
    arm = c.parameters.l1 + c.parameters.l2
    low, high = _extent(c, tip, elbow, base, arm)
    height = _WIDTH * float(np.clip((high[1] - low[1]) / (high[0] - low[0]), 0.3, 1.0))
    figure, (axes,) = new_figure(_WIDTH, height, margins=Margins())
    _draw_discs(axes, c)
    _draw_arms(axes, c, tip, elbow, base, arm)
    _draw_touches(axes, c, tip, arm)
    axes.set(xlabel='x  [m]', ylabel='y  [m]', aspect='equal')
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    return as_svg(figure, 'cell', 'the cell from above with its discs, the arm and the touches')


def _arm(c: Calibration) -> tuple[Floats, Floats, Floats]:
    """Tip and elbow at each touch, (n, 2), and the base, (2,), without deflections."""
    p, q = c.parameters, c.touches.joints
    base = np.array([p.x0, p.y0])
    angle = q[:, 0] + p.theta1
    elbow = base + p.l1 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return forward(p, q), elbow, base


def _extent(c: Calibration, tip: Floats, elbow: Floats, base: Floats, arm: float) -> tuple[Floats, Floats]:
    reach = c.cell.radii[:, None]
    everything = [c.cell.centers - reach, c.cell.centers + reach, tip, elbow, base[None]]
    points = np.concatenate(everything)
    margin = _LONGEST_ARROW * arm * 1.05
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _draw_discs(axes: Axes, c: Calibration) -> None:
    for number, disc in enumerate(c.cell.discs):
        colour = mark(number).colour
        axes.add_patch(Circle((disc.x, disc.y), disc.radius, facecolor=colour, alpha=0.13, lw=0))
        axes.add_patch(Circle((disc.x, disc.y), disc.radius, fill=False, edgecolor=colour, lw=1.2))
        text = axes.text(disc.x, disc.y, disc.name, ha='center', va='center', color=INK)
        text.set_parse_math(False)


def _draw_arms(axes: Axes, c: Calibration, tip: Floats, elbow: Floats, base: Floats, arm: float) -> None:
    """All arms as a faint trace, one of each posture in full, in front of the farthest disc, where it covers least."""
    touched = np.unique(c.touches.disc)
    farthest = touched[np.argmax(np.linalg.norm(c.cell.centers[touched] - base, axis=1))]
    lines = np.stack([np.broadcast_to(base, tip.shape), elbow, tip], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=FAINT, linewidths=0.6, alpha=0.16))
    for posture, dashes in ((1, 'solid'), (-1, (0, (5, 2.5)))):
        members = np.flatnonzero((c.touches.posture == posture) & (c.touches.disc == farthest))
        if len(members):
            nearest = members[np.argmin(np.linalg.norm(tip[members] - base, axis=1))]
            x, y = lines[nearest].T
            axes.plot(x, y, color=INK, lw=2.2, ls=dashes, solid_capstyle='round', dash_capstyle='round')
            axes.plot(x[1], y[1], 'o', ms=6.5, mfc=PAPER, mec=INK, mew=1.4)
    axes.add_patch(Circle((base[0], base[1]), 0.022 * arm, facecolor=PAPER, edgecolor=INK, lw=1.6, zorder=4))
    axes.add_patch(Circle((base[0], base[1]), 0.006 * arm, facecolor=INK, lw=0, zorder=5))
    axes.annotate('base', (base[0], base[1]), (11, 8), textcoords='offset points', color=FAINT)
    axes.axhline(base[1], color=LINE, lw=0.7, zorder=0)


def _draw_touches(axes: Axes, c: Calibration, tip: Floats, arm: float) -> None:
    """An arrow per touch, head at the contact, length as the force."""
    magnitude = np.hypot(c.force[:, 0], c.force[:, 1])
    along = c.force / np.maximum(magnitude, 1e-9)[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=-1) * c.touches.posture[:, None] * 0.004 * arm
    head = tip + aside
    tail = head - _LONGEST_ARROW * arm * c.force / max(float(magnitude.max()), 1e-9)
    for number in range(len(c.cell.discs)):
        for posture in (1, -1):
            chosen = (c.touches.disc == number) & (c.touches.posture == posture) & c.used
            shaft = np.stack([tail[chosen], head[chosen]], axis=1)
            look = mark(number)
            axes.add_collection(LineCollection(list(shaft), colors=look.colour, linewidths=1.0, alpha=0.55))
            fill = look.colour if posture > 0 else PAPER
            x, y = head[chosen].T
            axes.plot(x, y, look.shape, ls='none', ms=4.6, mfc=fill, mec=look.colour, mew=1.1, zorder=3)
    for k in np.flatnonzero(~c.used):
        axes.plot(*tip[k], 'X', ms=9, mfc=WARN, mec=PAPER, zorder=6)
        axes.annotate(str(c.touches.index[k]), (tip[k, 0], tip[k, 1]), (7, -4), textcoords='offset points', color=WARN)
