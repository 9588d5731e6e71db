"""The load of the joints over time, in the contacts of a recording.

The force, its zero subtracted, is smoothed over `SMOOTHING`; the joint angles are interpolated at its stamps; the
torques are C = JᵀF by the nominal parameters: they serve to choose the moments at which the load turns, for which
lever arms within a percent are good enough.

The extreme of noisy readings is too far: that of 50 independent ones by 2.2 standard deviations, that of 1000 by 3.2.
Therefore the load at a turn is not the extreme itself. It is estimated by a parabola through all neighbours whose
torques differ from the extreme by less than the noise explains (`LoadPath.least`), evaluated in their middle: the mean
of a plateau, with 1.5 times its standard deviation, or the top of a peak. Under white noise the bias that remains is at
most half of the standard deviation of the smoothed force (0.08 N for readings at 100 Hz that scatter by 0.3 N).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.kinematics import jacobian
from scara_kinetostatic.model.load_history import torques_of
from scara_kinetostatic.touches.holds import Hold
from scara_kinetostatic.touches.signals import SMOOTHING, Signals, median_of_three, moving_mean
from scara_kinetostatic.touches.tare import Tare

_SIGMAS = 6.0
"""The load turns if it comes back by more than this many standard deviations of the smoothed force,"""
_STEADY = 0.004
"""and by more than this part of the largest force of the contact."""
_FEWEST_FITTED = 5
"""Fewer samples than this are averaged instead of a parabola fitted to them."""


class Turn(NamedTuple):
    """A moment at which the load turned.

    Attributes:
        stamp: when, ns.
        state: q1, q2, rad, and fx, fy on the object in the frame of the sensor, N.
        torque: of both joints by the nominal parameters, Nm.
    """

    stamp: int
    state: tuple[float, ...]
    torque: tuple[float, float]


class ContactLoad(NamedTuple):
    """A contact whose load is wanted: when it begins and ends, s, the zero of its force, and its holds."""

    begin: float
    end: float
    tare: Tare
    holds: tuple[Hold, ...]


class LoadPath(NamedTuple):
    """The load in one contact at k moments.

    Attributes:
        time: since the start of the recording, (k,), s.
        value: q1, q2, rad, fx, fy on the object in the frame of the sensor, N, and both torques, Nm, (k, 6).
        least: change of the torques that the noise explains, (2,), Nm.
        start: first stamp of the recording, ns.
    """

    time: Floats
    value: Floats
    least: Floats
    start: int

    @property
    def torque(self) -> Floats:
        """Torques of both joints, (k, 2), Nm."""
        return self.value[:, 4:]

    def neighbours(self, at: int) -> tuple[int, int]:
        """The samples around one that differ from it by no more than the noise: the first, the one after the last."""
        off = (np.abs(self.torque - self.torque[at]) > self.least).any(axis=1)
        before, after = np.flatnonzero(off[:at]), np.flatnonzero(off[at:])
        return int(before[-1]) + 1 if len(before) else 0, at + int(after[0]) if len(after) else len(off)

    def turn(self, at: int, first: int, end: int) -> Turn:
        """The turn at a sample, estimated from those of a range around it."""
        value = _top(self.value[first:end]).tolist()
        return Turn(self.start + round(1e9 * float(self.time[at])), tuple(value[:4]), (value[4], value[5]))

    def unloaded(self) -> Turn:
        """The end of the contact: no load."""
        joints = self.value[-1, :2].tolist() if len(self.value) else [0.0, 0.0]
        return Turn(self.start + round(1e9 * float(self.time[-1])) + 1, (*joints, 0.0, 0.0), (0.0, 0.0))


def load_paths(signals: Signals, contacts: list[ContactLoad], cell: Cell) -> list[LoadPath]:
    """The loads of contacts.

    Args:
        signals: the recording.
        contacts: the contacts in the order of time.
        cell: nominal parameters, frame and sign of the sensor.
    """
    if not contacts:
        return []
    wrench = signals.filtered
    half = round(0.5 * SMOOTHING / wrench.period)
    bounds = np.searchsorted(wrench.time, [(contact.begin, np.nextafter(contact.end, np.inf)) for contact in contacts])
    bounds = np.clip(bounds + np.array([-half, half]), 0, len(wrench.time))
    sizes = bounds[:, 1] - bounds[:, 0]
    rows = np.concatenate([np.arange(first, end) for first, end in bounds])
    stops = np.cumsum(sizes)
    zero = np.repeat([contact.tare.force for contact in contacts], sizes, axis=0)
    time, force = wrench.time[rows], moving_mean(wrench.value[rows] - zero, 2 * half + 1)
    force *= -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    angles = median_of_three(signals.joints.value)
    joints = np.column_stack([np.interp(time, signals.joints.time, column) for column in angles.T])
    state = np.hstack([joints, force])
    value = np.hstack([state, torques_of(cell.nominal, state, cell.sensor.frame)])
    levers = np.linalg.norm(jacobian(cell.nominal, joints[stops - (sizes + 1) // 2]), axis=1)
    paths = []
    for contact, begin, stop, lever in zip(contacts, stops - sizes, stops, levers, strict=True):
        inner = slice(begin + half, stop - half)
        least = _least_turn(contact, time[inner], force[inner], 2 * half + 1) * lever
        paths.append(LoadPath(time[inner], value[inner], least, signals.start))
    return paths


def _least_turn(contact: ContactLoad, time: Floats, force: Floats, width: int) -> float:
    """Change of the smoothed force that noise explains, N.

    The noise is that of the free motion before the contact, or of differences over one length of the moving mean in the
    holds, where that is larger: a slow change of the force has no influence.
    """
    noise = contact.tare.noise / np.sqrt(width)
    for hold in contact.holds:
        first, end = np.searchsorted(time, hold.intervals[0])
        if end - first > 2 * width:
            held = force[first:end]
            steps = (held[width:] - held[:-width]).ravel()
            noise = max(noise, np.sqrt(steps @ steps / (2.0 * len(steps))))
    peak = np.abs(force).max(initial=0.0)
    return max(_SIGMAS * float(noise), _STEADY * float(peak))


def _top(values: Floats) -> Floats:
    """Value in the middle of samples (n, m) in even steps, by a parabola; the mean of a few, (m,)."""
    n = len(values)
    return np.asarray(values.mean(axis=0) if n < _FEWEST_FITTED else _weights(n) @ values)


@lru_cache(maxsize=256)
def _weights(n: int) -> Floats:
    """Weights by which n samples in even steps give the value in their middle of a parabola fitted to them, (n,)."""
    square = np.linspace(-1.0, 1.0, n) ** 2
    second, fourth = square.sum(), square @ square
    return np.asarray((fourth - second * square) / (n * fourth - second**2))
