"""One clock for both topics: that of the header stamps where they are set, else the times of recording.

Joint angles and forces are matched by time, so both must come from one clock. Lag is stamp - recording time: the
difference of two clocks, less a delay that is never negative. The best lags of both topics, of the messages that were
least late, so tell the difference of the clocks that stamp them; the recorder's own clock cancels out:

    D = max(lag of the wrench) - max(lag of the joint states).

A constant D is taken from the stamps of the wrench, with a warning. Messages that come late, by seconds even, change
nothing. What else may be wrong with clocks is refused. `sensor.time_offset` of the cell description states D instead;
then nothing is compared. The same rule serves recordings and what is kept of the streams of a running cell.

Joint states may come in parts, messages with some of the joints each, from several publishers; `JointParts` brings them
to common times. In the order of the stamps, a message with news of one angle after news of the other gives a sample at
its time: one angle was measured there, the other is interpolated between its neighbours. So there are as many samples
as of the slower joint, none bridges the silence of one, and each waits until both angles are known up to its time:
messages may come in bursts. A message with both angles is a sample as it came. Other joints, as of a lift, count as
they were last heard, for one second.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.quantities import count

Stamps = NDArray[np.int64]
Timed = tuple[Stamps, Floats]
"""Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""
BestLags = tuple[dict[int, int], dict[int, int]]
"""Of both topics, the largest lag by the second of the recording time, ns."""
SECOND = 1_000_000_000
TOLERANCE = SECOND // 4
"""A smaller difference of the clocks or step of one stays, ns: holds last longer."""
_PAUSE = 5.0
"""More than so many usual steps from stamp to stamp are no usual one."""


class Samples(NamedTuple):
    """The samples of one topic in the order of their arrival.

    Attributes:
        stamp: header stamps, (n,), ns.
        log_time: when each was recorded, (n,), ns.
        values: q1, q2 and held joints, or fx, fy, (n, 2 + h), rad or N.
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
        is_step = (steps > _PAUSE * np.median(steps)) & (between < _PAUSE * np.median(between)) & (time_offset is None)
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
    found = list[Timed]()
    for topic, (stamp, log_time, values), offset in zip(topics, kept, (0, clock.offset), strict=True):
        time = (log_time if clock.by_log_time else stamp) + offset
        _say(warnings, topic, int(np.sum(np.diff(time) < 0)), 'out of order, sorted')
        order = np.argsort(time, kind='stable')
        repeated = np.append(False, np.diff(time[order]) == 0)
        _say(warnings, topic, int(repeated.sum()), 'dropped whose stamp is that of another')
        first = order[~repeated]
        found.append((read_only(time[first]), read_only(values[first])))
    return found, clock


def _say(warnings: list[str], topic: str, number: int, what: str) -> None:
    warnings += [f'{topic}: {count(number, "message")} {what}'] if number else []


def strays(stamp: Stamps) -> Mask:
    """Which stamps are zero among others that are not, or far off those before and after, (n,)."""
    steps = np.diff(stamp)
    limit = max(TOLERANCE, _PAUSE * float(np.median(np.abs(steps)))) if len(steps) else 0.0
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
    at = np.flatnonzero(pause > max(TOLERANCE, _PAUSE * period))
    came = np.searchsorted(time, time[at + 1] + 3 * pause[at], side='right') - at - 2
    most = int((came * period - 3.0 * pause[at]).max(initial=0.0))
    return most if most > TOLERANCE else 0


_BOTH = 2
"""In place of the number of a joint, 0 or 1: the message has both."""
NEVER = int(np.iinfo(np.int64).min) // 2


class JointParts:
    """Brings the joint states of one topic, of which a message has some of the joints, to common times.

    Messages may be added one by one or many at once: the samples are the same.

    Args:
        names: of q1, q2 and the other joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._rows = Samples(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, len(names))))
        self._done = np.zeros(0, bool)  # which of these messages are behind the common time
        self._last = _BOTH, False  # joint of the latest of them, and whether it gave a sample
        self._heard, self._when = np.full(len(names) + 2, nan), np.zeros(0, np.int64)

    @property
    def awaited(self) -> str:
        """Names of q1 and q2; of one alone where the other has been heard of."""
        unheard = [name for name, at in zip(self._names, self._heard[:2].tolist(), strict=False) if isnan(at)]
        return ' and '.join(unheard or self._names[:2])

    def add(self, new: Samples) -> tuple[Samples, dict[str, int]]:
        """One or more messages.

        Args:
            new: in the order in which they came, (n, 2 + h), NaN where a message does not have that joint.

        Returns:
            The samples that they complete, each with the times of one message, and how many messages are of no use, by
            reason. Where a joint is not stamped, no sample is.
        """
        rows = Samples(*(np.concatenate(both) for both in zip(self._rows, new, strict=True)))
        angle, kept = ~np.isnan(rows.values[:, :2]), len(self._done)
        stamped = all(2 * np.count_nonzero(rows.stamp[column]) >= column.sum() for column in angle.T)
        time = rows.stamp if stamped else rows.log_time
        rows.values[kept:, 2:], good, problems = self._checked(new, (time - rows.log_time)[kept:])
        used = np.append(np.ones(kept, bool), good)
        done = np.append(self._done, np.zeros(len(good), bool))[used]
        rows, angle, time = rows.select(used), angle[used], time[used]
        place = np.maximum.accumulate(np.where(angle, np.arange(len(time))[:, None], -1), axis=0)
        common = np.where(place < 0, NEVER, time[place])[kept:].min(axis=1).max(initial=NEVER)
        which, order = np.where(angle.all(axis=1), _BOTH, angle[:, 1]), np.argsort(time, kind='stable')
        due = order[(((time <= common) | (which == _BOTH)) & ~done)[order]]
        samples = self._samples(rows, time, order, due[self._give_samples(which[due])])
        done[due] = True
        since = min([int(time[done & column][-1]) if (done & column).any() else NEVER for column in angle.T])
        later: Mask = time >= since
        self._rows, self._done = rows.select(later), done[later]
        return samples if stamped else samples._replace(stamp=np.zeros_like(samples.stamp)), problems

    def _checked(self, new: Samples, lag: NDArray[np.int64]) -> tuple[Floats, Mask, dict[str, int]]:
        """Positions of the other joints as last heard; which messages can be used; how many cannot, by reason."""
        angle = ~np.isnan(new.values[:, :2])
        columns = np.column_stack([new.values, np.where(angle, lag[:, None], nan)])
        place = np.where(np.isnan(columns), -1, np.arange(len(columns))[:, None])
        place = np.maximum.accumulate(place, axis=0)
        heard = np.where(place < 0, self._heard, np.take_along_axis(columns, place, axis=0))
        when = np.where(place < 0, self._when if len(self._when) else new.log_time[0], new.log_time[place])
        self._heard, self._when = heard[-1], when[-1]
        pause, apart = new.log_time[:, None] - when, np.abs(heard[:, -1] - heard[:, -2])
        silent = (pause[:, :2] > SECOND) & angle[:, ::-1] & ~angle  # while the other one speaks
        slow = pause[:, :2].sum(axis=1)  # of a clock that runs slower, as a simulated one, the lag changes by as much
        differ = (angle.sum(axis=1) == 1) & ~silent.any(axis=1) & (apart > TOLERANCE + slow)
        problems = {f'{name} is silent': int(n) for name, n in zip(self._names, silent.sum(axis=0), strict=False) if n}
        if differ.any():
            how = f'{" and ".join(self._names[:2])} differ by {np.median(apart[differ]) / SECOND:.1g} s'
            problems[f'the clocks of {how}, or one comes late'] = int(differ.sum())
        others = np.where(pause > SECOND, nan, heard)[:, 2:-2]
        return others, angle.any(axis=1) & ~silent.any(axis=1) & ~differ, problems

    def _give_samples(self, joint: NDArray[np.int64]) -> Mask:
        """Which of these messages, in the order of time, have news of one joint after news of the other."""
        changes = np.append(self._last[1], np.append(self._last[0], joint[:-1]) + joint == 1)
        at = np.arange(len(changes))
        second = changes & ((at - np.maximum.accumulate(np.where(changes, -1, at))) % 2 == 1)  # every other one in turn
        self._last = (int(joint[-1]), bool(second[-1])) if len(joint) else self._last
        return np.asarray(second[1:] | (joint == _BOTH))

    @staticmethod
    def _samples(rows: Samples, time: NDArray[np.int64], order: Indices, due: Indices) -> Samples:
        """At the times of some messages; an angle that one does not have is interpolated, but not over a second."""
        found, when = rows.select(due), time[due]
        for k in (0, 1) if len(due) else ():
            mine = order[~np.isnan(rows.values[order, k])]
            known, after = time[mine], np.searchsorted(time[mine], when).clip(max=len(mine) - 1)
            between = np.interp(when - known[0], known - known[0], rows.values[mine, k], left=nan, right=nan)
            between[known[after] - known[np.maximum(after - 1, 0)] > SECOND] = nan
            found.values[:, k] = np.where(np.isnan(found.values[:, k]), between, found.values[:, k])
        found = found.select(np.flatnonzero(np.isfinite(found.values[:, 0] + found.values[:, 1])))
        return found.select(np.argsort(found.log_time, kind='stable'))
