"""Estimate the parameters from recordings.

Finds the touches in recordings of joint angles and forces, and estimates the
twelve parameters of the robot with their uncertainties (the base model). Then
tests this model against the touches: a physical effect that it lacks is
identified, added to the model and estimated together with the parameters, so
that it does not bias them. Writes into DIR

  calibration.yaml   the result as ROS parameters, for --params-file
  calibration.json   the complete result as data
  report.html        the complete result as a page with figures
  residuals.csv      one row per touch: measured, predicted, residual

An earlier result in DIR is kept under the date of its file, such as
calibration_2026-11-21T14-03-22Z.json.

A recording is a rosbag2 folder (MCAP or SQLite, compressed or not), a bare
.mcap or .db3 file, a ROS 1 .bag, or a recording of the collector. A touch table is
accepted as well: a .csv file with the columns q1_rad,q2_rad,fx_N,fy_N (force on
the object, base frame; in the tool frame: fx_tool_N,fy_tool_N) and, optional,
object,time_s,approach1,approach2.
Several inputs are calibrated together, as one longer recording of the same
robot and cell.

--from brings an earlier calibration up to date by a few touches: its result with
its whole covariance is the prior. What --free names is known as the data sheet
knows it instead: tool (theta2, l2, p_ee, g_ee), zeros (theta1, theta2), base (x0,
y0, theta1) or a parameter. Where the touches contradict the prior the result is
unfit, and what most likely changed is said.

Example:
  scara-kinetostatic calibrate monday tuesday --cell cell.yaml --out result --fix p1 --fix l1=0.3302
  scara-kinetostatic calibrate four.csv --from result/calibration.json --free tool --out new
  scara-kinetostatic calibrate touches.csv --cell cell.yaml --out result --residuals residuals.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import (
    FREE,
    MAX_BYTES,
    SEVERAL,
    cell_option,
    check_file,
    check_strict,
    out_option,
    progress,
)
from scara_kinetostatic.errors import InputError, ParameterError

_FIX = 'hold a parameter at VALUE in SI units, or at its nominal value; also one of an effect; repeatable'
_LEAVE_OUT = 'leave out touches (5, 10-14), by their numbers in the result, or a recording (NAME); repeatable'
ARGUMENTS = (
    ('bags', 'BAG', Path, 'recordings, or touch tables (.csv), of one robot', {'nargs': '+'}),
    cell_option('the one in the recording'),
    MAX_BYTES,
    out_option('calibration'),
    ('--from', 'CALIBRATION.json', Path, 'an earlier calibration, the prior of a few touches', {'dest': 'earlier'}),
    FREE,
    ('--fix', 'NAME[=VALUE]', str, _FIX, SEVERAL),
    ('--leave-out', 'TOUCHES', str, _LEAVE_OUT, SEVERAL),
    ('--residuals', 'FILE.csv', Path, 'write residuals.csv there as well'),
    ('--strict', '', bool, 'exit status 3 where the result is unfit for use; it is written all the same'),
)


def run(args: argparse.Namespace) -> None:
    """Calibrates.

    Raises:
        InputError: a recording, the cell or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the data cannot support a calibration; with ``--strict``, or the result, which is written
            all the same, is unfit for use.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.pipeline import calibrate_files
    from scara_kinetostatic.results.document import RESIDUALS, RESULTS, residual_table, write_results
    from scara_kinetostatic.results.report import text_report

    if args.free and not args.earlier:
        raise ParameterError('--free', 'is for --from CALIBRATION.json', 'give both')
    if args.fix and args.earlier:
        raise ParameterError(
            '--fix', 'is not for --from, which holds what the earlier calibration held', 'leave it out'
        )
    inputs = [*args.bags, *(path for path in (args.cell, args.earlier) if path)]
    results = [(args.out / name).resolve() for name in RESULTS]
    if replaced := [given for given in inputs if given.resolve() in results]:
        remedy = 'choose another folder for --out'
        raise InputError(replaced[0], 'is an input and would be replaced by the result', remedy)
    residuals = args.residuals
    if residuals:
        check_file(residuals, inputs, '--residuals', '.csv')
        out = args.out.resolve()
        if residuals.resolve() in (out, *out.parents, *(path for path in results if path.name != RESIDUALS)):
            remedy = 'choose another file for --residuals'
            raise InputError(residuals, 'is a result and would be replaced', remedy)
    with progress() as show_progress:
        if args.earlier:
            from scara_kinetostatic.monitoring.update import update_files

            outcome = update_files(args.bags, args.earlier, args.free, args.cell, args.leave_out, show_progress)
        else:
            outcome = calibrate_files(args.bags, args.cell, args.fix, args.leave_out, progress=show_progress)
        show_progress('writing the report', 1.0)
        assessment = outcome.assessment
        if residuals and residuals.resolve() != (args.out / RESIDUALS).resolve():
            write_texts(residuals.parent, {residuals.name: residual_table(outcome)})
        files = write_results(outcome, args.out)
    print(text_report(outcome))
    if files.note:
        print(f'{files.note}\n')
    print('\n'.join(dict.fromkeys(map(str, (*files.paths, *([residuals] if residuals else []))))))
    check_strict(args, assessment)
