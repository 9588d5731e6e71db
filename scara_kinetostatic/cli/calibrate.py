"""`scara-kinetostatic calibrate`: from recordings to the twelve parameters and what lies beyond them."""

from __future__ import annotations

import argparse
import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.arguments import Subparsers, add_verb
from scara_kinetostatic.cli.progress import progress
from scara_kinetostatic.errors import CellError, InputError, RecordingError

if TYPE_CHECKING:
    from scara_kinetostatic.model.cell import Cell

DESCRIPTION = """\
Finds the touches in recordings of joint angles and forces, and estimates the
twelve parameters of the robot with their uncertainties. Then looks for what the
twelve lack: a physical effect that the touches prove is added to the model and
fitted along, so that it does not bend them. Writes into DIR

  calibration.yaml   the result as ROS parameters, for --params-file
  calibration.json   the result with everything about it
  report.html        the same to look at, one self-contained page

A recording is a rosbag2 folder (MCAP or SQLite, compressed or not), a bare
.mcap file, a ROS 1 .bag, or what the collector recorded. Touches may come as
a table as well: a .csv file with the columns q1_rad,q2_rad,fx_N,fy_N (force on
the object, base frame) and, optional, object,time_s,approach1,approach2.
Several files are calibrated together, as one longer recording of the same
robot and cell.
"""
EXAMPLE = """\
  scara-kinetostatic calibrate monday tuesday --cell cell.yaml --out result --fix p1 --fix l1=0.3302
  scara-kinetostatic calibrate touches.csv --cell cell.yaml --out result --residuals residuals.csv
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(subparsers, 'calibrate', 'estimate the parameters from recordings', DESCRIPTION, EXAMPLE, run)
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help='recordings, or touch tables (.csv), of one robot'
    )
    parser.add_argument(
        '--cell', type=Path, metavar='FILE', help='cell description; default: the one that the recording carries'
    )
    parser.add_argument(
        '--out', type=Path, default=Path('calibration'), metavar='DIR', help='for the results (default: calibration)'
    )
    parser.add_argument(
        '--fix',
        action='append',
        default=[],
        type=_fixed,
        metavar='NAME[=VALUE]',
        help='hold a parameter at VALUE in SI units, or at its nominal value; may be given several times',
    )
    parser.add_argument(
        '--residuals', type=Path, metavar='FILE.csv', help='write one row per touch: measured, predicted, residual'
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Calibrates.

    Raises:
        InputError: a recording, the cell or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the data cannot support a calibration.
    """
    _check_different(args.bags)
    _check_residuals(args.residuals, args.bags)
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.pipeline import calibrate_recordings
    from scara_kinetostatic.report.residuals import residual_table
    from scara_kinetostatic.report.text import text_report
    from scara_kinetostatic.report.write import write_results

    cell = find_cell(args.cell, args.bags)
    nominal = cell.nominal.as_dict()
    fixed = {name: nominal[name] if value is None else value for name, value in args.fix}
    with progress() as tell:
        try:
            outcome = calibrate_recordings(args.bags, cell, fixed=fixed, progress=tell)
        except CellError as error:  # the data contradict it: say in which file
            where = args.cell or f'the cell description in {args.bags[0]}'
            raise CellError(f'{where}: {error.where}', error.problem, error.remedy) from error
        if args.cell:
            outcome = replace(outcome, warnings=(*outcome.warnings, *other_descriptions(cell, args.bags)))
        tell('writing the report', 1.0)
        if args.residuals:
            write_texts(args.residuals.parent, {args.residuals.name: residual_table(outcome)})
        files = write_results(outcome, args.out)
    print(text_report(outcome))
    print('\n'.join(str(path) for path in (*files[1:], *([args.residuals] if args.residuals else []))))
    return 0


def find_cell(named: Path | None, bags: list[Path]) -> Cell:
    """The cell description that is named, or the one that the recordings carry.

    Raises:
        CellError: it cannot be read or makes no sense.
        RecordingError: none is named, and the recordings carry none, or different ones.
    """
    from scara_kinetostatic.bags.reader import embedded_cell
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.files.touch_table import is_touch_table

    if named is not None:
        return load_cell(named)
    carried = {bag: embedded_cell(bag) for bag in bags if not is_touch_table(bag)}
    if not carried:
        raise RecordingError(bags[0], 'a table carries no cell description', 'give one by --cell cell.yaml')
    first = next(iter(carried))
    for bag, cell in carried.items():
        if cell is None:
            raise RecordingError(bag, 'carries no cell description', 'give one by --cell cell.yaml')
        if cell != carried[first]:
            raise RecordingError(bag, f'carries another cell description than {first}', 'say which by --cell')
    common = carried[first]
    assert common is not None
    return common


def other_descriptions(cell: Cell, bags: list[Path]) -> list[str]:
    """Where recordings carry another cell description than the one that is named, one sentence each."""
    from scara_kinetostatic.bags.reader import embedded_cell
    from scara_kinetostatic.files.touch_table import is_touch_table
    from scara_kinetostatic.model.cell import different_parts

    sentences = []
    for bag in (bag for bag in bags if not is_touch_table(bag)):
        with suppress(InputError):  # it may be why another one is named
            carried = embedded_cell(bag)
            keys = [] if carried is None else different_parts(cell, carried)
            if keys:
                sentences.append(f'{bag} carries another cell description ({", ".join(keys)}); that of --cell is used')
    return sentences


def _check_different(bags: list[Path]) -> None:
    """A recording that is counted twice would make the result look better than it is."""
    seen: set[Path] = set()
    for bag in bags:
        place = bag.resolve()
        if place in seen:
            raise InputError(bag, 'the recording is given twice', 'give each recording once')
        seen.add(place)


def _check_residuals(path: Path | None, bags: list[Path]) -> None:
    if path is not None and path.resolve() in [bag.resolve() for bag in bags]:
        raise InputError(path, 'is an input and would be replaced', 'choose another file for --residuals')


def _fixed(text: str) -> tuple[str, float | None]:
    from scara_kinetostatic.model.parameters import NAMES

    name, sign, value = text.partition('=')
    if name not in NAMES:
        raise argparse.ArgumentTypeError(f'no parameter is called {name!r}, the names are {" ".join(NAMES)}')
    if not sign:
        return name, None
    try:
        number = float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{name}: expected a number, got {value!r}') from None
    if not math.isfinite(number):
        raise argparse.ArgumentTypeError(f'{name}: expected a finite number, got {value}')
    return name, number
