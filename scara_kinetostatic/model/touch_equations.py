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
force by dφ changes them by b dφ. Everything follows from these four numbers.

**Dead band.** sign(a) is set-valued at a = 0. There the joint floats (mode 0): its row
becomes a_i = 0, the force line passes through the joint's axis, and q_i no
longer matters as long as the joint stays inside its backlash. The modes are found as
in a complementarity problem, see `next_modes`.

**Gravity** (`joint_law`) adds a torque t to f a: the actuators exert C = f a + t. A joint floats where C = 0. Its row
is C / f then, of which f counts as a constant.

**Elimination.** The rows fix Q*. With M = ∂rows/∂Q* and A = [a; b], G = A M⁻¹,
the circle's residual h and its derivatives with respect to the measured quantities and to L̄ are

    h = circle - G rows,   h_z = circle_z - G rows_z.

The measured angle q_i and the offset theta_i enter alike: h_theta = h_q.

**Plane vectors are complex numbers**, x + iy in the base frame. Seen along the force, multiplied by exp(-iφ), they are
(part along n) + i (part along t): so is h, and with r_i the vector from the axis of joint i to the tip, so seen,
b_i - i a_i = r_i and A = i r.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Complexes, Floats, Mask, as_complex, pairs, unit_vectors
from scara_kinetostatic.model.effect_law import TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.joint_law import Four, Pull, deflection, inverse_of_derivative, pull_of
from scara_kinetostatic.model.kinematics import GripperSign, LoadedJoints, component_by_parameters, forward
from scara_kinetostatic.model.outline import EDGE_RADIUS
from scara_kinetostatic.model.parameters import Parameters


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


LEAST_FORCE = 1e-3
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


class Edges(NamedTuple):
    """The straight edges among n touches (`model.outline`).

    Attributes:
        tangent: unit vector along the edge, base frame, complex, (n,); 0 on an arc.
        aside: what effects add along the tangent, (n,), complex, m: r times the angle by which they turn the normal.
        sense: -1 on an arc of an inner corner, else 1, (n,).
    """

    tangent: Complexes
    aside: Complexes
    sense: Floats

    @classmethod
    def of(cls, tangents: Floats | None, radii: Floats) -> Edges | None:
        """The edges of tangents (n, 2) and radii (n,), m; None for arcs alone."""
        if tangents is None:
            return None
        return cls(as_complex(tangents), np.zeros(len(tangents), dtype=complex), np.sign(radii))

    def shifted(self, place: Complexes) -> Edges:
        """The same with a displacement d, (n,), m."""
        return self._replace(aside=place - across(self.tangent, place))

    def inward(self, to_center: Complexes) -> Complexes:
        """Directions of forces along the normal, for vectors from tip to centre, (n,), m."""
        normal = 1j * self.tangent * EDGE_RADIUS - self.aside
        return np.where(self.tangent == 0, self.sense * to_center, normal)


class ContactProblem(NamedTuple):
    """n touches as the equations take them, besides the model and the state.

    Attributes:
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper: the form of (7).
        metadata: of the touches; effects need it, the base model does not.
        off_normal: off-normal angle of the force in each touch, (n,), rad; None for zero.
        edges: which touches are of a straight edge; None for arcs alone.
    """

    joints: Floats
    centers: Floats
    radii: Floats
    gripper: GripperSign
    metadata: TouchMetadata | None = None
    off_normal: Floats | None = None
    edges: Edges | None = None

    def inward(self, tips: Floats) -> Floats:
        """Vectors along which forces without friction act on the object, (n, 2), for tips (n, 2), m."""
        to_center = self.centers - tips
        return to_center if self.edges is None else pairs(self.edges.inward(as_complex(to_center)))

    def touch_state(self, parameters: Parameters, state: State, arm: Arm | None = None) -> TouchState:
        """The touches at a state, as effects take them; `arm` saves work where that of the state is known."""
        assert self.metadata is not None
        arm = view_arm(parameters, state) if arm is None else arm
        f, normal, pull = state.magnitude, pairs(arm.normal), pull_of(parameters, arm.link1, arm.link2)
        return TouchState(
            parameters=parameters,
            joints=self.joints,
            force=f[:, None] * normal,
            magnitude=f,
            normal=normal,
            torques=(f * arm.lever if pull is None else f * arm.lever + pull.torque).T,
            link1=pairs(arm.link1),
            link2=pairs(arm.link2),
            centers=self.centers,
            radii=self.radii,
            metadata=self.metadata,
            off_normal=np.zeros(len(f)) if self.off_normal is None else self.off_normal,
            tangents=None if self.edges is None else pairs(self.edges.tangent),
        )

    def shifted(self, model: ExtendedModel, state: State, arm: Arm | None = None) -> ContactProblem:
        """The same touches for the base model: Q - δ and S_c - d instead of Q and S_c; `arm` as in `touch_state`."""
        if not model.effects:
            return self
        return self.shifted_by(*model.shift(self.touch_state(model.parameters, state, arm)))

    def shifted_by(self, joints: Floats, place: Floats) -> ContactProblem:
        """Q - δ and S_c - d instead of Q and S_c."""
        edges = None if self.edges is None else self.edges.shifted(as_complex(place))
        return self._replace(joints=self.joints - joints, centers=self.centers - place, off_normal=None, edges=edges)


def free_state(parameters: Parameters, joints: Floats, centers: Floats, edges: Edges | None = None) -> State:
    """A start for n touches: links at the measured angles, no force, pointing from tip to disc."""

    def inward(links: Floats) -> Floats:
        to_disc = centers - forward(parameters, links)
        to_disc = to_disc if edges is None else pairs(edges.inward(as_complex(to_disc)))
        return np.asarray(np.arctan2(*to_disc.T[::-1]))

    direction = inward(joints)
    still, (q1, q2) = np.zeros(len(direction)), joints.T
    state = State(q1, q2, still, direction, still, still)
    mode1, mode2 = np.where(view_arm(parameters, state).lever < 0, -1.0, 1.0)
    state = state._replace(mode1=mode1, mode2=mode2)
    if parameters.has_gravity:  # the arm hangs in its joints
        for _ in range(4):
            state, _ = step_links(parameters, joints, state)
        state = state._replace(direction=inward(np.array(state[:2]).T))
    return state


class Rows(NamedTuple):
    """The joints' rows at n touches; those of joint 1 and joint 2, (2, n).

    Attributes:
        arm: the arm along the force.
        joints: the measured angles that they hold for, Q less what effects add, (n, 2), rad.
        row: residuals, rad, or m where the joint floats.
        weight: how strongly a row feels its lever arm: p f on a flank, 1 where the joint floats.
        on: 1 where the joint rests on a flank, 0 where it floats.
        inverse: M⁻¹ by rows, (n,) each.
        pulled: how strongly a row feels the torque of gravity, 1/N m, (2, n): p on a flank, 1 / f where the joint
            floats; and the pull; None without gravity.
    """

    arm: Arm
    joints: Floats
    row: Floats
    weight: Floats
    on: Floats
    inverse: Four
    pulled: tuple[Floats, Pull] | None = None

    def step(self, left: Floats) -> tuple[Floats, Floats]:
        """M⁻¹ times what is left of the rows, (2, n)."""
        i11, i12, i21, i22 = self.inverse
        return i11 * left[0] + i12 * left[1], i21 * left[0] + i22 * left[1]


def joint_rows(parameters: Parameters, joints: Floats, state: State, arm: Arm | None = None) -> Rows:
    """The rows of (6) and (8) at a state, and M⁻¹; `arm` saves work where that of the state is known."""
    arm = view_arm(parameters, state) if arm is None else arm
    mode = np.array(state[4:])
    on = mode * mode
    weight = on * (parameters.joint_compliances * state.magnitude) + (1.0 - on)
    load, turn, by, pulled = arm.lever, arm.turn, weight, None
    if (pull := pull_of(parameters, arm.link1, arm.link2)) is not None:
        force = np.where(np.abs(state.magnitude) > LEAST_FORCE, state.magnitude, LEAST_FORCE)
        by = on * parameters.joint_compliances + (1.0 - on) / force
        load, turn = state.magnitude * load + pull.torque, state.magnitude * turn + pull.turn
        weight, pulled = by * state.magnitude, (by, pull)
    row = on * (np.array(state[:2]) - joints.T) + deflection(by, parameters.joint_backlashes, load, mode)
    return Rows(arm, joints, row, weight, on, inverse_of_derivative(on, by, turn), pulled)


def step_links(
    parameters: Parameters, joints: Floats, state: State, frozen: bool = False, arm: Arm | None = None
) -> tuple[State, Arm]:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        state: where from; its force stays.
        frozen: whether every joint stays on its flank.
        arm: the arm at `state`, where it is known.

    Returns:
        The state, and the arm there.
    """
    rows = joint_rows(parameters, joints, state, arm)
    step1, step2 = rows.step(rows.row)
    state = state._replace(link1=state.link1 - step1, link2=state.link2 - step2)
    arm = view_arm(parameters, state)
    return (state if frozen else next_modes(parameters, joints, state, arm)), arm


class Equations(NamedTuple):
    """Residuals of n touches and what the derivatives are made of, seen along the force.

    Attributes:
        rows: the joints' rows.
        h: (n,), complex, m.
        by_rows: G, (2, n), complex, m/rad.
        rows_by: derivatives of the rows by f and by φ, (2, n) each.
        h_by: those of h, (n,) each, complex, m/N and m/rad.
        touch_state: the touches as effects take them; None for the base model.
        tangent: unit vector along the edge seen along the force, (n,), 0 on an arc; None for arcs alone.
    """

    rows: Rows
    h: Complexes
    by_rows: Complexes
    rows_by: tuple[Floats, Floats]
    h_by: tuple[Complexes, Complexes]
    touch_state: TouchState | None = None
    tangent: Complexes | None = None

    def moved(self, turned: Floats) -> Complexes:
        """What a change of the rows (2, n) takes from h, (n,)."""
        return self.by_rows[0] * turned[0] + self.by_rows[1] * turned[1]

    def across(self, vectors: Complexes) -> Complexes:
        """The part of displacements, seen along the force, that is not along the edge."""
        return vectors if self.tangent is None else across(self.tangent, vectors)


def across(tangent: Complexes, vectors: Complexes) -> Complexes:
    """Vectors (..., n) without their part along unit vectors (n,), or zeros."""
    return np.asarray(vectors - tangent * (vectors * tangent.conj()).real)


def touch_equations(parameters: Parameters, problem: ContactProblem, state: State, arm: Arm | None = None) -> Equations:
    """The equations of n touches at a state.

    Args:
        parameters: L̄.
        problem: what is given of the touches.
        state: where to evaluate.
        arm: that of the state, where it is known.

    Returns:
        Residuals and derivatives, to first order exact wherever the rows hold.
    """
    p, f, (joints, centers, radii, gripper, *_, edges) = parameters, state.magnitude, problem
    rows = joint_rows(p, joints, state, arm)
    arm, reach, seen = rows.arm, radii + gripper.stretch(p, state.magnitude), rows.arm.normal.conj()
    circle = arm.reach[0] + reach + (p.x0 + 1j * p.y0 - as_complex(centers)) * seen
    by_f, by_d = np.asarray(gripper.slope(p), dtype=complex), np.asarray(1j * reach)
    by_link = 1j * arm.reach
    row_f, row_d = p.joint_compliances * rows.on * arm.lever, rows.weight * arm.turn
    if rows.pulled is not None:
        row_f = rows.pulled[0] * arm.lever
    tangent = None
    if edges is not None:
        # the radius turns with the force, all the rest counts across the edge
        tangent = edges.tangent * seen
        circle = across(tangent, circle - radii) + radii + edges.aside * seen
        by_f, by_d = across(tangent, by_f + 0j * f), across(tangent, by_d - 1j * radii) + 1j * radii
        by_link = across(tangent, by_link)
    i11, i12, i21, i22 = rows.inverse
    g = np.array([by_link[0] * i11 + by_link[1] * i21, by_link[0] * i12 + by_link[1] * i22])
    e = Equations(rows, circle, g, (row_f, row_d), (by_f, by_d), tangent=tangent)
    return e._replace(h=circle - e.moved(rows.row), h_by=(by_f - e.moved(row_f), by_d - e.moved(row_d)))


def parameter_derivative(parameters: Parameters, state: State, equations: Equations, gripper: GripperSign) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held.

    Returns:
        (n, 2, 12), with gravity (n, 2, 14): along n and t, by the parameters in the order of `Parameters.names`.
    """
    r, f, arm = equations.rows, state.magnitude, equations.rows.arm
    torque, pull = f * arm.lever, None
    if r.pulled is not None:
        by, pulled = r.pulled
        torque, pull = torque + pulled.torque, (tuple(by), pulled.per_moment)
    joints = LoadedJoints(
        slope=tuple(r.weight),
        moment=tuple(-arm.links.imag),
        torque=tuple(torque * r.on),
        sense=(state.mode1, state.mode2),
        rests=tuple(r.on),
        pull=pull,
    )
    seen = arm.normal.conj()
    columns = component_by_parameters(
        (seen, 1j * seen), tuple(arm.links), tuple(equations.by_rows), (gripper.factor * f, -1.0), joints
    )
    along, found = np.empty((len(columns), len(f)), dtype=complex), np.empty((len(columns), 2, len(f)))
    for out, column in zip(along, columns, strict=True):
        out[:] = column
    along = equations.across(along)
    found[:, 0], found[:, 1] = along.real, along.imag
    return found.transpose(2, 1, 0)


def move_links(equations: Equations, state: State, change_f: Floats, change_d: Floats) -> State:
    """One Newton step of the rows: the link angles that go with a change of f and φ."""
    row_f, row_d = equations.rows_by
    step1, step2 = equations.rows.step(equations.rows.row + row_f * change_f + row_d * change_d)
    return State(
        state.link1 - step1, state.link2 - step2, state.magnitude + change_f, state.direction + change_d, *state[4:]
    )
