"""An archive of recordings recalibrated one by one, by processes and by a local Dask cluster: same results, times.

    python -m benchmark.archive [--recordings N] [--jobs N] [--reports] [--json FILE]

The recordings are simulated: the paper's cell, 36 touches each, streams of 40 Hz, each with its own noise. Each is
read, calibrated and diagnosed, and all but the page is written; `--reports` draws that, too. Times are of the
processor, of all processes together, and include what each process needs to start. Results are the same where all of
calibration.json is, apart from the date. Needs the extra `cluster`.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from benchmark.common import machine, parser, print_and_save
from scara_kinetostatic.cli.main import main as command
from scara_kinetostatic.monitoring.archive import Done, Task, in_processes, on_cluster, tasks_of


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


def run(work: Callable[[list[Task]], Iterable[Done]], tasks: list[Task]) -> dict[str, Any]:
    """One way to work the tasks."""
    begun, wall = processor_time(), time.monotonic()
    done = list(work(tasks))
    return {
        'done': sum(not item.problem for item in done),
        'processor time, s': processor_time() - begun,
        'wall clock, s': time.monotonic() - wall,
    }


def by_cluster(jobs: int) -> Callable[[list[Task]], Iterable[Done]]:
    """On a cluster of local processes that is started and ended with it."""

    def work(tasks: list[Task]) -> Iterable[Done]:
        from distributed import LocalCluster

        with LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=':0') as cluster:
            yield from on_cluster(tasks, cluster.scheduler_address)

    return work


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
        ways = {'processes': lambda tasks: in_processes(tasks, args.jobs), 'dask': by_cluster(args.jobs)}
        tasks = {way: tasks_of(paths, None, folder / way, report=args.reports) for way in ways}
        figures: dict[str, Any] = {way: run(work, tasks[way]) for way, work in ways.items()}
        pairs = zip(tasks['processes'], tasks['dask'], strict=True)
        figures['same results'] = sum(document(one) == document(other) for one, other in pairs)
    print_and_save(args.json, {'recordings': args.recordings, 'jobs': args.jobs, **figures, 'machine': machine()})
    return 0 if figures['same results'] == args.recordings else 1


if __name__ == '__main__':
    sys.exit(main())
