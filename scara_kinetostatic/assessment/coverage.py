"""Where the result is an extrapolation: elbow postures, forces and places that were not touched."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import NAMES, Parameters

GEOMETRY = 6
"""The first parameters are those of the unloaded arm."""
_ELBOWS = {1: 'left', -1: 'right'}
_FIRST_ANGLES = np.linspace(-np.pi, np.pi, 12, endpoint=False)
_ELBOW_ANGLES = np.deg2rad(np.linspace(20.0, 160.0, 8))
"""The workspace: all round the base, the elbow neither nearly stretched nor nearly folded."""


def postures(evidence: Evidence) -> Iterator[Remark]:
    """An elbow posture that was not touched."""
    c = evidence.final
    touched = set(c.touches.posture[c.used].tolist())
    for posture in {1, -1} - touched:
        yield Remark(
            Grade.CAUTION,
            f'all touches are with the elbow {_ELBOWS[-posture]}: with the elbow {_ELBOWS[posture]} the result is an '
            'extrapolation that nothing has checked',
            f'use it with the elbow {_ELBOWS[-posture]} only, or touch with the elbow {_ELBOWS[posture]}, too',
        )


def forces(evidence: Evidence) -> Iterator[Remark]:
    """Forces that are all alike."""
    c = evidence.final
    if any({'p_ee', 'g_ee'} <= set(group) for group in c.identifiability.confounded):
        return  # said already
    size = np.hypot(*c.force[c.used].T)
    least, most = float(size.min()), float(size.max())
    if most < thresholds.FORCE_RANGE * least:
        yield Remark(
            Grade.CAUTION,
            f'all touches are at {least:.0f} to {most:.0f} N: at other forces the result is an extrapolation',
            f'touch with {least / 2:.0f} N as well',
        )


def places(evidence: Evidence) -> Iterator[Remark]:
    """Touches that cover a small part of the workspace."""
    c = evidence.final
    if any(set(group) & set(NAMES[:GEOMETRY]) for group in c.identifiability.confounded):
        return
    touched = float(np.median(tip_std(c, c.touches.joints[c.used])))
    joints = workspace(c)
    std = tip_std(c, joints)
    worst = int(np.argmax(std))
    if touched > 0 and std[worst] > thresholds.EXTRAPOLATION * touched:
        x, y = forward(c.parameters, joints[worst : worst + 1])[0]
        yield Remark(
            Grade.CAUTION,
            f'the touches cover a small part of the workspace: at x {x:.2f} m, y {y:.2f} m the tip is uncertain by '
            f'{quantity(float(std[worst]), "m")} (1 σ), at the touches by {quantity(touched, "m")}',
            'use it near the touches, or touch objects that are farther apart',
        )


def workspace(c: Calibration) -> Floats:
    """Joint angles all over the workspace, in the elbow postures that were touched, (n, 2), rad."""
    first, second = (axis.ravel() for axis in np.meshgrid(_FIRST_ANGLES, _ELBOW_ANGLES, indexing='ij'))
    touched = np.unique(c.touches.posture[c.used])
    return np.concatenate([np.stack([first, posture * second], axis=-1) for posture in touched])


def tip_std(c: Calibration, joints: Floats) -> Floats:
    """Standard uncertainty of the unloaded tip H(L̄, Q) in the direction where it is largest, (n,), m."""
    p = c.parameters.as_array()
    derivative = np.empty((len(joints), 2, GEOMETRY))
    for k in range(GEOMETRY):  # complex steps are not worth it: H is linear in lengths, and angles are in rad
        step = np.zeros_like(p)
        step[k] = 1e-6
        high, low = (forward(Parameters.from_array(p + sign * step), joints) for sign in (1, -1))
        derivative[:, :, k] = (high - low) / 2e-6
    covariance = derivative @ c.covariance[:GEOMETRY, :GEOMETRY] @ derivative.swapaxes(1, 2)
    return np.sqrt(np.clip(np.linalg.eigvalsh(covariance)[:, -1], 0.0, None))
