"""`scara-kinetostatic hysteresis`: measured loops of force over displacement, and the law they call for."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.arguments import Subparsers, add_verb, real
from scara_kinetostatic.errors import InputError

if TYPE_CHECKING:
    from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings

DESCRIPTION = """\
Closes the loop on measured force-displacement loops. Law (6) of the paper, slope
and gap, is fitted; its residual is asked what it depends on; a softening
spring, a damper, friction in parallel and friction in series are each added and
fitted to one half of the sweeps, and judged by what they predict of the other
half. The one that predicts best is named, with those that the data cannot tell
from it, and the error before and after is reported.

A table needs the columns time_s, force_N and displacement_m (or kN, ms, mm, um).
"""
EXAMPLE = """\
  scara-kinetostatic hysteresis loop.csv --out result
  scara-kinetostatic hysteresis a.csv b.csv c.csv --tension 20 35 80
"""


def add_parser(subparsers: Subparsers[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Adds the verb."""
    parser = add_verb(
        subparsers, 'hysteresis', 'what loops show beyond slope and gap', DESCRIPTION, EXAMPLE, run, aliases=('loops',)
    )
    parser.add_argument('tables', type=Path, nargs='+', metavar='FILE.csv', help='continuous records')
    parser.add_argument(
        '--tension',
        type=real(),
        nargs='+',
        default=[],
        metavar='T',
        help='of the band, one per file, any unit: predict each of three or more files from the others',
    )
    parser.add_argument('--out', type=Path, metavar='DIR', help='write loops.json and loops.html, with pictures, there')
    parser.add_argument('--json', action='store_true', help='print JSON instead of tables')
    return parser


def run(args: argparse.Namespace) -> int:
    """Analyses.

    Raises:
        InputError: a table or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: there are too few reversals.
    """
    from scara_kinetostatic.render.json_file import json_text
    from scara_kinetostatic.studies.hysteresis.analysis import check_tensions, hysteresis_study
    from scara_kinetostatic.studies.hysteresis.document import NAME, hysteresis_document
    from scara_kinetostatic.studies.hysteresis.text import text

    check_tensions(len(args.tables), args.tension)
    study = hysteresis_study(_tables(args.tables), args.tension)
    document = hysteresis_document(study)
    if args.out:
        from scara_kinetostatic.files.atomic import write_texts
        from scara_kinetostatic.studies.hysteresis.page import NAME as PAGE
        from scara_kinetostatic.studies.hysteresis.page import html_text

        texts = {NAME: json_text(document), PAGE: html_text(study)}
        write_texts(args.out, texts)
    print(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) if args.json else text(study))
    if args.out and not args.json:
        print(f'written: {", ".join(str(args.out / name) for name in texts)}')
    return 0


def _tables(paths: list[Path]) -> list[DialGaugeReadings]:
    from scara_kinetostatic.studies.dial_gauge.table_file import load_readings

    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise InputError(path, 'is given twice', 'name each table once')
        seen.add(path.resolve())
    return [load_readings(path) for path in paths]
