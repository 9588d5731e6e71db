"""The picture of `peers`: time over touches, both logarithmic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

COLORS = {
    'package': '#0b6e99',
    'minimisation': '#56b4e9',
    'casadi angles': '#d55e00',
    'casadi forces': '#e69f00',
    'scipy': '#666666',
    'scipy scalars': '#aaaaaa',
}


def draw_times(records: list[dict[str, Any]], path: Path) -> None:
    """Median time of each contender over the number of touches, with the quartiles, as SVG."""
    with matplotlib.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'peers', 'font.size': 9}):
        figure = Figure(figsize=(6.4, 4.0), layout='constrained')
        axes = figure.add_subplot()
        for name in dict.fromkeys(record['contender'] for record in records):
            rows = sorted((r for r in records if r['contender'] == name), key=lambda record: int(record['touches']))
            touches, median = [r['touches'] for r in rows], [r['median'] for r in rows]
            error = [[m - r['quartiles'][0] for m, r in zip(median, rows, strict=True)],
                     [r['quartiles'][1] - m for m, r in zip(median, rows, strict=True)]]  # fmt: skip
            axes.errorbar(touches, median, error, marker='o', ms=4, lw=1.2, color=COLORS[name], label=name)
        axes.set(xscale='log', yscale='log', xlabel='touches', ylabel='processor time, s')
        axes.grid(alpha=0.3)
        axes.legend(frameon=False)
        figure.savefig(path, format='svg', metadata={'Date': None})
