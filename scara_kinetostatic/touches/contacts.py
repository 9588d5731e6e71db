"""Contacts of a recording, from the force alone.

A contact begins where the smoothed force deviates from the zero of the sensor (`tare`) by more than a threshold, and
ends where the deviation falls below a part of it (hysteresis).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.signals import SMOOTHING, Signals, moving_mean, runs, white_noise
from scara_kinetostatic.touches.tare import coarse_tare

CONTACT_FORCE = 1.0
"""Deviation from the zero at which a contact begins, N; above the drift of a zero, below usual touches."""
END_RATIO = 0.5
"""A contact ends below this part of the deviation at which it begins."""


@dataclass(frozen=True)
class ContactSettings:
    """What a contact is.

    Attributes:
        contact_sigmas: deviation at which a contact begins as a multiple of the standard deviation of the smoothed
            force, where that is larger than `CONTACT_FORCE`.
        longest_bounce: two contacts with a shorter loss of contact between them are one, s.
        shortest_contact: a shorter deviation is a spike of the sensor, not a contact, s.
    """

    contact_sigmas: float = 6.0
    longest_bounce: float = 0.05
    shortest_contact: float = 0.05


SETTINGS = ContactSettings()


class Contacts(NamedTuple):
    """The contacts of a recording.

    Attributes:
        begin: time of the first sample of each in contact, (m,), s.
        end: time of the last sample, (m,), s.
        peak: largest deviation from the coarse zero in each, (m,), N.
        travel: range of the joint that moves most in each, (m,), rad.
        spikes: number of deviations that were too short for a contact.
        threshold: deviation at which a contact begins, N.
        smoothing: time over which the force was smoothed for it, s.
    """

    begin: Floats
    end: Floats
    peak: Floats
    travel: Floats
    spikes: int
    threshold: float
    smoothing: float

    def select(self, which: NDArray[np.bool_]) -> Contacts:
        """The contacts where a mask, (m,), is true."""
        return self._replace(
            begin=self.begin[which], end=self.end[which], peak=self.peak[which], travel=self.travel[which]
        )


def find_contacts(signals: Signals, zero: Floats | None = None, longest_smoothing: float = SMOOTHING) -> Contacts:
    """All contacts in the order of time.

    Args:
        signals: the recording.
        zero: of the force sensor where it is known, (2,), N; None to take it from where the arm moves most.
        longest_smoothing: where the noise asks for it the force is smoothed for so long, s.
    """
    wrench, noise = signals.wrench, white_noise(signals.wrench.value)
    shortest, longest = (2 * round(0.5 * time / wrench.period) + 1 for time in (SMOOTHING, longest_smoothing))
    needed = 2 * round(0.5 * (SETTINGS.contact_sigmas * noise / CONTACT_FORCE) ** 2) + 1
    width = int(np.clip(needed, shortest, longest))
    smooth = moving_mean(signals.filtered.value, width)
    smooth -= coarse_tare(signals) if zero is None else zero
    deviation = np.hypot(smooth[:, 0], smooth[:, 1])
    on = max(CONTACT_FORCE, SETTINGS.contact_sigmas * noise / float(np.sqrt(width)))
    first, last = runs(_with_hysteresis(deviation, on, END_RATIO * on))
    begin, end = wrench.time[first], wrench.time[last]
    apart = begin[1:] - end[:-1] >= SETTINGS.longest_bounce
    begin, end = begin[np.append(True, apart)[: len(begin)]], end[np.append(apart, True)[: len(end)]]
    lasting = end - begin > max(SETTINGS.shortest_contact, (width + 1) * wrench.period)
    begin, end = begin[lasting], end[lasting]
    peak = [deviation[wrench.stretch(b, e)].max() for b, e in zip(begin, end, strict=True)]
    inside = [signals.joints.value[signals.joints.stretch(b, e)] for b, e in zip(begin, end, strict=True)]
    travel = [np.ptp(joints, axis=0).max() if len(joints) else 0.0 for joints in inside]
    smoothing = SMOOTHING if width == shortest else width * wrench.period
    return Contacts(begin, end, np.array(peak), np.array(travel), int(np.sum(~lasting)), on, smoothing)


def _with_hysteresis(deviation: Floats, on: float, off: float) -> NDArray[np.bool_]:
    """Whether each sample is in contact, (n,): from where the deviation exceeds `on` to where it falls below `off`."""
    decided = np.where(deviation > on, 1, np.where(deviation < off, -1, 0)).astype(np.int8)
    latest = np.where(decided != 0, np.arange(len(decided)), 0)
    contact: NDArray[np.bool_] = decided[np.maximum.accumulate(latest)] > 0
    return contact
