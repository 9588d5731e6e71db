"""Messages as they arrive: how late each was received after its stamp.

A message is received when it was stamped, plus the difference of the clocks, plus a delay that is never negative: the
one that was least late shows the difference. On a computer that is overloaded most messages wait, some for seconds,
and medians show the waiting.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.touches.signals import runs

LARGEST_OFFSET = 250_000_000
"""Clocks that differ by more than this, or messages as late, would assign forces to wrong joint angles, ns."""
_INTERVAL, _FEWEST_INTERVALS, _MOST_INTERVALS = 2_000_000_000, 8, 200
"""Lags are compared by intervals: shortest one, ns; fewest for clocks that drift apart, most."""
_LARGEST_SHARE_APART = 0.04
"""A larger offset in at most this part of the intervals is accepted."""
_SAME_RATE = 0.03
"""Stamps and recording times run at the same rate if they differ by less over an interval; clocks drift far less."""
_RATE = 0.01
"""Messages that are sent at one rate keep it within this."""
_LONGEST_JITTER = 100_000_000
"""Messages that were received with a smaller delay after a pause are on time, ns;"""
_ON_TIME = 20_000_000
"""those that wait to be received are on time again when the delay is smaller than this, ns."""
_STRETCH = 16
"""The interval between messages is the mean over so many."""


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
    """Stamp - recording time of the messages that were least late, of both topics in intervals of their common time.

    Attributes:
        lags: (k, 2), ns; intervals without messages of both topics are left out.
        on_time: whether no message in the interval came late after a pause, (k,).
        width: of an interval, ns.
    """

    lags: NDArray[np.int64]
    on_time: Mask
    width: float

    @property
    def best(self) -> tuple[int, int] | None:
        """Those of the interval in which the messages of both topics were least late, ns; None without intervals."""
        if not len(self.lags):
            return None
        one, other = self.lags[self._best].tolist()
        return int(one), int(other)

    @property
    def is_on_time(self) -> bool:
        """Whether the messages of that interval were on time."""
        return bool(len(self.lags)) and bool(self.on_time[self._best])

    @property
    def _best(self) -> int:
        return int(np.argmax(self.lags.sum(axis=1)))


def least_lags(one: Samples, other: Samples) -> LeastLags:
    """The least lags of two topics; no intervals where they have no time in common."""
    times = [np.maximum.accumulate(samples.log_time) for samples in (one, other)]
    begin, end = max(int(time[0]) for time in times), min(int(time[-1]) for time in times)
    number = max(1, min((end - begin) // _INTERVAL, _MOST_INTERVALS))
    edges = np.linspace(0, max(end - begin, 0), number + 1).astype(np.int64) + begin
    edges[-1] += 1
    columns = [_least(samples, time, edges) for samples, time in zip((one, other), times, strict=True)]
    rows = [(first, second) for first, second in zip(*columns, strict=True) if first and second]
    lags = np.array([(first[0], second[0]) for first, second in rows], dtype=np.int64).reshape(-1, 2)
    on_time = np.array([first[1] and second[1] for first, second in rows], dtype=bool)
    return LeastLags(lags, on_time, (end - begin) / number)


def _least(samples: Samples, time: NDArray[np.int64], edges: NDArray[np.int64]) -> list[tuple[int, bool] | None]:
    """The greatest stamp - recording time in each interval, and whether all were on time; None without a message.

    A message that is stamped later than one that came after it does not count: its stamp may be wrong.
    """
    later = np.minimum.accumulate(samples.stamp[:0:-1])[::-1]
    sound = np.append(samples.stamp[:-1] <= later, len(time) == 1)
    lag = (samples.stamp - samples.log_time)[sound]
    due = np.maximum(np.diff(samples.stamp), _period(time))
    delay = _after_a_pause(np.diff(time) - (1.0 + _RATE) * due)[sound]
    places = np.searchsorted(time[sound], edges).tolist()
    return [
        (int(lag[low:high].max()), bool(delay[low:high].max() < _LONGEST_JITTER)) if high > low else None
        for low, high in pairwise(places)
    ]


def drift(least: LeastLags, apart: int) -> int:
    """How far apart two clocks drift that differ by `apart`, or step, ns; 0 if they do not.

    Only intervals count in which messages were on time, with lags that agree with those of a neighbour. In others
    the recorder paused or caught up, or a bag was played fast: there the stamps are the better clock.
    """
    if len(least.lags) < _FEWEST_INTERVALS:
        return 0
    alike = np.all(np.abs(np.diff(least.lags, axis=0)) <= _SAME_RATE * least.width, axis=1)
    steady = least.on_time & (np.append(alike, False) | np.append(False, alike))
    away = np.abs(least.lags[:, 0] - least.lags[:, 1] - apart)[steady]
    if len(away) < _FEWEST_INTERVALS or np.mean(away > LARGEST_OFFSET) < _LARGEST_SHARE_APART:
        return 0
    return int(away.max())


def received_late(samples: Samples) -> Mask:
    """Which messages were received late, (n,), by the recording times alone: from a delay of `LARGEST_OFFSET` on.

    What waited comes after a pause, and then faster than it was sent. Both must show it: a pause alone may be a loss,
    a burst alone another rate; only before the first message nobody knows. The messages that follow count as well
    until they are on time again (`_ON_TIME`).
    """
    time = np.maximum.accumulate(samples.log_time)
    between, period = np.diff(time).astype(float), _period(time)
    at_first = 2.0 * float(_before_catching_up(0.5 * period - between)[0])
    paused = _after_a_pause(between - (1.0 + _RATE) * period, at_first)
    delay = np.minimum(paused, _before_catching_up((1.0 - _RATE) * period - between))
    late = delay > _ON_TIME
    for first, last in zip(*runs(late), strict=True):
        late[first : last + 1] = delay[first : last + 1].max() > LARGEST_OFFSET
    return late


def paused_share(samples: Samples) -> float:
    """The part of the time in pauses longer than `LARGEST_OFFSET`, by the recording times."""
    time = np.maximum.accumulate(samples.log_time)
    between = np.diff(time)
    return float(between[between > max(LARGEST_OFFSET, 5.0 * _period(time))].sum() / max(between.sum(), 1))


def _after_a_pause(excess: Floats, at_first: float = 0.0) -> Floats:
    """Delay of messages, ns, (n,), from how much longer the intervals between them were than due, (n - 1,)."""
    total = np.append(0.0, np.cumsum(excess))
    return np.asarray(total - np.minimum(np.minimum.accumulate(total), -at_first))


def _before_catching_up(saved: Floats) -> Floats:
    """The same from how much shorter the intervals after each message were than due."""
    total = np.append(0.0, np.cumsum(saved))
    return np.asarray(np.maximum.accumulate(total[::-1])[::-1] - total)


def _period(time: NDArray[np.int64]) -> float:
    """Interval at which messages are sent, ns: that of most of the time, pauses and bursts left out."""
    if len(time) > _STRETCH:
        span = time[_STRETCH:] - time[:-_STRETCH]
        span = np.sort(span[2 * sliding_window_view(np.diff(time), _STRETCH).max(axis=1) < span])
        if len(span):
            covered = np.cumsum(span)
            usual = span[np.searchsorted(covered, covered[-1] // 2)]
            return float(span[(span > 0.5 * usual) & (span < 1.5 * usual)].mean()) / _STRETCH
    return float(time[-1] - time[0]) / max(len(time) - 1, 1)
