"""The equations of a touch with the effects that extend the model: shifts, and what these add to the derivatives."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.equations import Equations, parameter_derivative, touch_equations
from scara_kinetostatic.model.extension import ContactProblem
from scara_kinetostatic.model.law import Shift
from scara_kinetostatic.model.link_angles import LinkAngles, solve_link_angles, update_modes
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.state import State
from scara_kinetostatic.model.statics import Arm, Floats

OFF_NORMAL_STEP = 1e-5
"""Step of the central difference over the lean, rad."""


def extended_equations(
    parameters: Parameters, contact_problem: ContactProblem, state: State, arm: Arm | None = None
) -> Equations:
    """`touch_equations` for a setting that may have effects.

    To first order exact in f and φ; what the effects change over Q* is left out of the derivatives. `arm` saves work
    where that of the state is known.
    """
    joints, centers, radii, gripper, *_ = contact_problem.shifted(parameters, state)
    e = touch_equations(parameters, joints, centers, radii, state, gripper, arm)
    if contact_problem.extension is None:
        return e
    joints_f, place_f, joints_d, place_d = contact_problem.sensitivity(parameters, state)
    on = np.stack([state.mode1 != 0, state.mode2 != 0])
    (f1, f2), (d1, d2) = on * joints_f.T, on * joints_d.T
    nx, ny = e.rows.arm.nx, e.rows.arm.ny
    return e._replace(
        row1_f=e.row1_f + f1,
        row2_f=e.row2_f + f2,
        row1_d=e.row1_d + d1,
        row2_d=e.row2_d + d2,
        normal_f=e.normal_f - e.g11 * f1 - e.g12 * f2 + place_f[:, 0] * nx + place_f[:, 1] * ny,
        tangent_f=e.tangent_f - e.g21 * f1 - e.g22 * f2 + place_f[:, 1] * nx - place_f[:, 0] * ny,
        normal_d=e.normal_d - e.g11 * d1 - e.g12 * d2 + place_d[:, 0] * nx + place_d[:, 1] * ny,
        tangent_d=e.tangent_d - e.g21 * d1 - e.g22 * d2 + place_d[:, 1] * nx - place_d[:, 0] * ny,
    )


def shift_column(shift: Shift, state: State, equations: Equations) -> Floats:
    """What a shift adds to h along n and t, (n, 2); what the sensor misreads is not in it."""
    e, arm = equations, equations.rows.arm
    out = np.zeros((len(state.magnitude), 2))
    if shift.joints is not None:
        turn1, turn2 = shift.joints[:, 0] * (state.mode1 != 0), shift.joints[:, 1] * (state.mode2 != 0)
        out[:, 0] -= e.g11 * turn1 + e.g12 * turn2
        out[:, 1] -= e.g21 * turn1 + e.g22 * turn2
    if shift.place is not None:
        x, y = shift.place.T
        out[:, 0] += x * arm.nx + y * arm.ny
        out[:, 1] += y * arm.nx - x * arm.ny
    return out


def all_derivatives(
    parameters: Parameters, contact_problem: ContactProblem, state: State, equations: Equations
) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held, the effects' parameters included, (n, 2, 12 + k)."""
    base = parameter_derivative(state, equations, contact_problem.gripper)
    if contact_problem.extension is None:
        return base
    at = contact_problem.touch_state(parameters, state)
    for name, shift in contact_problem.extension.by_robot(at).items():
        base[:, :, NAMES.index(name)] += shift_column(shift, state, equations)
    shifts = contact_problem.extension.derivative(at)
    columns = [shift_column(shift, state, equations)[:, :, None] for shift in shifts]
    return np.concatenate([base, *columns], axis=2)


def off_normal_derivative(
    parameters: Parameters, contact_problem: ContactProblem, state: State, equations: Equations
) -> Floats:
    """∂h by the lean of each touch's force, (n, 2), m/rad, by central differences."""
    assert contact_problem.extension is not None
    off_normal = np.zeros_like(state.magnitude) if contact_problem.off_normal is None else contact_problem.off_normal
    up, down = (
        contact_problem.extension.shift(
            contact_problem._replace(off_normal=off_normal + sign * OFF_NORMAL_STEP).touch_state(parameters, state)
        )
        for sign in (1, -1)
    )
    joints, place = ((a - b) / (2 * OFF_NORMAL_STEP) for a, b in zip(up, down, strict=True))
    return shift_column(Shift(joints, place), state, equations)


def with_updated_modes(parameters: Parameters, contact_problem: ContactProblem, state: State) -> LinkAngles:
    """The state with the modes it calls for."""
    shifted = contact_problem.shifted(parameters, state)
    return update_modes(parameters, shifted.joints, state, contact_problem.gripper)


def extended_link_angles(
    parameters: Parameters, contact_problem: ContactProblem, state: State, frozen: bool = False
) -> State:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for."""
    shifted = contact_problem.shifted(parameters, state)
    return solve_link_angles(parameters, shifted.joints, state, contact_problem.gripper, frozen).state
