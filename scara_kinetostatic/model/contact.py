"""The contact of the tip with a disc: A(Q, L̄) (9) (11), its derivatives, the unilateral rule.

The equations of a touch (`equations`) are solved for the state by Newton's
method, all touches at once; they are so nearly linear that four or five steps reach
rounding error. A touch that does not settle, which happens only where a
joint is about to enter or leave its dead band, is solved in each of the nine combinations of
modes and a consistent one is kept.

**Several equilibria.** Where the line of force passes close to a joint's axis, a joint with backlash
is a toggle: as the tip slides along the disc the force turns away from the axis, so a floating joint
is in unstable equilibrium (stable only where the axis lies inside the touched circle), and for a
narrow range of Q the joint can rest on either flank. Which one it is depends on how it came there.
Without further knowledge the flank is taken to which the force turns an arm that arrives in the
middle of its dead band; where the force was measured, `near` picks the equilibrium next to it.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.equations import (
    Equations,
    State,
    free_state,
    move_links,
    next_modes,
    parameter_derivative,
    touch_equations,
)
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.statics import view_arm

Floats = NDArray[np.float64]

TOLERANCE = 1e-13
"""Residual of a solved touch, m and rad."""
STEPS = 12
TURN_LIMIT = 0.5
"""Largest turn of the force in one step, rad."""


class Contact(NamedTuple):
    """The contact of n touches with their discs.

    Attributes:
        force: F on the object, base frame, (n, 2), N; zero without contact.
        magnitude: f, (n,), N; negative where the tip would have to pull
            (only with `tension`).
        tip: S, (n, 2), m.
        links: Q*, (n, 2), rad.
        state: the solution, with the modes of both joints.
        solved: whether Newton's method converged, (n,).
    """

    force: Floats
    magnitude: Floats
    tip: Floats
    links: Floats
    state: State
    solved: NDArray[np.bool_]


def contact(
    parameters: Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper_sign: GripperSign = GripperSign.PHYSICAL,
    tension: bool = False,
    near: ArrayLike | None = None,
) -> Contact:
    """A(Q, L̄) for touches whose disc is known.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper_sign: sign of (7).
        tension: let the tip pull at the disc where it does not reach it (a smooth
            continuation for fitting), instead of no force as (9) has it.
        near: a force per touch, (n, 2), N; where there are several equilibria, the one
            closest to it is taken.

    Returns:
        Force, tip and link angles. Without contact the force is zero, the joints
        are in the middle of their dead bands and the tip is at H(L, Q).
    """
    joints, centers = np.atleast_2d(np.asarray(joints, dtype=float)), np.asarray(centers, dtype=float)
    centers = np.broadcast_to(centers, joints.shape)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), joints.shape[:1])
    state, solved = solve_state(parameters, joints, centers, radii, gripper_sign)
    if near is not None:
        state = _nearest_equilibrium(parameters, joints, centers, radii, gripper_sign, state, np.asarray(near))
    if not tension:
        touching = solved & (state.magnitude > 0)
        free = free_state(parameters, joints, centers)
        zero = free._replace(mode1=np.zeros_like(free.mode1), mode2=np.zeros_like(free.mode2))
        state = State(*(np.where(touching, loaded, idle) for loaded, idle in zip(state, zero, strict=True)))
    return _as_contact(parameters, centers, radii, gripper_sign, state, solved)


def _as_contact(
    parameters: Parameters, centers: Floats, radii: Floats, sign: GripperSign, state: State, solved: NDArray[np.bool_]
) -> Contact:
    unit = np.stack([np.cos(state.direction), np.sin(state.direction)], axis=-1)
    links = np.stack([state.link1, state.link2], axis=-1)
    first = state.link1 + parameters.theta1
    second = first + state.link2 + parameters.theta2
    rigid = np.stack(
        [
            parameters.x0 + parameters.l1 * np.cos(first) + parameters.l2 * np.cos(second),
            parameters.y0 + parameters.l1 * np.sin(first) + parameters.l2 * np.sin(second),
        ],
        axis=-1,
    )
    loaded = (state.magnitude != 0)[:, None]
    tip = np.where(loaded, centers - radii[:, None] * unit, rigid)
    return Contact(state.magnitude[:, None] * unit, state.magnitude, tip, links, state, solved)


def contact_force(
    parameters: Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    gripper_sign: GripperSign = GripperSign.PHYSICAL,
) -> Floats:
    """A(Q, L̄) over several discs: the force on the disc that the arm presses, zero where it presses none.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centres of all discs, (m, 2), m.
        radii: their radii, (m,), m.
        gripper_sign: sign of (7).

    Returns:
        F on the object, base frame, (n, 2), N. Discs do not overlap, so at most one is pressed.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    best = contact(parameters, joints, np.asarray(centers)[0], np.asarray(radii)[0], gripper_sign)
    force, magnitude = best.force, best.magnitude
    for center, radius in zip(np.asarray(centers)[1:], np.asarray(radii)[1:], strict=True):
        other = contact(parameters, joints, center, radius, gripper_sign)
        stronger = other.magnitude > magnitude
        force = np.where(stronger[:, None], other.force, force)
        magnitude = np.where(stronger, other.magnitude, magnitude)
    return force


class ContactDerivatives(NamedTuple):
    """Derivatives of A(Q, L̄) at n touches; zero without contact.

    Attributes:
        joints: A_Q, (n, 2, 2), N/rad.
        parameters: A_L̄ = J_L̄ (12), (n, 2, 12), N per unit of the parameter.
    """

    joints: Floats
    parameters: Floats


def contact_derivatives(
    parameters: Parameters,
    joints: ArrayLike,
    centers: ArrayLike,
    radii: ArrayLike,
    found: Contact,
    gripper_sign: GripperSign = GripperSign.PHYSICAL,
) -> ContactDerivatives:
    """∂A/∂Q and ∂A/∂L̄ by the implicit function theorem: h_F dF = -h_Q dQ - h_L̄ dL̄.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        found: what `contact` returned for the same arguments.
        gripper_sign: sign of (7).
    """
    joints, centers = np.atleast_2d(np.asarray(joints, dtype=float)), np.asarray(centers, dtype=float)
    centers = np.broadcast_to(centers, joints.shape)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), joints.shape[:1])
    state = found.state
    loaded = (state.magnitude != 0).astype(float)
    state = state._replace(
        mode1=np.where(loaded == 0, 1, state.mode1), mode2=np.where(loaded == 0, 1, state.mode2)
    )  # an unloaded touch has derivative zero; any flank keeps the algebra regular
    e = touch_equations(parameters, joints, centers, radii, state, gripper_sign)
    h_l = parameter_derivative(parameters, state, e, gripper_sign)
    det = e.normal_f * e.tangent_d - e.normal_d * e.tangent_f
    with np.errstate(divide='ignore', invalid='ignore'):
        f_h = np.stack([e.tangent_d, -e.normal_d], axis=-1) / det[:, None]
        d_h = np.stack([-e.tangent_f, e.normal_f], axis=-1) / det[:, None]
    n = np.stack([e.arm.nx, e.arm.ny], axis=-1)
    t = np.stack([-e.arm.ny, e.arm.nx], axis=-1)
    # the force per metre of residual, (n, 2, 2)
    stiffness = n[:, :, None] * f_h[:, None, :] + (state.magnitude[:, None] * t)[:, :, None] * d_h[:, None, :]
    stiffness = np.where(loaded[:, None, None] > 0, -stiffness, 0.0)
    h_q = h_l[:, :, [2, 4]]
    return ContactDerivatives(stiffness @ h_q, stiffness @ h_l)


def solve_state(
    parameters: Parameters, joints: Floats, centers: Floats, radii: Floats, sign: GripperSign
) -> tuple[State, NDArray[np.bool_]]:
    """Solve the equations of n touches, tension allowed, for touches within reach of their discs.

    A touch whose tip is so far outside the disc that no play in the joints brings it into
    contact is left at its free state, with f = 0.

    Returns:
        The state and whether it is solved, (n,).
    """
    start = free_state(parameters, joints, centers)
    state = start
    p = parameters
    with np.errstate(all='ignore'):
        for _ in range(STEPS):
            e = touch_equations(p, joints, centers, radii, state, sign)
            state = next_modes(p, joints, _newton_step(e, state))
        solved = is_solved(p, joints, centers, radii, state, sign)
        if not solved.all():
            todo = ~solved
            part, done = _solve_by_modes(p, joints[todo], centers[todo], radii[todo], sign)
            state = State(*(_insert(whole, todo, new) for whole, new in zip(state, part, strict=True)))
            solved = _insert(solved, todo, done)
    return State(*(np.where(solved, a, b) for a, b in zip(state, start, strict=True))), solved


def _newton_step(e: Equations, state: State) -> State:
    det = e.normal_f * e.tangent_d - e.normal_d * e.tangent_f
    change_f = -(e.tangent_d * e.normal - e.normal_d * e.tangent) / det
    change_d = -(e.normal_f * e.tangent - e.tangent_f * e.normal) / det
    change_d = np.clip(change_d, -TURN_LIMIT, TURN_LIMIT)
    return move_links(e, state, change_f, change_d)


def is_solved(
    parameters: Parameters, joints: Floats, centers: Floats, radii: Floats, state: State, sign: GripperSign
) -> NDArray[np.bool_]:
    """Whether the state obeys equations and modes, (n,)."""
    e = touch_equations(parameters, joints, centers, radii, state, sign)
    error = np.max(np.abs([e.normal, e.tangent, e.row1, e.row2]), axis=0)
    wanted = next_modes(parameters, joints, state)
    return (error < TOLERANCE) & (wanted.mode1 == state.mode1) & (wanted.mode2 == state.mode2)


def _solve_by_modes(
    parameters: Parameters,
    joints: Floats,
    centers: Floats,
    radii: Floats,
    sign: GripperSign,
    near: Floats | None = None,
) -> tuple[State, NDArray[np.bool_]]:
    """Solve in each combination of modes; keep the first consistent one, or the one nearest to a force."""
    best = start = free_state(parameters, joints, centers)
    solved, distance = np.zeros(len(joints), dtype=bool), np.full(len(joints), np.inf)
    for mode1, mode2 in product((-1, 1, 0), repeat=2):
        state = start._replace(mode1=np.full_like(start.mode1, mode1), mode2=np.full_like(start.mode2, mode2))
        for _ in range(STEPS):
            state = _newton_step(touch_equations(parameters, joints, centers, radii, state, sign), state)
        away = np.zeros(len(joints)) if near is None else _distance(state, near)
        better = is_solved(parameters, joints, centers, radii, state, sign) & (away < distance)
        best = State(*(np.where(better, new, old) for new, old in zip(state, best, strict=True)))
        distance = np.where(better, away, distance)
        solved |= better
    return best, solved


def _nearest_equilibrium(
    parameters: Parameters,
    joints: Floats,
    centers: Floats,
    radii: Floats,
    sign: GripperSign,
    state: State,
    near: Floats,
) -> State:
    """Where a joint could rest on either flank, the equilibrium nearest to a force."""
    p = parameters
    arm = view_arm(p, state.link1, state.link2, state.direction)
    swing1 = abs(p.g1) + np.abs(p.p1 * state.magnitude * arm.b1)
    swing2 = abs(p.g2) + np.abs(p.p2 * state.magnitude * arm.b2)
    room = 4 * (swing1 + swing2) * (p.l1 + p.l2)
    toggles = (np.abs(arm.a1) < room) | (np.abs(arm.a2) < room)
    if not toggles.any():
        return state
    with np.errstate(all='ignore'):
        other, found = _solve_by_modes(p, joints[toggles], centers[toggles], radii[toggles], sign, near[toggles])
        closer = found & (_distance(other, near[toggles]) < _distance(state, near)[toggles])
    where = np.flatnonzero(toggles)[closer]
    return State(*(_insert(old, where, new[closer]) for old, new in zip(state, other, strict=True)))


def _distance(state: State, force: Floats) -> Floats:
    x, y = state.magnitude * np.cos(state.direction), state.magnitude * np.sin(state.direction)
    return np.hypot(x - force[:, 0], y - force[:, 1])


def _insert(whole: NDArray, where: NDArray, part: NDArray) -> NDArray:
    out = whole.copy()
    out[where] = part
    return out
