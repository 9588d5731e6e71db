"""Figures of the reproduction: force error over the iterations, unidentifiable direction, noise, Monte Carlo study."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.report.figure import FAINT, INK, LINE, PAPER, SERIES, as_svg, new_figure
from scara_kinetostatic.studies.paper.study import Reproduction
from scara_kinetostatic.studies.paper.table_2 import (
    ESTIMATED,
    ESTIMATED_FROM_NOISE,
    FORCE,
    FORCE_ERROR,
    FORCE_ERROR_RANGE,
    determined_combination,
    expected_force_error,
)

WIDTH, HALF = 920.0, 450.0
_SMALLEST = 1e-13


def trend_picture(r: Reproduction) -> Markup:
    """e_f over the iterations (figure 3), one force level and three."""
    figure, (axes,) = new_figure(WIDTH, 330)
    lines = (
        (r.exact.paper.history, SERIES[0], 'o', '-', 'one level, unilateral contact (10)'),
        (r.exact.paper.merit, SERIES[0], '', ':', 'the same, two-sided contact'),
        (r.exact_levels.paper.history, SERIES[1], 's', '-', 'three levels, unilateral contact'),
    )
    for values, colour, shape, dash, label in lines:
        shown = np.maximum(values, _SMALLEST)
        axes.plot(np.arange(len(shown)), shown, dash, marker=shape or None, ms=5, color=colour, label=label)
    axes.axhline(FORCE_ERROR, color=FAINT, lw=1, ls='--')
    axes.text(0.05, FORCE_ERROR * 1.6, f'the paper: {FORCE_ERROR:.3g} N at its end', color=FAINT)
    axes.set(yscale='log', xlabel='iteration', ylabel='force error $e_f$  [N]')
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, loc='lower left')
    axes.set_xlim(left=-0.2)
    return as_svg(figure, 'trend', 'force error over the iterations of the algorithm of the paper')


def unidentifiable_picture(r: Reproduction) -> Markup:
    """The plane of p_ee and g_ee: one force level determines only a linear combination."""
    figure, (axes,) = new_figure(HALF, 380)
    p = np.array([0.75e-5, 1.75e-5])
    truth = determined_combination(PAPER_ACTUAL.as_array())
    axes.plot(1e6 * p, 1e6 * (FORCE * p - truth), color=FAINT, lw=1)
    axes.annotate(
        '40 $p_{ee}$ − $g_{ee}$ = 345 µm', (13.4, 1e6 * (FORCE * 13.4e-6 - truth)), (13.2, 60), color=FAINT,
        arrowprops={'arrowstyle': '-', 'color': LINE},
    )  # fmt: skip
    points = (
        (PAPER_NOMINAL, 'nominal', FAINT, 'o', (6, -14)),
        (PAPER_ACTUAL, 'actual', INK, 'o', (-8, 10)),
        (ESTIMATED, 'paper, without noise', SERIES[1], 's', (8, -4)),
        (ESTIMATED_FROM_NOISE, 'paper, with noise', SERIES[1], '^', (-112, 2)),
        (r.exact.weighted.parameters, 'weighted, nearest to nominal', SERIES[0], 'D', (6, 8)),
    )
    for values, label, colour, shape, offset in points:
        x, y = 1e6 * values.p_ee, 1e6 * values.g_ee
        axes.plot([x], [y], shape, ms=6, color=colour, mec=PAPER, mew=0.6)
        axes.annotate(label, (x, y), offset, textcoords='offset points', color=colour, fontsize=11)
    axes.set(xlabel='$p_{ee}$  [µm/N]', ylabel='$g_{ee}$  [µm]', xlim=(7.5, 17.5), ylim=(-40, 340))
    return as_svg(figure, 'unidentifiable', 'estimates of p_ee and g_ee lie on one line')


def noise_picture(r: Reproduction) -> Markup:
    """Noise of joints and forces for which e_f is that of the paper, one force level."""
    figure, (axes,) = new_figure(HALF, 380)
    ratios = np.concatenate([[0.0], np.logspace(-6.5, -2, 19), [1e3]])
    units = np.array([expected_force_error(r.one_level, Noise(ratio, 1.0))[0] for ratio in ratios])
    low, high = ((ratios * level / units, level / units) for level in FORCE_ERROR_RANGE)
    ring = [np.concatenate([a, b[::-1]]) for a, b in zip(low, high, strict=True)]
    axes.fill(1e6 * ring[0], ring[1], color=SERIES[0], alpha=0.25, lw=0)
    axes.annotate(
        '$e_f$ = 1.25 … 1.35 N', (1e6 * low[0][13], high[1][13]), (12, 0.35), color=SERIES[0],
        arrowprops={'arrowstyle': '-', 'color': LINE},
    )  # fmt: skip
    axes.plot([1e6 * r.noise.joint_rms], [r.noise.force_rms], 'o', color=SERIES[1], ms=6)
    axes.annotate('used', (1e6 * r.noise.joint_rms, r.noise.force_rms), (-42, -4), textcoords='offset points',
                  color=SERIES[1])  # fmt: skip
    axes.set(xlabel='noise of a joint angle  [µrad]', ylabel='noise of a force component  [N]')
    axes.set_xlim(0, 65)
    axes.set_ylim(0, 1.3)
    return as_svg(figure, 'noise', 'joint and force noise that lead to the force error of the paper')


def scatter_picture(r: Reproduction) -> Markup:
    """Standard deviation found over that predicted, parameter by parameter, both estimators."""
    figure, (axes,) = new_figure(WIDTH, 300)
    place = np.arange(len(NAMES))
    error = r.monte_carlo.weighted.sampling_error
    axes.axhspan(1 - 2 * error, 1 + 2 * error, color=FAINT, alpha=0.15, lw=0)
    axes.axhline(1, color=FAINT, lw=0.9)
    for item, colour, shape, shift, label in (
        (r.monte_carlo.paper, SERIES[1], 's', -0.1, 'unweighted (the paper)'),
        (r.monte_carlo.weighted, SERIES[0], 'o', 0.1, 'weighted'),
    ):
        axes.plot(place + shift, item.found / item.predicted, shape, color=colour, ms=6, label=label)
    axes.set_xticks(place, NAMES)
    axes.set(ylabel='std found / predicted', ylim=(0.88, 1.12))
    axes.grid(visible=False, axis='x')
    axes.legend(frameon=False, loc='upper right', ncols=2)
    return as_svg(figure, 'scatter', 'standard deviation of the estimates found over that predicted')


def efficiency_picture(r: Reproduction) -> Markup:
    """Standard deviation of the weighted over the unweighted estimate."""
    figure, (axes,) = new_figure(WIDTH, 230)
    place = np.arange(len(NAMES))
    predicted = r.monte_carlo.weighted.predicted / r.monte_carlo.paper.predicted
    axes.bar(place, predicted, width=0.55, color=SERIES[0], alpha=0.3, label='predicted')
    axes.plot(place, np.sqrt(r.monte_carlo.efficiency), 'o', color=SERIES[0], ms=6, label='found')
    axes.axhline(1, color=FAINT, lw=0.9)
    axes.set_xticks(place, NAMES)
    axes.set(ylabel='std weighted / unweighted', ylim=(0.6, 1.1))
    axes.grid(visible=False, axis='x')
    axes.legend(frameon=False, loc='upper right', ncols=2)
    return as_svg(figure, 'efficiency', 'standard deviation of the weighted over the unweighted estimate')
