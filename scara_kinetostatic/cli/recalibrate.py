"""Calibrate every recording of an archive by itself, in parallel.

Calibrates thousands of recordings of many robots, each by itself, as after a
correction of the cell description or with a new version of this package. The
results of each are in a folder of its name in DIR, as calibrate writes them, and

  archive.csv    one row per recording: robot, date, grade, verdict, effects,
                 parameters with standard deviations; or why there is no result
  archive.html   the same robot by robot, with the trend of every parameter

A recording that cannot be calibrated is a row with the reason, and the others go
on; the exit status is then 3. What DIR has already, of the same recording, cell
description and version, is not done again: repeat an interrupted run.

The work is done by Dask (pip install 'scara_kinetostatic[cluster]'): by all cores
of this machine or, with --dask, by a running cluster: `dask scheduler`, and
`dask worker ADDRESS --nthreads 1` on each machine. Its workers must have this
version of the package, and see recordings and DIR under the same paths. A robot is
told by the identification in its cell description, else by the folder of its
recordings.

Example:
  scara-kinetostatic recalibrate archive/*/*.mcap --cell cell.yaml --out results
  scara-kinetostatic recalibrate archive/*/*.mcap --out results --no-report --dask tcp://cluster:8786
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import MAX_BYTES, cell_option, out_option, print_result, progress
from scara_kinetostatic.errors import InputError, UnsupportedDataError

_NO_REPORT = 'do not draw report.html of each recording, which takes a third of the time'
ARGUMENTS = (
    ('recordings', 'RECORDING', Path, 'recordings, or touch tables (.csv)', {'nargs': '+'}),
    cell_option('the one in each recording'),
    MAX_BYTES,
    out_option(required=True),
    ('--no-report', '', bool, _NO_REPORT),
    ('--dask', 'ADDRESS', str, 'scheduler of a running cluster (default: one of all cores)', {'default': ''}),
)


def run(args: argparse.Namespace) -> None:
    """Recalibrates.

    Raises:
        InputError: an option is wrong, there is no scheduler or worker, or DIR cannot be written.
        UnsupportedDataError: a recording cannot be calibrated; the others are.
    """
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.monitoring.archive import archive_table, recalibrate_archive, tasks_of
    from scara_kinetostatic.report.page import as_page, as_text

    names = ('archive.csv', 'archive.html')
    for path in args.recordings:
        if path.resolve() in [(args.out / name).resolve() for name in names]:
            raise InputError(path, 'is an input and would be replaced by the result', 'choose another folder for --out')
    if args.cell:
        load_cell(args.cell)
    tasks, done = tasks_of(args.recordings, args.cell, args.out, report=not args.no_report), list[str]()
    with progress() as show_progress:

        def heard(row: dict[str, str], is_earlier: bool) -> None:
            done.append(row['reason'])
            print(f'{row["recording"]}: {row["reason"] or row["grade"]}{", as before" * is_earlier}', flush=True)
            show_progress(f'{len(done)} of {len(tasks)}', len(done) / len(tasks))

        rows, report = recalibrate_archive(tasks, args.dask, heard)
    print_result(f'\n{as_text(report)}', args.out, {names[0]: archive_table(rows), names[1]: as_page(report)})
    if failed := sum(map(bool, done)):
        raise UnsupportedDataError(f'{failed} of {len(tasks)} recordings are not calibrated', 'see the reasons above')
