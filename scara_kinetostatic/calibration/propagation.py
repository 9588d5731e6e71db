"""Predictions H̄ and Ḡ of a calibrated model with their uncertainty (GUM, JCGM 100, sections 4.3.7 and 5.2).

For a prediction y(x) of the model's values x with covariance Σ, to first order Σ_y = J Σ Jᵀ with J = ∂y/∂x, here by
differences over a tenth of each standard uncertainty: central ones, one-sided ones at the edge of reach. Where y
depends on a direction of x that the data do not determine, there is no statement: Σ_y is NaN.

Where the force or a torque is within three standard deviations of zero, the sign of its backlash is not known: the
prediction is that of the middle of the dead band, and the half-width g contributes the variance g²/3 of a uniform
distribution.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.joint_equations import solve_link_angles
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics, joint_torques
from scara_kinetostatic.model.robot_effects import Pose, solve_pose

_STEP = 0.1
"""Step of the differences, in standard uncertainties."""
_DETERMINED = 1e-9
"""Singular value above which a direction, in plausible ranges of its parameters, was free in the fit."""
_DEPENDS = 1.0
"""A change of the prediction by the plausible range of an undetermined direction that counts, in standard
uncertainties of the prediction."""
_PASSES = 20
"""Newton steps to the link angles at most; three or four suffice."""
_ROUNDING = 1e-15
"""Change of the link angles at which they are found, rad."""
_SETTLED = 1e-12
"""Change of the link angles by one more step that is only rounding, rad."""
_STARTS = ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
"""Flanks of both joints from which the link angles are sought, in turn."""
_SIGN_KNOWN = 3.0
"""Standard uncertainties from zero at which the sign of a torque, or the direction of a force, is known."""
Law = Callable[[ExtendedModel, Indices], tuple[Floats, Floats]]
"""From a model and the numbers of some poses to the prediction and the torques there, (k, 2) each."""


class Prediction(NamedTuple):
    """H̄ or Ḡ of n poses.

    Attributes:
        value: tip or joint angles, (n, 2), m or rad.
        torques: C, (n, 2), Nm.
        covariance: of `value`, (n, 2, 2); NaN where the data do not determine it.
        loaded: whether the force and both torques exceed three times their standard uncertainty, (n,).
    """

    value: Floats
    torques: Floats
    covariance: Floats
    loaded: Mask


def locate_tip(calibration: Calibration, joints: Floats, force: Floats, metadata: TouchMetadata) -> Prediction:
    """H̄ with its uncertainty.

    Args:
        calibration: the model with its covariance.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        metadata: of the poses.
    """
    gripper = calibration.cell.gripper

    def law(model: ExtendedModel, rows: Indices) -> tuple[Floats, Floats]:
        return tip_under_force(model, joints[rows], force[rows], gripper, metadata.select(rows))

    found, bands = _predict(calibration, law, force, joints)
    jacobian = kinematics.jacobian(calibration.parameters, joints)
    band = np.einsum('nij,nj,nkj->nik', jacobian, bands[:, :2], jacobian) + bands[:, 2, None, None] * np.eye(2)
    return found._replace(covariance=found.covariance + band)


def compensate_joints(
    calibration: Calibration, tip: Floats, force: Floats, posture: Indices, metadata: TouchMetadata
) -> Prediction:
    """Ḡ with its uncertainty.

    Args:
        calibration: the model with its covariance.
        tip: S, (n, 2), m.
        force: F on the object, base frame, (n, 2), N.
        posture: +1 or -1, (n,).
        metadata: of the poses.
    """
    gripper = calibration.cell.gripper

    def law(model: ExtendedModel, rows: Indices) -> tuple[Floats, Floats]:
        return inverse_kinetostatics(
            model, tip[rows], force[rows], posture[rows], gripper, metadata=metadata.select(rows)
        )

    found, bands = _predict(calibration, law, force)
    (a, b), (c, d) = np.moveaxis(kinematics.jacobian(calibration.parameters, found.value), 0, -1)
    with np.errstate(divide='ignore', invalid='ignore'):  # the stretched arm has no inverse
        inverse = np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), -1, 0)
        gripper_band = np.where(
            bands[:, 2, None, None] > 0, bands[:, 2, None, None] * inverse @ inverse.swapaxes(1, 2), 0.0
        )
    return found._replace(covariance=found.covariance + bands[:, :2, None] * np.eye(2) + gripper_band)


def _predict(c: Calibration, law: Law, force: Floats, joints: Floats | None = None) -> tuple[Prediction, Floats]:
    """The prediction, and the variance of each backlash in its dead band, (n, 3): g1, g2 in rad², g_ee in m²."""
    value, torques, covariance, of_torques = _propagate(c, law, np.arange(len(force)))
    jacobian = kinematics.jacobian(c.parameters, value if joints is None else joints)
    noise = c.noise.force_rms
    variance = np.nan_to_num(np.diagonal(of_torques, axis1=1, axis2=2)) + noise**2 * (jacobian**2).sum(axis=1)
    small = np.column_stack([torques**2 <= _SIGN_KNOWN**2 * variance, np.hypot(*force.T) <= _SIGN_KNOWN * noise])
    for pattern in np.unique(small[small.any(axis=1)], axis=0):
        rows = np.flatnonzero((small == pattern).all(axis=1))
        centred = _propagate(c, _centred(law, pattern), rows)
        value[rows], torques[rows], covariance[rows] = centred[:3]
    p = c.parameters
    bands = np.where(small, np.array([p.g1, p.g2, p.g_ee]) ** 2 / 3, 0.0)
    return Prediction(value, torques, covariance, np.asarray(~small.any(axis=1))), bands


def _centred(law: Law, which: Mask) -> Law:
    """The law with some of g1, g2, g_ee zero: it predicts the middle of their dead bands."""
    zeros = {name: 0.0 for name, zero in zip(('g1', 'g2', 'g_ee'), which, strict=True) if zero}
    return lambda model, rows: law(model.replace(**zeros), rows)


def tip_under_force(
    model: ExtendedModel, joints: Floats, force: Floats, gripper: Gripper, metadata: TouchMetadata | None = None
) -> tuple[Floats, Floats]:
    """H̄ from what sensors measure: the tip's place from joint angles and the force on the object.

    Args:
        model: the model.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N; where it is zero the joints are in the middle of their dead
            bands.
        gripper: the form of (7).
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`.

    Returns:
        S, (n, 2), m, and C, (n, 2), Nm.
    """
    parameters = model.parameters
    pressed = np.any(force != 0, axis=1)[:, None]

    def pose_with(turn: Floats, place: Floats) -> Pose:
        links = np.where(pressed, _links(model, joints - turn, force, gripper), joints - turn)
        link2 = links.sum(axis=1) + parameters.theta1 + parameters.theta2
        with np.errstate(invalid='ignore'):
            offset = np.where(pressed, gripper.deflection(parameters, force, link2), 0.0)
        torques = joint_torques(parameters, links, force, offset)
        return Pose(joints, links, torques, kinematics.forward(parameters, links) + offset + place, force)

    still = np.zeros_like(joints)
    pose = solve_pose(pose_with, model, len(joints), gripper, metadata) if model.effects else pose_with(still, still)
    return pose.tip, pose.torques


def _links(model: ExtendedModel, joints: Floats, force: Floats, gripper: Gripper) -> Floats:
    """Q* of joints under a force, (n, 2), by Newton's method.

    Where a link is nearly in line with a force that compresses it, the floating joint is unstable, and the flanks
    alternate from one start: then the others are tried.
    """
    links, settled = _links_from(_STARTS[0], model, joints, force, gripper)
    wrong = np.flatnonzero(~settled)
    for start in _STARTS[1:]:
        if not len(wrong):
            break
        found, settled = _links_from(start, model, joints[wrong], force[wrong], gripper)
        links[wrong[settled]] = found[settled]
        wrong = wrong[~settled]
    return links


def _links_from(
    start: tuple[float, float], model: ExtendedModel, joints: Floats, force: Floats, gripper: Gripper
) -> tuple[Floats, Mask]:
    """Q* from flanks to start on, (n, 2), and whether links and flanks agree, (n,)."""
    magnitude, direction = np.hypot(force[:, 0], force[:, 1]), np.arctan2(force[:, 1], force[:, 0])
    flanks = (np.full(len(joints), each) for each in start)
    state = State(joints[:, 0], joints[:, 1], magnitude, direction, *flanks)
    for _ in range(_PASSES):
        before = state
        state = solve_link_angles(model.parameters, joints, state, gripper, again=True).state
        if not np.any(np.abs([state.link1 - before.link1, state.link2 - before.link2]) > _ROUNDING):
            break
    next_one = solve_link_angles(model.parameters, joints, state, gripper).state
    moved = np.abs([state.link1 - next_one.link1, state.link2 - next_one.link2]).max(axis=0)
    settled = (moved < _SETTLED) & (state.mode1 == next_one.mode1) & (state.mode2 == next_one.mode2)
    return np.stack([state.link1, state.link2], axis=-1), np.asarray(settled)


def _propagate(c: Calibration, law: Law, rows: Indices) -> tuple[Floats, Floats, Floats, Floats]:
    """A prediction and the torques of some poses, (k, 2) each, and the covariance of both, (k, 2, 2) each."""

    def predict(model: ExtendedModel) -> Floats:
        return np.concatenate(law(model, rows), axis=1)

    found = predict(c.model)
    values, scales = c.model.as_array(), scales_of(c.model)
    std = np.sqrt(np.clip(np.diag(c.covariance), 0.0, None))
    free = np.array([name not in c.fixed for name in c.model.names])
    step = np.where(std > 0, _STEP * std, 1e-3 * scales)
    jacobian = np.zeros((*found.shape, len(values)))
    for k in np.flatnonzero(free):
        change = step * (np.arange(len(values)) == k)
        up, down = predict(c.model.with_array(values + change)), predict(c.model.with_array(values - change))
        sides = np.isfinite(up).astype(float) + np.isfinite(down)
        up, down = np.where(np.isfinite(up), up, found), np.where(np.isfinite(down), down, found)
        with np.errstate(invalid='ignore'):  # out of reach with either
            jacobian[..., k] = (up - down) / (sides * step[k])
    undetermined = undetermined_directions(c)
    of_value, of_torques = (_covariance(c, part, undetermined) for part in (jacobian[:, :2], jacobian[:, 2:]))
    return found[:, :2].copy(), found[:, 2:].copy(), of_value, of_torques


def _covariance(c: Calibration, jacobian: Floats, undetermined: Floats) -> Floats:
    covariance = np.einsum('nik,kl,njl->nij', jacobian, c.covariance, jacobian)
    change = np.linalg.norm(jacobian @ undetermined, axis=(1, 2))
    total = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    return np.where((change > _DEPENDS * total)[:, None, None], np.nan, covariance)


def undetermined_directions(calibration: Calibration) -> Floats:
    """Directions of the free values that the fit kept where they were, each by its plausible range, (12 + k, u)."""
    scales = scales_of(calibration.model)
    held = calibration.model.held.union(calibration.fixed)
    free = np.array([name not in held for name in calibration.model.names])
    basis = (calibration.subspace.basis / scales[:, None])[free]
    u, singular, _ = np.linalg.svd(basis, full_matrices=True)
    rank = int(np.sum(singular > _DETERMINED * singular.max(initial=0.0)))
    found = np.zeros((len(free), u.shape[0] - rank))
    found[free] = u[:, rank:]
    return np.asarray(scales[:, None] * found)
