"""One clock for both topics: the header stamps where they are valid, else the recording times.

Joint angles and forces are matched by their stamps, so both must come from one clock. Header stamps are not valid where
they are zero or constant, where they step back by more than `_LARGEST_STEP_BACK` (a simulation restarted, a bag played
in a loop), or where the clocks of the topics differ. The recording times (log times) then replace them in both topics,
if these are valid. Where both step back, as when the computer's clock was set back, the parts between the steps are
placed one after another. The same judgement serves recordings and the streams of a running cell.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError

_LARGEST_STEP_BACK = 1_000_000_000
"""Stamps that step back by more than this are from a clock that was set; by less, from messages out of order, ns."""
_OUTLIER = 60_000_000_000
"""A stamp that differs by more than this from the median of its neighbours is an outlier, ns."""
_LARGEST_OUTLIER_SHARE = 20
"""Outliers are dropped if they are at most one in so many stamps."""
_PAUSE = 1_000_000_000
"""Time inserted between the parts of a recording whose clock was set back, ns: longer than a gap within a touch."""
_LARGEST_OFFSET = 250_000_000
"""Clocks that differ by more than this would assign forces to wrong joint angles, ns."""
_MOSTLY = 0.6
"""An offset that is the same in this part of the recording is one of the clocks; else messages wait or clocks drift."""
_MOST_COMPARED = 5000
"""At so many moments the lags of the topics are compared."""
_INTERVAL, _FEWEST_INTERVALS, _MOST_INTERVALS = 2_000_000_000, 8, 200
"""Offsets that vary are compared by intervals: shortest one, ns, fewest, most."""
_LARGEST_SHARE_APART = 0.04
"""A larger offset in at most this part of the intervals is accepted."""
_SAME_RATE = 0.03
"""Stamps and recording times run at the same rate if they differ by less over an interval; clocks drift far less."""


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


class Timed(NamedTuple):
    """Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""

    stamp: NDArray[np.int64]
    values: NDArray[np.float64]


class Judgement(NamedTuple):
    """Which clock is valid for both topics.

    Attributes:
        topics: the samples of each topic in the order given, on that clock.
        by_log_time: whether it is that of the recording times.
        joined: where parts between steps back were placed one after another: the samples so shifted, in the order of
            arrival, by topic; else empty.
        at_one_rate: whether stamps and recording times run at the same rate.
    """

    topics: list[Timed]
    by_log_time: bool
    joined: dict[str, Samples]
    at_one_rate: bool


def judge_clocks(source: str, streams: dict[str, Samples], warnings: list[str]) -> Judgement:
    """Both topics sorted by time on one clock, and which that is.

    Args:
        source: the recording, for messages.
        streams: by topic, at least one sample each.
        warnings: what was corrected is appended here.

    Raises:
        RecordingError: neither the header stamps nor the recording times are valid.
    """
    streams = {topic: _without_outliers(topic, samples, warnings) for topic, samples in streams.items()}
    problem = _problem(streams, 'stamp') or _clock_offset(streams)
    use, in_turn, one_rate = 'stamp', False, True
    if problem:
        joined = _parts_in_turn(streams, 'stamp')
        valid = not _problem(streams, 'log_time')
        one_rate = _at_one_rate(streams)
        if valid and (joined is None or one_rate):
            use = 'log_time'
            warnings.append(f'{problem}: the recording times were used instead')
        elif (joined := joined or _parts_in_turn(streams, 'log_time')) is not None:
            streams, in_turn = joined, True
            why = 'the recording times run at another rate' if valid else 'so do the recording times'
            warnings.append(f'{problem}, {why}: the parts were placed one after another')
        else:
            remedy = 'record in one run, with stamps from one clock'
            raise RecordingError(source, f'{problem}, and the recording times are not valid either', remedy)
    topics = [_in_order(topic, getattr(samples, use), samples.values, warnings) for topic, samples in streams.items()]
    return Judgement(topics, use == 'log_time', streams if in_turn else {}, one_rate)


def _without_outliers(topic: str, samples: Samples, warnings: list[str]) -> Samples:
    """The samples without the few whose stamp is zero or more than `_OUTLIER` from those around it."""
    if np.all(np.abs(np.diff(samples.stamp)) < _OUTLIER):
        return samples
    around = sliding_window_view(np.pad(samples.stamp, 3, mode='symmetric'), 7)
    outlier = np.abs(samples.stamp - np.median(around, axis=1)) > _OUTLIER
    number = int(np.sum(outlier))
    if number == 0 or number > max(1, len(outlier) // _LARGEST_OUTLIER_SHARE):
        return samples
    warnings.append(f'{topic}: {counted(number)} dropped whose stamp is more than 60 s off')
    return samples._replace(
        stamp=samples.stamp[~outlier], log_time=samples.log_time[~outlier], values=samples.values[~outlier]
    )


def _problem(streams: dict[str, Samples], use: str) -> str:
    """Why stamps (`use` is stamp) or recording times (log_time) are not valid; empty if they are."""
    for topic, samples in streams.items():
        times: NDArray[np.int64] = getattr(samples, use)
        if np.all(times == 0):
            return f'`header.stamp` of {topic} is zero'
        if len(times) > 2 and np.all(times == times[0]):
            return f'`header.stamp` of {topic} is constant'
        step = int(np.min(np.diff(times), initial=0))
        if step < -_LARGEST_STEP_BACK:
            return f'`header.stamp` of {topic} steps back by {-step / 1e9:.3g} s'
    return ''


def _clock_offset(streams: dict[str, Samples]) -> str:
    """Why the stamps of the topics are not from one clock, by their lags behind the recording times; or empty.

    The lags of both topics at the same moment are compared: what delays both, a busy recorder or a bag played at
    another rate, cancels out.
    """
    if _problem(streams, 'log_time'):
        return ''
    between = _lags_apart(*streams.values())
    low, middle, high = np.percentile(between, [5, 50, 95]).tolist()
    steady = np.mean(np.abs(between - middle) < 0.5 * _LARGEST_OFFSET) > _MOSTLY
    if abs(middle) < _LARGEST_OFFSET or not steady:
        return _clock_drift(streams) if high - low > _LARGEST_OFFSET else ''
    if not _at_one_rate(streams):
        return ''
    lags = [int(samples.stamp[0] - samples.log_time[0]) + _median_change(samples) for samples in streams.values()]
    apart = abs(lags[0] - lags[1]) / 1e9
    return f'`header.stamp` of {" and ".join(streams)} comes from clocks that differ by {apart:.3g} s'


def _median_change(samples: Samples) -> int:
    """Median change of the lag since the first sample, ns."""
    lag = samples.stamp - samples.log_time
    return int(np.median(lag - lag[0]))


def _lags_apart(one: Samples, other: Samples) -> NDArray[np.float64]:
    """Lag of one topic behind its recording times less that of the other, at moments of the one, (k,), ns."""
    (time, lag), (others, other_lag) = (
        (np.maximum.accumulate(samples.log_time), samples.stamp - samples.log_time) for samples in (one, other)
    )
    every = max(1, len(time) // _MOST_COMPARED)
    start, base = int(others[0]), int(other_lag[0])
    near = np.interp((time[::every] - start).astype(float), (others - start).astype(float), other_lag - base)
    return np.asarray((lag[::every] - base) - near)


def _clock_drift(streams: dict[str, Samples]) -> str:
    """Why the stamps of the topics drift apart, by their lags in intervals; empty if they do not.

    Only intervals count in which stamps and recording times run at the same rate. In others the recorder paused or
    caught up, or a bag was played fast: there the stamps are the better clock.
    """
    samples = list(streams.values())
    begin = max(int(one.log_time.min()) for one in samples)
    end = min(int(one.log_time.max()) for one in samples)
    number = min((end - begin) // _INTERVAL, _MOST_INTERVALS)
    if number < _FEWEST_INTERVALS:
        return ''
    edges = np.linspace(begin, end, number + 1)
    apart = []
    for low, high in pairwise(edges):
        lags = [_lag(one, low, high) for one in samples]
        if not any(np.isnan(lags)):
            apart.append(abs(lags[0] - lags[1]))
    if len(apart) < _FEWEST_INTERVALS or np.mean(np.array(apart) > _LARGEST_OFFSET) < _LARGEST_SHARE_APART:
        return ''
    topics = ' and '.join(streams)
    return f'`header.stamp` of {topics} comes from clocks that drift apart, by up to {max(apart) / 1e9:.3g} s'


def _lag(samples: Samples, begin: float, end: float) -> float:
    """Median of stamp - recording time in an interval, ns; NaN where the two run at different rates."""
    first, last = np.searchsorted(samples.log_time, [begin, end])
    stamp, recorded = samples.stamp[first:last].astype(float), samples.log_time[first:last].astype(float)
    if len(stamp) < 3 or abs((recorded[-1] - recorded[0]) - (stamp[-1] - stamp[0])) > _SAME_RATE * (end - begin):
        return np.nan
    return float(np.median(stamp - recorded))


def _at_one_rate(streams: dict[str, Samples]) -> bool:
    """Whether stamps and recording times run at the same rate within a factor of 2, unlike in a bag played fast.

    By the medians of differences over many samples, since a recorder may take several at a time.
    """
    for samples in streams.values():
        apart = max(1, len(samples.stamp) // 64)
        if len(samples.stamp) > 2:
            stamped = float(np.median(samples.stamp[apart:] - samples.stamp[:-apart]))
            recorded = float(np.median(samples.log_time[apart:] - samples.log_time[:-apart]))
            if stamped > 0 and not 0.5 < recorded / stamped < 2.0:
                return False
    return True


def _parts_in_turn(streams: dict[str, Samples], use: str) -> dict[str, Samples] | None:
    """The samples with the parts between steps back placed one after another; None where the topics step differently.

    All topics are shifted by the same time in each part, so that forces and joint angles stay together.
    """
    times = [np.array(getattr(samples, use)) for samples in streams.values()]
    cuts = [[0, *(np.flatnonzero(np.diff(time) < -_LARGEST_STEP_BACK) + 1).tolist(), len(time)] for time in times]
    if len({len(cut) for cut in cuts}) != 1 or len(cuts[0]) < 3 or any(np.all(time == 0) for time in times):
        return None
    for part in range(1, len(cuts[0]) - 1):
        end = max(int(time[: cut[part]].max()) for time, cut in zip(times, cuts, strict=True))
        begin = min(int(time[cut[part] : cut[part + 1]].min()) for time, cut in zip(times, cuts, strict=True))
        for time, cut in zip(times, cuts, strict=True):
            time[cut[part] : cut[part + 1]] += end + _PAUSE - begin
    return {topic: samples._replace(stamp=time) for (topic, samples), time in zip(streams.items(), times, strict=True)}


def _in_order(topic: str, stamp: NDArray[np.int64], values: NDArray[np.float64], warnings: list[str]) -> Timed:
    """The samples sorted by stamp, the first of equal stamps only."""
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


def counted(number: int) -> str:
    """`1 message`, `2 messages` and so on."""
    return f'{number} message' if number == 1 else f'{number} messages'
