"""A small run of every benchmark, which shows that it works and nothing else.

    python -m benchmark.smoke [--jobs 2] [NAME...]

Each runs in a process of its own with so few cases that it ends within seconds. Its targets
do not count; a traceback, or a status other than 0 and 1, does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmark.common import parser

ONE_THREAD = os.environ | {'OPENBLAS_NUM_THREADS': '1'}
ROOT = Path(__file__).parents[1]
ARGUMENTS = {
    'archive': '--recordings 12 --robots 2 --loop 2',
    'assessment': '--runs 1 --each 1',
    'closed_loop': '--tolerance 1e-3',
    'command': '--runs 1',
    'compensation': '--calibrations 2 --poses 5 --timed 1000',
    'contour': '--runs 1',
    'design': '--number 2 --grades 1 --robots 1',
    'diagnosis': '--seeds 1 --clean 2 --only clean --jobs 1',
    'dial_gauge': '--number 2',
    'drift': '--calibrations 1 --alarm-touches 20 --pairs 2',
    'export': '--poses 10',
    'faults': '--bags 5 --cells 5 --kills 0 --disks 0',
    'faults.fuzz': '--files 56',
    'gravity': '2',
    'faults.hostile': '--only heading history_view ros1_giant',
    'faults.services': '--nodes compensator --calls 20 --values 2',
    'hysteresis': '--seeds 0 --alarms 2',
    'joint_slip': '--seeds 1 --clean 2 --cells short',
    'live': '--seconds 10 --rate 100',
    'lone_flaws': '--robots 1 --effect sensor_bias --jobs 1',
    'measured_data': '--alarms 1',
    'measured_gears': '--only base_init1 base_init1_again',
    'mujoco': '--scene tilted_base --per-disc 3',
    'mujoco_slip': '--scene joint_slip --per-disc 2',
    'next': '--cells 1 --simulated 1 --runs 2',
    'noise': '--number 1',
    'odds': '--recordings 1 --jobs 1',
    'outlines': '--recordings 2 --named 1',
    'peers': '--touches 36 --contenders package minimisation scipy',
    'pictures': '--out {folder} --first 1',
    'population': '--robots 1 --sizes 1 --kind all --cell paper --jobs 1',
    'reading': '--seconds 10 --rate 100',
    'runner': '--cells 1 --touches 4',
    'runner_faults': '--only silent_wrench:approach',
    'statistics': '--runs 10',
    'update': '--robots 1 --kind tool --jobs 1',
    'uncertainty': '--count 1 --kind small',
}
"""Of each benchmark, by its name."""
SHARED = {
    '__init__',
    'cell_nodes',
    'common',
    'engine_slides',
    'engine_touches',
    'figures',
    'rehearsal',
    'smoke',
    'svg',
    'urdf',
}
"""Modules that are no benchmarks."""


def run(name: str) -> bool:
    """Runs a benchmark; whether it works."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, '-m', f'benchmark.{name}', *ARGUMENTS[name].format(folder=folder).split()]
        done = subprocess.run(command, cwd=ROOT, env=ONE_THREAD, capture_output=True, text=True, check=False)
    works = done.returncode in (0, 1) and 'Traceback' not in done.stderr
    print(f'{"works " if works else "FAILED"} {name} {time.monotonic() - began:.1f} s', flush=True)
    if not works:
        print(done.stdout, done.stderr, sep='\n')
    return works


def main() -> int:
    """Runs them."""
    options_of = parser(__doc__, json_file=False)
    options_of.add_argument('names', nargs='*', metavar='NAME', choices=[[], *ARGUMENTS], help='these alone')
    options_of.add_argument('--jobs', type=int, default=2)
    options = options_of.parse_args()
    with ThreadPoolExecutor(options.jobs) as pool:
        return 0 if all([*pool.map(run, options.names or ARGUMENTS)]) else 1


if __name__ == '__main__':
    sys.exit(main())
