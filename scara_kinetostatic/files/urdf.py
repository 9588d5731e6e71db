"""URDF of the arm: as the cell description states it, as it was calibrated, or both side by side.

The frames are those of (5), in the names of REP-103, REP-105 and ROS-Industrial: `base_link` is the frame in which the
objects are given, the tip is `tool0`. The offsets are in the origins of the joints, so that the joint angles which the
robot reports are those of the URDF:

    base_link --(x0, y0), theta1--> link1 --(l1, 0), theta2--> link2 --(l2, 0)--> tool0

A URDF is rigid: the tip is H(L̄, Q), without deflection and backlash.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from scara_kinetostatic.model.parameters import Parameters

BASE_FRAME = 'base_link'
"""Frame in which the objects are given."""
TOOL_FRAME = 'tool0'
"""Frame of the tip; x runs along link 2."""
CALIBRATED = 'calibrated_'
"""Begins the names of the calibrated arm beside the nominal one."""
NOMINAL_COLOUR = (0.55, 0.55, 0.55, 0.6)
CALIBRATED_COLOUR = (0.0, 0.45, 0.70, 0.9)

Colour = tuple[float, float, float, float]


class Arm(NamedTuple):
    """One arm of a URDF.

    Attributes:
        parameters: L̄.
        prefix: of the names of its links and joints.
        colour: red, green, blue, opacity, 0 to 1.
    """

    parameters: Parameters
    prefix: str = ''
    colour: Colour = NOMINAL_COLOUR


def arm_urdf(name: str, joint_names: Sequence[str], arms: Sequence[Arm]) -> str:
    """The text of a URDF.

    Args:
        name: of the robot.
        joint_names: of q1 and q2 in `JointState`.
        arms: the joints of the first have these names; those of the others mimic them.
    """
    robot = Element('robot', name=name)
    SubElement(robot, 'link', name=BASE_FRAME)
    for number, arm in enumerate(arms):
        _add_arm(robot, joint_names, arm, mimics=number > 0)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def side_by_side(name: str, joint_names: Sequence[str], nominal: Parameters, calibrated: Parameters | None) -> str:
    """The text of a URDF of the nominal arm and, where there is one, the calibrated arm."""
    arms = [Arm(nominal)]
    if calibrated is not None:
        arms.append(Arm(calibrated, CALIBRATED, CALIBRATED_COLOUR))
    return arm_urdf(name, joint_names, arms)


def _add_arm(robot: Element, joint_names: Sequence[str], arm: Arm, *, mimics: bool) -> None:
    p, prefix = arm.parameters, arm.prefix
    frames = [BASE_FRAME, *(prefix + frame for frame in ('link1', 'link2', TOOL_FRAME))]
    places = ((p.x0, p.y0, p.theta1), (p.l1, 0.0, p.theta2))
    for number, (joint, (x, y, angle)) in enumerate(zip(joint_names, places, strict=True)):
        made = _add_joint(robot, prefix + joint, 'continuous', frames[number : number + 2], (x, y, angle))
        SubElement(made, 'axis', xyz='0 0 1')
        if mimics:
            SubElement(made, 'mimic', joint=joint)
    _add_joint(robot, f'{prefix}tip', 'fixed', frames[2:], (p.l2, 0.0, 0.0))
    for frame, length in zip(frames[1:], (p.l1, p.l2, 0.0), strict=True):
        _add_link(robot, frame, length, 0.03 * (p.l1 + p.l2), arm)


def _add_joint(
    robot: Element, name: str, kind: str, frames: Sequence[str], pose: tuple[float, float, float]
) -> Element:
    x, y, angle = pose
    joint = SubElement(robot, 'joint', name=name, type=kind)
    SubElement(joint, 'parent', link=frames[0])
    SubElement(joint, 'child', link=frames[1])
    SubElement(joint, 'origin', xyz=f'{x!r} {y!r} 0', rpy=f'0 0 {angle!r}')
    return joint


def _add_link(robot: Element, name: str, length: float, radius: float, arm: Arm) -> None:
    """A link with a cylinder along x; a sphere where it has no length."""
    visual = SubElement(SubElement(robot, 'link', name=name), 'visual')
    SubElement(visual, 'origin', xyz=f'{length / 2!r} 0 0', rpy=f'0 {pi / 2!r} 0')
    geometry = SubElement(visual, 'geometry')
    if length:
        SubElement(geometry, 'cylinder', radius=f'{radius:.6g}', length=repr(abs(length)))
    else:
        SubElement(geometry, 'sphere', radius=f'{radius:.6g}')
    material = SubElement(visual, 'material', name=f'{arm.prefix}arm')
    SubElement(material, 'color', rgba=' '.join(f'{part:g}' for part in arm.colour))
