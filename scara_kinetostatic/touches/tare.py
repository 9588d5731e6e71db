"""The force zero of one contact, from the free motion before it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.touches.segmentation import SMOOTHING, moving_mean
from scara_kinetostatic.touches.signals import Floats, Signals, mean_steps, median, robust_mean, white_noise

LONGEST_FREE = 2.0
"""Only this much of the free motion before a contact is used, s."""
SHORTEST_FREE = 0.1
"""Less free motion than this gives no zero, s."""
AFTER_CONTACT = 0.05
"""Left out after the contact before, s."""
BEFORE_CONTACT = 0.02
"""Left out before the contact, s."""
FLOOR = 1e-3
"""Smallest deviation that can tell contact from free motion, N."""


class Tare(NamedTuple):
    """What the sensor reads without force.

    Attributes:
        force: in the frame and sign of the sensor, (2,), N.
        noise: white noise of one component, N.
        wander: standard deviation of a component of the step between neighbouring means
            (`mean_steps`), slow noise included, N.
        contact: where the force first leaves the zero, s.
    """

    force: Floats
    noise: float
    wander: float
    contact: float


def tare_before(signals: Signals, begin: float, previous_end: float) -> Tare | None:
    """The zero of a contact; None where the free motion before it is too short.

    Args:
        signals: the recording.
        begin: first sample that is clearly in contact, s.
        previous_end: last sample of the contact before, s, or -inf.
    """
    wrench = signals.wrench
    earliest = max(previous_end + AFTER_CONTACT, begin - LONGEST_FREE)
    free = wrench.stretch(earliest, begin)
    time, force = wrench.time[free], wrench.value[free]
    if len(time) < 5 or begin - max(earliest, time[0]) < SHORTEST_FREE:
        return None
    noise = white_noise(force)
    contact = _first_contact(time, signals.calm.value[free], noise, wrench.period)
    before = time < contact - BEFORE_CONTACT
    if np.sum(before) < 3:
        before = np.arange(len(time)) < 3
    steps, _ = mean_steps(signals.calm, time[before], signals.half)
    # the median of the length of a vector with two normal components is 1.18 sigma
    wander = float(median(np.hypot(*steps.T))) / 1.18
    return Tare(robust_mean(force[before]).mean, noise, wander, contact)


def _first_contact(time: Floats, force: Floats, noise: float, period: float) -> float:
    """Where the force leaves the middle of the free samples for good, in the later half of them at the earliest."""
    width = 2 * round(0.5 * SMOOTHING / period) + 1
    smooth = moving_mean(force - median(force), width)
    limit = max(FLOOR, 4.0 * noise / np.sqrt(width))
    calm = np.flatnonzero(np.hypot(smooth[:, 0], smooth[:, 1]) < limit)
    latest = max(int(calm[-1]) if len(calm) else 0, len(time) // 2)
    return float(time[latest])
