"""One clock for both topics: that of the header stamps where they are set, else the times of recording.

Joint angles and forces are matched by time, so both must come from one clock. Lag is stamp - recording time: the
difference of two clocks, less a delay that is never negative. The best lags of both topics, of the messages that were
least late, so tell the difference of the clocks that stamp them; the recorder's own clock cancels out:

    D = max(lag of the wrench) - max(lag of the joint states).

A constant D is taken from the stamps of the wrench, with a warning. Messages that come late, by seconds even, change
nothing. What else may be wrong with clocks is refused. `sensor.time_offset` of the cell description states D instead;
then nothing is compared. The same rule serves recordings and, observed bit by bit, the streams of a running cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Mask

Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class ClockRule:
    """What counts as one clock.

    Attributes:
        tolerance: a smaller difference of the clocks or step back stays, ns: holds last longer.
        stray_share: stamps off those around them are dropped where they are at most this part.
        interval: the best lags are compared in intervals of this, ns.
        fewest: intervals in which a drift is looked for.
        straight: clocks drift where half of the differences lie within this part of their change off a line.
        fastest: by this factor stamps may be faster or slower than real time where clocks differ.
        sure: of running streams, a difference is believed after this time, ns: at first messages may be late;
        soon: after this time, ns, where nothing is late,
        on_time: that is, the usual lags are the best ones within this, ns.
    """

    tolerance: int = 250_000_000
    stray_share: float = 0.05
    interval: int = 1_000_000_000
    fewest: int = 8
    straight: float = 0.1
    fastest: float = 2.0
    sure: int = 15_000_000_000
    soon: int = 3_000_000_000
    on_time: int = 20_000_000


class Samples(NamedTuple):
    """The samples of one topic in the order of their arrival.

    Attributes:
        stamp: header stamps, (n,), ns.
        log_time: when each was recorded, (n,), ns.
        values: q1, q2 or fx, fy, (n, 2), rad or N.
    """

    stamp: Stamps
    log_time: Stamps
    values: NDArray[np.float64]

    def select(self, which: slice | Mask) -> Samples:
        """Some of them."""
        return Samples(self.stamp[which], self.log_time[which], self.values[which])


class Timed(NamedTuple):
    """Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""

    stamp: Stamps
    values: NDArray[np.float64]


class Clock(NamedTuple):
    """The clock that is valid for both topics.

    Attributes:
        by_log_time: whether it is that of the recording times.
        offset: what is added to the stamps of the wrench, ns.
        warning: what was corrected; or empty.
        is_sure: whether more samples will not change it.
    """

    by_log_time: bool
    offset: int
    warning: str = ''
    is_sure: bool = True


class _Topic:
    """What was observed of one topic."""

    def __init__(self, name: str, rule: ClockRule) -> None:
        self.name, self._rule = name, rule
        self.first = self.last = (0, 0)
        self.count = 0
        self._varies = False
        self.best: dict[int, int] = {}
        self.problem = ''
        self._highest = -(1 << 62)

    @property
    def is_set(self) -> bool:
        """Whether the driver stamps its messages."""
        return self._varies or (self.count < 3 and self.first[0] != 0)

    def observe(self, stamp: Stamps, log_time: Stamps) -> None:
        """Takes in samples in the order of arrival, without stray ones."""
        if not len(stamp):
            return
        if not self.count:
            self.first = self.last = (int(stamp[0]), int(log_time[0]))
        self._varies |= bool((stamp != self.first[0]).any())
        time = np.maximum.accumulate(np.append(self.last[1], log_time))
        lag = stamp - log_time
        self._check_steps(np.diff(np.append(self.last[0], stamp)), np.diff(time), lag)
        intervals = time[1:] // self._rule.interval
        first = np.append(0, np.flatnonzero(np.diff(intervals)) + 1)
        for number, most in zip(intervals[first].tolist(), np.maximum.reduceat(lag, first).tolist(), strict=True):
            self.best[number] = max(most, self.best.get(number, most))
        self._highest = max(self._highest, int(lag.max()))
        self.last = int(stamp[-1]), int(time[-1])
        self.count += len(stamp)

    def _check_steps(self, steps: Stamps, between: Stamps, lag: Stamps) -> None:
        """Notes a step of the clock: back, or ahead without a pause and beyond all lags before."""
        name, tolerance = f'`header.stamp` of {self.name}', self._rule.tolerance
        back = int(steps.min())
        if back < -tolerance and not self.problem:
            self.problem = f'{name} steps back by {-back / 1e9:.3g} s'
        before = np.maximum.accumulate(np.append(self._highest, lag[:-1]))
        count = max(self.count + len(lag) - 1, 1)
        usual_step = (self.last[0] - self.first[0] + int(steps.sum())) / count
        usual_time = (self.last[1] - self.first[1] + int(between.sum())) / count
        ahead = (steps - between > tolerance) & (steps > 5.0 * usual_step) & (between < 5.0 * usual_time)
        ahead &= lag - before > tolerance
        ahead[0] &= self.count > 0
        if ahead.any() and not self.problem:
            self.problem = f'{name} steps ahead by {int(steps[ahead].max()) / 1e9:.3g} s'


class ClockComparison:
    """Compares the clocks of both topics by what was observed so far.

    Args:
        source: the recording, for messages.
        topics: names of joint states and wrenches.
        time_offset: of the cell description, s.
        rule: what counts as one clock.
    """

    def __init__(
        self, source: str, topics: Sequence[str], time_offset: float | None = None, rule: ClockRule | None = None
    ) -> None:
        self._source, self._stated, self.rule = source, time_offset, rule or ClockRule()
        self._topics = [_Topic(name, self.rule) for name in topics]
        self._waited = ''

    def observe(self, joints: Samples, wrench: Samples) -> None:
        """Takes in samples that came since the last call, in the order of arrival, without stray ones."""
        for topic, samples in zip(self._topics, (joints, wrench), strict=True):
            topic.observe(samples.stamp, samples.log_time)

    def check_reception(self, joints: Samples, wrench: Samples) -> None:
        """Notes where messages without stamps waited before they were received: recording times are then not valid."""
        if all(topic.is_set for topic in self._topics):
            return
        for topic, samples in zip(self._topics, (joints, wrench), strict=True):
            if not self._waited and (wait := longest_wait(samples.log_time, self.rule.tolerance)):
                self._waited = f'messages of {topic.name} were received {1e-9 * wait:.2g} s late, in a burst'

    def clock(self, now: int = 0) -> Clock:
        """The clock that is valid.

        Args:
            now: on the clock of the reception, ns; 0: when the last was received.

        Raises:
            RecordingError: it is not sure that any is.
        """
        stated = round(1e9 * (self._stated or 0.0))
        unset = next((topic.name for topic in self._topics if not topic.is_set), '')
        if unset:
            return self._by_log_time(f'`header.stamp` of {unset} is zero or constant', stated)
        steps = next((topic.problem for topic in self._topics if topic.problem), '')
        if steps and (self._stated is None or 'back' in steps):
            raise self._refusal(steps, 'record in one run, with stamps from one clock')
        return Clock(False, stated) if self._stated is not None else self._compared(now)

    def _by_log_time(self, problem: str, offset: int) -> Clock:
        for topic in self._topics:
            if topic.count > 2 and topic.first[1] == topic.last[1]:
                raise self._refusal(f'{problem}, and all were recorded at once', 'let the drivers stamp their messages')
        if self._waited:
            raise self._refusal(f'{problem}, and {self._waited}', 'let the drivers stamp their messages')
        return Clock(True, offset, f'{problem}: the recording times were used instead')

    def _compared(self, now: int) -> Clock:
        rule, (one, other) = self.rule, self._topics
        common = sorted(one.best.keys() & other.best.keys())
        if not common:
            return Clock(False, 0)
        lags = np.array([(one.best[number], other.best[number]) for number in common])
        apart = lags[:, 1] - lags[:, 0]
        best, usual = int(np.subtract(*lags.max(axis=0)[::-1])), int(np.median(apart))
        what = f'`header.stamp` of {one.name} and {other.name} comes from clocks that'
        if drift := self._drift(np.array(common, dtype=float), apart.astype(float)):
            raise self._refusal(f'{what} drift apart, by {1e-9 * drift:.3g} s')
        if min(abs(best), abs(usual)) < rule.tolerance:
            return Clock(False, 0)
        what += f' differ by {1e-9 * abs(best):.3g} s'
        for topic in self._topics:
            stamped, recorded = (last - first for first, last in zip(topic.first, topic.last, strict=True))
            if not recorded < rule.fastest * stamped < rule.fastest**2 * recorded:
                raise self._refusal(f'{what}, or messages came late, and time is simulated or a bag was played')
        if abs(best - usual) >= rule.tolerance:
            raise self._refusal(f'{what}, or messages of one topic came late')
        wait = rule.soon if abs(best - usual) < rule.on_time else rule.sure
        observed = max(now, one.last[1]) - max(one.first[1], other.first[1])
        return Clock(False, -best, f'{what}: the stamps of {other.name} were shifted', observed > wait)

    def _drift(self, number: NDArray[np.float64], apart: NDArray[np.float64]) -> float:
        """How far clocks drift apart, ns, whose differences lie on a line; 0 if they do not."""
        third = len(apart) // 3
        if len(apart) < self.rule.fewest:
            return 0.0
        (begin, low), (end, high) = (
            (np.median(number[part]), np.median(apart[part])) for part in (slice(third), slice(-third, None))
        )
        slope = (high - low) / (end - begin)
        change = float(abs(slope) * (number[-1] - number[0]))
        off = float(np.median(np.abs(apart - low - slope * (number - begin))))
        return change if change > self.rule.tolerance and off < self.rule.straight * change else 0.0

    def _refusal(
        self, problem: str, remedy: str = 'record again with one clock, or state the difference'
    ) -> RecordingError:
        return RecordingError(self._source, problem, f'{remedy} (`sensor.time_offset` states a constant difference)')


def on_one_clock(
    source: str, topics: Sequence[str], samples: Sequence[Samples], warnings: list[str], time_offset: float | None
) -> tuple[list[Timed], Clock]:
    """Joint angles and forces of a whole recording sorted by time on one clock, and which that is.

    Args:
        source: the recording, for messages.
        topics: names of joint states and wrenches.
        samples: of both, at least one each.
        warnings: what was corrected is appended here.
        time_offset: of the cell description, s; None to compare the clocks.

    Raises:
        RecordingError: it is not sure that the samples can be put on one clock.
    """
    comparison = ClockComparison(source, topics, time_offset)
    kept = [without_strays(topic, one, warnings) for topic, one in zip(topics, samples, strict=True)]
    comparison.observe(*kept)
    comparison.check_reception(*kept)
    clock = comparison.clock()
    warnings += [clock.warning] if clock.warning else []
    return by_clock(topics, kept, clock, warnings), clock


def by_clock(topics: Sequence[str], samples: Sequence[Samples], clock: Clock, warnings: list[str]) -> list[Timed]:
    """Both topics sorted by time on a clock, the first of equal stamps only."""
    found = []
    for topic, (stamp, log_time, values), offset in zip(topics, samples, (0, clock.offset), strict=True):
        found.append(_in_order(topic, (log_time if clock.by_log_time else stamp) + offset, values, warnings))
    return found


def _in_order(topic: str, stamp: Stamps, values: NDArray[np.float64], warnings: list[str]) -> Timed:
    backwards = int(np.sum(np.diff(stamp) < 0))
    if backwards:
        warnings.append(f'{topic}: {counted(backwards)} out of order, sorted')
        order = np.argsort(stamp, kind='stable')
        stamp, values = stamp[order], values[order]
    repeated = np.concatenate([[False], np.diff(stamp) == 0])
    if np.any(repeated):
        warnings.append(f'{topic}: {counted(int(np.sum(repeated)))} dropped whose stamp is that of another')
        stamp, values = stamp[~repeated], values[~repeated]
    stamp.flags.writeable = False
    values.flags.writeable = False
    return Timed(stamp, values)


def without_strays(topic: str, samples: Samples, warnings: list[str]) -> Samples:
    """The samples without the few whose stamp is far off those around it, as those of zero."""
    stray = strays(samples.stamp, ClockRule())
    if not stray.any():
        return samples
    warnings.append(f'{topic}: {counted(int(stray.sum()))} dropped whose stamp is far off those around it')
    return samples.select(~stray)


def strays(stamp: Stamps, rule: ClockRule) -> Mask:
    """Which stamps are far off the median of the seven around them, (n,); none where they are too many."""
    steps = np.abs(np.diff(stamp))
    stray = np.zeros(len(stamp), dtype=bool)
    if np.all(steps <= rule.tolerance):
        return stray
    limit = max(rule.tolerance, 5.0 * float(np.median(steps)))
    near = np.convolve(np.append(0, steps > limit), np.ones(7), 'full')[3 : 3 + len(stamp)] > 0
    around = sliding_window_view(np.pad(stamp, 3, mode='symmetric'), 7)[near]
    stray[near] = np.abs(stamp[near] - np.median(around, axis=1)) > limit
    return stray if stray.sum() <= max(1, rule.stray_share * len(stray)) else np.zeros_like(stray)


def longest_wait(log_time: Stamps, tolerance: int) -> float:
    """By how much messages were received late, ns, by the recording times alone; 0 where none is seen to be.

    What waited comes after a pause, and then faster than it was sent: in three times the pause, more messages come than
    were sent meanwhile. The same counts from the first message on, after a pause of `tolerance`.
    """
    time = np.maximum.accumulate(log_time)
    # the rate is that of most seconds: in pauses nothing comes, and bursts are short
    width = max(1_000_000_000, 20 * int(time[-1] - time[0]) // len(time))
    counts = np.bincount((time - time[0]) // width)[:-1]
    some = np.sort(counts[counts > 0])
    usual = int(some[len(some) // 2]) if len(some) else 0
    near = counts[np.abs(counts - usual) <= 0.3 * usual]
    period = width / float(near.mean()) if usual else 0.0
    pause = np.append(tolerance, np.diff(time))
    at = np.flatnonzero(pause >= np.append(tolerance, np.full(len(time) - 1, max(tolerance, 5.0 * period))))
    came = np.searchsorted(time, time[at] + 3 * pause[at], side='right') - at - 1
    made_up = came * period - 3.0 * pause[at]
    most = float(made_up.max(initial=0.0))
    return most if most > tolerance else 0.0


def counted(number: int) -> str:
    """`1 message`, `2 messages` and so on."""
    return f'{number} message' if number == 1 else f'{number} messages'
