"""A cell description from a robot's URDF: two parallel joints of it are the arm, all others are held.

With the axes a_1, a_2 of the joints, the plane of the arm is at right angles to a_1 through the tip. Its normal n is
a_1 or -a_1, so that y is up and x ahead or, where the axes stand upright, n is up and x the robot's. p_1, p_2 are the
places where the axes pierce the plane, T is that of the tip. At readings of zero

    l_1 e_1 = p_2 - p_1,    l_2 e_2 = T - p_2,    theta_1 = angle of e_1,    theta_1 + theta_2 = angle of e_2

in the plane, whose origin is p_1. The static moments are Σ m (r - p_i) over the links that joint i moves, with what the
elbow carries at the elbow for joint 1; where they do not lie along the links, phi_i is the angle between.

Axes that are not exactly parallel make the tip leave the plane and its projection differ from the model's tip; how much
is worked out over all positions of the joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import asin, degrees, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.files.robot_urdf import Robot, axis_of
from scara_kinetostatic.files.template import render
from scara_kinetostatic.files.yaml_file import dump_yaml
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import Parameters, quantity
from scara_kinetostatic.model.plane import Plane

GRAVITY = 9.81
"""m/s², along -z of the root."""
MOST_TILT = 0.035
"""Axes farther from parallel are not those of a planar arm, rad: 2 degrees."""
_EXACT = 1e-9
_LEAST = 1e-4
"""A link of no length, m; gravity of no size, m/s²."""
_PLACES = 15
"""Decimals to which numbers are rounded, so that no rounding error is written as a digit."""


class PlanarArm(NamedTuple):
    """Two joints of a robot as an arm in a plane.

    Attributes:
        nominal: geometry, and static moments where gravity loads the joints; no compliances.
        direction: sign of both readings.
        plane: in the root of the robot.
        tilt: angle between the axes, rad.
        off_plane: by how much the tip leaves the plane at most, m.
        off_model: distance of its projection from the tip of the model at most, m.
        mass: of what joint 1 and joint 2 move, kg.
    """

    nominal: Parameters
    direction: tuple[int, int]
    plane: Plane
    tilt: float
    off_plane: float
    off_model: float
    mass: tuple[float, float]


def planar_arm(robot: Robot, joints: tuple[str, str], tip: str, held: Mapping[str, float]) -> PlanarArm:
    """The arm of two joints.

    Args:
        robot: whose they are.
        joints: shoulder and elbow.
        tip: link at the end of the arm.
        held: positions of other joints, rad or m; 0 of those that are not there.

    Raises:
        InputError: they make none.
    """
    (a1, o1), (a2, o2) = (_axis(robot, joint, held) for joint in joints)
    end = robot.frame(tip, held)[:3, 3]
    tilt = asin(min(1.0, float(np.linalg.norm(np.cross(a1, a2)))))
    if tilt > MOST_TILT:
        problem = f'the axes of {joints[0]} and {joints[1]} are {degrees(tilt):.3g} degrees from parallel'
        raise robot.error(problem, 'choose two parallel joints; --at sets the joints between')
    x, y = _axes_of_plane(a1)
    n = np.cross(x, y)
    axes = np.stack([x, y])
    p1, p2 = (o + a * (n @ (end - o)) / (n @ a) for o, a in ((o1, a1), (o2, a2)))
    e1, e2 = (complex(*(axes @ line)) for line in (p2 - p1, end - p2))
    for length, problem in ((abs(e1), 'the axes of both joints are one'), (abs(e2), 'the tip is on the axis of joint 2')):
        if length < _LEAST:
            raise robot.error(f'{problem}: a link of length zero', 'choose another joint, or another --tip')
    gravity = axes @ (0.0, 0.0, -GRAVITY)
    geometry = Parameters(
        theta1=_rounded(np.angle(e1)), l1=_rounded(abs(e1)), theta2=_rounded(np.angle(e2 / e1)), l2=_rounded(abs(e2))
    )
    direction = int(np.sign(n @ a1)), int(np.sign(n @ a2))
    plane = Plane(robot.root, _vector(p1), _vector(x), _vector(y), tip)
    beyond2 = {name: (mass, at) for name, mass, at in robot.masses_beyond(joints[1], held)}
    own = [(mass, at) for name, mass, at in robot.masses_beyond(joints[0], held) if name not in beyond2]
    moment2 = sum((mass * complex(*(axes @ (at - p2))) for mass, at in beyond2.values()), 0j)
    mass2 = sum(mass for mass, _ in beyond2.values())
    moment1 = sum((mass * complex(*(axes @ (at - p1))) for mass, at in own), mass2 * e1)
    if np.hypot(*gravity) > _LEAST:
        geometry = geometry.replace(
            gravity=_vector(gravity), s1=_rounded(abs(moment1)), s2=_rounded(abs(moment2)),
            phi1=_rounded(np.angle(moment1 / e1)), phi2=_rounded(np.angle(moment2 / e2)),
        )  # fmt: skip
    off_plane, off_model = _errors(robot, joints, held, geometry, direction, plane)
    mass1 = mass2 + sum(mass for mass, _ in own)
    return PlanarArm(geometry, direction, plane, tilt, off_plane, off_model, (mass1, mass2))


def _axis(robot: Robot, joint: str, held: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Axis and a place on it of a joint in the root, (3,) each."""
    frame = robot.frame(robot.joints[joint].child, held)
    return frame[:3, :3] @ axis_of(robot.joints[joint]), frame[:3, 3]


def _axes_of_plane(axis: Floats) -> tuple[Floats, Floats]:
    """X and y of the plane at right angles to an axis."""
    ahead, left, up = np.eye(3)
    upright = up - axis * (axis @ up)
    if np.linalg.norm(upright) * GRAVITY <= _LEAST:  # a SCARA
        x = ahead - axis * (axis @ ahead)
        x /= np.linalg.norm(x)
        return x, np.cross(axis * np.sign(axis @ up), x)
    y = upright / np.linalg.norm(upright)
    x = np.cross(y, axis)
    forward_part = x @ ahead if abs(x @ ahead) > 1e-6 else x @ left
    return x * np.sign(forward_part), y


def _errors(
    robot: Robot, joints: tuple[str, str], held: Mapping[str, float], nominal: Parameters, direction: tuple[int, int],
    plane: Plane,
) -> tuple[float, float]:  # fmt: skip
    """What axes that are not parallel cost, over positions of both joints: off the plane, and off the model in it, m."""
    turns = np.linspace(-pi, pi, 9)
    readings = np.stack(np.meshgrid(turns, turns), axis=-1).reshape(-1, 2)
    tips = [robot.frame(plane.tip, {**held, **dict(zip(joints, pair, strict=True))})[:3, 3] for pair in readings.tolist()]
    places = plane.in_plane(np.array(tips))
    off = places[:, :2] - forward(nominal, readings * direction)
    return float(np.abs(places[:, 2]).max()), float(np.hypot(*off.T).max())


def _rounded(value: float) -> float:
    return round(float(value), _PLACES) + 0.0


def _vector(values: Floats) -> tuple[Any, ...]:
    return tuple(_rounded(value) for value in values)


class RobotCell(NamedTuple):
    """A cell description without objects.

    Attributes:
        text: YAML with comments that say where each number comes from.
        notes: what is to be known of it, one sentence each.
    """

    text: str
    notes: tuple[str, ...]


def robot_cell(
    robot: Robot, joints: tuple[str, str], tip: str, at: Mapping[str, float], sensor: str = ''
) -> RobotCell:
    """The cell description of two joints of a robot.

    Args:
        robot: whose they are.
        joints: shoulder and elbow.
        tip: link at the end of the arm.
        at: positions of other joints, rad or m; 0 of those that are not there.
        sensor: link in whose frame the wrench is; empty: the tip.

    Raises:
        InputError: they make no arm; or a joint between or beyond does not stay where it is put.
    """
    chain = _chain(robot, joints, tip)
    held = _held(robot, chain, joints, at)
    arm = planar_arm(robot, joints, tip, held)
    limits, notes = [_limits(robot, name) for name in joints], _notes(robot, arm)
    mounted = _mounting(robot, sensor or tip, joints, held, arm)
    p, has_mass = arm.nominal, arm.nominal.has_gravity and arm.mass[0] > 0
    shown = {key: repr(getattr(p, key)) for key in ('theta1', 'l1', 'theta2', 'l2', 's1', 's2', 'phi1', 'phi2')}
    text = render(
        Path(__file__).with_name('cell.yaml.j2'),
        escape=False,
        source=robot.where,
        names=joints,
        joint_names=_flow(list(joints)),
        tip=tip,
        direction=list(arm.direction),
        parallel=_parallel(arm),
        plane=_flow(arm.plane._asdict() | {key: list(getattr(arm.plane, key)) for key in ('origin', 'x', 'y')}),
        root=robot.root,
        limits=_flow(dict(zip(joints, limits, strict=True))),
        continuous=[name for name in joints if robot.joints[name].type == 'continuous'],
        held=_flow({name: value for name, value in held.items() if name in {joint.name for joint in chain} or name in at}),
        assumed=' '.join(name for name in held if name not in at),
        gravity=list(p.gravity) if p.has_gravity else None,
        has_mass=has_mass,
        mass=[f'{mass:.4g}' for mass in arm.mass],
        sensor=sensor or tip,
        mounted=mounted,
        spread={key: f'{0.3 * getattr(p, key):.3g}' for key in ('s1', 's2')},
        **shown,
    )
    return RobotCell(text, tuple(notes))


def _chain(robot: Robot, joints: tuple[str, str], tip: str) -> list[Any]:
    """The joints from the root to the tip.

    Raises:
        InputError: the two are not among them in their order, or one mimics another or does not stay where it is put.
    """
    for name in joints:
        robot.turning(name)
    chain = robot.chain(tip)
    names = [joint.name for joint in chain]
    if missing := [name for name in joints if name not in names]:
        moved = ' '.join(joint.name for joint in chain if joint.type != 'fixed') or 'none'
        raise robot.error(f'{missing[0]} does not move link {tip!r}', f'choose another --tip; it is moved by {moved}')
    first, second = map(names.index, joints)
    if first >= second:
        raise robot.error(f'{joints[1]} comes before {joints[0]}', f'write --joints {joints[1]} {joints[0]}')
    for place, joint in enumerate(chain):
        if joint.mimic or joint.type not in ('fixed', 'revolute', 'continuous', 'prismatic'):
            kind = f'mimics {joint.mimic.joint}' if joint.mimic else f'is {joint.type}'
            raise robot.error(f'joint {joint.name!r} on the way to {tip!r} {kind}', 'an arm of two joints has none such')
        if joint.type == 'prismatic' and first < place < second:
            problem = f'joint {joint.name!r} between the two is prismatic: link 1 has no length of its own'
            raise robot.error(problem, 'choose other joints, or make it fixed in a copy of the URDF')
    return chain


def _held(robot: Robot, chain: list[Any], joints: tuple[str, str], at: Mapping[str, float]) -> dict[str, float]:
    """Positions of the other joints of the chain, and of those that are stated."""
    for name in at:
        if name in joints or robot.joint(name).type == 'fixed' or robot.joint(name).mimic:
            raise robot.error(f'--at {name}: it is not a joint to be held', 'name other joints that move')
    others = [joint.name for joint in chain if joint.type != 'fixed' and joint.name not in joints]
    held = {name: at.get(name, 0.0) for name in dict.fromkeys((*others, *at))}
    for name, value in held.items():
        limit = robot.joints[name].limit
        if limit and robot.joints[name].type != 'continuous' and not limit.lower <= value <= limit.upper:
            problem = f'{name} at {value:g} is beyond its limits, {limit.lower:g} to {limit.upper:g}'
            raise robot.error(problem, f'state another position: --at {name}=VALUE')
    return held


def _limits(robot: Robot, name: str) -> list[float]:
    joint = robot.joints[name]
    if joint.type == 'continuous' or not joint.limit or joint.limit.lower >= joint.limit.upper:
        return [-3.14, 3.14]
    return [max(-12.5, joint.limit.lower), min(12.5, joint.limit.upper)]


def _mounting(
    robot: Robot, sensor: str, joints: tuple[str, str], held: Mapping[str, float], arm: PlanarArm
) -> str:
    """The key that says how the sensor is mounted on link 2: `rotation`, or `axes` where its z axis is not across."""
    if joints[1] not in [joint.name for joint in robot.chain(sensor)]:
        raise robot.error(f'link {sensor!r} is not moved by {joints[1]}', 'name the link of the sensor by --sensor')
    angle = arm.nominal.theta1 + arm.nominal.theta2
    turned = arm.plane.axes @ [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    of_link2 = robot.frame(sensor, held)[:3, :3].T @ turned  # axes of link 2 in the sensor, as columns
    if of_link2[2, 2] > 1 - 1e-9:
        return f'rotation: {_rounded(-np.arctan2(of_link2[1, 0], of_link2[0, 0]))!r}'
    return f'axes: {_flow({name: list(_vector(of_link2[:, k])) for k, name in enumerate("xy")})}'


def _parallel(arm: PlanarArm) -> str:
    if arm.tilt < _EXACT:
        return 'parallel to rounding'
    cost = f'the tip leaves the plane by up to {quantity(arm.off_plane, "m")}'
    off = f'{arm.off_model:.1g} m' if arm.off_model < 1e-6 else quantity(arm.off_model, 'm')
    return f'{degrees(arm.tilt):.3g} degrees off parallel: {cost}, and is up to {off} off the model in it'


def _notes(robot: Robot, arm: PlanarArm) -> list[str]:
    found = [f'the axes are {_parallel(arm)}'] if arm.tilt > 1e-4 else []
    if not arm.nominal.has_gravity:
        found.append('gravity is across the plane: none in it')
    elif not arm.mass[0]:
        found.append(f'{robot.where} has no inertias: state robot.moments, {{s1, s2}} in kg m')
    return found


def _flow(value: Any) -> str:
    return dump_yaml(value, flow=True).removesuffix('\n').removesuffix('\n...')
