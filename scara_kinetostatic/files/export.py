"""The calibrated arm in the formats of other software: URDF, xacro, Denavit–Hartenberg table, corrections, C header.

`FORMATS` has every format once, with what its file holds. Each file says in comment lines from which calibration it is.

`correction_file`: corrections of the joint angles of the nominal arm, over workspace and load.

`exported_into`: the user's own URDF, corrected (`files.robot_cell`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from scara_kinetostatic import __version__
from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.files.atomic import render
from scara_kinetostatic.files.robot_cell import corrected_origins, with_origins
from scara_kinetostatic.files.tables import csv_cell, csv_lines
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, arm_urdf, comment, place_of_arm, read_robot, xacro
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.extended_model import EffectLaw
from scara_kinetostatic.model.kinematics import forward, inverse, wrap
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import MILLI, NAMES, P_EE, UNITS

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
    if (count := len(places) * len(vectors) * len(arm.used.postures)) > MOST_ROWS:
        problem = f'{step:g} m needs a table of up to {count:.2g} rows, {MOST_ROWS:.2g} are the most'
        raise ParameterError('--step', problem, 'give more, choose fewer forces, or bound the region of the cell')
    change, columns = _corrections(arm, places, vectors)
    if not columns['x_m']:
        problem = 'no place of the grid can be reached under these forces, within robot.limits'
        raise UnsupportedDataError(problem, 'choose a smaller --step or smaller forces')
    between = _in_words(_errors_between(arm, cells, places + step / 2, vectors, change))
    lines = [
        *(f'# {line}' for line in head),
        '# Command q1_nominal_rad + dq1_rad and q2_nominal_rad + dq2_rad to have the tip at x_m, y_m under the force.',
        f'# Places {step:g} m apart; {between}.',
    ]
    beyond = [f'{size:g}' for size in sizes if size > high or 0 < size < low]
    touched = f'the forces of the calibration, {low:.3g} to {high:.3g} N'
    notes = [f'{", ".join(beyond)} N is outside of {touched}: extrapolated'] if beyond else []
    notes.insert(0, f'places {step:g} m apart; {between}')
    return '\n'.join([*lines, csv_lines(columns)]), notes


def _corrections(arm: CalibratedArm, places: Floats, forces: Floats) -> tuple[Floats, dict[str, list[str]]]:
    """What to add to the nominal joint angles for s postures, p places and f forces, and the columns of the table.

    Returns:
        (s, p, f, 2), rad; NaN where one of the arms does not reach, or not within its limits: there is no such row.
    """
    cell, predictor, postures = arm.cell, Predictor(arm), arm.used.postures
    shape = len(postures), len(places), len(forces), 2
    sides = np.repeat(postures, len(places) * len(forces))
    tip = np.broadcast_to(places[:, None], shape).reshape(-1, 2)
    force = np.broadcast_to(forces, shape).reshape(-1, 2)
    rigid, found = inverse(cell.nominal, tip, sides), predictor.compensate(tip, force, sides)
    miss = np.linalg.norm(predictor.locate(rigid, force).position - tip, axis=1)
    change = wrap(found.joints - rigid)
    nominal = cell.readings(found.joints - change)  # in the turn of the commands
    elbows = np.where(sides > 0, 'left', 'right')
    numbers = (*tip.T, *force.T, elbows, *nominal.T, *cell.readings(change).T, miss, found.std_normal, found.status)
    heading = 'x_m y_m fx_N fy_N elbow q1_nominal_rad q2_nominal_rad dq1_rad dq2_rad miss_m std_normal_m status'
    kept = cell.can_take(found.joints) & np.isfinite(change).all(axis=1)
    columns = {name: _texts(column[kept]) for name, column in zip(heading.split(), numbers, strict=True)}
    return np.where(kept[:, None], change, np.nan).reshape(shape), columns


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
    largest, most = (f'{value / MILLI:.2g}' for value in (errors.max(), np.quantile(errors, 0.95)))
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
    places, distance = np.array([p.x0, p.y0]) + step * cells, step * np.hypot(*cells.T)
    kept = arm.cell.region.holds(places) & (distance <= longest) & (distance >= shortest)
    return cells[kept], places[kept]


def _forces(magnitudes: Sequence[float]) -> Floats:
    angles = np.pi / 4 * np.arange(8)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1).round(15) + 0.0
    return np.concatenate([np.zeros((1, 2)) if size == 0 else size * unit for size in magnitudes])


_FREE = 'not determined'


def _robot_effects(arm: CalibratedArm) -> list[str]:
    """Labels of the effects that act on the robot itself, neither on an object nor on the sensor."""
    return [effect.label for effect in arm.effects if not effect.on_object and not _is_of_sensor(effect)]


def _is_of_sensor(effect: EffectLaw) -> bool:
    start = np.array([p.start for p in effect.parameters])
    return effect.sensor_error(np.ones((1, 2)), start, None) is not None


def _left_out(arm: CalibratedArm, kind: str) -> str:
    """What a format cannot hold of the model; a correction table holds all of it, a header gravity besides."""
    gravity = ['deflection by gravity'] * (arm.model.parameters.has_gravity and kind != 'header')
    undetected = ['effects not detected'] * any(effect.is_undetected for effect in arm.model.acting.effects)
    left_out = '' if kind == 'csv' else ', '.join((*_robot_effects(arm), *gravity, *undetected))
    miss = rigid_miss(arm) if left_out and kind != 'header' else 0.0
    return left_out + (f', up to {miss / MILLI:.3g} mm at the unloaded tip' if miss else '')


def rigid_miss(arm: CalibratedArm) -> float:
    """Largest displacement of the unloaded tip by effects that act on the robot, over joint angles within limits, m."""
    angles = (np.linspace(low, high, 24) for low, high in arm.cell.limits or [(-np.pi, np.pi)] * 2)
    joints = np.stack(np.meshgrid(*angles), axis=-1).reshape(-1, 2)
    tip, _ = direct_kinetostatics(arm.model, joints, np.zeros_like(joints), arm.cell.gripper_sign)
    largest = float(np.nanmax(np.linalg.norm(tip - forward(arm.model.parameters, joints), axis=1)))
    return largest if largest > 1e-9 else 0.0  # rounding alone


def _head(arm: CalibratedArm, kind: str, source: str, content: str) -> list[str]:
    """From which calibration a file is: comment lines without marks; none holds the end of a comment of XML or C."""
    left_out = _left_out(arm, kind)
    lines = [
        *(f'{text[:1].upper()}{text[1:]}.' for text in arm.reservations),
        content,
        f'From {_origin(arm, source)}.',
        f'Model errors found: {", ".join(effect.label for effect in arm.effects) or "none"}.',
        f'Written by scara_kinetostatic {__version__}.',
        *([f'Not contained: {left_out}.'] if left_out else []),
    ]
    return list(map(comment, lines))


def _origin(arm: CalibratedArm, source: str) -> str:
    """A calibration in words."""
    grade = f', grade {arm.grade}' if arm.grade else ''
    return f'{source}: calibrated {arm.created or "at an unknown time"}{grade}'


def _notes(arm: CalibratedArm, kind: str) -> list[str]:
    """What a reader must know besides, one sentence each."""
    named = NAMES[:P_EE] if kind in ('urdf', 'xacro', 'dh') else tuple(UNITS)
    notes = list(arm.reservations)
    if free := [name for name, _, std, _ in _values(arm) if std == _FREE and name in named]:
        notes.append(f'the touches do not determine {", ".join(free)}: other values fit them as well')
    if left_out := _left_out(arm, kind):
        notes.append(f'the file cannot hold {left_out}; `locate` does')
    return notes


def urdf_text(arm: CalibratedArm, head: Sequence[str]) -> str:
    """The URDF: its tip `tool0` is at H(L̄, Q) for the joint angles Q that the robot reports."""
    name = arm.cell.identification.robot or 'scara'
    return arm_urdf(name, arm.cell, arm.model.parameters, CALIBRATED_COLOUR, _comment(head))


def xacro_text(arm: CalibratedArm, head: Sequence[str]) -> str:
    """The same as a xacro: properties, a macro that a xacro of one's own may include, and the arm made by it.

    With the argument ``standalone:=false`` the macro is defined and no arm is made.
    """
    return render(
        Path(__file__).with_name('arm.xacro.j2'),
        comment=Markup(xacro(_comment(head))),
        name=xacro(arm.cell.identification.robot or 'scara'),
        properties=_values(arm)[:P_EE],
        joints=[xacro(name) for name in arm.cell.joint_names],
        lift_joint=xacro(arm.cell.lift.joint) if arm.cell.lift else '',
        back=-arm.cell.coupling,
        axes=arm.cell.direction,
        **place_of_arm(arm.cell),
    )


def _values(arm: CalibratedArm) -> list[tuple[str, float, str, str]]:
    """Name, value, uncertainty in words and unit of the base model's parameters."""
    values, size = arm.model.parameters.as_dict(), arm.model.base_count
    stds = np.sqrt(np.diag(arm.covariance))[:size]
    hidden = np.linalg.norm(arm.undetermined[:size], axis=1) > stds
    words = [
        _FREE if free else f'u = {std:.2g}' if std else 'fixed'
        for free, std in zip(hidden.tolist(), stds.tolist(), strict=True)
    ]
    return [(name, value, std, UNITS[name]) for (name, value), std in zip(values.items(), words, strict=True)]


def _comment(head: Sequence[str]) -> str:
    lines = '\n'.join(f'  {escape(line)}' for line in head)
    return f'<!--\n{lines}\n-->\n'


def dh_text(arm: CalibratedArm, head: Sequence[str]) -> str:
    """The Denavit–Hartenberg table of the rigid arm as CSV, in the standard convention.

    T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha), a and alpha of the same link. The frame before
    joint 1 is that of the base displaced by (x0, y0), row ``base``. All d and alpha are zero.
    """
    p, signs = arm.model.parameters, arm.cell.direction
    j1, j2 = map(csv_cell, arm.cell.joint_names)
    lines = [
        *(f'# {line}' for line in head),
        '# standard convention: T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha); x_m and y_m of base '
        'are a translation.',
        *([f'# q of {j2} is its reading less {arm.cell.coupling!r} times that of {j1}.'] if arm.cell.coupling else []),
        *([f'# Then q is {signs[0]} and {signs[1]} times the reading: the joints turn so.'] if signs != (1, 1) else []),
        'row,joint_name,x_m,y_m,theta_offset_rad,d_m,a_m,alpha_rad',
        f'base,,{p.x0!r},{p.y0!r},0.0,0.0,0.0,0.0',
        f'joint1,{j1},0.0,0.0,{p.theta1!r},0.0,{p.l1!r},0.0',
        f'joint2,{j2},0.0,0.0,{p.theta2!r},0.0,{p.l2!r},0.0',
    ]
    return '\n'.join(lines) + '\n'


def header_text(arm: CalibratedArm, head: Sequence[str]) -> str:
    """The header.

    Raises:
        UnsupportedDataError: effects of its own, which the functions do not have.
    """
    if effects := _robot_effects(arm):
        problem = f'a C header has the base model alone, and this calibration found {", ".join(effects)}'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    p = arm.model.parameters
    return render(
        Path(__file__).with_name('header.h.j2'),
        escape=False,
        lines=head,
        constants=_values(arm),
        coupling=arm.cell.coupling,
        direction=arm.cell.direction,
        gravity=[(pull.real, pull.imag) for pull in p.gravity_of_links] if p.has_gravity else [],
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


def exported_into(arm: CalibratedArm, urdf: Path, source: str) -> tuple[bytes, list[str]]:
    """The user's URDF with corrected origins, every other byte as it was, and what is to be known of it.

    Args:
        arm: the calibrated arm.
        urdf: the file.
        source: the file that the arm was read from.

    Raises:
        InputError: the file cannot be read, or is that of another robot.
    """
    robot = read_robot(urdf)
    origins, p = corrected_origins(arm, robot), arm.model.parameters
    soft = ', '.join(f'{name} {getattr(p, name):.3g} {UNITS[name]}' for name in NAMES[P_EE:])
    rest = f'a rigid URDF cannot hold compliance and backlash ({soft})'
    made = f'changed are the origins of {", ".join(origins) or "no joint"}, by {_origin(arm, source)}'
    return with_origins(robot, origins), [*_notes(arm, 'urdf'), rest, made]


def exported(
    arm: CalibratedArm, kind: str, source: str, *, step: float = STEP, forces: Sequence[float] = ()
) -> tuple[str, list[str]]:
    """The text of a file, and what is to be known of it, one sentence each.

    Args:
        arm: the calibrated arm.
        kind: one of `FORMATS`.
        source: the file that the arm was read from.
        step: of a correction table, as `correction_file` has it.
        forces: of a correction table, too.

    Raises:
        ParameterError: the grid of a correction table is too fine.
        UnsupportedDataError: the format cannot hold the model.
    """
    head, notes = _head(arm, kind, source, FORMATS[kind]), _notes(arm, kind)
    if kind == 'csv':
        text, more = correction_file(arm, head, step, forces)
        return text, [*notes, *more]
    return {'urdf': urdf_text, 'xacro': xacro_text, 'dh': dh_text, 'header': header_text}[kind](arm, head), notes
