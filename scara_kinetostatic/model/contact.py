"""The equations of a touch, everything else is built on these; the contact A(Q, L̄) (9) (11) that they give.

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

**Solution.** With the shifts of the effects, these equations are solved for the state by Newton's method, all touches
at once; they are so nearly linear that four or five steps reach rounding error. A touch that does not converge, which
happens only where a joint is about to enter or leave its dead band, is solved in each of the nine combinations of modes
and a consistent one is kept.

**Several equilibria.** Where the line of force passes close to a joint's axis, a joint with backlash is a toggle: as
the tip slides along the disc the force turns away from the axis, so a floating joint is in unstable equilibrium (stable
only where the axis lies inside the touched circle), and for a narrow range of Q the joint can rest on either flank.
Which one it is depends on how it came there. Without further knowledge the flank is taken to which the force turns an
arm that arrives in the middle of its dead band; where the force was measured, `warm_start` picks the equilibrium next
to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Complexes, Floats, Mask, as_complex, pairs, pick, put
from scara_kinetostatic.model.extended_model import (
    ExtendedModel,
    ForceDependence,
    Shift,
    TouchMetadata,
    TouchState,
    as_model,
    sum_of_shifts,
)
from scara_kinetostatic.model.flanks import LEAST_FORCE, Arm, State, keep_flanks, next_modes, view_arm
from scara_kinetostatic.model.gravity import Pull, pull_of
from scara_kinetostatic.model.joint_law import deflection, inverse_of_derivative
from scara_kinetostatic.model.kinematics import GripperSign, LoadedJoints, component_by_parameters, forward
from scara_kinetostatic.model.outline import EDGE_RADIUS
from scara_kinetostatic.model.parameters import MILLI, NAMES, THETA1, THETA2, Parameters


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


def free_state(parameters: Parameters, joints: Floats, centers: Floats, edges: Edges | None = None) -> State:
    """A start for n touches: links at the measured angles, no force, pointing from tip to disc."""

    def direction_at(links: Floats) -> Floats:
        return np.asarray(np.arctan2(*inward(centers - forward(parameters, links), edges).T[::-1]))

    direction = direction_at(joints)
    still, (q1, q2) = np.zeros(len(direction)), joints.T
    state = State(q1, q2, still, direction, still, still)
    mode1, mode2 = np.where(view_arm(parameters, state).lever < 0, -1.0, 1.0)
    state = state._replace(mode1=mode1, mode2=mode2)
    if parameters.has_gravity:  # the arm hangs in its joints
        for _ in range(4):
            state, _ = step_links(parameters, joints, state)
        state = state._replace(direction=direction_at(np.array(state[:2]).T))
    return state


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


_ANGLE_STEP = 1e-5
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
        (ForceDependence.DIRECTION, 'direction', np.full(len(by_magnitude), _ANGLE_STEP), None),
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


def all_derivatives(model: ExtendedModel, problem: ContactProblem, state: State, equations: Equations) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held, and by the parameters of the effects behind, (n, 2, 12 + k)."""
    at = equations.touch_state
    base = parameter_derivative(model.parameters, state, equations, problem.gripper)
    if at is None:
        return base
    for name, shift in model.shift_by_robot(at).items():
        base[:, :, NAMES.index(name)] += shift_column(shift, equations)
    columns = list(base.transpose(2, 1, 0))
    for effect, values in model.pairs:
        for shift in effect.derivative(at, values):
            columns.append(shift_column(shift, equations).T)
    return np.array(columns).transpose(2, 1, 0)


def off_normal_derivative(model: ExtendedModel, equations: Equations) -> Floats:
    """∂h by the off-normal angle of each touch's force, (n, 2), m/rad, by central differences; there are effects."""
    at = equations.touch_state
    assert at is not None
    up, down = (at._replace(off_normal=at.off_normal + change) for change in (_ANGLE_STEP, -_ANGLE_STEP))
    return shift_column(model.difference(up, down, 2 * _ANGLE_STEP, ForceDependence.DIRECTION), equations)


def solve_links(
    model: ExtendedModel, problem: ContactProblem, state: State, frozen: bool = False, again: bool = False
) -> tuple[State, Arm]:
    """Link angles and modes that go with a force: one Newton step, and with `again` a second one where it changes them.

    Returns:
        The state, and the arm there.
    """
    p, first = model.parameters, state
    arm = view_arm(p, state)
    for _ in range(1 + again):
        flanks = state
        state, arm = step_links(p, problem.shifted(model, state, arm).joints, state, frozen, arm)
        state = keep_flanks(p, state, flanks, arm)
        if not model.effects and (frozen or ((state.mode1 == first.mode1) & (state.mode2 == first.mode2)).all()):
            break
    return state, arm


def solve_state(model: ExtendedModel, problem: ContactProblem) -> tuple[State, Mask]:
    """Solve the equations of n touches, tension allowed.

    Returns:
        The state and whether it is solved, (n,); what is not solved is left free, with f = 0.
    """
    start = state = free_state(model.parameters, problem.joints, problem.centers, problem.edges)
    with np.errstate(all='ignore'):
        arm: Arm | None = None
        # with effects more steps: their derivatives over Q* are left out, so that the last digits come one by one
        for _ in range(25 if model.effects else 12):
            e = extended_equations(model, problem, state, arm)
            solved = _obeys(e, model, state)
            if solved.all():
                return _newton_step(e, state), solved
            state = _newton_step(e, state)
            arm = view_arm(model.parameters, state)
            state = next_modes(model.parameters, problem.shifted(model, state, arm).joints, state, arm)
        todo = ~_is_solved(model, problem, state)
        part, done = _solve_by_modes(model, pick(problem, todo))
    solved = ~todo
    solved[todo] = done
    return start.replace_where(solved, put(state, (todo, part))), solved


def _newton_step(e: Equations, state: State) -> State:
    (h_f, h_d), (row_f, row_d) = e.h_by, e.rows_by
    det = (h_f.conj() * h_d).imag
    change_f, change_d = -(e.h.conj() * h_d).imag / det, -(h_f.conj() * e.h).imag / det
    # so far a step may turn the direction of the force, rad
    change_d = np.clip(change_d, -0.5, 0.5)
    state = State(*state[:2], state.magnitude + change_f, state.direction + change_d, *state[4:])
    return e.rows.solved(state, e.rows.row + row_f * change_f + row_d * change_d)


def _is_solved(model: ExtendedModel, problem: ContactProblem, state: State) -> Mask:
    """Whether the state obeys equations and modes, (n,)."""
    return _obeys(extended_equations(model, problem, state), model, state)


def _obeys(e: Equations, model: ExtendedModel, state: State) -> Mask:
    error = np.max(np.abs([e.h.real, e.h.imag, *e.rows.row]), axis=0)
    wanted = next_modes(model.parameters, e.rows.joints, state, e.rows.arm)
    # residual of a solved touch, m and rad
    return (error < 1e-13) & (wanted.mode1 == state.mode1) & (wanted.mode2 == state.mode2)


def _solve_by_modes(
    model: ExtendedModel, problem: ContactProblem, warm_start: Floats | None = None
) -> tuple[State, Mask]:
    """Solve in each combination of modes, all at once; keep the first consistent one, or the one nearest to a force."""
    n, (mode1, mode2) = len(problem.joints), np.array(list(product((-1.0, 1.0, 0.0), repeat=2))).T
    every = np.tile(np.arange(n), len(mode1))
    start = free_state(model.parameters, problem.joints, problem.centers, problem.edges)
    state = pick(start, every)._replace(mode1=np.repeat(mode1, n), mode2=np.repeat(mode2, n))
    problem = pick(problem, every)
    for _ in range(9):
        state = _newton_step(extended_equations(model, problem, state), state)
    away = np.zeros(len(every)) if warm_start is None else _distance(state, warm_start[every])
    away = np.where(_is_solved(model, problem, state), away, np.inf).reshape(len(mode1), n)
    best = np.argmin(away, axis=0)
    solved = away[best, np.arange(n)] < np.inf
    return start.replace_where(solved, pick(state, best * n + np.arange(n))), solved


def nearest_equilibrium(model: ExtendedModel, problem: ContactProblem, state: State, warm_start: Floats) -> State:
    """Where a joint could rest on either flank, the equilibrium nearest to a force."""
    p, radii = model.parameters, problem.radii
    arm = view_arm(p, state)
    # joints that swing through all their backlash slide the tip along the disc, which also turns the force
    b = np.abs(arm.reach.real)
    slide = ((np.abs(p.joint_backlashes) + np.abs(p.joint_compliances * state.magnitude) * b) * b).sum(axis=0)
    # a lever arm is small if the backlash of the joints, times 2.5, could change its sign
    lever = arm.lever
    if (pull := pull_of(p, arm.link1, arm.link2)) is not None:
        lever = lever + np.array(pull.torque) / np.maximum(np.abs(state.magnitude), 1.0)
    toggles = (np.abs(lever) < 2.5 * slide * (1 + b / np.abs(radii))).any(axis=0)
    if not toggles.any():
        return state
    with np.errstate(all='ignore'):
        other, found = _solve_by_modes(model, pick(problem, toggles), warm_start[toggles])
        closer = found & (_distance(other, warm_start[toggles]) < _distance(state, warm_start)[toggles])
    return put(state, (toggles, pick(state, toggles).replace_where(closer, other)))


def _distance(state: State, force: Floats) -> Floats:
    x, y = state.magnitude * np.cos(state.direction), state.magnitude * np.sin(state.direction)
    return np.hypot(x - force[:, 0], y - force[:, 1])


class Contact(NamedTuple):
    """The contact of n touches with their discs.

    Attributes:
        problem: what was given.
        force: F on the object, base frame, (n, 2), N; zero without contact.
        magnitude: f, (n,), N; negative where the tip would have to pull
            (only with `tension`).
        tip: S, (n, 2), m.
        links: Q*, (n, 2), rad.
        state: the solution, with the modes of both joints.
        solved: whether Newton's method converged, (n,).
    """

    problem: ContactProblem
    force: Floats
    magnitude: Floats
    tip: Floats
    links: Floats
    state: State
    solved: Mask


def contact(
    model: ExtendedModel | Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper: GripperSign = GripperSign.PHYSICAL,
    tension: bool = False,
    warm_start: ArrayLike | None = None,
    metadata: TouchMetadata | None = None,
    off_normal: Floats | None = None,
    tangents: Floats | None = None,
    edges: Edges | None = None,
) -> Contact:
    """A(Q, L̄) for touches whose disc is known.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper: the form of (7).
        tension: let the tip pull at the disc where it does not reach it (a smooth
            continuation for fitting), instead of no force as (9) has it.
        warm_start: a force per touch, (n, 2), N; where there are several equilibria, the one
            closest to it is taken.
        metadata: what effects need to know of each touch; by default `TouchMetadata.plain`.
        off_normal: off-normal angle of the force in each touch, (n,), rad, where an effect lets it differ from touch
            to touch.
        tangents: unit vectors along the straight edges that are touched, (n, 2), zero on arcs; None for arcs alone.
        edges: the same with what displaces them, in place of `tangents`.

    Returns:
        Force, tip and link angles. Without contact the force is zero, the joints
        are in the middle of their dead bands and the tip is at H(L, Q).
    """
    model = as_model(model)
    parameters = model.parameters
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    centers = np.broadcast_to(np.asarray(centers, dtype=float), joints.shape)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), joints.shape[:1])
    metadata = TouchMetadata.plain(len(joints)) if metadata is None and model.effects else metadata
    edges = edges or Edges.of(tangents, radii)
    problem = ContactProblem(joints, centers, radii, gripper, metadata, off_normal, edges)
    state, solved = solve_state(model, problem)
    if warm_start is not None:
        state = nearest_equilibrium(model, problem, state, np.asarray(warm_start))
    if not tension:
        shifted = problem.shifted(model, state)
        free = free_state(parameters, shifted.joints, shifted.centers, shifted.edges)
        touching = solved & (state.magnitude > 0)
        if gripper is GripperSign.PHYSICAL:
            touching &= _reaches(parameters, free, shifted)
        zero = free
        if not parameters.has_gravity:
            zero = free._replace(mode1=np.zeros_like(free.mode1), mode2=np.zeros_like(free.mode2))
        state = zero.replace_where(touching, state)
    discs = problem.centers
    if model.effects:
        discs = discs - model.object_shift(problem.touch_state(parameters, state))
    unit = np.stack([np.cos(state.direction), np.sin(state.direction)], axis=-1)
    links = np.stack([state.link1, state.link2], axis=-1)
    rigid = forward(parameters, links)
    surface = discs - problem.radii[:, None] * unit
    if problem.edges is not None:
        tangent = pairs(problem.edges.tangent)
        surface = surface + ((rigid - surface) * tangent).sum(axis=1)[:, None] * tangent
    tip = np.where((state.magnitude != 0)[:, None], surface, rigid)
    return Contact(problem, state.magnitude[:, None] * unit, state.magnitude, tip, links, state, solved)


def _reaches(parameters: Parameters, free: State, problem: ContactProblem) -> Mask:
    """Whether the rigid tip H(L, Q) is inside the object, (n,): only then can there be a force (section 4.2).

    A millimetre outside allows for backlashes that noise has made negative.
    """
    tip = forward(parameters, np.stack([free.link1, free.link2], axis=-1))
    off, edges = as_complex(tip - problem.centers), problem.edges
    away = np.abs(off)
    if edges is not None:
        away = np.where(edges.tangent == 0, away * edges.sense, (off * 1j * edges.tangent.conj()).real)
    return np.asarray(away < problem.radii + MILLI)


class ContactDerivatives(NamedTuple):
    """Derivatives of A(Q, L̄) at n touches; zero without contact.

    Attributes:
        joints: A_Q, (n, 2, 2), N/rad.
        parameters: A_L̄ = J_L̄ (12), (n, 2, 12 + k), N per unit of the parameter, in the order of `ExtendedModel.names`.
    """

    joints: Floats
    parameters: Floats


def contact_derivatives(model: ExtendedModel | Parameters, found: Contact) -> ContactDerivatives:
    """∂A/∂Q and ∂A/∂L̄ by the implicit function theorem: h_F dF = -h_Q dQ - h_L̄ dL̄.

    Args:
        model: the extended model, or L̄ of the base model alone.
        found: what `contact` returned for it.
    """
    model, state, problem = as_model(model), found.state, found.problem._replace(off_normal=None)
    loaded = (state.magnitude != 0).astype(float)
    state = state._replace(
        mode1=np.where(loaded == 0, 1, state.mode1), mode2=np.where(loaded == 0, 1, state.mode2)
    )  # an unloaded touch has derivative zero; any flank keeps the algebra regular
    e = extended_equations(model, problem, state)
    h_l = all_derivatives(model, problem, state, e)
    (h_f, h_d), n = e.h_by, e.rows.arm.normal
    with np.errstate(divide='ignore', invalid='ignore'):
        det = (h_f.conj() * h_d).imag
        # the force per metre of residual along n and along t, (n, 2, 2)
        columns = [
            (n * part_f + 1j * state.magnitude * n * part_d) / det
            for part_f, part_d in ((h_d.imag, -h_f.imag), (-h_d.real, h_f.real))
        ]
    stiffness = np.stack([pairs(column) for column in columns], axis=-1)
    stiffness = np.where(loaded[:, None, None] > 0, -stiffness, 0.0)
    h_q = h_l[:, :, [THETA1, THETA2]]
    return ContactDerivatives(stiffness @ h_q, stiffness @ h_l)
