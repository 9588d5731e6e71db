"""The equations of a touch; everything else is built on these.

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
in a complementarity problem, see `flanks.next_modes`.

**Gravity** (`gravity`) adds a torque t to f a: the actuators exert C = f a + t. A joint floats where C = 0. Its row
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

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Complexes, Floats, as_complex, pairs
from scara_kinetostatic.model.extended_model import (
    ExtendedModel,
    ForceDependence,
    Shift,
    TouchMetadata,
    TouchState,
    sum_of_shifts,
)
from scara_kinetostatic.model.flanks import LEAST_FORCE, Arm, State, next_modes, view_arm
from scara_kinetostatic.model.gravity import Pull, pull_of
from scara_kinetostatic.model.joint_law import deflection, inverse_of_derivative
from scara_kinetostatic.model.kinematics import GripperSign
from scara_kinetostatic.model.outline import EDGE_RADIUS
from scara_kinetostatic.model.parameters import Parameters


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
        """The same with a further displacement d, (n,), m."""
        return self._replace(aside=self.aside + place - across(self.tangent, place))


def inward(to_center: Floats, edges: Edges | None) -> Floats:
    """Vectors along which forces without friction act on the object, for those from tip to centre, (n, 2), m."""
    if edges is None:
        return to_center
    normal = 1j * edges.tangent * EDGE_RADIUS - edges.aside
    return pairs(np.where(edges.tangent == 0, edges.sense * as_complex(to_center), normal))


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
        return inward(self.centers - tips, self.edges)

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
        return self.shifted_by(*sum_of_shifts(self.touch_state(model.parameters, state, arm), model.pairs))

    def shifted_by(self, joints: Floats | None, place: Floats | None) -> ContactProblem:
        """Q - δ and S_c - d instead of Q and S_c; None for nothing."""
        q, centers, edges = self.joints, self.centers, self.edges
        if place is not None:
            centers, edges = centers - place, None if edges is None else edges.shifted(as_complex(place))
        return self._replace(joints=q if joints is None else q - joints, centers=centers, off_normal=None, edges=edges)


class Rows(NamedTuple):
    """The joints' rows at n touches; those of joint 1 and joint 2, (2, n).

    Attributes:
        arm: the arm along the force.
        joints: the measured angles that they hold for, Q less what effects add, (n, 2), rad.
        row: residuals, rad, or m where the joint floats.
        weight: how strongly a row feels its lever arm: p f on a flank, 1 where the joint floats.
        on: 1 where the joint rests on a flank, 0 where it floats.
        inverse: M⁻¹, (2, 2, n).
        pulled: how strongly a row feels the torque of gravity, 1/N m, (2, n): p on a flank, 1 / f where the joint
            floats; and the pull; None without gravity.
    """

    arm: Arm
    joints: Floats
    row: Floats
    weight: Floats
    on: Floats
    inverse: Floats
    pulled: tuple[Floats, Pull] | None = None

    def solved(self, state: State, left: Floats) -> State:
        """The state after Newton's step of the rows, of which so much is left, (2, n)."""
        step1, step2 = self.inverse[:, 0] * left[0] + self.inverse[:, 1] * left[1]
        return State(state.link1 - step1, state.link2 - step2, *state[2:])


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
    inverse = np.array(inverse_of_derivative(on, by, turn)).reshape(2, 2, -1)
    return Rows(arm, joints, row, weight, on, inverse, pulled)


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
    state = rows.solved(state, rows.row)
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
    g = by_link[0] * rows.inverse[0] + by_link[1] * rows.inverse[1]
    e = Equations(rows, circle, g, (row_f, row_d), (by_f, by_d), tangent=tangent)
    return e._replace(h=circle - e.moved(rows.row), h_by=(by_f - e.moved(row_f), by_d - e.moved(row_d)))


ANGLE_STEP = 1e-5
"""Step of the central difference over an angle, rad."""


def _by_force(
    model: ExtendedModel, problem: ContactProblem, state: State, arm: Arm
) -> Iterator[tuple[TouchState, TouchState, Floats, ForceDependence] | None]:
    """Arguments of `ExtendedModel.difference` for the derivatives of δ and d by f, then by φ; None where no effect
    depends on it.
    """
    by_magnitude = 1e-4 * np.maximum(np.abs(state.magnitude), 1.0)  # as a part of the force, of 1 N at least
    for least, part, step, known in (
        (ForceDependence.ALL, 'magnitude', by_magnitude, arm),
        (ForceDependence.DIRECTION, 'direction', np.full(len(by_magnitude), ANGLE_STEP), None),
    ):
        if model.force_dependence < least:
            yield None
            continue
        up, down = (state._replace(**{part: getattr(state, part) + change}) for change in (step, -step))
        p = model.parameters
        yield problem.touch_state(p, up, known), problem.touch_state(p, down, known), 2 * step[:, None], least


def extended_equations(
    model: ExtendedModel, problem: ContactProblem, state: State, arm: Arm | None = None
) -> Equations:
    """`touch_equations` of an extended model.

    The derivatives by f and φ are exact to first order; those by Q* leave out that δ and d depend on it.

    Args:
        model: the model; without effects the equations are those of the base model.
        problem: the touches.
        state: where to evaluate.
        arm: the arm at the state, where it is known.
    """
    p = model.parameters
    if not model.effects:
        return touch_equations(p, problem, state, arm)
    arm = view_arm(p, state) if arm is None else arm
    at = problem.touch_state(p, state, arm)
    shifted = problem.shifted_by(*sum_of_shifts(at, model.pairs))
    e = touch_equations(p, shifted, state, arm)
    shifts = list[Shift]()
    for states in _by_force(model, problem, state, arm):
        shifts.append(Shift() if states is None else model.difference(*states))
    turns = (0.0 if shift.joints is None else shift.joints.T * e.rows.on for shift in shifts)
    row_f, row_d = (row + turn for row, turn in zip(e.rows_by, turns, strict=True))
    h_f, h_d = (h + as_complex(shift_column(shift, e)) for h, shift in zip(e.h_by, shifts, strict=True))
    return e._replace(rows_by=(row_f, row_d), h_by=(h_f, h_d), touch_state=at)


def shift_column(shift: Shift, equations: Equations) -> Floats:
    """What a shift adds to h along n and t, (n, 2), m."""
    out = np.zeros(equations.h.shape, dtype=complex)
    if shift.joints is not None:
        out -= equations.moved(shift.joints.T * equations.rows.on)
    if shift.place is not None:
        out += as_complex(shift.place) * equations.rows.arm.normal.conj()
    return pairs(out)
