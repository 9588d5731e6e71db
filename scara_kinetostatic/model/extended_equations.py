"""The equations of a touch with the effects of an extended model: their shifts, and their part of the derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.contact_state import State, next_modes
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.joint_equations import LinkAngles, solve_link_angles
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

    def touch_state(self, parameters: Parameters, state: State, arm: Arm | None = None) -> TouchState:
        """The touches at a state, as effects take them; `arm` saves work where that of the state is known."""
        assert self.metadata is not None
        arm = view_arm(parameters, *state[:4], self.gripper) if arm is None else arm
        f, normal = state.magnitude, np.array([arm.nx, arm.ny]).T
        return TouchState(
            parameters=parameters,
            joints=self.joints,
            force=f[:, None] * normal,
            magnitude=f,
            normal=normal,
            torques=np.array([f * arm.lever1, f * arm.lever2]).T,
            link1=np.array([arm.ux, arm.uy]).T,
            link2=np.array([arm.vx, arm.vy]).T,
            centers=self.centers,
            radii=self.radii,
            metadata=self.metadata,
            off_normal=np.zeros(len(f)) if self.off_normal is None else self.off_normal,
        )

    def shifted(self, model: ExtendedModel, state: State, arm: Arm | None = None) -> ContactProblem:
        """The same touches for the base model: Q - δ and S_c - d instead of Q and S_c; `arm` as in `touch_state`."""
        if not model.effects:
            return self
        return self.shifted_by(*model.shift(self.touch_state(model.parameters, state, arm)))

    def shifted_by(self, joints: Floats, place: Floats) -> ContactProblem:
        """Q - δ and S_c - d instead of Q and S_c."""
        return self._replace(joints=self.joints - joints, centers=self.centers - place, off_normal=None)


def _shift_by_magnitude(model: ExtendedModel, contact_problem: ContactProblem, state: State, arm: Arm) -> Shift:
    """The derivatives of δ and d by f, by central differences; nothing where no effect depends on f."""
    if model.force_dependence < ForceDependence.ALL:
        return Shift()
    step = _FORCE_STEP * np.maximum(np.abs(state.magnitude), 1.0)
    same = arm if arm.skew is None else None
    up, down = (
        contact_problem.touch_state(model.parameters, state._replace(magnitude=state.magnitude + change), same)
        for change in (step, -step)
    )
    return model.difference(up, down, 2 * step[:, None], ForceDependence.ALL)


def _shift_by_direction(model: ExtendedModel, contact_problem: ContactProblem, state: State) -> Shift:
    """The derivatives of δ and d by φ, by central differences; nothing where no effect depends on φ."""
    if model.force_dependence < ForceDependence.DIRECTION:
        return Shift()
    up, down = (
        contact_problem.touch_state(model.parameters, state._replace(direction=state.direction + change))
        for change in (_ANGLE_STEP, -_ANGLE_STEP)
    )
    return model.difference(up, down, 2 * _ANGLE_STEP, ForceDependence.DIRECTION)


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
    p, gripper = model.parameters, contact_problem.gripper
    if not model.effects:
        return touch_equations(p, *contact_problem[:3], state, gripper, arm)
    arm = view_arm(p, *state[:4], gripper) if arm is None else arm
    at = contact_problem.touch_state(p, state, arm)
    e = touch_equations(p, *contact_problem.shifted_by(*model.shift(at))[:3], state, gripper, arm)
    by_magnitude = _shift_by_magnitude(model, contact_problem, state, arm)
    by_direction = _shift_by_direction(model, contact_problem, state)
    (row1_f, row2_f), (normal_f, tangent_f) = _turns(by_magnitude, e), shift_column(by_magnitude, state, e).T
    (row1_d, row2_d), (normal_d, tangent_d) = _turns(by_direction, e), shift_column(by_direction, state, e).T
    return e._replace(
        row1_f=e.row1_f + row1_f,
        row2_f=e.row2_f + row2_f,
        row1_d=e.row1_d + row1_d,
        row2_d=e.row2_d + row2_d,
        normal_f=e.normal_f + normal_f,
        tangent_f=e.tangent_f + tangent_f,
        normal_d=e.normal_d + normal_d,
        tangent_d=e.tangent_d + tangent_d,
        touch_state=at,
    )


def _turns(shift: Shift, equations: Equations) -> tuple[Floats | float, Floats | float]:
    """δ of joint 1 and of joint 2, (n,) each, rad; zero where the joint floats, and where there is none."""
    if shift.joints is None:
        return 0.0, 0.0
    return shift.joints[:, 0] * equations.rows.on1, shift.joints[:, 1] * equations.rows.on2


def shift_column(shift: Shift, state: State, equations: Equations) -> Floats:
    """What a shift adds to h along n and t, (n, 2), m."""
    e, arm = equations, equations.rows.arm
    out = np.zeros((2, len(state.magnitude)))
    if shift.joints is not None:
        turn1, turn2 = _turns(shift, e)
        out[0] -= e.g11 * turn1 + e.g12 * turn2
        out[1] -= e.g21 * turn1 + e.g22 * turn2
    if shift.place is not None:
        x, y = shift.place.T
        out[0] += x * arm.nx + y * arm.ny
        out[1] += y * arm.nx - x * arm.ny
    return out.T


def all_derivatives(
    model: ExtendedModel, contact_problem: ContactProblem, state: State, equations: Equations
) -> Floats:
    """∂h/∂L̄ of n touches, f and φ held, and by the parameters of the effects behind, (n, 2, 12 + k)."""
    base, at = parameter_derivative(state, equations, contact_problem.gripper), equations.touch_state
    if at is None:
        return base
    for name, shift in model.shift_by_robot(at).items():
        base[:, :, NAMES.index(name)] += shift_column(shift, state, equations)
    columns = [shift_column(shift, state, equations).T[None] for shift in model.shift_by_effects(at)]
    return np.concatenate([base.transpose(2, 1, 0), *columns]).transpose(2, 1, 0)


def off_normal_derivative(model: ExtendedModel, state: State, equations: Equations) -> Floats:
    """∂h by the off-normal angle of each touch's force, (n, 2), m/rad, by central differences; there are effects."""
    at = equations.touch_state
    assert at is not None
    up, down = (at._replace(off_normal=at.off_normal + change) for change in (_ANGLE_STEP, -_ANGLE_STEP))
    return shift_column(model.difference(up, down, 2 * _ANGLE_STEP, ForceDependence.DIRECTION), state, equations)


def with_updated_modes(model: ExtendedModel, contact_problem: ContactProblem, state: State) -> LinkAngles:
    """`update_modes` of an extended model."""
    arm = view_arm(model.parameters, *state[:4], contact_problem.gripper)
    shifted = contact_problem.shifted(model, state, arm)
    return LinkAngles(next_modes(model.parameters, shifted.joints, state, arm), arm)


def extended_link_angles(
    model: ExtendedModel,
    contact_problem: ContactProblem,
    state: State,
    frozen: bool = False,
    arm: Arm | None = None,
) -> LinkAngles:
    """`solve_link_angles` of an extended model, one step; `arm` saves work where that of the state is known."""
    if arm is None:
        arm = view_arm(model.parameters, *state[:4], contact_problem.gripper)
    shifted = contact_problem.shifted(model, state, arm)
    return solve_link_angles(model.parameters, shifted.joints, state, contact_problem.gripper, frozen, arm=arm)
