"""The outcome of `statistics`, drawn: variances over the bound, coverage, growth by outliers, naming by size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.statistics.outliers import CASES, LEFT_OUT
from benchmark.statistics.summary import COVERED, EFFICIENT, GROWTH, LEVEL, sizes_of
from benchmark.svg import light_colours
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.report.figure import INK, LINE, SERIES, WARN, style

Part = dict[str, Any]
Panel = Callable[[Axes, Part, dict[str, str]], None]

WIDTH, HEIGHT = 14.0, 5.0
"""Of a picture and of each of its rows, inches."""
SPREAD = 0.6
"""Room for the series beside each other, of the distance between two places."""


def draw(summary: Part, path: Path) -> None:
    """Draws the figures into a file, .svg or .png by its name."""
    panels: list[tuple[str, Panel]] = [('efficiency', _efficiency), ('coverage', _coverage)]
    panels += [('outliers', _growth), ('outliers', _naming)]
    shown = [(key, panel) for key, panel in panels if summary.get(key)]
    if not shown:
        return
    palette = light_colours()
    with style():
        mpl.rcParams.update({key: palette.get(str(value), value) for key, value in mpl.rcParams.items()})
        rows = -(-len(shown) // 2)
        figure = Figure(figsize=(WIDTH, HEIGHT * rows), layout='constrained', facecolor='white')
        axes = figure.subplots(rows, 2, squeeze=False).ravel()
        for ax, (key, panel) in zip(axes, shown, strict=False):
            panel(ax, summary[key], palette)
            ax.legend(frameon=False, fontsize='small', ncols=2, loc='upper center', bbox_to_anchor=(0.5, -0.08))
        for ax in axes[len(shown) :]:
            ax.set_visible(False)
        figure.suptitle('Statistics of the calibration; all touches are simulated')
        figure.savefig(path)


def _places(number: int, count: int, of: int) -> np.ndarray[Any, Any]:
    """Where one series of `of` is drawn over so many places."""
    return np.arange(count) + SPREAD * ((number + 0.5) / of - 0.5)


def _names(ax: Axes) -> None:
    ax.set_xticks(range(len(NAMES)), NAMES)


def _efficiency(ax: Axes, parts: Part, palette: dict[str, str]) -> None:
    for number, (key, part) in enumerate(parts.items()):
        values, x = part['variance_over_bound'], _places(number, len(NAMES), len(parts))
        colour = palette[SERIES[number]]
        ax.errorbar(x, list(values.values()), part['sampling_error'], fmt='o', ms=4, color=colour, label=key)
        same = part['variance_over_ideal_of_same_noise']
        ax.plot(x, list(same.values()), '_', ms=7, color=palette[INK])
    ax.axhline(1.0, color=palette[INK], lw=0.8)
    ax.axhline(EFFICIENT, color=palette[WARN], lw=0.8)
    title = 'variance over the Cramér–Rao bound, ± sampling error; dashes: without it'
    ax.set_title(title, fontsize='small')
    _names(ax)


def _coverage(ax: Axes, parts: Part, palette: dict[str, str]) -> None:
    for number, (key, part) in enumerate(parts.items()):
        rates = [100 * part['coverage']['normal'][name] for name in NAMES]
        x, error = _places(number, len(NAMES), len(parts)), 100 * part['coverage_sampling_error']
        ax.errorbar(x, rates, error, fmt='o', ms=4, color=palette[SERIES[number]], label=key)
        same = [100 * part['coverage']['normal_of_same_noise'][name] for name in NAMES]
        ax.plot(x, same, '_', ms=7, color=palette[INK])
    ax.axhline(100 * LEVEL, color=palette[INK], lw=0.8)
    for limit in COVERED:
        ax.axhline(100 * limit, color=palette[WARN], lw=0.8)
    ax.set_title('95 % intervals that hold the truth, %, ± sampling error; dashes: without it', fontsize='small')
    _names(ax)


def _growth(ax: Axes, parts: Part, palette: dict[str, str]) -> None:
    labels = [LEFT_OUT, *CASES]
    for number, (key, part) in enumerate(parts.items()):
        cases = [part['cases'][label] for label in labels]
        y, colour = _places(number, len(labels), len(parts)), palette[SERIES[number % len(SERIES)]]
        face = colour if number < len(SERIES) else 'white'
        largest = [100 * case['growth_largest'] for case in cases]
        ax.plot(largest, y, 'o', ms=4, color=colour, mfc=face, label=key)
    ax.axvline(100 * GROWTH, color=palette[WARN], lw=0.8)
    ax.set_yticks(range(len(labels)), labels)
    ax.invert_yaxis()
    ax.set_title(
        'one touch in ten bad: growth of the standard deviation, %, largest of the parameters', fontsize='small'
    )


def _naming(ax: Axes, parts: Part, palette: dict[str, str]) -> None:
    for number, (key, part) in enumerate(parts.items()):
        rows, colour = part['named_by_size'], palette[SERIES[number % len(SERIES)]]
        share = [100 * row['named'] / row['bad'] if row['bad'] else np.nan for row in rows]
        line = '-' if number < len(SERIES) else '--'
        ax.plot(range(len(rows)), share, line, marker='o', ms=4, color=colour, label=key)
        ax.set_xticks(range(len(rows)), [sizes_of(row) for row in rows])
    ax.set_title('bad touches that are rejected, %, by their size in standard deviations', fontsize='small')
    ax.grid(color=palette[LINE], lw=0.5)
