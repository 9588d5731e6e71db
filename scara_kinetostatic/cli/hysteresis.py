"""`scara-kinetostatic hysteresis`: model selection for measured force-displacement loops."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.arguments import Subparsers, add_verb, check_different, real
from scara_kinetostatic.cli.output import print_result

if TYPE_CHECKING:
    from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings

DESCRIPTION = """\
Fits law (6) of the paper, slope and gap, to measured force-displacement loops,
and tests what its residual depends on. A softening spring, a damper, friction
in parallel and friction in series are each added, fitted to one half of the
sweeps and compared by their prediction of the other half. The best one is
reported with those that the data cannot distinguish from it, and with the force
error before and after.

A table needs the columns time_s, force_N and displacement_m (or kN, ms, mm, um).
"""
EXAMPLE = """\
  scara-kinetostatic hysteresis loop.csv --out result
  scara-kinetostatic hysteresis a.csv b.csv c.csv --tension 20 35 80
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(
        subparsers,
        'hysteresis',
        'the law of measured force-displacement loops',
        DESCRIPTION,
        EXAMPLE,
        run,
        aliases=('loops',),
    )
    parser.add_argument('tables', type=Path, nargs='+', metavar='FILE.csv', help='continuous records')
    parser.add_argument(
        '--tension',
        type=real(),
        nargs='+',
        default=[],
        metavar='T',
        help='tension of the belt, one per file, any unit: predict each of three or more files from the others',
    )
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder for hysteresis.json and hysteresis.html')
    parser.add_argument('--json', action='store_true', help='print JSON instead of text')
    return parser


def run(args: argparse.Namespace) -> int:
    """Selects and fits the law.

    Raises:
        InputError: a table or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: there are too few reversals.
    """
    from scara_kinetostatic.studies.hysteresis.analysis import analyse_hysteresis, check_tensions
    from scara_kinetostatic.studies.hysteresis.document import NAME, hysteresis_document
    from scara_kinetostatic.studies.hysteresis.text import text

    check_tensions(len(args.tables), args.tension)
    analysis = analyse_hysteresis(_tables(args.tables), args.tension)
    document = hysteresis_document(analysis)
    files = {}
    if args.out:
        from scara_kinetostatic.render.json_file import json_text
        from scara_kinetostatic.studies.hysteresis import page

        files = {NAME: json_text(document), page.NAME: page.html_text(analysis)}
    print_result(text(analysis), document, args.json, args.out, files)
    return 0


def _tables(paths: list[Path]) -> list[DialGaugeReadings]:
    from scara_kinetostatic.studies.dial_gauge.table_file import load_readings

    check_different(paths)
    return [load_readings(path) for path in paths]
