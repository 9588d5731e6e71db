"""What arrives: joint angles and forces with their stamps, the frame of the forces, and both on one time axis.

The forces are taken in the frame that `sensor.frame` states, the base or the tool. Its names in ROS are `NAMES`. Where
fixed transforms (`/tf_static`) connect the `frame_id` of a wrench with such a frame, the force is turned by them:

    f = R f_id,    R the rotation of the frame `frame_id` in that frame,

of which the two components in the plane are used. A sensor that is mounted with a turn, or upside down, so gives the
force in the frame stated. Only fixed transforms count: a sensor is mounted once. A recording holds the wrenches as they
came, and the transforms; each reader of forces, the collector and the reader of recordings, turns them once, by this
code. `sensor.base_frame` and `sensor.tool_frame` name the frames where a prefix or a driver calls them otherwise. A
`frame_id` that is neither known nor fixed to a known frame is said: nobody knows how the sensor is turned, unless the
cell states how it is mounted. A frame of a robot of which `robot.plane` is stated is not that of link 2, unless
`sensor.tool_frame` names it: there the transforms count for forces in the base, and those in the tool are taken as
`sensor.rotation` or `sensor.axes` say.

On their time axis, the topics are not resampled: each keeps its own stamps. Only means over the same interval of time
are compared between them, so that their rates need not agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import acos, degrees
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Indices, Mask, interpolated
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.parameters import NANO


@dataclass(frozen=True)
class JointStream:
    """Joint angles as they came, but for a coupling of the joints (`Cell.angles`).

    Attributes:
        stamp: header stamps, (n,), ns.
        position: q1, q2, (n, 2), rad.
        others: of the cell's other joints, (n, h), rad or m, NaN where a message has none; None where there are none.
    """

    stamp: NDArray[np.int64]
    position: Floats
    others: Floats | None = None

    @classmethod
    def of(cls, stamp: NDArray[np.int64], values: Floats) -> JointStream:
        """From rows of q1, q2 and the other joints, (n, 2 + h)."""
        return cls(stamp, values[:, :2], values[:, 2:])

    def moved(self, cell: Cell) -> Mask:
        """In which samples another joint is not where the cell holds it, (n,)."""
        none = np.zeros(len(self.stamp), dtype=bool)
        return none if self.others is None else none | cell.moved(self.others).any(axis=1)

    def while_held(self, cell: Cell) -> JointStream:
        """The other samples."""
        kept = ~self.moved(cell)
        return self if kept.all() else JointStream(self.stamp[kept], self.position[kept])


@dataclass(frozen=True)
class WrenchStream:
    """Forces as they came: sign, frame and zero are still the sensor's.

    Attributes:
        stamp: header stamps, (n,), ns.
        force: fx, fy, (n, 2), N.
    """

    stamp: NDArray[np.int64]
    force: Floats


@dataclass(frozen=True)
class Streams:
    """Both streams of one recording.

    Attributes:
        source: the file or topic pair they come from, for messages.
        joints: joint angles.
        wrench: forces.
        warnings: what was dropped or mended on reading, one sentence each.
        topics: the names of both, where they are not those of the cell description.
        discarded: touches that were discarded while recording, each by a stamp within its hold, ns.
        turned: how the forces were turned by their `frame_id`; empty where they were not.
        force_ranges: of fx, fy and fz as they came, without spikes, (3,), N; None where turned or unknown.
    """

    source: str
    joints: JointStream
    wrench: WrenchStream
    warnings: tuple[str, ...] = field(default=())
    topics: tuple[str, str] | None = None
    discarded: tuple[int, ...] = ()
    turned: str = ''
    force_ranges: Floats | None = None


ALTERNATE = 'the positions alternate: two publishers?'


def alternate(positions: Floats) -> bool:
    """Whether joint angles in the order of time, (n, 2), rad, jump back and forth between two motions.

    In a motion of one robot a step from sample to sample is followed by its like; with messages of another publisher
    in between many large steps are undone by the next large one.
    """
    if len(positions) < 3:
        return False
    steps = np.diff(positions[:, int(np.argmax(np.ptp(positions, axis=0)))])
    jumps = steps[np.abs(steps) > 5e-3]  # less may be noise, or the resolution of an encoder
    undone = int(np.sum(np.abs(jumps[1:] + jumps[:-1]) < 0.05 * np.abs(jumps[1:])))
    return undone >= max(6, 0.05 * len(positions))


NAMES = {SensorFrame.BASE: ('base_link', 'base', 'world'), SensorFrame.TOOL: ('tool0', 'tool', 'flange', 'tcp')}
"""Usual names of both frames, without what a prefix puts before the last slash; the first is that of the URDF, and an
earlier one counts where several are connected."""


class FixedTransform(NamedTuple):
    """A transform that does not change.

    Attributes:
        parent: frame.
        child: frame.
        quaternion: x, y, z, w of the rotation of the child in the parent.
    """

    parent: str
    child: str
    quaternion: tuple[float, float, float, float]


class WrenchFrame:
    """What the `frame_id` of wrenches says, beside the cell description.

    Args:
        cell: whose sensor it is.
        prefix: before the names of frames, where the node has one.
    """

    def __init__(self, cell: Cell, prefix: str = '') -> None:
        sensor, plane, base, tool = cell.sensor, cell.plane, *NAMES.values()
        self._stated, self._axes, self._prefix = sensor.frame, cell.force_axes, prefix.lstrip('/')
        self._plane = plane.axes.T if self._stated is SensorFrame.BASE else np.eye(3)
        if plane.is_stated:
            base, tool = (plane.frame,), ()
        named = [(name.lstrip('/'),) if name else usual for name, usual in zip(sensor[-2:], (base, tool), strict=True)]
        self._names: dict[SensorFrame, tuple[str, ...]] = dict(zip(NAMES, named, strict=True))
        self._is_mounted = bool(sensor.axes or sensor.rotation or not self._names[self._stated])
        self._neighbours: dict[str, dict[str, Floats]] = {}

    def add(self, transform: FixedTransform) -> None:
        """Notes a fixed transform; a later one between the same frames replaces it. One without a rotation is none."""
        turn = _matrix(transform.quaternion)
        if turn is None:
            return
        parent, child = transform.parent.lstrip('/'), transform.child.lstrip('/')
        self._neighbours.setdefault(parent, {})[child] = turn.T
        self._neighbours.setdefault(child, {})[parent] = turn

    def turn(self, frame_id: str) -> Floats | None:
        """How wrenches with a `frame_id` give the force in the plane, (2, 3); None: they are taken as they come."""
        start = frame_id.lstrip('/')
        frame, name, turn = self._known_frame(start)
        axes = self._plane[:2] @ turn if frame is self._stated and name != start else self._axes
        return None if np.allclose(axes, np.eye(3)[:2], rtol=0, atol=NANO) else axes

    def description(self, frame_id: str) -> str:
        """How the forces are turned, in words; empty where they are not."""
        _, name, turn = self._known_frame(frame_id.lstrip('/'))
        if (axes := self.turn(frame_id)) is None:
            return ''
        if axes is self._axes:
            return 'forces turned into the plane as the cell description states'
        angle = degrees(acos(min(1.0, max(-1.0, (float(np.trace(turn)) - 1) / 2))))
        return f'forces turned by {angle:.3g} degrees from {frame_id} into {name}'

    def complaint(self, frame_id: str) -> str:
        """How a `frame_id` contradicts the cell description, or that it is not known; empty if neither, or without one.

        A frame that is not known does no harm where the cell description states how the sensor is mounted.
        """
        start = frame_id.lstrip('/')
        frame, name, _ = self._known_frame(start)
        if frame is self._stated or not start or (frame is None and self._is_mounted):
            return ''
        if frame is None:
            stated, known = self._stated.value, ', '.join(self._names[self._stated])
            like = [each for each in self._turns(start) if each.endswith(NAMES[self._stated])]
            named = f'{like[0]} if that is it' if like else f'its name, {start} where that is not turned against it'
            unknown = f'frame_id {frame_id!r} is no known frame ({known}), nor fixed to one on /tf_static'
            if name:
                unknown = f'frame_id {frame_id!r} is fixed to {name}, but {like[0]}, turned against it, is nearer'
            remedy = f'set sensor.{stated}_frame, the name of the {stated}, to {named}, or state sensor.rotation'
            return f'{unknown}; forces are taken as in the {stated}: {remedy}'
        how = f'is fixed to {name}' if name != start else f'is a frame of the {frame.value}'
        stated = f'the cell description states sensor.frame: {self._stated.value}'
        return f'frame_id {frame_id!r} {how}, but {stated}; one of them is wrong'

    def _known_frame(self, start: str) -> tuple[SensorFrame | None, str, Floats]:
        """The frame with a usual name that is fixed to one, its name and the rotation into it.

        That which the cell states counts before the other, a nearer one before one that is farther off. None, with the
        name: something nearer that is turned against it is called like a base; as of one of two arms in one world.
        """
        turns = self._turns(start)
        for frame in sorted(self._names, key=lambda frame: frame is not self._stated):
            for usual in (usuals := self._names[frame]):
                nearer = list[Floats]()  # of what may be the base of this arm, where none is named
                for name, turn in turns.items():
                    called = {name, name.rpartition('/')[2], name.removeprefix(self._prefix)}
                    if usual in called:
                        is_doubtful = any(not np.allclose(other, turn, rtol=0, atol=NANO) for other in nearer)
                        return (None, name, turns[start]) if is_doubtful else (frame, name, turn)
                    if frame is self._stated is SensorFrame.BASE and len(usuals) > 1 and called.isdisjoint(usuals):
                        nearer += [turn] if name.endswith(usuals) else []
        return None, '', turns[start]

    def _turns(self, start: str) -> dict[str, Floats]:
        """The frames that are fixed to one, itself included, nearer ones first, with the rotation into each."""
        turns = {start: np.eye(3)}
        waiting = [start]
        for name in waiting:
            for neighbour, step in self._neighbours.get(name, {}).items():
                if neighbour not in turns:
                    turns[neighbour] = step @ turns[name]
                    waiting.append(neighbour)
        return turns


def _matrix(quaternion: Sequence[float]) -> Floats | None:
    """The rotation matrix of a quaternion x, y, z, w; None where it is no rotation."""
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0):
        return None
    x, y, z, w = np.asarray(quaternion) / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


SMOOTHING = 0.03
"""Length of the moving mean of force and joint angles, s."""


class Thresholds:
    """What makes a contact, a hold, a touch; times in s, forces in N, angles in rad, lengths in m."""

    sigmas: float = 6.0
    """Noise alone does not make more of its standard deviations; and misses are within so many medians."""
    brief: float = 0.05
    """What is shorter is an interruption, or a spike, and is left out beside an event."""
    pause: float = 0.1
    """What is shorter is not looked at: pauses of a topic, stretches of steady samples, joint readings that are equal
    before a contact."""
    few: int = 5
    """So few samples or periods make no estimate: of a zero, of frozen readings, of a gap."""

    samples: float = 2.5
    """A mean is over so many samples or more."""

    grid: float = 0.025
    """Interval over which force and joint travel are taken together for the coarse zero."""
    largest_weight: float = 0.01
    """Largest weight of one such interval: a joint travel beyond this counts no more."""
    block: float = 10.0
    """The coarse zero is estimated once in so long."""
    least_share: float = 0.05
    """A block with less than this part of the mean joint travel of all blocks gives no coarse zero."""
    longest_free: float = 2.0
    """At most so long before a contact is used for its zero."""
    before_contact: float = 0.02
    """Left out before the contact."""
    smallest_deviation: float = 1e-3
    """Smallest deviation from the zero that marks the begin of a contact, for sensors without noise."""
    onset_sigmas: float = 4.0
    """The same as a multiple of the standard deviation of the smoothed force."""

    least_turning: float = 0.2
    """A smaller zero that turns with link 2 changes no touch: that before each takes most of it. Source: 50 g."""
    cluster: float = 2.5
    """Residuals of its fit further apart than this are independent."""
    fewest_clusters: int = 4
    """Less do not show a standard deviation."""
    outlying: float = 3.0
    """Residuals beyond this many times their median are left out of it."""
    rounds: int = 6
    """Of the fit, each without the outliers of the one before."""

    shortest_hold: float = 0.2
    """A shorter hold is not a touch."""
    hold_sigmas: float = 5.0
    """A difference of neighbouring means is a change if it exceeds this many of its standard deviations."""
    steady_force: float = 0.004
    """Difference of neighbouring means of the force up to which it is steady, relative to the force."""
    rough_contact: float = 0.02
    """White noise of the force in contact is accepted up to this part of it, where it exceeds that before."""
    same_force: float = 0.01
    """Two holds are one if their forces differ by less, relative to the force; slow noise before counts up to this."""
    same_joint: float = 5e-5
    """And if their joint angles differ by less."""
    steady_joint: float = 1e-3
    """Speed up to which a joint is at rest, rad/s."""
    highest_joint_noise: float = 1e-4
    """Noise of the joint readings is accepted up to this; more is a motion."""
    loaded: float = 0.5
    """A contact is under load while the force exceeds this part of its largest value."""
    peak: float = 0.5
    """A hold shorter than three windows and than this part of the longest one in its contact is left out: the means on
    both sides of a peak of the force agree as well."""
    largest_drift: float = 0.03
    """Accepted change of the force from the first to the last third of a hold, relative to the force,"""
    fastest_drift: float = 0.1
    """and the same per second, 1/s; the smaller one holds, but never less than `sigmas` of that change by noise."""
    largest_scatter: float = 0.1
    """Accepted standard deviation of the force in a hold, relative to the force,"""
    scatter_sigmas: float = 4.0
    """but never less than this many times the noise before the contact."""
    largest_joint_scatter: float = 1e-3
    """Accepted standard deviation of a joint angle in a hold: ten times the noise with which a hold is found."""
    largest_slide: float = 2e-4
    """Accepted change of a joint angle from the first to the last third of a hold."""
    clear_change: float = 2.0
    """A part of such a hold is steady if the rest changes by more than this many times what is none: pieces of a steady
    change are seldom so by chance."""
    weak_force: float = 0.5
    """A contact without a hold under less force than this part of the smallest force of a hold,"""
    weak_travel: float = 0.03
    """in which a joint moves by more than this, is not a touch: the force is that of the arm's acceleration."""
    samples_of_hold: int = 10
    """Of the slower topic under load, needed to find a hold: means of `samples` before and after."""

    largest_miss_nominal: float = 0.08
    """A touch belongs to a disc if its miss with the nominal geometry is at most this."""
    largest_miss_fitted: float = 0.03
    """The same with the fitted model, or `sigmas` times the median miss, where that is more."""
    fewest_for_fit: int = 8
    """Touches needed for the fit."""
    inner_corner: float = 0.01
    """A rejected touch at most so far from both edges of an inner corner is taken for one of both."""
    largest_friction_angle: float = 0.35
    """Accepted angle between the force and the normal of the disc (friction, noise)."""


class Signal(NamedTuple):
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
        return max(Thresholds.pause, Thresholds.few * self.period)

    def at(self, time: Floats) -> Floats:
        """The values at some times, (k,), s: (k, 2)."""
        return interpolated(time, self.time, self.value)

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

    joints: Signal
    wrench: Signal
    filtered: Signal
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
        return max(SMOOTHING, Thresholds.samples * longest)


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
    topics, warnings = list[Signal](), list[str]()
    for name, stamp, samples in zip(names, stamps, (streams.joints.position, streams.wrench.force), strict=True):
        time, value = NANO * (stamp - start).astype(np.float64), np.asarray(samples, dtype=float)
        kept = np.flatnonzero(np.isfinite(value).all(axis=1))
        kept = kept[np.argsort(time[kept], kind='stable')]
        kept = kept[np.diff(time[kept], prepend=-np.inf) > 0]
        if left_out := len(time) - len(kept):
            warnings.append(f'{name}: {left_out} samples that are not finite or repeat a stamp left out')
        if len(kept) < 2:
            return None
        topics.append(Signal(name, time[kept], value[kept], _period(time[kept])))
    joints, wrench = topics
    if cell.sensor.tool_weight:
        wrench = wrench._replace(value=wrench.value - cell.tool_pull(joints.at(wrench.time)))
    common = min(joints.time[-1], wrench.time[-1]) - max(joints.time[0], wrench.time[0])
    if common < 0.5 * max(joints.time[-1] - joints.time[0], wrench.time[-1] - wrench.time[0]):
        warnings.append(f'{joints.name} and {wrench.name} have only {max(common, 0.0):.1f} s in common by their stamps')
    filtered = wrench._replace(value=median_of_three(wrench.value))
    gaps = [np.diff(np.unique(np.round(column, 12))) for column in joints.value.T]
    resolution = max((float(gap.min()) for gap in gaps if len(gap)), default=0.0)  # of the coarser encoder
    return Signals(joints, wrench, filtered, start, tuple(warnings), resolution)


def _period(time: Floats) -> float:
    """Mean interval between stamps without the longest 5 %; unlike the median it is right for samples in bursts."""
    steps = np.sort(np.diff(time))
    return float(steps[: max(1, round(0.95 * len(steps)))].mean())


def steps_of_mean(topic: Signal, time: Floats, window: float) -> tuple[Floats, Floats]:
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
    low, mid, high = (interpolated(time + side, stamps, integral) for side in (-window, 0.0, window))
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
