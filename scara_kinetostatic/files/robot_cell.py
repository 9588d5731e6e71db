"""A cell description from a robot's URDF: two parallel joints of it are the arm, all others are held.

With the axes a_1, a_2 of the joints, the plane of the arm is at right angles to a_1 through the tip. Its normal n is
a_1 or -a_1, so that y is up and x ahead or, where the axes stand upright, n is up and x the robot's. p_1, p_2 are the
places where the axes pierce the plane, T is that of the tip. At readings of zero

    l_1 e_1 = p_2 - p_1,    l_2 e_2 = T - p_2,    theta_1 = angle of e_1,    theta_1 + theta_2 = angle of e_2

in the plane, whose origin is p_1. The static moments are Σ m (r - p_i) over the links that joint i moves, with what the
elbow carries at the elbow for joint 1; where they do not lie along the links, phi_i is the angle between.

Axes that are not exactly parallel make the tip leave the plane and its projection differ from the model's tip. That
angle is said, and how far.

A joint that slides along the normal raises the tip: the one next to it is the lift, unless it is told where to stay.

**The URDF corrected by a calibration**: the robot's own, in which the origins of the two joints, and of the one that
carries the tip, are corrected. With Δ the calibrated less the file's own geometry, in the plane of the arm:

    joint 1:     its place by (Δx0, Δy0), turned about its axis by Δtheta1
    joint 2:     its place by Δl1 along link 1, turned about its axis by Δtheta2
    the next:    its place by Δl2 along link 2, where the calibration changed l2

All else stays to the last byte. The tip is then that of the rigid arm, H(L, Q).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from functools import partial
from math import asin, degrees, pi, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from scara_kinetostatic.errors import CellError, InputError, one_line
from scara_kinetostatic.files.atomic import render
from scara_kinetostatic.files.cell_file import MOST_TURN, read_cell
from scara_kinetostatic.files.urdf import ATTRIBUTE, TOKEN, Joint, RobotDescription, axis_of
from scara_kinetostatic.files.yaml_file import dump_yaml, parse_yaml
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Lift, Plane
from scara_kinetostatic.model.kinematics import wrap
from scara_kinetostatic.model.parameters import MICRO, MILLI, MOMENTS, NANO, Parameters
from scara_kinetostatic.model.quantities import implausible_size, quantity

GRAVITY = 9.81
"""m/s², along -z of the root."""
MOST_TILT = 0.035
"""Axes farther from parallel are not those of a planar arm, rad: 2 degrees."""
_SAID = 1e-4
"""Axes that are farther from parallel are said, rad."""
_LEAST = 1e-4
"""A link of no length, m."""
_LEVEL = 0.01
"""A plane that is less tilted is level, an axis along its normal, rad: URDFs round their angles."""
_DUST, _DIGITS = 1e-12, 15
"""What is less is a rounding error, m and rad; and digits that are none."""
_PARALLEL = NANO
"""Axes that are less off parallel are exactly so, rad."""
_ASSUMED = 3.14
"""Limits of a joint that has none, rad."""


class PlanarArm(NamedTuple):
    """Two joints of a robot as an arm in a plane.

    Attributes:
        nominal: geometry, and static moments where gravity loads the joints; no compliances.
        direction: sign of both readings.
        plane: in the root of the robot.
        tilt: angle between the axes, rad.
        cost: of it, at most: how far the tip leaves the plane, and how far in it from the model's, m.
        mass: of what joint 1 and joint 2 move, kg.
    """

    nominal: Parameters
    direction: tuple[int, int]
    plane: Plane
    tilt: float
    cost: tuple[float, float]
    mass: tuple[float, float]


def planar_arm(robot: RobotDescription, joints: tuple[str, str], tip: str, held: Mapping[str, float]) -> PlanarArm:
    """The arm of two joints.

    Args:
        robot: whose they are.
        joints: shoulder and elbow.
        tip: link at the end of the arm.
        held: positions of other joints, rad or m; 0 of those that are not there.

    Raises:
        InputError: they make none.
    """
    frames = [robot.frame(robot.turning(name).child, held) for name in joints]
    a1, a2 = (_axis(robot, robot.joints[name], held) for name in joints)
    end = robot.frame(tip, held)[:3, 3]
    tilt = asin(min(1.0, float(np.linalg.norm(np.cross(a1, a2)))))
    if tilt > MOST_TILT:
        problem = f'the axes of {joints[0]} and {joints[1]} are {degrees(tilt):.3g} degrees from parallel'
        raise robot.error(problem, 'choose two parallel joints; --at sets the joints between')
    axes, normal = _axes_of_plane(a1)
    lines = [(frame[:3, 3], a) for frame, a in zip(frames, (a1, a2), strict=True)]
    p1, p2 = (at + a * (normal @ (end - at)) / (normal @ a) for at, a in lines)
    e1, e2 = complex(*(axes @ (p2 - p1))), complex(*(axes @ (end - p2)))
    for link, problem in ((e1, 'the axes of both joints are one'), (e2, 'the tip is on the axis of joint 2')):
        if abs(link) < _LEAST:
            raise robot.error(f'{problem}: a link of length zero', 'choose another joint, or another --tip')
    found = {'theta1': np.angle(e1), 'l1': abs(e1), 'theta2': np.angle(e2 / e1), 'l2': abs(e2)}
    beyond1, beyond2 = (dict(robot.masses_beyond(name, held)) for name in joints)
    mass1, mass2 = (sum(mass for mass, _ in beyond.values()) for beyond in (beyond1, beyond2))
    gravity = axes @ (0.0, 0.0, -GRAVITY)
    if np.hypot(*gravity) <= _LEVEL * GRAVITY:
        gravity = np.zeros(2)
    else:
        own = [beyond1[name] for name in beyond1.keys() - beyond2.keys()]
        moment1 = sum((mass * complex(*(axes @ (at - p1))) for mass, at in own), mass2 * e1)
        moment2 = sum((mass * complex(*(axes @ (at - p2))) for mass, at in beyond2.values()), 0j)
        found |= {'s1': abs(moment1), 's2': abs(moment2)}
        found |= {'phi1': np.angle(moment1 / e1), 'phi2': np.angle(moment2 / e2)}
    nominal = Parameters(**dict(zip(found, _rounded(list(found.values())), strict=True)), gravity=_rounded(gravity))
    plane = Plane(robot.root, _rounded(p1), _rounded(axes[0]), _rounded(axes[1]), tip)
    direction = int(np.sign(normal @ a1)), int(np.sign(normal @ a2))
    return PlanarArm(nominal, direction, plane, tilt, _cost(normal, a2, end - p2), (mass1, mass2))


def _cost(normal: Floats, axis: Floats, link: Floats) -> tuple[float, float]:
    """How far the tip leaves the plane, and how far in it from where the model has it, at most, m."""
    turns = np.linspace(-pi, pi, 361)[:, None]
    off = Rotation.from_rotvec(turns * axis).apply(link)
    off -= Rotation.from_rotvec(turns * normal * np.sign(normal @ axis)).apply(link)
    out = off @ normal
    return float(np.abs(out).max()), float(np.linalg.norm(off - out[:, None] * normal, axis=1).max())


def _axes_of_plane(axis: Floats) -> tuple[Floats, Floats]:
    """X and y, (2, 3), and the normal of the plane at right angles to an axis."""
    ahead, left, up = np.eye(3)
    y = up - axis * (axis @ up)
    if np.linalg.norm(y) <= _LEVEL:  # a SCARA
        normal, x = axis * np.sign(axis @ up), ahead - axis * (axis @ ahead)
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(normal, x)]), normal
    y /= np.linalg.norm(y)
    x = np.cross(y, axis)
    x *= np.sign(x @ (ahead if abs(x @ ahead) > MICRO else left))
    return np.stack([x, y]), np.cross(x, y)


def _rounded(values: Any) -> tuple[Any, ...]:
    """Numbers without the digits of rounding errors."""
    return tuple(np.where(np.abs(values) < _DUST, 0.0, np.round(values, _DIGITS)).tolist())


def robot_cell(
    robot: RobotDescription, joints: tuple[str, str], tip: str, at: Mapping[str, float], sensor: str = ''
) -> tuple[str, list[str]]:
    """The cell description of two joints of a robot, without objects; and what is to be known of it.

    Args:
        robot: whose they are.
        joints: shoulder and elbow.
        tip: link at the end of the arm.
        at: positions of other joints, rad or m; 0 of those that are not there.
        sensor: link in whose frame the wrench is; empty: the tip.

    Raises:
        InputError: they make no arm; or a joint between or beyond does not stay where it is put.
    """
    held, lift = _held(robot, joints, tip, at)
    positions = held | ({lift.joint: lift.down} if lift else {})
    arm = planar_arm(robot, joints, tip, positions)
    parallel = 'parallel'
    if arm.tilt > _PARALLEL:
        out, aside = (quantity(cost, 'm') for cost in arm.cost)
        cost = f'the tip leaves the plane by up to {out}, and is in it up to {aside} from where the model has it'
        parallel = f'{degrees(arm.tilt):.3g} degrees off parallel: {cost}'
    mounted = _mounting(robot, sensor or tip, joints, positions, arm)
    moments = {name: getattr(arm.nominal, name) for name in MOMENTS}
    known = {name: float(f'{0.3 * moment:.3g}') for name, moment in moments.items() if moment}
    has_weight = bool(known)
    notes = [f'the axes are {parallel}'] if arm.tilt > _SAID else []
    if not arm.nominal.has_gravity:
        tilt = degrees(np.hypot(arm.plane.x[2], arm.plane.y[2]))
        notes.append(f'gravity is across the plane{f" to {tilt:.1g} degrees" if tilt > _PARALLEL else ""}: none in it')
    elif not has_weight:
        notes.append(f'{robot.where} has no inertias: state robot.moments, {{s1, s2}} in kg m')
    limits, guessed = {}, list[str]()
    for name in joints:
        pair, stated = _limits(robot.joints[name])
        low, high = limits[name] = list(pair or (-_ASSUMED, _ASSUMED))
        if stated:
            guessed.append(f'limits of {name} {stated}: {low:.4g} to {high:.4g} rad is assumed, correct robot.limits')
    plane = arm.plane._asdict() | {key: list(getattr(arm.plane, key)) for key in ('origin', 'x', 'y')}
    assumed = ' '.join(name for name in held if name not in at)
    said = {'source': robot.where, 'assumed': assumed, 'root': robot.root, 'tip': tip, 'sensor': sensor or tip}
    trees = {'known': {'nominal': known}, 'names': list(joints), 'plane': plane, 'limits': limits, 'held': held}
    trees['lift'] = lift._asdict() if lift else {}
    text = render(
        Path(__file__).with_name('cell.yaml.j2'),
        escape=False,
        arm=arm,
        joints=[one_line(name) for name in joints],
        continuous=[one_line(name) for name in joints if robot.joints[name].type == 'continuous'],
        parallel=parallel,
        has_weight=has_weight,
        guessed=list(map(one_line, guessed)),
        lift_joint=one_line(lift.joint) if lift else '',
        lift_stays=lift is not None and lift.joint in held,
        mounted=mounted,
        number=partial(dump_yaml, flow=True),
        **{name: one_line(text) for name, text in said.items()},
        **{name: dump_yaml(tree, flow=True) if tree else '' for name, tree in trees.items()},
    )
    where = f'the cell of {robot.where}'
    read_cell(parse_yaml(text, where, CellError), where, may_be_empty=True)  # whoever reads it finds it right
    if lift and lift.joint not in held:
        notes.append(f'{lift.joint} is proposed as robot.lift, up {lift.up:g} and down {lift.down:g} m: check both')
    return text, notes + guessed


def _held(
    robot: RobotDescription, joints: tuple[str, str], tip: str, at: Mapping[str, float]
) -> tuple[dict[str, float], Lift | None]:
    """Positions of the other joints on the way to the tip, and of those that are stated; and the lift, if there is one.

    Raises:
        InputError: the two do not move the tip in their order, or another joint does not stay where it is put.
    """
    for name in joints:
        robot.turning(name)
    chain = robot.chain(tip)
    names = [joint.name for joint in chain if joint.type != 'fixed']
    if missing := [name for name in joints if name not in names]:
        raise robot.error(f'{missing[0]} does not move link {tip!r}', f'it is moved by {" ".join(names) or "none"}')
    if joints[0] == joints[1]:
        raise robot.error(f'{joints[0]} is named twice', 'name two joints, the shoulder first')
    if names.index(joints[0]) >= names.index(joints[1]):
        raise robot.error(f'{joints[1]} comes before {joints[0]}', f'write --joints {joints[1]} {joints[0]}')
    between = names[names.index(joints[0]) : names.index(joints[1])]
    first, lifts = _axis(robot, robot.joints[joints[0]], at), list[Lift]()
    for joint in (joint for joint in chain if joint.name not in joints):
        if joint.mimics or joint.type not in ('fixed', 'revolute', 'continuous', 'prismatic'):
            kind = f'mimics {joint.mimics}' if joint.mimics else f'is {joint.type}'
            raise robot.error(f'joint {joint.name!r} on the way to {tip!r} {kind}', 'choose another --tip')
        if joint.type != 'prismatic':
            continue
        along = _axis(robot, joint, at)
        travel, _ = _limits(joint)
        if travel and np.linalg.norm(np.cross(first, along)) <= _LEVEL:
            low, high = sorted(travel, reverse=bool(along @ _axes_of_plane(first)[1] < 0))
            down = at.get(joint.name, low)
            lifts = [Lift(joint.name, high, down), *lifts] if high != down else lifts
        elif joint.name in between:
            problem = f'joint {joint.name!r} between the two is prismatic: link 1 has no length of its own'
            raise robot.error(problem, 'choose other joints, or make it fixed in a copy of the URDF')
    for name in at:
        if name in joints or robot.joint(name).type == 'fixed' or robot.joint(name).mimics:
            raise robot.error(f'--at {name}: it is not a joint to be held', 'name other joints that move')
    lift = max(lifts, key=lambda each: each.joint not in at, default=None)  # that next to the tip
    moving = {*joints, *({lift.joint} - at.keys() if lift else ())}
    held = {name: at.get(name, 0.0) for name in dict.fromkeys((*names, *at)) if name not in moving}
    for name, value in held.items():
        if robot.joints[name].type != 'prismatic' and abs(value) > 2 * pi + MILLI:
            raise robot.error(f'--at {name}={value:g} is beyond a turn', f'in degrees? Give rad: {radians(value):.6g}')
        limits, _ = _limits(robot.joints[name])
        if limits and not limits[0] <= value <= limits[1]:
            problem = f'{name} at {value:g} is beyond its limits, {limits[0]:g} to {limits[1]:g}'
            raise robot.error(problem, f'state another position: --at {name}=VALUE')
    return held, lift


def _axis(robot: RobotDescription, joint: Joint, positions: Mapping[str, float]) -> Floats:
    """The axis of a joint in the root, of unit length, (3,)."""
    return np.asarray(robot.frame(joint.child, positions)[:3, :3] @ axis_of(joint))


def _limits(joint: Joint) -> tuple[tuple[float, float] | None, str]:
    """The limits of a joint, rad or m, None where it has none; and what the URDF has, where these are others."""
    if joint.type == 'continuous':
        return None, ''
    if joint.limits is None:
        return None, 'are missing'
    (low, high), stated = joint.limits, '{:g} to {:g} in the URDF'.format(*joint.limits)
    largest, is_angle = max(abs(low), abs(high)), joint.type == 'revolute'
    if not low < high:
        return None, stated
    if is_angle and MOST_TURN < largest <= degrees(4 * pi):
        return (radians(low), radians(high)), f'{stated} (in degrees?)'
    is_none = largest > MOST_TURN if is_angle else implausible_size(largest, 'm')
    return (None, stated) if is_none else (joint.limits, '')


def _mounting(
    robot: RobotDescription, sensor: str, joints: tuple[str, str], held: Mapping[str, float], arm: PlanarArm
) -> str:
    """The key that says how the sensor is mounted on link 2: `rotation`, or `axes` where its z axis is not across."""
    if joints[1] not in [joint.name for joint in robot.chain(sensor)]:
        raise robot.error(f'link {sensor!r} is not moved by {joints[1]}', 'name the link of the sensor by --sensor')
    turn = np.exp(1j * (arm.nominal.theta1 + arm.nominal.theta2))
    link2 = arm.plane.axes @ [[turn.real, -turn.imag, 0], [turn.imag, turn.real, 0], [0, 0, 1]]
    seen = robot.frame(sensor, held)[:3, :3].T @ link2  # axes of link 2 in the sensor, as columns
    if seen[2, 2] > 1 - _PARALLEL:
        return f'rotation: {dump_yaml(_rounded([-np.arctan2(seen[1, 0], seen[0, 0])])[0], flow=True)}'
    axes = {name: list(_rounded(seen[:, k])) for k, name in enumerate('xy')}
    return f'axes: {dump_yaml(axes, flow=True)}'


_MOST = 0.05
"""A geometry that differs by more is that of another robot, m and rad."""


class Pose(NamedTuple):
    """Place, m, and roll, pitch and yaw, rad, of a joint in its parent."""

    xyz: Floats
    rpy: Floats


def corrected_origins(arm: CalibratedArm, robot: RobotDescription) -> dict[str, Pose]:
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
        if max(*np.abs(move), abs(turn)) > _DUST
    }


def _moved(robot: RobotDescription, name: str, positions: Mapping[str, float], move: Floats, turn: float) -> Pose:
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
    return Pose(*(np.where(np.abs(new - old) > _DUST, np.round(new, _DIGITS) + 0.0, old) for old, new in pairs))


def with_origins(robot: RobotDescription, origins: Mapping[str, Pose]) -> bytes:
    """The URDF with other origins of some joints; all other bytes, and numbers that are the same, stay."""
    changes = [change for name, origin in origins.items() for change in _changes(robot, robot.joints[name], origin)]
    text = robot.text
    for start, end, new in sorted(changes, reverse=True):
        text = text[:start] + new + text[end:]
    return text.encode(robot.encoding)


def _changes(robot: RobotDescription, joint: Joint, origin: Pose) -> list[tuple[int, int, str]]:
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
