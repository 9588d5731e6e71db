"""An archive recalibrated on a Dask cluster, one worker of which is killed, beside a plain loop.

    python -m benchmark.archive [--recordings N] [--robots N] [--loop N] [--json FILE]

The recordings are simulated: the paper's cell without undetected effects, 24 touches each, of robots with links of
their own; nine of ten are tables of touches, the tenth is a recording of both topics at 40 Hz. They are calibrated and
diagnosed by `recalibrate --no-report --dask` on a scheduler with two workers of one thread, each a process of its own.
When a third of the rows is there, one worker is killed (SIGKILL) and does not come back. The loop does the first
recordings one after the other in one process. Targets: no row is lost, all are calibrated, and the rows of the loop
are the same.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.common import CELL, counted, dump_touch_table, machine, parser, print_targets, save
from benchmark.smoke import ONE_THREAD
from scara_kinetostatic import simulate
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.files.tables import TouchTable
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.monitoring.archive import recalibrate, tasks_of
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams

PER_DISC = 4


def record(folder: Path, number: int, robots: int) -> list[Path]:
    """The archive: each robot has a folder."""
    paths = []
    links = np.random.default_rng(0).normal(0.0, 2e-4, (robots, 2))
    for k in counted(iter(range(number)), number):
        robot, recording = k % robots, k // robots
        truth = PAPER_ACTUAL.replace(l1=PAPER_ACTUAL.l1 + links[robot, 0], l2=PAPER_ACTUAL.l2 + links[robot, 1])
        place = folder / f'robot_{robot:02d}'
        place.mkdir(parents=True, exist_ok=True)
        if recording % 10 == 9:
            sensors = SensorModel(touch_noise=CELL.noise, joint_rate=40.0, wrench_rate=40.0)
            plan = default_plan(CELL, per_disc=PER_DISC)
            paths.append(place / f'{recording:04d}')
            write_streams(paths[-1], simulate_streams(CELL, ExtendedModel(truth), plan, sensors=sensors, seed=k), CELL)
        else:
            t = simulate(CELL, truth, per_disc=PER_DISC, seed=k)
            names = tuple(CELL.discs[disc].name for disc in t.disc)
            table = TouchTable(t.joints, t.force, names, t.time, t.approach, (), '')
            paths.append(place / f'{recording:04d}.csv')
            paths[-1].write_text(dump_touch_table(table), encoding='utf-8')
    return paths


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process of Dask."""
    command = [sys.executable, '-m', *arguments]
    with subprocess.Popen(command, env=ONE_THREAD, stderr=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            running.kill()


def on_cluster(paths: list[Path], cell: Path, out: Path) -> dict[str, Any]:
    """Calibrated on a cluster, one worker of which is killed."""
    dask = ('distributed.cli.dask_scheduler', '--host', '127.0.0.1', '--port', '0', '--no-dashboard')
    with process(*dask) as scheduler:
        assert scheduler.stderr is not None
        address = next(line.split()[-1] for line in scheduler.stderr if 'Scheduler at' in line)
        work = ('distributed.cli.dask_worker', address, '--nthreads', '1', '--no-nanny', '--no-dashboard')
        with process(*work) as victim, process(*work):
            command = [sys.executable, '-m', 'scara_kinetostatic.cli.main', 'recalibrate', *map(str, paths)]
            options = ['--cell', str(cell), '--out', str(out), '--no-report', '--dask', address]
            began, times = time.monotonic(), []
            with subprocess.Popen(command + options, env=ONE_THREAD, stdout=subprocess.PIPE, text=True) as running:
                assert running.stdout is not None
                for line in counted(running.stdout, len(paths)):
                    if not line.startswith(str(paths[0].parents[1])):
                        break
                    times.append(time.monotonic() - began)
                    if len(times) == len(paths) // 3:
                        victim.kill()
                running.communicate()
    third = len(paths) // 3
    return {
        'status': running.returncode,
        'rows a second, two workers': (third - 1) / (times[third - 1] - times[0]),
        'rows a second, one worker left': (len(times) - third) / (times[-1] - times[third - 1]),
        'rows a second, altogether': len(times) / times[-1],
        'trends, s': time.monotonic() - began - times[-1],
    }


def in_a_loop(paths: list[Path], cell: Path, out: Path) -> tuple[float, list[dict[str, str]]]:
    """Rows a second, and the rows."""
    began = time.monotonic()
    rows = [recalibrate(task)[0] for task in tasks_of(paths, cell, out, report=False)]
    return len(rows) / (time.monotonic() - began), rows


def main() -> int:
    """Record, recalibrate in both ways, compare."""
    made = parser(__doc__)
    made.add_argument('--recordings', type=int, default=2000, metavar='N')
    made.add_argument('--robots', type=int, default=20, metavar='N')
    made.add_argument('--loop', type=int, default=100, metavar='N', help='recordings of the plain loop')
    args = made.parse_args()
    os.environ |= ONE_THREAD
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cell = folder / 'cell.yaml'
        cell.write_text(dump_cell(CELL), encoding='utf-8')
        paths = record(folder / 'archive', args.recordings, args.robots)
        figures: dict[str, Any] = on_cluster(paths, cell, folder / 'cluster')
        with (folder / 'cluster/archive.csv').open(encoding='utf-8', newline='') as stream:
            rows = list(csv.DictReader(stream))
        figures['rows a second, plain loop'], own = in_a_loop(paths[: args.loop], cell, folder / 'loop')
    apart = ('date', 'folder')  # a table has the date of its calculation
    same = sum(
        all(row[key] == one[key] for key in one if key not in apart) for row, one in zip(rows, own, strict=False)
    )
    figures |= {'rows': len(rows), 'calibrated': sum(not row['reason'] for row in rows)}
    figures |= {'robots': len({row['robot'] for row in rows}), 'same as in the loop': f'{same} of {len(own)}'}
    for key, value in figures.items():
        print(f'{key}: {value:.4g}' if isinstance(value, float) else f'{key}: {value}')
    save(args.json, figures | {'machine': machine()})
    targets = [
        ('no row is lost', [row['recording'] for row in rows] == [str(path) for path in paths]),
        ('all are calibrated', figures['calibrated'] == len(paths)),
        ('the same rows as in a loop', same == len(own)),
    ]
    return 0 if print_targets(targets) else 1


if __name__ == '__main__':
    sys.exit(main())
