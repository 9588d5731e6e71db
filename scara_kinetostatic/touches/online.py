"""Online detection: the touches in two streams that are still running.

The latest `_HORIZON` of samples is kept, whether anything is touched or not, and never more than `_MOST` of a topic. A
poll compares only the new forces, smoothed, with the zero of the sensor; once the force has deviated from it and
returned, `find_touches` runs on all kept samples, and each contact that has ended is reported once. What the joints
remember of the load is kept without a limit of time.

Which clock is valid for both topics is judged as for a recording (`clock.judge_clocks`), by the samples kept: the
header stamps, else the times at which the messages were received. Once these had to be used, they are used on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.clock import Judgement, Samples, judge_clocks
from scara_kinetostatic.touches.detection import Detection, find_touches, no_touches
from scara_kinetostatic.touches.load_history import LoadMemory
from scara_kinetostatic.touches.segmentation import CONTACT_FORCE, END_RATIO
from scara_kinetostatic.touches.signals import SMOOTHING, as_signals, median_of_three, moving_mean
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream
from scara_kinetostatic.touches.tare import coarse_tare

SECOND = 1_000_000_000
_HORIZON = 30 * SECOND
"""Older samples are dropped, ns: the longest contact that can be found."""
_MOST = 150_000
"""Most samples of a topic that are kept, whatever their stamps: the horizon at 5 kHz."""
_CLEAR = SECOND // 7
"""A contact is over when the force has been back at its zero for so long, ns."""
_LONGEST_WAIT = 5 * SECOND
"""During a contact the detection runs once in so long, ns,"""
_SHORTEST_WAIT = SECOND // 2
"""and never more often than once in so long, ns."""
_SURE = 3 * SECOND
"""After less than this time the difference of the clocks may be that of the first delays, ns."""
_ALERT = 0.8
"""A poll looks for touches from this part of the force on at which a contact begins: the zero may drift meanwhile."""
_NEVER = -(1 << 62)


class OnlineDetector:
    """Finds touches in two streams that are still running.

    Not thread-safe: add and poll from one thread, or under a lock.

    Args:
        cell: nominal parameters, discs, frame and sign of the sensor.
        horizon: length of the streams that is kept, ns.
        topics: names of both, for messages; those of the cell by default.

    Attributes:
        clock_warning: what had to be corrected in the stamps, the last time the touches were looked for; or empty.
    """

    def __init__(self, cell: Cell, horizon: int = _HORIZON, topics: tuple[str, str] | None = None) -> None:
        self._cell = cell
        self._topics = topics or cell.sensor.topics
        self._horizon = horizon
        self._found = 0
        self._joints, self._wrench = _Buffer(), _Buffer()
        self._tare: NDArray[np.float64] | None = None
        self._width = 1
        self._reported = self._searched = _NEVER
        self._in_contact = False
        self._memory = LoadMemory()
        self.clock_warning = ''

    @property
    def found(self) -> int:
        """Touches reported so far, accepted or rejected."""
        return self._found

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float], log_time: int | None = None) -> None:
        """One sample of q1, q2, rad, with its header stamp and when it was received, ns; by default at its stamp."""
        self._joints.append(stamp_ns, stamp_ns if log_time is None else log_time, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float], log_time: int | None = None) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its times as those of a joint state."""
        self._wrench.append(stamp_ns, stamp_ns if log_time is None else log_time, force)

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
        self._joints, self._wrench = _Buffer(), _Buffer()
        self._tare, self._in_contact = None, False
        self._reported = self._searched = _NEVER

    def received(self, stamp_ns: int) -> int:
        """When the wrench was received whose stamp is nearest, ns, as long as it is kept."""
        return self._wrench.log_time_of(stamp_ns)

    def _is_due(self) -> bool:
        """Whether a contact has ended, or `_LONGEST_WAIT` is over."""
        fresh = self._wrench.fresh(self._width)
        if not len(fresh):
            return False
        now = self._wrench.now
        if self._searched == _NEVER:
            self._searched = int(self._wrench.samples.stamp[0])
        waited = abs(now - self._searched)
        if self._tare is None:
            return waited > _SHORTEST_WAIT
        smooth = moving_mean(median_of_three(fresh), self._width)
        self._in_contact |= bool(np.any(_deviation(smooth, self._tare) > _ALERT * CONTACT_FORCE))
        last = self._wrench.latest(4 * _CLEAR // 3).mean(axis=0)
        back = bool(_deviation(last, self._tare) < END_RATIO * CONTACT_FORCE)
        return self._in_contact and (waited > _LONGEST_WAIT or (back and waited > _SHORTEST_WAIT))

    def _search(self, open_too: bool) -> Detection:
        """The touches among the kept samples that are new and complete; with `open_too`, also those in contact."""
        none = Detection(no_touches())
        if not (len(self._joints.samples.stamp) and len(self._wrench.samples.stamp)):
            return none
        judged = self._on_one_clock()
        self._searched = self._wrench.now
        if judged is None or (judged.by_log_time and not open_too and not self._is_sure(judged)):
            self._forget()
            return none
        self._correct(judged)
        joints, wrench = judged.topics
        streams = Streams('online', JointStream(*joints), WrenchStream(*wrench), topics=self._topics)
        signals = as_signals(streams, self._cell)
        if signals is None:
            return none
        self._tare = coarse_tare(signals)[-1]
        self._width = 2 * round(0.5 * SMOOTHING / signals.wrench.period) + 1
        latest = min(int(wrench.stamp[-1]) - _CLEAR, int(joints.stamp[-1]))
        new = self._new(find_touches(streams, self._cell, self._memory), np.iinfo(np.int64).max if open_too else latest)
        self._forget()
        return new

    def _on_one_clock(self) -> Judgement | None:
        """Both topics on one clock; None where there is none, or not yet: one topic stepped, the other will."""
        warnings: list[str] = []
        samples = (self._joints.samples, self._wrench.samples)
        try:
            judged = judge_clocks('online', dict(zip(self._topics, samples, strict=True)), warnings)
        except RecordingError as error:
            self.clock_warning = error.problem
            return None
        if judged.by_log_time or judged.joined:
            self.clock_warning = next(text for text in warnings if 'header.stamp' in text)
        return judged

    def _is_sure(self, judged: Judgement) -> bool:
        """Whether the times of reception may be used for good."""
        received = self._wrench.samples.log_time
        return judged.at_one_rate and int(received[-1] - received[0]) > _SURE

    def _correct(self, judged: Judgement) -> None:
        """Puts the kept samples, and those to come, on the clock that was found valid."""
        if judged.by_log_time:
            if self._reported != _NEVER:
                self._reported = self._wrench.log_time_of(self._reported)
            if self._memory.turns:
                self._memory = self._memory._replace(stamp=self._wrench.log_time_of(self._memory.stamp))
            self._joints.use_log_time()
            self._wrench.use_log_time()
            self._searched = self._wrench.now
        elif judged.joined:
            for buffer, samples in zip((self._joints, self._wrench), judged.joined.values(), strict=True):
                buffer.replace(samples)
            self._searched = self._wrench.now

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
        for buffer in (self._joints, self._wrench):
            buffer.drop_before(buffer.now - self._horizon)


class _Buffer:
    """The latest samples of one topic in the order of arrival.

    They come into lists and go into arrays many at a time: one by one an array takes five times as long.
    """

    def __init__(self) -> None:
        self._times: list[int] = []
        self._pairs: list[float] = []
        self._room = _room(1024)
        self._first = self._last = self._seen = 0
        self._shift = 0
        self._by_log_time = False

    def append(self, stamp: int, log_time: int, value: Sequence[float]) -> None:
        self._times += (log_time if self._by_log_time else stamp, log_time)
        self._pairs.extend(value)
        if len(self._times) > _MOST:
            self._store()

    @property
    def samples(self) -> Samples:
        """All that are kept."""
        if self._times:
            self._store()
        return _part(self._room, self._first, self._last)

    @property
    def now(self) -> int:
        """The latest stamp, ns; a single one that is far off does not count."""
        latest = sorted(self.samples.stamp[-7:].tolist())
        return int(latest[len(latest) // 2]) if latest else 0

    def fresh(self, before: int) -> Floats:
        """The values added since the last call, and so many before them, (k, 2); none where none were added."""
        values = self.samples.values
        begin = max(self._seen - self._first, 0)
        self._seen = self._last
        return values[max(begin - before, 0) if begin < len(values) else begin :]

    def latest(self, span: int) -> Floats:
        """The values of the last so many ns, at least one, (k, 2)."""
        stamps, _, values = self.samples
        recent = stamps[-2048:] > self.now - span
        return values[-2048:][recent] if recent.any() else values[-1:]

    def log_time_of(self, stamp: int) -> int:
        """When the sample was received whose stamp is nearest, ns."""
        samples = self.samples
        return int(samples.log_time[np.argmin(np.abs(samples.stamp - stamp))])

    def use_log_time(self) -> None:
        """Times of reception are the stamps from now on, those of the kept samples as well."""
        self.samples.stamp[:] = self.samples.log_time
        self._by_log_time, self._shift = True, 0

    def replace(self, samples: Samples) -> None:
        """Puts shifted samples in place of those kept; later ones are shifted like the last."""
        self._shift += int(samples.stamp[-1] - self.samples.stamp[-1])
        self._room = samples
        self._first, self._last = 0, len(samples.stamp)
        self._seen = self._last

    def drop_before(self, stamp: int) -> None:
        """Drops the samples that came before the first one with this stamp or a later one."""
        stamps = self.samples.stamp
        if len(stamps) and stamps[0] < stamp:
            later = stamps >= stamp
            self._first += int(later.argmax()) if later.any() else len(later)

    def _store(self) -> None:
        """Moves what came into the arrays, and the oldest samples out of them if they are too many."""
        times = np.array(self._times, dtype=np.int64).reshape(-1, 2)
        new = Samples(times[:, 0] + self._shift, times[:, 1], np.array(self._pairs, dtype=float).reshape(-1, 2))
        self._times, self._pairs = [], []
        count = len(times)
        if self._last + count > len(self._room.stamp):
            self._first = max(self._first, self._last + count - _MOST)
            self._make_room(count)
        for room, values in zip(self._room, new, strict=True):
            room[self._last : self._last + count] = values
        self._last += count

    def _make_room(self, count: int) -> None:
        """Moves the kept samples to the front of arrays of up to twice the length that is needed."""
        kept = _part(self._room, self._first, self._last)
        size = len(kept.stamp)
        self._room = _room(max(1024, 2 * (size + count)))
        for room, values in zip(self._room, kept, strict=True):
            room[:size] = values
        self._seen = max(self._seen - self._first, 0)
        self._first, self._last = 0, size


def _room(size: int) -> Samples:
    return Samples(np.empty(size, np.int64), np.empty(size, np.int64), np.empty((size, 2)))


def _part(samples: Samples, first: int, last: int) -> Samples:
    return Samples(samples.stamp[first:last], samples.log_time[first:last], samples.values[first:last])


def _deviation(force: NDArray[np.float64], tare: NDArray[np.float64]) -> NDArray[np.float64]:
    distance: NDArray[np.float64] = np.linalg.norm(force - tare, axis=-1)
    return distance
