"""Online detection: the touches in two streams that are still running.

The latest samples are kept, whether anything is touched or not. A poll compares only the new forces,
smoothed, with the zero of the sensor; once the force has deviated from it and returned, `find_touches` runs on all kept
samples, and each contact that has ended is reported once. What the joints remember of the load is kept without a limit
of time.

Which clock is valid for both topics is found as for a recording (`clock`). Where there is none, nothing more is
reported: the recording could not be used either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats, interpolated
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.clock import NEVER, SECOND, BestLags, ClockStepError, Samples, on_one_clock
from scara_kinetostatic.touches.contacts import CONTACT_FORCE, END_RATIO, TurningZero, coarse_tare
from scara_kinetostatic.touches.detection import Detection, find_touches, no_touches
from scara_kinetostatic.touches.load_history import LoadMemory
from scara_kinetostatic.touches.streams import (
    SMOOTHING,
    JointStream,
    Streams,
    WrenchStream,
    as_signals,
    median_of_three,
    moving_mean,
)

_CLEAR = SECOND // 7
"""A contact is over when the force has been back at its zero for so long, ns."""


class SampleBuffer:
    """The latest samples of one topic in the order of arrival.

    They come into lists and are joined to the arrays when these are asked for.

    Args:
        most: samples that are kept at most, whatever their stamps.
        width: numbers of a sample.

    Attributes:
        total: number of samples so far, those that are no longer kept as well.
        by_log_time: whether times are those of reception, not the header stamps.
        offset: what is added to them, ns.
    """

    def __init__(self, most: int, width: int = 2) -> None:
        self._most = most
        self._times: list[int] = []
        self._numbers: list[float] = []
        self._kept = Samples(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, width)))
        self.total = 0
        self.by_log_time, self.offset = False, 0

    def append(self, stamp: int, log_time: int, value: Sequence[float]) -> None:
        """One sample with its header stamp and when it was received, ns."""
        self._times += (stamp, log_time)
        self._numbers.extend(value)
        self.total += 1
        if len(self._times) > self._most:
            _ = self.samples

    @property
    def samples(self) -> Samples:
        """All that are kept, as they came."""
        if self._times:
            times = np.array(self._times, dtype=np.int64).reshape(-1, 2)
            new = Samples(times[:, 0], times[:, 1], np.array(self._numbers, dtype=float).reshape(len(times), -1))
            joined = Samples(*(np.concatenate(both) for both in zip(self._kept, new, strict=True)))
            self._kept = joined.select(slice(-self._most, None))
            self._times, self._numbers = [], []
        return self._kept

    @property
    def times(self) -> NDArray[np.int64]:
        """Of the samples that are kept, by the valid clock, (n,), ns."""
        samples = self.samples
        return (samples.log_time if self.by_log_time else samples.stamp) + self.offset

    @property
    def now(self) -> int:
        """The latest time, ns; a single stamp that is far off does not count."""
        latest = np.sort(self.times[-7:])
        return int(latest[len(latest) // 2]) if len(latest) else 0

    def latest(self, span: int) -> Floats:
        """The values of the last so many ns, at least one, (k, 2)."""
        recent = self.times > self.now - span
        recent[-1:] |= not recent.any()
        return self.samples.values[recent]

    def drop_before(self, time: int) -> None:
        """Drops the samples that came before the first one with this time or a later one."""
        later = np.append(self.times >= time, True)
        self._kept = self.samples.select(slice(int(later.argmax()), None))


class StreamPair:
    """The latest samples of joint angles and forces, and the clock that both have in common.

    Args:
        topics: their names, for messages.
        most: samples of a topic that are kept at most.
        time_offset: of the cell description, s; None to compare the clocks.
        others: number of further joints, whose positions follow q1 and q2.

    Attributes:
        joints: joint angles, rad.
        wrench: forces as the sensor reports them, N.
        problem: what was corrected in the stamps the last time, or why they cannot be used; or empty.
        is_refused: whether they cannot be used.
    """

    def __init__(self, topics: tuple[str, str], most: int, time_offset: float | None = None, others: int = 0) -> None:
        self._topics, self._time_offset = topics, time_offset
        self.joints, self.wrench = self.buffers = SampleBuffer(most, 2 + others), SampleBuffer(most)
        self.problem, self.is_refused, self._has_stepped = '', False, False
        self._best: BestLags = ({}, {})

    def restart(self) -> None:
        """Drops all samples; what is known of the clocks stays."""
        for buffer in self.buffers:
            buffer.drop_before(np.iinfo(np.int64).max)

    def forget(self, horizon: int) -> None:
        """Drops the samples before the last so many ns, of each topic by its own stamps: their clocks may differ."""
        if any(len(buffer.times) and buffer.now - buffer.times[0] > horizon + SECOND for buffer in self.buffers):
            self.streams('online')  # a clock that was set is noted before
            for buffer in self.buffers:
                buffer.drop_before(buffer.now - horizon)

    def streams(self, source: str, at_end: bool = False) -> Streams | None:
        """What is kept on one clock; None where there is none, or where it is not yet sure.

        Args:
            source: for messages.
            at_end: whether nothing more will come.
        """
        samples = [buffer.samples for buffer in self.buffers]
        if self._has_stepped or not all(len(one.stamp) for one in samples):
            return None
        try:
            timed, clock = on_one_clock(source, self._topics, samples, [], self._time_offset, self._best)
        except RecordingError as error:
            self.problem, self.is_refused = f'{error.problem}: {error.remedy}', True
            self._has_stepped = isinstance(error, ClockStepError)
            return None
        self.is_refused = False
        for lags in self._best:
            while len(lags) > 3600:  # seconds: a drift shows within an hour
                del lags[next(iter(lags))]
        if not (at_end or clock.is_sure):
            return None
        self.problem = clock.warning
        for buffer, offset in zip(self.buffers, (0, clock.offset), strict=True):
            buffer.by_log_time, buffer.offset = clock.by_log_time, offset
        return Streams(source, JointStream.of(*timed[0]), WrenchStream(*timed[1]), topics=self._topics)


class OnlineDetector:
    """Finds touches in two streams that are still running.

    Not thread-safe: add and poll from one thread, or under a lock.

    Args:
        cell: nominal parameters, discs, frame and sign of the sensor.
        horizon: length of the streams that is kept, ns: the longest contact that can be found.
        topics: names of both, for messages; those of the cell by default.
        most: samples of a topic that are kept, whatever their stamps: the horizon at 5 kHz.

    Attributes:
        found: touches reported so far, accepted or rejected.
        clock_warning: what had to be corrected in the stamps, the last time the touches were looked for; or empty.
    """

    def __init__(
        self, cell: Cell, horizon: int = 30 * SECOND, topics: tuple[str, str] | None = None, most: int = 150_000
    ) -> None:
        self._cell, self._horizon = cell, horizon
        self._pair = StreamPair(topics or cell.sensor.topics, most, cell.sensor.time_offset, len(cell.other_joints))
        self._memory, self._turning = LoadMemory(), TurningZero()
        self._polled = self.found = 0
        self.clock_warning = ''
        self._begin()

    def _begin(self) -> None:
        self._tare: Floats | None = None
        self._width = 1
        self._in_contact = False
        self._reported = self._searched = NEVER

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float], log_time: int | None = None) -> None:
        """One sample of q1, q2, rad, and the cell's other joints, as far as they are known.

        Args:
            stamp_ns: its header stamp, ns.
            joints: their positions.
            log_time: when it was received, ns; by default at its stamp.
        """
        unknown = [np.nan] * (2 + len(self._cell.other_joints) - len(joints))
        self._pair.joints.append(stamp_ns, stamp_ns if log_time is None else log_time, [*joints, *unknown])

    def add_wrench(self, stamp_ns: int, force: Sequence[float], log_time: int | None = None) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its times as those of a joint state."""
        self._pair.wrench.append(stamp_ns, stamp_ns if log_time is None else log_time, force)

    def poll(self) -> Detection:
        """The touches completed since the last poll, numbered from the first of all; `found` counts the new ones."""
        if self._is_due():
            return self._search(open_too=False)
        if not self._in_contact:
            self._pair.forget(self._horizon)
        return Detection(no_touches())

    def finish(self) -> Detection:
        """The touches not yet reported, at the end of the streams; one still in contact counts as well."""
        return self._search(open_too=True)

    def restart(self) -> None:
        """Begins anew with what comes, as forces that are turned otherwise; call `finish` before.

        What the joints remember of the load, and the numbers of the touches, go on.
        """
        self._pair.restart()
        self._begin()

    def received(self, stamp_ns: int) -> int:
        """When the wrench was received whose stamp is nearest, ns, as long as it is kept."""
        wrench = self._pair.wrench
        return int(wrench.samples.log_time[np.argmin(np.abs(wrench.times - stamp_ns))])

    def _is_due(self) -> bool:
        """Whether a contact has ended, or five seconds of one are over, or half of the horizon."""
        wrench = self._pair.wrench
        new, self._polled = wrench.total - self._polled, wrench.total
        samples = wrench.samples
        if not new or not len(samples.stamp):
            return False
        self._searched = int(samples.log_time[0]) if self._searched == NEVER else self._searched
        waited = int(samples.log_time[-1]) - self._searched
        if self._tare is None or waited > self._horizon // 2:
            return waited > SECOND // 2
        recent = slice(-new - self._width, None)
        free = samples.values[recent] - self._turned(wrench.times[recent])
        smooth = moving_mean(median_of_three(free), self._width)
        # less than the force of a contact, as the zero may drift meanwhile
        self._in_contact |= bool(np.any(np.linalg.norm(smooth - self._tare, axis=1) > 0.8 * CONTACT_FORCE))
        last = wrench.latest(4 * _CLEAR // 3).mean(axis=0)
        last = last - self._turned(wrench.times[-1:])[0]
        is_back = np.hypot(*(last - self._tare)) < END_RATIO * CONTACT_FORCE
        return self._in_contact and waited > (SECOND // 2 if is_back else 5 * SECOND)

    def _turned(self, times: NDArray[np.int64]) -> Floats:
        """What turns with link 2 in the readings of the sensor, and the weight of its tool, then, (k, 2), N."""
        stamps, joints = self._pair.joints.times, self._pair.joints.samples.values
        if not len(stamps) or not (self._turning.force or self._cell.sensor.tool_weight):
            return np.zeros((len(times), 2))
        at = interpolated(times, stamps, joints[:, :2])
        return self._turning.at(at, self._cell) + self._cell.tool_pull(at)

    def _search(self, open_too: bool) -> Detection:
        """The touches among the kept samples that are new and complete; with `open_too`, also those in contact."""
        streams = self._pair.streams('online', at_end=open_too)
        self.clock_warning = self._pair.problem
        received = self._pair.wrench.samples.log_time
        self._searched = int(received[-1]) if len(received) else NEVER
        signals = None if streams is None else as_signals(streams, self._cell)
        if streams is None or signals is None:
            self._pair.forget(self._horizon)
            return Detection(no_touches())
        found = find_touches(streams, self._cell, self._memory, self._turning)
        self._turning = found.turning
        self._tare = coarse_tare(self._turning.out_of(signals, self._cell))[-1]
        self._width = 2 * round(0.5 * SMOOTHING / signals.wrench.period) + 1
        latest = min(int(streams.wrench.stamp[-1]) - _CLEAR, int(streams.joints.stamp[-1]))
        new = self._new(found, np.iinfo(np.int64).max if open_too else latest)
        self._pair.forget(self._horizon)
        return new

    def _new(self, detection: Detection, latest: int) -> Detection:
        """The touches of a detection that have not been reported and whose contact had ended at `latest`, ns."""
        contacts = [
            detection.start + np.round(SECOND * np.array(one.contact)).astype(int) for one in detection.episodes
        ]
        self._in_contact = any(end > latest for _, end in contacts)
        new = [n for n, (begin, end) in enumerate(contacts) if begin > self._reported and end <= latest]
        self._reported = max([self._reported, *(int(contacts[number][1]) for number in new)])
        complete = [memory for memory in detection.memories if memory.stamp <= latest]
        self._memory = complete[-1] if complete else self._memory
        part = detection.renumbered(new, self.found)
        self.found += len(new)
        return part
