"""Quality of the diagnosis: false alarms, effects found and named, errors before and after.

    python -m benchmark.diagnosis [--seeds N] [--first N] [--clean N] [--only SECTION] [--effect LABEL] [--cell NAME]
                                  [--noise given|estimated] [--jobs N] [--json FILE] [--plot FILE]

All touches are simulated, by this package's own simulator: 108 per recording, in two cells, the noise given and
estimated. Sections:

- clean: no effect, or one that is an exact alias of the base model's parameters;
- effects: each effect of the catalogue in a random way, at three sizes;
- pairs: two effects at once, each pair of six;
- unlisted: effects that are not in the catalogue;
- time: of the diagnoses above, CPU.

A size is the reduced chi-square to which the effect brings the fit of the base model, all touches used.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path

from benchmark.common import NOISES, in_processes, parser, save
from benchmark.diagnosis.cells import SETUPS, SIZES
from benchmark.diagnosis.picture import draw
from benchmark.diagnosis.record import Record
from benchmark.diagnosis.runs import PAIR_SIZE, UNLISTED_SIZES, Task, cases, run_task
from benchmark.diagnosis.tables import tables, time_lines

SECTIONS = ('clean', 'effects', 'pairs', 'unlisted', 'time')


def tasks(options: argparse.Namespace) -> list[Task]:
    """The recordings to simulate."""
    cells = [options.cell] if options.cell else list(SETUPS)
    noises = (options.noise,) if options.noise else NOISES
    sizes = {'clean': (), 'effects': SIZES, 'pairs': (PAIR_SIZE,), 'unlisted': UNLISTED_SIZES}
    wanted = {'time': ('clean', 'effects')}.get(options.only, (options.only,) if options.only else tuple(sizes))
    listed = []
    for section in wanted:
        for cell in cells:
            for labels in cases(section, cell):
                if options.effect and options.effect not in labels:
                    continue
                plain = section == 'clean' and not labels
                number = options.clean // (len(cells) * len(noises)) if plain else options.seeds
                seeds = range(options.first, options.first + number)
                listed += [Task(section, cell, labels, seed, noises, sizes[section]) for seed in seeds]
    return listed


def run(listed: list[Task], jobs: int) -> list[Record]:
    """All records in the order of the tasks."""
    return [record for found in in_processes(run_task, listed, jobs) for record in found]


def parse() -> argparse.Namespace:
    """The options."""
    options = parser(__doc__)
    options.add_argument('--seeds', type=int, default=3, help='of each effect, pair, alias in each cell (default: 3)')
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--clean', type=int, default=500, help='recordings without any effect (default: 500)')
    options.add_argument('--only', choices=SECTIONS)
    options.add_argument('--effect', metavar='LABEL', help='only what has this effect')
    options.add_argument('--cell', choices=list(SETUPS))
    options.add_argument('--noise', choices=NOISES)
    options.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    options.add_argument('--plot', type=Path, help='draw the outcome there, .svg or .png')
    return options.parse_args()


def main() -> int:
    """Run, print, save."""
    options = parse()
    records = run(tasks(options), options.jobs)
    chosen = time_lines(records) if options.only == 'time' else tables(records)
    print('\n'.join(chosen))
    save(options.json, [asdict(record) for record in records])
    if options.plot:
        draw(records, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())
