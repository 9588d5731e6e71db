"""Write the calibrated arm as URDF, xacro, DH table, correction table or C header.

Writes the calibrated arm in a format of other software:

  urdf    for robot_state_publisher, MoveIt, ros2_control: rigid, the joint
          offsets in the origins of the joints, so that the joint angles which
          the robot reports give the tip (frame tool0)
  xacro   the same as properties and a macro
  dh      Denavit-Hartenberg table (CSV), standard convention
  csv     corrections of the joint angles of the nominal arm, over the
          workspace and the load
  header  C99 header: constants, and functions for the tip from joint angles
          and force, and back

URDF, xacro and DH table hold the geometry alone; compliance and backlash are in
csv and header. Each file says from which calibration it is. The exit status is 3
where the format cannot hold the calibrated model.

--into takes the URDF from which the cell was described: the origins of the two
joints are corrected in it, and that of the next one by l2. Every other byte
stays as it is; from which calibration it is, is said on stderr.

Example:
  scara-kinetostatic export result/calibration.json --format urdf --out arm.urdf
  scara-kinetostatic export result/calibration.json --format urdf --into robot.urdf --out calibrated.urdf
  scara-kinetostatic export result/calibration.json --format csv --force 0 --force 20 --out corrections.csv
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import SEVERAL, check_file, note, real
from scara_kinetostatic.errors import ParameterError

_FORMATS = ('urdf', 'xacro', 'dh', 'csv', 'header')
_FORCE = 'in eight directions, 0 for none; repeatable (default: 0, and the middle of the forces of the touches)'
ARGUMENTS = (
    ('calibration', 'CALIBRATION.json', Path, 'of the result of calibrate'),
    ('--format', '', _FORMATS, 'of the file', {'required': True}),
    ('--out', 'FILE', Path, 'the file (default: stdout)'),
    ('--into', 'FILE', Path, 'of urdf: the URDF of the robot, which is corrected'),
    'of csv',
    ('--step', 'M', real(1e-3), 'distance of the places along x and y (default: 0.025)', {'default': 0.025}),
    ('--force', 'N', real(0), _FORCE, SEVERAL),
)


def run(args: argparse.Namespace) -> None:
    """Exports.

    Raises:
        InputError: the calibration cannot be read, or the file not be written.
        UnsupportedDataError: the format cannot hold the model.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.files.calibration_file import load_calibration
    from scara_kinetostatic.files.export import exported, exported_into

    out, inputs = args.out, [args.calibration, *([args.into] if args.into else [])]
    if args.into and (out is None or args.format != 'urdf'):
        raise ParameterError('--into', 'is for --format urdf with --out FILE', 'give both')
    if out is not None:
        check_file(out, inputs)
    arm, name = load_calibration(args.calibration), args.calibration.name
    text: str | bytes
    if args.into:
        text, notes = exported_into(arm, args.into, name)
    else:
        text, notes = exported(arm, args.format, name, step=args.step, forces=args.force)
    if out is not None:
        write_texts(out.parent, {out.name: text})
    print(text if out is None else f'{out}\n', end='')
    for each in notes:
        note(each)
