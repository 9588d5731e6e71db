"""Keep calibrations in one file, with their trend.

Keeps the calibrations of robots in one SQLite file: robot, date, parameters with
their covariance, assessment, and the whole calibration.json.

  add      put calibrations into FILE, which is made if it does not exist
  list     print them in the order of their recordings, with what changed from one
           to the next, and slowly since the last change; of several by the same
           recordings, the last one
  page     the same as a page with the trend of every parameter, history.html in DIR
  extract  print the calibration.json of a NUMBER of the list
  remove   take the calibrations of these NUMBERs out

Example:
  scara-kinetostatic history add robots.sqlite result/calibration.json
  scara-kinetostatic history page robots.sqlite --out trend
  scara-kinetostatic history remove robots.sqlite 3
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import print_result
from scara_kinetostatic.errors import InputError

_ROBOT = 'name of the robot (default: as its cell description identifies it)'
ARGUMENTS = (
    ('action', '', ('add', 'list', 'page', 'extract', 'remove'), 'what to do'),
    ('file', 'FILE', Path, 'the SQLite file'),
    ('items', 'CALIBRATION.json', str, 'files to add; or numbers to extract or remove', {'nargs': '*'}),
    ('--robot', 'NAME', str, _ROBOT, {'default': ''}),
    ('--out', 'DIR', Path, 'of page (default: history)', {'default': Path('history')}),
)


def run(args: argparse.Namespace) -> None:
    """Adds, lists, writes the page, prints or removes.

    Raises:
        InputError: FILE is no history, a calibration cannot be read or is of another robot, or DIR cannot be written.
    """
    from scara_kinetostatic.monitoring.history import History, trends_of
    from scara_kinetostatic.monitoring.record import CalibrationRecord
    from scara_kinetostatic.monitoring.report import history_report
    from scara_kinetostatic.report.page import as_page, as_text

    takes = {'add': 'calibrations to add', 'extract': 'one number', 'remove': 'numbers'}
    if (args.action in takes) != bool(args.items) or (args.action == 'extract' and len(args.items) > 1):
        problem = f'expected {takes[args.action]}' if args.action in takes else 'takes no calibrations'
        raise InputError(f'history {args.action}', problem)
    if args.action == 'add':
        records = [CalibrationRecord.load(path) for path in args.items]
        added = History(args.file, create=True).add(records, args.robot)
        for path, is_new in zip(args.items, added, strict=True):
            print(f'{path}: {"added" if is_new else "is in the history already"}')
        return
    if args.action in takes:
        if wrong := [item for item in args.items if not (item.isascii() and item.isdigit() and len(item) < 19)]:
            raise InputError(f'history {args.action}', f'expected a number of the list, got {wrong[0]!r}')
        is_removed = args.action == 'remove'
        documents = History(args.file).extract([int(item) for item in dict.fromkeys(args.items)], remove=is_removed)
        print(f'removed: {" ".join(args.items)}' if is_removed else documents[0].rstrip())
        return
    entries = History(args.file).entries(args.robot)
    if not entries:
        raise InputError(args.file, f'holds no calibration of {args.robot!r}' if args.robot else 'holds no calibration')
    shown = history_report(trends_of(entries))
    print_result(as_text(shown), args.out, {'history.html': as_page(shown)} if args.action == 'page' else {})
