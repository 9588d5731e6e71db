"""`scara-kinetostatic calibrate`: from recordings to the parameters of the robot and its model errors."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scara_kinetostatic.cli.arguments import Subparsers, add_cell, add_verb, cell_or_recorded
from scara_kinetostatic.cli.output import progress
from scara_kinetostatic.errors import CellError, InputError, UnsupportedDataError

DESCRIPTION = """\
Finds the touches in recordings of joint angles and forces, and estimates the
twelve parameters of the robot with their uncertainties (the base model). Then
tests this model against the touches: a physical effect that it lacks is
identified, added to the model and estimated together with the parameters, so
that it does not bias them. Writes into DIR

  calibration.yaml   the result as ROS parameters, for --params-file
  calibration.json   the complete result as data
  report.html        the complete result as a page with figures
  residuals.csv      one row per touch: measured, predicted, residual

An earlier result in DIR is kept under the date of its calibration, such as
calibration_2026-11-21T14-03-22Z.json.

A recording is a rosbag2 folder (MCAP or SQLite, compressed or not), a bare
.mcap or .db3 file, a ROS 1 .bag, or a recording of the collector. A touch table is
accepted as well: a .csv file with the columns q1_rad,q2_rad,fx_N,fy_N (force on
the object, base frame) and, optional, object,time_s,approach1,approach2.
Several inputs are calibrated together, as one longer recording of the same
robot and cell.
"""
EXAMPLE = """\
  scara-kinetostatic calibrate monday tuesday --cell cell.yaml --out result --fix p1 --fix l1=0.3302
  scara-kinetostatic calibrate touches.csv --cell cell.yaml --out result --residuals residuals.csv
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(
        subparsers,
        'calibrate',
        'estimate the parameters from recordings',
        DESCRIPTION,
        EXAMPLE,
        run,
        unsupported='with --strict also: the result is unfit for use',
    )
    parser.add_argument(
        'bags', nargs='+', type=Path, metavar='BAG', help='recordings, or touch tables (.csv), of one robot'
    )
    add_cell(parser, recorded=True)
    parser.add_argument(
        '--out',
        type=Path,
        default=Path('calibration'),
        metavar='DIR',
        help='results (default: calibration)',
    )
    parser.add_argument(
        '--fix',
        action='append',
        default=[],
        metavar='NAME[=VALUE]',
        help='hold a parameter at VALUE in SI units, or at its nominal value; of an effect, such as '
        'object_radius[disc_2].radius=0, it is in the model with VALUE, or absent; may be given several times',
    )
    parser.add_argument(
        '--leave-out',
        action='append',
        default=[],
        metavar='TOUCHES',
        help='leave out touches by their numbers in the result (5 or 10-14) or in one recording (NAME:5), or a whole '
        'recording (NAME); may be given several times',
    )
    parser.add_argument('--residuals', type=Path, metavar='FILE.csv', help='write residuals.csv there as well')
    parser.add_argument(
        '--strict',
        action='store_true',
        help='exit status 3 where the result is unfit for use; it is written all the same',
    )
    return parser


def run(args: argparse.Namespace) -> int:
    """Calibrates.

    Raises:
        InputError: a recording, the cell or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the data cannot support a calibration; with ``--strict``, or the result, which is written
            all the same, is unfit for use.
    """
    from scara_kinetostatic.assessment.grade import Grade
    from scara_kinetostatic.bags.inputs import other_descriptions
    from scara_kinetostatic.calibration.calibrate import fixed_values, parse_fixed
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.files.checksum import check_different
    from scara_kinetostatic.pipeline import calibrate_recordings
    from scara_kinetostatic.report import residuals
    from scara_kinetostatic.report.text import text_report
    from scara_kinetostatic.report.write import RESULTS, write_results
    from scara_kinetostatic.touches.left_out import kept_recordings, parse_left_out

    check_different(args.bags)
    inputs = [*args.bags, *([args.cell] if args.cell else [])]
    _check_results(args.out, RESULTS, inputs)
    for text in args.fix:
        parse_fixed(text, '--fix')
    left_out = parse_left_out(args.leave_out, '--leave-out')
    if args.residuals:
        _check_residuals(args.residuals, inputs, args.out, RESULTS)
    kept = list(map(Path, kept_recordings(args.bags, left_out)))
    cell = cell_or_recorded(args.cell, kept)
    fixed = fixed_values(args.fix, cell.nominal, '--fix')
    with progress() as show_progress:
        try:
            outcome = calibrate_recordings(args.bags, cell, fixed=fixed, left_out=left_out, progress=show_progress)
        except CellError as error:  # the data contradict it: name its file
            where = args.cell or f'the cell description in {kept[0]}'
            raise CellError(f'{where}: {error.where}', error.problem, error.remedy) from error
        if args.cell:
            outcome = replace(outcome, warnings=(*outcome.warnings, *other_descriptions(cell, kept, '--cell')))
        show_progress('writing the report', 1.0)
        if args.residuals and args.residuals.resolve() != (args.out / residuals.NAME).resolve():
            write_texts(args.residuals.parent, {args.residuals.name: residuals.residual_table(outcome)})
        files = write_results(outcome, args.out)
    print(text_report(outcome))
    if files.note:
        print(f'{files.note}\n')
    print('\n'.join(dict.fromkeys(map(str, (*files.paths, *([args.residuals] if args.residuals else []))))))
    if args.strict and outcome.assessment.grade is Grade.UNFIT:
        raise UnsupportedDataError(
            outcome.assessment.headline, f'the results are written to {files.folder} all the same'
        )
    return 0


def _check_results(out: Path, results: Sequence[str], inputs: Sequence[Path]) -> None:
    """Check that no file of the result replaces an input.

    Raises:
        InputError: one would.
    """
    places = [(out / name).resolve() for name in results]
    for given in inputs:
        if given.resolve() in places:
            raise InputError(
                given, 'is an input and would be replaced by the result', 'choose another folder for --out'
            )


def _check_residuals(path: Path, inputs: Sequence[Path], out: Path, results: Sequence[str]) -> None:
    """Check, before anything is computed, that the table of residuals replaces neither an input nor a result.

    Raises:
        InputError: it would, or its path names no ``.csv`` file.
    """
    remedy = 'choose another file for --residuals'
    if path.is_dir():
        raise InputError(path, 'is a folder where a file is to be written', remedy)
    if path.suffix.lower() != '.csv':
        raise InputError(path, f'expected a file name that ends in .csv, got {path.name!r}', remedy)
    place, out = path.resolve(), out.resolve()
    for given in inputs:
        if place == given.resolve():
            raise InputError(path, 'is an input and would be replaced', remedy)
        if given.resolve() in place.parents:
            raise InputError(path, f'is inside the input {given}', remedy)
    others = (out / name for name in results if not name.endswith('.csv'))
    if place in (out, *out.parents, *others):
        raise InputError(path, 'is a result and would be replaced', remedy)
