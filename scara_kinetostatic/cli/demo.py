"""A simulated robot calibrates itself, over ROS.

A robot 2.5 mm off its data sheet touches the discs of a cell by itself, in
simulated time: the runner chooses each touch, commands it, judges it, and ends
when the tip is known to the tolerance of the cell. Prints how the tip's
uncertainty falls, and the estimated parameters beside the true ones of the
simulator, and where the report is. A cell of yours needs robot.limits and a tolerance. Needs ROS 2
Jazzy, as wheels or from apt.

Example:
  scara-kinetostatic demo --seed 7
"""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.shared_arguments import SEED, cell_option, real
from scara_kinetostatic.errors import OutputError

if TYPE_CHECKING:
    from scara_kinetostatic.nodes.demo import DemoResult


_FACTOR = 'simulated seconds per second, at most (default: 10)'
ARGUMENTS = (
    ('--out', 'DIR', Path, 'each run makes a folder in it (default: demo)', {'default': Path('demo')}),
    ('--time-factor', 'X', real(0.01), _FACTOR, {'default': 10.0}),
    cell_option(),
    SEED,
)


def run(args: argparse.Namespace) -> None:
    """Runs the demonstration.

    Raises:
        InputError: the cell or the folder is wrong, a node did not start or answer.
        UnsupportedDataError: there was no calibration.
    """
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.nodes.demo import run_demo

    cell = load_cell(args.cell) if args.cell else None
    folder = args.out.absolute() / datetime.now().strftime('%Y_%m_%d-%H_%M_%S_%f')
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputError(args.out, f'cannot make a folder in it ({error.strerror})', 'choose another --out') from error
    print('touch       tip, expanded uncertainty so far', flush=True)
    _print_result(run_demo(folder, cell, {'seed': args.seed, 'time_factor': args.time_factor}, _print_progress))


def _print_progress(accepted: int, known: float | None, touch: str) -> None:
    """One line for a touch."""
    text = '' if known is None else 'not yet' if known == float('inf') else f'{1e6 * known:.0f} µm'
    print(f'{accepted:5}  {text:>8}  {touch}', flush=True)


def _print_result(result: DemoResult) -> None:
    import numpy as np

    from scara_kinetostatic.model.parameters import NAMES, UNITS
    from scara_kinetostatic.report.page import Table

    truth, estimate, std = np.array([result.truth, result.estimate.values, result.estimate.deviations])
    deviation = (estimate - truth) / std
    numbers = zip(truth, estimate, std, deviation, strict=True)
    rows = tuple(
        (name, f'{true:.6e}', f'{value:.7e}', f'{spread:.2e}', f'{z:.2f}', UNITS[name])
        for name, (true, value, spread, z) in zip(NAMES, numbers, strict=True)
    )
    print(f'{result.message}\n')
    print(Table(('', 'truth', 'estimate', 'std', 'z', 'unit'), (), rows).text())
    print(f'z: error in standard deviations, at most {np.nanmax(np.abs(deviation)):.2f}\n')
    print(f'recording:   {result.recording}')
    print(f'report:      {result.results / "report.html"}')
    print(f'calibration: {result.results / "calibration.json"}')
