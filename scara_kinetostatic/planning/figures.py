"""Figures of the optimal design: accuracy by the number of touches, checks of the set, maps of the tip and of discs."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator, NullLocator

from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.planning.optimal_design import Design
from scara_kinetostatic.planning.prediction import free_tip, loaded_tip, make_workspace, tip_std
from scara_kinetostatic.report.figure import (
    FAINT,
    INK,
    MICRO,
    PAPER,
    SERIES,
    WARN,
    as_svg,
    draw_object,
    in_mm,
    mark,
    new_figure,
)

WIDTH, HALF = 920.0, 450.0
_TICKS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 300, 500, 1000)


def number_picture(design: Design) -> Markup:
    """Largest standard deviation of the tip over the number of touches: best, even, and the lower bound."""
    figure, (axes,) = new_figure(WIDTH, 360)
    c, target = design.curve, MICRO * design.accuracy
    curves = (
        ('evenly distributed', c.even, {'color': SERIES[1], 'ls': (0, (5, 2.5))}),
        ('best set found', c.chosen, {'color': SERIES[0], 'marker': 'o'}),
        ('lower bound', c.bound, {'color': INK, 'ls': (0, (1, 2))}),
    )
    for label, values, look in curves:
        axes.plot(c.number, MICRO * values, label=label, lw=1.4, **look)
    axes.axhline(target, color=WARN, lw=1.0, label='required')
    best = (len(design.plan), MICRO * design.tip_std.largest)
    axes.plot(*best, 'o', ms=11, mfc='none', mec=WARN, mew=1.6)
    axes.annotate('recommended', best, (9, 7), textcoords='offset points', color=WARN)
    axes.set(xscale='log', yscale='log', xlabel='touches', ylabel='largest std of the tip  [µm]')
    for axis, ticks in ((axes.xaxis, c.number.tolist()), (axes.yaxis, _TICKS)):
        axis.set_major_locator(FixedLocator(list(ticks)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.legend(frameon=False)
    return as_svg(figure, 'number', 'largest standard deviation of the tip over the number of touches')


COLOURS = 'viridis_r'


def tip_picture(design: Design) -> Markup:
    """The standard deviation of the tip over the workspace after the recommended set, posture by posture."""
    figure = Figure(figsize=(WIDTH / 72, 430 / 72), dpi=72, layout='constrained')
    axes = figure.subplots(1, 2, sharey=True)
    robot, q = design.robot, design.requirements
    workspace = make_workspace(robot, radii=24, angles=120)
    tip = loaded_tip(robot, workspace, q.load) if q.under_load else free_tip(robot, workspace)
    places = MICRO * tip_std(tip, design.row.prediction).places
    low, high = float(places.min()), float(places.max())
    every = np.full(workspace.mask.shape, np.nan)
    every[workspace.mask] = places
    for k, name in enumerate(('posture left', 'posture right')):
        angle = np.append(workspace.angles, 2 * np.pi)
        x, y = (workspace.radii[:, None] * turn(angle) for turn in (np.cos, np.sin))
        base = (robot.cell.nominal.x0, robot.cell.nominal.y0)
        values = np.concatenate([every[k], every[k][:, :1]], axis=1)
        drawn = axes[k].pcolormesh(
            x + base[0], y + base[1], np.ma.masked_invalid(values), shading='gouraud', cmap=COLOURS, vmin=low,
            vmax=high, rasterized=True,
        )  # fmt: skip
        _discs(axes[k], robot.cell.discs, INK)
        axes[k].set(aspect='equal', xlabel='x  [mm]', title=name)
        in_mm(axes[k])
        axes[k].grid(visible=False)
        axes[k].plot(*base, 'o', ms=6, mfc=PAPER, mec=INK)
    axes[0].set(ylabel='y  [mm]')
    figure.colorbar(drawn, ax=axes, label='std of the tip  [µm]', shrink=0.85).outline.set_visible(False)
    return as_svg(figure, 'tip', 'standard deviation of the tip over the workspace, both postures')


def plan_picture(design: Design) -> Markup:
    """The chosen touches from above: arrows as long as the forces, filled heads for the left posture."""
    figure, (axes,) = new_figure(HALF, 400)
    cell, plan = design.robot.cell, design.plan
    contact, normal = plan.contact(cell), plan.normal(cell)
    for number, disc in enumerate(cell.discs):
        look = mark(number)
        draw_object(axes, disc, look.colour, filled=True)
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
    axes.annotate('base', base, (-9, 4), ha='right', textcoords='offset points', color=FAINT)
    axes.set(aspect='equal', xlabel='x  [mm]', ylabel='y  [mm]')
    in_mm(axes)
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
    axes.set(aspect='equal', xlabel='x of its centre  [mm]', ylabel='y  [mm]')
    in_mm(axes)
    axes.grid(visible=False)
    figure.colorbar(drawn, ax=axes, label='largest std of the tip  [µm]', shrink=0.85).outline.set_visible(False)
    return as_svg(
        figure, 'additional_disc', 'largest standard deviation of the tip by the place of one additional disc'
    )


def _discs(axes: Axes, discs: Iterable[Disc | Outline], colour: str) -> None:
    for disc in discs:
        draw_object(axes, disc, colour, width=1.1)
