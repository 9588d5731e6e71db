"""Lever arms of the joints about a line of force, and their changes as the arm moves.

With n the unit vector of the force on the object and t = R90 n, with e and k the
vectors from the axes of joint 1 and joint 2 to the rigid tip,

- the lever arms a = (e × n, k × n) give the torques C = JᵀF = f a (8);
- b = (e · n, k · n) are the moves of the tip along t per angle.

Turning the joints by dq moves the tip by a·dq along n and b·dq along t, and
changes the arms by da1 = -b1 dq1 - b2 dq2, da2 = -b2 (dq1 + dq2); turning the
force by dφ changes them by b dφ. Everything follows from these four numbers, and, for a
gripper that does not give way along the force (`gripper.Skew`), from what it adds to the arms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.gripper import Gripper, Skew
from scara_kinetostatic.model.parameters import Parameters

_ISOTROPIC = Gripper().excess


class Arm(NamedTuple):
    """The arm at link angles Q*, seen along a force direction; all (n,).

    Attributes:
        ux: unit vector of link 1, x.
        uy: the same, y.
        vx: unit vector of link 2, x.
        vy: the same, y.
        nx: unit vector of the force on the object, x.
        ny: the same, y.
        a1: lever arm of joint 1, m.
        a2: lever arm of joint 2, m.
        b1: move of the tip along t per angle of joint 1, m.
        b2: the same of joint 2, m.
        lever1: lever arm of joint 1, gripper and all, m.
        lever2: the same of joint 2, m.
        turn1: what `lever1` loses per angle of joint 1, and gains as the force turns, m.
        turn2: the same of joint 2, m.
        skew: what the gripper adds where it does not give way along the force; None where it does.
        un: unit vector of link 1 along n.
        ut: the same along t.
        vn: unit vector of link 2 along n.
        vt: the same along t.
    """

    ux: Floats
    uy: Floats
    vx: Floats
    vy: Floats
    nx: Floats
    ny: Floats
    a1: Floats
    a2: Floats
    b1: Floats
    b2: Floats
    lever1: Floats
    lever2: Floats
    turn1: Floats
    turn2: Floats
    skew: Skew | None
    un: Floats
    ut: Floats
    vn: Floats
    vt: Floats


def view_arm(
    parameters: Parameters, link1: Floats, link2: Floats, magnitude: Floats, direction: Floats, gripper: Gripper
) -> Arm:
    """The arm seen along a force.

    Args:
        parameters: L̄.
        link1: link angle q1*, (n,), rad.
        link2: link angle q2*, (n,), rad.
        magnitude: f, (n,), N.
        direction: angle φ of the force on the object in the base frame, (n,), rad.
        gripper: the form of (7).

    Returns:
        Unit vectors, lever arms and their companions.
    """
    first = link1 + parameters.theta1
    second = first + link2 + parameters.theta2
    ux, uy, vx, vy = np.cos(first), np.sin(first), np.cos(second), np.sin(second)
    nx, ny = np.cos(direction), np.sin(direction)
    un, ut = ux * nx + uy * ny, uy * nx - ux * ny
    vn, vt = vx * nx + vy * ny, vy * nx - vx * ny
    a2, b2 = -parameters.l2 * vt, parameters.l2 * vn
    a1, b1 = a2 - parameters.l1 * ut, b2 + parameters.l1 * un
    skew = None if gripper.excess == _ISOTROPIC else gripper.skew(direction - second)
    if skew is None:
        return Arm(ux, uy, vx, vy, nx, ny, a1, a2, b1, b2, a1, a2, b1, b2, None, un, ut, vn, vt)
    aside, turn = magnitude * skew.tangent, magnitude * skew.tangent_turn
    levers = a1 - aside, a2 - aside, b1 - turn, b2 - turn
    return Arm(ux, uy, vx, vy, nx, ny, a1, a2, b1, b2, *levers, skew, un, ut, vn, vt)
