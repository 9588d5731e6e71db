"""An archive of recordings recalibrated one by one, in this process and by several: same results, times.

    python -m benchmark.archive [--recordings N] [--jobs N] [--reports] [--json FILE]

The recordings are simulated: the paper's cell, 36 touches each, streams of 40 Hz, each with its own noise. Each is
read, calibrated and diagnosed, and all but the page is written; `--reports` draws that, too. Times are of the
processor, of all processes together, and include what each process needs to start. Results are the same where all of
calibration.json is, apart from the date.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from benchmark.common import machine, parser, print_and_save
from scara_kinetostatic.cli.main import main as command
from scara_kinetostatic.monitoring.archive import Task, in_processes, tasks_of


def processor_time() -> float:
    """Of this process and all that have ended, s."""
    return sum(os.times()[:4])


def record(folder: Path, count: int) -> list[Path]:
    """The archive."""
    paths = [folder / f'recording_{k:04d}' for k in range(count)]
    rates = ['--joint-rate', '40', '--wrench-rate', '40']
    for seed, path in enumerate(paths):
        with redirect_stdout(StringIO()):
            status = command(['simulate', '--out', str(path), '--per-disc', '6', '--seed', str(seed), *rates])
        if status:
            raise SystemExit(f'{path} cannot be simulated')
    return paths


def run(tasks: list[Task], jobs: int) -> dict[str, Any]:
    """One way to work the tasks."""
    begun, wall = processor_time(), time.monotonic()
    done = list(in_processes(tasks, jobs))
    return {
        'done': sum(not item.problem for item in done),
        'processor time, s': processor_time() - begun,
        'wall clock, s': time.monotonic() - wall,
    }


def document(task: Task) -> Any:
    """A result without its date."""
    text = (Path(task.folder) / 'calibration.json').read_text(encoding='utf-8')
    return {key: value for key, value in json.loads(text).items() if key != 'created'}


def main() -> int:
    """Record, recalibrate in both ways, compare."""
    made = parser(__doc__)
    made.add_argument('--recordings', type=int, default=1000, metavar='N')
    made.add_argument('--jobs', type=int, default=2, metavar='N')
    made.add_argument('--reports', action='store_true', help='draw the pages as well')
    args = made.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = record(folder, args.recordings)
        ways = {'one process': 1, 'processes': args.jobs}
        tasks = {way: tasks_of(paths, None, folder / way, report=args.reports) for way in ways}
        figures: dict[str, Any] = {way: run(tasks[way], jobs) for way, jobs in ways.items()}
        pairs = zip(*tasks.values(), strict=True)
        figures['same results'] = sum(document(one) == document(other) for one, other in pairs)
    print_and_save(args.json, {'recordings': args.recordings, 'jobs': args.jobs, **figures, 'machine': machine()})
    return 0 if figures['same results'] == args.recordings else 1


if __name__ == '__main__':
    sys.exit(main())
