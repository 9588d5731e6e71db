"""Compliance and backlash from dial gauge readings.

Estimates compliance and backlash from tables of loads and dial gauge readings,
as in section 5.2 of the paper: load and unload in both directions, record force
and displacement. The slope is the compliance, the gap at zero force the
backlash, each with its standard deviation.

The first line of a table names its columns with their units:
  force_N displacement_mm         required; also kN, m, um
  direction_deg                   of the positive force
  cycle                           1, 2, 3, ... ; else taken from the order of the rows
  part                            gripper, joint1 or joint2
  lever_m                         of the force about the joint
  gauge_at                        where the dial gauge measures: tip or link

Continuous records of loops are for the verb hysteresis.

Example:
  scara-kinetostatic dial-gauge gripper.csv --out result
  scara-kinetostatic dial-gauge joint2.csv --part joint2 --lever 0.33
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import JSON, out_option, print_report, real
from scara_kinetostatic.errors import InputError

_PARTS = ('gripper', 'joint1', 'joint2')
ARGUMENTS = (
    ('tables', 'FILE.csv', Path, 'tables of readings', {'nargs': '+'}),
    out_option(files='dial_gauge.json and dial_gauge.html'),
    JSON,
    'for tables without these columns',
    ('--part', '', _PARTS, 'the elastic part (default: gripper)', {'default': 'gripper'}),
    ('--lever', 'M', real(0, above=True), 'lever arm of the force, m', {'default': math.nan}),
    ('--direction', 'DEG', real(), 'direction of the positive force', {'default': math.nan}),
    ('--gauge-at', '', ('tip', 'link'), 'place of the dial gauge (default: link for a joint)', {'default': ''}),
)


def run(args: argparse.Namespace) -> None:
    """Estimates compliance and backlash.

    Raises:
        InputError: a table or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: there is no reversal, or there are too few rows.
    """
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.files.tables import load_table
    from scara_kinetostatic.studies.loops.dial_gauge import analyse_runs, load_readings
    from scara_kinetostatic.studies.loops.report import dial_gauge_document, dial_gauge_report

    if args.lever > 5.0:  # no arm is longer
        remedy = f'it is in m, not mm: give {1e-3 * args.lever:g}'
        raise InputError('--lever', f'expected at most 5 m, got {args.lever:g}', remedy)
    check_different(args.tables)
    usual = {'part': args.part, 'lever': args.lever, 'gauge_at': args.gauge_at}
    usual['direction'] = math.radians(args.direction)
    tables = [load_readings(load_table(path, 'force_N,displacement_mm'), **usual) for path in args.tables]
    analysis = analyse_runs([run for table in tables for run in table.runs])
    notes = tuple(note for table in tables for note in table.notes)
    analysis = analysis._replace(warnings=notes + analysis.warnings)
    print_report(args, 'dial_gauge', dial_gauge_report(analysis), dial_gauge_document(analysis))
