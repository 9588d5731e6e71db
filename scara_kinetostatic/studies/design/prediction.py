"""Predicted covariance of L̄ for a plan of touches, before any touch is made, and its observability indices.

The conditions of the touches are linearised where they hold exactly, at Q = Ḡ(S, F) of the expected robot, and whitened
by the noise of a touch. The Jacobian is the one from which the calibration works out its covariance, by the same
functions (`calibration.gauss_helmert`), and directions that the calibration would report as unidentifiable are left out
here as well: a prediction has the rank and the confounded groups of the fit that it predicts.

**Observability indices.** From the singular values σ1 ≥ … ≥ σL of the whitened Jacobian of m touches, its columns in
units of the plausible range of each parameter (`calibration.identifiability.SCALES`); without common units only O1
would be comparable between sets:

    O1 = (σ1 ⋯ σL)^(1/L) / √m        Borm and Menq, Int. J. Robotics Research 10 (1991) 51: volume of the ellipsoid
    O2 = σL / σ1                     Driels and Pathre, J. Robotic Systems 7 (1990) 921: inverse condition number
    O3 = σL                          Nahvi, Hollerbach and Hayward, ICRA 1994, 984: the worst direction
    O4 = σL² / σ1                    Nahvi and Hollerbach, ICRA 1996, 994: noise amplification
    O5 = 1 / (1/σ1 + … + 1/σL)       Sun and Hollerbach, ICRA 2008, 831: mean uncertainty

Larger is better. Where the rank is less than 12, only the L identifiable combinations count. The indices rank sets of
touches in one cell; they do not depend on where the tip is used, as its standard deviation over the workspace does.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration import least_squares
from scara_kinetostatic.calibration.fit_point import Point, evaluate
from scara_kinetostatic.calibration.gauss_helmert import Adjusted
from scara_kinetostatic.calibration.identifiability import (
    SCALES,
    condition_number,
    group_names,
    unidentifiable_directions,
)
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.contact_state import State
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics, joint_deflection
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.sensors import TYPICAL_NOISE, in_sensor_frame


class Indices(NamedTuple):
    """O1 to O5; see the module."""

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float


def observability(values: NDArray[np.float64], touches: int) -> Indices:
    """The five indices.

    Args:
        values: singular values of the scaled, whitened Jacobian, (L,), in any order.
        touches: m.
    """
    if not len(values) or not values.min() > 0:
        return Indices(0.0, 0.0, 0.0, 0.0, 0.0)
    largest, smallest = float(values.max()), float(values.min())
    return Indices(
        o1=float(np.exp(np.log(values).mean()) / np.sqrt(touches)),
        o2=smallest / largest,
        o3=smallest,
        o4=smallest**2 / largest,
        o5=float(1 / (1 / values).sum()),
    )


@dataclass(frozen=True)
class Robot:
    """The robot that a design is made for.

    Attributes:
        cell: discs, sensor, nominal parameters.
        parameters: expected L̄; geometry, compliances and backlashes all enter the prediction.
        noise: repeatability of one touch, one standard deviation, rad and N.

    Raises:
        ParameterError: a noise level is not above 0.
    """

    cell: Cell
    parameters: Parameters
    noise: Noise

    def __post_init__(self) -> None:
        for name, levels in (('joint', self.noise.joint_levels), ('force', self.noise.force_levels)):
            for value in levels:
                if not (np.isfinite(value) and value > 0):
                    problem, remedy = f'expected a value above 0, got {value}', 'give the standard deviation of a touch'
                    raise ParameterError(f'noise: {name}', problem, remedy)

    @classmethod
    def of(cls, cell: Cell, parameters: Parameters | None = None, noise: Noise | None = None) -> Robot:
        """The robot of a cell.

        Args:
            cell: the cell.
            parameters: expected L̄; by default the nominal parameters.
            noise: by default that of the cell, or typical noise if the cell states none.
        """
        return cls(cell, parameters or cell.nominal, noise or cell.noise or TYPICAL_NOISE)


@dataclass(frozen=True)
class Prediction:
    """Predicted uncertainty of L̄.

    Attributes:
        touches: number of touches that it holds for.
        covariance: of L̄ over the identifiable directions, (12, 12), SI units.
        std: standard deviations, (12,), SI units; NaN where confounded.
        unidentifiable: directions of L̄ that the touches do not determine, (12, d), in `SCALES`.
        confounded: groups of parameters of which only combinations are determined, by name.
        condition: condition number of the whitened Jacobian with unit columns, over the identifiable directions.
        indices: observability indices, over the identifiable directions.
        leverage: largest eigenvalue of each touch's block of the hat matrix, (m,), 0 to 1; at 1 no other touch checks
            it, and an error in it is not detected.
    """

    touches: int
    covariance: Floats
    std: Floats
    unidentifiable: Floats
    confounded: tuple[tuple[str, ...], ...]
    condition: float
    indices: Indices
    leverage: Floats

    @property
    def rank(self) -> int:
        """Number of independent combinations of the twelve parameters that are identifiable."""
        return len(NAMES) - self.unidentifiable.shape[1]


class ExactTouches(NamedTuple):
    """Touches without noise.

    Attributes:
        observations: what would be measured.
        point: the linearised conditions there.
        arms: distance of each line of force from both joint axes, (m, 2), m.
    """

    observations: Observations
    point: Point
    arms: Floats


def exact_plan(robot: Robot, plan: Plan) -> ExactTouches:
    """The touches of a plan without noise.

    Raises:
        UnsupportedDataError: the robot cannot reach a touch.
    """
    cell = robot.cell
    return exact_touches(robot, cell.centers[plan.disc], cell.radii[plan.disc], plan.angle, plan.posture, plan.force)


def exact_touches(
    robot: Robot, centers: Floats, radii: Floats, angle: Floats, posture: NDArray[np.intp], force: Floats
) -> ExactTouches:
    """Touches without noise on discs that need not be in the cell.

    Args:
        robot: the robot; of its cell only the sensor and the gripper count.
        centers: centre of each touch's disc, (m, 2), m.
        radii: its radius, (m,), m.
        angle: direction from the centre to the contact, (m,), rad.
        posture: +1 or -1, (m,).
        force: its magnitude, (m,), N.

    Raises:
        UnsupportedDataError: the robot cannot reach a touch.
    """
    p, cell = robot.parameters, robot.cell
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    pressed = -force[:, None] * outward
    joints, torques = inverse_kinetostatics(p, centers + radii[:, None] * outward, pressed, posture, cell.gripper)
    if not np.isfinite(joints).all():
        lost = int(np.flatnonzero(~np.isfinite(joints).all(axis=1))[0])
        raise UnsupportedDataError(f'the robot cannot reach touch {lost} of the plan', 'leave it out, or move its disc')
    links, modes = joints - joint_deflection(p, torques), np.sign(torques)
    measured = in_sensor_frame(cell, p, joints, pressed)
    direction = np.arctan2(pressed[:, 1], pressed[:, 0])
    state = State(links[:, 0], links[:, 1], force, direction, modes[:, 0], modes[:, 1])
    observations = Observations(joints, measured, centers, radii, cell.sensor.frame, cell.gripper)
    point = evaluate(observations, ExtendedModel(p), Adjusted(joints, measured, state), robot.noise)
    return ExactTouches(observations, point, np.abs(torques) / force[:, None])


def predict(robot: Robot, plan: Plan, number: int | None = None) -> Prediction:
    """The uncertainty of a calibration with the touches of a plan.

    Args:
        robot: the robot.
        plan: the touches.
        number: predict for this number of touches, evenly distributed over those of the plan; None: for the plan as it
            is.

    Raises:
        UnsupportedDataError: the robot cannot reach a touch.
    """
    observations, point, _ = exact_plan(robot, plan)
    everything = np.arange(len(NAMES))
    unidentifiable = unidentifiable_directions(observations, point, everything, robot.noise)
    basis = SCALES[:, None] * _complement(unidentifiable)
    weight = 1.0 if number is None else number / len(plan)
    identifiable = np.sqrt(weight) * (point.whitened.derivative @ basis)
    system = least_squares.compress(identifiable, point.whitened.residual)
    covariance = basis @ least_squares.covariance(system) @ basis.T
    groups = group_names(unidentifiable, everything)
    std = np.sqrt(np.diag(covariance))
    std[[name in {member for group in groups for member in group} for name in NAMES]] = np.nan
    touches = number or len(plan)
    return Prediction(
        touches=touches,
        covariance=covariance,
        std=std,
        unidentifiable=unidentifiable,
        confounded=groups,
        condition=condition_number(identifiable),
        indices=observability(system.values, touches),
        leverage=leverage(point.whitened.derivative, covariance),
    )


def _complement(unidentifiable: Floats) -> Floats:
    """Orthonormal columns that span all but the given orthonormal columns, (k, k - d)."""
    k, d = unidentifiable.shape
    return np.asarray(np.linalg.qr(np.concatenate([unidentifiable, np.eye(k)], axis=1))[0][:, d:k])


def leverage(derivative: Floats, covariance: Floats) -> Floats:
    """Leverage of each touch: the larger eigenvalue of J C Jᵀ, (m,); J whitened, (m, 2, 12), C (12, 12)."""
    return np.asarray(np.linalg.eigvalsh(np.einsum('nik,kl,njl->nij', derivative, covariance, derivative))[:, -1])
