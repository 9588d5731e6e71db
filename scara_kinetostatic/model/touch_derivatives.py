"""Derivatives of the equations of a touch, and of its contact force, by L̄ and the parameters of effects (12)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, pairs
from scara_kinetostatic.model.contact_force import Contact
from scara_kinetostatic.model.extended_model import ExtendedModel, ForceDependence, as_model
from scara_kinetostatic.model.flanks import State
from scara_kinetostatic.model.kinematics import GripperSign, LoadedJoints, component_by_parameters
from scara_kinetostatic.model.parameters import NAMES, THETA1, THETA2, Parameters
from scara_kinetostatic.model.touch_equations import (
    ANGLE_STEP,
    ContactProblem,
    Equations,
    extended_equations,
    shift_column,
)


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
    up, down = (at._replace(off_normal=at.off_normal + change) for change in (ANGLE_STEP, -ANGLE_STEP))
    return shift_column(model.difference(up, down, 2 * ANGLE_STEP, ForceDependence.DIRECTION), equations)


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
