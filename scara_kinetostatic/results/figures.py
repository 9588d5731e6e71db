"""Figures of the report: the cell, the residuals, what the touches show of an effect; maps of the tip's uncertainty.

A map is drawn for each elbow posture that was touched, over the grid of the uncertainty of the tip. Where the joint
angles of a place are outside the convex hull of those of the touches, the model is extrapolated: the map is faded.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure as Picture
from matplotlib.patches import Circle, Patch, Polygon, Wedge
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED, UncertaintyMap
from scara_kinetostatic.diagnosis.comparison import EffectResidual
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.kinematics import forward, inverse, link_vectors
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import IN_MICRO, IN_MILLI
from scara_kinetostatic.model.quantities import micrometres, percentage
from scara_kinetostatic.report import figure as draw
from scara_kinetostatic.report.page import Figure, Figures, Legend

_WIDTH, _HALF, _HEIGHT = 920.0, 450.0, 360.0
"""Of a figure, of one of two side by side, of one that is no map, pixels."""
_WITH_TITLE = draw.Margins(top=26.0)
_MARK, _ASIDE = 4.0, 8.0
"""Size of a mark; distance of a text from what it names, pixels."""
_FAINT = 0.6
"""Opacity of what is not to cover the rest."""
_LONGEST_ARROW = 0.14
"""Of the largest force, as a part of the arm's length."""
_FEW = 6
"""A variable with so few values is a category: its touches are drawn side by side."""
_ROOM = 1.1
"""Of a scale beyond the largest value on it."""
_TINY = np.finfo(float).tiny


def _from_above(low: Floats, high: Floats, width: float, margins: draw.Margins) -> tuple[Picture, Axes]:
    """An empty figure of a part of the plane from one corner to another, m, labelled in mm."""
    (across, up), inner = high - low, width - margins.left - margins.right
    height = inner * min(max(up / across, 1 / 3), 1.0) + margins.bottom + margins.top
    figure, (axes,) = draw.new_figure(width, height, margins=margins)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f'{IN_MILLI * value:.0f}'.replace('-', '−'))
    return figure, axes


def cell_picture(c: Calibration) -> Markup:
    """The cell from above, in the base frame."""
    p, arm, reach, base = c.parameters, c.parameters.l1 + c.parameters.l2, c.cell.radii[:, None], _base(c)
    tip, elbow = forward(p, c.touches.joints), base + link_vectors(p, c.touches.joints)[0]
    points = np.concatenate([c.cell.centers - reach, c.cell.centers + reach, tip, elbow, base[None]])
    margin = _LONGEST_ARROW * arm
    figure, axes = _from_above(points.min(axis=0) - margin, points.max(axis=0) + margin, _WIDTH, draw.Margins())
    _draw_objects(axes, c, filled=True)
    _draw_arms(axes, c, tip, elbow, base)
    _draw_touches(axes, c, tip, arm)
    return draw.as_svg(figure, 'cell', 'the cell from above with its discs, the arm and the touches')


def _base(c: Calibration) -> Floats:
    return np.array([c.parameters.x0, c.parameters.y0])


def _draw_objects(axes: Axes, c: Calibration, *, filled: bool = False) -> None:
    """The objects with their names: discs to the centre of the tip in contact, outlines by their sides."""
    for number, item in enumerate(c.cell.discs):
        colour = draw.mark(number).colour
        inside = to_rgba(colour, 0.13) if filled and item.is_closed else 'none'
        look: dict[str, Any] = {'facecolor': inside, 'edgecolor': colour, 'zorder': 2}
        shape: Patch = Circle((item.x, item.y), item.radius, **look)
        if isinstance(item, Outline):
            shape = Polygon(item.shape(), closed=item.is_closed, **look)
        axes.add_patch(shape)
        text = axes.text(item.x, item.y, item.name, ha='center', va='center', size='small', color=draw.INK, zorder=4)
        text.set(parse_math=False, clip_on=True)


def _draw_arms(axes: Axes, c: Calibration, tip: Floats, elbow: Floats, base: Floats) -> None:
    """All arms as a faint trace, one of each posture in full, in front of the farthest disc, where it covers least."""
    touched = np.unique(c.touches.disc)
    farthest = touched[np.argmax(np.linalg.norm(c.cell.centers[touched] - base, axis=1))]
    lines = np.stack([np.broadcast_to(base, tip.shape), elbow, tip], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=draw.FAINT, linewidths=draw.THIN, alpha=_FAINT / 4))
    for posture, dashes in ((1, 'solid'), (-1, 'dashed')):
        members = np.flatnonzero((c.touches.posture == posture) & (c.touches.disc == farthest))
        if len(members):
            x, y = lines[members[np.argmin(np.linalg.norm(tip[members] - base, axis=1))]].T
            axes.plot(x, y, color=draw.INK, lw=draw.THICK, ls=dashes)
            _draw_joint(axes, x[1], y[1])
    _draw_joint(axes, *base)
    _draw_beside(axes, 'base', base, draw.FAINT, va='top')
    axes.axhline(base[1], color=draw.LINE, lw=draw.THIN, zorder=0)


def _draw_beside(axes: Axes, text: str, place: Floats, colour: str, va: str) -> None:
    at = _ASIDE, -_ASIDE if va == 'top' else 0
    axes.annotate(text, (place[0], place[1]), at, textcoords='offset points', color=colour, va=va)


def _draw_joint(axes: Axes, x: float, y: float) -> None:
    axes.plot(x, y, 'o', ms=2 * _MARK, mfc=draw.PAPER, mec=draw.INK, zorder=4)


def _draw_touches(axes: Axes, c: Calibration, tip: Floats, arm: float) -> None:
    """An arrow per touch, head at the contact, length as the force."""
    along, t, used = _unit(c.force), c.touches, c.used
    # the postures lie beside each other
    head = tip + np.stack([-along[:, 1], along[:, 0]], axis=-1) * t.posture[:, None] * 0.004 * arm
    tail = head - _LONGEST_ARROW * arm * c.force / max(np.hypot(*c.force.T).max(), _TINY)
    colours = [draw.mark(number).colour for number in t.disc[used].tolist()]
    axes.add_collection(LineCollection(list(np.stack([tail, head], axis=1)[used]), colors=colours, alpha=_FAINT))
    _draw_marks(axes, t.disc[used], t.posture[used], head[used])
    _draw_unused(axes, tip[~used])
    for k in np.flatnonzero(~used):
        _draw_beside(axes, str(t.index[k]), tip[k], draw.WARN, va='center')


def _unit(force: Floats) -> Floats:
    return force / np.maximum(np.hypot(*force.T), _TINY)[:, None]


def _draw_unused(axes: Axes, places: Floats) -> None:
    axes.plot(*places.T, 'X', ls='none', ms=2 * _MARK, mfc=draw.WARN, mec=draw.PAPER, zorder=4)


def legend(c: Calibration) -> Legend:
    """Sign, colour and name of each disc that was touched."""
    looks = [(draw.mark(number), c.cell.discs[number].name) for number in sorted(set(c.touches.disc.tolist()))]
    unused = () if c.used.all() else (('✖', draw.COLOURS[draw.WARN], 'not used'),)
    discs = ((look.sign, draw.COLOURS[look.colour], name) for look, name in looks)
    return Legend((*discs, ('', 'inherit', 'filled: posture left, hollow: right'), *unused))


def residual_picture(c: Calibration) -> Markup:
    """The parts of the calibrated residual along and across the force, per touch."""
    along, t, used = _unit(c.force), c.touches, c.used
    parts = (
        ('along the force  [N]', (c.residual * along).sum(axis=1)),
        ('across it  [N]', c.residual[:, 1] * along[:, 0] - c.residual[:, 0] * along[:, 1]),
    )
    figure, both = draw.new_figure(_WIDTH, _HEIGHT, rows=2, margins=draw.Margins(), sharex=True)
    for axes, (label, values) in zip(both, parts, strict=True):
        shown = _draw_about_zero(axes, values, float(np.abs(values[used]).max(initial=0.0)))
        places = np.stack([t.index, shown], axis=-1)
        _draw_marks(axes, t.disc[used], t.posture[used], places[used])
        _draw_unused(axes, places[~used])
        axes.set_ylabel(label)
    both[-1].set_xlabel('touch')
    figure.align_ylabels()
    return draw.as_svg(figure, 'residuals', 'residual force of each touch along and across the force')


def _draw_about_zero(axes: Axes, values: Floats, largest: float) -> Floats:
    """Zero as a line amid a scale; returns the values on it, those beyond it at its edge."""
    axes.axhline(0, color=draw.FAINT, lw=draw.THIN)
    axes.grid(visible=False, axis='x')
    largest = largest or 1.0
    axes.set_ylim(-_ROOM * largest, _ROOM * largest)
    return np.clip(values, -largest, largest)


def _draw_marks(axes: Axes, disc: Indices, posture: Indices, places: Floats) -> None:
    """Touches at places (n, 2) by disc (colour and shape) and posture (full: left, hollow: right)."""
    for number in np.unique(disc).tolist():
        look = draw.mark(number)
        for side, fill in ((1, look.colour), (-1, draw.PAPER)):
            x, y = places[(disc == number) & (posture == side)].T
            axes.plot(x, y, look.shape, ls='none', ms=_MARK, mfc=fill, mec=look.colour, zorder=3)


def effect_picture(found: EffectResidual, name: str, titles: tuple[str, str] = ('without it', 'with it')) -> Markup:
    """The deviation by an effect, estimated from each touch, without it in the model and with it, on the same axes."""
    figure, axes = draw.new_figure(_WIDTH, _HEIGHT, columns=2, margins=_WITH_TITLE, sharey=True, sharex=True)
    x, kinds = _side_by_side(found.x), np.unique(found.x)
    size = np.abs(np.concatenate([found.before, found.after, found.expected, [0.0] * (not len(x))]))
    # 0.97: this part of the touches lies well within the scale, so that single outliers do not change it
    largest = min(float(size.max()), 2 * float(np.quantile(size, 0.97)))
    sides = ((found.before, found.std_before), (found.after, found.std_after))
    for one, (deviation, std), title in zip(axes, sides, titles, strict=True):
        values = _draw_about_zero(one, deviation, largest)
        one.vlines(x, values - std, values + std, color=draw.LINE, zorder=1)
        _draw_marks(one, found.disc, found.posture, np.stack([x, values], axis=-1))
        one.set(title=title, xlabel=found.x_label)
        if 0 < len(kinds) <= _FEW:
            one.set_xticks(kinds)
    if found.expected.any():  # an effect that only scatters leaves no pattern
        axes[0].plot(x, found.expected, '_', ms=2 * _MARK, mew=draw.THICK, color=draw.INK, zorder=4)
    axes[0].set(ylabel=found.y_label)
    return draw.as_svg(figure, name, 'deviation by the effect, estimated from each touch, without it and with it')


def _side_by_side(x: Floats) -> Floats:
    """Values of which there are few, spread out in the order of the touches."""
    kinds, which = np.unique(x, return_inverse=True)
    if len(kinds) > _FEW:
        return x
    apart, out = float(np.diff(kinds).min()) if len(kinds) > 1 else 1.0, x.copy()
    for number in range(len(kinds)):
        members = np.flatnonzero(which == number)
        out[members] += apart / 3 * np.linspace(-1, 1, len(members) + 2)[1:-1]
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
        parts.append(f'Not determined by these touches in {percentage(tip.undetermined)} of the {c.cell.region.title}')
    parts.append('The play of the joints without load is not contained')
    figures = tuple(Figure(partial(uncertainty_picture, c, each)) for each in known)
    return Figures(figures, '. '.join([*parts, _FADED])) if figures else None


def uncertainty_picture(c: Calibration, places: UncertaintyMap) -> Markup:
    """Filled lines of equal expanded uncertainty of the tip, a thick one at the tolerance; discs and touches.

    The extrapolated part is faded.
    """
    p, touches, values, posture = c.parameters, c.touches.select(c.used), places.expanded, places.posture
    name, tolerance, reach = 'left' if posture > 0 else 'right', c.cell.tolerance, NEARLY_STRETCHED * (p.l1 + p.l2)
    coarse_grid = places.x, places.y
    grid = [np.linspace(line[0], line[-1], 4 * len(line)) for line in coarse_grid]
    coarse, fine = (np.stack(np.meshgrid(*lines), axis=-1) for lines in (coarse_grid, grid))
    within = np.linalg.norm(coarse - _base(c), axis=-1) <= reach
    lost = np.isnan(values) & within & c.cell.can_take(inverse(p, coarse, posture))
    blank = (np.kron(lost, np.ones((4, 4))) > 0) | ~c.cell.can_take(inverse(p, fine, posture))
    shown = np.where(blank, np.nan, IN_MICRO * _smooth(values))
    ends = np.nanmin(shown), np.nanmax(shown)
    figure, axes = _from_above(fine[0, 0], fine[-1, -1], _HALF, _WITH_TITLE)
    levels = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(*ends) if ends[1] > ends[0] else np.array([])
    if len(levels) > 1:
        fills = [to_rgba(draw.SERIES[0], k / (2 * len(levels))) for k in range(len(levels) + 1)]
        axes.contourf(*grid, shown, levels=levels, colors=fills, extend='both')
        lines = axes.contour(*grid, shown, levels=levels, colors=[draw.SERIES[0]], linewidths=draw.THIN)
        axes.clabel(lines, fontsize='small', colors=[draw.INK], inline=True, zorder=4, fmt=lambda value: f'{value:g}')
    faded = to_rgba(draw.PAPER, _FAINT)
    axes.contourf(*grid, _smooth(places.touched.astype(float)), levels=[-1, 0.5], colors=[faded], zorder=2)
    axes.add_patch(Wedge(tuple(_base(c)), 4 * reach, 0, 360, width=3 * reach, color=draw.PAPER, zorder=2))
    _draw_objects(axes, c)
    chosen = touches.posture == posture
    _draw_marks(axes, touches.disc[chosen], touches.posture[chosen], forward(p, touches.joints)[chosen])
    _draw_joint(axes, p.x0, p.y0)
    axes.set(title=f'posture {name}, lines in µm')
    axes.grid(visible=False)
    if tolerance is not None and np.nanmin(values) < tolerance < np.nanmax(values):
        axes.contour(*grid, _smooth(values), levels=[tolerance], colors=[draw.WARN], linewidths=draw.THICK)
    return draw.as_svg(figure, f'uncertainty_{name}', f'uncertainty of the tip, posture {name}')


def _smooth(values: Floats) -> Floats:
    """A grid of values four times as fine, smoothed; what is not determined is filled from what is near."""
    known = np.isfinite(values)
    rows, columns = (np.exp(-0.35 * (np.linspace(0, n - 1, 4 * n)[:, None] - np.arange(n)) ** 2) for n in values.shape)
    weight = rows @ known @ columns.T
    return np.asarray(rows @ np.where(known, values, 0.0) @ columns.T / np.maximum(weight, _TINY), dtype=float)
