"""Propagation of the calibration's uncertainty to what the model predicts (GUM, JCGM 100, section 5.2).

For a prediction y(x) of the model's values x with covariance Σ, to first order Σ_y = J Σ Jᵀ with J = ∂y/∂x, here by
central differences over a tenth of each standard uncertainty. Where y depends on a direction of x that the data do not
determine, there is no statement: Σ_y is NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.joint_equations import solve_link_angles
from scara_kinetostatic.model.kinetostatics import joint_torques
from scara_kinetostatic.model.robot_effects import Pose, solve_pose

_STEP = 0.1
"""Step of the central difference, in standard uncertainties."""
_DETERMINED = 1e-9
"""Singular value above which a direction, in plausible ranges of its parameters, was free in the fit."""
_DEPENDS = 1.0
"""A change of the prediction by the plausible range of an undetermined direction that counts, in standard
uncertainties of the prediction."""
_PASSES = 20
"""Newton steps to the link angles; three or four suffice."""


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
    """Q* of joints under a force, (n, 2), by Newton's method."""
    n = len(joints)
    magnitude, direction = np.hypot(force[:, 0], force[:, 1]), np.arctan2(force[:, 1], force[:, 0])
    state = State(joints[:, 0], joints[:, 1], magnitude, direction, np.ones(n), np.ones(n))
    for _ in range(_PASSES):
        before = state
        state = solve_link_angles(model.parameters, joints, state, gripper, again=True).state
        if np.array_equal(state.link1, before.link1) and np.array_equal(state.link2, before.link2):
            break
    return np.stack([state.link1, state.link2], axis=-1)


def propagated(calibration: Calibration, predict: Callable[[ExtendedModel], Floats]) -> Floats:
    """Covariance of a prediction by the uncertainty of the calibrated model.

    Args:
        calibration: the model with its covariance.
        predict: from a model to the prediction, (n, 2).

    Returns:
        (n, 2, 2), in squared units of the prediction; NaN where it depends on what the data do not determine.
    """
    c = calibration
    values, scales = c.model.as_array(), scales_of(c.model)
    std = np.sqrt(np.clip(np.diag(c.covariance), 0.0, None))
    free = np.array([name not in c.fixed for name in c.model.names])
    step = np.where(std > 0, _STEP * std, 1e-3 * scales)
    columns = []
    for k in range(len(values)):
        if not free[k]:
            columns.append(np.zeros_like(predict(c.model)))
            continue
        change = step * (np.arange(len(values)) == k)
        up, down = predict(c.model.with_array(values + change)), predict(c.model.with_array(values - change))
        columns.append((up - down) / (2 * step[k]))
    jacobian = np.stack(columns, axis=-1)
    covariance = np.einsum('nik,kl,njl->nij', jacobian, c.covariance, jacobian)
    spread = np.linalg.norm(jacobian @ (scales[:, None] * _undetermined(c, free, scales)), axis=(1, 2))
    total = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    return np.where((spread > _DEPENDS * total)[:, None, None], np.nan, covariance)


def _undetermined(calibration: Calibration, free: Mask, scales: Floats) -> Floats:
    """Orthonormal directions of the free values, in their plausible ranges, that the fit kept, (12 + k, u)."""
    basis = (calibration.subspace.basis / scales[:, None])[free]
    u, singular, _ = np.linalg.svd(basis, full_matrices=True)
    rank = int(np.sum(singular > _DETERMINED * singular.max(initial=0.0)))
    found = np.zeros((len(free), u.shape[0] - rank))
    found[free] = u[:, rank:]
    return found
