"""How long the command takes, from the shell and back: its help, and calibrating a recording, report and all.

    python -m benchmark.command [--runs 15] [--json FILE] [--plot FILE]

A recording of 72 touches and 50 000 messages is simulated and written as MCAP. Every command then runs in processes of
its own, one after the other, after one run that does not count; what is timed is the whole process on the wall clock.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.peers_timing import machine
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.cli.main import VERBS
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.sensors import SensorModel
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.streams import Streams

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
MESSAGES = 50_000
HELP, CALIBRATE = 0.3, 1.5
"""Longest median, s."""


def recorded() -> Streams:
    """72 touches, at such rates that there are just so many messages or a few more."""
    usual = _played(1.0)
    return _played(1.001 * MESSAGES / _messages(usual))


def _played(faster: float) -> Streams:
    usual = SensorModel()
    sensors = SensorModel(joint_rate=faster * usual.joint_rate, wrench_rate=faster * usual.wrench_rate)
    return simulate_streams(CELL, PAPER_ACTUAL, default_plan(CELL), sensors=sensors)


def _messages(streams: Streams) -> int:
    return len(streams.joints.stamp) + len(streams.wrench.stamp)


def compare(runs: int) -> list[dict[str, Any]]:
    """Every command, in turn."""
    records = []
    with tempfile.TemporaryDirectory(prefix='command_') as folder:
        streams = recorded()
        recording, result = f'{folder}/recording', f'{folder}/result'
        write_streams(recording, streams, CELL)
        print(f'{_messages(streams)} messages', flush=True)
        helps = [['--help'], *([verb, '--help'] for verb in VERBS)]
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


def judge(records: list[dict[str, Any]]) -> list[tuple[str, bool]]:
    """Each target in words, and whether it is met."""
    *helps, calibrate = records
    slowest = max(helps, key=lambda record: float(record['median']))
    return [
        (f'help under {HELP} s: {slowest["median"]:.2f} s ({slowest["command"]})', slowest['median'] < HELP),
        (f'calibrate under {CALIBRATE} s: {calibrate["median"]:.2f} s', calibrate['median'] < CALIBRATE),
    ]


def draw(records: list[dict[str, Any]], path: Path) -> None:
    """Median, least and longest time of each command, as SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'command', 'font.size': 9}):
        figure = Figure(figsize=(6.4, 2.6), layout='constrained')
        axes = figure.add_subplot()
        median = [record['median'] for record in records]
        error = [
            [record['median'] - record['least'] for record in records],
            [record['most'] - record['median'] for record in records],
        ]
        axes.barh([record['command'] for record in records], median, xerr=error, color='#0b6e99')
        axes.set(xlabel='whole process, s')
        axes.invert_yaxis()
        figure.savefig(path, format='svg', metadata={'Date': None})


def main() -> int:
    """Run, print, save, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=int, default=15)
    parser.add_argument('--json', type=Path)
    parser.add_argument('--plot', type=Path, help='SVG')
    options = parser.parse_args()
    before = machine()
    records = compare(options.runs)
    verdicts = judge(records)
    for words, met in verdicts:
        print(f'{"met   " if met else "MISSED"} {words}')
    if options.json:
        result = {'before': before, 'after': machine(), 'records': records, 'targets': dict(verdicts)}
        options.json.write_text(json.dumps(result, indent=2) + '\n', encoding='utf-8')
    if options.plot:
        draw(records, options.plot)
    return 0 if all(met for _, met in verdicts) else 1


if __name__ == '__main__':
    sys.exit(main())
