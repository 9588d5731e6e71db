"""One clock for both streams: header stamps where they can be trusted, else the times of recording.

The two topics are brought together by their stamps, so both must be on one
clock. Header stamps are not to be trusted where they are missing or stand
still, where they run back by more than `RESET` (a simulation restarted, a bag
played in a loop), or where the two topics' clocks disagree. The times of
recording then serve for both topics, if they are sound. Where both run back,
as when the computer's clock was set back, the parts in between are put one
after the other.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.bags.decoding import Samples
from scara_kinetostatic.errors import RecordingError

RESET = 1_000_000_000
"""A step back larger than this is no disorder but another clock, ns."""

STRAY = 60_000_000_000
"""A single stamp this far from the others is a slip, ns."""

PAUSE = 1_000_000_000
"""Between the parts of a recording whose clock was set back, ns: too long for a touch to reach across."""

DISAGREEMENT = 250_000_000
"""Two clocks this far apart would put a force beside the wrong joint angles, ns."""

STRETCH, LEAST_STRETCHES, MOST_STRETCHES = 2_000_000_000, 8, 200
"""Lags that vary are compared stretch by stretch, of at least so many ns each."""
SHORT = 0.04
"""That the lags are apart in a smaller part of the stretches is no matter."""
PACE = 0.03
"""Stamps and times of recording go at one pace if they differ by less over a stretch; clocks drift far less."""


class Timed(NamedTuple):
    """Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""

    stamp: NDArray[np.int64]
    values: NDArray[np.float64]


def on_one_clock(source: str, streams: dict[str, Samples], warnings: list[str]) -> list[Timed]:
    """Both streams in order on one clock.

    Args:
        source: the recording, for messages.
        streams: by topic, at least one sample each.
        warnings: what was mended is added here.

    Raises:
        RecordingError: neither header stamps nor times of recording make sense.
    """
    streams = {topic: _without_strays(topic, samples, warnings) for topic, samples in streams.items()}
    complaint = _complaint(streams, 'stamp') or _disagreement(streams)
    use = 'stamp'
    if complaint:
        mended = _end_to_end(streams, 'stamp')
        sound = not _complaint(streams, 'log_time')
        if sound and (mended is None or _at_one_pace(streams)):
            use = 'log_time'
            warnings.append(f'{complaint}: the times of recording were used instead')
        elif (mended := mended or _end_to_end(streams, 'log_time')) is not None:
            streams = mended
            why = 'the times of recording go at another pace' if sound else 'the times of recording as well'
            warnings.append(f'{complaint}, {why}: the parts were put one after the other')
        else:
            remedy = 'record the robot in one go, with stamps from one clock'
            raise RecordingError(source, f'{complaint}, and the times of recording are no better', remedy)
    return [_in_order(topic, getattr(samples, use), samples.values, warnings) for topic, samples in streams.items()]


def _without_strays(topic: str, samples: Samples, warnings: list[str]) -> Samples:
    """Drop the few messages whose stamp is missing or a minute off those around it."""
    if np.all(np.abs(np.diff(samples.stamp)) < STRAY):
        return samples
    around = sliding_window_view(np.pad(samples.stamp, 3, mode='symmetric'), 7)
    stray = np.abs(samples.stamp - np.median(around, axis=1)) > STRAY
    number = int(np.sum(stray))
    if number == 0 or number > max(1, len(stray) // 20):
        return samples
    warnings.append(f'{topic}: {counted(number)} with a stamp far off dropped')
    return samples._replace(
        stamp=samples.stamp[~stray], log_time=samples.log_time[~stray], values=samples.values[~stray]
    )


def _complaint(streams: dict[str, Samples], use: str) -> str:
    """Why the times of a kind cannot be used; empty where they can."""
    for topic, samples in streams.items():
        times: NDArray[np.int64] = getattr(samples, use)
        if np.all(times == 0):
            return f'the stamps of {topic} are all zero'
        if len(times) > 2 and np.all(times == times[0]):
            return f'the stamps of {topic} stand still'
        step = int(np.min(np.diff(times), initial=0))
        if step < -RESET:
            return f'the stamps of {topic} jump back by {-step / 1e9:.3g} s'
    return ''


def _disagreement(streams: dict[str, Samples]) -> str:
    """Whether the clocks of the two topics are apart, or run apart, by their lags against the times of recording."""
    if _complaint(streams, 'log_time'):
        return ''
    lags = []
    for samples in streams.values():
        lag = samples.stamp - samples.log_time
        low, middle, high = np.percentile(lag - lag[0], [5, 50, 95])
        if high - low > DISAGREEMENT:
            return _running_apart(streams)
        lags.append(int(lag[0]) + int(middle))
    apart = max(lags) - min(lags)
    if apart < DISAGREEMENT:
        return ''
    return f'the stamps of {" and ".join(streams)} come from clocks that are {apart / 1e9:.3g} s apart'


def _running_apart(streams: dict[str, Samples]) -> str:
    """Whether the lags differ where stamps and times of recording go at one pace.

    Elsewhere a recorder stood still or caught up, or what it recorded was played fast: the stamps are the better clock.
    """
    samples = list(streams.values())
    begin = max(int(one.log_time.min()) for one in samples)
    end = min(int(one.log_time.max()) for one in samples)
    number = min((end - begin) // STRETCH, MOST_STRETCHES)
    if number < LEAST_STRETCHES:
        return ''
    edges = np.linspace(begin, end, number + 1)
    apart = []
    for low, high in pairwise(edges):
        lags = [_lag(one, low, high) for one in samples]
        if not any(np.isnan(lags)):
            apart.append(abs(lags[0] - lags[1]))
    if len(apart) < LEAST_STRETCHES or np.mean(np.array(apart) > DISAGREEMENT) < SHORT:
        return ''
    return f'the stamps of {" and ".join(streams)} run apart, by up to {max(apart) / 1e9:.3g} s'


def _lag(samples: Samples, begin: float, end: float) -> float:
    """Median lag of the stamps behind the times of recording within a stretch, ns; NaN where the two go at different
    paces.
    """
    first, last = np.searchsorted(samples.log_time, [begin, end])
    stamp, recorded = samples.stamp[first:last].astype(float), samples.log_time[first:last].astype(float)
    if len(stamp) < 3 or abs((recorded[-1] - recorded[0]) - (stamp[-1] - stamp[0])) > PACE * (end - begin):
        return np.nan
    return float(np.median(stamp - recorded))


def _at_one_pace(streams: dict[str, Samples]) -> bool:
    """Whether stamps and times of recording go at about the same pace; a bag that was played fast has others.

    Judged over many samples, as a recorder may take several at a time.
    """
    for samples in streams.values():
        apart = max(1, len(samples.stamp) // 64)
        if len(samples.stamp) > 2:
            stamped = float(np.median(samples.stamp[apart:] - samples.stamp[:-apart]))
            recorded = float(np.median(samples.log_time[apart:] - samples.log_time[:-apart]))
            if stamped > 0 and not 0.5 < recorded / stamped < 2.0:
                return False
    return True


def _end_to_end(streams: dict[str, Samples], use: str) -> dict[str, Samples] | None:
    """The streams with stamps that run on, from times that were set back on all topics together; None from others.

    Each part of all topics is moved by the same time, so that forces stay beside their joint angles.
    """
    times = [np.array(getattr(samples, use)) for samples in streams.values()]
    cuts = [[0, *(np.flatnonzero(np.diff(time) < -RESET) + 1).tolist(), len(time)] for time in times]
    if len({len(cut) for cut in cuts}) != 1 or len(cuts[0]) < 3 or any(np.all(time == 0) for time in times):
        return None
    for part in range(1, len(cuts[0]) - 1):
        end = max(int(time[: cut[part]].max()) for time, cut in zip(times, cuts, strict=True))
        begin = min(int(time[cut[part] : cut[part + 1]].min()) for time, cut in zip(times, cuts, strict=True))
        for time, cut in zip(times, cuts, strict=True):
            time[cut[part] : cut[part + 1]] += end + PAUSE - begin
    return {topic: samples._replace(stamp=time) for (topic, samples), time in zip(streams.items(), times, strict=True)}


def _in_order(topic: str, stamp: NDArray[np.int64], values: NDArray[np.float64], warnings: list[str]) -> Timed:
    """Sort what is out of order and keep the first of equal stamps."""
    backwards = int(np.sum(np.diff(stamp) < 0))
    if backwards:
        warnings.append(f'{topic}: stamps run backwards ({backwards} times), sorted')
        order = np.argsort(stamp, kind='stable')
        stamp, values = stamp[order], values[order]
    repeated = np.concatenate([[False], np.diff(stamp) == 0])
    if np.any(repeated):
        warnings.append(f'{topic}: {counted(int(np.sum(repeated)))} with the stamp of another dropped')
        stamp, values = stamp[~repeated], values[~repeated]
    stamp.flags.writeable = False
    values.flags.writeable = False
    return Timed(stamp, values)


def counted(number: int) -> str:
    """So many messages, in words that fit."""
    return f'{number} message' if number == 1 else f'{number} messages'
