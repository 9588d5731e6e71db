"""The deformable robot: direct and inverse kinetostatics H̄ and Ḡ (4), from (6), (7) and (8).

sign(c) in (6) is set-valued at c = 0: inside its backlash the joint floats and
q - q* is anywhere in [-g, g]. Where a torque vanishes, `slack` in [-1, 1] says
where in the dead band the joint is, 0 being its middle.

The effects of an extended model that act on the robot itself are part of both (`robot_effects`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.gripper import Gripper, as_gripper
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.robot_effects import Pose, solve_pose

_TORQUE_ROUNDING = 1e-13
"""A torque below this part of force times arm length is rounding error: zero."""
_PASSES = 8
"""Fixed-point passes for a gripper that does not give way along the force; each gains three digits or more."""


def joint_deflection(parameters: Parameters, torques: ArrayLike, slack: ArrayLike = 0.0) -> Floats:
    """Law of the joints (6): q - q* = p c + g sign(c).

    Args:
        parameters: L̄.
        torques: C, (n, 2), Nm.
        slack: place in the dead band where a torque is zero, in [-1, 1].

    Returns:
        q - q*, (n, 2), rad.
    """
    torques = np.asarray(torques, dtype=float)
    sign = np.where(torques == 0, slack, np.sign(torques))
    compliance, backlash = np.array([parameters.p1, parameters.p2]), np.array([parameters.g1, parameters.g2])
    return compliance * torques + backlash * sign


def joint_torques(
    parameters: Parameters, links: ArrayLike, force: ArrayLike, offset: ArrayLike | None = None
) -> Floats:
    """Torques C = JᵀF (2) (8), with J at the link angles Q*; rounding error is made an exact zero.

    Args:
        parameters: L̄.
        links: Q*, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        offset: S - S*, (n, 2), m, where the force acts beside the rigid tip; its moment
            counts only if it is not along the force.

    Returns:
        C, (n, 2), Nm.
    """
    force = np.asarray(force, dtype=float)
    torques = np.einsum('...ij,...i->...j', kinematics.jacobian(parameters, links), force)
    if offset is not None:
        torques = torques + _moment(np.asarray(offset), force)[..., None]
    scale = (parameters.l1 + parameters.l2) * np.hypot(force[..., 0], force[..., 1])
    return np.where(np.abs(torques) <= _TORQUE_ROUNDING * scale[..., None], 0.0, torques)


def _moment(arm: Floats, force: Floats) -> Floats:
    return np.asarray(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])


def _link2_angle(parameters: Parameters, links: Floats) -> Floats:
    return np.asarray(links.sum(axis=-1) + parameters.theta1 + parameters.theta2)


def inverse_kinetostatics(
    model: ExtendedModel | Parameters,
    tip: ArrayLike,
    force: ArrayLike,
    posture: ArrayLike,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
    slack: ArrayLike = 0.0,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """Ḡ: the actuator angles and torques that hold a tip at a place under a force (4).

    Args:
        model: the extended model, or L̄ of the base model alone.
        tip: S, (n, 2), m.
        force: F on the object, base frame, (n, 2), N.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,) or one for all.
        gripper: the form of (7); a bare sign is the isotropic gripper.
        slack: place in the dead band where a torque is zero, in [-1, 1].
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`. Effects on the object
            are no part of this.

    Returns:
        Q, (n, 2), rad, NaN where the place is out of reach, and C, (n, 2), Nm.
    """
    model = as_model(model)
    parameters = model.parameters
    gripper, tip, force = as_gripper(gripper), np.asarray(tip, dtype=float), np.asarray(force, dtype=float)
    if not model.effects:
        links, torques = _held_links(parameters, tip, force, posture, gripper)
        return links + joint_deflection(parameters, torques, slack), torques
    tip, force = np.broadcast_arrays(np.atleast_2d(tip), np.atleast_2d(force))

    def pose_with(turn: Floats, place: Floats) -> Pose:
        links, torques = _held_links(parameters, tip - place, force, posture, gripper)
        return Pose(links + joint_deflection(parameters, torques, slack) + turn, links, torques, tip, force)

    pose = solve_pose(pose_with, model, len(tip), gripper, metadata)
    return pose.joints, pose.torques


def _held_links(
    parameters: Parameters, tip: Floats, force: Floats, posture: ArrayLike, gripper: Gripper
) -> tuple[Floats, Floats]:
    """Q* and C of a robot that holds its tip at a place under a force, (n, 2) each."""
    offset = gripper.deflection(parameters, force, np.zeros(np.shape(tip)[:-1]))
    links = kinematics.inverse(parameters, tip - offset, posture)
    if gripper.isotropic:
        return links, joint_torques(parameters, links, force)
    for _ in range(_PASSES):
        offset = gripper.deflection(parameters, force, _link2_angle(parameters, links))
        links = kinematics.inverse(parameters, tip - offset, posture)
    return links, joint_torques(parameters, links, force, offset)


def direct_kinetostatics(
    model: ExtendedModel | Parameters,
    joints: ArrayLike,
    torques: ArrayLike,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
    slack: ArrayLike = 0.0,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """H̄: the tip's place and the force from actuator angles and torques (4).

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        torques: C, (n, 2), Nm.
        gripper: the form of (7); a bare sign is the isotropic gripper.
        slack: place in the dead band where a torque is zero, in [-1, 1].
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`. Effects on the object
            are no part of this.

    Returns:
        S, (n, 2), m, and F on the object in the base frame, (n, 2), N; not finite
        where the arm is exactly stretched or folded and J has no inverse.
    """
    model = as_model(model)
    parameters = model.parameters
    gripper, joints, torques = as_gripper(gripper), np.asarray(joints, dtype=float), np.asarray(torques, dtype=float)
    links = joints - joint_deflection(parameters, torques, slack)
    if not model.effects:
        return _exerted(parameters, links, torques, gripper)
    joints, torques, links = (np.atleast_2d(part) for part in np.broadcast_arrays(joints, torques, links))

    def pose_with(turn: Floats, place: Floats) -> Pose:
        tip, force = _exerted(parameters, links - turn, torques, gripper)
        return Pose(joints, links - turn, torques, tip + place, force)

    pose = solve_pose(pose_with, model, len(joints), gripper, metadata)
    return pose.tip, pose.force


def _exerted(parameters: Parameters, links: Floats, torques: Floats, gripper: Gripper) -> tuple[Floats, Floats]:
    """S and F of a robot under torques, (n, 2) each."""
    link1, link2 = kinematics.link_vectors(parameters, links)
    # F = J⁻ᵀ C: the torques fix F's moment about both axes, hence along both links
    moment1, moment2 = torques[..., 0] - torques[..., 1], torques[..., 1]
    with np.errstate(divide='ignore', invalid='ignore'):
        area = link1[..., 0] * link2[..., 1] - link1[..., 1] * link2[..., 0]
        force = (link2 * moment1[..., None] - link1 * moment2[..., None]) / area[..., None]
        link2_angle = _link2_angle(parameters, links)
        offset = gripper.deflection(parameters, force, link2_angle)
        for _ in range(0 if gripper.isotropic else _PASSES):
            # the force acts beside the rigid tip: what its offset adds to both torques is not JᵀF
            moment2 = torques[..., 1] - _moment(offset, force)
            force = (link2 * moment1[..., None] - link1 * moment2[..., None]) / area[..., None]
            offset = gripper.deflection(parameters, force, link2_angle)
    return link1 + link2 + (parameters.x0, parameters.y0) + offset, force
