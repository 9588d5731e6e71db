"""The calibrated arm in the formats of other software: URDF, xacro, Denavit–Hartenberg table, corrections, C header.

`FORMATS` has every format once, with what its file holds. Each file says in comment lines from which calibration it is.

`correction_file`: corrections of the joint angles of the nominal arm, over workspace and load.

`exported_into`: the user's own URDF, in which the origins of the two joints, and of the one that carries the tip, are
corrected.

With Δ the calibrated less the file's own geometry, in the plane of the arm (`files.robot_cell`):

    joint 1:     its place by (Δx0, Δy0), turned about its axis by Δtheta1
    joint 2:     its place by Δl1 along link 1, turned about its axis by Δtheta2
    the next:    its place by Δl2 along link 2, where the calibration changed l2

All else stays, but for the style of attributes. The tip is then that of the rigid arm, H(L, Q).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from math import isfinite, pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scara_kinetostatic import __version__
from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED
from scara_kinetostatic.errors import InputError, ParameterError, UnsupportedDataError
from scara_kinetostatic.files.cell_file import turned_limits
from scara_kinetostatic.files.columns import csv_cell, csv_lines
from scara_kinetostatic.files.robot_cell import planar_arm
from scara_kinetostatic.files.robot_urdf import Robot, axis_of, read_bytes
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, arm_urdf, comment, place_of_arm, render, xacro
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.kinematics import forward, inverse, wrap
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, UNITS

MOST_ROWS = 1_000_000
"""Of a table, some 100 MB."""
STEP = 0.025
"""Distance of the places of a correction table unless told, m."""


def correction_file(
    arm: CalibratedArm, head: Sequence[str], step: float = STEP, forces: Sequence[float] = ()
) -> tuple[str, list[str]]:
    """The correction table as CSV: what to add to the joint angles of the nominal arm; and what to know of it.

    A row has the place of the tip, the force, the elbow, the joint angles by the nominal rigid arm, the correction of
    each, the error of the tip without it, and the standard uncertainty of the tip along the force, in the worst
    direction without one. Places out of reach of either arm, or beyond robot.limits, are left out. The head states the
    error of the tip halfway between places, by bilinear interpolation.

    Args:
        arm: the calibrated arm.
        head: comment lines, without their marks.
        step: distance of the places along x and y, m.
        forces: magnitudes, N; 0 has one row per place, the others one per direction; empty: 0, and the middle of the
            forces of the touches.

    Raises:
        ParameterError: the step makes more than `MOST_ROWS` rows.
        UnsupportedDataError: there is no row.
    """
    low, high = arm.used.lowest_force, arm.used.highest_force
    sizes = tuple(dict.fromkeys(forces)) or (0.0, float(f'{(low + high) / 2:.2g}'))
    vectors, (cells, places) = _forces(sizes), _grid(arm, step)
    if (count := len(cells) * len(vectors) * len(arm.used.postures)) > MOST_ROWS:
        problem = f'{step:g} m needs a table of up to {count:.2g} rows, {MOST_ROWS:.2g} are the most'
        raise ParameterError('--step', problem, 'give more, choose fewer forces, or bound the region of the cell')
    change, columns = _corrections(arm, places, vectors)
    if not np.isfinite(change).all(axis=-1).any():
        problem = 'no place of the grid can be reached under these forces, within robot.limits'
        raise UnsupportedDataError(problem, 'choose a smaller --step or smaller forces')
    between = _in_words(_errors_between(arm, cells, places + step / 2, vectors, change))
    lines = [
        *(f'# {line}' for line in head),
        '# Command q1_nominal_rad + dq1_rad and q2_nominal_rad + dq2_rad to have the tip at x_m, y_m under the force.',
        f'# Places {step:g} m apart; {between}.',
    ]
    notes = [f'places {step:g} m apart; {between}']
    if beyond := [f'{size:g}' for size in sizes if size > high or 0 < size < low]:
        touched = f'the forces of the calibration, {low:.3g} to {high:.3g} N'
        notes.append(f'{", ".join(beyond)} N is outside of {touched}: extrapolated')
    return '\n'.join([*lines, csv_lines(columns)]), notes


def _corrections(arm: CalibratedArm, places: Floats, forces: Floats) -> tuple[Floats, dict[str, list[str]]]:
    """What to add to the nominal joint angles for s postures, p places and f forces; and the columns of the table.

    Returns:
        (s, p, f, 2), rad; NaN where one of the arms does not reach, or not within its limits: there is no such row.
    """
    cell, predictor, postures = arm.cell, Predictor(arm), arm.used.postures
    shape = len(postures), len(places), len(forces)
    sides = np.repeat(postures, len(places) * len(forces))
    tip = np.broadcast_to(places[:, None], (*shape, 2)).reshape(-1, 2)
    force = np.broadcast_to(forces, (*shape, 2)).reshape(-1, 2)
    rigid, found = inverse(cell.nominal, tip, sides), predictor.compensate(tip, force, sides)
    miss = np.linalg.norm(predictor.locate(rigid, force).position - tip, axis=1)
    change = np.where(cell.can_take(found.joints)[:, None], wrap(found.joints - rigid), np.nan)
    nominal = cell.readings(found.joints - change)  # in the turn of the commands
    elbows = np.where(sides > 0, 'left', 'right')
    numbers = (*tip.T, *force.T, elbows, *nominal.T, *cell.readings(change).T, miss, found.std_normal, found.status)
    heading = 'x_m y_m fx_N fy_N elbow q1_nominal_rad q2_nominal_rad dq1_rad dq2_rad miss_m std_normal_m status'
    kept = np.isfinite(change).all(axis=1)
    columns = {name: _texts(column[kept]) for name, column in zip(heading.split(), numbers, strict=True)}
    return change.reshape(*shape, 2), columns


def _texts(column: NDArray[Any]) -> list[str]:
    """Words as they are, numbers to ten digits, nothing for what is not finite."""
    if column.dtype.kind != 'f':
        return list(map(str, column))
    return [f'{value:.10g}' if isfinite(value) else '' for value in column.tolist()]


def _errors_between(arm: CalibratedArm, cells: Indices, middle: Floats, forces: Floats, change: Floats) -> Floats:
    """How far interpolated corrections miss the tip in the middles between four places, (k,), m."""
    x, y = (cells - cells.min(axis=0)).T
    number = np.full((x.max() + 2, y.max() + 2), -1)
    number[x, y] = np.arange(len(cells))
    square = np.stack([number[x, y], number[x + 1, y], number[x, y + 1], number[x + 1, y + 1]], axis=-1)
    whole = (square >= 0).all(axis=1)
    rigid = np.stack([inverse(arm.cell.nominal, middle[whole], side) for side in arm.used.postures])
    joints = rigid[:, :, None] + change[:, square[whole]].mean(axis=2)
    known = np.isfinite(joints).all(axis=-1)
    tip, force = (np.broadcast_to(part, joints.shape)[known] for part in (middle[whole][:, None], forces))
    errors = np.linalg.norm(Predictor(arm).locate(joints[known], force).position - tip, axis=1)
    return np.asarray(errors[np.isfinite(errors)])


def _in_words(errors: Floats) -> str:
    if not len(errors):
        return 'the places are too far apart to interpolate between them'
    largest, most = (f'{1e3 * value:.2g}' for value in (errors.max(), np.quantile(errors, 0.95)))
    rest = f'by up to {largest} mm where the arm is nearly stretched or folded or a backlash changes sides'
    most = f'by less than {most} mm in 95 % of the middles, {rest}'
    return f'halfway between places, bilinear interpolation of dq misses the tip {most}'


def _grid(arm: CalibratedArm, step: float) -> tuple[Indices, Floats]:
    """A grid through the base, within reach of the nominal arm and in the region: (n, 2) in steps, and (n, 2), m."""
    p = arm.cell.nominal
    longest = NEARLY_STRETCHED * (p.l1 + p.l2)
    shortest = abs(p.l1 - p.l2) + (1 - NEARLY_STRETCHED) * (p.l1 + p.l2)
    line = np.arange(-int(longest / step), int(longest / step) + 1)
    cells = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    places, distance = np.asarray((p.x0, p.y0) + step * cells), step * np.hypot(*cells.T)
    kept = arm.cell.region.holds(places) & (distance <= longest) & (distance >= shortest)
    return cells[kept], places[kept]


def _forces(magnitudes: Sequence[float]) -> Floats:
    angles = np.pi / 4 * np.arange(8)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1).round(15) + 0.0
    return np.concatenate([np.zeros((1, 2)) if size == 0 else size * unit for size in magnitudes])


_MOST = 0.05
"""A geometry that differs by more is that of another robot, m and rad."""
_SAME = 1e-14
"""A joint that moves by less stays as it is, m."""


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
    moves = (np.array([*lengths[:2], 0.0]), *(lengths[3:, None] * along))
    turns = (*(angles * cell.direction).tolist(), 0.0)
    return {
        name: _moved(robot, name, positions, plane.axes @ move, turn)
        for name, move, turn in zip((*joints, third), moves, turns, strict=True)
        if np.abs(move).max() > _SAME or turn
    }


def _moved(robot: Robot, name: str, positions: Mapping[str, float], move: Floats, turn: float) -> Origin:
    """The origin of a joint moved in the root, m, and turned about its axis, rad."""
    joint = robot.joints[name]
    xyz, rpy = np.array((joint.origin and (joint.origin.xyz, joint.origin.rpy)) or np.zeros((2, 3)), dtype=float)
    parent = robot.frame(joint.parent, positions)[:3, :3]
    turned = Rotation.from_euler('xyz', rpy) * Rotation.from_rotvec(turn * np.array(axis_of(joint)))
    rpy = _angles_near(rpy, turned) if turn else rpy
    return Origin(np.round(xyz + parent.T @ move, 15) + 0.0, np.round(rpy, 15) + 0.0)


def _angles_near(rpy: Floats, turned: Rotation) -> Floats:
    """Those angles of a rotation, of the two triples that it has, that are near to others, (3,), rad."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # where roll and yaw turn about one axis, one of them is taken as 0
        roll, pitch, yaw = turned.as_euler('xyz')
    off = wrap(np.array([[roll, pitch, yaw], [roll + pi, pi - pitch, yaw + pi]]) - rpy)
    return np.asarray(rpy + off[np.abs(off).sum(axis=1).argmin()])


def with_origins(content: bytes, origins: Mapping[str, Origin], lines: Sequence[str]) -> str:
    """The text of a URDF with other origins of some joints, and comment lines before its root."""
    from lxml import etree

    robot = etree.fromstring(content)
    for joint in robot.iterchildren('joint'):
        if joint.get('name') in origins:
            if (origin := joint.find('origin')) is None:
                joint.insert(0, origin := etree.Element('origin'))
            for key, values in origins[joint.get('name')]._asdict().items():
                origin.set(key, ' '.join(map(repr, values.tolist())))
    robot.addprevious(etree.Comment('\n' + ''.join(f'  {line}\n' for line in lines)))
    return str(etree.tostring(robot.getroottree(), encoding='utf-8', xml_declaration=True).decode() + '\n')


_FREE = 'not determined'


class ExportFacts(NamedTuple):
    """Facts of a calibration for the head of a file.

    Attributes:
        lines: comment lines without marks; no line holds the end of a comment of XML or C.
        std: of each parameter of the base model, words: ``u = 2e-06`` or ``not determined``.
        robot_effects: labels of the effects that act on the robot itself.
        left_out: what a rigid arm leaves out: these, gravity, effects that were not detected.
        rigid_miss: largest displacement of the tip without load by what is left out, m.
        reservations: what is to be known of the calibration, one sentence each.
    """

    lines: tuple[str, ...]
    std: tuple[str, ...]
    robot_effects: tuple[str, ...]
    left_out: str
    rigid_miss: float
    reservations: tuple[str, ...] = ()

    @classmethod
    def of(cls, arm: CalibratedArm, source: str, content: str) -> ExportFacts:
        """Those of an arm.

        Args:
            arm: the calibrated arm.
            source: the file that it was read from.
            content: what the exported file holds, a sentence.
        """
        effects = tuple(effect.label for effect in arm.effects if _is_of_robot(effect))
        grade = f', grade {arm.grade}' if arm.grade else ''
        found = ', '.join(effect.label for effect in arm.effects) or 'none'
        lines: tuple[str, ...] = (
            *(f'{text[:1].upper()}{text[1:]}.' for text in arm.reservations),
            content,
            f'From {source}: calibrated {arm.created or "at an unknown time"}{grade}.',
            f'Model errors found: {found}.',
            f'Written by scara_kinetostatic {__version__}.',
        )
        gravity = ['deflection by gravity'] * arm.model.parameters.has_gravity
        undetected = ['effects not detected'] * any(effect.is_undetected for effect in arm.model.acting.effects)
        left_out = ', '.join((*effects, *gravity, *undetected))
        miss = rigid_miss(arm) if left_out else 0.0
        if miss:
            lines += (f'Not contained: {left_out}, up to {1e3 * miss:.3g} mm at the unloaded tip.',)
        cleaned = tuple(map(comment, lines))
        return cls(cleaned, _stds(arm), effects, left_out, miss, arm.reservations)

    def notes(self, *, is_rigid: bool) -> list[str]:
        """What a reader must know besides, one sentence each; `is_rigid`: whether the file has the geometry alone."""
        found, named = list(self.reservations), NAMES[:6] if is_rigid else tuple(UNITS)
        free = [name for name, std in zip(UNITS, self.std, strict=False) if std == _FREE and name in named]
        if free:
            found.append(f'the touches do not determine {", ".join(free)}: other values fit them as well')
        if is_rigid and self.rigid_miss:
            where = f'up to {1e3 * self.rigid_miss:.3g} mm elsewhere even without load'
            found.append(f'it cannot hold {self.left_out}: the tip is {where}; see `locate`')
        return found


def _is_of_robot(effect: EffectLaw) -> bool:
    start = np.array([p.start for p in effect.parameters])
    return not effect.on_object and effect.sensor_error(np.ones((1, 2)), start, None) is None


def _stds(arm: CalibratedArm) -> tuple[str, ...]:
    stds = np.sqrt(np.diag(arm.covariance))[: arm.model.base_count]
    hidden = np.linalg.norm(arm.undetermined[: arm.model.base_count], axis=1) > stds
    pairs = zip(hidden.tolist(), stds.tolist(), strict=True)
    return tuple(_FREE if free else f'u = {std:.2g}' if std else 'fixed' for free, std in pairs)


def rigid_miss(arm: CalibratedArm) -> float:
    """Largest displacement of the unloaded tip by effects that act on the robot, over joint angles within limits, m."""
    angles = (np.linspace(low, high, 24) for low, high in arm.cell.limits or [(-np.pi, np.pi)] * 2)
    joints = np.stack(np.meshgrid(*angles), axis=-1).reshape(-1, 2)
    tip, _ = direct_kinetostatics(arm.model, joints, np.zeros_like(joints), arm.cell.gripper_sign)
    largest = float(np.nanmax(np.linalg.norm(tip - forward(arm.model.parameters, joints), axis=1)))
    return largest if largest > 1e-9 else 0.0  # rounding alone


def urdf_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The URDF: its tip `tool0` is at H(L̄, Q) for the joint angles Q that the robot reports."""
    name = arm.cell.identification.robot or 'scara'
    return arm_urdf(name, arm.cell, arm.model.parameters, CALIBRATED_COLOUR, _comment(facts))


def xacro_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The same as a xacro: properties, a macro that a xacro of one's own may include, and the arm made by it.

    With the argument ``standalone:=false`` the macro is defined and no arm is made.
    """
    return render(
        Path(__file__).with_name('arm.xacro.j2'),
        comment=Markup(xacro(_comment(facts))),
        name=xacro(arm.cell.identification.robot or 'scara'),
        properties=[row for row in _values(arm, facts) if row[0] in NAMES[:6]],
        joints=[xacro(name) for name in arm.cell.joint_names],
        back=-arm.cell.coupling,
        axes=arm.cell.direction,
        **place_of_arm(arm.cell),
    )


def _values(arm: CalibratedArm, facts: ExportFacts) -> list[tuple[str, float, str, str]]:
    """Name, value, uncertainty in words and unit of the base model's parameters."""
    values = zip(arm.model.parameters.as_dict().items(), facts.std, strict=True)
    return [(name, value, std, UNITS[name]) for (name, value), std in values]


def _comment(facts: ExportFacts) -> str:
    lines = '\n'.join(f'  {escape(line)}' for line in facts.lines)
    return f'<!--\n{lines}\n-->\n'


def dh_text(arm: CalibratedArm, facts: ExportFacts, convention: str) -> str:
    """The Denavit–Hartenberg table of the rigid arm as CSV.

    standard:  T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha), a and alpha of the same link;
    modified:  T = Rot_x(alpha) Trans_x(a) Rot_z(q + theta_offset) Trans_z(d), a and alpha of the link before.

    The frame before joint 1 is that of the base displaced by (x0, y0), row ``base``; with the modified convention the
    tip is displaced from frame 2 by l2 along x, row ``tool``. All d and alpha are zero.
    """
    p, signs = arm.model.parameters, arm.cell.direction
    j1, j2 = map(csv_cell, arm.cell.joint_names)
    lengths = (p.l1, p.l2) if convention == 'standard' else (0.0, p.l1)
    rows = [
        ('base', '', p.x0, p.y0, 0.0, 0.0, 0.0, 0.0),
        ('joint1', j1, 0.0, 0.0, p.theta1, 0.0, lengths[0], 0.0),
        ('joint2', j2, 0.0, 0.0, p.theta2, 0.0, lengths[1], 0.0),
        ('tool', '', p.l2, 0.0, 0.0, 0.0, 0.0, 0.0),
    ][: 3 if convention == 'standard' else 4]
    formula = {
        'standard': 'T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha)',
        'modified': 'T = Rot_x(alpha) Trans_x(a) Rot_z(q + theta_offset) Trans_z(d)',
    }[convention]
    lines = [
        *(f'# {line}' for line in facts.lines),
        f'# {convention} convention: {formula}; x_m and y_m of base and tool are translations.',
        *([f'# q of {j2} is its reading less {arm.cell.coupling!r} times that of {j1}.'] if arm.cell.coupling else []),
        *([f'# Then q is {signs[0]} and {signs[1]} times the reading: the joints turn so.'] if signs != (1, 1) else []),
        'row,joint_name,x_m,y_m,theta_offset_rad,d_m,a_m,alpha_rad',
        *(','.join(part if isinstance(part, str) else repr(part) for part in row) for row in rows),
    ]
    return '\n'.join(lines) + '\n'


def header_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The header.

    Args:
        arm: the calibrated arm.
        facts: of it.

    Raises:
        UnsupportedDataError: effects of its own, which the functions do not have.
    """
    if facts.robot_effects:
        problem = f'a C header has the base model alone, and this calibration found {", ".join(facts.robot_effects)}'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    pairs = zip(arm.cell.joint_names, turned_limits(arm.cell.limits, arm.cell.direction) or (), strict=False)
    limits = ', '.join(f'{name} {low:g} to {high:g} rad' for name, (low, high) in pairs)
    p = arm.model.parameters
    pulls = [(pull.real, pull.imag) for pull in p.gravity_of_links] if p.has_gravity else []
    unchecked = comment(f'The limits of the joints are not checked: {limits}.')
    return render(
        Path(__file__).with_name('header.h.j2'),
        escape=False,
        lines=(*facts.lines, unchecked) if limits else facts.lines,
        constants=_values(arm, facts),
        coupling=arm.cell.coupling,
        direction=arm.cell.direction,
        gravity=pulls,
        gravity_std=Predictor(arm).law.gravity_std,
        force_std=arm.noise.force_rms,
        force_growth=arm.noise.growth,
        compliance_sign='-' if arm.cell.gripper_sign is GripperSign.PHYSICAL else '+',
    )


_RIGID = 'Rigid geometry of the calibrated arm: the tip tool0 is H(L, Q), without compliance and backlash.'
FORMATS = {
    'urdf': _RIGID,
    'xacro': _RIGID,
    'dh': 'Denavit-Hartenberg parameters of the calibrated arm, rigid: without compliance and backlash.',
    'csv': 'Corrections of the joint angles of the nominal arm, over places and forces of the robot on the object.',
    'header': 'Calibrated kinetostatic model of a SCARA arm: geometry, compliance, backlash.',
}
"""What the file of each format holds."""


def exported_into(arm: CalibratedArm, urdf: Path, source: str) -> tuple[str, list[str]]:
    """The user's URDF with corrected origins, and what is to be known of it.

    Args:
        arm: the calibrated arm.
        urdf: the file.
        source: the file that the arm was read from.

    Raises:
        InputError: the file cannot be read, or is that of another robot.
    """
    content = read_bytes(urdf)
    robot = Robot(content, str(urdf))
    origins, p = corrected_origins(arm, robot), arm.model.parameters
    facts = ExportFacts.of(arm, source, f'Calibrated by touch: origins of {", ".join(origins) or "no joint"}; rigid.')
    soft = ', '.join(f'{name} {getattr(p, name):.3g} {UNITS[name]}' for name in NAMES[6:])
    rest = f'a rigid URDF cannot hold compliance and backlash ({soft}), nor effects too small to be detected'
    lines = (*facts.lines, comment(f'{rest[:1].upper()}{rest[1:]}.'))
    return with_origins(content, origins, lines), [*facts.notes(is_rigid=True), rest]


def exported(
    arm: CalibratedArm,
    kind: str,
    source: str,
    *,
    convention: str = 'standard',
    step: float = STEP,
    forces: Sequence[float] = (),
) -> tuple[str, list[str]]:
    """The text of a file, and what is to be known of it, one sentence each.

    Args:
        arm: the calibrated arm.
        kind: one of `FORMATS`.
        source: the file that the arm was read from.
        convention: of a Denavit–Hartenberg table, ``standard`` or ``modified``.
        step: of a correction table, as `correction_file` has it.
        forces: of a correction table, too.

    Raises:
        ParameterError: the grid of a correction table is too fine.
        UnsupportedDataError: the format cannot hold the model.
    """
    facts = ExportFacts.of(arm, source, FORMATS[kind])
    notes = facts.notes(is_rigid=kind in ('urdf', 'xacro', 'dh'))
    if kind == 'csv':
        text, more = correction_file(arm, facts.lines, step, forces)
        return text, [*notes, *more]
    if kind == 'dh':
        return dh_text(arm, facts, convention), notes
    return {'urdf': urdf_text, 'xacro': xacro_text, 'header': header_text}[kind](arm, facts), notes
