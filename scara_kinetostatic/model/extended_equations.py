"""The equations of a touch with the effects of an extended model: their shifts, and their part of the derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.effect_law import Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.joint_equations import LinkAngles, solve_link_angles, update_modes
from scara_kinetostatic.model.lever_arms import Arm, view_arm
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch_equations import Equations, parameter_derivative, touch_equations

_FORCE_STEP = 1e-4
"""Step of the central difference over the force, as a part of it (of 1 N at least)."""
_ANGLE_STEP = 1e-5
"""Step of the central difference over an angle, rad."""


class ContactProblem(NamedTuple):
    """n touches as the equations take them, besides the model and the state.

    Attributes:
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper: the form of (7).
        metadata: of the touches; effects need it, the base model does not.
        off_normal: off-normal angle of the force in each touch, (n,), rad; None for zero.
    """

    joints: Floats
    centers: Floats
    radii: Floats
    gripper: Gripper
    metadata: TouchMetadata | None = None
    off_normal: Floats | None = None

    def select(self, which: Mask | Indices) -> ContactProblem:
        """The touches that a mask or an array of positions picks."""
        metadata = None if self.metadata is None else self.metadata.select(which)
        off_normal = None if self.off_normal is None else self.off_normal[which]
        return ContactProblem(
            self.joints[which], self.centers[which], self.radii[which], self.gripper, metadata, off_normal
        )

    def touch_state(self, parameters: Parameters, state: State) -> TouchState:
        """The touches at a state, as effects take them."""
        assert self.metadata is not None
        arm = view_arm(parameters, *state[:4], self.gripper)
        f, normal = state.magnitude, np.stack([arm.nx, arm.ny], axis=-1)
        return TouchState(
            parameters=parameters,
            joints=self.joints,
            force=f[:, None] * normal,
            magnitude=f,
            normal=normal,
            torques=np.stack([f * arm.lever1, f * arm.lever2], axis=-1),
            link1=np.stack([arm.ux, arm.uy], axis=-1),
            link2=np.stack([arm.vx, arm.vy], axis=-1),
            centers=self.centers,
            radii=self.radii,
            metadata=self.metadata,
            off_normal=np.zeros_like(f) if self.off_normal is None else self.off_normal,
        )

    def shifted(self, model: ExtendedModel, state: State) -> ContactProblem:
        """The same touches for the base model: Q - δ and S_c - d instead of Q and S_c."""
        if not model.effects:
            return self
        joints, place = model.shift(self.touch_state(model.parameters, state))
        return self._replace(joints=self.joints - joints, centers=self.centers - place, off_normal=None)


def _shift_by_force(
    model: ExtendedModel, contact_problem: ContactProblem, state: State
) -> tuple[Floats, Floats, Floats, Floats]:
    """The derivatives of δ and d by f and φ: δ_f, d_f, δ_φ, d_φ, (n, 2) each, by central differences."""
    parts: list[Floats] = []
    step = _FORCE_STEP * np.maximum(np.abs(state.magnitude), 1.0)
    for name, size in (('magnitude', step), ('direction', np.full_like(step, _ANGLE_STEP))):
        value = getattr(state, name)
        up, down = (
            model.shift(contact_problem.touch_state(model.parameters, state._replace(**{name: value + sign * size})))
            for sign in (1, -1)
        )
        parts += [(a - b) / (2 * size[:, None]) for a, b in zip(up, down, strict=True)]
    return parts[0], parts[1], parts[2], parts[3]


def extended_equations(
    model: ExtendedModel, contact_problem: ContactProblem, state: State, arm: Arm | None = None
) -> Equations:
    """`touch_equations` of an extended model.

    The derivatives by f and φ are exact to first order; those by Q* leave out that δ and d depend on it.

    Args:
        model: the model; without effects the equations are those of the base model.
        contact_problem: the touches.
        state: where to evaluate.
        arm: the arm at the state, where it is known.
    """
    joints, centers, radii, gripper, *_ = contact_problem.shifted(model, state)
    e = touch_equations(model.parameters, joints, centers, radii, state, gripper, arm)
    if not model.effects:
        return e
    joints_f, place_f, joints_d, place_d = _shift_by_force(model, contact_problem, state)
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
    """What a shift adds to h along n and t, (n, 2), m."""
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
    model: ExtendedModel, contact_problem: ContactProblem, state: State, equations: Equations
) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held, and by the parameters of the effects behind, (n, 2, 12 + k)."""
    base = parameter_derivative(state, equations, contact_problem.gripper)
    if not model.effects:
        return base
    at = contact_problem.touch_state(model.parameters, state)
    for name, shift in model.shift_by_robot(at).items():
        base[:, :, NAMES.index(name)] += shift_column(shift, state, equations)
    columns = [shift_column(shift, state, equations)[:, :, None] for shift in model.shift_by_effects(at)]
    return np.concatenate([base, *columns], axis=2)


def off_normal_derivative(
    model: ExtendedModel, contact_problem: ContactProblem, state: State, equations: Equations
) -> Floats:
    """∂h by the off-normal angle of each touch's force, (n, 2), m/rad, by central differences."""
    off_normal = np.zeros_like(state.magnitude) if contact_problem.off_normal is None else contact_problem.off_normal
    up, down = (
        model.shift(
            contact_problem._replace(off_normal=off_normal + sign * _ANGLE_STEP).touch_state(model.parameters, state)
        )
        for sign in (1, -1)
    )
    joints, place = ((a - b) / (2 * _ANGLE_STEP) for a, b in zip(up, down, strict=True))
    return shift_column(Shift(joints, place), state, equations)


def with_updated_modes(model: ExtendedModel, contact_problem: ContactProblem, state: State) -> LinkAngles:
    """`update_modes` of an extended model."""
    shifted = contact_problem.shifted(model, state)
    return update_modes(model.parameters, shifted.joints, state, contact_problem.gripper)


def extended_link_angles(
    model: ExtendedModel, contact_problem: ContactProblem, state: State, frozen: bool = False
) -> State:
    """`solve_link_angles` of an extended model, one step."""
    shifted = contact_problem.shifted(model, state)
    return solve_link_angles(model.parameters, shifted.joints, state, contact_problem.gripper, frozen).state
