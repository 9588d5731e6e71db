"""Joint angles and force of a recording on one time axis, with the filters and statistics used on them.

The topics are not resampled: each keeps its own stamps. Only means over the same interval of time are compared between
them, so that their rates need not agree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.streams import Streams

SMOOTHING = 0.03
"""Length of the moving mean of force and joint angles, s."""


class Topic(NamedTuple):
    """One topic.

    Attributes:
        name: of the topic.
        time: since the first stamp of the recording, (n,), s, increasing.
        value: joint angles or force, (n, 2), rad or N.
        period: mean interval between stamps, gaps left out, s.
    """

    name: str
    time: Floats
    value: Floats
    period: float

    @property
    def gap_limit(self) -> float:
        """Longest pause within a touch, s: five periods, but at least 0.1 s."""
        return max(0.1, 5.0 * self.period)

    def at(self, time: Floats) -> Floats:
        """The values at some times, (k,), s: (k, 2)."""
        return np.column_stack([np.interp(time, self.time, column) for column in self.value.T])

    def stretch(self, begin: float, end: float) -> slice:
        """The samples from `begin` (included) to `end` (not included), s."""
        first, last = np.searchsorted(self.time, [begin, end], side='left')
        return slice(int(first), int(last))

    def during(self, intervals: Floats) -> Floats:
        """The values within intervals of time, (k, 2), s, one after the other: (n, 2)."""
        return np.concatenate([self.value[self.stretch(begin, end)] for begin, end in intervals])

    def longest_pause(self, begin: float, end: float) -> float:
        """Longest time without a sample that overlaps the interval from `begin` to `end`, s."""
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
        filtered: the force after a median filter of three samples, which removes spikes of a single one.
        start: first stamp of the recording, ns.
        warnings: what was left out, one sentence each.
        resolution: step of the encoders, rad; near 0 where the readings are not rounded.
    """

    joints: Topic
    wrench: Topic
    filtered: Topic
    start: int
    warnings: tuple[str, ...]
    resolution: float

    def stretch(self, begin: float, end: float) -> Signals:
        """The part from `begin` (included) to `end` (not included), s; a topic may have no samples there."""
        parts = [(topic, topic.stretch(begin, end)) for topic in (self.joints, self.wrench, self.filtered)]
        joints, wrench, filtered = (t._replace(time=t.time[part], value=t.value[part]) for t, part in parts)
        return self._replace(joints=joints, wrench=wrench, filtered=filtered)

    @property
    def window(self) -> float:
        """Time over which neighbouring means are taken, s: short, but with enough samples of either topic."""
        longest = max(self.joints.period, self.wrench.period)
        return max(0.03, 2.5 * longest)


def as_signals(streams: Streams, cell: Cell) -> Signals | None:
    """Both topics of a cell in seconds, sorted, finite, each stamp once.

    Args:
        streams: the recording.
        cell: names the topics.

    Returns:
        The signals; None where a topic has fewer than two such samples.
    """
    names, stamps = streams.topics or cell.sensor.topics, (streams.joints.stamp, streams.wrench.stamp)
    if min(map(len, stamps)) < 2:
        return None
    start = min(int(np.min(stamp)) for stamp in stamps)
    topics, warnings = list[Topic](), list[str]()
    for name, stamp, samples in zip(names, stamps, (streams.joints.position, streams.wrench.force), strict=True):
        time, value = 1e-9 * (stamp - start).astype(np.float64), np.asarray(samples, dtype=float)
        kept = np.flatnonzero(np.isfinite(value).all(axis=1))
        kept = kept[np.argsort(time[kept], kind='stable')]
        kept = kept[np.diff(time[kept], prepend=-np.inf) > 0]
        if left_out := len(time) - len(kept):
            warnings.append(f'{name}: {left_out} samples that are not finite or repeat a stamp left out')
        if len(kept) < 2:
            return None
        topics.append(Topic(name, time[kept], value[kept], _period(time[kept])))
    joints, wrench = topics
    if cell.sensor.tool_weight:
        wrench = wrench._replace(value=wrench.value - cell.tool_pull(joints.at(wrench.time)))
    common = min(joints.time[-1], wrench.time[-1]) - max(joints.time[0], wrench.time[0])
    if common < 0.5 * max(joints.time[-1] - joints.time[0], wrench.time[-1] - wrench.time[0]):
        warnings.append(f'{joints.name} and {wrench.name} have only {max(common, 0.0):.1f} s in common by their stamps')
    filtered = wrench._replace(value=median_of_three(wrench.value))
    return Signals(joints, wrench, filtered, start, tuple(warnings), _resolution(joints))


def _resolution(joints: Topic) -> float:
    """Resolution of the encoders, the coarser of both, rad; near 0 where the readings are not rounded."""
    gaps = [np.diff(np.unique(np.round(column, 12))) for column in joints.value.T]
    return max((float(gap.min()) for gap in gaps if len(gap)), default=0.0)


def _period(time: Floats) -> float:
    """Mean interval between stamps without the longest 5 %; unlike the median it is right for samples in bursts."""
    steps = np.sort(np.diff(time))
    return float(steps[: max(1, round(0.95 * len(steps)))].mean())


def steps_of_mean(topic: Topic, time: Floats, window: float) -> tuple[Floats, Floats]:
    """Difference of neighbouring means: a step or a slope of a signal, with little of its noise.

    Args:
        topic: the signal x(t), taken as piecewise linear.
        time: k times, s, increasing.
        window: w, s.

    Returns:
        (mean of x over [t, t + w]) - (mean over [t - w, t]), and the mean over both, (k, 2) each; the difference is
        infinite where the topic has no two samples near.
    """
    near = topic.stretch(time[0] - window - 2 * topic.gap_limit, time[-1] + window + 2 * topic.gap_limit)
    stamps, values = topic.time[near], topic.value[near]
    if len(stamps) < 2:
        return np.full((len(time), 2), np.inf), np.zeros((len(time), 2))
    area = np.diff(stamps)[:, None] * 0.5 * (values[1:] + values[:-1])
    integral = np.concatenate([np.zeros((1, 2)), np.cumsum(area, axis=0)])
    low, mid, high = (
        np.column_stack([np.interp(time + side, stamps, column) for column in integral.T])
        for side in (-window, 0.0, window)
    )
    return (high - 2.0 * mid + low) / window, (high - low) / (2.0 * window)


def moving_mean(values: Floats, width: int) -> Floats:
    """Centred mean over `width` (odd) samples, shorter at the ends, (n, 2)."""
    half = width // 2
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(values, axis=0)])
    position = np.arange(len(values))
    low, high = np.maximum(position - half, 0), np.minimum(position + half + 1, len(values))
    mean: Floats = (sums[high] - sums[low]) / (high - low)[:, None]
    return mean


def median_of_three(values: Floats) -> Floats:
    """Median filter of three samples, (n, 2); the first and the last sample stay."""
    before, after = values[:-2], values[2:]
    result = values.copy()
    low, high = np.minimum(before, after), np.maximum(before, after)
    np.clip(values[1:-1], low, high, out=result[1:-1])
    return result


def median(values: Floats) -> Floats:
    """Median over the first axis of at least one sample; five times as fast as `np.median` for the few of a hold."""
    ordered, last = np.sort(values, axis=0), len(values) - 1
    return np.asarray(0.5 * (ordered[last // 2] + ordered[(last + 1) // 2]))


def white_noise(values: Floats) -> float:
    """Standard deviation of the white noise of samples (n, 2), the larger of both components.

    1.4826 times the median absolute deviation of the differences of neighbours, divided by the square root of 2: a
    steady motion has no influence, nor have a few large steps. 0 for fewer than four samples.
    """
    if len(values) < 4:
        return 0.0
    steps = np.diff(values, axis=0)
    steps -= median(steps)
    return float(1.4826 * median(np.abs(steps)).max() / np.sqrt(2.0))


def robust_mean(values: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation, (2,) each, of samples (n, 2) without outliers.

    These are farther from the median than four times the range of the middle 68 %.
    """
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
    return center + mean, scatter


def runs(mask: Mask) -> tuple[Indices, Indices]:
    """First and last index of every run of True."""
    edges = np.diff(np.concatenate([[0], mask.view(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
