"""The user's own URDF, in which the origins of the two joints, and of the one that carries the tip, are corrected.

With Δ the calibrated less the file's own geometry, in the plane of the arm (`files.robot_cell`):

    joint 1:     its place by (Δx0, Δy0), turned about its axis by Δtheta1
    joint 2:     its place by Δl1 along link 1, turned about its axis by Δtheta2
    the next:    its place by Δl2 along link 2, where the calibration changed l2

All other bytes stay. The tip is then that of the rigid arm, H(L, Q).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.robot_cell import planar_arm
from scara_kinetostatic.files.robot_urdf import Robot, axis_of
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import wrap

_MOST = 0.05
"""A geometry that differs by more is that of another robot, m and rad."""
_SAME = 1e-14
"""Numbers that differ by less keep their digits."""


class Origin(NamedTuple):
    """Place, m, and roll, pitch and yaw, rad, of a joint in its parent, and the link that it carries."""

    xyz: Floats
    rpy: Floats
    child: str


def corrected_origins(arm: CalibratedArm, robot: Robot) -> dict[str, Origin]:
    """The origins that change, by joint.

    Raises:
        InputError: the cell of the calibration has no plane of a robot, or the robot is another one.
    """
    cell, p = arm.cell, arm.model.parameters
    if not cell.plane.tip or cell.coupling:
        problem = 'a URDF has no coupling of joints' if cell.coupling else 'its cell has no robot.plane with a tip'
        raise InputError('the calibration', problem, 'describe the cell by `scara-kinetostatic cell --urdf`')
    joints, positions, plane = cell.joint_names, dict(cell.hold), cell.plane
    now = planar_arm(robot, joints, plane.tip, positions)
    x, y, height = plane.in_plane(np.array(now.plane.origin)).tolist()
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
    moves = (np.array([*lengths[:2], 0.0]), lengths[3] * along[0], lengths[4] * along[1])
    turns = (*(angles * cell.direction).tolist(), 0.0)
    return {
        name: _moved(robot, name, positions, plane.axes @ move, turn)
        for name, move, turn in zip((*joints, third), moves, turns, strict=True)
        if np.abs(move).max() > _SAME or turn
    }


def _moved(robot: Robot, name: str, positions: Mapping[str, float], move: Floats, turn: float) -> Origin:
    """The origin of a joint moved in the root, m, and turned about its axis, rad."""
    joint = robot.joints[name]
    origin = joint.origin
    xyz, rpy = np.array((origin and (origin.xyz, origin.rpy)) or np.zeros((2, 3)), dtype=float)
    parent = robot.frame(joint.parent, positions)[:3, :3]
    turned = Rotation.from_euler('xyz', rpy) * Rotation.from_rotvec(turn * np.array(axis_of(joint)))
    rpy = _angles_near(rpy, turned) if turn else rpy
    xyz = xyz + parent.T @ move
    return Origin(np.round(xyz, 15) + 0.0, np.round(rpy, 15) + 0.0, joint.child)


def _angles_near(rpy: Floats, turned: Rotation) -> Floats:
    """Those angles of a rotation, of the two triples that it has, that are near to others, (3,), rad."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # where roll and yaw turn about one axis, one of them is taken as 0
        roll, pitch, yaw = turned.as_euler('xyz')
    both = np.array([[roll, pitch, yaw], [roll + pi, pi - pitch, yaw + pi]])
    off = wrap(both - rpy)
    return np.asarray(rpy + off[np.abs(off).sum(axis=1).argmin()])


def with_origins(content: bytes, origins: Mapping[str, Origin], comment: str, robot: Robot) -> str:
    """The text of a URDF with other origins, and a comment before its root.

    Raises:
        InputError: it is not UTF-8, or a number in an origin is none.
    """
    places, root = _places(content, set(origins))
    newline = b'\r\n' if b'\r\n' in content else b'\n'
    edits = [(root, root, comment.encode().replace(b'\n', newline))]
    try:
        for name, (begin, is_origin) in places.items():
            tag = re.compile(rb'<(?:[^>"\']|"[^"]*"|\'[^\']*\')*>').match(content, begin)
            assert tag is not None  # expat has read it
            made = tag[0] if is_origin else b'<origin/>'
            for key, values in (('xyz', origins[name].xyz), ('rpy', origins[name].rpy)):
                made = _with_attribute(made, key.encode(), values.tolist())
            edits.append((tag.start(), tag.end(), made) if is_origin else (tag.end(), tag.end(), made))
        for begin, end, made in sorted(edits, reverse=True):
            content = content[:begin] + made + content[end:]
        return content.decode()
    except (ValueError, UnicodeError) as error:
        remedy = 'save it as UTF-8, with plain numbers in the origins: expand a xacro first'
        raise robot.error(f'an origin cannot be corrected: {error}', remedy) from error


def _places(content: bytes, wanted: set[str]) -> tuple[dict[str, tuple[int, bool]], int]:
    """Where the origin of each joint begins, or the joint itself where it has none; and the root."""
    found: dict[str, tuple[int, bool]] = {}
    path: list[tuple[str, str]] = []
    begins: list[int] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: Mapping[str, str]) -> None:
        path.append((tag, attributes.get('name', '')))
        begins.append(parser.CurrentByteIndex)
        kinds, name = [each for each, _ in path], path[min(1, len(path) - 1)][1]
        if kinds in (['robot', 'joint'], ['robot', 'joint', 'origin']) and name in wanted:
            found[name] = parser.CurrentByteIndex, len(path) == 3

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: path.pop()
    parser.Parse(content, True)
    return found, begins[0]


def _with_attribute(tag: bytes, key: bytes, values: Sequence[float]) -> bytes:
    """The tag with three numbers; those that are the same keep their digits."""
    pattern = re.compile(rb'(\s' + key + rb'\s*=\s*)(["\'])(.*?)\2', re.DOTALL)
    given = pattern.search(tag)
    if given is None:
        return tag if not any(values) else re.sub(rb'\s*/?>$', b' ' + key + b'="' + _text([], values) + rb'"\g<0>', tag)
    made = _text(given[3].split(), values)
    return tag if made == b' '.join(given[3].split()) else tag[: given.start(3)] + made + tag[given.end(3) :]


def _text(before: Sequence[bytes], values: Sequence[float]) -> bytes:
    olds: Sequence[Any] = before or [b'nan'] * 3
    pairs = zip(olds, values, strict=True)
    return b' '.join(old if abs(float(old) - new) < _SAME else repr(new).encode() for old, new in pairs)


def origins_yaml(origins: Mapping[str, Origin], lines: Sequence[str]) -> str:
    """The origins as `ur_calibration` writes them: by the link that a joint carries, without ``_link``."""
    found = [*(f'# {line}' for line in lines), 'kinematics:']
    for origin in origins.values():
        values = (*origin.xyz.tolist(), *origin.rpy.tolist())
        numbers = zip(('x', 'y', 'z', 'roll', 'pitch', 'yaw'), values, strict=True)
        found += [f'  {origin.child.removesuffix("_link")}:', *(f'    {key}: {value!r}' for key, value in numbers)]
    return '\n'.join(found) + '\n'
