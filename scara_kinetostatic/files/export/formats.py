"""The calibrated arm in the formats of other software: URDF, xacro, Denavit–Hartenberg table, corrections, C header.

`FORMATS` has every format once: what its file holds, and the function that writes it. Each file says in comment lines
from which calibration it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape

from scara_kinetostatic import __version__
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files import escaping
from scara_kinetostatic.files.cell_file import turned_limits
from scara_kinetostatic.files.escaping import render
from scara_kinetostatic.files.export.corrections import Grid, correction_file
from scara_kinetostatic.files.export.into_urdf import corrected_origins, origins_yaml, with_origins
from scara_kinetostatic.files.robot_urdf import Robot, read_bytes
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, Arm, arm_urdf, place_of_arm
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import UNITS

RIGID = ('x0', 'y0', 'theta1', 'l1', 'theta2', 'l2')
"""The parameters of the rigid arm."""
_SOFT = ('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2')
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
        others = {
            'deflection by gravity': arm.model.parameters.has_gravity,
            'effects not detected': any(effect.is_undetected for effect in arm.model.acting.effects),
        }
        left_out = ', '.join((*effects, *(name for name, is_there in others.items() if is_there)))
        miss = rigid_miss(arm) if left_out else 0.0
        if miss:
            lines += (f'Not contained: {left_out}, up to {1e3 * miss:.3g} mm at the unloaded tip.',)
        cleaned = tuple(map(escaping.comment, lines))
        return cls(cleaned, _stds(arm), effects, left_out, miss, arm.reservations)

    def notes(self, *, is_rigid: bool) -> list[str]:
        """What a reader must know besides, one sentence each; `is_rigid`: whether the file has the geometry alone."""
        found = list(self.reservations)
        names = tuple(UNITS)[: len(self.std)]
        named = RIGID if is_rigid else names
        free = [name for name, std in zip(names, self.std, strict=True) if std == _FREE and name in named]
        if free:
            found.append(f'the touches do not determine {", ".join(free)}: other values fit them as well')
        if is_rigid and self.rigid_miss:
            where = f'up to {1e3 * self.rigid_miss:.3g} mm elsewhere even without load'
            found.append(f'it cannot hold {self.left_out}: the tip is {where}; see `locate`')
        return found


def _is_of_robot(effect: EffectLaw) -> bool:
    no_force = np.ones((1, 2))
    start = np.array([p.start for p in effect.parameters])
    return not effect.on_object and effect.sensor_error(no_force, start, None) is None


def _stds(arm: CalibratedArm) -> tuple[str, ...]:
    stds = np.sqrt(np.diag(arm.covariance))[: arm.model.base_count]
    hidden = np.linalg.norm(arm.undetermined[: arm.model.base_count], axis=1) > stds
    pairs = zip(hidden.tolist(), stds.tolist(), strict=True)
    return tuple(_FREE if free else f'u = {std:.2g}' if std else 'fixed' for free, std in pairs)


def rigid_miss(arm: CalibratedArm) -> float:
    """Largest displacement of the unloaded tip by effects that act on the robot, over joint angles within limits, m."""
    angles = (np.linspace(low, high, 24) for low, high in arm.cell.limits or [(-np.pi, np.pi)] * 2)
    joints = np.stack(np.meshgrid(*angles), axis=-1).reshape(-1, 2)
    tip, _ = direct_kinetostatics(arm.model, joints, np.zeros_like(joints), arm.cell.gripper)
    miss = np.linalg.norm(tip - forward(arm.model.parameters, joints), axis=1)
    largest = float(np.nanmax(miss))
    return largest if largest > 1e-9 else 0.0  # rounding alone


def urdf_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The URDF: its tip `tool0` is at H(L̄, Q) for the joint angles Q that the robot reports."""
    arms = [Arm(arm.model.parameters, colour=CALIBRATED_COLOUR)]
    return arm_urdf(_name(arm), arm.cell, arms, _comment(facts))


def xacro_text(arm: CalibratedArm, facts: ExportFacts) -> str:
    """The same as a xacro: properties, a macro that a xacro of one's own may include, and the arm made by it.

    With the argument ``standalone:=false`` the macro is defined and no arm is made.
    """
    return render(
        Path(__file__).with_name('arm.xacro.j2'),
        comment=Markup(escaping.xacro(_comment(facts))),
        name=escaping.xacro(_name(arm)),
        properties=[row for row in _values(arm, facts) if row[0] in RIGID],
        joints=[escaping.xacro(name) for name in arm.cell.joint_names],
        back=-arm.cell.coupling,
        axes=arm.cell.direction,
        **place_of_arm(arm.cell),
    )


def _values(arm: CalibratedArm, facts: ExportFacts) -> list[tuple[str, float, str, str]]:
    """Name, value, uncertainty in words and unit of the base model's parameters."""
    values = zip(arm.model.parameters.names, arm.model.parameters.as_array().tolist(), facts.std, strict=True)
    return [(name, value, std, UNITS[name]) for name, value, std in values]


def _name(arm: CalibratedArm) -> str:
    return arm.cell.identification.robot or 'scara'


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
    p = arm.model.parameters
    j1, j2 = map(escaping.csv_cell, arm.cell.joint_names)
    lengths = (p.l1, p.l2) if convention == 'standard' else (0.0, p.l1)
    rows = [('base', '', p.x0, p.y0, 0.0, 0.0, 0.0, 0.0)]
    rows.append(('joint1', j1, 0.0, 0.0, p.theta1, 0.0, lengths[0], 0.0))
    rows.append(('joint2', j2, 0.0, 0.0, p.theta2, 0.0, lengths[1], 0.0))
    if convention == 'modified':
        rows.append(('tool', '', p.l2, 0.0, 0.0, 0.0, 0.0, 0.0))
    signs = f'{arm.cell.direction[0]} and {arm.cell.direction[1]}'
    formula = {
        'standard': 'T = Rot_z(q + theta_offset) Trans_z(d) Trans_x(a) Rot_x(alpha)',
        'modified': 'T = Rot_x(alpha) Trans_x(a) Rot_z(q + theta_offset) Trans_z(d)',
    }[convention]
    lines = [
        *(f'# {line}' for line in facts.lines),
        f'# {convention} convention: {formula}; x_m and y_m of base and tool are translations.',
        *([f'# q of {j2} is its reading less {arm.cell.coupling!r} times that of {j1}.'] if arm.cell.coupling else []),
        *([f'# Then q is {signs} times the reading: the joints turn so.'] if arm.cell.direction != (1, 1) else []),
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
        UnsupportedDataError: a general gripper or effects of its own, which the functions do not have.
    """
    if facts.robot_effects:
        problem = f'a C header has the base model alone, and this calibration found {", ".join(facts.robot_effects)}'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    if not arm.cell.gripper.isotropic:
        problem = 'a C header has the isotropic gripper alone, and the cell description states model.gripper_excess'
        raise UnsupportedDataError(problem, 'export --format csv, which contains it, or use `compensate`')
    pairs = zip(arm.cell.joint_names, turned_limits(arm.cell.limits, arm.cell.direction) or (), strict=False)
    limits = ', '.join(f'{name} {low:g} to {high:g} rad' for name, (low, high) in pairs)
    p = arm.model.parameters
    pulls = [(pull.real, pull.imag) for pull in p.gravity_of_links] if p.has_gravity else []
    unchecked = escaping.comment(f'The limits of the joints are not checked: {limits}.')
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


class Options(NamedTuple):
    """What some formats may be told: the convention of a Denavit–Hartenberg table, the grid of a correction table."""

    convention: str = 'standard'
    step: float | None = None
    accuracy: float | None = None
    forces: tuple[float, ...] = ()


class Format(NamedTuple):
    """A format.

    Attributes:
        content: what its file holds, a sentence.
        is_rigid: whether it has the geometry alone.
        write: gives the text of the file and notes on it.
    """

    content: str
    is_rigid: bool
    write: Callable[[CalibratedArm, ExportFacts, Options], tuple[str, Sequence[str]]]


def _corrections(arm: CalibratedArm, facts: ExportFacts, options: Options) -> tuple[str, Sequence[str]]:
    middle = float(f'{(arm.used.lowest_force + arm.used.highest_force) / 2:.2g}')
    accuracy = options.accuracy or arm.cell.tolerance or 1e-4
    grid = Grid(options.step, tuple(dict.fromkeys(options.forces)) or (0.0, middle), accuracy)
    return correction_file(arm, facts.lines, grid)


_RIGID = 'Rigid geometry of the calibrated arm: the tip tool0 is H(L, Q), without compliance and backlash.'
FORMATS = {
    'urdf': Format(_RIGID, True, lambda arm, facts, _: (urdf_text(arm, facts), ())),
    'xacro': Format(_RIGID, True, lambda arm, facts, _: (xacro_text(arm, facts), ())),
    'dh': Format(
        'Denavit-Hartenberg parameters of the calibrated arm, rigid: without compliance and backlash.',
        True,
        lambda arm, facts, options: (dh_text(arm, facts, options.convention), ()),
    ),
    'csv': Format(
        'Corrections of the joint angles of the nominal arm, over places and forces of the robot on the object.',
        False,
        _corrections,
    ),
    'header': Format(
        'Calibrated kinetostatic model of a SCARA arm: geometry, compliance, backlash.',
        False,
        lambda arm, facts, _: (header_text(arm, facts), ()),
    ),
}
"""The formats by name."""


def exported_into(arm: CalibratedArm, urdf: Path, source: str) -> tuple[tuple[str, str], list[str]]:
    """The user's URDF with corrected origins, and these as YAML; and what is to be known of them.

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
    soft = ', '.join(f'{name} {value:.3g} {UNITS[name]}' for name, value in p.as_dict().items() if name in _SOFT)
    rest = f'a rigid URDF cannot hold compliance and backlash ({soft}), nor effects too small to be detected'
    facts = facts._replace(lines=(*facts.lines, escaping.comment(f'{rest[:1].upper()}{rest[1:]}.')))
    text = with_origins(content, origins, _comment(facts), robot)
    return (text, origins_yaml(origins, facts.lines)), [*facts.notes(is_rigid=True), rest]


def exported(arm: CalibratedArm, kind: str, source: str, options: Options = Options()) -> tuple[str, list[str]]:  # noqa: B008 - immutable
    """The text of a file, and what is to be known of it, one sentence each.

    Args:
        arm: the calibrated arm.
        kind: one of `FORMATS`.
        source: the file that the arm was read from.
        options: of the format.

    Raises:
        ParameterError: the grid of a correction table is too fine.
        UnsupportedDataError: the format cannot hold the model.
    """
    chosen = FORMATS[kind]
    facts = ExportFacts.of(arm, source, chosen.content)
    text, notes = chosen.write(arm, facts, options)
    return text, [*facts.notes(is_rigid=chosen.is_rigid), *notes]
