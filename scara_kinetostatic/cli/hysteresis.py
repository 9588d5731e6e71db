"""The law of measured records of load and response.

Fits law (6) of the paper, slope and gap, to measured records of load and
response, and tests what its residual depends on. Other laws are fitted to a
part of the data and compared by their prediction of the rest. The best one is
reported with those that the data cannot distinguish from it, and with the error
before and after.

Driven by its motion: full loops, six sweeps or more; the force is predicted.
Driven by its load: at rest, loaded, unloaded, once or several times, or loops of
six sweeps or more; the response is predicted; several records of one joint are
judged together. A column such as commanded_Nm says what drives; else both are tried.

A table needs time_s and a response with its load: displacement_m and force_N
(or mm, um, kN), or angle_rad and torque_Nm (or mrad, urad, deg, mNm).

Example:
  scara-kinetostatic hysteresis loop.csv --out result
  scara-kinetostatic hysteresis pose_*.csv --response q2_rad --load tau2_ext_Nm --predict other.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import JSON, out_option, print_report
from scara_kinetostatic.errors import InputError

_PREDICT = 'records driven by load, to predict: from the unloading on, in loops after the first third'
ARGUMENTS = (
    ('tables', 'FILE.csv', Path, 'continuous records', {'nargs': '+'}),
    ('--response', 'COLUMN', str, 'column of the displacement or the angle, among many'),
    ('--load', 'COLUMN', str, 'column of the force or the torque, among many'),
    ('--driven', '', ('load', 'motion'), 'what drives the records (default: a column says it, or both are tried)'),
    ('--predict', 'OTHER.csv', Path, _PREDICT, {'nargs': '+', 'default': []}),
    out_option(files='hysteresis.json and hysteresis.html'),
    JSON,
)


def run(args: argparse.Namespace) -> None:
    """Selects and fits the law.

    Raises:
        InputError: a table or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the records are too short, or not of full loops or of a load that comes and goes.
    """
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.studies.loops.record import MOTION, check_alike, load_record, what_drives
    from scara_kinetostatic.studies.loops.report import hysteresis_document, hysteresis_report
    from scara_kinetostatic.studies.loops.selection import analyse, analyse_both, predict_records

    paths = [*args.tables, *args.predict]
    check_different(paths)
    records = [load_record(path, args.response, args.load) for path in paths]
    check_alike(records)
    driven = args.driven or what_drives(records)
    if args.predict and driven == MOTION:
        problem = f'{records[0].source} is driven by its motion'
        raise InputError('--predict', problem, 'it takes records driven by their load; see --driven')
    tables, is_stated = records[: len(args.tables)], args.driven or any(each.driven_by for each in records)
    selections, other = (analyse(tables, driven), ()) if is_stated or args.predict else analyse_both(tables, driven)
    predicted = predict_records(selections[0], records[len(args.tables) :]) if args.predict else ()
    report = hysteresis_report(selections, predicted, other)
    print_report(args, 'hysteresis', report, hysteresis_document(selections, predicted))
