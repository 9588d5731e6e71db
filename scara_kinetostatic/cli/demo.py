"""`scara-kinetostatic demo`: the whole cell on this machine in one go."""

from __future__ import annotations

import argparse
import signal
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from scara_kinetostatic.errors import InputError, OutputError
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, UNITS

if TYPE_CHECKING:
    from scara_kinetostatic.nodes.demo_client import DemoResult

DESCRIPTION = """\
Starts the three nodes as processes of their own in a private ROS domain: a
simulated robot touches the discs of the example cell (figure 3), the collector
records, the calibrator calibrates on a service call. Prints the twelve
estimates beside the truth that the simulator was given.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = subparsers.add_parser(
        'demo',
        help='simulate, record and calibrate a whole cell over ROS, on this machine',
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--out', type=Path, default=Path('demo'), metavar='DIR', help='each run makes a folder in it (default: demo)'
    )
    parser.add_argument('--seed', type=int, default=0, help='seed of the simulated noise (default: 0)')
    parser.add_argument(
        '--time-factor', type=float, default=20.0, metavar='X', help='simulated seconds per second (default: 20)'
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Runs the demonstration.

    Raises:
        InputError: ROS is not installed, the folder cannot be written to, a node did not start or answer.
        UnsupportedDataError: there was no calibration.
    """
    try:
        from scara_kinetostatic.nodes.demo_client import run_demo
    except ModuleNotFoundError as error:
        remedy = "install the ROS wheels by pip install 'scara_kinetostatic[ros]', or source a ROS 2 installation"
        raise InputError('demo', f'needs ROS 2 Jazzy, and there is no module {error.name!r}', remedy) from error
    former = signal.signal(signal.SIGTERM, _interrupt)
    try:
        result = run_demo(_new_folder(args.out), {'seed': args.seed, 'time_factor': args.time_factor}, _Teller())
    finally:
        signal.signal(signal.SIGTERM, former)
    _print_result(result)
    return 0


def _interrupt(number: int, _: FrameType | None) -> NoReturn:
    """SIGTERM ends the demonstration as Ctrl-C does: the nodes are ended, too."""
    raise KeyboardInterrupt


def _new_folder(parent: Path) -> Path:
    folder = parent.absolute() / datetime.now().strftime('%Y%m%d_%H%M%S_%f')
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputError(parent, f'cannot make a folder in it ({error.strerror})', 'choose another --out') from error
    return folder


class _Teller:
    """Prints what is going on, of the touches only every tenth or so."""

    def __init__(self) -> None:
        self._told = ''
        self._next = 0

    def __call__(self, what: str, touches: int) -> None:
        if what != self._told:
            print(f'{what} …', flush=True)
            self._told, self._next = what, 10
        elif touches >= self._next:
            print(f'  {touches} touches recorded', flush=True)
            self._next = touches + 10


def _print_result(result: DemoResult) -> None:
    truth = PAPER_ACTUAL.as_array()
    deviation = (result.estimate - truth) / result.std
    print(f'{result.message}\n')
    print(f'{"":8}{"truth":>14}{"estimate":>16}{"std":>11}   {"z":>5}')
    for row, name in enumerate(NAMES):
        print(
            f'{name:8}{truth[row]:14.6e}{result.estimate[row]:16.7e}{result.std[row]:11.2e}   '
            f'{deviation[row]:5.2f}  {UNITS[name]}'
        )
    print(f'\nlargest |z|: {np.nanmax(np.abs(deviation)):.2f} standard deviations')
    print(f'recording: {result.recording}')
    print(f'report:    {result.results / "report.html"}')
