"""Derivatives of H, G, H̄ and Ḡ with respect to their arguments and to L̄, for the isotropic gripper.

Those of A(Q, L̄) are in `contact`. All follow from four blocks at the link angles Q*: J, H_L̄,
K = ∂(JᵀF)/∂Q* and ∂(JᵀF)/∂L̄. The sign of a torque counts as constant: on the edges of a
dead band the derivatives are one-sided.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics, kinetostatics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.gripper import Gripper
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
    torques = kinetostatics.joint_torques(parameters, links, force)
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
    _, force = kinetostatics.direct_kinetostatics(parameters, joints, torques, sign)
    links = np.asarray(joints, dtype=float) - kinetostatics.joint_deflection(parameters, torques)
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
