"""Contacts of a recording, from the force alone, and the zero of the force sensor: coarsely, and before each contact.

A contact begins where the smoothed force deviates from the zero of the sensor by more than a threshold, and ends where
the deviation falls below a part of it (hysteresis).

The zero is unknown and may be larger than a light touch. `coarse_tare`, which serves to find the contacts, uses that
the arm moves freely between the contacts and hardly in them: the zero is the mode of the force readings, each weighted
with the travel of the joints meanwhile, estimated block by block so that it follows a drift. `tare_before` is the zero
of one touch, from the free motion right before its contact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.report.quantities import rounded_down
from scara_kinetostatic.touches.signals import (
    SMOOTHING,
    Signals,
    Topic,
    median,
    median_of_three,
    moving_mean,
    robust_mean,
    runs,
    steps_of_mean,
    white_noise,
)

CONTACT_FORCE = 1.0
"""Deviation from the zero at which a contact begins, N; above the drift of a zero, below usual touches."""
END_RATIO = 0.5
"""A contact ends below this part of the deviation at which it begins."""


SHORTEST_FREE = 0.1
"""Free motion needed for a zero, s."""
AFTER_CONTACT = 0.05
"""Left out after the previous contact, s."""


class Settings:
    """What a contact is, and how the zero is found.

    Attributes:
        contact_sigmas: deviation at which a contact begins as a multiple of the standard deviation of the smoothed
            force, where that is larger than `CONTACT_FORCE`.
        longest_bounce: two contacts with a shorter loss of contact between them are one, s.
        shortest_contact: a shorter deviation is a spike of the sensor, not a contact, s.
        grid: interval over which force and joint travel are taken together for the coarse zero, s.
        largest_weight: largest weight of one such interval: a joint travel beyond this counts no more, rad.
        block: the coarse zero is estimated once in so long, s.
        least_share: a block with less than this part of the mean joint travel of all blocks gives no coarse zero.
        longest_free: at most so long before a contact is used for its zero, s.
        before_contact: left out before the contact, s.
        smallest_deviation: smallest deviation from the zero that marks the begin of a contact, N, for sensors
            without noise.
        onset_sigmas: the same as a multiple of the standard deviation of the smoothed force.
        fewest_samples: samples of the force needed for a zero.
    """

    contact_sigmas: float = 6.0
    longest_bounce: float = 0.05
    shortest_contact: float = 0.05
    grid: float = 0.025
    largest_weight: float = 0.01
    block: float = 10.0
    least_share: float = 0.05
    longest_free: float = 2.0
    before_contact: float = 0.02
    smallest_deviation: float = 1e-3
    onset_sigmas: float = 4.0
    fewest_samples: int = 5


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

    def select(self, which: Mask) -> Contacts:
        """The contacts where a mask, (m,), is true."""
        return self._replace(**{name: getattr(self, name)[which] for name in self._fields[:4]})


def find_contacts(signals: Signals, zero: Floats | None = None, longest_smoothing: float = SMOOTHING) -> Contacts:
    """All contacts in the order of time.

    Args:
        signals: the recording.
        zero: of the force sensor where it is known, (2,), N; None to take it from where the arm moves most.
        longest_smoothing: where the noise asks for it the force is smoothed for so long, s.
    """
    wrench, noise = signals.wrench, white_noise(signals.wrench.value)
    shortest, longest = (2 * round(0.5 * time / wrench.period) + 1 for time in (SMOOTHING, longest_smoothing))
    needed = 2 * round(0.5 * (Settings.contact_sigmas * noise / CONTACT_FORCE) ** 2) + 1
    width = int(np.clip(needed, shortest, longest))
    smooth = moving_mean(signals.filtered.value, width)
    smooth -= coarse_tare(signals) if zero is None else zero
    deviation = np.hypot(smooth[:, 0], smooth[:, 1])
    on = max(CONTACT_FORCE, Settings.contact_sigmas * noise / float(np.sqrt(width)))
    first, last = runs(_with_hysteresis(deviation, on, END_RATIO * on))
    begin, end = wrench.time[first], wrench.time[last]
    apart = begin[1:] - end[:-1] >= Settings.longest_bounce
    begin, end = begin[np.append(True, apart)[: len(begin)]], end[np.append(apart, True)[: len(end)]]
    lasting = end - begin > max(Settings.shortest_contact, (width + 1) * wrench.period)
    begin, end = begin[lasting], end[lasting]
    peak = [deviation[wrench.stretch(b, e)].max() for b, e in zip(begin, end, strict=True)]
    inside = [signals.joints.value[signals.joints.stretch(b, e)] for b, e in zip(begin, end, strict=True)]
    travel = [np.ptp(joints, axis=0).max() if len(joints) else 0.0 for joints in inside]
    smoothing = SMOOTHING if width == shortest else width * wrench.period
    return Contacts(begin, end, np.array(peak), np.array(travel), int(np.sum(~lasting)), on, smoothing)


def _with_hysteresis(deviation: Floats, on: float, off: float) -> Mask:
    """Whether each sample is in contact, (n,): from where the deviation exceeds `on` to where it falls below `off`."""
    decided = np.where(deviation > on, 1, np.where(deviation < off, -1, 0)).astype(np.int8)
    latest = np.where(decided != 0, np.arange(len(decided)), 0)
    contact: Mask = decided[np.maximum.accumulate(latest)] > 0
    return contact


class Tare(NamedTuple):
    """The zero of the force sensor before one contact.

    Attributes:
        force: the zero in the frame and sign of the sensor, (2,), N.
        noise: standard deviation of the white noise of one component, N.
        slow_noise: standard deviation of one component of the difference of neighbouring means (`steps_of_mean`), to
            which noise of low frequency contributes as well, N.
        contact: when the contact begins, s since the start of the recording.
    """

    force: Floats
    noise: float
    slow_noise: float
    contact: float


def tare_before(signals: Signals, begin: float, previous_end: float) -> Tare | str:
    """The zero of a contact.

    Args:
        signals: the recording.
        begin: time of the first sample that is clearly in contact, s.
        previous_end: time of the last sample of the previous contact, s, or -inf.

    Returns:
        The zero; why there is none where the free motion before the contact is too short, or sampled too slowly.
    """
    wrench, fewest = signals.wrench, Settings.fewest_samples
    earliest = max(previous_end + AFTER_CONTACT, begin - Settings.longest_free)
    free = wrench.stretch(earliest, begin)
    time, force = wrench.time[free], wrench.value[free]
    lasting = begin - (float(time[0]) if len(time) >= fewest else max(earliest, float(wrench.time[0])))
    if lasting < SHORTEST_FREE:
        expected = f'expected {SHORTEST_FREE} s or more for the force zero'
        return f'no free motion before it: {rounded_down(max(lasting, 0.0))} s, {expected}'
    if len(time) < fewest:
        samples = f'{len(time)} of {fewest} samples needed for the force zero'
        return f'{wrench.name} is sampled too slowly: {samples} in the {lasting:.2f} s of free motion before it'
    noise = white_noise(force)
    contact = _first_contact(time, signals.filtered.value[free], noise, wrench.period)
    before = time < contact - Settings.before_contact
    if np.sum(before) < 3:
        before = np.arange(len(time)) < 3
    steps, _ = steps_of_mean(signals.filtered, time[before], signals.window)
    # the median of the length of a vector with two normal components is 1.18 sigma
    slow_noise = float(median(np.hypot(*steps.T))) / 1.18
    return Tare(robust_mean(force[before])[0], noise, slow_noise, contact)


def _first_contact(time: Floats, force: Floats, noise: float, period: float) -> float:
    """Time after which the force stays away from the median of the free samples, s; in their later half."""
    width = 2 * round(0.5 * SMOOTHING / period) + 1
    smooth = moving_mean(force - median(force), width)
    limit = max(Settings.smallest_deviation, Settings.onset_sigmas * noise / np.sqrt(width))
    at_zero = np.flatnonzero(np.hypot(smooth[:, 0], smooth[:, 1]) < limit)
    latest = max(int(at_zero[-1]) if len(at_zero) else 0, len(time) // 2)
    return float(time[latest])


def coarse_tare(signals: Signals) -> Floats:
    """The zero of the force sensor at every wrench sample, (n, 2), N, in its frame and sign."""
    wrench = signals.wrench
    time, force, travel = grid_means(signals.joints, signals.filtered)
    block = (time // Settings.block).astype(np.intp)
    whole = _weighted_mode(force, travel)
    enough = Settings.least_share * travel.sum() / (block[-1] + 1)
    centers, zeros = [], []
    for first, last in zip(*_equal_runs(block), strict=True):
        part = slice(first, last + 1)
        if travel[part].sum() > enough:
            centers.append(time[part].mean())
            zeros.append(_weighted_mode(force[part], travel[part]))
    if not zeros:
        return np.broadcast_to(whole, wrench.value.shape)
    course = median_of_three(np.array(zeros))
    return np.column_stack([np.interp(wrench.time, centers, column) for column in course.T])


def grid_means(joints: Topic, wrench: Topic) -> tuple[Floats, Floats, Floats]:
    """Time (k,), s, mean force (k, 2), N, and joint travel (k,), rad, of every interval with force samples."""
    size = max(Settings.grid, 2.5 * wrench.period)
    first, last = _equal_runs((wrench.time // size).astype(np.intp))
    count = (last - first + 1)[:, None]
    force = np.add.reduceat(wrench.value, first, axis=0) / count
    time = (np.floor(wrench.time[first] / size) + 0.5) * size
    begin, end = joints.at(time - 0.5 * size), joints.at(time + 0.5 * size)
    return time, force, np.minimum(np.abs(end - begin).sum(axis=1), Settings.largest_weight)


def _weighted_mode(values: Floats, weight: Floats) -> Floats:
    """Mode of weighted points in the plane: the half-sample mode, along x and y in turn.

    The shortest interval with half of the weight is kept, again and again, until few points are left; the mode is
    their weighted mean (Robertson and Cryer 1974; Bickel and Fruehwirth 2006).

    Args:
        values: points, (n, 2).
        weight: their weights, (n,); all are 1 where their sum is 0.

    Returns:
        The mode, (2,).
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


def _equal_runs(labels: Indices) -> tuple[Indices, Indices]:
    """First and last index of every run of equal labels."""
    change = np.flatnonzero(np.diff(labels))
    return np.append(0, change + 1), np.append(change, len(labels) - 1)
