"""Errors of the force sensor: zero offset, rotation, a gain that depends on the force, cross-talk."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.effects.base import SensorEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Parameter, TouchMetadata


class SensorBias(SensorEffect):
    """The sensor reports F + b, b = (x, y) constant in its frame: what the tare before the touch left, e = b."""

    name = 'sensor_bias'
    parameters = (
        Parameter('x', 'N', 3.0, 'reported too much along x of the sensor', typical=1.0),
        Parameter('y', 'N', 3.0, 'reported too much along y of the sensor', typical=-0.7),
    )
    statement = 'the force sensor has a zero offset'
    confounded_with = 'the places of the discs, if each is touched from one side or with one force only'
    identified_by = 'touches from all sides of the discs, some of them with little force'
    plot_variable = 'direction'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        return np.full(force.shape, values)


class SensorRotation(SensorEffect):
    """The sensor reports R(angle) F: e = (R(angle) - I) F."""

    name = 'sensor_rotation'
    parameters = (Parameter('angle', 'rad', 0.05, 'by which reported forces are turned', typical=0.05),)
    statement = 'the force sensor is rotated about its axis'
    confounded_with = 'contact friction, if the tip slides the same way in all touches'
    identified_by = 'touches that slide in both directions: preload every other touch'
    plot_variable = 'direction'
    declared_as = 'force_rotation'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        c, s = np.cos(values[0]) - 1, np.sin(values[0])
        return np.array([c * force[:, 0] - s * force[:, 1], s * force[:, 0] + c * force[:, 1]]).T

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        c, s = np.cos(values[0]), np.sin(values[0])
        return (np.array([-s * force[:, 0] - c * force[:, 1], c * force[:, 0] - s * force[:, 1]]).T,)


class SensorNonlinearity(SensorEffect):
    """The sensor reports (1 + rate · ‖F‖) F: its gain grows with the force, or falls, e = rate ‖F‖ F.

    A gain that is wrong alike at all forces scales all compliances and can never be identified.
    """

    name = 'sensor_nonlinearity'
    parameters = (
        Parameter('rate', '1/N', 3e-2, 'part of the force reported too much, per newton of it', typical=1e-3),
    )
    statement = 'the gain of the force sensor depends on the force'
    confounded_with = (
        'the compliances, if all forces are alike; the law of the contact and the hardening of joints, if the force '
        'levels are few'
    )
    identified_by = 'touches at many force levels, from very small to large, at many places'
    plot_variable = 'magnitude'

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        return np.asarray(values[0] * (np.hypot(force[:, 0], force[:, 1])[:, None] * force))


class SensorCrossTalk(SensorEffect):
    """The sensor reports (I + A) F in its own frame, e = A F with A = [[gain/2, xy], [yx, -gain/2]].

    That is every 2×2 matrix but for a gain common to both axes, which is an exact alias: all compliances are smaller
    by it. A rotation by a small angle r is xy = -r, yx = r; where only that is there, it is called `sensor_rotation`.
    """

    name = 'sensor_cross_talk'
    parameters = (
        Parameter('gain', '1', 0.05, 'gain of x less that of y', typical=0.02),
        Parameter('xy', '1', 0.05, 'part of the force along y that is added to x', typical=0.015),
        Parameter('yx', '1', 0.05, 'part of the force along x that is added to y', typical=-0.01),
    )
    statement = 'the force sensor has cross-talk or unequal gains'
    confounded_with = (
        'all compliances, by a gain common to both axes, **always**; sensor_rotation, if the forces have few '
        'directions in the frame of the sensor'
    )
    identified_by = 'forces from all directions in the frame of the sensor, slid in both directions'
    plot_variable = 'direction'
    is_linear = True
    special_cases = ('sensor_rotation',)

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        gain, xy, yx = values
        return np.asarray(force @ np.array([[gain / 2, yx], [xy, -gain / 2]]))
