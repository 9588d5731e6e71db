"""A force sensor whose axes act on each other, or have unequal gains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Parameter, SensorEffect
from scara_kinetostatic.model.arrays import Floats


@dataclass(frozen=True)
class SensorCrossTalk(SensorEffect):
    """The sensor reports (I + A) F in its own frame, e = A F with A = [[gain/2, xy], [yx, -gain/2]].

    That is every 2×2 matrix but for a gain common to both axes, which is an exact alias: all compliances are smaller
    by it. A rotation by a small angle r is xy = -r, yx = r; where only that is there, it is called `sensor_rotation`.
    """

    name: ClassVar[str] = 'sensor_cross_talk'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('gain', '1', 0.05, 'gain of x less that of y', typical=0.02),
        Parameter('xy', '1', 0.05, 'part of the force along y that is added to x', typical=0.015),
        Parameter('yx', '1', 0.05, 'part of the force along x that is added to y', typical=-0.01),
    )
    statement: ClassVar[str] = 'the force sensor has cross-talk or unequal gains'
    short_statement: ClassVar[str] = 'cross-talk of the force sensor'
    confounded_with: ClassVar[str] = (
        'all compliances, by a gain common to both axes, **always**; sensor_rotation, if the forces have few '
        'directions in the frame of the sensor'
    )
    identified_by: ClassVar[str] = 'forces from all directions in the frame of the sensor, slid in both directions'
    plot_variable: ClassVar[str] = 'direction'
    is_linear: ClassVar[bool] = True
    special_cases: ClassVar[tuple[str, ...]] = ('sensor_rotation',)
    order: ClassVar[int] = 20

    def sensor_error(self, force: Floats, values: Floats) -> Floats:
        gain, xy, yx = values
        return np.asarray(force @ np.array([[gain / 2, yx], [xy, -gain / 2]]))

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        return tuple(self.sensor_error(force, unit) for unit in np.eye(3))
