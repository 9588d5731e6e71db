"""Messages as they arrive: how late each was received after its stamp.

Lag is stamp - recording time: the difference of the clocks, less a delay that is never negative. What delays both
topics alike cancels out in the difference of their lags. A topic that waits longer than the other shows it: after a
pause, or before its messages come faster than they were stamped. There the difference is not that of the clocks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.touches.signals import runs

LARGEST_OFFSET = 250_000_000
"""Clocks that differ by more than this, or messages as late, would assign forces to wrong joint angles, ns."""
_INTERVAL = 500_000_000
"""Lags are compared in intervals of at least this, ns,"""
_FEWEST_MESSAGES = 4.0
"""in which at least so many messages of each topic are sent."""
_FEWEST_INTERVALS = 8
"""In fewer intervals on time clocks are not compared for drift."""
_LARGEST_SHARE_APART = 0.04
"""A larger offset in less than this part of the intervals is accepted."""
_SAME_RATE = 0.02
"""Stamps and recording times run at one rate if they differ by less; else the bag was played, or time is simulated."""
_WHOLE = 0.3
"""The difference of the rates may vary by this part of it between most of the time and the whole."""
_SLOWEST = 0.05
"""Played faster than by the inverse of this, a bag says nothing of its clocks."""
_FASTEST_DRIFT = 0.005
"""Clocks run at the same rate within this."""
_LARGEST_WAIT = 100_000_000
"""A topic that waits longer than the other by less than this is on time, ns."""
_ON_TIME = 20_000_000
"""What is received late is on time again at a smaller delay, ns."""
_DISTINCTLY_FASTER = 0.05
"""What comes faster by less than this does not show that it waited: it may be sent so."""
_PAUSE_PERIODS = 5.0
"""A pause is longer than `LARGEST_OFFSET` and than so many periods."""
_STRETCH = 20
"""Periods are means over at least so many messages."""


class Samples(NamedTuple):
    """The samples of one topic in the order of their arrival.

    Attributes:
        stamp: header stamps, (n,), ns.
        log_time: when each was recorded, (n,), ns.
        values: q1, q2 or fx, fy, (n, 2), rad or N.
    """

    stamp: NDArray[np.int64]
    log_time: NDArray[np.int64]
    values: NDArray[np.float64]


class LeastLags(NamedTuple):
    """Lags of the messages of both topics that were least late, in intervals of their common time.

    Attributes:
        lags: (k, 2), ns; intervals without messages of both topics are left out.
        waits: by how much one topic waited longer than the other, (k,), ns.
        pace: of these times, per time by the stamps.
    """

    lags: NDArray[np.int64]
    waits: Floats
    pace: float = 1.0

    @property
    def on_time(self) -> Mask:
        """In which intervals neither topic waited longer than the other, (k,)."""
        return np.asarray(self.waits < _LARGEST_WAIT)

    @property
    def apart(self) -> NDArray[np.int64]:
        """Lag of the first topic less that of the second, (k,), ns: the difference of their clocks where on time."""
        return np.asarray(self.lags[:, 0] - self.lags[:, 1])

    def difference(self) -> int | None:
        """The difference of the clocks, ns: the median over the intervals on time; None where there are none."""
        if not self.on_time.any():
            return None
        best = self.on_time & (self.waits < max(_ON_TIME, float(self.waits.min())))
        return int(np.median(self.apart[best if best.any() else self.on_time]))

    def guess(self) -> int:
        """The same from the interval in which the waiting of the topics differed least, 0 without intervals."""
        return int(self.apart[np.argmin(self.waits)]) if len(self.waits) else 0

    def drift(self, difference: int) -> int:
        """How far clocks get apart, by steps or by drift, that differ by `difference`, ns; 0 if they do not."""
        away = np.abs(self.apart - difference)[self.on_time]
        if len(away) < _FEWEST_INTERVALS or np.mean(away > LARGEST_OFFSET) < _LARGEST_SHARE_APART:
            return 0
        return int(np.ptp(self.apart[self.on_time]))


def least_lags(one: Samples, other: Samples) -> LeastLags:
    """The least lags of two topics; no intervals where they have no time in common."""
    times = [np.maximum.accumulate(samples.log_time) for samples in (one, other)]
    begin, end = max(int(time[0]) for time in times), min(int(time[-1]) for time in times)
    width = max(_INTERVAL, round(_FEWEST_MESSAGES * max(period(time) for time in times)))
    number = max(1, (end - begin) // width)
    width = (end - begin) // number + 1
    speed = _speed(one, other)
    found = [_least(samples, time, begin, width, speed) for samples, time in zip((one, other), times, strict=True)]
    (first, first_rows), (second, second_rows) = found
    _, in_first, in_second = np.intersect1d(first, second, assume_unique=True, return_indices=True)
    both = [first_rows[in_first], second_rows[in_second]]
    waits = np.max([np.abs(both[0][:, column] - both[1][:, column]) for column in (1, 2)], axis=0)
    return LeastLags(np.column_stack([rows[:, 0] for rows in both]), waits.astype(float))


def lags_at_pace(one: Samples, other: Samples) -> LeastLags | None:
    """The least lags in real time where time is simulated or a bag was played; None where its speed is not steady.

    Stamps are slowed to the pace of the recording times, or, where those are faster, these to that of the stamps.
    """
    speed, origin = _speed(one, other), int(one.log_time[0])
    if not _SLOWEST < speed < 1.0 / _SLOWEST or 0.5 < speed < 2.0:
        return None

    def slowed(time: NDArray[np.int64], pace: float) -> NDArray[np.int64]:
        return origin + np.round(pace * (time - origin)).astype(np.int64) if pace < 1.0 else time

    slow_one, slow_other = (
        samples._replace(stamp=slowed(samples.stamp, speed), log_time=slowed(samples.log_time, 1.0 / speed))
        for samples in (one, other)
    )
    lags = least_lags(slow_one, slow_other)
    return lags._replace(pace=min(speed, 1.0)) if len(lags.lags) >= _FEWEST_INTERVALS else None


def _least(
    samples: Samples, time: NDArray[np.int64], begin: int, width: int, speed: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the intervals with messages, (k,), and of each the greatest lag and two delays of it, (k, 3), ns.

    A message that is stamped later than one that came after it does not count: its stamp may be wrong.
    """
    between, stamped = np.diff(time).astype(float), np.diff(samples.stamp).astype(float)
    usual = _stamp_period(samples.stamp)
    due = speed * np.where(stamped > 0, stamped, usual)
    shown = np.where(due > max(LARGEST_OFFSET, _PAUSE_PERIODS * usual), speed * usual, due)
    paused = _after_a_pause(between - (1.0 + _FASTEST_DRIFT) * due, between - due > _LARGEST_WAIT)
    bursts = _before_catching_up((1.0 - _DISTINCTLY_FASTER) * shown - between)
    waiting = _before(_ends(bursts, _LARGEST_WAIT), (1.0 - _FASTEST_DRIFT) * shown - between)
    later = np.minimum.accumulate(samples.stamp[:0:-1])[::-1]
    sound = np.append(samples.stamp[:-1] <= later, len(time) == 1) & (time >= begin)
    lag, interval = (samples.stamp - samples.log_time)[sound], (time[sound] - begin) // width
    if not len(lag):
        return interval, np.empty((0, 3), dtype=np.int64)
    first = np.append(0, np.flatnonzero(np.diff(interval)) + 1)
    greatest = np.repeat(np.maximum.reduceat(lag, first), np.diff(np.append(first, len(lag))))
    reached = np.flatnonzero(lag == greatest)
    best = reached[np.searchsorted(reached, first)]
    delays = [delay[sound][best].astype(np.int64) for delay in (paused, waiting)]
    return interval[first], np.column_stack([lag[best], *delays])


def received_late(samples: Samples) -> Mask:
    """Which messages were received late, (n,), by the recording times alone: from a delay of `LARGEST_OFFSET` on.

    What waited comes after a pause, and then faster than it was sent. Both must show it: a pause alone may be a loss,
    a burst alone another rate; only before the first message nobody knows. The messages that follow count as well
    until they are on time again (`_ON_TIME`).
    """
    time = np.maximum.accumulate(samples.log_time)
    between, usual = np.diff(time).astype(float), period(time)
    at_first = 2.0 * float(_before_catching_up(0.5 * usual - between)[0])
    pause = between > max(LARGEST_OFFSET, _PAUSE_PERIODS * usual)
    paused = _after_a_pause(between - usual, pause, at_first if at_first > LARGEST_OFFSET else 0.0)
    delay = np.minimum(paused, _before_catching_up((1.0 - _DISTINCTLY_FASTER) * usual - between))
    return _lasting(delay, LARGEST_OFFSET)


def paused_share(samples: Samples) -> float:
    """The part of the time in pauses, by the recording times."""
    time = np.maximum.accumulate(samples.log_time)
    _, pause = _pauses(time)
    return float(np.diff(time)[pause].sum()) / max(int(time[-1] - time[0]), 1)


def period(time: NDArray[np.int64]) -> float:
    """Interval at which messages are sent, ns, from when they were received, in order: that of most of the time.

    Pauses, and the few moments at which what waited came faster, have no influence.
    """
    usual, pause = _pauses(time)
    since, width = (time - time[0]).astype(float), max(2.0 * LARGEST_OFFSET, _STRETCH * usual)
    number = int(since[-1] / width)
    counts = np.diff(np.searchsorted(since, width * np.arange(number + 1)))
    touched = np.zeros(number + 3, dtype=np.intp)
    np.add.at(touched, (since[:-1][pause] / width).astype(np.intp), 1)
    np.add.at(touched, (since[1:][pause] / width).astype(np.intp) + 1, -1)
    counts = counts[np.cumsum(touched)[:number] == 0]
    near = counts[np.abs(counts - np.median(counts)) <= 0.3 * np.median(counts)] if len(counts) else counts
    return float(width / near.mean()) if near.any() else usual


def _speed(one: Samples, other: Samples) -> float:
    """The common rate of two topics, 1 where it is not that of most of the time and of the whole alike."""
    usual = float(np.mean([rate(samples) for samples in (one, other)]))
    spans = [(np.ptp(samples.log_time), max(samples.stamp[-1] - samples.stamp[0], 1)) for samples in (one, other)]
    whole = float(np.mean([recorded / stamped for recorded, stamped in spans]))
    apart = abs(usual - 1.0)
    return usual if apart > _SAME_RATE and abs(usual - whole) < _WHOLE * apart else 1.0


def rate(samples: Samples) -> float:
    """Recording time per time by the stamps, 1 where the stamps are all the same: in a bag played fast it is less."""
    usual = _stamp_period(samples.stamp)
    return period(np.maximum.accumulate(samples.log_time)) / usual if usual > 0 else 1.0


def _stamp_period(stamp: NDArray[np.int64]) -> float:
    """Interval at which messages are stamped, ns: the median over stretches of `_STRETCH` messages."""
    many = min(_STRETCH, max(len(stamp) - 1, 1))
    return float(np.median(stamp[many:] - stamp[:-many])) / many if len(stamp) > 1 else 0.0


def _pauses(time: NDArray[np.int64]) -> tuple[float, Mask]:
    """The mean interval between messages, ns, and which intervals are pauses, (n - 1,)."""
    between = np.diff(time)
    mean = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    return mean, between > max(LARGEST_OFFSET, _PAUSE_PERIODS * mean)


def _after_a_pause(excess: Floats, pause: Mask, at_first: float = 0.0) -> Floats:
    """Delay of messages since the pauses before them, ns, (n,).

    Args:
        excess: how much longer the intervals between the messages were than due, (n - 1,), ns.
        pause: which of them are pauses, (n - 1,).
        at_first: delay of the first message, ns.
    """
    total = np.append(0.0, np.cumsum(excess))
    before = np.append(-at_first if at_first else np.inf, np.where(pause, total[:-1], np.inf))
    return np.asarray(np.maximum(total - np.minimum.accumulate(before), 0.0))


def _lasting(delay: Floats, largest: float) -> Mask:
    """Which messages come later than `_ON_TIME` in a row of such in which one comes later than `largest`, (n,)."""
    late = delay > _ON_TIME
    first, last = runs(late)
    greatest = np.maximum.reduceat(np.append(delay, 0.0), np.column_stack([first, last + 1]).ravel())[::2]
    late[late] = np.repeat(greatest > largest, last - first + 1)
    return late


def _ends(delay: Floats, largest: float) -> Mask:
    """The first messages after rows of late ones (`_lasting`), (n,)."""
    late = _lasting(delay, largest)
    return np.append(False, late[:-1] & ~late[1:])


def _before(ends: Mask, saved: Floats) -> Floats:
    """Delay of the messages before others that are on time at last, ns, (n,), from what the intervals saved."""
    total = np.append(0.0, np.cumsum(saved))
    later = np.maximum.accumulate(np.where(ends, total, -np.inf)[::-1])[::-1]
    return np.asarray(np.maximum(later - total, 0.0))


def _before_catching_up(saved: Floats) -> Floats:
    """Delay of messages that catch up later, ns, (n,), from how much shorter the intervals after them were than due."""
    total = np.append(0.0, np.cumsum(saved))
    return np.asarray(np.maximum.accumulate(total[::-1])[::-1] - total)
