"""Joint angles for wanted places of the tip under force.

The joint angles to command so that the tip of the calibrated arm reaches its
place under a force (inverse kinetostatics): deflection of joints and gripper,
backlash, and all effects that were found are compensated.

POSES.csv has the columns x_m, y_m (tip, base frame), fx_N, fy_N (force of the
robot on the object, base frame) and, optional, elbow: left, sin(q2 + theta2) > 0,
or right. Without it, the elbow is left, or right where the calibration has
touches with the right elbow only. Where the calibration has an effect of time or
of the motion before, time_s (since its first touch), approach1, approach2, too.

The result adds q1_rad, q2_rad, the torques c1_Nm, c2_Nm, std_normal_m, the
standard uncertainty of the tip along the force (without a force: in the worst
direction), and status, the last of these that applies:
  ok            as stated
  unloaded      force or torque too small for the sign of a backlash to be known
  extrapolated  a force, an elbow or a time beyond those of the calibration
  undetermined  the calibration does not determine the uncertainty
  out_of_reach  no joint angles; they are nan
  beyond_limits of the joints, where the cell description states them
The exit status is 3 where no pose is within reach and limits.

--command adds x_command_m, y_command_m, phi_command_rad: the pose, base frame, to
give to a controller that computes with the nominal arm, so that its joints come to
these angles; phi is the direction of link 2. The controller takes the same elbow.

Example:
  scara-kinetostatic compensate result/calibration.json poses.csv --out commands.csv
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scara_kinetostatic.cli.shared_arguments import Option, check_file, note

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from scara_kinetostatic.files.tables import PoseTable
    from scara_kinetostatic.model.arm import Predictor
    from scara_kinetostatic.model.arrays import Indices
    from scara_kinetostatic.model.extended_model import TouchMetadata


def files(table: str, meaning: str) -> tuple[Option, ...]:
    """The options of the calibration, the table and ``--out``."""
    return (
        ('calibration', 'CALIBRATION.json', Path, 'or a cell.yaml: the nominal arm'),
        ('table', table, Path, meaning),
        ('--out', 'FILE.csv', Path, 'the table with its results', {'required': True}),
    )


ARGUMENTS = (
    *files('POSES.csv', 'wanted places of the tip and forces'),
    ('--command', '', bool, 'the pose to command as well, for a controller that takes no joint angles'),
)


def run(args: argparse.Namespace) -> None:
    """Compensates.

    Raises:
        InputError: the calibration or the table is wrong, or FILE.csv cannot be written.
        UnsupportedDataError: no pose is within reach and limits.
    """
    import numpy as np

    from scara_kinetostatic.errors import UnsupportedDataError
    from scara_kinetostatic.files.calibration_file import load_predictor
    from scara_kinetostatic.files.tables import POSES, load_pose_table
    from scara_kinetostatic.model.arm import STATUSES
    from scara_kinetostatic.model.kinematics import pose

    check_file(args.out, [args.calibration, args.table], suffix='.csv')
    predictor = load_predictor(args.calibration)
    table = load_pose_table(args.table, POSES)
    touched = predictor.arm.used.postures
    usual = 'left' if 1 in touched or not touched else 'right'
    elbows = table.elbows or (usual,) * len(table)
    sides = np.array([1 if elbow == 'left' else -1 for elbow in elbows], dtype=np.intp)
    found = predictor.compensate(table.pair('x_m', 'y_m'), table.force, sides, metadata_of(table, sides, predictor))
    if np.isin(found.status, STATUSES[-2:]).all():
        limits, remedy = '', 'check the unit in the headings; places are in the base frame'
        if STATUSES[-1] in found.status:
            limits, remedy = ', and within robot.limits', 'choose other places, or the other elbow'
        raise UnsupportedDataError(f'{args.table}: no pose is within reach of the arm{limits}', remedy)
    cell = predictor.arm.cell
    (q1, q2), (c1, c2) = cell.readings(found.joints).T, cell.in_sense(found.torques).T + 0.0  # no -0.0
    results = {'q1_rad': q1, 'q2_rad': q2, 'c1_Nm': c1, 'c2_Nm': c2, 'std_normal_m': found.std_normal}
    if args.command:
        x, y, phi = pose(cell.nominal, found.joints).T
        results |= {'x_command_m': x, 'y_command_m': y, 'phi_command_rad': phi}
    write(args.out, table, results | {'status': found.status}, predictor)
    if table.elbows is None:
        note(f'{table.source}: no column elbow; {usual} is taken for all rows')


def metadata_of(table: PoseTable, sides: Indices, predictor: Predictor) -> TouchMetadata:
    """What effects need to know of the rows."""
    from scara_kinetostatic.model.extended_model import TouchMetadata
    from scara_kinetostatic.touches.detection import approach_of

    metadata = TouchMetadata.plain(len(table))._replace(posture=sides)
    if table.time is not None:
        metadata = metadata._replace(time=table.time)
    if table.approach is not None:
        metadata = metadata._replace(approach=approach_of(table.approach, predictor.arm.cell))
    return metadata


def write(path: Path, table: PoseTable, results: dict[str, NDArray[Any]], predictor: Predictor) -> None:
    """Writes the table, and says what is to be known of it."""
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.model.arm import STATUSES
    from scara_kinetostatic.model.quantities import count

    write_texts(path.parent, {path.name: table.text_with(results)})
    reservations = () if predictor.nominal else predictor.arm.reservations
    for text in reservations:
        note(text)
    if same := ', '.join(name for name in table.heading if name in results):
        note(f'{table.source}: replaced by results: {same}')
    columns = (('time', table.time, 'time_s'), ('approach', table.approach, 'approach1, approach2'))
    for name, given, wanted in columns:
        if given is None and (effects := predictor.effects_of(name)):
            note(f'{effects[0]} depends on {name}; 0 is taken, as the table has no {wanted}')
    if effects := predictor.effects_of('history'):
        note(f'{effects[0]} depends on the load before; none, and no preload, is taken')
    numbers = Counter(results['status'].tolist())
    statuses = ', '.join(f'{numbers[name]} {name}' for name in STATUSES if numbers[name])
    print(f'{count(len(table), "row")}: {statuses}\n{path}')
