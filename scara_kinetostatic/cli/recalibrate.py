"""Calibrate every recording of an archive by itself, in parallel.

Calibrates every recording of an archive by itself, as after a correction of the
cell description or with a new version. The results of each are in a folder of
its name in DIR, as calibrate writes them; with --history they are added to a
history as well.

A recording that cannot be calibrated is named with the reason, and the others
go on; the exit status is then 3.

Example:
  scara-kinetostatic recalibrate archive/*.mcap --cell cell.yaml --out results --jobs 8 --history robots.sqlite
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.arguments import add_cell, add_max_bytes, add_options, add_results, progress, whole
from scara_kinetostatic.errors import InputError, UnsupportedDataError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the verb."""
    add_options(parser, ('bags', 'BAG', Path, 'recordings, or touch tables (.csv)', {'nargs': '+'}))
    add_cell(parser, 'the one in the recording')
    add_max_bytes(parser)
    add_results(parser, 'recalibrated', json=False)
    add_options(
        parser,
        ('--jobs', 'N', whole(1), 'parallel processes (default: 1)', {'default': 1}),
        ('--no-report', '', bool, 'do not draw report.html, which takes most of the time'),
        ('--history', 'FILE', Path, 'history to add the results to'),
        ('--robot', 'NAME', str, 'its name in the history', {'default': ''}),
    )


def run(args: argparse.Namespace) -> None:
    """Recalibrates.

    Raises:
        InputError: an option is wrong, or the history cannot be written.
        UnsupportedDataError: a recording cannot be calibrated.
    """
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.monitoring.archive import in_processes, tasks_of
    from scara_kinetostatic.monitoring.history import History
    from scara_kinetostatic.monitoring.record import CalibrationRecord
    from scara_kinetostatic.results.calibration_json import NAME

    check_different(args.bags)
    if args.cell:
        load_cell(args.cell)
    history = History(args.history, create=True) if args.history else None
    tasks = tasks_of(args.bags, args.cell, args.out, report=not args.no_report)
    failed, added = 0, 0
    with progress() as show_progress:
        for number, done in enumerate(in_processes(tasks, args.jobs), 1):
            show_progress(f'{number} of {len(tasks)}', number / len(tasks))
            problem = done.problem
            if history is not None and not problem:
                try:
                    added += sum(history.add([CalibrationRecord.load(Path(done.task.folder) / NAME)], args.robot))
                except InputError as error:
                    problem = f'not added to the history: {error}'
            print(f'{done.task.recording}: {problem or done.grade}', flush=True)
            failed += bool(problem)
    if history is not None:
        print(f'{added} results added to {args.history}')
    if failed:
        raise UnsupportedDataError(f'{failed} of {len(tasks)} recordings failed', 'see the reasons above')
