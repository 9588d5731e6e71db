"""A robot's own URDF, in which the origins of the two joints, and of the one that carries the tip, are corrected.

With Δ the calibrated less the file's own geometry, in the plane of the arm (`files.robot_cell`):

    joint 1:     its place by (Δx0, Δy0), turned about its axis by Δtheta1
    joint 2:     its place by Δl1 along link 1, turned about its axis by Δtheta2
    the next:    its place by Δl2 along link 2, where the calibration changed l2

All else stays to the last byte. The tip is then that of the rigid arm, H(L, Q).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from math import pi
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.robot_cell import planar_arm
from scara_kinetostatic.files.robot_urdf import ATTRIBUTE, TOKEN, Joint, Robot, axis_of
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import wrap

_MOST = 0.05
"""A geometry that differs by more is that of another robot, m and rad."""
_SAME = 1e-12
"""A joint that moves by less stays as it is, m or rad."""


class Origin(NamedTuple):
    """Place, m, and roll, pitch and yaw, rad, of a joint in its parent."""

    xyz: Floats
    rpy: Floats


def corrected_origins(arm: CalibratedArm, robot: Robot) -> dict[str, Origin]:
    """The origins that change, by joint.

    Raises:
        InputError: the cell of the calibration has no plane of a robot, or the robot is another one.
    """
    cell, p = arm.cell, arm.model.parameters
    if not cell.plane.tip or cell.coupling:
        problem = 'a URDF has no coupling of joints' if cell.coupling else 'its cell has no robot.plane with a tip'
        raise InputError('the calibration', problem, 'describe the cell by `scara-kinetostatic cell --urdf`')
    joints, positions, plane = cell.joint_names, cell.positions, cell.plane
    now = planar_arm(robot, joints, plane.tip, positions)
    x, y, height = plane.in_plane(np.array(now.plane.origin)).tolist()
    height *= not cell.lift  # may be lowered to another one
    own = now.nominal
    lengths = np.array([p.x0 - x, p.y0 - y, height, p.l1 - own.l1, p.l2 - own.l2])
    angles = wrap(np.array([p.theta1 - own.theta1, p.theta2 - own.theta2]))
    off = max(*np.abs(lengths), *np.abs(angles), np.abs(plane.axes - now.plane.axes).max())
    if now.direction != cell.direction or off > _MOST:
        problem = f'differs by {off:.2g} m or rad from what was calibrated, or a joint turns the other way'
        raise robot.error(problem, 'give the URDF from which the cell was described')
    chain = robot.chain(plane.tip)
    third = chain[[joint.name for joint in chain].index(joints[1]) + 1].name
    along = np.array([[np.cos(a), np.sin(a), 0.0] for a in (own.theta1, own.theta1 + own.theta2)])
    moves = (np.array([*lengths[:2], 0.0]), *(lengths[3:, None] * along))
    turns = (*(angles * cell.direction).tolist(), 0.0)
    return {
        name: _moved(robot, name, positions, plane.axes @ move, turn)
        for name, move, turn in zip((*joints, third), moves, turns, strict=True)
        if max(*np.abs(move), abs(turn)) > _SAME
    }


def _moved(robot: Robot, name: str, positions: Mapping[str, float], move: Floats, turn: float) -> Origin:
    """The origin of a joint moved in the root, m, and turned about its axis, rad."""
    joint = robot.joints[name]
    xyz, rpy = np.array(joint.xyz), np.array(joint.rpy)
    parent = robot.frame(joint.parent, positions)[:3, :3]
    if turn:
        turned = Rotation.from_euler('xyz', rpy) * Rotation.from_rotvec(turn * np.array(axis_of(joint)))
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # where roll and yaw turn about one axis, one of them is taken as 0
            roll, pitch, yaw = turned.as_euler('xyz')
        off = wrap(np.array([[roll, pitch, yaw], [roll + pi, pi - pitch, yaw + pi]]) - rpy)
        rpy = rpy + off[np.abs(off).sum(axis=1).argmin()]  # of its two triples that which is near the old one
    pairs = (joint.xyz, xyz + parent.T @ move), (joint.rpy, rpy)
    return Origin(*(np.where(np.abs(new - old) > _SAME, np.round(new, 15) + 0.0, old) for old, new in pairs))


def with_origins(robot: Robot, origins: Mapping[str, Origin]) -> bytes:
    """The URDF with other origins of some joints; all other bytes, and numbers that are the same, stay."""
    changes = [change for name, origin in origins.items() for change in _changes(robot, robot.joints[name], origin)]
    text = robot.text
    for start, end, new in sorted(changes, reverse=True):
        text = text[:start] + new + text[end:]
    return text.encode(robot.encoding)


def _changes(robot: Robot, joint: Joint, origin: Origin) -> list[tuple[int, int, str]]:
    """What makes an origin that of a joint: from where to where there is another text, and this."""
    element, pairs = joint.element.find('origin'), {'xyz': (joint.xyz, origin.xyz), 'rpy': (joint.rpy, origin.rpy)}
    moved = {key: (old, new.tolist()) for key, (old, new) in pairs.items() if (new != old).any()}
    if element is None:
        place = robot.starts[joint.element[0]]
        words = ''.join(f' {key}="{" ".join(map(repr, new))}"' for key, (_, new) in moved.items())
        before = robot.text[:place]
        return [(place, place, f'<origin{words}/>{before[len(before.rstrip()) :]}')]
    tag = TOKEN.match(robot.text, robot.starts[element])
    assert tag is not None  # it was one when it was read
    spans = {found[1]: found.span(2) for found in reversed([*re.finditer(ATTRIBUTE, tag[0])])}
    changes, begin, behind = [], tag.start() + 1, tag.end('tag')
    for key, (old, new) in moved.items():
        if key not in spans:
            changes.append((behind, behind, f' {key}="{" ".join(map(repr, new))}"'))
            continue
        start, end = spans[key]
        texts = zip(tag[0][start + 1 : end - 1].split(), old, new, strict=True)
        kept = ' '.join(text if was == now else repr(now) for text, was, now in texts)
        changes.append((begin + start, begin + end - 2, kept))
    return changes
