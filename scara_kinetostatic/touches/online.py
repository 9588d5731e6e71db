"""Online detection: the touches in two streams that are still running.

The latest samples are kept, whether anything is touched or not. A poll compares only the new forces,
smoothed, with the zero of the sensor; once the force has deviated from it and returned, `find_touches` runs on all kept
samples, and each contact that has ended is reported once. What the joints remember of the load is kept without a limit
of time.

Which clock is valid for both topics is found as for a recording (`clock`), by all that came so far. Where there is
none, nothing more is reported: the recording could not be used either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.clock import ClockComparison, Samples, by_clock, strays, without_strays
from scara_kinetostatic.touches.contacts import CONTACT_FORCE, END_RATIO, coarse_tare
from scara_kinetostatic.touches.detection import Detection, find_touches, no_touches
from scara_kinetostatic.touches.load_history import LoadMemory
from scara_kinetostatic.touches.signals import SMOOTHING, as_signals, median_of_three, moving_mean
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 1_000_000_000
_MOST = 150_000
"""Most samples of a topic that are kept, whatever their stamps: the horizon at 5 kHz."""


_CLEAR = SECOND // 7
"""A contact is over when the force has been back at its zero for so long, ns."""
_SHORTEST_WAIT = SECOND // 2
"""Touches are looked for once in so long at most, ns."""
_NEVER = -(1 << 62)


class SampleBuffer:
    """The latest samples of one topic in the order of arrival.

    They come into lists and are joined to the arrays when these are asked for.

    Args:
        most: samples that are kept at most, whatever their stamps.

    Attributes:
        total: number of samples so far, those that are no longer kept as well.
        by_log_time: whether times are those of reception, not the header stamps.
        offset: what is added to them, ns.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._times: list[int] = []
        self._pairs: list[float] = []
        self._kept = Samples(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2)))
        self.total = 0
        self.by_log_time, self.offset = False, 0

    def append(self, stamp: int, log_time: int, value: Sequence[float]) -> None:
        """One sample with its header stamp and when it was received, ns."""
        self._times += (stamp, log_time)
        self._pairs.extend(value)
        self.total += 1
        if len(self._times) > self._most:
            _ = self.samples

    @property
    def samples(self) -> Samples:
        """All that are kept, as they came."""
        if self._times:
            times = np.array(self._times, dtype=np.int64).reshape(-1, 2)
            new = Samples(times[:, 0], times[:, 1], np.array(self._pairs, dtype=float).reshape(-1, 2))
            joined = Samples(*(np.concatenate(both) for both in zip(self._kept, new, strict=True)))
            self._kept = joined.select(slice(-self._most, None))
            self._times, self._pairs = [], []
        return self._kept

    def last(self, number: int) -> Samples:
        """At most so many of the latest that are kept."""
        return self.samples.select(slice(max(0, len(self.samples.stamp) - number), None))

    @property
    def times(self) -> NDArray[np.int64]:
        """Of the samples that are kept, by the valid clock, (n,), ns."""
        samples = self.samples
        return (samples.log_time if self.by_log_time else samples.stamp) + self.offset

    @property
    def now(self) -> int:
        """The latest time, ns; a single stamp that is far off does not count."""
        stamp, log_time, _ = self.last(7)
        latest = sorted((log_time if self.by_log_time else stamp).tolist())
        return int(latest[len(latest) // 2]) + self.offset if latest else 0

    @property
    def received(self) -> int:
        """When the latest sample was received, ns; 0 where there is none."""
        times = self.samples.log_time
        return int(times[-1]) if len(times) else 0

    def latest(self, span: int) -> Floats:
        """The values of the last so many ns, at least one, (k, 2)."""
        values = self.last(2048).values
        recent = self.times[-2048:] > self.now - span
        return values[recent] if recent.any() else values[-1:]

    def log_time_of(self, time: int) -> int:
        """When the sample was received whose time is nearest, ns."""
        return int(self.samples.log_time[np.argmin(np.abs(self.times - time))])

    def clear(self) -> None:
        """Drops all samples."""
        self._kept = self.samples.select(slice(0))

    def drop_before(self, time: int) -> None:
        """Drops the samples that came before the first one with this time or a later one."""
        times = self.times
        if len(times) and times[0] < time:
            later = times >= time
            self._kept = self.samples.select(slice(int(later.argmax()) if later.any() else len(later), None))


class StreamPair:
    """The latest samples of joint angles and forces, and the clock that both have in common.

    Args:
        topics: their names, for messages.
        most: samples of a topic that are kept at most.
        time_offset: of the cell description, s; None to compare the clocks.

    Attributes:
        joints: joint angles, rad.
        wrench: forces as the sensor reports them, N.
        problem: what was corrected in the stamps the last time, or why they cannot be used; or empty.
        is_refused: whether they cannot be used.
    """

    def __init__(self, topics: tuple[str, str], most: int, time_offset: float | None = None) -> None:
        self._topics = topics
        self.joints, self.wrench = self.buffers = SampleBuffer(most), SampleBuffer(most)
        self.problem, self.is_refused = '', False
        self._comparison = ClockComparison('online', topics, time_offset)
        self._observed = [0, 0]

    def restart(self) -> None:
        """Drops all samples; what is known of the clocks stays."""
        self.observe()
        for buffer in self.buffers:
            buffer.clear()

    def observe(self) -> None:
        """Compares the clocks by what came since the last call; to be called before samples are dropped."""
        fresh = []
        for place, buffer in enumerate(self.buffers):
            new = min(buffer.total - self._observed[place], len(buffer.samples.stamp))
            around = buffer.last(new + 100)
            sound = ~strays(around.stamp, self._comparison.rule)
            sound[: len(sound) - new] = False
            fresh.append(around.select(sound))
            self._observed[place] = buffer.total
        self._comparison.observe(*fresh)

    def streams(self, source: str, at_end: bool = False, now: int = 0) -> Streams | None:
        """What is kept on one clock; None where there is none, or where it is not yet sure.

        Args:
            source: for messages.
            at_end: whether nothing more will come.
            now: on the clock of the reception, ns, where nothing may come for a while; 0: when the last was received.
        """
        self.observe()
        samples = [
            without_strays(topic, buffer.samples, []) for topic, buffer in zip(self._topics, self.buffers, strict=True)
        ]
        self._comparison.check_reception(*samples)
        try:
            clock = self._comparison.clock(now)
        except RecordingError as error:
            self.problem, self.is_refused = f'{error.problem}: {error.remedy}', True
            return None
        self.is_refused = False
        if not (at_end or clock.is_sure):
            return None
        self.problem = clock.warning
        for buffer, offset in zip(self.buffers, (0, clock.offset), strict=True):
            buffer.by_log_time, buffer.offset = clock.by_log_time, offset
        joints, wrench = by_clock(self._topics, samples, clock, [])
        return Streams(source, JointStream(*joints), WrenchStream(*wrench), topics=self._topics)


class OnlineDetector:
    """Finds touches in two streams that are still running.

    Not thread-safe: add and poll from one thread, or under a lock.

    Args:
        cell: nominal parameters, discs, frame and sign of the sensor.
        horizon: length of the streams that is kept, ns: the longest contact that can be found.
        topics: names of both, for messages; those of the cell by default.

    Attributes:
        clock_warning: what had to be corrected in the stamps, the last time the touches were looked for; or empty.
    """

    def __init__(self, cell: Cell, horizon: int = 30 * SECOND, topics: tuple[str, str] | None = None) -> None:
        self._cell = cell
        self._topics = topics or cell.sensor.topics
        self._horizon = horizon
        self._found = 0
        self._pair = StreamPair(self._topics, _MOST, cell.sensor.time_offset)
        self._tare: NDArray[np.float64] | None = None
        self._width = 1
        self._polled = 0
        self._reported = self._searched = self._searched_stamp = _NEVER
        self._in_contact = False
        self._memory = LoadMemory()
        self.clock_warning = ''

    @property
    def found(self) -> int:
        """Touches reported so far, accepted or rejected."""
        return self._found

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float], log_time: int | None = None) -> None:
        """One sample of q1, q2, rad, with its header stamp and when it was received, ns; by default at its stamp."""
        self._pair.joints.append(stamp_ns, stamp_ns if log_time is None else log_time, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float], log_time: int | None = None) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its times as those of a joint state."""
        self._pair.wrench.append(stamp_ns, stamp_ns if log_time is None else log_time, force)

    def poll(self) -> Detection:
        """The touches completed since the last poll, numbered from the first of all; `found` counts the new ones."""
        if self._is_due():
            return self._search(open_too=False)
        if not self._in_contact:
            self._forget()
        return Detection(no_touches())

    def finish(self) -> Detection:
        """The touches not yet reported, at the end of the streams; one still in contact counts as well."""
        return self._search(open_too=True)

    def restart(self) -> None:
        """Begins anew with what comes, as forces that are turned otherwise; call `finish` before.

        What the joints remember of the load, and the numbers of the touches, go on.
        """
        self._pair.restart()
        self._tare, self._in_contact = None, False
        self._reported = self._searched = _NEVER

    def received(self, stamp_ns: int) -> int:
        """When the wrench was received whose stamp is nearest, ns, as long as it is kept."""
        return self._pair.wrench.log_time_of(stamp_ns)

    def _is_due(self) -> bool:
        """Whether a contact has ended, or five seconds of one are over."""
        wrench = self._pair.wrench
        new, self._polled = wrench.total - self._polled, wrench.total
        if not new:
            return False
        self._pair.observe()
        fresh = wrench.last(new + self._width).values
        if not len(fresh):  # `restart` has dropped them
            return False
        if self._searched == _NEVER:
            first = wrench.samples
            self._searched, self._searched_stamp = int(first.log_time[0]), int(wrench.times[0])
        waited = max(abs(wrench.received - self._searched), abs(wrench.now - self._searched_stamp))
        if self._tare is None:
            return waited > _SHORTEST_WAIT
        smooth = moving_mean(median_of_three(fresh), self._width)
        # less than the force of a contact, as the zero may drift meanwhile
        self._in_contact |= bool(np.any(_deviation(smooth, self._tare) > 0.8 * CONTACT_FORCE))
        last = wrench.latest(4 * _CLEAR // 3).mean(axis=0)
        back = bool(_deviation(last, self._tare) < END_RATIO * CONTACT_FORCE)
        return self._in_contact and (waited > 5 * SECOND or (back and waited > _SHORTEST_WAIT))

    def _search(self, open_too: bool) -> Detection:
        """The touches among the kept samples that are new and complete; with `open_too`, also those in contact."""
        none = Detection(no_touches())
        if not (len(self._pair.joints.samples.stamp) and len(self._pair.wrench.samples.stamp)):
            return none
        streams = self._pair.streams('online', at_end=open_too)
        self._searched, self._searched_stamp = self._pair.wrench.received, self._pair.wrench.now
        self.clock_warning = self._pair.problem
        if streams is None:
            self._forget()
            return none
        signals = as_signals(streams, self._cell)
        if signals is None:
            return none
        self._tare = coarse_tare(signals)[-1]
        self._width = 2 * round(0.5 * SMOOTHING / signals.wrench.period) + 1
        latest = min(int(streams.wrench.stamp[-1]) - _CLEAR, int(streams.joints.stamp[-1]))
        new = self._new(find_touches(streams, self._cell, self._memory), np.iinfo(np.int64).max if open_too else latest)
        self._forget()
        return new

    def _new(self, detection: Detection, latest: int) -> Detection:
        """The touches of a detection that have not been reported and whose contact had ended at `latest`, ns."""
        ends = [detection.start + round(1e9 * episode.contact[1]) for episode in detection.episodes]
        begins = [detection.start + round(1e9 * episode.contact[0]) for episode in detection.episodes]
        self._in_contact = any(end > latest for end in ends)
        new = [n for n, begin in enumerate(begins) if begin > self._reported and ends[n] <= latest]
        self._reported = max([self._reported, *(ends[number] for number in new)])
        complete = [memory for memory in detection.memories if memory.stamp <= latest]
        self._memory = complete[-1] if complete else self._memory
        part = detection.part(new).renumbered(self._found)
        self._found += len(new)
        return part

    def _forget(self) -> None:
        """Drops the samples before the horizon, of each topic by its own stamps: their clocks may differ."""
        for buffer in self._pair.buffers:
            buffer.drop_before(buffer.now - self._horizon)


def _deviation(force: NDArray[np.float64], tare: NDArray[np.float64]) -> NDArray[np.float64]:
    distance: NDArray[np.float64] = np.linalg.norm(force - tare, axis=-1)
    return distance
