"""The state of a touch: link angles, force, and the flank on which each joint rests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.lever_arms import Arm, view_arm
from scara_kinetostatic.model.parameters import Parameters

_MODE_SCALE = 1.0
"""Weight of lever arm against backlash in the choice of a mode, rad/m. Any positive value is right; with this one a
lever arm of a millimetre already outweighs a usual backlash, so that a flank gives way to the other one at once."""


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

    def select(self, which: Mask | Indices) -> State:
        """The touches that a mask or an array of positions picks."""
        return State(*(part[which] for part in self))

    def replace_where(self, where: Mask, other: State) -> State:
        """Another state's touches where a mask is true, this one's elsewhere; both of n touches."""
        return State(*(np.where(where, new, old) for new, old in zip(other, self, strict=True)))


def next_modes(parameters: Parameters, joints: Floats, state: State, arm: Arm) -> State:
    """The modes that the state calls for, by the rule of a primal-dual active set.

    The law of the backlash is β ∈ g Sign(a) with β = q - q* - p f a, that is: on a
    flank β = ±g and a has its sign; floating, a = 0 and |β| ≤ g. Which of the
    two holds follows from β + κ a for any κ > 0: outside [-g, g] it is on that flank.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: with any modes.
        arm: the arm at that state.

    Returns:
        The state with its modes renewed.
    """
    p, f = parameters, state.magnitude
    floats1 = joints[:, 0] - state.link1 + (_MODE_SCALE - p.p1 * f) * arm.lever1
    floats2 = joints[:, 1] - state.link2 + (_MODE_SCALE - p.p2 * f) * arm.lever2
    return state._replace(mode1=_mode(floats1, arm.lever1, p.g1), mode2=_mode(floats2, arm.lever2, p.g2))


def _mode(pointer: Floats, arm: Floats, backlash: float) -> Floats:
    if backlash <= 0:
        return np.where(arm < 0, -1.0, 1.0)
    return np.sign(pointer) * (np.abs(pointer) > backlash)


def free_state(parameters: Parameters, joints: Floats, centers: Floats) -> State:
    """A start for n touches: links at the measured angles, no force, pointing from tip to disc."""
    first = joints[:, 0] + parameters.theta1
    second = first + joints[:, 1] + parameters.theta2
    x = parameters.x0 + parameters.l1 * np.cos(first) + parameters.l2 * np.cos(second)
    y = parameters.y0 + parameters.l1 * np.sin(first) + parameters.l2 * np.sin(second)
    direction = np.arctan2(centers[:, 1] - y, centers[:, 0] - x)
    state = State(joints[:, 0], joints[:, 1], np.zeros(len(x)), direction, *np.ones((2, len(x))))
    arm = view_arm(parameters, *state[:4], Gripper())
    return state._replace(mode1=_mode(arm.a1, arm.a1, 0.0), mode2=_mode(arm.a2, arm.a2, 0.0))
