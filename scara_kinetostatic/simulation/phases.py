"""The phases of a touch, their durations and their time law."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.simulation.plan import CLEARANCE

PHASES = ('travel', 'pause', 'approach', 'press', 'ease', 'hold', 'release', 'retract')
TRAVEL, PAUSE, APPROACH, PRESS, EASE, HOLD, RELEASE, RETRACT = range(8)


@dataclass(frozen=True)
class Timing:
    """Durations of the phases of a touch, s.

    Attributes:
        travel: shortest travel between two touches.
        pause: rest at the free pose before the approach.
        approach: from the free pose to the disc.
        press: from no force to the force of the hold, or to the peak beyond it.
        ease: from the peak down to the force of the hold, for touches with preload.
        hold: at rest under the force.
        release: back to no force.
        retract: back to the free pose.
        speed: largest mean speed of a joint during the travel, rad/s.
        clearance: distance of the free pose from the disc, m.

    Raises:
        ParameterError: a value that is not above 0 (0 is fine for the pause).
    """

    travel: float = 0.6
    pause: float = 0.1
    approach: float = 0.4
    press: float = 0.3
    ease: float = 0.2
    hold: float = 0.5
    release: float = 0.2
    retract: float = 0.2
    speed: float = 4.0
    clearance: float = CLEARANCE

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not np.isfinite(value) or value < 0 or (value == 0 and item.name != 'pause'):
                raise ParameterError(f'timing: {item.name}', f'expected a value above 0, got {value}')


def minimum_jerk(part: Floats) -> Floats:
    """10 s³ - 15 s⁴ + 6 s⁵: from 0 to 1, at rest at both ends."""
    return part**3 * (10.0 + part * (6.0 * part - 15.0))
