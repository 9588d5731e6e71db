"""A force sensor that is mounted at a different angle than stated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Parameter, SensorEffect
from scara_kinetostatic.model.arrays import Floats


@dataclass(frozen=True)
class SensorRotation(SensorEffect):
    """The sensor reports R(angle) F: e = (R(angle) - I) F."""

    name: ClassVar[str] = 'sensor_rotation'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('angle', 'rad', 0.05, 'by which reported forces are turned', typical=0.05),
    )
    statement: ClassVar[str] = 'the force sensor is rotated about its axis'
    short_statement: ClassVar[str] = 'force sensor turned'
    confounded_with: ClassVar[str] = 'contact friction, if the tip slides the same way in all touches'
    identified_by: ClassVar[str] = 'touches that slide in both directions: preload every other touch'
    plot_variable: ClassVar[str] = 'direction'
    declared_as: ClassVar[str] = 'force_rotation'
    order: ClassVar[int] = 2

    def sensor_error(self, force: Floats, values: Floats) -> Floats:
        c, s = np.cos(values[0]) - 1, np.sin(values[0])
        return np.array([c * force[:, 0] - s * force[:, 1], s * force[:, 0] + c * force[:, 1]]).T

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        c, s = np.cos(values[0]), np.sin(values[0])
        return (np.array([-s * force[:, 0] - c * force[:, 1], c * force[:, 0] - s * force[:, 1]]).T,)
