"""Where the arm is in contact, told from the force alone.

The sensor's zero is unknown and may be larger than a light touch. It shows while the
arm moves freely: the force stays while the joints go a long way. In contact the
joints hardly move. So the densest place of the force, every sample weighted with the
way of the joints, is the zero; taken afresh every few seconds, it follows a drift.
It serves to find the contacts only; each touch then takes its own zero (`zero`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.touches.signals import Floats, Signals, Topic, median_of_three, runs, white_noise

MOVING = 0.01
"""A way of the joints beyond this within a cell of the grid counts no more, rad."""
CELL = 0.025
"""Grid on which the zero is looked for, s."""
BLOCK = 10.0
"""The zero is taken afresh this often, s."""
SMOOTHING = 0.03
"""The force is averaged over this long before it is compared, s."""
ON = 1.0
"""Deviation from the zero at which contact begins, N, if the noise allows."""
ON_SIGMAS = 6.0
OFF_PART = 0.5
"""Contact ends below this part of the deviation at which it begins."""
BOUNCE = 0.05
"""A loss of contact shorter than this is a bounce, s."""
GLITCH = 0.05
"""A deviation shorter than this is a spike, no contact, s."""


class Contacts(NamedTuple):
    """The contacts of a recording.

    Attributes:
        begin: time of the first sample of each in contact, (m,), s.
        end: time of the last sample, (m,), s.
        peak: largest deviation from the coarse zero in each, (m,), N.
        way: span of the joint that goes farthest in each, (m,), rad.
        glitches: how many spikes were passed over.
    """

    begin: Floats
    end: Floats
    peak: Floats
    way: Floats
    glitches: int

    def select(self, which: NDArray[np.bool_]) -> Contacts:
        """The contacts that a mask picks."""
        return Contacts(self.begin[which], self.end[which], self.peak[which], self.way[which], self.glitches)


def find_contacts(signals: Signals) -> Contacts:
    """All contacts in the order of time."""
    wrench = signals.wrench
    width = 2 * round(0.5 * SMOOTHING / wrench.period) + 1
    smooth = moving_mean(signals.calm.value, width)
    smooth -= coarse_tare(signals)
    deviation = np.hypot(smooth[:, 0], smooth[:, 1])
    on = max(ON, ON_SIGMAS * white_noise(wrench.value) / np.sqrt(width))
    first, last = runs(_with_hysteresis(deviation, on, OFF_PART * on))
    begin, end = wrench.time[first], wrench.time[last]
    apart = begin[1:] - end[:-1] >= BOUNCE
    begin, end = begin[np.append(True, apart)[: len(begin)]], end[np.append(apart, True)[: len(end)]]
    lasting = end - begin > max(GLITCH, (width + 1) * wrench.period)
    begin, end = begin[lasting], end[lasting]
    peak = [deviation[wrench.stretch(b, e)].max() for b, e in zip(begin, end, strict=True)]
    inside = [signals.joints.value[signals.joints.stretch(b, e)] for b, e in zip(begin, end, strict=True)]
    way = [np.ptp(joints, axis=0).max() if len(joints) else 0.0 for joints in inside]
    return Contacts(begin, end, np.array(peak), np.array(way), int(np.sum(~lasting)))


def _with_hysteresis(deviation: Floats, on: float, off: float) -> NDArray[np.bool_]:
    """True from where the deviation exceeds `on` to where it falls below `off`."""
    decided = np.where(deviation > on, 1, np.where(deviation < off, -1, 0)).astype(np.int8)
    latest = np.where(decided != 0, np.arange(len(decided)), 0)
    contact: NDArray[np.bool_] = decided[np.maximum.accumulate(latest)] > 0
    return contact


def moving_mean(values: Floats, width: int) -> Floats:
    """Centred mean over `width` (odd) samples, shorter at the ends, (n, 2)."""
    half = width // 2
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(values, axis=0)])
    position = np.arange(len(values))
    low, high = np.maximum(position - half, 0), np.minimum(position + half + 1, len(values))
    mean: Floats = (sums[high] - sums[low]) / (high - low)[:, None]
    return mean


def coarse_tare(signals: Signals) -> Floats:
    """What the sensor reads without force, at every wrench sample, (n, 2), N."""
    wrench = signals.wrench
    time, force, way = _on_grid(signals.joints, signals.calm)
    block = (time // BLOCK).astype(np.intp)
    whole = weighted_mode(force, way)
    enough = 0.05 * way.sum() / (block[-1] + 1)
    centers, zeros = [], []
    for first, last in zip(*_equal_runs(block), strict=True):
        part = slice(first, last + 1)
        if way[part].sum() > enough:
            centers.append(time[part].mean())
            zeros.append(weighted_mode(force[part], way[part]))
    if not zeros:
        return np.broadcast_to(whole, wrench.value.shape)
    course = median_of_three(np.array(zeros))
    return np.column_stack([np.interp(wrench.time, centers, column) for column in course.T])


def _on_grid(joints: Topic, wrench: Topic) -> tuple[Floats, Floats, Floats]:
    """Time (k,), mean force (k, 2) and way of the joints (k,) in every cell of time that holds force samples."""
    size = max(CELL, 2.5 * wrench.period)
    first, last = _equal_runs((wrench.time // size).astype(np.intp))
    count = (last - first + 1)[:, None]
    force = np.add.reduceat(wrench.value, first, axis=0) / count
    time = (np.floor(wrench.time[first] / size) + 0.5) * size
    begin, end = (
        np.column_stack([np.interp(time + side * size, joints.time, column) for column in joints.value.T])
        for side in (-0.5, 0.5)
    )
    return time, force, np.minimum(np.abs(end - begin).sum(axis=1), MOVING)


def weighted_mode(values: Floats, weight: Floats) -> Floats:
    """The densest place of points in the plane, (2,), by halving: the half-sample mode.

    Along x and y in turn, the shortest interval with half of the weight is kept,
    until few points are left.

    Args:
        values: points, (n, 2).
        weight: their weights, (n,); all alike where their sum is 0.
    """
    if not weight.sum() > 0:
        weight = np.ones(len(values))
    axis, unchanged = 0, 0
    while len(values) > 8 and unchanged < 2:
        order = np.argsort(values[:, axis], kind='stable')
        total = np.cumsum(weight[order])
        half = 0.5 * total[-1]
        start = np.flatnonzero(total - weight[order] <= half)
        stop = np.searchsorted(total, total[start] - weight[order][start] + half * (1 - 1e-12))
        stop = np.minimum(stop, len(order) - 1)
        best = np.argmin(values[order[stop], axis] - values[order[start], axis])
        keep = order[start[best] : stop[best] + 1]
        unchanged = unchanged + 1 if len(keep) == len(values) else 0
        values, weight, axis = values[keep], weight[keep], 1 - axis
    mode: Floats = np.average(values, axis=0, weights=np.maximum(weight, 1e-300))
    return mode


def _equal_runs(labels: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last position of every run of equal labels."""
    change = np.flatnonzero(np.diff(labels))
    return np.append(0, change + 1), np.append(change, len(labels) - 1)
