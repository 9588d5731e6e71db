"""Time of the command as a whole process: its help, and the calibration of a recording with its report.

    python -m benchmark.command [--runs 15] [--json FILE] [--plot FILE]

A recording of 72 touches and 50 000 messages is simulated and written as MCAP. Each command then runs in processes of
its own, one after the other; the first run does not count. The wall-clock time of the whole process is measured.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.common import CELL, machine, parser, print_targets, save, svg_figure
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.cli.main import VERBS
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.streams import Streams

MESSAGES = 50_000
LONGEST_HELP, LONGEST_CALIBRATION = 0.3, 1.5
"""Targets of the medians, s."""


def simulated() -> Streams:
    """72 touches, at rates that give `MESSAGES` messages or a few more."""
    return _simulated(1.001 * MESSAGES / _messages(_simulated(1.0)))


def _simulated(rate_factor: float) -> Streams:
    usual = SensorModel()
    sensors = SensorModel(joint_rate=rate_factor * usual.joint_rate, wrench_rate=rate_factor * usual.wrench_rate)
    return simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL), sensors=sensors)


def _messages(streams: Streams) -> int:
    return len(streams.joints.stamp) + len(streams.wrench.stamp)


def compare(runs: int) -> list[dict[str, Any]]:
    """Times every command, one after the other."""
    records = []
    with tempfile.TemporaryDirectory(prefix='command_') as folder:
        streams = simulated()
        recording, result = f'{folder}/recording', f'{folder}/result'
        write_streams(recording, streams, CELL)
        print(f'{_messages(streams)} messages', flush=True)
        helps = [['--help'], *([verb.replace('_', '-'), '--help'] for verbs in VERBS.values() for verb in verbs)]
        for arguments in (*helps, ['calibrate', recording, '--out', result]):
            record = measure(arguments, runs)
            records.append(record)
            times = f'{record["median"]:.3f} s ({record["least"]:.3f} … {record["most"]:.3f})'
            print(f'{record["command"]:<20} {times}', flush=True)
    return records


def measure(arguments: list[str], runs: int) -> dict[str, Any]:
    """Times one command."""
    command = [sys.executable, '-m', 'scara_kinetostatic.cli.main', *arguments]
    seconds = []
    for _ in range(runs + 1):
        begin = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        seconds.append(time.perf_counter() - begin)
    least, median, most = np.quantile(seconds[1:], [0, 0.5, 1]).tolist()
    shown = ' '.join(text for text in arguments if '/' not in text and text != '--out')
    return {'command': shown, 'runs': runs, 'median': median, 'least': least, 'most': most}


def targets(records: list[dict[str, Any]]) -> list[tuple[str, bool]]:
    """Each target as text, and whether it is met."""
    *helps, calibrate = records
    slowest = max(helps, key=lambda record: float(record['median']))
    return [
        (
            f'help under {LONGEST_HELP} s: {slowest["median"]:.2f} s ({slowest["command"]})',
            slowest['median'] < LONGEST_HELP,
        ),
        (
            f'calibrate under {LONGEST_CALIBRATION} s: {calibrate["median"]:.2f} s',
            calibrate['median'] < LONGEST_CALIBRATION,
        ),
    ]


def draw(records: list[dict[str, Any]], path: Path) -> None:
    """Median, shortest and longest time of each command."""
    with svg_figure(path, 6.4, 2.6) as figure:
        axes = figure.add_subplot()
        median = [record['median'] for record in records]
        error = [
            [record['median'] - record['least'] for record in records],
            [record['most'] - record['median'] for record in records],
        ]
        axes.barh([record['command'] for record in records], median, xerr=error, color='#0b6e99')
        axes.set(xlabel='whole process, s')
        axes.invert_yaxis()


def main() -> int:
    """Runs the benchmark."""
    options_of = parser(__doc__, plot=True)
    options_of.add_argument('--runs', type=int, default=15)
    options = options_of.parse_args()
    before = machine()
    records = compare(options.runs)
    found = targets(records)
    met = print_targets(found)
    save(options.json, {'before': before, 'after': machine(), 'records': records, 'targets': dict(found)})
    if options.plot:
        draw(records, options.plot)
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())
