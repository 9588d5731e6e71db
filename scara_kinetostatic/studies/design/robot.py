"""The robot for which touches are designed: its cell, what is expected of it, and the noise of a touch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Cell, Noise, Plate
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.sensors import TYPICAL_NOISE


@dataclass(frozen=True)
class Robot:
    """The robot that a design is made for.

    Attributes:
        cell: discs, sensor, nominal parameters, and how well they are known.
        parameters: expected L̄; geometry, compliances and backlashes all enter the prediction.
        noise: repeatability of one touch, one standard deviation, rad and N.
        assumed: parts of the noise that nobody has stated, ``joint`` or ``force``: typical values stand for them.

    Raises:
        ParameterError: a noise level is not above 0.
    """

    cell: Cell
    parameters: Parameters
    noise: Noise
    assumed: tuple[str, ...] = ()

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
            noise: by default that of the cell, or typical noise, marked as assumed, if the cell states none.
        """
        stated = noise or cell.noise
        return cls(cell, parameters or cell.nominal, stated or TYPICAL_NOISE, () if stated else ('joint', 'force'))

    @cached_property
    def declared(self) -> DeclaredErrors | None:
        """What the cell description declares as uncertain; None where everything counts as exactly known."""
        return DeclaredErrors.of(self.cell)

    @cached_property
    def common_plate(self) -> Plate | None:
        """The plate that carries all discs, if its place or rotation is uncertain."""
        names = {disc.plate for disc in self.cell.discs}
        uncertain = [plate for plate in self.cell.plates if plate.center_std or plate.angle_std]
        return next((plate for plate in uncertain if names == {plate.name}), None)

    def on_plate(self) -> Robot:
        """The same robot with plates that count as exactly placed.

        With all discs on one plate, touches say nothing about the place of the plate in the base frame: x0, y0 and
        theta1 move with it. What they determine is the robot in the frame of the plate, and that is this robot.
        """
        plates = tuple(plate._replace(center_std=0.0, angle_std=0.0) for plate in self.cell.plates)
        return replace(self, cell=replace(self.cell, plates=plates))
