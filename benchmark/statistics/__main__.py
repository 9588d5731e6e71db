"""The calibration as an estimator: efficiency, coverage, random starts, outliers.

    python -m benchmark.statistics [--runs N] [--only SECTION] [--jobs N] [--json FILE] [--plot FILE]

All touches are simulated, by this package's own simulator: the paper's cell, three force levels, both postures, 72
touches; robots of table 2 and of figure 4(d); noise of 1e-5 rad and 0.3 N, given and estimated. Sections:

- efficiency: the variance of each parameter over its Cramér–Rao bound, which `bound` derives independently;
- coverage: the part of the 95 % intervals that hold the truth, of the same runs;
- starts: nominal values far off, an eighth as many as there are runs, the same touches: do all converge to one optimum;
- outliers: one touch in ten bad, of 72 and of 108, a sixteenth as many runs: growth of the std, rejections.

The sampling error of a variance is 1.6 % with 8000 runs; with 2000 it is 3.2 %, and the largest of 48 ratios may lie
three times as far off.

All of it takes about half an hour on one core, most of it for the outliers.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmark.common import NOISES, ROBOTS, in_processes, parser, save
from benchmark.statistics.outliers import run_task
from benchmark.statistics.runs import Task, setup_of
from benchmark.statistics.summary import noise_summary, outlier_summary, starts_summary, tables

SECTIONS = ('efficiency', 'coverage', 'starts', 'outliers')
SHOWN_IN: dict[str, tuple[str, ...]] = {
    'noise': ('efficiency', 'coverage'),
    'starts': ('starts',),
    'outliers': ('outliers',),
}
FEWER = {'noise': 1, 'starts': 8, 'outliers': 16}
PER_DISC = {'noise': (12,), 'starts': (12,), 'outliers': (12, 18)}
AT_ONCE = 25
"""Runs of one task."""


def tasks(runs: int, only: str | None) -> list[Task]:
    """The runs to make."""
    listed = []
    for section, shown in SHOWN_IN.items():
        if only and only not in shown:
            continue
        number = max(2, runs // FEWER[section])
        for robot in ROBOTS:
            for noise in NOISES:
                for per_disc in PER_DISC[section]:
                    parts = (range(first, min(first + AT_ONCE, number)) for first in range(0, number, AT_ONCE))
                    listed += [Task(section, robot, noise, per_disc, seeds) for seeds in parts]
    return listed


def run(listed: Sequence[Task], jobs: int) -> dict[tuple[str, str, str, int], list[Any]]:
    """The runs by section, robot, noise and points per disc."""
    records: dict[tuple[str, str, str, int], list[Any]] = {}
    for task, found in zip(listed, in_processes(run_task, listed, jobs), strict=True):
        records.setdefault(task[:4], []).extend(found)
    return records


def summarise(records: dict[tuple[str, str, str, int], list[Any]], only: str | None = None) -> dict[str, Any]:
    """The figures of each section, by robot, noise and, where it differs, touches."""
    summary: dict[str, Any] = {}
    for (section, robot, noise, per_disc), runs in records.items():
        key, setup = f'{robot}, {noise}', setup_of(robot, per_disc)
        if section == 'noise':
            figures = noise_summary(runs, setup)
        elif section == 'starts':
            figures = starts_summary(runs)
        else:
            key, figures = f'{key}, {len(setup.plan)} touches', outlier_summary(runs)
        for shown in SHOWN_IN[section]:
            if only in (None, shown):
                summary.setdefault(shown, {})[key] = figures
    return summary


def parse() -> argparse.Namespace:
    """The options."""
    options = parser(__doc__)
    options.add_argument('--runs', type=int, default=8000, help='calibrations of each robot and noise (default: 8000)')
    options.add_argument('--only', choices=SECTIONS)
    options.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    options.add_argument('--plot', type=Path, help='draw the outcome there, .svg or .png')
    return options.parse_args()


def main() -> int:
    """Run, print, save, draw."""
    options = parse()
    summary = summarise(run(tasks(options.runs, options.only), options.jobs), options.only)
    print('\n'.join(tables(summary)))
    save(options.json, summary)
    if options.plot:
        from benchmark.statistics.picture import draw

        draw(summary, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())
