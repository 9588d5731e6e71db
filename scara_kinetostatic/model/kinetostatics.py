"""The deformable robot: direct and inverse kinetostatics H̄ and Ḡ (4), from (6), (7) and (8), and their derivatives.

sign(c) in (6) is set-valued at c = 0: inside its backlash the joint floats and
q - q* is anywhere in [-g, g]. Where a torque vanishes, `slack` in [-1, 1] says
where in the dead band the joint is, 0 being its middle.

**Effects.** With effects (`extended_model`) the law of the joints (6) becomes q - q* = p c + g sign(c) + δ and the tip
is at S = H(Q*) + (S - S*) + d. What an effect does to the object or to the force sensor is no part of H̄ and Ḡ. As δ
and d depend on the pose itself, it is found by fixed-point iteration.

**Derivatives** with respect to the arguments and to L̄ are those of the isotropic gripper. They follow from four blocks
at the link angles Q*: J, H_L̄, K = ∂(JᵀF)/∂Q* and ∂(JᵀF)/∂L̄. The sign of a torque counts as constant: on the edges of
a dead band the derivatives are one-sided.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.contact import ContactProblem
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.gripper import Gripper, as_gripper
from scara_kinetostatic.model.kinematics import quarter_turn
from scara_kinetostatic.model.parameters import (
    G1,
    G2,
    G_EE,
    L1,
    L2,
    NAMES,
    P1,
    P2,
    P_EE,
    THETA1,
    THETA2,
    X0,
    Y0,
    Parameters,
)
from scara_kinetostatic.model.touch_equations import State

_DISC_RADIUS = 0.1
"""Radius of the disc that effects are given as the touched one, m; the tip touches it along the force."""
_PASSES = 60
_ROUNDING = 1e-15
"""Change of δ and d at which they are found, rad and m."""


class Pose(NamedTuple):
    """The robot in n poses; all (n, 2).

    Attributes:
        joints: Q, rad.
        links: Q*, rad.
        torques: C, Nm.
        tip: S, m.
        force: F on the object, base frame, N.
    """

    joints: Floats
    links: Floats
    torques: Floats
    tip: Floats
    force: Floats


def _shift_at(model: ExtendedModel, pose: Pose, gripper: Gripper, metadata: TouchMetadata) -> tuple[Floats, Floats]:
    """δ, (n, 2), rad, and d, (n, 2), m, of the robot's own effects in n poses; the joints on the flanks of C."""
    magnitude, direction = np.hypot(*pose.force.T), np.arctan2(pose.force[:, 1], pose.force[:, 0])
    normal = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    centers, radii = pose.tip + _DISC_RADIUS * normal, np.full(len(magnitude), _DISC_RADIUS)
    link1, link2 = pose.links.T
    mode1, mode2 = np.sign(pose.torques).T
    state = State(link1, link2, magnitude, direction, mode1, mode2)
    contact_problem = ContactProblem(pose.joints, centers, radii, gripper, metadata)
    with np.errstate(invalid='ignore'):
        return model.shift(contact_problem.touch_state(model.parameters, state), robot_only=True)


def solve_pose(
    pose_with: Callable[[Floats, Floats], Pose],
    model: ExtendedModel,
    n: int,
    gripper: Gripper,
    metadata: TouchMetadata | None,
) -> Pose:
    """The pose that agrees with what the effects do in it.

    Args:
        pose_with: the pose for given δ and d, (n, 2) each.
        model: the model, with effects.
        n: number of poses.
        gripper: the form of (7).
        metadata: of the poses, as if they were touches; None where nothing is known.
    """
    metadata = TouchMetadata.plain(n) if metadata is None else metadata
    turn, place = np.zeros((n, 2)), np.zeros((n, 2))
    for _ in range(_PASSES):
        pose = pose_with(turn, place)
        before = turn, place
        turn, place = _shift_at(model, pose, gripper, metadata)
        change = np.abs([turn - before[0], place - before[1]])
        if not np.any(change > _ROUNDING):  # where the place is out of reach it is not a number
            break
    return pose_with(turn, place)


_TORQUE_ROUNDING = 1e-13
"""A torque below this part of force times arm length is rounding error: zero."""
_PASSES_KINETOSTATICS = 8
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
    for _ in range(_PASSES_KINETOSTATICS):
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
        for _ in range(0 if gripper.isotropic else _PASSES_KINETOSTATICS):
            # the force acts beside the rigid tip: what its offset adds to both torques is not JᵀF
            moment2 = torques[..., 1] - _moment(offset, force)
            force = (link2 * moment1[..., None] - link1 * moment2[..., None]) / area[..., None]
            offset = gripper.deflection(parameters, force, link2_angle)
    return link1 + link2 + (parameters.x0, parameters.y0) + offset, force


class Derivatives(NamedTuple):
    """Derivatives of one quantity with respect to two arguments and L̄.

    Attributes:
        first: by the first argument of the function, (n, 2, 2).
        second: by the second, (n, 2, 2).
        parameters: by L̄ in the order of `NAMES`, (n, 2, 12).
    """

    first: Floats
    second: Floats
    parameters: Floats


def forward_by_parameters(parameters: Parameters, joints: ArrayLike) -> Floats:
    """∂H/∂L̄ at link angles (n, 2), rad: (n, 2, 12). By the joints it is J, `kinematics.jacobian`."""
    jacobian = kinematics.jacobian(parameters, joints)
    link1, link2 = kinematics.link_vectors(parameters, joints)
    out = np.zeros((*jacobian.shape[:-1], len(NAMES)))
    out[..., 0, X0] = out[..., 1, Y0] = 1.0
    out[..., THETA1], out[..., THETA2] = jacobian[..., 0], jacobian[..., 1]
    out[..., L1], out[..., L2] = link1 / parameters.l1, link2 / parameters.l2
    return out


def inverse_derivatives(parameters: Parameters, joints: ArrayLike) -> tuple[Floats, Floats]:
    """Derivatives of G at the link angles (n, 2), rad, that it gave: by S*, (n, 2, 2), and by L̄, (n, 2, 12)."""
    by_tip = np.asarray(np.linalg.inv(kinematics.jacobian(parameters, joints)), dtype=float)
    return by_tip, -by_tip @ forward_by_parameters(parameters, joints)


def _torque_blocks(parameters: Parameters, links: Floats, force: Floats) -> tuple[Floats, Floats]:
    """K = ∂(JᵀF)/∂Q*, (n, 2, 2), and ∂(JᵀF)/∂L̄, (n, 2, 12), F held."""
    link1, link2 = kinematics.link_vectors(parameters, links)
    both, second = ((link1 + link2) * force).sum(-1), (link2 * force).sum(-1)
    stiffness = -np.stack([np.stack([both, second], -1), np.stack([second, second], -1)], -2)
    by_parameters = np.zeros((len(links), 2, len(NAMES)))
    by_parameters[:, :, THETA1], by_parameters[:, :, THETA2] = stiffness[:, :, 0], stiffness[:, :, 1]
    by_parameters[:, 0, L1] = (quarter_turn(link1) * force).sum(-1) / parameters.l1
    by_parameters[:, :, L2] = ((quarter_turn(link2) * force).sum(-1) / parameters.l2)[:, None]
    return stiffness, by_parameters


def _gripper_blocks(parameters: Parameters, force: Floats, sign: GripperSign) -> tuple[Floats, Floats]:
    """Derivatives of S - S* (7) by F, (n, 2, 2), and by L̄, (n, 2, 12); those of a loaded gripper."""
    magnitude = np.hypot(force[:, 0], force[:, 1])[:, None]
    unit = force / magnitude
    slope = 1.0 if sign is GripperSign.PAPER else -1.0
    across = np.eye(2) - unit[:, :, None] * unit[:, None, :]
    by_force = slope * parameters.p_ee * np.eye(2) - parameters.g_ee * across / magnitude[:, :, None]
    by_parameters = np.zeros((len(force), 2, len(NAMES)))
    by_parameters[:, :, P_EE], by_parameters[:, :, G_EE] = slope * force, -unit
    return by_force, by_parameters


def _law_by_parameters(torques: Floats) -> Floats:
    """Derivative of q - q* = p c + g sign(c) (6) by L̄, torques held, (n, 2, 12)."""
    out = np.zeros((len(torques), 2, len(NAMES)))
    out[:, 0, P1], out[:, 1, P2] = torques.T
    out[:, 0, G1], out[:, 1, G2] = np.sign(torques).T
    return out


def inverse_kinetostatics_derivatives(
    parameters: Parameters,
    tip: ArrayLike,
    force: ArrayLike,
    posture: ArrayLike,
    sign: GripperSign = GripperSign.PHYSICAL,
) -> tuple[Derivatives, Derivatives]:
    """Derivatives of Ḡ (4) at loaded poses within reach.

    Args:
        parameters: L̄.
        tip: S, (n, 2), m.
        force: F on the object, base frame, (n, 2), N; not zero.
        posture: +1 or -1, (n,) or one for all.
        sign: sign of (7) of the isotropic gripper.

    Returns:
        Those of Q and those of C, each by S, by F and by L̄.
    """
    force = np.asarray(force, dtype=float)
    rigid = np.asarray(tip, dtype=float) - Gripper(sign).deflection(parameters, force, np.zeros(len(force)))
    links = kinematics.inverse(parameters, rigid, posture)
    torques = joint_torques(parameters, links, force)
    by_tip, links_by_parameters = inverse_derivatives(parameters, links)
    gripper_by_force, gripper_by_parameters = _gripper_blocks(parameters, force, sign)
    stiffness, torques_by_parameters = _torque_blocks(parameters, links, force)
    jacobian_t = np.swapaxes(kinematics.jacobian(parameters, links), 1, 2)
    link = Derivatives(by_tip, -by_tip @ gripper_by_force, links_by_parameters - by_tip @ gripper_by_parameters)
    torque = Derivatives(
        stiffness @ link.first,
        stiffness @ link.second + jacobian_t,
        stiffness @ link.parameters + torques_by_parameters,
    )
    compliance = np.diag([parameters.p1, parameters.p2])
    joint = Derivatives(*(a + compliance @ b for a, b in zip(link, torque, strict=True)))
    return joint._replace(parameters=joint.parameters + _law_by_parameters(torques)), torque


def direct_kinetostatics_derivatives(
    parameters: Parameters,
    joints: ArrayLike,
    torques: ArrayLike,
    sign: GripperSign = GripperSign.PHYSICAL,
) -> tuple[Derivatives, Derivatives]:
    """Derivatives of H̄ (4) at loaded, regular poses.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        torques: C, (n, 2), Nm; not both zero.
        sign: sign of (7) of the isotropic gripper.

    Returns:
        Those of S and those of F, each by Q, by C and by L̄.
    """
    torques = np.asarray(torques, dtype=float)
    _, force = direct_kinetostatics(parameters, joints, torques, sign)
    links = np.asarray(joints, dtype=float) - joint_deflection(parameters, torques)
    jacobian = kinematics.jacobian(parameters, links)
    stiffness, torques_by_parameters = _torque_blocks(parameters, links, force)
    gripper_by_force, gripper_by_parameters = _gripper_blocks(parameters, force, sign)
    n = len(links)
    link = Derivatives(
        np.broadcast_to(np.eye(2), (n, 2, 2)),
        np.broadcast_to(-np.diag([parameters.p1, parameters.p2]), (n, 2, 2)),
        -_law_by_parameters(torques),
    )
    to_force = np.linalg.inv(np.swapaxes(jacobian, 1, 2))
    by_force = Derivatives(
        -to_force @ stiffness @ link.first,
        to_force @ (np.eye(2) - stiffness @ link.second),
        -to_force @ (stiffness @ link.parameters + torques_by_parameters),
    )
    tip = Derivatives(*(jacobian @ a + gripper_by_force @ b for a, b in zip(link, by_force, strict=True)))
    rigid = forward_by_parameters(parameters, links) + gripper_by_parameters
    return tip._replace(parameters=tip.parameters + rigid), by_force
