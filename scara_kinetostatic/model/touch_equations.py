"""The equations of one touch and their derivatives: everything else is built on these.

A touch is a state (Q*, f, φ): link angles, force magnitude, force direction. With
n = (cos φ, sin φ) the force on the object is F = f n, and the state obeys

    rows:  q_i* + p_i f a_i + g_i s_i - q_i = 0,   s_i = sign(a_i)   (6), (8)
    circle: H(Q*) + (r + γ(f)) n - S_c = 0                            (5), (7), (11)

The second, a vector in metres, is both conditions of (11) at once: along n, the tip
lies on the circle; along t = R90 n, the force is radial. For f > 0, sign(a) is
sign(c); keeping sign(a) for f < 0 continues the contact smoothly into tension.

**Dead band.** sign(a) is set-valued at a = 0. There the joint floats (mode 0): its row
becomes a_i = 0, the force line passes through the joint's axis, and q_i no
longer matters as long as the joint stays inside its backlash. The modes are found as
in a complementarity problem, see `contact_state.next_modes`.

**Elimination.** The rows fix Q*. With M = ∂rows/∂Q* and A = [a; b] (see `lever_arms`), G = A M⁻¹,
the circle's residual h and its derivatives with respect to the measured quantities and to L̄ are

    h = circle - G rows,   h_z = circle_z - G rows_z.

The measured angle q_i and the offset theta_i enter alike: h_theta = h_q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.effect_law import TouchState
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.joint_equations import Rows, joint_rows
from scara_kinetostatic.model.lever_arms import Arm
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


class Equations(NamedTuple):
    """Residuals of n touches and what the derivatives are made of; all (n,).

    Attributes:
        rows: the joints' rows.
        normal: h along n, m.
        tangent: h along t, m.
        g11: G, by rows (g11, g12) along n, (g21, g22) along t, m/rad.
        g12: see `g11`.
        g21: see `g11`.
        g22: see `g11`.
        row1_f: ∂row1/∂f.
        row2_f: ∂row2/∂f.
        row1_d: ∂row1/∂φ.
        row2_d: ∂row2/∂φ.
        normal_f: ∂h/∂f along n, m/N.
        tangent_f: ∂h/∂f along t, m/N.
        normal_d: ∂h/∂φ along n, m/rad.
        tangent_d: ∂h/∂φ along t, m/rad.
        touch_state: the touches as effects take them; None for the base model.
    """

    rows: Rows
    normal: Floats
    tangent: Floats
    g11: Floats
    g12: Floats
    g21: Floats
    g22: Floats
    row1_f: Floats
    row2_f: Floats
    row1_d: Floats
    row2_d: Floats
    normal_f: Floats
    tangent_f: Floats
    normal_d: Floats
    tangent_d: Floats
    touch_state: TouchState | None = None


def touch_equations(
    parameters: Parameters,
    joints: Floats,
    centers: Floats,
    radii: Floats,
    state: State,
    gripper: Gripper,
    arm: Arm | None = None,
) -> Equations:
    """The equations of n touches at a state.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        state: where to evaluate.
        gripper: the form of (7).
        arm: that of the state, where it is known.

    Returns:
        Residuals and derivatives, to first order exact wherever the rows hold.
    """
    p, r = parameters, joint_rows(parameters, joints, state, gripper, arm)
    arm, (normal, tangent, a1, a2, by_f, by_d) = r.arm, _circle(p, centers, radii, state, r.arm, gripper)
    g11, g12 = a1 * r.i11 + a2 * r.i21, a1 * r.i12 + a2 * r.i22
    g21, g22 = arm.turn1 * r.i11 + arm.turn2 * r.i21, arm.turn1 * r.i12 + arm.turn2 * r.i22
    row1_f, row2_f = p.p1 * r.on1 * arm.lever1, p.p2 * r.on2 * arm.lever2
    if arm.skew is not None:
        row1_f, row2_f = row1_f - r.w1 * arm.skew.tangent, row2_f - r.w2 * arm.skew.tangent
    row1_d, row2_d = r.w1 * arm.turn1, r.w2 * arm.turn2
    return Equations(
        rows=r,
        normal=normal - g11 * r.row1 - g12 * r.row2,
        tangent=tangent - g21 * r.row1 - g22 * r.row2,
        g11=g11,
        g12=g12,
        g21=g21,
        g22=g22,
        row1_f=row1_f,
        row2_f=row2_f,
        row1_d=row1_d,
        row2_d=row2_d,
        normal_f=by_f[0] - g11 * row1_f - g12 * row2_f,
        tangent_f=by_f[1] - g21 * row1_f - g22 * row2_f,
        normal_d=by_d[0] - g11 * row1_d - g12 * row2_d,
        tangent_d=by_d[1] - g21 * row1_d - g22 * row2_d,
    )


class _Circle(NamedTuple):
    """H(Q*) + (S - S*) + r n - S_c along n and t, and what it becomes with Q*, f and φ."""

    normal: Floats
    tangent: Floats
    normal_1: Floats
    normal_2: Floats
    by_f: tuple[Floats | float, Floats | float]
    by_d: tuple[Floats | float, Floats]


def _circle(p: Parameters, centers: Floats, radii: Floats, state: State, arm: Arm, gripper: Gripper) -> _Circle:
    f = state.magnitude
    reach = radii + gripper.stretch(p, f)
    cx, cy = p.x0 - centers[:, 0], p.y0 - centers[:, 1]
    normal = arm.b1 + cx * arm.nx + cy * arm.ny + reach
    tangent = -arm.a1 - cx * arm.ny + cy * arm.nx
    slope, skew = gripper.slope(p), arm.skew
    if skew is None:
        return _Circle(normal, tangent, arm.a1, arm.a2, (slope, 0.0), (0.0, reach))
    return _Circle(
        normal + f * skew.normal,
        tangent + f * skew.tangent,
        arm.a1 - f * skew.normal_turn,
        arm.a2 - f * skew.normal_turn,
        (slope + skew.normal, skew.tangent),
        (f * (skew.normal_turn - skew.tangent), reach + f * (skew.tangent_turn + skew.normal)),
    )


def parameter_derivative(state: State, equations: Equations, gripper: Gripper) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held.

    Returns:
        (n, 2, 12): along n and t, by the parameters in the order of `NAMES`.
    """
    e, r, f = equations, equations.rows, state.magnitude
    arm = r.arm
    torque1, torque2 = f * arm.lever1 * r.on1, f * arm.lever2 * r.on2
    out = np.empty((len(NAMES), 2, len(f)))
    normal = out[:, 0], arm.nx, arm.ny, arm.un, arm.vn, e.g11, e.g12
    tangent = out[:, 1], -arm.ny, arm.nx, arm.ut, arm.vt, e.g21, e.g22
    for row, x, y, along1, along2, g_1, g_2 in (normal, tangent):
        w_1 = g_1 * r.w1
        row[X0], row[Y0] = x, y
        row[THETA1], row[THETA2] = g_1 * r.on1, g_2 * r.on2
        row[L1], row[L2] = along1 + w_1 * arm.ut, along2 + (w_1 + g_2 * r.w2) * arm.vt
        row[P1], row[P2] = -g_1 * torque1, -g_2 * torque2
        row[G1], row[G2] = -g_1 * state.mode1, -g_2 * state.mode2
    out[P_EE, 0], out[P_EE, 1] = gripper.factor * f, 0.0
    out[G_EE, 0], out[G_EE, 1] = -1.0, 0.0
    return out.transpose(2, 1, 0)


def excess_derivative(state: State, equations: Equations, gripper: Gripper) -> Floats:
    """∂h/∂E of n touches, f and φ held: by the entries 11, 12, 21, 22 of the gripper's excess, (n, 2, 4)."""
    e, r = equations, equations.rows
    arm, push = r.arm, gripper.factor * state.magnitude
    n = np.stack([arm.nx * arm.vx + arm.ny * arm.vy, arm.ny * arm.vx - arm.nx * arm.vy])  # in the frame of link 2
    t = np.stack([-n[1], n[0]])
    normal = push * n[:, None] * n[None, :]
    tangent = push * t[:, None] * n[None, :]
    normal_h = normal + (e.g11 * r.w1 + e.g12 * r.w2) * tangent
    tangent_h = tangent + (e.g21 * r.w1 + e.g22 * r.w2) * tangent
    return np.moveaxis(np.stack([normal_h.reshape(4, -1), tangent_h.reshape(4, -1)]), -1, 0)


def move_links(equations: Equations, state: State, change_f: Floats, change_d: Floats) -> State:
    """One Newton step of the rows: the link angles that go with a change of f and φ."""
    e, r = equations, equations.rows
    left1 = r.row1 + e.row1_f * change_f + e.row1_d * change_d
    left2 = r.row2 + e.row2_f * change_f + e.row2_d * change_d
    return state._replace(
        link1=state.link1 - (r.i11 * left1 + r.i12 * left2),
        link2=state.link2 - (r.i21 * left1 + r.i22 * left2),
        magnitude=state.magnitude + change_f,
        direction=state.direction + change_d,
    )
