"""Pictures of the design study: accuracy by the number of touches, proofs of the set, radii and places of discs."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import NDArray

from scara_kinetostatic.render.figure import FAINT, INK, PAPER, SERIES, WARN, as_svg, mark, new_figure
from scara_kinetostatic.studies.design.solution import Design

Floats = NDArray[np.float64]

WIDTH, HALF = 920.0, 450.0
MICRO = 1e6
TICKS = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 300, 500, 1000)


def number_picture(design: Design) -> Markup:
    """Largest standard deviation of the tip over the number of touches: chosen, spread, random, and the bound."""
    figure, (axes,) = new_figure(WIDTH, 360)
    c, target = design.curve, MICRO * design.question.accuracy
    n = c.number
    low, middle, high = MICRO * c.random.T
    top = 8 * target
    axes.fill_between(n, low, np.minimum(high, 2 * top), color=FAINT, alpha=0.16, lw=0)
    axes.plot(n, middle, color=FAINT, lw=1.2)
    axes.plot(n, MICRO * c.spread, color=SERIES[1], lw=1.4, ls=(0, (5, 2.5)))
    axes.plot(n, MICRO * c.bound, color=INK, lw=1.0, ls=(0, (1, 2)))
    axes.plot(n, MICRO * c.chosen, 'o-', color=SERIES[0], lw=1.6, ms=5)
    axes.axhline(target, color=WARN, lw=1.0)
    axes.plot(len(design.smallest.plan), MICRO * design.smallest.value, 'o', ms=11, mfc='none', mec=WARN, mew=1.6)
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_ylim(0.74 * MICRO * float(c.bound.min()), top)
    axes.set_xlim(0.96 * n[0], 1.3 * n[-1])
    _plain_ticks(axes)
    axes.xaxis.set_major_locator(FixedLocator(n.tolist()))
    axes.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.set(xlabel='touches', ylabel='largest std of the tip  [µm]')
    ends = {'random sets, 5 to 95 %': (middle, FAINT), 'spread evenly': (MICRO * c.spread, SERIES[1]),
            'chosen': (MICRO * c.chosen, SERIES[0]), 'no set below': (MICRO * c.bound, INK)}  # fmt: skip
    _labels(axes, n[-1], ends)
    axes.annotate('asked for', (n[-1], target), (6, 4), textcoords='offset points', color=WARN)
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
    axes.yaxis.set_major_locator(FixedLocator(list(TICKS)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f'{value:g}')


def without_picture(design: Design) -> Markup:
    """What is left of the accuracy without each touch of the smallest set."""
    figure, (axes,) = new_figure(HALF, 300)
    values, plan = MICRO * design.smallest.check.without_each, design.smallest.plan
    target, base = MICRO * design.question.accuracy, MICRO * design.smallest.value
    axes.vlines(np.arange(len(plan)), base, values, color=FAINT, lw=1.2)
    for k, value in enumerate(values):
        look = mark(int(plan.disc[k]))
        fill = look.colour if plan.posture[k] > 0 else PAPER
        axes.plot(k, value, look.shape, ms=6, mfc=fill, mec=look.colour, mew=1.2)
    axes.axhline(target, color=WARN, lw=1.0)
    axes.axhline(base, color=SERIES[0], lw=1.0)
    axes.set(xlabel='touch left out', ylabel='largest std of the tip  [µm]', yscale='log')
    axes.set_ylim(0.93 * base, 1.15 * max(float(values.max()), target))
    axes.set_xticks(np.arange(0, len(plan), max(1, len(plan) // 12)))
    _plain_ticks(axes)
    axes.grid(visible=False, axis='x')
    return as_svg(figure, 'without', 'largest standard deviation of the tip without each touch')


def random_picture(design: Design) -> Markup:
    """How random sets of as many touches do."""
    figure, (axes,) = new_figure(HALF, 300)
    values = MICRO * design.smallest.check.random
    base = MICRO * design.smallest.value
    edges = np.geomspace(0.9 * base, min(float(values.max()), 40 * base) * 1.02, 32)
    axes.hist(np.minimum(values, edges[-1] * 0.999), bins=edges.tolist(), color=FAINT, alpha=0.55)
    axes.axvline(base, color=SERIES[0], lw=2.0)
    axes.axvline(MICRO * design.question.accuracy, color=WARN, lw=1.0)
    axes.set_xscale('log')
    axes.set(xlabel='largest std of the tip  [µm]', ylabel=f'of {len(values)} random sets')
    axes.xaxis.set_major_locator(FixedLocator(list(TICKS)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.set_xlim(0.8 * base, edges[-1] * 1.1)
    return as_svg(figure, 'random', 'distribution of the largest standard deviation of the tip over random sets')
