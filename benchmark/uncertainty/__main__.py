"""Declared uncertainties: recordings of drawn worlds, the budget against Monte Carlo, time.

    python -m benchmark.uncertainty [--show recordings|fits|budget|time] [--first N] [--count N] [--json FILE]

Two cells with 108 touches each, those of `benchmark.diagnosis`: the paper's cell with the robot of table 2, four other
discs with the robot of figure 4(d).

- recordings: the errors of discs, plates and sensor are drawn from their declared uncertainties (`worlds.KINDS`); then
  the touches are calibrated and diagnosed, with the noise given and estimated: z of each parameter, verdicts; and the
  same with one object 10 declared standard uncertainties off its place.
- fits: the same without displaced objects and without the diagnosis, z of each parameter: 200 recordings determine
  its root mean square to 5 %, so the extremes of 72 of them need more.
- budget: `Calibration.contributions` and the tip's, source by source, against Monte Carlo (JCGM 101): the errors of one
  source alone are drawn, or all, and the fit is repeated.
- time: a fit with declared uncertainties over one without, of 36, 72 and 360 touches.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from benchmark.common import in_processes, parser, print_targets, save
from benchmark.uncertainty import monte_carlo, recordings, timing
from benchmark.uncertainty.worlds import KINDS

SHOWS = ('recordings', 'fits', 'budget', 'time')


def parse() -> argparse.Namespace:
    """The options."""
    options = parser(__doc__)
    options.add_argument('--show', choices=SHOWS, default='recordings')
    options.add_argument('--first', type=int, default=0, help='number of the first recording or draw (default: 0)')
    options.add_argument('--count', type=int, default=200, help='recordings of each situation, or draws (default: 200)')
    options.add_argument('--kind', choices=tuple(KINDS), action='append', help='what is declared; may be repeated')
    options.add_argument('--jobs', type=int, default=1, help='processes (default: 1)')
    return options.parse_args()


def main() -> int:
    """Run, print, save."""
    options = parse()
    records: list[dict[str, Any]]
    if options.show == 'time':
        records = timing.run()
        targets = timing.targets(records)
    elif options.show == 'budget':
        listed = monte_carlo.tasks(options.first, options.count)
        records = list(in_processes(monte_carlo.run_task, listed, options.jobs))
        lines, targets = monte_carlo.summarise(records)
        print('\n'.join(lines))
    else:
        drawn = recordings.tasks(options.first, options.count, options.kind or recordings.DRAWN)
        fits = options.show == 'fits'
        drawn = [task for task in drawn if not (fits and task.displaced)]
        run = recordings.run_fits if fits else recordings.run_task
        records = [record for part in in_processes(run, drawn, options.jobs) for record in part]
        lines, targets = (recordings.summarise_fits if fits else recordings.summarise)(records)
        print('\n'.join(lines))
    met = print_targets(targets)
    save(options.json, records)
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())
