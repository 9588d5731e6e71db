"""Where the tip is under force.

Where the tip of the calibrated arm is under a force (direct kinetostatics), with
its uncertainty. compensate is its inverse.

STATES.csv has the columns q1_rad, q2_rad, fx_N, fy_N (force of the robot on the
object, base frame). Where the calibration has an effect of time or of the motion
before, time_s (since its first touch), approach1, approach2, too.

The result adds x_m, y_m (base frame), std_x_m, std_y_m, cov_xy_m2: standard
uncertainties and covariance by the calibration, and status, the last of these
that applies:
  ok            as stated
  unloaded      force or torque too small for the sign of a backlash to be known
  extrapolated  a force, an elbow or a time beyond those of the calibration
  undetermined  the calibration does not determine the uncertainty: nan

Example:
  scara-kinetostatic locate result/calibration.json states.csv --out places.csv
  scara-kinetostatic locate result/calibration.json states.csv --rigid --out rigid.csv
"""

from __future__ import annotations

import argparse

from scara_kinetostatic.cli.compensate import files, metadata_of, write
from scara_kinetostatic.cli.shared_arguments import check_file

ARGUMENTS = (
    *files('STATES.csv', 'joint angles and forces'),
    ('--rigid', '', bool, 'leave out all deflection and backlash'),
    ('--nominal', '', bool, 'take the nominal parameters, without effects; their uncertainty is nan'),
    ('--measured', '', bool, 'forces as the sensor reports them: the errors found of it are removed first'),
)


def run(args: argparse.Namespace) -> None:
    """Locates.

    Raises:
        InputError: the calibration or the table is wrong, or FILE.csv cannot be written.
    """
    import numpy as np

    from scara_kinetostatic.files.calibration_file import load_predictor
    from scara_kinetostatic.files.tables import STATES, load_pose_table
    from scara_kinetostatic.model.arm import force_on_object, in_sensor_frame
    from scara_kinetostatic.model.kinematics import posture

    check_file(args.out, [args.calibration, args.table], suffix='.csv')
    predictor = load_predictor(args.calibration, nominal=args.nominal, rigid=args.rigid)
    table = load_pose_table(args.table, STATES)
    joints = predictor.arm.cell.angles(table.pair('q1_rad', 'q2_rad'))
    force = table.force
    if args.measured and not predictor.nominal:
        force = force_on_object(predictor.arm, in_sensor_frame(predictor.arm, force, joints), joints)
    metadata = metadata_of(table, posture(predictor.law.model.parameters, joints), predictor)
    found = predictor.locate(joints, force, metadata)
    (x, y), (std_x, std_y) = found.position.T, np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)).T
    results = {'x_m': x, 'y_m': y, 'std_x_m': std_x, 'std_y_m': std_y, 'cov_xy_m2': found.covariance[:, 0, 1]}
    write(args.out, table, results | {'status': found.status}, predictor)
