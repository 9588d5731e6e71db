"""How fast the simulated controller moves the arm."""

from __future__ import annotations

from typing import NamedTuple

from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.trajectory import Timing


class Pace(NamedTuple):
    """Durations and speeds.

    Attributes:
        timing: durations of the phases but the press.
        press: fastest commanded motion while it presses, m/s.
        control_time: time constant with which the force approaches its target, s.
        peak: rest under the largest force of a touch with preload, s.
    """

    timing: Timing
    press: float
    control_time: float
    peak: float


USUAL = Pace(Timing(), press=0.015, control_time=0.05, peak=0.0)
SLOW = Pace(
    Timing(travel=1.5, approach=1.8, release=0.5, retract=0.5, speed=1.0), press=0.005, control_time=0.15, peak=0.1
)
"""So that the approach has the speed of its last millimetres throughout."""


def pace_of(scene: Scene) -> Pace:
    """That of a scene."""
    return SLOW if scene.quasi_static else USUAL
