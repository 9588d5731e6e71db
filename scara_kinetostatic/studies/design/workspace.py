"""Predicted standard deviation of the tip over the workspace, free and under load.

With the covariance C of L̄, that of the tip is T C Tᵀ, T being its derivative with respect to L̄ at the measured joint
angles: ∂H/∂L̄ for the free tip; for the loaded tip, at given Q and F, that of S in (4) with (6) and (7). The standard
deviation at a place is √trace(T C Tᵀ). The grid is polar about the robot's base and includes the limits of the reach,
where the uncertainty is largest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinetostatics import forward_by_parameters, inverse_kinetostatics_derivatives
from scara_kinetostatic.simulation.plan import BASE_MARGIN, REACH_MARGIN
from scara_kinetostatic.studies.design.prediction import Prediction, Robot

_RADII, _ANGLES = 8, 36
"""Radii and angles of the grid on which the reported numbers are evaluated."""
_DIRECTIONS = 8
"""Directions of the load, evenly around."""
_NEGLIGIBLE = 1e-6
"""Motion of the tip by an unidentifiable direction of L̄, over its plausible range, up to which the tip counts as
determined, m: well below any accuracy that is asked for."""
POSTURES = (1, -1)


class Region(NamedTuple):
    """The part of the base frame that counts, m; by default all of it."""

    x_min: float = -np.inf
    x_max: float = np.inf
    y_min: float = -np.inf
    y_max: float = np.inf

    def holds(self, places: Floats) -> NDArray[np.bool_]:
        """Whether places, (…, 2), m, are inside, (…)."""
        low, high = (self.x_min, self.y_min), (self.x_max, self.y_max)
        return np.asarray(((places >= low) & (places <= high)).all(axis=-1))


class Tip(NamedTuple):
    """Sensitivity of the tip to L̄ at every place of the workspace.

    Attributes:
        derivative: T, (2 g, d, 2, 12), posture left first, d directions of the load (1 without load).
        weight: share of the area that belongs to each place, (2 g,).
    """

    derivative: Floats
    weight: Floats


class TipStd(NamedTuple):
    """The standard deviation of the tip over the workspace; infinite where it is not determined.

    Attributes:
        largest: m.
        rms: root of the mean square, weighted by area, m.
        places: at each place for the worst direction of the load, (2, g), m, posture left first.
    """

    largest: float
    rms: float
    places: Floats


@dataclass(frozen=True)
class Workspace:
    """The places at which the tip is evaluated.

    Attributes:
        places: (g, 2), m, base frame.
        area: share of the area that belongs to each, (g,).
        mask: which places of the polar grid are in the region, (radii, angles).
        radii: of the grid, m.
        angles: of the grid, rad.
    """

    places: Floats
    area: Floats
    mask: NDArray[np.bool_]
    radii: Floats
    angles: Floats


def reach(robot: Robot) -> tuple[float, float]:
    """Smallest and largest distance of the tip from the base, with the margins of a plan of touches, m."""
    p = robot.cell.nominal
    return max(abs(p.l1 - p.l2) + REACH_MARGIN, BASE_MARGIN), p.l1 + p.l2 - REACH_MARGIN


def make_workspace(robot: Robot, region: Region | None = None, radii: int = _RADII, angles: int = _ANGLES) -> Workspace:
    """The polar grid over all that is within reach and in the region.

    Args:
        robot: the robot.
        region: by default all within reach.
        radii: number of radii.
        angles: number of angles.

    Raises:
        ParameterError: no place of the region is within reach.
    """
    region = region or Region()
    nominal = robot.cell.nominal
    distance = np.linspace(*reach(robot), radii)
    angle = 2 * np.pi * np.arange(angles) / angles
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    grid = (nominal.x0, nominal.y0) + distance[:, None, None] * directions
    mask = region.holds(grid)
    if not mask.any():
        raise ParameterError('region', f'no place of {tuple(region)} is within reach', 'give x and y limits in m')
    area = np.broadcast_to(distance[:, None], mask.shape)[mask]
    return Workspace(grid[mask], area / area.sum(), mask, distance, angle)


def free_tip(robot: Robot, workspace: Workspace) -> Tip:
    """The free tip: T = ∂H/∂L̄."""
    blocks = [
        forward_by_parameters(robot.parameters, kinematics.inverse(robot.parameters, workspace.places, posture))
        for posture in POSTURES
    ]
    return Tip(np.concatenate(blocks)[:, None], np.tile(workspace.area, 2) / 2)


def loaded_tip(robot: Robot, workspace: Workspace, load: float, directions: int = _DIRECTIONS) -> Tip:
    """The loaded tip: T = dS/dL̄ at given Q and F, from the derivatives of Ḡ.

    Args:
        robot: the robot.
        workspace: where.
        load: magnitude of the force on the object, N.
        directions: of the load, evenly around.
    """
    angle = 2 * np.pi * np.arange(directions) / directions
    force = load * np.tile(np.stack([np.cos(angle), np.sin(angle)], axis=-1), (len(workspace.places), 1))
    places = np.repeat(workspace.places, directions, axis=0)
    sign = robot.cell.gripper_sign
    blocks = []
    for posture in POSTURES:
        joints, _ = inverse_kinetostatics_derivatives(robot.parameters, places, force, posture, sign)
        derivative = -np.linalg.solve(joints.first, joints.parameters)
        blocks.append(derivative.reshape(-1, directions, *derivative.shape[1:]))
    return Tip(np.concatenate(blocks), np.tile(workspace.area, 2) / 2)


def tip_std(tip: Tip, prediction: Prediction) -> TipStd:
    """The tip's standard deviation from a predicted covariance of L̄."""
    variance = np.einsum('gdik,kl,gdil->gd', tip.derivative, prediction.covariance, tip.derivative, optimize=True)
    if prediction.unidentifiable.size:
        motion = np.abs(tip.derivative @ (SCALES[:, None] * prediction.unidentifiable)).max(axis=(2, 3))
        variance = np.where(motion > _NEGLIGIBLE, np.inf, variance)
    places = variance.max(axis=1)
    mean = variance.mean(axis=1) @ tip.weight
    return TipStd(float(np.sqrt(places.max())), float(np.sqrt(mean)), np.sqrt(places).reshape(2, -1))
