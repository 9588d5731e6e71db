"""`scara-kinetostatic history`: calibrations in one file, listed and as a page with the trend."""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.arguments import Subparsers, add_verb
from scara_kinetostatic.errors import InputError

DESCRIPTION = """\
Keeps the calibrations of robots in one SQLite file: robot, date, parameters with
their covariance, assessment, and the whole calibration.json.

  add   put calibrations into FILE, which is made if it does not exist
  list  print them in the order of time, with what changed from one to the next
  page  the same as a page with the trend of every parameter, history.html in DIR
"""
EXAMPLE = """\
  scara-kinetostatic history add robots.sqlite result/calibration.json
  scara-kinetostatic history page robots.sqlite --out trend
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(
        subparsers, 'history', 'keep calibrations in one file, with their trend', DESCRIPTION, EXAMPLE, run
    )
    parser.add_argument('action', choices=('add', 'list', 'page'), help='what to do')
    parser.add_argument('file', type=Path, metavar='FILE', help='the SQLite file')
    parser.add_argument('calibrations', nargs='*', type=Path, metavar='CALIBRATION.json', help='to add')
    parser.add_argument(
        '--robot', default='', metavar='NAME', help='name of the robot (default: as its cell description identifies it)'
    )
    parser.add_argument('--out', type=Path, default=Path('history'), metavar='DIR', help='of page (default: history)')
    return parser


def run(args: argparse.Namespace) -> int:
    """Adds, lists, or writes the page.

    Raises:
        InputError: FILE is no history, a calibration cannot be read or is of another robot, or DIR cannot be written.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.monitoring import history_report as report
    from scara_kinetostatic.monitoring.history import History, changes_of
    from scara_kinetostatic.monitoring.record import CalibrationRecord

    if (args.action == 'add') != bool(args.calibrations):
        problem = 'expected calibrations to add' if args.action == 'add' else f'{args.action} takes no calibrations'
        raise InputError(f'history {args.action}', problem)
    if args.action == 'add':
        records = [CalibrationRecord.load(path) for path in args.calibrations]
        for path, is_new in zip(
            args.calibrations, History(args.file, create=True).add(records, args.robot), strict=True
        ):
            print(f'{path}: {"added" if is_new else "is in the history already"}')
        return 0
    entries = History(args.file).entries(args.robot)
    if not entries:
        raise InputError(args.file, f'holds no calibration of {args.robot!r}' if args.robot else 'holds no calibration')
    changes = changes_of(entries)
    print(report.history_table(entries, changes).text())
    if args.action == 'page':
        write_texts(args.out, {report.PAGE_NAME: report.history_page(entries, changes)})
        print(f'\nwritten: {args.out / report.PAGE_NAME}')
    return 0
