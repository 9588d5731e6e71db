"""One clock for both topics: the header stamps where they are valid, else the recording times.

Joint angles and forces are matched by their stamps, so both must come from one clock. Where the clocks of the topics
differ, by the messages that were least late (`arrivals`), the stamps of one topic are shifted. Header stamps are not
valid where they are zero or constant, where they step back by more than `_LARGEST_STEP_BACK` (a simulation restarted, a
bag played in a loop), or where the clocks drift apart. The recording times (log times) then replace them in both
topics, if these are valid, and messages that were received late are dropped. Where both step back, as when the
computer's clock was set back, the parts between the steps are placed one after another. The same judgement serves
recordings and the streams of a running cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.touches.arrivals import (
    LARGEST_OFFSET,
    LeastLags,
    Samples,
    lags_at_pace,
    least_lags,
    paused_share,
    rate,
    received_late,
)

_LARGEST_STEP_BACK = 1_000_000_000
"""Stamps that step back by more than this are from a clock that was set; by less, from messages out of order, ns."""
_OUTLIER = 60_000_000_000
"""A stamp that differs by more than this from the median of its neighbours is an outlier, ns."""
_LARGEST_OUTLIER_SHARE = 20
"""Outliers are dropped if they are at most one in so many stamps."""
_PAUSE = 1_000_000_000
"""Time inserted between the parts of a recording whose clock was set back, ns: longer than a gap within a touch."""
_LARGEST_SHARE_PAUSED = 0.1
"""Recording times are doubtful where nothing is received for a larger part of the time: what follows may be late."""
_FINE = 10_000_000
"""A smaller rest of a difference that was taken out stays, ns."""


class Timed(NamedTuple):
    """Samples in the order of their stamps, each stamp once: (n,) ns and (n, 2)."""

    stamp: NDArray[np.int64]
    values: NDArray[np.float64]


class KnownClocks(NamedTuple):
    """What is known of the clocks from samples that are kept no longer.

    Attributes:
        by_log_time: whether the stamps are recording times.
        shifts: what was added to the stamps of each topic, ns.
        apart: by how much the stamps of the first topic are ahead of those of the second, shifts left out, when both
            were last received on time, ns; None where that is not known.
    """

    by_log_time: bool = False
    shifts: tuple[int, int] = (0, 0)
    apart: int | None = None


class Judgement(NamedTuple):
    """Which clock is valid for both topics.

    Attributes:
        topics: the samples of each topic in the order given, on that clock.
        arrived: the same by topic, in the order of arrival.
        known: what to hand to the next judgement of these streams.
        shifts: what was added to the stamps of each topic, ns, beside the shifts known before.
        joined: whether parts between steps back were placed one after another.
        at_one_rate: whether stamps and recording times run at the same rate.
        on_time: whether both topics were on time when their clocks were last compared.
    """

    topics: list[Timed]
    arrived: dict[str, Samples]
    known: KnownClocks
    shifts: tuple[int, int] = (0, 0)
    joined: bool = False
    at_one_rate: bool = True
    on_time: bool = True

    @property
    def by_log_time(self) -> bool:
        """Whether the clock is that of the recording times."""
        return self.known.by_log_time


def judge_clocks(
    source: str, streams: dict[str, Samples], warnings: list[str], known: KnownClocks | None = None
) -> Judgement:
    """Both topics sorted by time on one clock, and which that is.

    Args:
        source: the recording, for messages.
        streams: of both topics, at least one sample each.
        warnings: what was corrected is appended here.
        known: from earlier samples of the same streams; None for a whole recording.

    Raises:
        RecordingError: neither the header stamps nor the recording times are valid.
    """
    is_whole, known = known is None, known or KnownClocks()
    streams = {topic: _without_outliers(topic, samples, warnings) for topic, samples in streams.items()}
    if known.by_log_time:
        return _as_received(streams, warnings)
    problem, shifts, on_time = _problem(streams, 'stamp'), (0, 0), True
    comparable = not (problem or _problem(streams, 'log_time'))
    if comparable and not _at_one_rate(streams):
        on_time = known.apart is not None or _paused(streams) < _LARGEST_SHARE_PAUSED
        warnings += _doubt(streams) if is_whole else []
    elif comparable:
        lags, shifted = least_lags(*streams.values()), known.shifts[0] - known.shifts[1]
        found = lags.difference()
        known = known._replace(apart=known.apart if found is None else found - shifted)
        on_time = known.apart is not None
        apart = lags.guess() - shifted if known.apart is None else known.apart
        problem = _drift(streams, lags.drift(apart + shifted))
        shifts = _shifts(lags, apart, known.shifts)
    if problem:
        return _without_stamps(source, streams, problem, warnings, known)
    total = (known.shifts[0] + shifts[0], known.shifts[1] + shifts[1])
    if any(total):
        shifted_topics = ' and '.join(topic for topic, shift in zip(streams, total, strict=True) if shift)
        warnings.append(f'{_differ(streams, total[0] - total[1])}: the stamps of {shifted_topics} were shifted')
    moved = {
        topic: samples._replace(stamp=samples.stamp + shift) if shift else samples
        for (topic, samples), shift in zip(streams.items(), shifts, strict=True)
    }
    known = known._replace(shifts=total)
    return Judgement(_all_in_order(moved, warnings), moved, known, shifts, on_time=on_time)


def _without_stamps(
    source: str, streams: dict[str, Samples], problem: str, warnings: list[str], known: KnownClocks
) -> Judgement:
    """Both topics by their recording times, or with the parts between steps back in turn."""
    joined = _parts_in_turn(streams, 'stamp')
    valid = not _problem(streams, 'log_time')
    one_rate = _at_one_rate(streams)
    if valid and (joined is None or one_rate):
        warnings.append(f'{problem}: the recording times were used instead')
        judged, paused = _as_received(streams, warnings), _paused(streams)
        dropped = any(len(judged.arrived[topic].stamp) < len(samples.stamp) for topic, samples in streams.items())
        if dropped and paused > _LARGEST_SHARE_PAUSED:
            doubt = f'nothing was received during {100 * paused:.0f} % of the time, and messages came late'
            warnings.append(f'{doubt}: without valid stamps some forces may belong to other joint angles')
        return judged._replace(at_one_rate=one_rate)
    if (joined := joined or _parts_in_turn(streams, 'log_time')) is None:
        remedy = 'record in one run, with stamps from one clock'
        raise RecordingError(source, f'{problem}, and the recording times are not valid either', remedy)
    why = 'the recording times run at another rate' if valid else 'so do the recording times'
    warnings.append(f'{problem}, {why}: the parts were placed one after another')
    known = known._replace(apart=None)
    return Judgement(_all_in_order(joined, warnings), joined, known, joined=True, at_one_rate=one_rate)


def _as_received(streams: dict[str, Samples], warnings: list[str]) -> Judgement:
    """Both topics by their recording times, without the messages that were received late."""
    received = {}
    for topic, samples in streams.items():
        late = received_late(samples)
        if late.any():
            warnings.append(f'{topic}: {counted(int(late.sum()))} dropped that were received late')
        stamp, values = samples.log_time[~late], samples.values[~late]
        received[topic] = Samples(stamp, stamp, values)
    return Judgement(_all_in_order(received, warnings), received, KnownClocks(by_log_time=True))


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


def _drift(streams: dict[str, Samples], away: int) -> str:
    """Why the stamps of the topics drift apart, by `away` ns; empty if they do not."""
    topics = ' and '.join(streams)
    return f'`header.stamp` of {topics} comes from clocks that drift apart, by up to {away / 1e9:.3g} s' if away else ''


def _doubt(streams: dict[str, Samples]) -> list[str]:
    """That clocks seem to differ in what was recorded while it was played fast or slowly; nothing is corrected there.

    What is a short delay in real time is a long one by the stamps.
    """
    lags = lags_at_pace(*streams.values())
    apart = None if lags is None else lags.difference()
    if lags is None or apart is None or abs(apart) < LARGEST_OFFSET or lags.drift(apart):
        return []
    return [
        f'{_differ(streams, round(apart / lags.pace))}, or one of them was late: they were recorded at another speed, '
        'and nothing was shifted; forces may belong to other joint angles'
    ]


def _shifts(lags: LeastLags, apart: int, known: tuple[int, int]) -> tuple[int, int]:
    """What to add to the stamps of each topic, ns, beside what is known: to those farther from reception."""
    if abs(apart) < LARGEST_OFFSET:
        return -known[0], -known[1]
    rest = apart + known[0] - known[1]
    if abs(rest) < _FINE or not len(lags.lags):
        return 0, 0
    first = known[0] != 0 if any(known) else np.subtract(*np.abs(lags.lags.max(axis=0))) > 0
    return (-rest, 0) if first else (0, rest)


def _differ(streams: dict[str, Samples], apart: int) -> str:
    return f'`header.stamp` of {" and ".join(streams)} comes from clocks that differ by {abs(apart) / 1e9:.3g} s'


def _at_one_rate(streams: dict[str, Samples]) -> bool:
    """Whether stamps and recording times run at the same rate within a factor of 2, unlike in a bag played fast."""
    return all(0.5 < rate(samples) < 2.0 for samples in streams.values())


def _paused(streams: dict[str, Samples]) -> float:
    """The part of the time in which a topic pauses, by the recording times."""
    return max(paused_share(samples) for samples in streams.values())


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


def _all_in_order(streams: dict[str, Samples], warnings: list[str]) -> list[Timed]:
    return [_in_order(topic, samples.stamp, samples.values, warnings) for topic, samples in streams.items()]


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
