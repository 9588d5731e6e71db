"""The law of measured records of load and response.

Fits law (6) of the paper, slope and gap, to measured records of load and
response, and tests what its residual depends on. Other laws are fitted to a
part of the data and compared by their prediction of the rest. The best one is
reported with those that the data cannot distinguish from it, and with the error
before and after.

Driven by its motion: full loops, six sweeps or more; the force is predicted.
Driven by its load: at rest, loaded, unloaded, once or several times; the
response is predicted; several records of one joint are judged together.

A table needs time_s and a response with its load: displacement_m and force_N
(or mm, um, kN), or angle_rad and torque_Nm (or mrad, urad, deg, mNm).

Example:
  scara-kinetostatic hysteresis loop.csv --out result
  scara-kinetostatic hysteresis a.csv b.csv c.csv --tension 20 35 80
  scara-kinetostatic hysteresis pose_*.csv --response q2_rad --load tau2_Nm --predict other.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from scara_kinetostatic.cli.arguments import add_results, print_result, real
from scara_kinetostatic.errors import InputError

if TYPE_CHECKING:
    from scara_kinetostatic.studies.hysteresis.record_table import RecordTable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the verb."""
    parser.add_argument('tables', type=Path, nargs='+', metavar='FILE.csv', help='continuous records')
    parser.add_argument('--response', metavar='COLUMN', help='column of the displacement or the angle, among many')
    parser.add_argument('--load', metavar='COLUMN', help='column of the force or the torque, among many')
    parser.add_argument('--driven', choices=('load', 'motion'), help='what drives the records (default: as they look)')
    parser.add_argument(
        '--predict',
        type=Path,
        nargs='+',
        default=[],
        metavar='OTHER.csv',
        help='predict the response of these records from the moment on at which they are unloaded; driven by load',
    )
    parser.add_argument(
        '--tension',
        type=real(),
        nargs='+',
        default=[],
        metavar='T',
        help='tension of the belt, one per file, any unit: predict each of three or more files from the others',
    )
    add_results(parser, files='hysteresis.json and hysteresis.html')


def run(args: argparse.Namespace) -> int:
    """Selects and fits the law.

    Raises:
        InputError: a table or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the records are too short, or not of full loops or of a load that comes and goes.
    """
    from scara_kinetostatic.studies.hysteresis.record_table import LOAD, what_drives

    tables = _tables(args)
    if what_drives(tables, args.driven) == LOAD:
        return _run_load_driven(args, tables)
    return _run_motion_driven(args, tables)


def _run_motion_driven(args: argparse.Namespace, tables: list[RecordTable]) -> int:
    from scara_kinetostatic.studies.hysteresis.analysis import BY_LOAD, analyse_hysteresis
    from scara_kinetostatic.studies.hysteresis.document import NAME, hysteresis_document
    from scara_kinetostatic.studies.hysteresis.text import text

    if args.predict:
        problem = f'{tables[0].source} is driven by its motion'
        raise InputError('--predict', problem, 'it takes records driven by their load; see --driven')
    units = BY_LOAD[tables[0].load_unit]
    analysis = analyse_hysteresis([table.readings for table in tables], args.tension, units)
    document = hysteresis_document(analysis)
    files = {}
    if args.out:
        from scara_kinetostatic.report.json_file import json_text
        from scara_kinetostatic.studies.hysteresis import page

        files = {NAME: json_text(document), page.NAME: page.html_text(analysis)}
    print_result(text(analysis), document, args.json, args.out, files)
    return 0


def _run_load_driven(args: argparse.Namespace, tables: list[RecordTable]) -> int:
    from scara_kinetostatic.studies.hysteresis.document import NAME
    from scara_kinetostatic.studies.hysteresis.load_driven.analysis import analyse_load_driven, predict_records
    from scara_kinetostatic.studies.hysteresis.load_driven.document import load_driven_document
    from scara_kinetostatic.studies.hysteresis.load_driven.text import text

    if args.tension:
        problem = f'{tables[0].source} is driven by its load'
        raise InputError('--tension', problem, 'it is for records driven by their motion; see --driven')
    records = [table.load_record for table in tables]
    analysis = analyse_load_driven(records[: len(args.tables)])
    predicted = predict_records(analysis, records[len(args.tables) :])
    document = load_driven_document(analysis, predicted)
    files = {}
    if args.out:
        from scara_kinetostatic.report.json_file import json_text
        from scara_kinetostatic.studies.hysteresis import page as names
        from scara_kinetostatic.studies.hysteresis.load_driven import page

        files = {NAME: json_text(document), names.NAME: page.html_text(analysis, predicted)}
    print_result(text(analysis, predicted), document, args.json, args.out, files)
    return 0


def _tables(args: argparse.Namespace) -> list[RecordTable]:
    from scara_kinetostatic.files.checksum import check_different
    from scara_kinetostatic.studies.hysteresis.record_table import check_alike, load_record_table

    paths = [*args.tables, *args.predict]
    check_different(paths)
    tables = [load_record_table(path, args.response, args.load) for path in paths]
    check_alike(tables)
    return tables
