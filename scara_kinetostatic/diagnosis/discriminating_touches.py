"""Discrimination of rivals: the touches at which their predictions of the force, each fitted to the data, differ most.

From a pool of touches all around the discs, in both elbow postures, at three force levels, pressed to the force or
preloaded beyond it and unloaded to it, those are chosen at which the predictions differ most in standard
deviations of a measured force, Σ_F + A_Q Σ_Q A_Qᵀ: the criterion of T-optimality (Atkinson and Fedorov,
Biometrika 62 (1975) 57).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.touch import LATER, TouchSet

_DIRECTIONS = 24
"""Touches of the pool around each disc."""
_PRELOAD = 0.3
"""Part of the force by which a touch is preloaded beyond it."""
_FIRST_FORCE = 1e-3
"""At the beginning of a touch that is pressed to its force, N."""
_LARGEST_REACH = 0.95
"""Part of the length of the arm beyond which no touch is advised."""
_LEAST_DIFFERENCE = 2.0
"""Standard deviations by which the predictions must differ for a touch to be advised."""
_NEIGHBOURS = 0.5
"""Cosine of the angle between two touches on a disc above which one of them is enough."""


class DiscriminatingTouch(NamedTuple):
    """A touch that would discriminate between two rivals.

    Attributes:
        disc: name of the disc.
        angle: place on it, direction from its centre, rad.
        posture: elbow, +1 or -1.
        force: N.
        is_unloaded: whether it is preloaded beyond the force and then unloaded to it.
        difference: of the two predictions, N.
        in_std: the same in standard deviations.
    """

    disc: str
    angle: float
    posture: int
    force: float
    is_unloaded: bool
    difference: float
    in_std: float

    def __str__(self) -> str:
        """As in advice: ``disc_1 from 30°, elbow +1, with 40 N (predictions differ by 1.2 N)``."""
        how = (
            f'preloaded beyond {self.force:.0f} N, then unloaded to it'
            if self.is_unloaded
            else f'with {self.force:.0f} N'
        )
        side = f'{np.degrees(self.angle) % 360:.0f}°'
        return (
            f'{self.disc} from {side}, elbow {self.posture:+d}, {how} (predictions differ by {self.difference:.1f} N)'
        )


def discriminating_touches(
    calibration: Calibration, rivals: Sequence[Calibration], most: int = 4
) -> tuple[DiscriminatingTouch, ...]:
    """The touches that discriminate best between fitted rivals, one per disc and side.

    Args:
        calibration: the base model; its touches give the force levels.
        rivals: the same touches fitted with each rival, two or more.
        most: how many touches at most.
    """
    pool, angle, is_unloaded = _pool(calibration)
    difference, in_std = np.zeros(len(pool)), np.zeros(len(pool))
    for one, other in combinations([_predict(pool, rival) for rival in rivals], 2):
        distance, std = _difference(one, other)
        larger = distance / std > in_std
        difference, in_std = np.where(larger, distance, difference), np.where(larger, distance / std, in_std)
    chosen: list[int] = []
    for k in np.argsort(-in_std):
        is_near = any(pool.disc[k] == pool.disc[j] and np.cos(angle[k] - angle[j]) > _NEIGHBOURS for j in chosen)
        if in_std[k] >= _LEAST_DIFFERENCE and not is_near and len(chosen) < most:
            chosen.append(int(k))
    magnitude = np.hypot(*pool.force.T)
    names = [disc.name for disc in calibration.cell.discs]
    return tuple(
        DiscriminatingTouch(
            names[pool.disc[k]],
            float(angle[k]),
            int(pool.posture[k]),
            float(magnitude[k]),
            bool(is_unloaded[k]),
            float(difference[k]),
            float(in_std[k]),
        )
        for k in chosen
    )


class _Predicted(NamedTuple):
    """The forces that a fit predicts for touches.

    Attributes:
        force: F, (n, 2), N; NaN where the model reaches none.
        by_joints: ∂F/∂Q, (n, 2, 2).
        noise: σ_q and σ_f of the fit.
    """

    force: Floats
    by_joints: Floats
    noise: Noise


def _predict(pool: TouchSet, fit: Calibration) -> _Predicted:
    o, model = observe(pool, replace(fit.cell, sensor=fit.cell.sensor._replace(frame=SensorFrame.BASE))), fit.model
    found = contact(model, o.joints, o.centers, o.radii, o.gripper, warm_start=pool.force, metadata=o.metadata)
    reached = (found.solved & (found.magnitude > 0))[:, None]
    by_joints = contact_derivatives(model, o.joints, o.centers, o.radii, found, o.gripper, o.metadata).joints
    return _Predicted(np.where(reached, found.force, np.nan), by_joints, fit.noise)


def _difference(one: _Predicted, other: _Predicted) -> tuple[Floats, Floats]:
    """The distance of two predictions, N, and its standard deviation, (n,) each."""
    difference = one.force - other.force
    distance = np.nan_to_num(np.hypot(difference[:, 0], difference[:, 1]))
    along = np.nan_to_num(difference / np.maximum(distance, 1e-12)[:, None])
    turned = np.einsum('nij,ni->nj', one.by_joints, along)
    return distance, np.sqrt(_force_variance(one) + ((one.noise.joint_levels * turned) ** 2).sum(axis=1))


def _force_variance(predicted: _Predicted) -> Floats | float:
    """Variance of a component of each force, rms over the axes, N²."""
    noise = predicted.noise
    grown = noise.growth**2 * np.nan_to_num(predicted.force**2).sum(axis=1) if noise.growth else 0.0
    return noise.force_rms**2 + grown


def _pool(calibration: Calibration) -> tuple[TouchSet, Floats, NDArray[np.bool_]]:
    """Touches to choose from, their places on the discs, and whether they are unloaded to their force.

    Their forces, in the history too, are in the base frame, whatever that of the sensor is.
    """
    cell, p = calibration.cell, calibration.parameters
    magnitude = np.hypot(*calibration.force.T)
    levels = np.unique(np.round(np.quantile(magnitude, (0.05, 0.5, 0.95)), 0))
    disc, direction, posture, level, is_unloaded = (
        axis.ravel()
        for axis in np.meshgrid(
            np.arange(len(cell.discs)), np.arange(_DIRECTIONS), (1, -1), levels, (False, True), indexing='ij'
        )
    )
    angle = 2 * np.pi * direction / _DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    tip = cell.centers[disc] + cell.radii[disc, None] * outward
    reach = np.hypot(tip[:, 0] - p.x0, tip[:, 1] - p.y0)
    length = p.l1 + p.l2
    reachable = (reach < _LARGEST_REACH * length) & (reach > (1 - _LARGEST_REACH) * length + abs(p.l1 - p.l2))
    parts = [array[reachable] for array in (disc, angle, posture, level, is_unloaded, tip, outward)]
    disc, angle, posture, level, is_unloaded, tip, outward = parts

    def pressed(force: Floats) -> Floats:
        return inverse_kinetostatics(p, tip, -force[:, None] * outward, posture, cell.gripper)[0]

    joints = pressed(level)
    before = np.where(is_unloaded, (1 + _PRELOAD) * level, _FIRST_FORCE)
    motion = joints - pressed(before)
    motion = (motion + np.pi) % (2 * np.pi) - np.pi
    peak = np.where(is_unloaded, before, 0.0)[:, None] * -outward
    pool = TouchSet(
        joints=joints,
        force=-level[:, None] * outward,
        disc=disc,
        posture=posture,
        time=np.full(len(disc), float(calibration.touches.time.max())),
        approach=motion,
        press=motion,
        history=np.concatenate([joints - motion, peak], axis=1)[:, None],
        order=np.full(len(disc), LATER),
    )
    return pool, angle, is_unloaded
