"""A force sensor that does not read zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Parameter, SensorEffect, unit_vectors
from scara_kinetostatic.model.arrays import Floats


@dataclass(frozen=True)
class SensorBias(SensorEffect):
    """The sensor reports F + b, b = (x, y) constant in its frame: what the tare before the touch left, e = b."""

    name: ClassVar[str] = 'sensor_bias'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'N', 3.0, 'reported too much along x of the sensor', typical=1.0),
        Parameter('y', 'N', 3.0, 'reported too much along y of the sensor', typical=-0.7),
    )
    statement: ClassVar[str] = 'the force sensor has a zero offset'
    short_statement: ClassVar[str] = 'zero offset of the force sensor'
    confounded_with: ClassVar[str] = 'the places of the discs, if each is touched from one side or with one force only'
    identified_by: ClassVar[str] = 'touches from all sides of the discs, some of them with little force'
    plot_variable: ClassVar[str] = 'direction'
    order: ClassVar[int] = 3

    def sensor_error(self, force: Floats, values: Floats) -> Floats:
        return np.full(force.shape, values)

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        return unit_vectors(len(force))
