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
in a complementarity problem, see `next_modes`.

**Elimination.** The rows fix Q*. With M = ∂rows/∂Q* and A = [a; b] (see `statics`), G = A M⁻¹,
the circle's residual h and its derivatives with respect to the measured quantities and to L̄ are

    h = circle - G rows,   h_z = circle_z - G rows_z.

The measured angle q_i and the offset theta_i enter alike: h_theta = h_q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.statics import Arm, Floats, gripper_slope, gripper_stretch, view_arm

MODE_SCALE = 1e-2
"""Weight of lever arm against backlash in the choice of a mode, rad/m; any positive value is right."""


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

    def select(self, which: NDArray[np.bool_]) -> State:
        """The touches that a mask picks."""
        return State(*(part[which] for part in self))

    def replace_where(self, where: NDArray[np.bool_], other: State) -> State:
        """Another state's touches where a mask is true, this one's elsewhere; both of n touches."""
        return State(*(np.where(where, new, old) for new, old in zip(other, self, strict=True)))


class Equations(NamedTuple):
    """Residuals of n touches and what the derivatives are made of; all (n,).

    Attributes:
        arm: the arm along the force.
        normal: h along n, m.
        tangent: h along t, m.
        row1: residual of joint 1's row.
        row2: the same of joint 2.
        i11: M⁻¹, by rows (i11, i12), (i21, i22).
        i12: see `i11`.
        i21: see `i11`.
        i22: see `i11`.
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
    """

    arm: Arm
    normal: Floats
    tangent: Floats
    row1: Floats
    row2: Floats
    i11: Floats
    i12: Floats
    i21: Floats
    i22: Floats
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


def touch_equations(
    parameters: Parameters, joints: Floats, centers: Floats, radii: Floats, state: State, sign: GripperSign
) -> Equations:
    """The equations of n touches at a state.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        state: where to evaluate.
        sign: sign of (7).

    Returns:
        Residuals and derivatives, to first order exact wherever the rows hold.
    """
    p, f = parameters, state.magnitude
    arm = view_arm(p, state.link1, state.link2, state.direction)
    a1, a2, b1, b2 = arm.a1, arm.a2, arm.b1, arm.b2
    on1, on2 = state.mode1 != 0, state.mode2 != 0
    # how strongly each row feels its lever arm: p f on a flank, 1 where the joint floats
    w1, w2 = np.where(on1, p.p1 * f, 1.0), np.where(on2, p.p2 * f, 1.0)
    row1 = w1 * a1 + np.where(on1, state.link1 - joints[:, 0] + p.g1 * state.mode1, 0.0)
    row2 = w2 * a2 + np.where(on2, state.link2 - joints[:, 1] + p.g2 * state.mode2, 0.0)
    m11, m12, m21, m22 = on1 - w1 * b1, -w1 * b2, -w2 * b2, on2 - w2 * b2
    det = m11 * m22 - m12 * m21
    i11, i12, i21, i22 = m22 / det, -m12 / det, -m21 / det, m11 / det
    g11, g12 = a1 * i11 + a2 * i21, a1 * i12 + a2 * i22
    g21, g22 = b1 * i11 + b2 * i21, b1 * i12 + b2 * i22

    reach = radii + gripper_stretch(p, f, sign)
    cx, cy = p.x0 - centers[:, 0], p.y0 - centers[:, 1]
    normal = b1 + cx * arm.nx + cy * arm.ny + reach - g11 * row1 - g12 * row2
    tangent = -a1 - cx * arm.ny + cy * arm.nx - g21 * row1 - g22 * row2
    row1_f, row2_f = np.where(on1, p.p1 * a1, 0.0), np.where(on2, p.p2 * a2, 0.0)
    row1_d, row2_d = w1 * b1, w2 * b2
    return Equations(
        arm, normal, tangent, row1, row2, i11, i12, i21, i22, g11, g12, g21, g22, row1_f, row2_f, row1_d, row2_d,
        normal_f=gripper_slope(p, sign) - g11 * row1_f - g12 * row2_f,
        tangent_f=-g21 * row1_f - g22 * row2_f,
        normal_d=-g11 * row1_d - g12 * row2_d,
        tangent_d=reach - g21 * row1_d - g22 * row2_d,
    )  # fmt: skip


def parameter_derivative(parameters: Parameters, state: State, equations: Equations, sign: GripperSign) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held.

    Returns:
        (n, 2, 12): along n and t, by the parameters in the order of `NAMES`.
    """
    e, arm, f = equations, equations.arm, state.magnitude
    on1, on2 = state.mode1 != 0, state.mode2 != 0
    w1, w2 = np.where(on1, parameters.p1 * f, 1.0), np.where(on2, parameters.p2 * f, 1.0)
    un, ut = arm.ux * arm.nx + arm.uy * arm.ny, arm.uy * arm.nx - arm.ux * arm.ny
    vn, vt = arm.vx * arm.nx + arm.vy * arm.ny, arm.vy * arm.nx - arm.vx * arm.ny
    turn1, turn2 = f * arm.a1 * on1, f * arm.a2 * on2
    out = np.empty((12, 2, len(f)))
    out[0] = arm.nx, -arm.ny
    out[1] = arm.ny, arm.nx
    out[2] = e.g11 * on1, e.g21 * on1
    out[3] = un + e.g11 * w1 * ut, ut + e.g21 * w1 * ut
    out[4] = e.g12 * on2, e.g22 * on2
    out[5] = vn + (e.g11 * w1 + e.g12 * w2) * vt, vt + (e.g21 * w1 + e.g22 * w2) * vt
    out[6] = (f if sign is GripperSign.PAPER else -f), np.zeros_like(f)
    out[7] = -e.g11 * turn1, -e.g21 * turn1
    out[8] = -e.g12 * turn2, -e.g22 * turn2
    out[9] = -np.ones_like(f), np.zeros_like(f)
    out[10] = -e.g11 * state.mode1, -e.g21 * state.mode1
    out[11] = -e.g12 * state.mode2, -e.g22 * state.mode2
    return np.moveaxis(out, -1, 0).swapaxes(1, 2)


def move_links(equations: Equations, state: State, change_f: Floats, change_d: Floats) -> State:
    """One Newton step of the rows: the link angles that go with a change of f and φ."""
    e = equations
    r1 = e.row1 + e.row1_f * change_f + e.row1_d * change_d
    r2 = e.row2 + e.row2_f * change_f + e.row2_d * change_d
    return state._replace(
        link1=state.link1 - (e.i11 * r1 + e.i12 * r2),
        link2=state.link2 - (e.i21 * r1 + e.i22 * r2),
        magnitude=state.magnitude + change_f,
        direction=state.direction + change_d,
    )


def settle_links(parameters: Parameters, joints: Floats, state: State) -> State:
    """One Newton step of the rows alone, then the modes that the new link angles call for."""
    p, f = parameters, state.magnitude
    arm = view_arm(p, state.link1, state.link2, state.direction)
    on1, on2 = state.mode1 != 0, state.mode2 != 0
    w1, w2 = np.where(on1, p.p1 * f, 1.0), np.where(on2, p.p2 * f, 1.0)
    row1 = w1 * arm.a1 + np.where(on1, state.link1 - joints[:, 0] + p.g1 * state.mode1, 0.0)
    row2 = w2 * arm.a2 + np.where(on2, state.link2 - joints[:, 1] + p.g2 * state.mode2, 0.0)
    m11, m12, m21, m22 = on1 - w1 * arm.b1, -w1 * arm.b2, -w2 * arm.b2, on2 - w2 * arm.b2
    det = m11 * m22 - m12 * m21
    moved = state._replace(
        link1=state.link1 - (m22 * row1 - m12 * row2) / det, link2=state.link2 - (m11 * row2 - m21 * row1) / det
    )
    return next_modes(parameters, joints, moved)


def next_modes(parameters: Parameters, joints: Floats, state: State) -> State:
    """The modes that the state calls for, by the rule of a primal-dual active set.

    The law of the backlash is β ∈ g Sign(a) with β = q - q* - p f a, that is: on a
    flank β = ±g and a has its sign; floating, a = 0 and |β| ≤ g. Both are told
    apart by β + κ a for any κ > 0: outside [-g, g] it is on that flank.

    Returns:
        The state with its modes renewed.
    """
    p = parameters
    arm = view_arm(p, state.link1, state.link2, state.direction)
    floats1 = joints[:, 0] - state.link1 - p.p1 * state.magnitude * arm.a1 + MODE_SCALE * arm.a1
    floats2 = joints[:, 1] - state.link2 - p.p2 * state.magnitude * arm.a2 + MODE_SCALE * arm.a2
    return state._replace(mode1=_mode(floats1, arm.a1, p.g1), mode2=_mode(floats2, arm.a2, p.g2))


def _mode(pointer: Floats, arm: Floats, backlash: float) -> Floats:
    if backlash <= 0:
        return np.where(arm < 0, -1.0, 1.0)
    return np.where(np.abs(pointer) <= backlash, 0.0, np.sign(pointer))


def free_state(parameters: Parameters, joints: Floats, centers: Floats) -> State:
    """A start for n touches: links at the measured angles, no force, pointing from tip to disc."""
    first = joints[:, 0] + parameters.theta1
    second = first + joints[:, 1] + parameters.theta2
    x = parameters.x0 + parameters.l1 * np.cos(first) + parameters.l2 * np.cos(second)
    y = parameters.y0 + parameters.l1 * np.sin(first) + parameters.l2 * np.sin(second)
    direction = np.arctan2(centers[:, 1] - y, centers[:, 0] - x)
    state = State(joints[:, 0], joints[:, 1], np.zeros(len(x)), direction, *np.ones((2, len(x))))
    arm = view_arm(parameters, *state[:2], direction)
    return state._replace(mode1=_mode(arm.a1, arm.a1, 0.0), mode2=_mode(arm.a2, arm.a2, 0.0))
