"""H̄ of a model from what sensors measure, by law (6) as it stands; and what the touches do not determine.

Where a link is nearly in line with a force that compresses it, law (6) has several solutions. Use of a calibration,
where nothing may jump, is `model.arm`.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.kinetostatics import Pose, joint_torques, solve_pose
from scara_kinetostatic.model.touch_equations import State, solve_link_angles

_PASSES = 20
"""Newton steps to the link angles at most; three or four suffice."""
_ROUNDING = 1e-15
"""Change of the link angles at which they are found, rad."""
_SETTLED = 1e-12
"""Change of the link angles by one more step that is only rounding, rad."""
_STARTS = ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
"""Flanks of both joints from which the link angles are sought, in turn."""


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
