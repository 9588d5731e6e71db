"""The outcome of the study of the diagnosis, drawn: naming, errors before and after, true against named effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmark.diagnosis.record import NAMINGS, WITHIN, Record
from benchmark.diagnosis.tables import REFERENCE_SIZE
from benchmark.svg import light_colours
from scara_kinetostatic.report.figure import FAINT, INK, LINE, SERIES, WARN, style

Pick = Callable[[Record, int], float]

WIDTH, HEIGHT_EACH, HEIGHT_REST = 15.0, 0.34, 1.6
"""Of a picture, of each of its rows and of the rest, inches."""
OTHERS = ('unnamed structure', 'nothing')


def draw(records: Sequence[Record], path: Path) -> None:
    """Draw single effects into a file, .svg or .png by its name; the sizes other than `SHOWN` only in the matrix."""
    every = [r for r in records if r.section == 'effects' and r.verdict]
    shown = [r for r in every if r.size == REFERENCE_SIZE]
    kinds = list(dict.fromkeys(_kind(r.simulated[0]) for r in every))
    labels = sorted({r.simulated[0] for r in every}, key=lambda label: (kinds.index(_kind(label)), label))[::-1]
    palette = light_colours()
    with style():
        mpl.rcParams.update({key: palette.get(str(value), value) for key, value in mpl.rcParams.items()})
        height = 2 * (HEIGHT_REST + HEIGHT_EACH * max(len(labels), 3))
        figure = Figure(figsize=(WIDTH, height), layout='constrained', facecolor='white')
        halves = figure.add_gridspec(2, 1)
        above, below = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
        first, second, third = above.subplots(1, 3, sharey=True)
        _naming(first, shown, labels, palette)
        _errors(second, shown, labels, palette, lambda r, k: r.held_out[k] / r.held_out[2])
        second.set(title='held-out error over that of the true model', xlabel='before (open), after (full)')
        _errors(third, shown, labels, palette, lambda r, k: r.z[k])
        third.set(title='largest |z| of the base model', xlabel='before (open), after (full)', xscale='log')
        third.xaxis.set_major_formatter('{x:g}')
        third.axvline(WITHIN, color=palette[WARN], lw=1)
        _matrix(below.subplots(), every, labels, palette)
        above.suptitle(f'Single effects that bring the reduced chi-square to {REFERENCE_SIZE:g}; simulated touches')
        figure.savefig(path)


def _kind(label: str) -> str:
    return label.split('[')[0]


def _naming(ax: Axes, records: Sequence[Record], labels: Sequence[str], palette: dict[str, str]) -> None:
    colours = dict(zip(NAMINGS, (SERIES[0], SERIES[4], SERIES[3], WARN, FAINT), strict=True))
    left = np.zeros(len(labels))
    for name in NAMINGS:
        share = np.array([_share([r for r in records if r.simulated[0] == label], name) for label in labels])
        ax.barh(range(len(labels)), share, left=left, color=palette[colours[name]], label=name, height=0.7)
        left += share
    ax.set_yticks(range(len(labels)), labels)
    ax.set(title='how it is named', xlabel='part of the recordings', xlim=(0, 1), ylim=(-0.6, len(labels) - 0.4))
    ax.legend(ncols=len(NAMINGS), loc='lower left', bbox_to_anchor=(-0.75, -0.11), frameon=False, handlelength=1.0)


def _share(records: Sequence[Record], name: str) -> float:
    return sum(r.naming.get(r.simulated[0]) == name for r in records) / max(len(records), 1)


def _errors(ax: Axes, records: Sequence[Record], labels: Sequence[str], palette: dict[str, str], pick: Pick) -> None:
    """Medians and ranges, before and after."""
    for row, label in enumerate(labels):
        some = [r for r in records if r.simulated[0] == label]
        for k, colour in ((0, FAINT), (1, SERIES[0])):
            values = np.array([pick(r, k) for r in some])
            values = values[np.isfinite(values)]
            if not len(values):
                continue
            shift = row + (0.15 if k == 0 else -0.15)
            ax.plot([values.min(), values.max()], [shift, shift], color=palette[colour], lw=1)
            face = 'white' if k == 0 else palette[colour]
            ax.plot(np.median(values), shift, 'o', ms=5, mfc=face, mec=palette[colour])


def _matrix(ax: Axes, records: Sequence[Record], labels: Sequence[str], palette: dict[str, str]) -> None:
    """Simulated against named: full where it was named alone, open among rivals; the area is the part of recordings."""
    columns = [*labels[::-1], *OTHERS]
    for row, label in enumerate(labels):
        some = [r for r in records if r.simulated[0] == label]
        sure = Counter(_column(name, columns) for r in some for name in r.named or (() if r.rivals else ('',)))
        rivals = Counter(_column(name, columns) for r in some for group in r.rivals for name in group)
        for counts, full in ((rivals, False), (sure, True)):
            for column, count in counts.items():
                hit = columns[column] == label
                colour = palette[SERIES[0] if hit else WARN if full else INK]
                area = 150 * count / len(some)
                ax.scatter(column, row, s=area, facecolor=colour if full else 'none', edgecolor=colour, zorder=3)
    ax.set_xticks(range(len(columns)), columns, rotation=60, ha='right', rotation_mode='anchor')
    ax.set_yticks(range(len(labels)), labels)
    ax.set(xlim=(-0.6, len(columns) - 0.4), ylim=(-0.6, len(labels) - 0.4), ylabel='simulated', xlabel='named')
    ax.set(title='named alone (full), among rivals (open); the area is the part of the recordings, all sizes')
    ax.grid(color=palette[LINE], lw=0.5)


def _column(name: str, columns: Sequence[str]) -> int:
    """Place of a name; structure without a name is all one."""
    if name in columns:
        return columns.index(name)
    return columns.index(OTHERS[0] if name else OTHERS[1])
