"""Equilibrium of arm and disc: the equations of a touch solved for link angles, force and modes.

The equations of a touch (`touch_equations`) are solved for the state by Newton's
method, all touches at once; they are so nearly linear that four or five steps reach
rounding error. A touch that does not converge, which happens only where a
joint is about to enter or leave its dead band, is solved in each of the nine combinations of
modes and a consistent one is kept.

**Several equilibria.** Where the line of force passes close to a joint's axis, a joint with backlash
is a toggle: as the tip slides along the disc the force turns away from the axis, so a floating joint
is in unstable equilibrium (stable only where the axis lies inside the touched circle), and for a
narrow range of Q the joint can rest on either flank. Which one it is depends on how it came there.
Without further knowledge the flank is taken to which the force turns an arm that arrives in the
middle of its dead band; where the force was measured, `warm_start` picks the equilibrium next to it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.contact_state import State, free_state, next_modes
from scara_kinetostatic.model.extended_equations import ContactProblem, extended_equations, with_updated_modes
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.lever_arms import Arm, view_arm
from scara_kinetostatic.model.touch_equations import Equations, move_links

_TOLERANCE = 1e-13
"""Residual of a solved touch, m and rad."""
_STEPS = 12
_EXTENDED_STEPS = 25
"""With effects: their derivatives over Q* are left out, so that the last digits come one by one."""
_STEPS_BY_MODES = 9
_BACKLASH_MARGIN = 2.5
"""A lever arm is small if the backlash of the joints, times this factor, could change its sign."""
_TURN_LIMIT = 0.5
"""Largest turn of the force in one step, rad."""


def solve_state(model: ExtendedModel, contact_problem: ContactProblem) -> tuple[State, Mask]:
    """Solve the equations of n touches, tension allowed.

    Returns:
        The state and whether it is solved, (n,); what is not solved is left free, with f = 0.
    """
    start = state = free_state(model.parameters, contact_problem.joints, contact_problem.centers)
    with np.errstate(all='ignore'):
        arm: Arm | None = None
        for _ in range(_EXTENDED_STEPS if model.effects else _STEPS):
            e = extended_equations(model, contact_problem, state, arm)
            solved = _obeys(e, model, state)
            if solved.all():
                return _newton_step(e, state), solved
            state, arm = with_updated_modes(model, contact_problem, _newton_step(e, state))
        todo = ~_is_solved(model, contact_problem, state)
        part, done = _solve_by_modes(model, contact_problem.select(todo))
    state, solved = _put(state, todo, part), _put_mask(~todo, todo, done)
    return start.replace_where(solved, state), solved


def _newton_step(e: Equations, state: State) -> State:
    det = e.normal_f * e.tangent_d - e.normal_d * e.tangent_f
    change_f = -(e.tangent_d * e.normal - e.normal_d * e.tangent) / det
    change_d = -(e.normal_f * e.tangent - e.tangent_f * e.normal) / det
    change_d = np.clip(change_d, -_TURN_LIMIT, _TURN_LIMIT)
    return move_links(e, state, change_f, change_d)


def _is_solved(model: ExtendedModel, contact_problem: ContactProblem, state: State) -> Mask:
    """Whether the state obeys equations and modes, (n,)."""
    return _obeys(extended_equations(model, contact_problem, state), model, state)


def _obeys(e: Equations, model: ExtendedModel, state: State) -> Mask:
    error = np.max(np.abs([e.normal, e.tangent, e.rows.row1, e.rows.row2]), axis=0)
    wanted = next_modes(model.parameters, e.rows.joints, state, e.rows.arm)
    return (error < _TOLERANCE) & (wanted.mode1 == state.mode1) & (wanted.mode2 == state.mode2)


def _solve_by_modes(
    model: ExtendedModel, contact_problem: ContactProblem, warm_start: Floats | None = None
) -> tuple[State, Mask]:
    """Solve in each combination of modes, all at once; keep the first consistent one, or the one nearest to a force."""
    n, (mode1, mode2) = len(contact_problem.joints), np.array(list(product((-1.0, 1.0, 0.0), repeat=2))).T
    every = np.tile(np.arange(n), len(mode1))
    start = free_state(model.parameters, contact_problem.joints, contact_problem.centers)
    state = start.select(every)._replace(mode1=np.repeat(mode1, n), mode2=np.repeat(mode2, n))
    contact_problem = contact_problem.select(every)
    for _ in range(_STEPS_BY_MODES):
        state = _newton_step(extended_equations(model, contact_problem, state), state)
    away = np.zeros(len(every)) if warm_start is None else _distance(state, warm_start[every])
    away = np.where(_is_solved(model, contact_problem, state), away, np.inf).reshape(len(mode1), n)
    best = np.argmin(away, axis=0)
    solved = away[best, np.arange(n)] < np.inf
    return start.replace_where(solved, state.select(best * n + np.arange(n))), solved


def nearest_equilibrium(
    model: ExtendedModel, contact_problem: ContactProblem, state: State, warm_start: Floats
) -> State:
    """Where a joint could rest on either flank, the equilibrium nearest to a force."""
    p, radii = model.parameters, contact_problem.radii
    arm = view_arm(p, *state[:4], contact_problem.gripper)
    # joints that swing through all their backlash slide the tip along the disc, which also turns the force
    slide = (abs(p.g1) + np.abs(p.p1 * state.magnitude * arm.b1)) * np.abs(arm.b1)
    slide += (abs(p.g2) + np.abs(p.p2 * state.magnitude * arm.b2)) * np.abs(arm.b2)
    slide *= _BACKLASH_MARGIN
    toggles = np.abs(arm.lever1) < slide * (1 + np.abs(arm.b1) / radii)
    toggles |= np.abs(arm.lever2) < slide * (1 + np.abs(arm.b2) / radii)
    if not toggles.any():
        return state
    with np.errstate(all='ignore'):
        other, found = _solve_by_modes(model, contact_problem.select(toggles), warm_start[toggles])
        closer = found & (_distance(other, warm_start[toggles]) < _distance(state, warm_start)[toggles])
    return _put(state, toggles, state.select(toggles).replace_where(closer, other))


def _distance(state: State, force: Floats) -> Floats:
    x, y = state.magnitude * np.cos(state.direction), state.magnitude * np.sin(state.direction)
    return np.hypot(x - force[:, 0], y - force[:, 1])


def _put(state: State, where: Mask, part: State) -> State:
    out = State(*(whole.copy() for whole in state))
    for whole, new in zip(out, part, strict=True):
        whole[where] = new
    return out


def _put_mask(mask: Mask, where: Mask, part: Mask) -> Mask:
    out = mask.copy()
    out[where] = part
    return out
