"""The contact force A(Q, L̄) (9) (11) that the model predicts for touches.

**Solution.** With the shifts of the effects, the equations of a touch (`touch_equations`) are solved for the state by
Newton's method, all touches at once; they are so nearly linear that four or five steps reach rounding error. A touch
that does not converge, which happens only where a joint is about to enter or leave its dead band, is solved in each of
the nine combinations of modes and a consistent one is kept.

**Several equilibria.** Where the line of force passes close to a joint's axis, a joint with backlash is a toggle: as
the tip slides along the disc the force turns away from the axis, so a floating joint is in unstable equilibrium (stable
only where the axis lies inside the touched circle), and for a narrow range of Q the joint can rest on either flank.
Which one it is depends on how it came there. Without further knowledge the flank is taken to which the force turns an
arm that arrives in the middle of its dead band; where the force was measured, `warm_start` picks the equilibrium next
to it.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats, Mask, as_complex, pairs, pick, put
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, as_model
from scara_kinetostatic.model.flanks import Arm, State, keep_flanks, next_modes, view_arm
from scara_kinetostatic.model.gravity import pull_of
from scara_kinetostatic.model.kinematics import GripperSign, forward
from scara_kinetostatic.model.parameters import MILLI, Parameters
from scara_kinetostatic.model.touch_equations import (
    ContactProblem,
    Edges,
    Equations,
    extended_equations,
    inward,
    step_links,
)


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
