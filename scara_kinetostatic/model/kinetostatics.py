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
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.effect_law import TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.gripper import Gripper, as_gripper
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch_equations import State, step_links


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
    """Torques C = JᵀF (2) (8), with J at the link angles Q*; exact zeros below 1e-13 of force times arm length.

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
    return np.where(np.abs(torques) <= 1e-13 * scale[..., None], 0.0, torques)


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
    model, gripper = as_model(model), as_gripper(gripper)
    parameters, place, load = model.parameters, np.asarray(tip, dtype=float), np.asarray(force, dtype=float)
    if model.effects:
        place, load = np.broadcast_arrays(np.atleast_2d(place), np.atleast_2d(load))

    def pose_with(turn: Floats | float, moved: Floats | float) -> Pose:
        links, torques = _held_links(parameters, place - moved, load, posture, gripper)
        return Pose(links + joint_deflection(parameters, torques, slack) + turn, links, torques, place, load)

    pose = _solve_pose(pose_with, model, metadata) if model.effects else pose_with(0.0, 0.0)
    return pose.joints, pose.torques


def _held_links(
    parameters: Parameters, tip: Floats, force: Floats, posture: ArrayLike, gripper: Gripper
) -> tuple[Floats, Floats]:
    """Q* and C of a robot that holds its tip at a place under a force, (n, 2) each."""
    offset = gripper.deflection(parameters, force, np.zeros(np.shape(tip)[:-1]))
    links = kinematics.inverse(parameters, tip - offset, posture)
    if gripper.isotropic:
        return links, joint_torques(parameters, links, force)
    for _ in range(8):  # each pass gains three digits or more
        offset = gripper.deflection(parameters, force, _link2_angle(parameters, links))
        links = kinematics.inverse(parameters, tip - offset, posture)
    return links, joint_torques(parameters, links, force, offset)


def direct_kinetostatics(
    model: ExtendedModel | Parameters,
    joints: Floats,
    force: Floats,
    gripper: Gripper | GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """H̄: the tip's place and the torques from what sensors measure, actuator angles and the force, by law (6).

    Where a link is nearly in line with a force that compresses it, law (6) has several solutions. Use of a calibration,
    where nothing may jump, is `tip`.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N; where it is zero the joints are in the middle of their dead
            bands.
        gripper: the form of (7); a bare sign is the isotropic gripper.
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`.

    Returns:
        S, (n, 2), m, and C, (n, 2), Nm.
    """
    model, gripper = as_model(model), as_gripper(gripper)
    parameters, pressed = model.parameters, np.any(force != 0, axis=1)[:, None]

    def pose_with(turn: Floats | float, moved: Floats | float) -> Pose:
        links = np.where(pressed, _links(parameters, joints - turn, force, gripper), joints - turn)
        with np.errstate(invalid='ignore'):
            offset = np.where(pressed, gripper.deflection(parameters, force, _link2_angle(parameters, links)), 0.0)
        torques = joint_torques(parameters, links, force, offset)
        return Pose(joints, links, torques, kinematics.forward(parameters, links) + offset + moved, force)

    pose = _solve_pose(pose_with, model, metadata) if model.effects else pose_with(0.0, 0.0)
    return pose.tip, pose.torques


def _links(parameters: Parameters, joints: Floats, force: Floats, gripper: Gripper) -> Floats:
    """Q* of joints under a force, (n, 2), by Newton's method.

    Where a link is nearly in line with a force that compresses it, the floating joint is unstable, and the flanks
    alternate from one start: then the others are tried.
    """
    links, settled = _links_from((1.0, 1.0), parameters, joints, force, gripper)
    wrong = np.flatnonzero(~settled)
    for start in ((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        if not len(wrong):
            break
        found, settled = _links_from(start, parameters, joints[wrong], force[wrong], gripper)
        links[wrong[settled]] = found[settled]
        wrong = wrong[~settled]
    return links


def _links_from(
    start: tuple[float, float], parameters: Parameters, joints: Floats, force: Floats, gripper: Gripper
) -> tuple[Floats, Mask]:
    """Q* from flanks to start on, (n, 2), and whether links and flanks agree, (n,)."""
    magnitude, direction = np.hypot(force[:, 0], force[:, 1]), np.arctan2(force[:, 1], force[:, 0])
    flanks = (np.full(len(joints), each) for each in start)
    state = State(joints[:, 0], joints[:, 1], magnitude, direction, *flanks)
    for _ in range(20):  # three or four suffice
        before, (state, arm) = state, step_links(parameters, joints, state, gripper)
        if ((state.mode1 != before.mode1) | (state.mode2 != before.mode2)).any():
            state, _ = step_links(parameters, joints, state, gripper, arm=arm)
        if not np.any(_change(state, before) > 1e-15):
            break
    further, _ = step_links(parameters, joints, state, gripper)
    settled = (_change(state, further) < 1e-12) & (state.mode1 == further.mode1) & (state.mode2 == further.mode2)
    return np.stack([state.link1, state.link2], axis=-1), np.asarray(settled)


def _change(one: State, other: State) -> Floats:
    """The larger change of both link angles, (n,), rad."""
    return np.asarray(np.maximum(np.abs(one.link1 - other.link1), np.abs(one.link2 - other.link2)))


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


def _solve_pose(
    pose_with: Callable[[Floats, Floats], Pose], model: ExtendedModel, metadata: TouchMetadata | None
) -> Pose:
    """The pose that agrees with what the effects do in it.

    Args:
        pose_with: the pose for given δ and d, (n, 2) each.
        model: the model, with effects.
        metadata: of the poses, as if they were touches; None where nothing is known.
    """
    turn = place = np.zeros(())
    for _ in range(60):
        pose = pose_with(turn, place)
        links = kinematics.link_vectors(model.parameters, pose.links)
        known = TouchMetadata.plain(len(pose.tip)) if metadata is None else metadata
        before = turn, place
        with np.errstate(invalid='ignore'):
            at = TouchState.of_poses(model.parameters, pose.joints, pose.force, pose.torques, links, pose.tip, known)
            turn, place = model.shift(at, robot_only=True)
        # where the place is out of reach it is not a number
        if not np.any(np.abs([turn - before[0], place - before[1]]) > 1e-15):
            break
    return pose_with(turn, place)


def loaded_tip_by_parameters(
    parameters: Parameters, tip: Floats, force: Floats, posture: ArrayLike, gripper: Gripper | GripperSign
) -> Floats:
    """∂S/∂L̄ at fixed Q and F of loaded poses, with the change of the torques; the gripper is isotropic.

    The sign of a torque counts as constant: on the edges of a dead band the derivatives are one-sided.

    Args:
        parameters: L̄.
        tip: S, (n, 2), m, within reach.
        force: F on the object, base frame, (n, 2), N; not zero.
        posture: +1 or -1, (n,) or one for all.
        gripper: the form of (7).

    Returns:
        (n, 2, 12), in the order of `NAMES`.
    """
    p, gripper = parameters, as_gripper(gripper)
    links, torques = _held_links(p, tip, force, posture, gripper)
    link1, link2 = kinematics.link_vectors(p, links)
    c2 = -(link2 * force).sum(axis=1)
    c1 = c2 - (link1 * force).sum(axis=1)
    rows = np.array([[1.0 + p.p1 * c1, p.p1 * c2], [p.p2 * c2, 1.0 + p.p2 * c2]]).transpose(2, 0, 1)
    turns = kinematics.jacobian(p, links) @ np.linalg.inv(rows)
    at = kinematics.LoadedJoints(
        slope=(p.p1, p.p2),
        moment=(_moment(link1, force) / p.l1, _moment(link2, force) / p.l2),
        torque=tuple(torques.T),
        sense=tuple(np.sign(torques).T),
    )
    unit = force / np.hypot(*force.T)[:, None]
    columns = [
        kinematics.component_by_parameters(
            (1.0 - k, k),
            (link1[:, k] / p.l1, link2[:, k] / p.l2),
            (turns[:, k, 0], turns[:, k, 1]),
            (gripper.factor * force[:, k], -unit[:, k]),
            at,
        )
        for k in (0, 1)
    ]
    return kinematics.stacked(columns, (len(force),)).transpose(2, 1, 0)
