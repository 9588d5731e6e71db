"""H̄ and Ḡ of an arm with dead bands that are crossed continuously (`loading`): the poses that solve them.

- H̄: Q and F are given; Q* solves q* + p c + g s(c / b) + δ = q by Newton's method.
- Ḡ: S and F are given; Q* is the rigid inverse of S less what gripper and effects add: in closed form, or with effects
  by fixed-point iteration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.compensation.loading import Force, Law, Loading
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.effect_law import TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import inverse

_PASSES = 60
"""Steps at most; Newton's method needs three or four, with effects some more."""
_ROUNDING = 1e-12
"""Change of an angle or a place at which it is found, rad and m."""
_SOLVED = 1e-11
"""Change beyond which a pose has not been found, rad and m: nothing physical is like that."""


class Equilibrium(NamedTuple):
    """Poses that obey the law.

    Attributes:
        joints: Q, (n, 2), rad; NaN where the place is out of reach.
        tip: S, (n, 2), m; NaN where it was not found.
        loading: the arm there.
        state: the poses as effects take them; None without effects.
    """

    joints: Floats
    tip: Floats
    loading: Loading
    state: TouchState | None


def tip_under_load(law: Law, joints: Floats, force: Force, metadata: TouchMetadata) -> Equilibrium:
    """H̄.

    Args:
        law: of the arm.
        joints: Q, (n, 2), rad.
        force: on the object.
        metadata: of the poses.
    """
    p, effects = law.model.parameters, bool(law.model.effects)
    q1, q2 = np.ascontiguousarray(joints.T)
    first, second = q1 + p.theta1, q1 + p.theta1 + q2 + p.theta2
    turn, moved, state, change = np.zeros((2, len(q1))), np.zeros((len(q1), 2)), None, np.zeros(len(q1))
    for _ in range(_PASSES):
        at = law.loading(first, second, force)
        if effects:
            state = law.touch_state(joints, at, force, metadata)
            shift, moved = law.shift(state, force.place)
            turn = shift.T
        row1 = first - p.theta1 - q1 + p.p1 * at.c1 + p.g1 * at.s1 + turn[0]
        row2 = second - first - p.theta2 - q2 + p.p2 * at.c2 + p.g2 * at.s2 + turn[1]
        i11, i12, i21, i22 = inverse_of_rows(at, force)
        step1, step2 = i11 * row1 + i12 * row2, i21 * row1 + i22 * row2
        first, second = first - step1, second - step1 - step2
        change = np.maximum(np.abs(step1), np.abs(step2))
        if not (change > _ROUNDING).any():
            break
    at = law.loading(first, second, force)
    x, y = p.x0 + at.x1 + at.x2 + at.offset_x, p.y0 + at.y1 + at.y2 + at.offset_y
    tip = np.where((change < _SOLVED)[:, None], np.array([x, y]).T + moved, np.nan)
    return Equilibrium(joints, tip, at, state)


def inverse_of_rows(at: Loading, force: Force) -> tuple[Floats, Floats, Floats, Floats]:
    """M⁻¹ by rows, M = I + diag(k) ∂C/∂Q* at constant F; (n,) each."""
    c22 = -(force.x * at.x2 + force.y * at.y2)
    c11 = c22 - (force.x * at.x1 + force.y * at.y1)
    m11, m12, m21, m22 = 1.0 + at.k1 * c11, at.k1 * c22, at.k2 * c22, 1.0 + at.k2 * c22
    scale = 1.0 / (m11 * m22 - m12 * m21)
    return m22 * scale, -m12 * scale, -m21 * scale, m11 * scale


def joints_under_load(law: Law, tip: Floats, force: Force, posture: Indices, metadata: TouchMetadata) -> Equilibrium:
    """Ḡ.

    Args:
        law: of the arm.
        tip: S, (n, 2), m.
        force: on the object.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,).
        metadata: of the poses.
    """
    p = law.model.parameters
    once = not law.model.effects and law.gripper.isotropic
    compliance, backlash = np.array([[p.p1], [p.p2]]), np.array([[p.g1], [p.g2]])
    turn, moved, state = np.zeros((2, len(tip))), np.zeros((len(tip), 2)), None
    joints, offset = np.zeros((2, len(tip))), _offset(law, np.zeros(len(tip)), force)
    change: tuple[Floats, Floats] = (joints, offset)
    for _ in range(_PASSES):
        links = inverse(p, tip - offset.T - moved, posture).T
        first = links[0] + p.theta1
        at = law.loading(first, first + links[1] + p.theta2, force)
        found = links + compliance * np.array([at.c1, at.c2]) + backlash * np.array([at.s1, at.s2]) + turn
        added = np.array([at.offset_x, at.offset_y])
        change = np.abs(found - joints), np.abs(added - offset)
        joints, offset = found, added
        # where the place is out of reach it is not a number
        if once or not ((change[0] > _ROUNDING).any() or (change[1] > _ROUNDING).any()):
            break
        if law.model.effects:
            state = law.touch_state(joints.T, at, force, metadata)
            shift, moved = law.shift(state, force.place)
            turn = shift.T
    solved = once | ~((change[0] > _SOLVED) | (change[1] > _SOLVED)).any(axis=0)
    return Equilibrium(np.where(solved, joints, np.nan).T, tip, at, state)


def _offset(law: Law, second: Floats, force: Force) -> Floats:
    """S - H(Q*) by the gripper with link 2 at angles (n,), rad; (2, n), m."""
    at = law.loading(second, second, force)
    return np.array([at.offset_x, at.offset_y])
