"""Hold new touches against a calibration.

Holds touches that a calibration has not seen against its prediction. The grade
says whether the calibration still holds: the error of the tip, what noise and
the uncertainty of the calibration let expect, and a chi-square of all touches
with its p-value. Where they contradict, the likeliest changes are
listed. Writes verification.json and verification.html into DIR.

A recording that was part of the calibration verifies nothing; that is said.

Example:
  scara-kinetostatic verify tuesday --calibration result/calibration.json --strict
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import JSON, MAX_BYTES, check_strict, out_option, print_report

ARGUMENTS = (
    ('bags', 'BAG', Path, 'recordings, or touch tables (.csv)', {'nargs': '+'}),
    ('--calibration', 'CALIBRATION.json', Path, 'of the result of calibrate', {'required': True}),
    ('--cell', 'FILE', Path, 'cell description (default: that of the calibration)'),
    ('--strict', '', bool, 'exit status 3 where the calibration is unfit; results are written anyway'),
    out_option('verification'),
    JSON,
    MAX_BYTES,
)


def run(args: argparse.Namespace) -> None:
    """Verifies.

    Raises:
        InputError: a recording, the calibration or the cell is wrong, or DIR cannot be written.
        UnsupportedDataError: there is no touch; with ``--strict``, or the calibration is unfit.
    """
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.monitoring.record import CalibrationRecord
    from scara_kinetostatic.monitoring.report import verification_document, verification_report
    from scara_kinetostatic.monitoring.verification import verify_recordings

    check_different(args.bags)
    record = CalibrationRecord.load(args.calibration)
    found = verify_recordings(args.bags, record, load_cell(args.cell) if args.cell else None)
    print_report(args, 'verification', verification_report(found), verification_document(found))
    check_strict(args, found.assessment)
