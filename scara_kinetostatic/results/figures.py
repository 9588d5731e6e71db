"""Figures of the report: the cell, the residuals, what the touches show of an effect."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.comparison import EffectResidual
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.report.figure import (
    FAINT,
    INK,
    LINE,
    PAPER,
    WARN,
    Margins,
    as_svg,
    draw_object,
    in_mm,
    mark,
    new_figure,
)

_WIDTH = 920.0
_LONGEST_ARROW = 0.14
"""Of the largest force, as a part of the arm's length."""
_FEW = 6
"""A variable with so few values is a category: its touches are drawn side by side."""


def cell_picture(c: Calibration) -> Markup:
    """The cell from above, in the base frame."""
    p, arm, reach = c.parameters, c.parameters.l1 + c.parameters.l2, c.cell.radii[:, None]
    base = np.array([p.x0, p.y0])
    angle = c.touches.joints[:, 0] + p.theta1
    tip, elbow = forward(p, c.touches.joints), base + p.l1 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    points = np.concatenate([c.cell.centers - reach, c.cell.centers + reach, tip, elbow, base[None]])
    margin = _LONGEST_ARROW * arm * 1.05
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    height = _WIDTH * float(np.clip((high[1] - low[1]) / (high[0] - low[0]), 0.3, 1.0))
    figure, (axes,) = new_figure(_WIDTH, height, margins=Margins())
    for number, disc in enumerate(c.cell.discs):
        draw_object(axes, disc, mark(number).colour, filled=True)
        text = axes.text(disc.x, disc.y, disc.name, ha='center', va='center', color=INK)
        text.set_parse_math(False)
    _draw_arms(axes, c, tip, elbow, base, arm)
    _draw_touches(axes, c, tip, arm)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal')
    in_mm(axes)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return as_svg(figure, 'cell', 'the cell from above with its discs, the arm and the touches')


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
    axes.annotate('base', (base[0], base[1]), (11, -18), textcoords='offset points', color=FAINT)
    axes.axhline(base[1], color=LINE, lw=0.7, zorder=0)


def _draw_touches(axes: Axes, c: Calibration, tip: Floats, arm: float) -> None:
    """An arrow per touch, head at the contact, length as the force."""
    magnitude = np.hypot(c.force[:, 0], c.force[:, 1])
    along = c.force / np.maximum(magnitude, 1e-9)[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=-1) * c.touches.posture[:, None] * 0.004 * arm
    head = tip + aside
    tail = head - _LONGEST_ARROW * arm * c.force / max(float(magnitude.max()), 1e-9)
    disc, posture = c.touches.disc[c.used], c.touches.posture[c.used]
    shafts = np.stack([tail, head], axis=1)[c.used]
    colours = [mark(number).colour for number in disc.tolist()]
    axes.add_collection(LineCollection(list(shafts), colors=colours, linewidths=1.0, alpha=0.55))
    _draw_marks(axes, disc, posture, head[c.used], 4.6)
    for k in np.flatnonzero(~c.used):
        axes.plot(*tip[k], 'X', ms=9, mfc=WARN, mec=PAPER, zorder=6)
        axes.annotate(str(c.touches.index[k]), (tip[k, 0], tip[k, 1]), (7, -4), textcoords='offset points', color=WARN)


def residual_picture(c: Calibration) -> Markup:
    """The parts of the calibrated residual along and across the force, per touch."""
    along = c.force / np.maximum(np.hypot(c.force[:, 0], c.force[:, 1]), 1e-9)[:, None]
    parts = (
        ('along the force  [N]', (c.residual * along).sum(axis=1)),
        ('across it  [N]', c.residual[:, 1] * along[:, 0] - c.residual[:, 0] * along[:, 1]),
    )
    figure, (first, second) = new_figure(_WIDTH, 380, rows=2, margins=Margins(), sharex=True)
    t, used = c.touches, c.used
    for axes, (label, values) in zip((first, second), parts, strict=True):
        largest = 1.25 * float(np.abs(values[used]).max(initial=1e-6))
        axes.axhline(0, color=FAINT, lw=0.9)
        places = np.stack([t.index, np.clip(values, -0.94 * largest, 0.94 * largest)], axis=-1)
        _draw_marks(axes, t.disc[used], t.posture[used], places[used], 5)
        axes.plot(*places[~used].T, 'X', ls='none', ms=8, mfc=WARN, mec=PAPER)
        axes.set(ylabel=label, ylim=(-largest, largest))
        axes.grid(visible=False, axis='x')
    second.set(xlabel='touch')
    second.margins(x=0.015)
    figure.align_ylabels()
    return as_svg(figure, 'residuals', 'residual force of each touch along and across the force')


def _draw_marks(axes: Axes, disc: Indices, posture: Indices, places: Floats, size: float) -> None:
    """Touches at places (n, 2) by disc (colour and shape) and posture (full: left, hollow: right)."""
    for number in np.unique(disc).tolist():
        look = mark(number)
        for side, fill in ((1, look.colour), (-1, PAPER)):
            x, y = places[(disc == number) & (posture == side)].T
            axes.plot(x, y, look.shape, ls='none', ms=size, mfc=fill, mec=look.colour, mew=1.1, zorder=3)


def effect_picture(found: EffectResidual, name: str, titles: tuple[str, str] = ('without it', 'with it')) -> Markup:
    """The deviation by an effect, estimated from each touch, without it in the model and with it, on the same axes."""
    figure, axes = new_figure(_WIDTH, 340, columns=2, sharey=True, sharex=True)
    x = _side_by_side(found.x)
    kinds = len(x) > 0 and len(np.unique(found.x)) <= _FEW
    size = np.abs(np.concatenate([found.before, found.after, found.expected, [0.0] * (not len(found.x))]))
    # 0.97: this part of the touches lies within the scale, so that single outliers do not change it
    largest = max(1.1 * min(float(size.max()), 1.6 * float(np.quantile(size, 0.97))), 1e-9)
    sides = ((found.before, found.std_before), (found.after, found.std_after))
    for one, (deviation, std), title in zip(axes, sides, titles, strict=True):
        values = np.clip(deviation, -0.97 * largest, 0.97 * largest)
        one.axhline(0, color=FAINT, lw=0.9)
        one.vlines(x, values - std, values + std, color=LINE, lw=1.0, zorder=1)
        _draw_marks(one, found.disc, found.posture, np.stack([x, values], axis=-1), 4.4)
        one.set(title=title, xlabel=found.x_label, ylim=(-largest, largest))
        one.grid(visible=False, axis='x')
        if kinds:
            one.set_xticks(np.unique(found.x))
        else:
            one.xaxis.set_major_locator(MaxNLocator(7))
    if found.expected.any():  # an effect that only scatters leaves no pattern
        axes[0].plot(x, found.expected, '_', ms=8, mew=1.6, color=INK, zorder=4)
    axes[0].set(ylabel=found.y_label)
    return as_svg(figure, name, 'deviation by the effect, estimated from each touch, without it and with it')


def _side_by_side(x: Floats) -> Floats:
    """Values of which there are few, spread out in the order of the touches."""
    kinds, which = np.unique(x, return_inverse=True)
    if len(kinds) > _FEW:
        return x
    apart = float(np.diff(kinds).min()) if len(kinds) > 1 else 1.0
    out = x.copy()
    for number in range(len(kinds)):
        members = np.flatnonzero(which == number)
        # 0.3: how far aside, as a part of the distance between categories
        out[members] += apart * 0.3 * np.linspace(-1, 1, len(members) + 2)[1:-1]
    return np.asarray(out)
