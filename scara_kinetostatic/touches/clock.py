"""One clock for both topics: that of the header stamps where they are set, else the times of recording.

Joint angles and forces are matched by time, so both must come from one clock. Lag is stamp - recording time: the
difference of two clocks, less a delay that is never negative. The best lags of both topics, of the messages that were
least late, so tell the difference of the clocks that stamp them; the recorder's own clock cancels out:

    D = max(lag of the wrench) - max(lag of the joint states).

A constant D is taken from the stamps of the wrench, with a warning. Messages that come late, by seconds even, change
nothing. What else may be wrong with clocks is refused. `sensor.time_offset` of the cell description states D instead;
then nothing is compared. The same rule serves recordings and what is kept of the streams of a running cell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.report.quantities import count

Stamps = NDArray[np.int64]
Timed = tuple[Stamps, Floats]
"""Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""
BestLags = tuple[dict[int, int], dict[int, int]]
"""Of both topics, the largest lag by the second of the recording time, ns."""
SECOND = 1_000_000_000
TOLERANCE = SECOND // 4
"""A smaller difference of the clocks or step of one stays, ns: holds last longer."""


class Samples(NamedTuple):
    """The samples of one topic in the order of their arrival.

    Attributes:
        stamp: header stamps, (n,), ns.
        log_time: when each was recorded, (n,), ns.
        values: q1, q2 or fx, fy, (n, 2), rad or N.
    """

    stamp: Stamps
    log_time: Stamps
    values: Floats

    def select(self, which: slice | Mask | Indices) -> Samples:
        """Some of them."""
        return Samples(self.stamp[which], self.log_time[which], self.values[which])

    @property
    def is_stamped(self) -> bool:
        """Whether the driver stamps its messages."""
        few = len(self.stamp) < 3 and self.stamp.all()
        return bool(few or (self.stamp != self.stamp[:1]).any())


class Clock(NamedTuple):
    """The clock that is valid for both topics.

    Attributes:
        by_log_time: whether it is that of the recording times.
        offset: what is added to the stamps of the wrench, ns.
        warning: what was corrected; or empty.
        is_sure: whether more samples will not change it: at first messages may be late.
    """

    by_log_time: bool
    offset: int
    warning: str = ''
    is_sure: bool = True


class ClockStepError(RecordingError):
    """The clock of a topic was set."""


def _refusal(source: str, problem: str, remedy: str, kind: type[RecordingError] = RecordingError) -> RecordingError:
    return kind(source, problem, f'{remedy} (`sensor.time_offset` states a constant difference)')


def _check_steps(source: str, topics: Sequence[str], samples: Sequence[Samples], time_offset: float | None) -> None:
    """Check that no clock steps back, nor ahead beyond all lags before without a pause; a stated difference allows it.

    Raises:
        ClockStepError: one does.
    """
    for topic, (stamp, log_time, _) in zip(topics, samples, strict=True):
        if len(stamp) < 2:
            continue
        steps, between, lag = np.diff(stamp), np.diff(log_time), stamp - log_time
        is_step = (steps > 5.0 * np.median(steps)) & (between < 5.0 * np.median(between)) & (time_offset is None)
        back = -int(steps.min())
        ahead = int((lag[1:] - np.maximum.accumulate(lag)[:-1])[is_step].max(initial=0))
        if max(back, ahead) > TOLERANCE:
            step = f'back by {back / SECOND:.3g} s' if back > TOLERANCE else f'ahead by {ahead / SECOND:.3g} s'
            problem = f'`header.stamp` of {topic} steps {step}'
            raise _refusal(source, problem, 'record in one run, with stamps from one clock', ClockStepError)


def _common_clock(
    source: str, topics: Sequence[str], samples: Sequence[Samples], time_offset: float | None, best: BestLags
) -> Clock:
    """The clock that is valid for samples without stray stamps; the rest as for `on_one_clock`."""
    stated = round(SECOND * (time_offset or 0.0))
    unset = next((topic for topic, one in zip(topics, samples, strict=True) if not one.is_stamped), None)
    if unset is not None:
        problem = f'`header.stamp` of {unset} is zero or constant'
        for topic, (_, log_time, _) in zip(topics, samples, strict=True):
            if len(log_time) > 2 and log_time[0] == log_time[-1]:
                raise _refusal(source, f'{problem}, and all were recorded at once', 'let the drivers stamp')
            if wait := longest_wait(log_time):
                problem += f', and messages of {topic} were received {wait / SECOND:.2g} s late, in a burst'
                raise _refusal(source, problem, 'let the drivers stamp their messages')
        return Clock(True, stated, f'{problem}: the recording times were used instead')
    _check_steps(source, topics, samples, time_offset)
    return Clock(False, stated) if time_offset is not None else _compared(source, topics, samples, best)


def _compared(source: str, topics: Sequence[str], samples: Sequence[Samples], best_lags: BestLags) -> Clock:
    """The clock of the stamps, by the best lags of both topics in each second that has both."""
    for known, (stamp, log_time, _) in zip(best_lags, samples, strict=True):  # the largest lag in each second
        second = np.maximum.accumulate(log_time) // SECOND
        first = np.append(0, np.flatnonzero(np.diff(second)) + 1)
        largest = np.maximum.reduceat(stamp - log_time, first)
        for number, lag in zip(second[first].tolist(), largest.tolist(), strict=True):
            known[number] = max(lag, known.get(number, lag))
    one, other = best_lags
    lags = np.array([(one[second], other[second]) for second in sorted(one.keys() & other.keys())])
    if not len(lags):
        return Clock(False, 0)
    apart, third = lags[:, 1] - lags[:, 0], len(lags) // 3
    best, usual = int(np.subtract(*lags.max(axis=0)[::-1])), int(np.median(apart))
    what = f'`header.stamp` of {topics[0]} and {topics[1]} comes from clocks that'
    remedy = 'record again with one clock, or state the difference'
    if third > 1:
        low, high = np.median(apart[:third]), np.median(apart[-third:])
        line = low + (high - low) / (len(apart) - third) * (np.arange(len(apart)) - (third - 1) / 2)
        drift = abs(float(line[-1] - line[0]))
        if drift > TOLERANCE and np.median(np.abs(apart - line)) < 0.1 * drift:
            raise _refusal(source, f'{what} drift apart, by {drift / SECOND:.3g} s', remedy)
    if min(abs(best), abs(usual)) < TOLERANCE:
        return Clock(False, 0)
    what += f' differ by {abs(best) / SECOND:.3g} s'
    for stamp, log_time, _ in samples:
        if not 0.5 < float(log_time[-1] - log_time[0]) / max(float(stamp[-1] - stamp[0]), 1.0) < 2.0:
            raise _refusal(source, f'{what}, or messages came late, and time is simulated or a bag was played', remedy)
    if abs(best - usual) >= TOLERANCE:
        raise _refusal(source, f'{what}, or messages of one topic came late', remedy)
    is_sure = len(lags) > 15 or (len(lags) > 3 and abs(best - usual) < SECOND // 50)
    return Clock(False, -best, f'{what}: the stamps of {topics[1]} were shifted', is_sure)


def on_one_clock(
    source: str,
    topics: Sequence[str],
    samples: Sequence[Samples],
    warnings: list[str],
    time_offset: float | None,
    best: BestLags | None = None,
) -> tuple[list[Timed], Clock]:
    """Joint angles and forces sorted by time on one clock, the first of equal stamps only, and which clock that is.

    Args:
        source: the recording, for messages.
        topics: names of both.
        samples: of both, at least one each.
        warnings: what was corrected is appended here.
        time_offset: of the cell description, s; None to compare the clocks.
        best: of both topics, the largest lags of samples before these by the second; those of these are added.

    Raises:
        RecordingError: it is not sure that the samples can be put on one clock.
    """
    kept = []
    for topic, one in zip(topics, samples, strict=True):
        stray = strays(one.stamp)
        _say(warnings, topic, int(stray.sum()), 'dropped whose stamp is zero or far off those around it')
        kept.append(one.select(~stray) if stray.any() else one)
    clock = _common_clock(source, topics, kept, time_offset, best or ({}, {}))
    warnings += [clock.warning] if clock.warning else []
    found = []
    for topic, (stamp, log_time, values), offset in zip(topics, kept, (0, clock.offset), strict=True):
        found.append(_in_order(topic, (log_time if clock.by_log_time else stamp) + offset, values, warnings))
    return found, clock


def _in_order(topic: str, stamp: Stamps, values: Floats, warnings: list[str]) -> Timed:
    _say(warnings, topic, int(np.sum(np.diff(stamp) < 0)), 'out of order, sorted')
    order = np.argsort(stamp, kind='stable')
    repeated = np.append(False, np.diff(stamp[order]) == 0)
    _say(warnings, topic, int(repeated.sum()), 'dropped whose stamp is that of another')
    stamp, values = stamp[order[~repeated]], values[order[~repeated]]
    stamp.flags.writeable = False
    values.flags.writeable = False
    return stamp, values


def _say(warnings: list[str], topic: str, number: int, what: str) -> None:
    warnings += [f'{topic}: {count(number, "message")} {what}'] if number else []


def strays(stamp: Stamps) -> Mask:
    """Which stamps are zero among others that are not, or far off those before and after, (n,)."""
    steps = np.diff(stamp)
    limit = max(TOLERANCE, 5.0 * float(np.median(np.abs(steps)))) if len(steps) else 0.0
    far = np.where(np.abs(steps) > limit, np.sign(steps), 0)
    stray = (stamp == 0) & bool(2 * np.count_nonzero(stamp) > len(stamp))
    stray[1:-1] |= far[1:] * far[:-1] < 0
    stray[[0, -1]] |= far[[0, -1]] != 0 if len(far) > 2 else False
    return stray


def longest_wait(log_time: Stamps) -> int:
    """By how much messages were received late, ns, by the recording times alone; 0 where none is seen to be.

    What waited comes after a pause, and then faster than it was sent: in three times the pause, more messages come than
    were sent meanwhile.
    """
    time = np.maximum.accumulate(log_time)
    pause = np.diff(time)
    # the rate is that of most seconds: in pauses nothing comes, and bursts are short
    width = max(SECOND, 20 * int(time[-1] - time[0]) // len(time))
    counts = np.bincount((time - time[0]) // width)[:-1]
    usual = float(np.median(counts[counts > 0])) if counts.any() else 0.0
    near = counts[np.abs(counts - usual) <= 0.3 * usual]
    period = width / float(near.mean()) if near.any() else 0.0
    at = np.flatnonzero(pause > max(TOLERANCE, 5.0 * period))
    came = np.searchsorted(time, time[at + 1] + 3 * pause[at], side='right') - at - 2
    most = int((came * period - 3.0 * pause[at]).max(initial=0.0))
    return most if most > TOLERANCE else 0
