"""Figures of the report: the cell, the residuals, what the touches show of an effect; maps of the tip's uncertainty.

A map is drawn for each elbow posture that was touched, over the grid of the uncertainty of the tip. Where the joint
angles of a place are outside the convex hull of those of the touches, the model is extrapolated: the map is faded.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Circle, Wedge
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED, UncertaintyMap
from scara_kinetostatic.diagnosis.comparison import EffectResidual
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.kinematics import forward, inverse
from scara_kinetostatic.report import Figure, Figures, Legend
from scara_kinetostatic.report import figure as draw
from scara_kinetostatic.report.quantities import micrometres

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
    figure, (axes,) = draw.new_figure(_WIDTH, height, margins=draw.Margins())
    _draw_discs(axes, c, filled=True)
    _draw_arms(axes, c, tip, elbow, base, arm)
    _draw_touches(axes, c, tip, arm)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal')
    draw.in_mm(axes)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return draw.as_svg(figure, 'cell', 'the cell from above with its discs, the arm and the touches')


def _draw_discs(axes: Axes, c: Calibration, *, filled: bool = False, order: float = 1.0) -> None:
    """The discs with their names."""
    for number, disc in enumerate(c.cell.discs):
        draw.draw_object(axes, disc, draw.mark(number).colour, filled=filled, order=order)
        text = axes.text(disc.x, disc.y, disc.name, ha='center', va='center', size='small', color=draw.INK, zorder=5)
        text.set(parse_math=False, clip_on=True)


def _draw_arms(axes: Axes, c: Calibration, tip: Floats, elbow: Floats, base: Floats, arm: float) -> None:
    """All arms as a faint trace, one of each posture in full, in front of the farthest disc, where it covers least."""
    touched = np.unique(c.touches.disc)
    farthest = touched[np.argmax(np.linalg.norm(c.cell.centers[touched] - base, axis=1))]
    lines = np.stack([np.broadcast_to(base, tip.shape), elbow, tip], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=draw.FAINT, linewidths=0.6, alpha=0.16))
    for posture, dashes in ((1, 'solid'), (-1, (0, (5, 2.5)))):
        members = np.flatnonzero((c.touches.posture == posture) & (c.touches.disc == farthest))
        if len(members):
            nearest = members[np.argmin(np.linalg.norm(tip[members] - base, axis=1))]
            x, y = lines[nearest].T
            axes.plot(x, y, color=draw.INK, lw=2.2, ls=dashes, solid_capstyle='round', dash_capstyle='round')
            axes.plot(x[1], y[1], 'o', ms=6.5, mfc=draw.PAPER, mec=draw.INK, mew=1.4)
    axes.add_patch(Circle((base[0], base[1]), 0.022 * arm, facecolor=draw.PAPER, edgecolor=draw.INK, lw=1.6, zorder=4))
    axes.add_patch(Circle((base[0], base[1]), 0.006 * arm, facecolor=draw.INK, lw=0, zorder=5))
    axes.annotate('base', (base[0], base[1]), (11, -18), textcoords='offset points', color=draw.FAINT)
    axes.axhline(base[1], color=draw.LINE, lw=0.7, zorder=0)


def _draw_touches(axes: Axes, c: Calibration, tip: Floats, arm: float) -> None:
    """An arrow per touch, head at the contact, length as the force."""
    magnitude = np.hypot(c.force[:, 0], c.force[:, 1])
    along = c.force / np.maximum(magnitude, 1e-9)[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=-1) * c.touches.posture[:, None] * 0.004 * arm
    head = tip + aside
    tail = head - _LONGEST_ARROW * arm * c.force / max(float(magnitude.max()), 1e-9)
    disc, posture = c.touches.disc[c.used], c.touches.posture[c.used]
    shafts = np.stack([tail, head], axis=1)[c.used]
    colours = [draw.mark(number).colour for number in disc.tolist()]
    axes.add_collection(LineCollection(list(shafts), colors=colours, linewidths=1.0, alpha=0.55))
    _draw_marks(axes, disc, posture, head[c.used], 4.6)
    for k in np.flatnonzero(~c.used):
        axes.plot(*tip[k], 'X', ms=9, mfc=draw.WARN, mec=draw.PAPER, zorder=6)
        axes.annotate(
            str(c.touches.index[k]), (tip[k, 0], tip[k, 1]), (7, -4), textcoords='offset points', color=draw.WARN
        )


def legend(c: Calibration) -> Legend:
    """Sign, colour and name of each disc that was touched."""
    looks = [(draw.mark(number), c.cell.discs[number].name) for number in sorted(set(c.touches.disc.tolist()))]
    unused = () if c.used.all() else (('✖', draw.COLOURS[draw.WARN], 'not used'),)
    discs = ((look.sign, draw.COLOURS[look.colour], name) for look, name in looks)
    return Legend((*discs, ('', 'inherit', 'filled: posture left, hollow: right'), *unused))


def residual_picture(c: Calibration) -> Markup:
    """The parts of the calibrated residual along and across the force, per touch."""
    along = c.force / np.maximum(np.hypot(c.force[:, 0], c.force[:, 1]), 1e-9)[:, None]
    parts = (
        ('along the force  [N]', (c.residual * along).sum(axis=1)),
        ('across it  [N]', c.residual[:, 1] * along[:, 0] - c.residual[:, 0] * along[:, 1]),
    )
    figure, (first, second) = draw.new_figure(_WIDTH, 380, rows=2, margins=draw.Margins(), sharex=True)
    t, used = c.touches, c.used
    for axes, (label, values) in zip((first, second), parts, strict=True):
        largest = 1.25 * float(np.abs(values[used]).max(initial=1e-6))
        axes.axhline(0, color=draw.FAINT, lw=0.9)
        places = np.stack([t.index, np.clip(values, -0.94 * largest, 0.94 * largest)], axis=-1)
        _draw_marks(axes, t.disc[used], t.posture[used], places[used], 5)
        axes.plot(*places[~used].T, 'X', ls='none', ms=8, mfc=draw.WARN, mec=draw.PAPER)
        axes.set(ylabel=label, ylim=(-largest, largest))
        axes.grid(visible=False, axis='x')
    second.set(xlabel='touch')
    second.margins(x=0.015)
    figure.align_ylabels()
    return draw.as_svg(figure, 'residuals', 'residual force of each touch along and across the force')


def _draw_marks(axes: Axes, disc: Indices, posture: Indices, places: Floats, size: float) -> None:
    """Touches at places (n, 2) by disc (colour and shape) and posture (full: left, hollow: right)."""
    for number in np.unique(disc).tolist():
        look = draw.mark(number)
        for side, fill in ((1, look.colour), (-1, draw.PAPER)):
            x, y = places[(disc == number) & (posture == side)].T
            axes.plot(x, y, look.shape, ls='none', ms=size, mfc=fill, mec=look.colour, mew=1.1, zorder=3)


def effect_picture(found: EffectResidual, name: str, titles: tuple[str, str] = ('without it', 'with it')) -> Markup:
    """The deviation by an effect, estimated from each touch, without it in the model and with it, on the same axes."""
    figure, axes = draw.new_figure(_WIDTH, 340, columns=2, sharey=True, sharex=True)
    x = _side_by_side(found.x)
    kinds = len(x) > 0 and len(np.unique(found.x)) <= _FEW
    size = np.abs(np.concatenate([found.before, found.after, found.expected, [0.0] * (not len(found.x))]))
    # 0.97: this part of the touches lies within the scale, so that single outliers do not change it
    largest = max(1.1 * min(float(size.max()), 1.6 * float(np.quantile(size, 0.97))), 1e-9)
    sides = ((found.before, found.std_before), (found.after, found.std_after))
    for one, (deviation, std), title in zip(axes, sides, titles, strict=True):
        values = np.clip(deviation, -0.97 * largest, 0.97 * largest)
        one.axhline(0, color=draw.FAINT, lw=0.9)
        one.vlines(x, values - std, values + std, color=draw.LINE, lw=1.0, zorder=1)
        _draw_marks(one, found.disc, found.posture, np.stack([x, values], axis=-1), 4.4)
        one.set(title=title, xlabel=found.x_label, ylim=(-largest, largest))
        one.grid(visible=False, axis='x')
        if kinds:
            one.set_xticks(np.unique(found.x))
        else:
            one.xaxis.set_major_locator(MaxNLocator(7))
    if found.expected.any():  # an effect that only scatters leaves no pattern
        axes[0].plot(x, found.expected, '_', ms=8, mew=1.6, color=draw.INK, zorder=4)
    axes[0].set(ylabel=found.y_label)
    return draw.as_svg(figure, name, 'deviation by the effect, estimated from each touch, without it and with it')


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


_FADED = 'Faded: extrapolated, the joint angles are not between those of the touches. Blank: the arm cannot be there.'


def uncertainty_figures(outcome: Outcome) -> Figures | None:
    """Maps of the expanded uncertainty of the tip; None where the data do not determine it."""
    c, tip = outcome.final, outcome.tip_uncertainty
    known = [each for each in tip.maps if np.isfinite(each.expanded).any()]
    parts = [
        f'Expanded uncertainty ({tip.coverage}) of the tip in the worst direction, without load or under the '
        f'mean force of the touches in any direction, µm; median {micrometres(tip.median)} µm'
    ]
    if tip.at is not None:
        parts[0] += f', largest {micrometres(tip.worst)} µm at {tip.at.title}'
    if c.cell.tolerance is not None and tip.worst > c.cell.tolerance:
        parts.append(f'Thick line: the tolerance, {micrometres(c.cell.tolerance)} µm')
    if tip.undetermined > 0:
        parts.append(f'Not determined by these touches in {100 * tip.undetermined:.0f} % of the {c.cell.region.title}')
    parts.append('The play of the joints without load is not contained')
    figures = tuple(Figure(partial(uncertainty_picture, c, each)) for each in known)
    return Figures(figures, '. '.join([*parts, _FADED])) if figures else None


def uncertainty_picture(c: Calibration, places: UncertaintyMap) -> Markup:
    """Filled lines of equal expanded uncertainty of the tip, a thick one at the tolerance; discs and touches.

    The extrapolated part is faded.
    """
    p, touches, values, posture = c.parameters, c.touches.select(c.used), 1e6 * places.expanded, places.posture
    name, tolerance = 'left' if posture > 0 else 'right', c.cell.tolerance
    coarse_grid = places.x, places.y
    grid = [np.linspace(line[0], line[-1], 4 * len(line)) for line in coarse_grid]
    reach, away = NEARLY_STRETCHED * (p.l1 + p.l2), np.hypot(grid[0] - p.x0, grid[1][:, None] - p.y0)
    meshes = (np.stack(np.meshgrid(*lines), axis=-1) for lines in (coarse_grid, grid))
    coarse, fine = (c.cell.can_take(inverse(p, mesh, posture)) for mesh in meshes)
    lost = np.kron(np.isnan(values) & coarse, np.ones((4, 4))) > 0  # beyond the reach as well, which is clipped
    shown = np.where((lost & (away < 0.9 * reach)) | ~fine, np.nan, _smooth(values))
    ends = np.nanmin(shown), np.nanmax(shown)
    height = 380.0 * np.ptp(places.y) / np.ptp(places.x) + 70.0
    figure, (axes,) = draw.new_figure(450.0, height, margins=draw.Margins(left=60, bottom=44, top=26))
    levels = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(*ends) if ends[1] > ends[0] else np.array([])
    if len(levels) > 1:
        fills = [to_rgba(draw.SERIES[0], 0.05 + 0.5 * k / len(levels)) for k in range(len(levels) + 1)]
        axes.contourf(*grid, shown, levels=levels, colors=fills, extend='both')
        lines = axes.contour(*grid, shown, levels=levels, colors=[draw.SERIES[0]], linewidths=0.8)
        axes.clabel(lines, fontsize=10, colors=[draw.INK], inline=True, zorder=5, fmt=lambda value: f'{value:g}')
    touched = _smooth(places.touched.astype(float))
    axes.contourf(*grid, touched, levels=[-1.0, 0.5], colors=[to_rgba(draw.PAPER, 0.62)], zorder=2)
    axes.add_patch(Wedge((p.x0, p.y0), 4 * reach, 0, 360, width=3 * reach, color=draw.PAPER, zorder=2.5))
    _draw_discs(axes, c, order=3)
    chosen = touches.posture == posture
    _draw_marks(axes, touches.disc[chosen], touches.posture[chosen], forward(p, touches.joints)[chosen], 3.2)
    axes.plot(p.x0, p.y0, 'o', ms=8, mfc=draw.PAPER, mec=draw.INK, mew=1.5, zorder=4)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', title=f'posture {name}, lines in µm')
    draw.in_mm(axes)
    axes.set(xlim=(grid[0][0], grid[0][-1]), ylim=(grid[1][0], grid[1][-1]))
    axes.grid(visible=False)
    if tolerance is not None and np.nanmin(places.expanded) < tolerance < np.nanmax(places.expanded):
        axes.contour(*grid, _smooth(places.expanded), levels=[tolerance], colors=[draw.WARN], linewidths=2.2)
    return draw.as_svg(figure, f'uncertainty_{name}', f'uncertainty of the tip, posture {name}')


def _smooth(values: Floats) -> Floats:
    """A grid of values four times as fine, smoothed; what is not determined is filled from what is near."""
    known = np.isfinite(values)
    rows, columns = (np.exp(-0.35 * (np.linspace(0, n - 1, 4 * n)[:, None] - np.arange(n)) ** 2) for n in values.shape)
    weight = rows @ known @ columns.T
    return np.asarray(rows @ np.where(known, values, 0.0) @ columns.T / np.maximum(weight, 1e-300), dtype=float)
