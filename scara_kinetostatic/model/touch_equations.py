"""The equations of one touch and their derivatives: everything else is built on these.

A touch is a state (Q*, f, φ): link angles, force magnitude, force direction. With
n = (cos φ, sin φ) the force on the object is F = f n, and the state obeys

    rows:  q_i* + p_i f a_i + g_i s_i - q_i = 0,   s_i = sign(a_i)   (6), (8)
    circle: H(Q*) + (r + γ(f)) n - S_c = 0                            (5), (7), (11)

The second, a vector in metres, is both conditions of (11) at once: along n, the tip
lies on the circle; along t = R90 n, the force is radial. For f > 0, sign(a) is
sign(c); keeping sign(a) for f < 0 continues the contact smoothly into tension.

**Lever arms.** With e and k the vectors from the axes of joint 1 and joint 2 to the rigid tip,

- the lever arms a = (e × n, k × n) give the torques C = JᵀF = f a (8);
- b = (e · n, k · n) are the moves of the tip along t per angle.

Turning the joints by dq moves the tip by a·dq along n and b·dq along t, and
changes the arms by da1 = -b1 dq1 - b2 dq2, da2 = -b2 (dq1 + dq2); turning the
force by dφ changes them by b dφ. Everything follows from these four numbers, and, for a
gripper that does not give way along the force (`gripper.Skew`), from what it adds to the arms.

**Dead band.** sign(a) is set-valued at a = 0. There the joint floats (mode 0): its row
becomes a_i = 0, the force line passes through the joint's axis, and q_i no
longer matters as long as the joint stays inside its backlash. The modes are found as
in a complementarity problem, see `next_modes`.

**Elimination.** The rows fix Q*. With M = ∂rows/∂Q* and A = [a; b], G = A M⁻¹,
the circle's residual h and its derivatives with respect to the measured quantities and to L̄ are

    h = circle - G rows,   h_z = circle_z - G rows_z.

The measured angle q_i and the offset theta_i enter alike: h_theta = h_q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.effect_law import TouchState
from scara_kinetostatic.model.gripper import Gripper, Skew
from scara_kinetostatic.model.kinematics import LoadedJoints, component_by_parameters, stacked
from scara_kinetostatic.model.parameters import Parameters


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
    skew = None if gripper.excess == ((0.0, 0.0), (0.0, 0.0)) else gripper.skew(direction - second)
    if skew is None:
        return Arm(ux, uy, vx, vy, nx, ny, a1, a2, b1, b2, a1, a2, b1, b2, None, un, ut, vn, vt)
    aside, turn = magnitude * skew.tangent, magnitude * skew.tangent_turn
    levers = a1 - aside, a2 - aside, b1 - turn, b2 - turn
    return Arm(ux, uy, vx, vy, nx, ny, a1, a2, b1, b2, *levers, skew, un, ut, vn, vt)


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
    two holds follows from β + κ a for any κ > 0: outside [-g, g] it is on that flank. With κ = 1 rad/m a lever arm of
    a millimetre already outweighs a usual backlash, so that a flank gives way to the other one at once.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: with any modes.
        arm: the arm at that state.

    Returns:
        The state with its modes renewed.
    """
    p, f = parameters, state.magnitude
    floats1 = joints[:, 0] - state.link1 + (1.0 - p.p1 * f) * arm.lever1
    floats2 = joints[:, 1] - state.link2 + (1.0 - p.p2 * f) * arm.lever2
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


def step_links(
    parameters: Parameters, joints: Floats, state: State, gripper: Gripper, frozen: bool = False, arm: Arm | None = None
) -> tuple[State, Arm]:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: where from; its force stays.
        gripper: the form of (7).
        frozen: whether every joint stays on its flank.
        arm: the arm at `state`, where it is known.

    Returns:
        The state, and the arm there.
    """
    r = joint_rows(parameters, joints, state, gripper, arm)
    state = state._replace(
        link1=state.link1 - (r.i11 * r.row1 + r.i12 * r.row2), link2=state.link2 - (r.i21 * r.row1 + r.i22 * r.row2)
    )
    arm = view_arm(parameters, *state[:4], gripper)
    return (state if frozen else next_modes(parameters, joints, state, arm)), arm


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


def _circle(
    p: Parameters, centers: Floats, radii: Floats, state: State, arm: Arm, gripper: Gripper
) -> tuple[Floats, Floats, Floats, Floats, tuple[Floats | float, Floats | float], tuple[Floats | float, Floats]]:
    """H(Q*) + (S - S*) + r n - S_c along n and t; its part along n by both joints; both parts by f, and by φ."""
    f = state.magnitude
    reach = radii + gripper.stretch(p, f)
    cx, cy = p.x0 - centers[:, 0], p.y0 - centers[:, 1]
    normal = arm.b1 + cx * arm.nx + cy * arm.ny + reach
    tangent = -arm.a1 - cx * arm.ny + cy * arm.nx
    slope, skew = gripper.slope(p), arm.skew
    if skew is None:
        return normal, tangent, arm.a1, arm.a2, (slope, 0.0), (0.0, reach)
    return (
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
    joints = LoadedJoints(
        slope=(r.w1, r.w2),
        moment=(-arm.ut, -arm.vt),
        torque=(f * arm.lever1 * r.on1, f * arm.lever2 * r.on2),
        sense=(state.mode1, state.mode2),
        rests=(r.on1, r.on2),
    )
    push = (gripper.factor * f, -1.0)
    along = component_by_parameters((arm.nx, arm.ny), (arm.un, arm.vn), (e.g11, e.g12), push, joints)
    across = component_by_parameters((-arm.ny, arm.nx), (arm.ut, arm.vt), (e.g21, e.g22), (0.0, 0.0), joints)
    return stacked((along, across), f.shape).transpose(2, 1, 0)


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
