"""What every exported file says of the calibration that it holds, as comment lines."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.errors import one_line
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES

_POSES = 24
"""Joint angles along each axis at which the rigid arm is compared with the model."""
RIGID = ('x0', 'y0', 'theta1', 'l1', 'theta2', 'l2')
"""The parameters of the rigid arm."""
_FREE = 'not determined'
_NO_MISS = 1e-9
"""A displacement of the tip that is none, m."""


CONTENT = {
    'urdf': 'Rigid geometry of the calibrated arm: the tip tool0 is H(L, Q), without compliance and backlash.',
    'xacro': 'Rigid geometry of the calibrated arm: the tip tool0 is H(L, Q), without compliance and backlash.',
    'dh': 'Denavit-Hartenberg parameters of the calibrated arm, rigid: without compliance and backlash.',
    'csv': 'Corrections of the joint angles of the nominal arm, over places and forces of the robot on the object.',
    'header': 'Calibrated kinetostatic model of a SCARA arm: geometry, compliance, backlash.',
}
"""What a file of each format holds."""


class ExportFacts(NamedTuple):
    """Facts of a calibration for the head of a file.

    Attributes:
        lines: comment lines without marks; no line holds the end of a comment of XML or C.
        std: of each of the twelve parameters, words: ``u = 2e-06`` or ``not determined``.
        robot_effects: labels of the effects that act on the robot itself.
        rigid_miss: largest displacement of the tip without load by these effects, which a rigid arm leaves out, m.
        reservations: what is to be known of the calibration, one sentence each.
    """

    lines: tuple[str, ...]
    std: tuple[str, ...]
    robot_effects: tuple[str, ...]
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
        effects = tuple(effect.label for effect in arm.model.effects if _is_of_robot(effect))
        grade = f', grade {arm.grade}' if arm.grade else ''
        found = ', '.join(effect.label for effect in arm.model.effects) or 'none'
        lines: tuple[str, ...] = (
            content,
            f'From {source}: calibrated {arm.created or "at an unknown time"}{grade}.',
            f'Model errors found: {found}.',
            f'Written by scara_kinetostatic {__version__}.',
        )
        miss = rigid_miss(arm) if effects else 0.0
        if miss:
            lines += (f'Up to {1e3 * miss:.3g} mm of the unloaded tip are by {", ".join(effects)}.',)
        cleaned = tuple(map(_as_comment, lines))
        return cls(cleaned, _stds(arm), effects, miss, arm.reservations)

    def notes(self, *, is_rigid: bool) -> list[str]:
        """What a reader must know besides, one sentence each; `is_rigid`: whether the file has the geometry alone."""
        found = list(self.reservations)
        named = RIGID if is_rigid else NAMES
        free = [name for name, std in zip(NAMES, self.std, strict=True) if std == _FREE and name in named]
        if free:
            found.append(f'the touches do not determine {", ".join(free)}: other values fit them as well')
        if is_rigid and self.rigid_miss:
            effects = ', '.join(self.robot_effects)
            miss = f'{1e3 * self.rigid_miss:.3g} mm'
            found.append(f'it cannot hold {effects}: the tip is up to {miss} elsewhere even without load; see `locate`')
        return found


def _as_comment(line: str) -> str:
    """A line that ends no comment of XML or C, and is one line, whatever the name of a file or robot."""
    return re.sub('-(?=-|$)', '- ', one_line(line)).replace('*/', '* /')


def _is_of_robot(effect: EffectLaw) -> bool:
    no_force = np.ones((1, 2))
    start = np.array([p.start for p in effect.parameters])
    return not effect.on_object and effect.sensor_error(no_force, start, None) is None


def _stds(arm: CalibratedArm) -> tuple[str, ...]:
    stds = np.sqrt(np.diag(arm.covariance))[: len(NAMES)]
    hidden = np.linalg.norm(arm.undetermined[: len(NAMES)], axis=1) > stds
    pairs = zip(hidden.tolist(), stds.tolist(), strict=True)
    return tuple(_FREE if free else f'u = {std:.2g}' if std else 'fixed' for free, std in pairs)


def rigid_miss(arm: CalibratedArm) -> float:
    """Largest displacement of the unloaded tip by effects that act on the robot, over all joint angles, m."""
    angles = np.linspace(-np.pi, np.pi, _POSES)
    joints = np.stack(np.meshgrid(angles, angles), axis=-1).reshape(-1, 2)
    tip, _ = direct_kinetostatics(arm.model, joints, np.zeros_like(joints), arm.cell.gripper)
    miss = np.linalg.norm(tip - forward(arm.model.parameters, joints), axis=1)
    largest = float(np.nanmax(miss))
    return largest if largest > _NO_MISS else 0.0
