"""What changed between calibrations.

Says what changed from each calibration of a robot to the next: every parameter
with the uncertainty of its change, a p-value of no change at all, and which
part moved most likely (base, tool, the zero of a joint, a link, a compliance,
a backlash, an object, the force sensor), or what else may have.

Errors that the calibrations share, such as those of the places of the objects,
cancel as far as both calibrations suffer from them alike: the change is fitted
to the touches of both, and is not the difference of the two values. Writes
comparison.json and comparison.html into DIR.

Example:
  scara-kinetostatic compare monday/calibration.json tuesday/calibration.json
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import JSON, out_option, print_report

ARGUMENTS = (
    ('calibrations', 'CALIBRATION.json', Path, 'two or more, by time', {'nargs': '+'}),
    out_option('comparison'),
    JSON,
)


def run(args: argparse.Namespace) -> None:
    """Compares.

    Raises:
        InputError: a calibration cannot be read or is of another robot, there are fewer than two, or DIR cannot be
            written.
    """
    from scara_kinetostatic.files.atomic import check_different
    from scara_kinetostatic.monitoring.comparison import compare_records
    from scara_kinetostatic.monitoring.record import CalibrationRecord
    from scara_kinetostatic.monitoring.report import comparison_document, comparison_report

    check_different(args.calibrations)
    changes = compare_records([CalibrationRecord.load(path) for path in args.calibrations])
    print_report(args, 'comparison', comparison_report(changes), comparison_document(changes))
