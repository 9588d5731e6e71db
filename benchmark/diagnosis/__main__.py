"""How good the diagnosis is: false alarms, effects found and named, errors before and after.

    python -m benchmark.diagnosis [--seeds N] [--first N] [--clean N] [--only SECTION] [--effect LABEL] [--cell NAME]
                                  [--noise given|estimated] [--jobs N] [--json FILE] [--plot FILE]

All touches are simulated, by this package's own simulator: 108 per recording, in two cells, the noise given and
estimated. Sections:

- clean: nothing is missing, or only what is an exact alias of the twelve parameters;
- effects: each effect of the catalogue in a random way, at three sizes;
- pairs: two effects at once, each pair of six;
- unlisted: effects that are not in the catalogue;
- time: of the diagnoses above, CPU.

A size is the reduced chi-square to which the effect brings the fit of the twelve parameters, all touches used.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from pathlib import Path

from benchmark.diagnosis.cells import SETUPS, SIZES
from benchmark.diagnosis.picture import draw
from benchmark.diagnosis.record import Record
from benchmark.diagnosis.runs import NOISES, PAIR_SIZE, UNLISTED_SIZES, Task, everything, work
from benchmark.diagnosis.tables import tables, time_lines

SECTIONS = ('clean', 'effects', 'pairs', 'unlisted', 'time')


def tasks(options: argparse.Namespace) -> list[Task]:
    """What is to be played."""
    cells = [options.cell] if options.cell else list(SETUPS)
    noises = (options.noise,) if options.noise else NOISES
    sizes = {'clean': (), 'effects': SIZES, 'pairs': (PAIR_SIZE,), 'unlisted': UNLISTED_SIZES}
    wanted = {'time': ('clean', 'effects')}.get(options.only, (options.only,) if options.only else tuple(sizes))
    listed = []
    for section in wanted:
        for cell in cells:
            for labels in everything(section, cell):
                if options.effect and options.effect not in labels:
                    continue
                plain = section == 'clean' and not labels
                number = options.clean // (len(cells) * len(noises)) if plain else options.seeds
                seeds = range(options.first, options.first + number)
                listed += [Task(section, cell, labels, seed, noises, sizes[section]) for seed in seeds]
    return listed


def run(listed: list[Task], jobs: int) -> list[Record]:
    """All records in the order of the tasks, worked in processes of one thread each."""
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ[name] = '1'  # before a process imports NumPy
    records = []
    with multiprocessing.get_context('spawn').Pool(jobs) as pool:
        for number, found in enumerate(pool.imap(work, listed), 1):
            records += found
            if sys.stderr.isatty():
                print(f'\r{number}/{len(listed)}', end='', file=sys.stderr)
    return records


def parse() -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, default=3, help='of each effect, pair, alias in each cell (default: 3)')
    parser.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    parser.add_argument('--clean', type=int, default=500, help='recordings without any effect (default: 500)')
    parser.add_argument('--only', choices=SECTIONS)
    parser.add_argument('--effect', metavar='LABEL', help='only what has this effect')
    parser.add_argument('--cell', choices=list(SETUPS))
    parser.add_argument('--noise', choices=NOISES)
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    parser.add_argument('--json', type=Path, help='write every recording there')
    parser.add_argument('--plot', type=Path, help='draw the outcome there, .svg or .png')
    return parser.parse_args()


def main() -> int:
    """Run, print, save."""
    options = parse()
    records = run(tasks(options), options.jobs)
    chosen = time_lines(records) if options.only == 'time' else tables(records)
    print('\n'.join(chosen))
    if options.json:
        text = json.dumps([record.as_dict() for record in records], indent=1, allow_nan=False)
        options.json.write_text(text + '\n', encoding='utf-8')
    if options.plot:
        draw(records, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())
