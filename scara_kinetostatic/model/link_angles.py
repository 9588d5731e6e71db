"""The joints brought to rest under a given force: the link angles and modes that go with measured joints."""

from __future__ import annotations

from typing import NamedTuple

from scara_kinetostatic.model.equations import joint_rows
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.state import State, next_modes
from scara_kinetostatic.model.statics import Arm, Floats, view_arm


class LinkAngles(NamedTuple):
    """A state and what was worked out on the way.

    Attributes:
        state: the state.
        arm: the arm there; None where nothing asked for it.
    """

    state: State
    arm: Arm | None


def solve_link_angles(
    parameters: Parameters,
    joints: Floats,
    state: State,
    gripper: Gripper,
    frozen: bool = False,
    again: bool = False,
) -> LinkAngles:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: where from; its force stays.
        gripper: the form of (7).
        frozen: whether every joint stays on its flank.
        again: whether to repeat it where a mode has changed.
    """
    moved = _step_links(parameters, joints, state, gripper)
    if frozen:
        return LinkAngles(moved, None)
    updated, arm = update_modes(parameters, joints, moved, gripper)
    if not again or ((updated.mode1 == state.mode1) & (updated.mode2 == state.mode2)).all():
        return LinkAngles(updated, arm)
    moved = _step_links(parameters, joints, updated, gripper, arm)
    return update_modes(parameters, joints, moved, gripper)


def update_modes(parameters: Parameters, joints: Floats, state: State, gripper: Gripper) -> LinkAngles:
    """The state with the modes it calls for."""
    arm = view_arm(parameters, *state[:4], gripper)
    return LinkAngles(next_modes(parameters, joints, state, arm), arm)


def _step_links(
    parameters: Parameters, joints: Floats, state: State, gripper: Gripper, arm: Arm | None = None
) -> State:
    r = joint_rows(parameters, joints, state, gripper, arm)
    return state._replace(
        link1=state.link1 - (r.i11 * r.row1 + r.i12 * r.row2), link2=state.link2 - (r.i21 * r.row1 + r.i22 * r.row2)
    )
