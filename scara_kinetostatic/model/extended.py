"""The equations of a touch with the effects that extend the model: shifts, and what these add to the derivatives."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.equations import Equations, parameter_derivative, touch_equations
from scara_kinetostatic.model.extension import Setting
from scara_kinetostatic.model.law import Shift
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.settling import Settled, renew_modes, settle_links
from scara_kinetostatic.model.state import State
from scara_kinetostatic.model.statics import Arm, Floats

LEAN_STEP = 1e-5
"""Step of the central difference over the lean, rad."""


def extended_equations(parameters: Parameters, setting: Setting, state: State, arm: Arm | None = None) -> Equations:
    """`touch_equations` for a setting that may have effects.

    To first order exact in f and φ; what the effects change over Q* is left out of the derivatives. `arm` saves work
    where that of the state is known.
    """
    joints, centers, radii, gripper, *_ = setting.shifted(parameters, state)
    e = touch_equations(parameters, joints, centers, radii, state, gripper, arm)
    if setting.extension is None:
        return e
    joints_f, place_f, joints_d, place_d = setting.sensitivity(parameters, state)
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


def all_derivatives(parameters: Parameters, setting: Setting, state: State, equations: Equations) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held, the effects' parameters included, (n, 2, 12 + k)."""
    twelve = parameter_derivative(state, equations, setting.gripper)
    if setting.extension is None:
        return twelve
    at = setting.situation(parameters, state)
    for name, shift in setting.extension.by_robot(at).items():
        twelve[:, :, NAMES.index(name)] += shift_column(shift, state, equations)
    shifts = setting.extension.derivative(at)
    columns = [shift_column(shift, state, equations)[:, :, None] for shift in shifts]
    return np.concatenate([twelve, *columns], axis=2)


def lean_derivative(parameters: Parameters, setting: Setting, state: State, equations: Equations) -> Floats:
    """∂h by the lean of each touch's force, (n, 2), m/rad, by central differences."""
    assert setting.extension is not None
    lean = np.zeros_like(state.magnitude) if setting.lean is None else setting.lean
    up, down = (
        setting.extension.shift(setting._replace(lean=lean + sign * LEAN_STEP).situation(parameters, state))
        for sign in (1, -1)
    )
    joints, place = ((a - b) / (2 * LEAN_STEP) for a, b in zip(up, down, strict=True))
    return shift_column(Shift(joints, place), state, equations)


def renewed(parameters: Parameters, setting: Setting, state: State) -> Settled:
    """The state with the modes it calls for."""
    shifted = setting.shifted(parameters, state)
    return renew_modes(parameters, shifted.joints, state, setting.gripper)


def settled(parameters: Parameters, setting: Setting, state: State, frozen: bool = False) -> State:
    """One Newton step of the rows alone, then, unless frozen, the modes that the new link angles call for."""
    shifted = setting.shifted(parameters, state)
    return settle_links(parameters, shifted.joints, state, setting.gripper, frozen).state
