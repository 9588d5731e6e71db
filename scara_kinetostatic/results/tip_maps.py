"""Maps of the tip over the workspace: its deviation nominal → calibrated, and its uncertainty.

A map is drawn for each elbow posture that was touched, over the grid of the uncertainty of the tip. Where the joint
angles of a place are outside the convex hull of those of the touches, the model is extrapolated: the map is faded.

The deviation is that of a controller with the nominal parameters: it commands the angles Q that bring the nominal
robot without load to a place; the map shows H̄(L̄, Q, F) less H̄(L̄n, Q, F).
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Wedge
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, NEARLY_STRETCHED, UncertaintyMap
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward, inverse
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.report import Figure, Figures
from scara_kinetostatic.report.figure import INK, PAPER, SERIES, WARN, Margins, as_svg, draw_object, mark, new_figure
from scara_kinetostatic.report.quantities import micrometres

_MILLI = 1e3
_FADED = 'Faded: extrapolated, the joint angles are not between those of the touches. Blank: the arm cannot be there.'


class Deviation(NamedTuple):
    """Deviation of the tip, calibrated less nominal, over a map.

    Attributes:
        unloaded: without load, (m, k, 2), m.
        loaded: largest length over all directions of the mean force, (m, k), m.
        force: mean force of the touches, N.
    """

    unloaded: Floats
    loaded: Floats
    force: float


def uncertainty_figures(outcome: Outcome) -> Figures | None:
    """Maps of the expanded uncertainty of the tip; None where the data do not determine it."""
    c, tip = outcome.final, outcome.tip_uncertainty
    known = [each for each in tip.maps if np.isfinite(each.expanded).any()]
    parts = [
        f'Expanded uncertainty (k = {COVERAGE_FACTOR:g}) of the tip in the worst direction, without load or under the '
        f'mean force of the touches in any direction, µm; median {micrometres(tip.median)} µm'
    ]
    if tip.at is not None:
        parts[0] += f', largest {micrometres(tip.worst)} µm at {tip.at.title}'
    if c.cell.tolerance is not None and tip.worst > c.cell.tolerance:
        parts.append(f'Thick line: the tolerance, {micrometres(c.cell.tolerance)} µm')
    if tip.undetermined > 0:
        parts.append(f'Not determined by these touches in {100 * tip.undetermined:.0f} % of the {c.cell.region.title}')
    parts.append(f'The play of the joints without load, up to {micrometres(tip.lost_motion)} µm, is not contained')
    figures = tuple(Figure(partial(uncertainty_picture, c, each)) for each in known)
    return Figures(figures, '. '.join([*parts, _FADED])) if figures else None


def deviation_figures(outcome: Outcome) -> Figures | None:
    """Maps of the deviation of the tip; None where the data do not determine it."""
    c, tip = outcome.final, outcome.tip_uncertainty
    if not np.isfinite(tip.worst):
        return None
    found = [deviation(c, each) for each in tip.maps]
    longest = max(float(np.nanmax(np.linalg.norm(each.unloaded, axis=-1))) for each in found)
    caption = (
        'Where the tip is, less where the nominal parameters put it, at the same joint angles. Arrows: without load, '
        f'the longest {_MILLI * longest:.3g} mm. Lines: largest deviation under {found[0].force:.3g} N, the mean force '
        f'of the touches, in any direction, mm. {_FADED}'
    )
    pairs = zip(tip.maps, found, strict=True)
    return Figures(tuple(Figure(partial(deviation_picture, c, places, each)) for places, each in pairs), caption)


def deviation(c: Calibration, places: UncertaintyMap) -> Deviation:
    """The deviation nominal → calibrated over a map."""
    force = float(np.hypot(*c.force[c.used].T).mean())
    tip = np.stack(np.meshgrid(places.x, places.y), axis=-1)
    joints = inverse(c.cell.nominal, np.where(np.isfinite(places.expanded)[..., None], tip, np.nan), places.posture)
    angles = 2 * np.pi * np.arange(12) / 12
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    lengths = [np.linalg.norm(_moved(c, joints, force * each), axis=-1) for each in directions]
    return Deviation(_moved(c, joints, np.zeros(2)), np.max(lengths, axis=0), force)


def _moved(c: Calibration, joints: Floats, force: Floats) -> Floats:
    """Calibrated less nominal place of the tip, (m, k, 2), m; NaN where the arm does not reach."""
    moved, known = np.full(joints.shape, np.nan), np.isfinite(joints).all(axis=-1)
    each = np.broadcast_to(force, joints[known].shape)
    models = (c.model, ExtendedModel(c.cell.nominal))
    calibrated, nominal = (direct_kinetostatics(model, joints[known], each, c.cell.gripper)[0] for model in models)
    moved[known] = calibrated - nominal
    return moved


def deviation_picture(c: Calibration, places: UncertaintyMap, found: Deviation) -> Markup:
    """Lines of equal deviation under the mean force, and arrows of that without load."""
    figure, axes = _draw_map(c, places, _MILLI * found.loaded, 'mm')
    step = slice(1, None, 3)
    u, v = np.moveaxis(found.unloaded[step, step] * _MILLI, -1, 0)
    x, y = np.meshgrid(places.x[step] * _MILLI, places.y[step] * _MILLI)
    largest = float(np.nanmax(np.hypot(u, v), initial=0.0))
    if largest > 0:
        per_mm = 2.7 * (places.x[1] - places.x[0]) * _MILLI / largest
        look: dict[str, Any] = {'color': INK, 'width': 0.0045, 'zorder': 4, 'clip_on': False}
        axes.quiver(x, y, u, v, angles='xy', scale_units='xy', scale=1 / per_mm, **look)
    name = _posture(places)
    return as_svg(figure, f'deviation_{name}', f'deviation of the tip, nominal to calibrated, posture {name}')


def uncertainty_picture(c: Calibration, places: UncertaintyMap) -> Markup:
    """Lines of equal expanded uncertainty of the tip; a thick one at the tolerance."""
    figure, axes = _draw_map(c, places, 1e6 * places.expanded, 'µm')
    tolerance = c.cell.tolerance
    if tolerance is not None and np.nanmin(places.expanded) < tolerance < np.nanmax(places.expanded):
        grid = (np.linspace(line[0], line[-1], 4 * len(line)) * _MILLI for line in (places.x, places.y))
        axes.contour(*grid, _smooth(places.expanded), levels=[tolerance], colors=[WARN], linewidths=2.2)
    name = _posture(places)
    return as_svg(figure, f'uncertainty_{name}', f'uncertainty of the tip, posture {name}')


def _posture(places: UncertaintyMap) -> str:
    return 'left' if places.posture > 0 else 'right'


def _smooth(values: Floats) -> Floats:
    """A grid of values four times as fine, smoothed; what is not determined is filled from what is near."""
    known = np.isfinite(values)
    rows, columns = (np.exp(-0.35 * (np.linspace(0, n - 1, 4 * n)[:, None] - np.arange(n)) ** 2) for n in values.shape)
    weight = rows @ known @ columns.T
    return np.asarray(rows @ np.where(known, values, 0.0) @ columns.T / np.maximum(weight, 1e-300), dtype=float)


def _draw_map(c: Calibration, places: UncertaintyMap, values: Floats, unit: str) -> tuple[Canvas, Axes]:
    """Filled lines of equal value with labels, the discs and touches in mm, the extrapolated part faded."""
    p, touches = c.parameters, c.touches.select(c.used)
    grid = [np.linspace(line[0], line[-1], 4 * len(line)) * _MILLI for line in (places.x, places.y)]
    base, reach = np.array([p.x0, p.y0]) * _MILLI, NEARLY_STRETCHED * (p.l1 + p.l2) * _MILLI
    away = np.hypot(grid[0] - base[0], grid[1][:, None] - base[1])
    fields = (places.x, places.y), (grid[0] / _MILLI, grid[1] / _MILLI)
    coarse, fine = (c.cell.can_take(inverse(p, np.stack(np.meshgrid(*xy), axis=-1), places.posture)) for xy in fields)
    lost = np.kron(np.isnan(values) & coarse, np.ones((4, 4))) > 0  # beyond the reach as well, which is clipped
    shown = np.where((lost & (away < 0.9 * reach)) | ~fine, np.nan, _smooth(values))
    ends = np.nanmin(shown), np.nanmax(shown)
    height = 380.0 * np.ptp(places.y) / np.ptp(places.x) + 70.0
    figure, (axes,) = new_figure(450.0, height, margins=Margins(left=60, bottom=44, top=26))
    levels = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(*ends) if ends[1] > ends[0] else np.array([])
    if len(levels) > 1:
        fills = [to_rgba(SERIES[0], 0.05 + 0.5 * k / len(levels)) for k in range(len(levels) + 1)]
        axes.contourf(*grid, shown, levels=levels, colors=fills, extend='both')
        lines = axes.contour(*grid, shown, levels=levels, colors=[SERIES[0]], linewidths=0.8)
        axes.clabel(lines, fontsize=10, colors=[INK], inline=True, zorder=5, fmt=lambda value: f'{value:g}')
    touched = _smooth(places.touched.astype(float))
    axes.contourf(*grid, touched, levels=[-1.0, 0.5], colors=[to_rgba(PAPER, 0.62)], zorder=2)
    beyond = Wedge((base[0], base[1]), 4 * reach, 0, 360, width=3 * reach, color=PAPER, zorder=2.5)
    axes.add_patch(beyond)
    tip = forward(p, touches.joints) * _MILLI
    for number, disc in enumerate(c.cell.discs):
        look, chosen = mark(number), (touches.disc == number) & (touches.posture == places.posture)
        centre = (disc.x * _MILLI, disc.y * _MILLI)
        draw_object(axes, disc, look.colour, scale=_MILLI, width=1.3, order=3)
        name = axes.text(*centre, disc.name, ha='center', va='center', fontsize=9.5, color=INK, zorder=5, clip_on=True)
        name.set_parse_math(False)
        axes.plot(*tip[chosen].T, look.shape, ls='none', ms=3.2, color=look.colour, mew=0, zorder=3)
    axes.plot(p.x0 * _MILLI, p.y0 * _MILLI, 'o', ms=8, mfc=PAPER, mec=INK, mew=1.5, zorder=4)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', title=f'posture {_posture(places)}, lines in {unit}')
    axes.set(xlim=(grid[0][0], grid[0][-1]), ylim=(grid[1][0], grid[1][-1]))
    axes.grid(visible=False)
    return figure, axes
