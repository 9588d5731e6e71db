"""Which touches would decide between rivals: those where they, each fitted to the data, predict different forces.

From a pool of touches all over the discs, in both elbow postures, at three force levels, pressed straight or
beyond the force and let down to it, those are chosen at which the predictions lie farthest apart in standard
deviations of a measured force, Σ_F + A_Q Σ_Q A_Qᵀ. That is the criterion of T-optimality (Atkinson and Fedorov,
Biometrika 62 (1975) 57).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.touch import TouchSet

Floats = NDArray[np.float64]

DIRECTIONS = 24
UNLOADED = 0.3
FIRST_FORCE = 1e-3
REACHED = 0.95
"""Part of the length of the arm beyond which no touch is advised."""
APART = 2.0
"""Standard deviations by which the predictions must differ for a touch to be worth while."""


class DiscriminatingTouch(NamedTuple):
    """A touch that would tell two rivals apart.

    Attributes:
        disc: name of the disc.
        angle: place on it, direction from its centre, rad.
        posture: elbow, +1 or -1.
        force: N.
        let_down: whether it is pressed harder first and let down to the force.
        apart: distance of the two predictions, N.
        sigmas: the same in standard deviations.
    """

    disc: str
    angle: float
    posture: int
    force: float
    unloaded: bool
    apart: float
    sigmas: float

    def __str__(self) -> str:
        """In words."""
        how = f'pressed beyond {self.force:.0f} N and let down to it' if self.unloaded else f'with {self.force:.0f} N'
        side = f'{np.degrees(self.angle) % 360:.0f}°'
        return f'{self.disc} from {side}, elbow {self.posture:+d}, {how} ({self.apart:.1f} N apart)'


def discriminating_touches(
    calibration: Calibration, rivals: Sequence[Calibration], most: int = 4
) -> tuple[DiscriminatingTouch, ...]:
    """The touches that tell fitted rivals apart best, one per disc and side.

    Args:
        calibration: of the twelve parameters; its touches give the force levels.
        rivals: the same touches fitted with each rival, two or more.
        most: how many touches at most.
    """
    pool, angle, unloaded = _pool(calibration)
    apart, sigmas = np.zeros(len(pool)), np.zeros(len(pool))
    for one, other in combinations([_predict(pool, rival) for rival in rivals], 2):
        distance, off_normal_std = _apart(one, other)
        farther = distance / off_normal_std > sigmas
        apart, sigmas = np.where(farther, distance, apart), np.where(farther, distance / off_normal_std, sigmas)
    chosen: list[int] = []
    for k in np.argsort(-sigmas):
        warm_start = any(pool.disc[k] == pool.disc[j] and np.cos(angle[k] - angle[j]) > 0.5 for j in chosen)
        if sigmas[k] >= APART and not warm_start and len(chosen) < most:
            chosen.append(int(k))
    magnitude = np.hypot(*pool.force.T)
    names = [disc.name for disc in calibration.cell.discs]
    return tuple(
        DiscriminatingTouch(
            names[pool.disc[k]],
            float(angle[k]),
            int(pool.posture[k]),
            float(magnitude[k]),
            bool(unloaded[k]),
            float(apart[k]),
            float(sigmas[k]),
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
    o, model = observe(pool, fit.cell), fit.model
    found = contact(model, o.joints, o.centers, o.radii, o.gripper, warm_start=pool.force, metadata=o.metadata)
    reached = (found.solved & (found.magnitude > 0))[:, None]
    by_joints = contact_derivatives(model, o.joints, o.centers, o.radii, found, o.gripper, o.metadata).joints
    return _Predicted(np.where(reached, found.force, np.nan), by_joints, fit.noise)


def _apart(one: _Predicted, other: _Predicted) -> tuple[Floats, Floats]:
    """How far two predictions lie apart, N, and the standard deviation of that distance."""
    difference = one.force - other.force
    distance = np.nan_to_num(np.hypot(difference[:, 0], difference[:, 1]))
    along = np.nan_to_num(difference / np.maximum(distance, 1e-12)[:, None])
    turned = np.einsum('nij,ni->nj', one.by_joints, along)
    return distance, np.sqrt(one.noise.force**2 + one.noise.joint**2 * (turned**2).sum(axis=1))


def _pool(calibration: Calibration) -> tuple[TouchSet, Floats, NDArray[np.bool_]]:
    """Touches to choose from, with their places on the discs and whether they are let down to their force."""
    cell, p = calibration.cell, calibration.parameters
    magnitude = np.hypot(*calibration.force.T)
    levels = np.unique(np.round(np.quantile(magnitude, (0.05, 0.5, 0.95)), 0))
    disc, direction, posture, level, down = (
        axis.ravel()
        for axis in np.meshgrid(
            np.arange(len(cell.discs)), np.arange(DIRECTIONS), (1, -1), levels, (False, True), indexing='ij'
        )
    )
    angle = 2 * np.pi * direction / DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    tip = cell.centers[disc] + cell.radii[disc, None] * outward
    reach = np.hypot(tip[:, 0] - p.x0, tip[:, 1] - p.y0)
    warm_start = (reach < REACHED * (p.l1 + p.l2)) & (reach > (1 - REACHED) * (p.l1 + p.l2) + abs(p.l1 - p.l2))
    parts = [array[warm_start] for array in (disc, angle, posture, level, down, tip, outward)]
    disc, angle, posture, level, down, tip, outward = parts

    def pressed(force: Floats) -> Floats:
        return inverse_kinetostatics(p, tip, -force[:, None] * outward, posture, cell.gripper)[0]

    joints = pressed(level)
    before = np.where(down, (1 + UNLOADED) * level, FIRST_FORCE)
    motion = joints - pressed(before)
    motion = (motion + np.pi) % (2 * np.pi) - np.pi
    time = np.full(len(disc), float(calibration.touches.time.max()))
    pool = TouchSet(joints, -level[:, None] * outward, disc, posture, time=time, approach=motion, press=motion)
    return pool, angle, down
