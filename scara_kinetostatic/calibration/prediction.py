"""What the model predicts for touches: A(Q, L̄), the residual F - A, the index e_f (10)."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.blocks import in_blocks
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.gauss_helmert import first_guess
from scara_kinetostatic.calibration.observations import NO_ERRORS, Observations
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward, rotate
from scara_kinetostatic.model.sensor_error import true_force
from scara_kinetostatic.model.touch import TouchSet


def observe(touches: TouchSet, cell: Cell, errors: Floats | None = None) -> Observations:
    """The touches as the adjustment takes them.

    Args:
        touches: what was measured.
        cell: the cell as stated.
        errors: its declared errors (`Calibration.errors`), (m,); None for none.

    Raises:
        ParameterError: a touch names a disc that the cell does not have.
    """
    if len(touches) and not (touches.disc.min() >= 0 and touches.disc.max() < len(cell.discs)):
        raise ParameterError('touches: disc', f'expected 0 to {len(cell.discs) - 1}, the discs of the cell')
    declared = DeclaredErrors.of(cell)
    stated = Observations(
        touches.joints,
        touches.force,
        cell.centers[touches.disc],
        cell.radii[touches.disc],
        cell.sensor.frame,
        cell.gripper,
        TouchMetadata.of(touches, cell.sensor.frame),
        declared,
        NO_ERRORS if declared is None else np.zeros(declared.count),
        None if declared is None else touches.force,
    )
    return stated if errors is None else stated.with_errors(errors)


def base_force(observations: Observations, model: ExtendedModel) -> Floats:
    """The measured forces in the base frame, (n, 2), N; the tool frame turns with q1 + theta1 + q2 + theta2.

    Errors of the sensor, if the model has such effects, are corrected.
    """
    force = true_force(model, observations.force, observations.metadata)
    if observations.frame is SensorFrame.BASE:
        return force
    return rotate(force, observations.joints.sum(axis=1) + model.parameters.theta1 + model.parameters.theta2)


def force_residual(observations: Observations, model: ExtendedModel) -> Floats:
    """F - A(Q, L̄) with the contact unilateral, as (10) takes it, (n, 2), N."""
    return in_blocks(len(observations.joints), lambda part: _force_residual(observations.select(part), model))


def _force_residual(observations: Observations, model: ExtendedModel) -> Floats:
    o = observations
    measured = base_force(o, model)
    off_normal = _measured_off_normal(o, model) if model.off_normal_std else None
    found = contact(
        model,
        o.joints,
        o.centers,
        o.radii,
        o.gripper,
        warm_start=measured,
        metadata=o.metadata,
        off_normal=off_normal,
    )
    return measured - found.force


def _measured_off_normal(observations: Observations, model: ExtendedModel) -> Floats:
    """Off-normal angle of each measured force, (n,), rad."""
    o = observations
    state = first_guess(o, model).state
    link2 = state.link1 + state.link2 + model.parameters.theta1 + model.parameters.theta2
    force = base_force(o, model)
    tip = forward(model.parameters, np.stack([state.link1, state.link2], axis=-1))
    inward = o.contact_problem(o.joints).shifted(model, state).centers - tip
    inward = inward - o.gripper.deflection(model.parameters, force, link2)
    across = inward[:, 0] * force[:, 1] - inward[:, 1] * force[:, 0]
    return np.asarray(np.arctan2(across, (inward * force).sum(axis=1)))


def force_error(residual: Floats) -> float:
    """e_f (10): the mean length of the residuals, N."""
    return float(np.hypot(residual[:, 0], residual[:, 1]).mean())
