"""A force sensor whose gain depends on the force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Parameter, SensorEffect
from scara_kinetostatic.model.arrays import Floats


@dataclass(frozen=True)
class SensorNonlinearity(SensorEffect):
    """The sensor reports (1 + rate · ‖F‖) F: its gain grows with the force, or falls, e = rate ‖F‖ F.

    A gain that is wrong alike at all forces scales all compliances and can never be identified.
    """

    name: ClassVar[str] = 'sensor_nonlinearity'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('rate', '1/N', 3e-2, 'part of the force reported too much, per newton of it', typical=1e-3),
    )
    statement: ClassVar[str] = 'the gain of the force sensor depends on the force'
    short_statement: ClassVar[str] = 'gain of the force sensor depends on the force'
    confounded_with: ClassVar[str] = (
        'the compliances, if all forces are alike; the law of the contact and the hardening of joints, if the force '
        'levels are few'
    )
    identified_by: ClassVar[str] = 'touches at many force levels, from very small to large, at many places'
    plot_variable: ClassVar[str] = 'magnitude'
    order: ClassVar[int] = 4
    diverges_with_alias: ClassVar[bool] = True

    def sensor_error(self, force: Floats, values: Floats) -> Floats:
        return np.asarray(values[0] * self._per_rate(force))

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        return (self._per_rate(force),)

    @staticmethod
    def _per_rate(force: Floats) -> Floats:
        return np.asarray(np.hypot(force[:, 0], force[:, 1])[:, None] * force)
