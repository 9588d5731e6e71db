"""How well touches agree with a description of the cell: a coarse, robust fit of many descriptions at once.

Each `Reading` is one way to read the touches and the cell. With the link angles that the measured
torques give, Q* = Q - p c - g sign(c), c = JᵀF, every touch puts the rigid tip at S* = H(Q*), and of the touched disc
two numbers have to vanish,

    d = |c_d - S*| - (r_d - p_ee f - g_ee),        the distance from the circle of contact (5) (7), m,
    a = angle(F) - angle(c_d - S*) + φ,            the off-normal angle of the force, rad,

with φ = 0, or the rotation of the sensor where a reading has one. The disc is the one with the smallest miss. The
twelve parameters are fitted by iteratively reweighted least squares (Cauchy's loss) with a prior about the nominal
values that is as wide as the errors of real cells; the backlash of the gripper is nearly free, as it stands for an
error of all radii. What is left is measured by the mean of log(1 + (d/D)²) + log(1 + (a/A)²): about 0 for a right
reading, above 5 for one that has nothing to do with the touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.kinematics import LoadedJoints, component_by_parameters, quarter_turn, stacked, wrap
from scara_kinetostatic.model.parameters import G1, G2, G_EE, L1, L2, NAMES, P1, P2, P_EE, THETA1, THETA2, X0, Y0

DISTANCE = 2e-4
"""D: distances from the circle of contact of this size are those of ordinary model errors, m."""
ANGLE = 0.15
"""A: the same of off-normal angles, such as those of friction and noise, rad."""
_PRIOR = np.empty(len(NAMES))
_PRIOR[[X0, Y0, L1, L2]] = 0.015
_PRIOR[[THETA1, THETA2]] = np.deg2rad(2.5)
_PRIOR[[P1, P2]] = 3e-4
_PRIOR[[G1, G2]] = 5e-3
_PRIOR[[P_EE, G_EE]] = 1e-4, 0.05
"""Standard deviation of the error of each nominal value, SI units."""


class Reading(NamedTuple):
    """A way to read n touches of m discs; in the fit k of them, stacked along a first axis.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object in the frame of the sensor, (n, 2), N.
        tool: whether that frame turns with link 2.
        centers: of the discs, (m, 2), m.
        radii: of the discs, (m,), m.
        nominal: the twelve parameters, (12,).
        free: which of them are fitted, (12,), 1 or 0.
        rotation: standard deviation of an unknown rotation φ of the sensor, rad; 0 for none.
    """

    joints: Floats
    force: Floats
    tool: Floats
    centers: Floats
    radii: Floats
    nominal: Floats
    free: Floats
    rotation: Floats


class Agreement(NamedTuple):
    """How well each of k readings agrees with n touches.

    Attributes:
        parameters: the twelve fitted, (k, 12).
        rotation: φ fitted, (k,), rad.
        disc: the touched one, (k, n).
        distance: d, (k, n), m.
        angle: a, (k, n), rad.
        misfit: the mean of log(1 + (d/D)²) + log(1 + (a/A)²), (k,).
    """

    parameters: Floats
    rotation: Floats
    disc: Indices
    distance: Floats
    angle: Floats
    misfit: Floats


class _Scene(NamedTuple):
    """Every touch under the parameters of a step."""

    disc: Indices
    distance: Floats
    angle: Floats
    by_distance: Floats
    by_angle: Floats


@np.errstate(all='ignore')
def fit_readings(readings: Sequence[Reading]) -> Agreement:
    """Fit every reading to the touches; the misfit of one that cannot be evaluated is infinite."""
    s = Reading(*(np.array(column, dtype=float) for column in zip(*readings, strict=True)))
    k = len(s.nominal)
    prior = np.concatenate([_PRIOR * s.free, s.rotation[:, None]], axis=1)
    change = np.zeros((k, len(NAMES) + 1))
    for step in range(12):  # the scales of the loss shrink to D and A
        scene = _scene(s, change)
        by_d = max(DISTANCE, 0.02 * 0.5**step)
        by_a = max(ANGLE, 0.3 * 0.5**step)
        change = _solved(scene, change, prior, by_d, by_a)
    scene = _scene(s, change)
    loss = np.log1p((scene.distance / DISTANCE) ** 2) + np.log1p((scene.angle / ANGLE) ** 2)
    parameters = s.nominal + change[:, :-1]
    misfit = np.nan_to_num(loss.mean(axis=1), nan=np.inf)
    return Agreement(parameters, change[:, -1], scene.disc, scene.distance, scene.angle, misfit)


def _solved(scene: _Scene, change: Floats, prior: Floats, by_d: float, by_a: float) -> Floats:
    """One step of reweighted least squares: the changes from the nominal values, (k, 13)."""
    rows, left = [], []
    for value, derivative, scale in ((scene.distance, scene.by_distance, by_d), (scene.angle, scene.by_angle, by_a)):
        weight = 1.0 / (scale * np.sqrt(1.0 + (value / scale) ** 2))
        rows.append(weight[..., None] * derivative * prior[:, None])
        left.append(weight * (np.einsum('kni,ki->kn', derivative, change) - value))
    k, size = prior.shape
    eye = np.broadcast_to(np.eye(size), (k, size, size))
    system = np.concatenate([*rows, eye], axis=1)
    right = np.concatenate([*left, np.zeros((k, size))], axis=1)
    q, r = np.linalg.qr(system)
    return np.asarray(prior * np.linalg.solve(r, np.einsum('kni,kn->ki', q, right)[..., None])[..., 0])


class _Arm(NamedTuple):
    """The loaded arm: unit vectors of the links, what a turn of each joint moves, torques, the rigid tip."""

    u: Floats
    v: Floats
    turn1: Floats
    turn2: Floats
    torque1: Floats
    torque2: Floats
    tip: Floats

    @property
    def senses(self) -> tuple[Floats, Floats]:
        """sign(c) of both joints, continuous within the least torque."""
        # 1e-2: within this torque the sense of a backlash is not certain, Nm
        one, two = (c / np.hypot(c, 1e-2) for c in (self.torque1, self.torque2))
        return one, two


def _arm(values: Sequence[Floats], links: Floats, force: Floats) -> _Arm:
    """The arm at link angles (k, n, 2) under a force in the base frame, (k, n, 2)."""
    first = links[..., 0] + values[THETA1]
    second = first + links[..., 1] + values[THETA2]
    u, v = (np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (first, second))
    link2 = values[L2][..., None] * v
    reach = values[L1][..., None] * u + link2
    turn1, turn2 = quarter_turn(reach), quarter_turn(link2)
    tip = reach + np.stack(np.broadcast_arrays(values[X0], values[Y0], first)[:2], axis=-1)
    return _Arm(u, v, turn1, turn2, (turn1 * force).sum(-1), (turn2 * force).sum(-1), tip)


def _scene(s: Reading, change: Floats) -> _Scene:
    """Distances, angles and their derivatives by the thirteen values, (k, n) and (k, n, 13)."""
    values = [column[:, None] for column in (s.nominal + change[:, :-1]).T]
    heading = values[THETA1] + s.joints.sum(axis=2) + values[THETA2]
    turned = np.where(s.tool[:, None] > 0, heading, 0.0) + change[:, -1:]
    size = np.maximum(np.hypot(s.force[..., 0], s.force[..., 1]), 1e-300)
    direction = np.arctan2(s.force[..., 1], s.force[..., 0]) + turned
    n = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    rigid = _arm(values, s.joints, size[..., None] * n)
    sense1, sense2 = rigid.senses
    deflection = values[P1] * rigid.torque1 + values[G1] * sense1, values[P2] * rigid.torque2 + values[G2] * sense2
    arm = _arm(values, s.joints - np.stack(deflection, axis=-1), size[..., None] * n)
    reach = s.radii[:, None, :] - (values[P_EE] * size + values[G_EE])[..., None]
    to_disc = s.centers[:, None] - arm.tip[:, :, None]
    miss = to_disc - reach[..., None] * n[:, :, None]
    disc = np.argmin(np.hypot(miss[..., 0], miss[..., 1]), axis=2)
    to_disc = np.take_along_axis(to_disc, disc[..., None, None], axis=2)[:, :, 0]
    reach = np.take_along_axis(reach, disc[..., None], axis=2)[:, :, 0]
    away = np.maximum(np.hypot(to_disc[..., 0], to_disc[..., 1]), 1e-9)
    angle = wrap(direction - np.arctan2(to_disc[..., 1], to_disc[..., 0]))
    return _Scene(disc, away - reach, angle, *_derivatives(arm, size, to_disc / away[..., None], away, s.tool))


def _derivatives(arm: _Arm, size: Floats, inward: Floats, away: Floats, tool: Floats) -> tuple[Floats, Floats]:
    """Those of d and a by the twelve parameters and φ, (k, n, 13) each; `size` of the force, (k, n), N."""
    at = LoadedJoints(torque=(arm.torque1, arm.torque2), sense=arm.senses)
    rows = [
        component_by_parameters(
            (1.0 - k, k), (arm.u[..., k], arm.v[..., k]), (arm.turn1[..., k], arm.turn2[..., k]), (0.0, 0.0), at
        )
        for k in (0, 1)
    ]
    moves = np.zeros((*size.shape, len(NAMES) + 1, 2))
    moves[..., :-1, :] = np.moveaxis(stacked(rows, size.shape), (0, 1), (-2, -1))
    by_distance = -(moves * inward[:, :, None]).sum(-1)
    by_distance[..., P_EE], by_distance[..., G_EE] = size, 1.0
    by_angle = (moves * quarter_turn(inward)[:, :, None]).sum(-1) / away[..., None]
    by_angle[..., THETA1] += tool[:, None]
    by_angle[..., THETA2] += tool[:, None]
    by_angle[..., -1] = 1.0
    return by_distance, by_angle
