"""How good the calibration is as an estimator: efficiency, coverage, random starts, outliers.

    python -m benchmark.statistics [--runs N] [--only SECTION] [--jobs N] [--json FILE] [--plot FILE]

All touches are simulated, by this package's own simulator: the paper's cell, three force levels, both postures, 72
touches; robots of table 2 and of figure 4(d); noise of 1e-5 rad and 0.3 N, given and estimated. Sections:

- efficiency: the variance of each of the twelve over its Cramér–Rao bound, which `bound` works out anew;
- coverage: the part of the 95 % intervals that hold the truth, of the same runs;
- starts: nominal values far off, an eighth as many as there are runs, the same touches: do all lead to one optimum;
- outliers: one touch in ten bad, of 72 and of 108, a sixteenth as many runs: what that costs, and which are named.

The sampling error of a variance is 1.6 % with 8000 runs; with 2000 it is 3.2 %, and the largest of 48 ratios may lie
three times as far off.

All of it takes about half an hour on one core, most of it for the outliers.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmark.common import ROBOTS
from benchmark.statistics.outliers import play_outliers
from benchmark.statistics.runs import NOISES, Task, play_noise, play_starts, scene
from benchmark.statistics.summary import noise_summary, outlier_summary, starts_summary
from benchmark.statistics.tables import tables

SECTIONS = ('efficiency', 'coverage', 'starts', 'outliers')
PLAYED: dict[str, tuple[str, ...]] = {
    'noise': ('efficiency', 'coverage'),
    'starts': ('starts',),
    'outliers': ('outliers',),
}
PLAY: dict[str, Callable[[Task], list[Any]]] = {'noise': play_noise, 'starts': play_starts, 'outliers': play_outliers}
FEWER = {'noise': 1, 'starts': 8, 'outliers': 16}
PER_DISC = {'noise': (12,), 'starts': (12,), 'outliers': (12, 18)}
AT_ONCE = 25
"""Runs of one task."""


def tasks(runs: int, only: str | None) -> list[Task]:
    """What is to be played."""
    listed = []
    for section, shown in PLAYED.items():
        if only and only not in shown:
            continue
        number = max(2, runs // FEWER[section])
        for robot in ROBOTS:
            for noise in NOISES:
                for per_disc in PER_DISC[section]:
                    parts = (range(first, min(first + AT_ONCE, number)) for first in range(0, number, AT_ONCE))
                    listed += [Task(section, robot, noise, per_disc, seeds) for seeds in parts]
    return listed


def work(task: Task) -> list[Any]:
    """All runs of a task."""
    return PLAY[task.section](task)


def run(listed: Sequence[Task], jobs: int) -> dict[tuple[str, str, str, int], list[Any]]:
    """The runs by section, robot, noise and points per disc, played in processes of one thread each."""
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ[name] = '1'  # before a process imports NumPy
    records: dict[tuple[str, str, str, int], list[Any]] = {}
    with multiprocessing.get_context('spawn').Pool(jobs) as pool:
        for number, (task, found) in enumerate(zip(listed, pool.imap(work, listed), strict=True), 1):
            records.setdefault(task[:4], []).extend(found)
            if sys.stderr.isatty():
                print(f'\r{number}/{len(listed)}', end='', file=sys.stderr)
    return records


def summarise(records: dict[tuple[str, str, str, int], list[Any]], only: str | None = None) -> dict[str, Any]:
    """The figures of each section, by robot, noise and, where it differs, touches."""
    summary: dict[str, Any] = {}
    for (section, robot, noise, per_disc), runs in records.items():
        key, stage = f'{robot}, {noise}', scene(robot, per_disc)
        if section == 'noise':
            figures = noise_summary(runs, stage)
        elif section == 'starts':
            figures = starts_summary(runs)
        else:
            key, figures = f'{key}, {len(stage.plan)} touches', outlier_summary(runs)
        for shown in PLAYED[section]:
            if only in (None, shown):
                summary.setdefault(shown, {})[key] = figures
    return summary


def plain(item: Any) -> Any:
    """The same with null for what JSON has no number for."""
    if isinstance(item, dict):
        return {key: plain(value) for key, value in item.items()}
    if isinstance(item, (list, tuple)):
        return [plain(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item


def parse() -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=int, default=8000, help='calibrations of each robot and noise (default: 8000)')
    parser.add_argument('--only', choices=SECTIONS)
    parser.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    parser.add_argument('--json', type=Path, help='write all figures there')
    parser.add_argument('--plot', type=Path, help='draw the outcome there, .svg or .png')
    return parser.parse_args()


def main() -> int:
    """Run, print, save, draw."""
    options = parse()
    summary = summarise(run(tasks(options.runs, options.only), options.jobs), options.only)
    print('\n'.join(tables(summary)))
    if options.json:
        text = json.dumps(plain(summary), indent=1, ensure_ascii=False, allow_nan=False)
        options.json.write_text(text + '\n', encoding='utf-8')
    if options.plot:
        from benchmark.statistics.picture import draw

        draw(summary, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())
