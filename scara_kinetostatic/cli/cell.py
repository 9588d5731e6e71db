"""Write a cell description from a robot's URDF.

Two parallel joints of a robot are an arm in a plane: the axes of a SCARA, or
shoulder and elbow of an arm with six or seven joints. Reads the URDF of the
robot, holds all other joints where --at puts them (rad, m; 0 unless told), and
writes a cell description: joint names, directions, lengths, offsets, limits,
the plane in the robot's frame, gravity in it, static moments, the mounting of
the sensor. Comments say where each number comes from. What is
touched has to be filled in.

The URDF is that of a file, or is heard on a topic, as robot_state_publisher
has it. Joints that --at does not name are taken at 0; one that slides along the
normal of the plane is proposed as the lift, down for the touches.

Example:
  scara-kinetostatic cell --urdf ur5.urdf --joints shoulder_lift_joint elbow_joint --tip tool0 --out cell.yaml
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import check_file, note, real
from scara_kinetostatic.errors import InputError, ParameterError


def _position(text: str) -> tuple[str, float]:
    name, equals, value = text.rpartition('=')
    if not equals:
        raise argparse.ArgumentTypeError(f'expected JOINT=VALUE, got {text!r}')
    return name, real()(value)


_HELD = 'position of another joint, rad or m; several, or repeatable'
ARGUMENTS = (
    (
        ('--urdf', 'FILE', Path, 'URDF of the robot'),
        ('--topic', 'NAME', str, 'topic that carries it, such as robot_description'),
    ),
    ('--joints', ('SHOULDER', 'ELBOW'), str, 'the two joints', {'nargs': 2, 'required': True}),
    ('--tip', 'LINK', str, 'link whose origin is the tip', {'required': True}),
    ('--at', 'JOINT=VALUE', _position, _HELD, {'nargs': '+', 'action': 'extend', 'default': []}),
    ('--sensor', 'LINK', str, 'link in whose frame the wrench is (default: the tip)', {'default': ''}),
    ('--out', 'FILE', Path, 'the cell description; must not exist', {'required': True}),
)


def run(args: argparse.Namespace) -> None:
    """Writes the cell description.

    Raises:
        InputError: the URDF cannot be read, or the joints are no such arm.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.files.robot_cell import robot_cell
    from scara_kinetostatic.files.urdf import RobotDescription, read_robot

    if len(dict(args.at)) < len(args.at):
        raise ParameterError('--at', 'names a joint twice', 'give one position of each')
    if args.urdf:
        robot = read_robot(args.urdf)
        check_file(args.out, [args.urdf])
    else:
        from scara_kinetostatic.nodes.streams import heard_description

        robot = RobotDescription(heard_description(args.topic).encode(), args.topic)
    if args.out.exists():
        raise InputError(f'{args.out}', 'exists, and may have objects filled in', 'give another --out')
    text, notes = robot_cell(robot, tuple(args.joints), args.tip, dict(args.at), args.sensor)
    write_texts(args.out.parent, {args.out.name: text})
    print(args.out)
    for each in notes:
        note(each)
