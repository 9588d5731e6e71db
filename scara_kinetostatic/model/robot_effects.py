"""Effects of the robot itself in H̄ and Ḡ: an angle at the joints, a displacement of the tip.

With effects (`extended_model`) the law of the joints (6) becomes q - q* = p c + g sign(c) + δ and the tip is at
S = H(Q*) + (S - S*) + d. What an effect does to the object or to the
force sensor is no part of H̄ and Ḡ. As δ and d depend on the pose itself, it is found by fixed-point iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_equations import ContactProblem
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper

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
