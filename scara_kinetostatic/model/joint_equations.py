"""The joints under a given force: the equations of law (6), their Jacobian, and the link angles that solve them."""

from __future__ import annotations

from typing import NamedTuple

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.contact_state import State, next_modes
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.lever_arms import Arm, view_arm
from scara_kinetostatic.model.parameters import Parameters


class Rows(NamedTuple):
    """The joints' rows at n touches; all (n,).

    Attributes:
        arm: the arm along the force.
        joints: the measured angles that they hold for, Q less what effects add, (n, 2), rad.
        row1: residual of joint 1's row.
        row2: the same of joint 2.
        w1: how strongly row 1 feels its lever arm: p f on a flank, 1 where the joint floats.
        w2: the same of row 2.
        on1: 1 where joint 1 rests on a flank, 0 where it floats.
        on2: the same of joint 2.
        i11: M⁻¹, by rows (i11, i12), (i21, i22).
        i12: see `i11`.
        i21: see `i11`.
        i22: see `i11`.
    """

    arm: Arm
    joints: Floats
    row1: Floats
    row2: Floats
    w1: Floats
    w2: Floats
    on1: Floats
    on2: Floats
    i11: Floats
    i12: Floats
    i21: Floats
    i22: Floats


def joint_rows(parameters: Parameters, joints: Floats, state: State, gripper: Gripper, arm: Arm | None = None) -> Rows:
    """The rows of (6) and (8) at a state, and M⁻¹; `arm` saves work where that of the state is known."""
    p, f = parameters, state.magnitude
    arm = view_arm(p, *state[:4], gripper) if arm is None else arm
    on1, on2 = state.mode1 * state.mode1, state.mode2 * state.mode2
    w1, w2 = on1 * (p.p1 * f) + (1.0 - on1), on2 * (p.p2 * f) + (1.0 - on2)
    row1 = w1 * arm.lever1 + on1 * (state.link1 - joints[:, 0]) + p.g1 * state.mode1
    row2 = w2 * arm.lever2 + on2 * (state.link2 - joints[:, 1]) + p.g2 * state.mode2
    m11, n12, n21 = on1 - w1 * arm.turn1, w1 * arm.turn2, w2 * arm.turn2
    m22 = on2 - n21
    inverse = 1.0 / (m11 * m22 - n12 * n21)
    i11, i12, i21, i22 = m22 * inverse, n12 * inverse, n21 * inverse, m11 * inverse
    return Rows(arm, joints, row1, row2, w1, w2, on1, on2, i11, i12, i21, i22)


class LinkAngles(NamedTuple):
    """A state and what was worked out on the way.

    Attributes:
        state: the state.
        arm: the arm there.
    """

    state: State
    arm: Arm


def solve_link_angles(
    parameters: Parameters,
    joints: Floats,
    state: State,
    gripper: Gripper,
    frozen: bool = False,
    again: bool = False,
    arm: Arm | None = None,
) -> LinkAngles:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: where from; its force stays.
        gripper: the form of (7).
        frozen: whether every joint stays on its flank.
        again: whether to repeat it where a mode has changed.
        arm: the arm at `state`, where it is known.
    """
    moved = _step_links(parameters, joints, state, gripper, arm)
    if frozen:
        return LinkAngles(moved, view_arm(parameters, *moved[:4], gripper))
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
