"""Maps of the tip over the workspace: its deviation nominal → calibrated, and its uncertainty.

A map is drawn for each elbow posture that was touched, over a grid of places of the tip. Where the joint angles of a
place are outside the convex hull of those of the touches, the model is extrapolated: the map is faded there.

The deviation is that of a controller with the nominal parameters: it commands the angles Q that bring the nominal
robot without load to a place; the map shows H̄(L̄, Q, F) less H̄(L̄n, Q, F).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull, QhullError

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import (
    COVERAGE_FACTOR,
    NEARLY_STRETCHED,
    TipUncertainty,
    UncertaintyMap,
)
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward, inverse, wrap
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.report import Figure, Figures
from scara_kinetostatic.report.figure import FAINT, INK, PAPER, SERIES, WARN, Margins, as_svg, mark, new_figure

_WIDTH = 450.0
_DIRECTIONS = 12
"""Of the force, over which the largest deviation is taken."""
_MILLI = 1e3
_FADED = 'Faded: extrapolated, the joint angles are not between those of the touches.'


class TipMap(NamedTuple):
    """Places of the tip in one elbow posture, on a grid.

    Attributes:
        posture: +1 for left, -1 for right.
        x: of the columns, (k,), m.
        y: of the rows, (m,), m.
        joints: nominal angles at the places, (m, k, 2), rad; NaN where they are out of reach.
        touched: outline of the places whose joint angles are between those of the touches, (j, 2), m; may be empty.
    """

    posture: int
    x: Floats
    y: Floats
    joints: Floats
    touched: Floats

    @property
    def name(self) -> str:
        """Of the posture."""
        return 'left' if self.posture > 0 else 'right'


class Deviation(NamedTuple):
    """Deviation of the tip, calibrated less nominal, over a map.

    Attributes:
        places: where.
        unloaded: without load, (m, k, 2), m.
        loaded: largest length over all directions of the mean force, (m, k), m.
        force: mean force of the touches, N.
    """

    places: TipMap
    unloaded: Floats
    loaded: Floats
    force: float


def uncertainty_figures(outcome: Outcome) -> Figures | None:
    """Maps of the expanded uncertainty of the tip; None where the data do not determine it."""
    c, tip = outcome.final, outcome.tip_uncertainty
    figures = [
        Figure(partial(uncertainty_picture, c, tip_map(c, each.posture), each, c.cell.tolerance))
        for each in tip.maps
        if np.isfinite(each.expanded).any()
    ]
    return Figures(tuple(figures), _uncertainty_caption(tip, c.cell.tolerance)) if figures else None


def deviation_figures(outcome: Outcome) -> Figures | None:
    """Maps of the deviation of the tip; None where the data do not determine it."""
    c, tip = outcome.final, outcome.tip_uncertainty
    if not np.isfinite(tip.worst):
        return None
    found = [deviation(c, tip_map(c, each.posture)) for each in tip.maps]
    return Figures(tuple(Figure(partial(deviation_picture, c, each)) for each in found), _deviation_caption(found))


def _uncertainty_caption(tip: TipUncertainty, tolerance: float | None) -> str:
    parts = [
        f'Expanded uncertainty (k = {COVERAGE_FACTOR:g}) of the tip in the worst direction, without load or under the '
        f'mean force of the touches in any direction, mm; median {_MILLI * tip.median:.3g} mm'
        f'{_largest(tip)}.'
    ]
    if tolerance is not None and tip.worst > tolerance:
        parts.append(f'Thick line: the tolerance, {_MILLI * tolerance:.3g} mm.')
    if tip.undetermined > 0:
        parts.append(f'Not determined by these touches in {100 * tip.undetermined:.0f} % of the workspace.')
    lost = f'{_MILLI * tip.lost_motion:.3g} mm'
    parts.append(f'The play of the joints without load, up to {lost}, is not contained. {_FADED}')
    return ' '.join(parts)


def _largest(tip: TipUncertainty) -> str:
    """The largest uncertainty and its place, which may be outside the picture."""
    if tip.at is None:
        return ''
    x, y = _MILLI * tip.at.tip
    return f', largest {_MILLI * tip.worst:.3g} mm at x {round(x)} mm, y {round(y)} mm'.replace('-', '−')


def _deviation_caption(found: list[Deviation]) -> str:
    longest = max(float(np.nanmax(np.linalg.norm(each.unloaded, axis=-1))) for each in found)
    size, force = f'{_MILLI * longest:.3g} mm', f'{found[0].force:.3g} N'
    return (
        'Where the tip is, less where the nominal parameters put it, at the same joint angles. Arrows: without load, '
        f'the longest {size}. Lines: largest deviation under {force}, the mean force of the touches, in any direction, '
        f'mm. {_FADED}'
    )


def tip_map(c: Calibration, posture: int) -> TipMap:
    """The places of one posture around its touches and the base."""
    nominal, p, touches = c.cell.nominal, c.parameters, c.touches.select(c.used)
    low, high = _extent(c)
    size = (high - low) / max(high - low)
    # 45: places along the longer side
    x, y = (np.linspace(low[k], high[k], max(3, round(45 * size[k]))) for k in (0, 1))
    tip = np.stack(np.meshgrid(x, y), axis=-1)
    away = np.hypot(tip[..., 0] - p.x0, tip[..., 1] - p.y0)
    ends = (1 - NEARLY_STRETCHED) * (p.l1 + p.l2)
    # 5.0: around the base, where the arm is folded, nothing is drawn: so many times what is left out at the reach
    reached = (away >= abs(p.l1 - p.l2) + 5.0 * ends) & (away <= p.l1 + p.l2 - ends)
    joints = inverse(nominal, np.where(reached[..., None], tip, np.nan), posture)
    members = touches.joints[touches.posture == posture]
    return TipMap(posture, x, y, joints, forward(p, _hull(members)))


def _extent(c: Calibration) -> tuple[Floats, Floats]:
    """Around all discs, touches and the base."""
    p, radii = c.parameters, c.cell.radii[:, None]
    discs = np.unique(c.touches.disc)
    round_discs = [c.cell.centers[discs] + sign * radii[discs] for sign in (1, -1)]
    points = np.concatenate([forward(p, c.touches.joints[c.used]), [[p.x0, p.y0]], *round_discs])
    # 0.1: of the arm's length, around touches and discs
    margin = 0.1 * (p.l1 + p.l2)
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _hull(members: Floats) -> Floats:
    """The convex hull of joint angles as a closed line, (k, 2), rad; k = 0 for fewer than three, or on a line."""
    centre = members.mean(axis=0)
    near = centre + wrap(members - centre)
    try:
        corners = near[ConvexHull(near).vertices]
    except (QhullError, ValueError):
        return np.empty((0, 2))
    # 12: points on each side of the hull
    part = np.linspace(0.0, 1.0, 12, endpoint=False)[:, None]
    sides = [
        first + part * (second - first) for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return np.concatenate(sides)


def deviation(c: Calibration, places: TipMap) -> Deviation:
    """The deviation nominal → calibrated over a map."""
    force = c.force[c.used]
    mean = float(np.hypot(force[:, 0], force[:, 1]).mean())
    joints = places.joints.reshape(-1, 2)
    known = np.isfinite(joints).all(axis=1)
    unloaded = np.full_like(joints, np.nan)
    loaded = np.full(len(joints), np.nan)
    unloaded[known] = _moved(c, joints[known], np.zeros(2))
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    lengths = [np.linalg.norm(_moved(c, joints[known], mean * each), axis=1) for each in directions]
    loaded[known] = np.max(lengths, axis=0)
    shape = places.joints.shape
    return Deviation(places, unloaded.reshape(shape), loaded.reshape(shape[:-1]), mean)


def _moved(c: Calibration, joints: Floats, force: Floats) -> Floats:
    """Calibrated less nominal place of the tip, (n, 2), m."""
    each = np.broadcast_to(force, joints.shape)
    models = (c.model, ExtendedModel(c.cell.nominal))
    calibrated, nominal = (direct_kinetostatics(model, joints, each, c.cell.gripper)[0] for model in models)
    return np.asarray(calibrated - nominal)


def deviation_picture(c: Calibration, found: Deviation) -> Markup:
    """Lines of equal deviation under the mean force, and arrows of that without load."""
    places = found.places
    grid = (places.x * _MILLI, places.y * _MILLI)
    figure, axes = _draw_map(c, places, grid, found.loaded * _MILLI)
    # 11: arrows along a side
    step = max(1, round(max(found.loaded.shape) / 11))
    rows, columns = (slice(step // 2, None, step) for _ in range(2))
    u, v = np.moveaxis(found.unloaded[rows, columns] * _MILLI, -1, 0)
    x, y = np.meshgrid(places.x[columns] * _MILLI, places.y[rows] * _MILLI)
    largest = float(np.nanmax(np.hypot(u, v), initial=0.0))
    if largest > 0:
        per_mm = 0.9 * step * (places.x[1] - places.x[0]) * _MILLI / largest
        axes.quiver(x, y, u, v, angles='xy', scale_units='xy', scale=1 / per_mm, color=INK, width=0.0045, zorder=4)
    text = f'deviation of the tip, nominal to calibrated, posture {places.name}'
    return as_svg(figure, f'deviation_{places.name}', text)


def uncertainty_picture(c: Calibration, places: TipMap, drawn: UncertaintyMap, tolerance: float | None) -> Markup:
    """Lines of equal expanded uncertainty of the tip; a thick one at the tolerance."""
    grid, shown = (drawn.x * _MILLI, drawn.y * _MILLI), drawn.expanded * _MILLI
    figure, axes = _draw_map(c, places, grid, shown)
    if tolerance is not None and np.nanmin(shown) < _MILLI * tolerance < np.nanmax(shown):
        axes.contour(*grid, shown, levels=[_MILLI * tolerance], colors=[WARN], linewidths=2.2)
    return as_svg(figure, f'uncertainty_{places.name}', f'uncertainty of the tip, posture {places.name}')


def _draw_map(c: Calibration, places: TipMap, grid: tuple[Floats, Floats], shown: Floats) -> tuple[Canvas, Axes]:
    """Filled lines of equal value with labels, the discs and touches, the extrapolated part faded; all in mm."""
    width, height = np.ptp(places.x), np.ptp(places.y)
    margins = Margins(left=60, bottom=44, top=26)
    inner = _WIDTH - margins.left - margins.right
    total = inner * float(np.clip(height / width, 0.5, 1.3)) + margins.bottom + margins.top
    figure, (axes,) = new_figure(_WIDTH, total, margins=margins)
    ends = np.nanmin(shown), np.nanmax(shown)
    levels = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(*ends) if ends[1] > ends[0] else np.array([])
    if len(levels) > 1:
        fills = [to_rgba(SERIES[0], 0.05 + 0.5 * k / len(levels)) for k in range(len(levels) - 1)]
        axes.contourf(*grid, shown, levels=levels, colors=fills)
        lines = axes.contour(*grid, shown, levels=levels, colors=[SERIES[0]], linewidths=0.8)
        axes.clabel(lines, fontsize=10, colors=[INK], inline=True, fmt=lambda value: f'{value:.3g}')
    _fade(axes, places)
    _draw_cell(axes, c, places.posture)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', title=f'posture {places.name}  [mm]')
    axes.set_xlim(places.x[0] * _MILLI, places.x[-1] * _MILLI)
    axes.set_ylim(places.y[0] * _MILLI, places.y[-1] * _MILLI)
    axes.grid(visible=False)
    return figure, axes


def _fade(axes: Axes, places: TipMap) -> None:
    """A veil over what is extrapolated, with a dashed line at its edge."""
    line = places.touched * _MILLI
    (left, right), (low, high) = ((ends[0] * _MILLI, ends[-1] * _MILLI) for ends in (places.x, places.y))
    frame = np.array([[left, low], [right, low], [right, high], [left, high]])
    if len(line):
        x, y = line.T
        is_clockwise = x @ np.roll(y, -1) < y @ np.roll(x, -1)
        hole = Path(line if is_clockwise else line[::-1], closed=False)
        parts = Path.make_compound_path(Path(frame), hole)
        axes.plot(*np.concatenate([line, line[:1]]).T, color=FAINT, lw=1.1, ls='dashed', zorder=3)
    else:
        parts = Path(frame)
    axes.add_patch(PathPatch(parts, facecolor=PAPER, alpha=0.62, lw=0, zorder=2))


def _draw_cell(axes: Axes, c: Calibration, posture: int) -> None:
    """Discs, base and the touches of one posture."""
    p, touches = c.parameters, c.touches.select(c.used)
    tip = forward(p, touches.joints) * _MILLI
    for number, disc in enumerate(c.cell.discs):
        look, chosen = mark(number), (touches.disc == number) & (touches.posture == posture)
        centre = (disc.x * _MILLI, disc.y * _MILLI)
        axes.add_patch(Circle(centre, disc.radius * _MILLI, fill=False, edgecolor=look.colour, lw=1.3, zorder=3))
        name = axes.text(*centre, disc.name, ha='center', va='center', fontsize=9.5, color=INK, zorder=5, clip_on=True)
        name.set_parse_math(False)
        axes.plot(*tip[chosen].T, look.shape, ls='none', ms=3.2, color=look.colour, mew=0, zorder=3)
    axes.plot(p.x0 * _MILLI, p.y0 * _MILLI, 'o', ms=8, mfc=PAPER, mec=INK, mew=1.5, zorder=4)
    axes.plot(p.x0 * _MILLI, p.y0 * _MILLI, 'o', ms=2.4, color=INK, zorder=5)
