"""Figures of the optimal design: accuracy by the number of touches, checks of the set, maps of the tip and of discs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator, NullLocator

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.report.figure import FAINT, INK, LINE, MICRO, PAPER, SERIES, WARN, as_svg, mark, new_figure
from scara_kinetostatic.studies.design.optimal_design import Design
from scara_kinetostatic.studies.design.prediction import free_tip, loaded_tip, make_workspace, reach, tip_std

WIDTH, HALF = 920.0, 450.0
_TICKS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 300, 500, 1000)


def number_picture(design: Design) -> Markup:
    """Largest standard deviation of the tip over the number of touches: best, even, random, and the lower bound."""
    figure, (axes,) = new_figure(WIDTH, 360)
    c, target = design.curve, MICRO * design.requirements.accuracy
    n = c.number
    low, middle, high = MICRO * c.random.T
    top = 8 * target
    axes.fill_between(n, low, np.minimum(high, 2 * top), color=FAINT, alpha=0.16, lw=0)
    axes.plot(n, middle, color=FAINT, lw=1.2)
    axes.plot(n, MICRO * c.even, color=SERIES[1], lw=1.4, ls=(0, (5, 2.5)))
    axes.plot(n, MICRO * c.bound, color=INK, lw=1.0, ls=(0, (1, 2)))
    axes.plot(n, MICRO * c.chosen, 'o-', color=SERIES[0], lw=1.6, ms=5)
    axes.axhline(target, color=WARN, lw=1.0)
    best = (len(design.recommended.plan), MICRO * design.tip_std.largest)
    axes.plot(*best, 'o', ms=11, mfc='none', mec=WARN, mew=1.6)
    axes.annotate('recommended', best, (9, 7), textcoords='offset points', color=WARN)
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_ylim(0.74 * MICRO * float(c.bound.min()), top)
    axes.set_xlim(0.96 * n[0], 1.3 * n[-1])
    _plain_ticks(axes)
    axes.xaxis.set_major_locator(FixedLocator(n.tolist()))
    axes.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.set(xlabel='touches', ylabel='largest std of the tip  [µm]')
    ends = {'random, 5 to 95 %': (middle, FAINT), 'evenly distributed': (MICRO * c.even, SERIES[1]),
            'best set found': (MICRO * c.chosen, SERIES[0]), 'lower bound': (MICRO * c.bound, INK)}  # fmt: skip
    _labels(axes, n[-1], ends)
    axes.annotate('required', (n[-1], target), (6, 4), textcoords='offset points', color=WARN)
    return as_svg(figure, 'number', 'largest standard deviation of the tip over the number of touches')


def _labels(axes: Axes, x: float, ends: dict[str, tuple[Floats, str]]) -> None:
    """Names at the right ends of curves, pushed apart where the curves nearly meet; logarithmic scale."""
    low, high = axes.get_ylim()
    step = (high / low) ** 0.055
    former = np.inf
    for name, (values, colour) in sorted(ends.items(), key=lambda item: -float(item[1][0][-1])):
        y = min(float(values[-1]), former / step)
        former = y
        place: dict[str, Any] = {'textcoords': 'offset points', 'va': 'center', 'annotation_clip': False}
        axes.annotate(name, (x, y), (8, 0), color=colour, **place)


def _plain_ticks(axes: Axes) -> None:
    axes.yaxis.set_major_locator(FixedLocator(list(_TICKS)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f'{value:g}')


COLOURS = 'viridis_r'


def tip_picture(design: Design) -> Markup:
    """The standard deviation of the tip over the workspace after the recommended set, posture by posture."""
    figure = Figure(figsize=(WIDTH / 72, 430 / 72), dpi=72, layout='constrained')
    axes = figure.subplots(1, 2, sharey=True)
    robot, q = design.robot, design.requirements
    workspace = make_workspace(robot, q.region, radii=24, angles=120)
    tip = loaded_tip(robot, workspace, q.load) if q.under_load else free_tip(robot, workspace)
    places = MICRO * tip_std(tip, design.recommended.row.prediction).places
    low, high = float(places.min()), float(places.max())
    for k, name in enumerate(('posture left', 'posture right')):
        values = np.full(workspace.mask.shape, np.nan)
        values[workspace.mask] = places[k]
        angle = np.append(workspace.angles, 2 * np.pi)
        x, y = (workspace.radii[:, None] * turn(angle) for turn in (np.cos, np.sin))
        base = (robot.cell.nominal.x0, robot.cell.nominal.y0)
        values = np.concatenate([values, values[:, :1]], axis=1)
        drawn = axes[k].pcolormesh(
            x + base[0], y + base[1], np.ma.masked_invalid(values), shading='gouraud', cmap=COLOURS, vmin=low,
            vmax=high, rasterized=True,
        )  # fmt: skip
        _discs(axes[k], robot.cell.discs, INK)
        axes[k].set(aspect='equal', xlabel='x  [m]', title=name)
        axes[k].grid(visible=False)
        axes[k].plot(*base, 'o', ms=6, mfc=PAPER, mec=INK)
    axes[0].set(ylabel='y  [m]')
    figure.colorbar(drawn, ax=axes, label='std of the tip  [µm]', shrink=0.85).outline.set_visible(False)
    return as_svg(figure, 'tip', 'standard deviation of the tip over the workspace, both postures')


def plan_picture(design: Design) -> Markup:
    """The chosen touches from above: arrows as long as the forces, filled heads for the left posture."""
    figure, (axes,) = new_figure(HALF, 400)
    cell, plan = design.robot.cell, design.recommended.plan
    contact, normal = plan.contact(cell), plan.normal()
    for number, disc in enumerate(cell.discs):
        look = mark(number)
        axes.add_patch(Circle((disc.x, disc.y), disc.radius, facecolor=look.colour, alpha=0.13, lw=0))
        axes.add_patch(Circle((disc.x, disc.y), disc.radius, fill=False, edgecolor=look.colour, lw=1.2))
        axes.text(disc.x, disc.y, disc.name, ha='center', va='center', color=INK).set_parse_math(False)
        for k in np.flatnonzero(plan.disc == number):
            aside = 0.005 * plan.posture[k] * np.array([-normal[k, 1], normal[k, 0]])
            head = contact[k] + aside
            tail = head + 0.16 * plan.force[k] / plan.force.max() * normal[k]  # m, of the largest force
            axes.plot(*np.stack([head, tail]).T, color=look.colour, lw=1.1, alpha=0.8)
            fill = look.colour if plan.posture[k] > 0 else PAPER
            axes.plot(*head, look.shape, ms=5.5, mfc=fill, mec=look.colour, mew=1.2, zorder=3)
    base = (cell.nominal.x0, cell.nominal.y0)
    axes.plot(*base, 'o', ms=7, mfc=PAPER, mec=INK, mew=1.4)
    axes.annotate('base', base, (9, 4), textcoords='offset points', color=FAINT)
    axes.set(aspect='equal', xlabel='x  [m]', ylabel='y  [m]')
    return as_svg(figure, 'recommended', 'the chosen touches from above')


def additional_disc_picture(design: Design) -> Markup:
    """Largest standard deviation of the tip by the place of one additional disc."""
    figure, (axes,) = new_figure(HALF, 400)
    m, cell = design.additional_disc, design.robot.cell
    shown = MICRO * np.ma.masked_invalid(m.largest)
    drawn = axes.pcolormesh(m.x, m.y, shown, shading='nearest', cmap=COLOURS, rasterized=True)
    _discs(axes, cell.discs, INK)
    best = m.best
    if best is not None:
        axes.add_patch(Circle(best[:2], m.radius, fill=False, edgecolor=SERIES[1], lw=2.0))
        axes.plot(*best[:2], '+', ms=9, color=SERIES[1], mew=2)
    axes.plot(cell.nominal.x0, cell.nominal.y0, 'o', ms=6, mfc=PAPER, mec=INK)
    axes.set(aspect='equal', xlabel='x of its centre  [m]', ylabel='y  [m]')
    axes.grid(visible=False)
    figure.colorbar(drawn, ax=axes, label='largest std of the tip  [µm]', shrink=0.85).outline.set_visible(False)
    return as_svg(
        figure, 'additional_disc', 'largest standard deviation of the tip by the place of one additional disc'
    )


def placed_picture(design: Design) -> Markup:
    """The best new layouts of one disc, two, …."""
    layouts = [placed for placed in design.placed if placed.row is not None]
    figure = Figure(figsize=(WIDTH / 72, (WIDTH / max(2, len(layouts)) + 24) / 72), dpi=72, layout='constrained')
    axes = figure.subplots(1, len(layouts), sharey=True, squeeze=False)[0]
    nominal = design.robot.cell.nominal
    base = (nominal.x0, nominal.y0)
    least, most = reach(design.robot)
    discs = [disc for placed in layouts for disc in placed.layout.discs]
    wide = 1.05 * max(most, *(max(abs(d.x - base[0]), abs(d.y - base[1])) + d.radius for d in discs))
    for one, placed in zip(axes, layouts, strict=True):
        for radius in (least, most):
            one.add_patch(Circle(base, radius, fill=False, edgecolor=LINE, lw=1.0))
        for number, disc in enumerate(placed.layout.discs):
            colour = mark(number).colour
            one.add_patch(Circle((disc.x, disc.y), disc.radius, facecolor=colour, alpha=0.2, lw=0))
            one.add_patch(Circle((disc.x, disc.y), disc.radius, fill=False, edgecolor=colour, lw=1.4))
        one.plot(*base, 'o', ms=6, mfc=PAPER, mec=INK)
        largest = placed.row.free.largest if placed.row else np.inf
        said = f'{MICRO * largest:.3g} µm' if np.isfinite(largest) else 'tip not determined'
        number = len(placed.layout.discs)
        one.set(aspect='equal', xlabel='x  [m]', title=f'{number} disc{"s" if number > 1 else ""}: {said}')
        one.set_xlim(base[0] - wide, base[0] + wide)
        one.set_ylim(base[1] - wide, base[1] + wide)
    axes[0].set(ylabel='y  [m]')
    return as_svg(figure, 'placed', 'best layouts of discs by their number')


def _discs(axes: Axes, discs: Iterable[Disc], colour: str) -> None:
    for disc in discs:
        axes.add_patch(Circle((disc.x, disc.y), disc.radius, fill=False, edgecolor=colour, lw=1.1))
