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

from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.effect_law import TouchState
from scara_kinetostatic.model.gripper import Gripper, Skew
from scara_kinetostatic.model.kinematics import LoadedJoints, component_by_parameters, forward, stacked
from scara_kinetostatic.model.parameters import Parameters


class Arm(NamedTuple):
    """The arm at link angles Q*, seen along a force direction; all (2, n).

    Attributes:
        link1: unit vector of link 1, base frame.
        link2: the same of link 2.
        normal: unit vector of the force on the object, base frame.
        seen1: unit vector of link 1 along n and t.
        seen2: the same of link 2.
        a: lever arms of joint 1 and joint 2, m.
        b: moves of the tip along t per angle of joint 1 and of joint 2, m.
        lever: lever arms, gripper and all, m.
        turn: what `lever` loses per angle of its joint, and gains as the force turns, m.
        skew: what the gripper adds where it does not give way along the force, (n,) each; None where it does.
    """

    link1: Floats
    link2: Floats
    normal: Floats
    seen1: Floats
    seen2: Floats
    a: Floats
    b: Floats
    lever: Floats
    turn: Floats
    skew: Skew | None

    def select(self, which: Mask | Indices | slice) -> Arm:
        """The touches that a mask, a slice or an array of positions picks."""
        skew = None if self.skew is None else Skew(*(part[which] for part in self.skew))
        parts: list[Any] = [*(part[:, which] for part in self[:-1]), skew]
        return Arm(*parts)


def seen(vectors: Floats, normal: Floats) -> Floats:
    """Components of vectors (2, n) along unit vectors n and along t = R90 n, (2, n)."""
    (x, y), (nx, ny) = vectors, normal
    return np.array([x * nx + y * ny, y * nx - x * ny])


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
    angles = np.array([first, second, direction])
    u, v, normal = np.array([np.cos(angles), np.sin(angles)]).transpose(1, 0, 2)
    seen1, seen2 = seen(u, normal), seen(v, normal)
    along1, aside1 = parameters.l1 * seen1
    along2, aside2 = parameters.l2 * seen2
    a, b = np.array([-aside2 - aside1, -aside2]), np.array([along2 + along1, along2])
    skew = gripper.skew(direction - second)
    if skew is None:
        return Arm(u, v, normal, seen1, seen2, a, b, a, b, None)
    lever, turn = a - magnitude * skew.tangent, b - magnitude * skew.tangent_turn
    return Arm(u, v, normal, seen1, seen2, a, b, lever, turn, skew)


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


def of_joints(parameters: Parameters) -> tuple[Floats, Floats]:
    """P and g of joint 1 and joint 2, (2, 1) each."""
    p = parameters
    return np.array([[p.p1], [p.p2]]), np.array([[p.g1], [p.g2]])


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
    compliance, backlash = of_joints(parameters)
    pointer = joints.T - np.array(state[:2]) + (1.0 - compliance * state.magnitude) * arm.lever
    floating = np.sign(pointer) * (np.abs(pointer) > backlash)
    mode1, mode2 = np.where(backlash <= 0, np.where(arm.lever < 0, -1.0, 1.0), floating)
    return state._replace(mode1=mode1, mode2=mode2)


def free_state(parameters: Parameters, joints: Floats, centers: Floats) -> State:
    """A start for n touches: links at the measured angles, no force, pointing from tip to disc."""
    direction = np.arctan2(*(centers - forward(parameters, joints)).T[::-1])
    still, (q1, q2) = np.zeros(len(direction)), joints.T
    arm = view_arm(parameters, q1, q2, still, direction, Gripper())
    return State(q1, q2, still, direction, *np.where(arm.a < 0, -1.0, 1.0))


class Rows(NamedTuple):
    """The joints' rows at n touches; those of joint 1 and joint 2, (2, n).

    Attributes:
        arm: the arm along the force.
        joints: the measured angles that they hold for, Q less what effects add, (n, 2), rad.
        row: residuals, rad, or m where the joint floats.
        weight: how strongly a row feels its lever arm: p f on a flank, 1 where the joint floats.
        on: 1 where the joint rests on a flank, 0 where it floats.
        inverse: M⁻¹, (2, 2, n).
    """

    arm: Arm
    joints: Floats
    row: Floats
    weight: Floats
    on: Floats
    inverse: Floats

    def step(self, left: Floats) -> Floats:
        """M⁻¹ times what is left of the rows, (2, n)."""
        return times(self.inverse, left)


def times(matrices: Floats, vectors: Floats) -> Floats:
    """Matrices (2, 2, n) times vectors (2, n), touch by touch."""
    return np.asarray(np.einsum('ijn,jn->in', matrices, vectors))


def joint_rows(parameters: Parameters, joints: Floats, state: State, gripper: Gripper, arm: Arm | None = None) -> Rows:
    """The rows of (6) and (8) at a state, and M⁻¹; `arm` saves work where that of the state is known."""
    arm = view_arm(parameters, *state[:4], gripper) if arm is None else arm
    (compliance, backlash), mode = of_joints(parameters), np.array(state[4:])
    on = mode * mode
    weight = on * (compliance * state.magnitude) + (1.0 - on)
    row = weight * arm.lever + on * (np.array(state[:2]) - joints.T) + backlash * mode
    m11, n12, n21 = on[0] - weight[0] * arm.turn[0], weight[0] * arm.turn[1], weight[1] * arm.turn[1]
    m22 = on[1] - n21
    inverse = np.array([[m22, n12], [n21, m11]]) / (m11 * m22 - n12 * n21)
    return Rows(arm, joints, row, weight, on, inverse)


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
    rows = joint_rows(parameters, joints, state, gripper, arm)
    step1, step2 = rows.step(rows.row)
    state = state._replace(link1=state.link1 - step1, link2=state.link2 - step2)
    arm = view_arm(parameters, *state[:4], gripper)
    return (state if frozen else next_modes(parameters, joints, state, arm)), arm


class Equations(NamedTuple):
    """Residuals of n touches and what the derivatives are made of.

    Attributes:
        rows: the joints' rows.
        h: along n and t, (2, n), m.
        by_rows: G, (2, 2, n), m/rad.
        rows_by: derivatives of the rows by f and by φ, (2, n) each.
        h_by: those of h, m/N and m/rad.
        touch_state: the touches as effects take them; None for the base model.
    """

    rows: Rows
    h: Floats
    by_rows: Floats
    rows_by: tuple[Floats, Floats]
    h_by: tuple[Floats, Floats]
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
    p, f, rows = parameters, state.magnitude, joint_rows(parameters, joints, state, gripper, arm)
    arm, reach, zero = rows.arm, radii + gripper.stretch(p, state.magnitude), np.zeros(len(radii))
    circle = np.array([arm.b[0] + reach, -arm.a[0]])  # H(Q*) + (S - S*) + r n - S_c along n and t
    circle += seen(np.array([[p.x0], [p.y0]]) - centers.T, arm.normal)
    across, by_f, by_d = arm.a, np.array([zero + gripper.slope(p), zero]), np.array([zero, reach])
    row_f = of_joints(p)[0] * rows.on * arm.lever
    if (skew := arm.skew) is not None:
        stretch, turned = np.array([skew.normal, skew.tangent]), np.array([skew.normal_turn, skew.tangent_turn])
        circle, by_f, across = circle + f * stretch, by_f + stretch, across - f * skew.normal_turn
        by_d = by_d + f * (turned + np.array([-skew.tangent, skew.normal]))
        row_f = row_f - rows.weight * skew.tangent
    row_d = rows.weight * arm.turn
    g = np.einsum('ijn,jkn->ikn', np.array([across, arm.turn]), rows.inverse)
    h_by = by_f - times(g, row_f), by_d - times(g, row_d)
    return Equations(rows, circle - times(g, rows.row), g, (row_f, row_d), h_by)


def parameter_derivative(state: State, equations: Equations, gripper: Gripper) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held.

    Returns:
        (n, 2, 12): along n and t, by the parameters in the order of `NAMES`.
    """
    r, f, arm = equations.rows, state.magnitude, equations.rows.arm
    joints = LoadedJoints(
        slope=tuple(r.weight),
        moment=(-arm.seen1[1], -arm.seen2[1]),
        torque=tuple(f * arm.lever * r.on),
        sense=(state.mode1, state.mode2),
        rests=tuple(r.on),
    )
    (nx, ny), (along, across) = arm.normal, equations.by_rows
    pushes = (gripper.factor * f, -1.0), (0.0, 0.0)
    parts = zip(((nx, ny), (-ny, nx)), zip(arm.seen1, arm.seen2, strict=True), (along, across), pushes, strict=True)
    return stacked([component_by_parameters(*part, joints) for part in parts], f.shape).transpose(2, 1, 0)


def excess_derivative(state: State, equations: Equations, gripper: Gripper) -> Floats:
    """∂h/∂E of n touches, f and φ held: by the entries 11, 12, 21, 22 of the gripper's excess, (n, 2, 4)."""
    arm, push = equations.rows.arm, gripper.factor * state.magnitude
    n = np.array([arm.seen2[0], -arm.seen2[1]])  # in the frame of link 2
    t = np.array([-n[1], n[0]])
    normal, tangent = push * n[:, None] * n, push * t[:, None] * n
    moved = times(equations.by_rows, equations.rows.weight)
    parts = normal + moved[0] * tangent, tangent + moved[1] * tangent
    return np.moveaxis(np.array([part.reshape(4, -1) for part in parts]), -1, 0)


def move_links(equations: Equations, state: State, change_f: Floats, change_d: Floats) -> State:
    """One Newton step of the rows: the link angles that go with a change of f and φ."""
    row_f, row_d = equations.rows_by
    step1, step2 = equations.rows.step(equations.rows.row + row_f * change_f + row_d * change_d)
    return State(
        state.link1 - step1, state.link2 - step2, state.magnitude + change_f, state.direction + change_d, *state[4:]
    )
