"""Both topics on one time axis in seconds, sorted and finite, with the tools to look at a stretch of one.

The topics are never resampled: each keeps its own stamps. What is compared between
them are means over the same stretch of time, so that their rates need not agree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.streams import Streams

Floats = NDArray[np.float64]

SHORTEST_GAP = 0.1
"""A pause of a topic up to this long is never called a gap, s."""
HALF = 0.03
"""Time over which neighbouring means are taken, s, if the rates allow."""
GAP_PERIODS = 5.0
"""Nor is one of up to this many periods."""


class Topic(NamedTuple):
    """One topic.

    Attributes:
        name: of the topic.
        time: since the first stamp of the recording, (n,), s, increasing.
        value: joint angles or force, (n, 2), rad or N.
        period: mean distance of two stamps, gaps left out, s.
    """

    name: str
    time: Floats
    value: Floats
    period: float

    @property
    def gap_limit(self) -> float:
        """Longest pause within a touch, s."""
        return max(SHORTEST_GAP, GAP_PERIODS * self.period)

    def stretch(self, begin: float, end: float) -> slice:
        """The samples from `begin` to `end`."""
        first, last = np.searchsorted(self.time, [begin, end], side='left')
        return slice(int(first), int(last))

    def during(self, intervals: Floats) -> Floats:
        """The samples within intervals (k, 2) of time, (n, 2)."""
        return np.concatenate([self.value[self.stretch(begin, end)] for begin, end in intervals])

    def at(self, time: float) -> Floats:
        """The value at a time, by linear interpolation, (2,)."""
        near = self.stretch(time - 10 * self.period, time + 10 * self.period)
        near = slice(max(near.start - 1, 0), near.stop + 1)
        return np.array([np.interp(time, self.time[near], column) for column in self.value[near].T])

    def longest_pause(self, begin: float, end: float) -> float:
        """Longest time between two samples that overlaps a stretch, s; past the ends of the topic as well."""
        first = max(int(np.searchsorted(self.time, begin, side='right')) - 1, 0)
        last = int(np.searchsorted(self.time, end, side='left')) + 1
        inside = self.time[first:last]
        bounds = np.concatenate([np.minimum(inside[:1], begin), inside, np.maximum(inside[-1:], end)])
        return float(np.diff(bounds).max()) if len(inside) else end - begin


class Signals(NamedTuple):
    """Both topics of one recording.

    Attributes:
        joints: joint angles, rad.
        wrench: force, N, as the sensor reports it.
        calm: the force without spikes of a single sample.
        start: first stamp of the recording, ns.
        warnings: what was left out, one sentence each.
    """

    joints: Topic
    wrench: Topic
    calm: Topic
    start: int
    warnings: tuple[str, ...]

    @property
    def half(self) -> float:
        """Time over which neighbouring means are compared, s: short, but with samples enough of either topic."""
        return max(HALF, 2.5 * self.joints.period, 2.5 * self.wrench.period)


def as_signals(streams: Streams, cell: Cell) -> Signals | None:
    """Streams on one time axis; None where a topic holds fewer than two samples."""
    pairs = (
        (cell.sensor.joint_states, streams.joints.stamp, streams.joints.position),
        (cell.sensor.wrench, streams.wrench.stamp, streams.wrench.force),
    )
    if min(len(stamp) for _, stamp, _ in pairs) < 2:
        return None
    start = min(int(np.min(stamp)) for _, stamp, _ in pairs)
    topics: list[Topic] = []
    warnings: list[str] = []
    for name, stamp, value in pairs:
        time, value, left_out = _in_order(_seconds(stamp, start), np.asarray(value, dtype=float))
        if left_out:
            warnings.append(f'{name}: {left_out} samples are not finite or repeat a stamp; left out')
        if len(time) < 2:
            return None
        topics.append(Topic(name, time, value, _period(time)))
    joints, wrench = topics
    common = min(joints.time[-1], wrench.time[-1]) - max(joints.time[0], wrench.time[0])
    if common < 0.5 * max(joints.time[-1] - joints.time[0], wrench.time[-1] - wrench.time[0]):
        warnings.append(f'{joints.name} and {wrench.name} have only {max(common, 0.0):.1f} s in common by their stamps')
    return Signals(joints, wrench, wrench._replace(value=median_of_three(wrench.value)), start, tuple(warnings))


def _seconds(stamp: NDArray[np.int64], start: int) -> Floats:
    return 1e-9 * (np.asarray(stamp) - start).astype(np.float64)


def _period(time: Floats) -> float:
    """Mean distance of two stamps without the longest; unlike the median it bears samples that come in bursts."""
    steps = np.sort(np.diff(time))
    return float(steps[: max(1, round(0.95 * len(steps)))].mean())


def _in_order(time: Floats, value: Floats) -> tuple[Floats, Floats, int]:
    """Finite samples in the order of time, one per stamp, and how many were left out."""
    count = len(time)
    finite = np.isfinite(value).all(axis=1)
    if not finite.all():
        time, value = time[finite], value[finite]
    steps = np.diff(time)
    if np.any(steps <= 0):
        order = np.argsort(time, kind='stable')
        time, value = time[order], value[order]
        fresh = np.append(True, np.diff(time) > 0)
        time, value = time[fresh], value[fresh]
    return time, value, count - len(time)


def mean_steps(topic: Topic, time: Floats, half: float) -> tuple[Floats, Floats]:
    """Mean over `half` after each time minus the mean before it, and the mean of both, (k, 2) each."""
    near = topic.stretch(time[0] - half - 2 * topic.gap_limit, time[-1] + half + 2 * topic.gap_limit)
    stamps, values = topic.time[near], topic.value[near]
    if len(stamps) < 2:
        return np.full((len(time), 2), np.inf), np.zeros((len(time), 2))
    area = np.diff(stamps)[:, None] * 0.5 * (values[1:] + values[:-1])
    integral = np.concatenate([np.zeros((1, 2)), np.cumsum(area, axis=0)])
    low, mid, high = (
        np.column_stack([np.interp(time + side, stamps, column) for column in integral.T])
        for side in (-half, 0.0, half)
    )
    return (high - 2.0 * mid + low) / half, (high - low) / (2.0 * half)


def median_of_three(values: Floats) -> Floats:
    """Every sample replaced by the median of itself and its two neighbours, (n, 2)."""
    before, after = values[:-2], values[2:]
    calm = values.copy()
    low, high = np.minimum(before, after), np.maximum(before, after)
    np.clip(values[1:-1], low, high, out=calm[1:-1])
    return calm


def median(values: Floats) -> Floats:
    """Median over the first axis of one sample or more; `np.median` asks so much first that it takes five times as long
    for the few samples of a hold.
    """
    ordered, last = np.sort(values, axis=0), len(values) - 1
    return np.asarray(0.5 * (ordered[last // 2] + ordered[(last + 1) // 2]))


def white_noise(values: Floats) -> float:
    """Standard deviation of the white part of samples (n, 2), from the differences of neighbours.

    The median of the differences' size does not see the few that belong to a
    motion; a steady motion is taken off.
    """
    if len(values) < 4:
        return 0.0
    steps = np.diff(values, axis=0)
    steps -= median(steps)
    return float(1.4826 * median(np.abs(steps)).max() / np.sqrt(2.0))


class Middle(NamedTuple):
    """Mean and standard deviation of samples without spikes, (2,) each."""

    mean: Floats
    scatter: Floats


def robust_mean(values: Floats) -> Middle:
    """Mean of samples (n, 2) without spikes: what lies far outside the middle of the samples is left out."""
    ordered, last = np.sort(values, axis=0), len(values) - 1
    center = ordered[last // 2]
    spread = ordered[round(0.84 * last)] - ordered[round(0.16 * last)]
    if not spread.all():
        spread = np.where(spread > 0, spread, ordered[round(0.975 * last)] - ordered[round(0.025 * last)])
    off = values - center
    off[np.abs(off) > np.where(spread > 0, 4.0 * spread, np.inf)] = np.nan
    kept = np.isfinite(off)
    count, off = kept.sum(axis=0), np.where(kept, off, 0.0)
    mean = off.sum(axis=0) / count
    scatter = np.sqrt((np.where(kept, off - mean, 0.0) ** 2).sum(axis=0) / count)
    return Middle(center + mean, scatter)


def runs(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last position of every run of True."""
    edges = np.diff(np.concatenate([[0], mask.view(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
