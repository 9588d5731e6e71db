"""A force sensor whose gain depends on the force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Floats, Parameter, SensorEffect


@dataclass(frozen=True)
class SensorNonlinearity(SensorEffect):
    """The sensor reports (1 + rate · ‖F‖) F: its gain grows with the force, or falls, e = rate ‖F‖ F.

    A gain that is wrong alike at all forces scales all compliances and can never be seen.
    """

    name: ClassVar[str] = 'sensor_nonlinearity'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('rate', '1/N', 3e-2, 'part of the force reported too much, per newton of it'),
    )
    hides_behind: ClassVar[str] = (
        'the compliances, if all forces are alike; the law of the contact and the hardening of joints, if the force '
        'levels are few'
    )
    reveal: ClassVar[str] = 'touches at many force levels, from very small to large, at many places'
    betrays: ClassVar[str] = 'magnitude'
    runs_off: ClassVar[bool] = True

    def reading(self, force: Floats, values: Floats) -> Floats:
        return np.asarray(values[0] * self._per_rate(force))

    def reading_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        return (self._per_rate(force),)

    @staticmethod
    def _per_rate(force: Floats) -> Floats:
        return np.asarray(np.hypot(force[:, 0], force[:, 1])[:, None] * force)
