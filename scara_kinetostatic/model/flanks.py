"""The arm seen along the force, and the flank of its backlash on which each joint rests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Complexes, Floats, Mask, unit_vectors
from scara_kinetostatic.model.gravity import pull_of
from scara_kinetostatic.model.parameters import MILLI, Parameters


class Arm(NamedTuple):
    """The arm at link angles Q*, seen along a force direction; (n,), of both links or joints (2, n).

    Attributes:
        link1: unit vector of link 1, base frame, complex.
        link2: the same of link 2.
        normal: unit vector of the force on the object, base frame, complex.
        links: unit vectors of the links seen along the force, complex.
        reach: vectors from the axes of the joints to the rigid tip seen along the force, complex, m.
        lever: lever arms a, m.
        turn: b, what `lever` loses per angle of its joint, and gains as the force turns, m.
    """

    link1: Complexes
    link2: Complexes
    normal: Complexes
    links: Complexes
    reach: Complexes
    lever: Floats
    turn: Floats


class State(NamedTuple):
    """State of n touches; all (n,).

    Attributes:
        link1: q1*, rad.
        link2: q2*, rad.
        magnitude: f, N; negative where the tip pulls (the continuation).
        direction: φ, angle of the force on the object in the base frame, rad.
        mode1: +1 or -1, the flank joint 1 rests on; 0 where it floats.
        mode2: the same of joint 2.
    """

    link1: Floats
    link2: Floats
    magnitude: Floats
    direction: Floats
    mode1: Floats
    mode2: Floats

    def replace_where(self, where: Mask, other: State) -> State:
        """Another state's touches where a mask is true, this one's elsewhere; both of n touches."""
        return State(*(np.where(where, new, old) for new, old in zip(other, self, strict=True)))


def view_arm(parameters: Parameters, state: State) -> Arm:
    """The arm seen along the force at a state; magnitude and modes do not count."""
    first = state.link1 + parameters.theta1
    second = first + state.link2 + parameters.theta2
    units = unit_vectors(np.array([first, second, state.direction]))
    links = units[:2] * units[2].conj()
    outer = parameters.l2 * links[1]
    reach = np.array([parameters.l1 * links[0] + outer, outer])
    return Arm(units[0], units[1], units[2], links, reach, -reach.imag, reach.real)


def next_modes(parameters: Parameters, joints: Floats, state: State, arm: Arm) -> State:
    """The modes that the state calls for, by the rule of a primal-dual active set.

    The law of the backlash is β ∈ g Sign(a) with β = q - q* - p f a, that is: on a
    flank β = ±g and a has its sign; floating, a = 0 and |β| ≤ g. Which of the
    two holds follows from β + κ a for any κ > 0: outside [-g, g] it is on that flank. With κ = 1 rad/m a lever arm of
    a millimetre already outweighs a usual backlash, so that a flank gives way to the other one at once. Where the
    force points away from the joint's axis, a floating joint is unstable, and the sign of a decides.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: with any modes.
        arm: the arm at that state.

    Returns:
        The state with its modes renewed.
    """
    compliance, backlash = parameters.joint_compliances, parameters.joint_backlashes
    per_arm = np.where(arm.reach.real > 0, 1e6, 1.0)  # κ
    pointer = joints.T - np.array(state[:2]) + (per_arm - compliance * state.magnitude) * arm.lever
    pointer = np.where(backlash <= 0, arm.lever, pointer)
    if (pull := pull_of(parameters, arm.link1, arm.link2)) is not None:
        torque = np.abs(state.magnitude) * arm.lever + pull.torque  # C, which f < 0 continues
        beyond = compliance * (state.magnitude * arm.lever + pull.torque)
        pointer = np.where(backlash <= 0, torque, joints.T - np.array(state[:2]) - beyond + torque)
    mode1, mode2 = np.copysign(np.abs(pointer) >= backlash, pointer)
    return state._replace(mode1=mode1, mode2=mode2)


LEAST_FORCE = MILLI
"""N; a smaller one leaves a joint within its backlash where gravity pulls it."""
SMALL_TORQUE, SMALL_DEFLECTION = 0.25, 1e-4
"""Part of the largest torque of gravity, and deflection by compliance, rad, below both of which the sign of a torque is
not known: the moments are not, as touches show them by the deflection."""


def keep_flanks(parameters: Parameters, state: State, before: State, arm: Arm, *, wide: bool = False) -> State:
    """The flanks of before wherever a torque is too small for its sign to be known; only under gravity.

    Elsewhere C = f a has the sign of a lever arm, which is known better than the static moments are.
    """
    pull = pull_of(parameters, arm.link1, arm.link2)
    if pull is None:
        return state
    small = has_no_sure_sign(parameters, state.magnitude * arm.lever + pull.torque, wide=wide)
    mode1, mode2 = np.where(small, before[4:], state[4:])
    return state._replace(mode1=mode1, mode2=mode2)


def has_no_sure_sign(parameters: Parameters, torque: Floats, *, wide: bool = False) -> Mask:
    """Which torques (2, n), Nm, are too small for their sign to be known under gravity.

    A joint on the wrong flank looks like other moments that deflect it by the gap, 2 g: with `wide`, those may be.
    """
    largest, torque = (abs(parameters.s1) + abs(parameters.s2)) * np.hypot(*parameters.gravity), np.abs(torque)
    deflection = SMALL_DEFLECTION + 2 * np.abs(parameters.joint_backlashes) * wide
    small = (torque < SMALL_TORQUE * largest) & (parameters.joint_compliances * torque < deflection)
    return np.asarray(small)
