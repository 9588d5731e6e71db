"""`scara-kinetostatic demo`: the whole cell on this machine in one go."""

from __future__ import annotations

import argparse
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.arguments import Subparsers, add_verb, real, whole
from scara_kinetostatic.errors import InputError, OutputError

if TYPE_CHECKING:
    from scara_kinetostatic.nodes.demo_client import DemoResult

DESCRIPTION = """\
Starts the three nodes as processes of their own in a private ROS domain: a
simulated robot touches the discs of a cell, the collector records, the
calibrator calibrates on a service call. Prints the twelve estimates beside the
truth that the simulator was given. Needs ROS 2 Jazzy, as wheels or from apt.
"""
EXAMPLE = """\
  scara-kinetostatic demo --seed 7
"""
TELL_EVERY = 12
"""Touches between two lines."""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(subparsers, 'demo', 'simulate, record and calibrate over ROS', DESCRIPTION, EXAMPLE, run)
    parser.add_argument(
        '--out', type=Path, default=Path('demo'), metavar='DIR', help='each run makes a folder in it (default: demo)'
    )
    parser.add_argument('--cell', type=Path, metavar='FILE', help="cell description; default: the paper's cell")
    parser.add_argument('--seed', type=whole(0), default=0, metavar='N', help='seed of the noise (default: 0)')
    parser.add_argument(
        '--time-factor',
        type=real(0.01),
        default=20.0,
        metavar='X',
        help='simulated seconds per second (default: 20)',
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Runs the demonstration.

    Raises:
        InputError: ROS is not installed, the cell or the folder is wrong, a node did not start or answer.
        UnsupportedDataError: there was no calibration.
    """
    try:
        from scara_kinetostatic.nodes.demo_client import run_demo
    except ModuleNotFoundError as error:
        if str(error.name).startswith('scara_kinetostatic'):
            raise
        remedy = "install the ROS wheels by pip install 'scara_kinetostatic[ros]', or source a ROS 2 installation"
        raise InputError('demo', f'needs ROS 2 Jazzy, and there is no module {error.name!r}', remedy) from error
    from scara_kinetostatic.files.cell_file import load_cell

    cell = load_cell(args.cell) if args.cell else None
    result = run_demo(_new_folder(args.out), cell, {'seed': args.seed, 'time_factor': args.time_factor}, _Teller())
    _print_result(result)
    return 0


def _new_folder(parent: Path) -> Path:
    folder = parent.absolute() / datetime.now().strftime('%Y_%m_%d-%H_%M_%S_%f')
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputError(parent, f'cannot make a folder in it ({error.strerror})', 'choose another --out') from error
    return folder


class _Teller:
    """Prints what is going on, of the touches only some."""

    def __init__(self) -> None:
        self._told = ''
        self._next = 0

    def __call__(self, what: str, touches: int) -> None:
        if what != self._told:
            print(f'{what} …', flush=True)
            self._told, self._next = what, TELL_EVERY
        elif touches >= self._next:
            print(f'  {touches} touches recorded', flush=True)
            self._next = touches - touches % TELL_EVERY + TELL_EVERY


def _print_result(result: DemoResult) -> None:
    import numpy as np

    from scara_kinetostatic.model.parameters import NAMES, UNITS

    deviation = (result.estimate - result.truth) / result.std
    print(f'{result.message}\n')
    print(f'{"":8}{"truth":>14}{"estimate":>16}{"std":>11}   {"z":>5}')
    for row, name in enumerate(NAMES):
        print(
            f'{name:8}{result.truth[row]:14.6e}{result.estimate[row]:16.7e}{result.std[row]:11.2e}   '
            f'{deviation[row]:5.2f}  {UNITS[name]}'
        )
    print('z: distance from the truth in standard deviations; the largest is', f'{np.nanmax(np.abs(deviation)):.2f}\n')
    print(f'recording: {result.recording}')
    print(f'report:    {result.results / "report.html"}')
