"""Online detection: the touches in two streams that are still running.

The latest `_HORIZON` of samples is kept, whether anything is touched or not, and never more than `_MOST` of a topic. A
poll compares only the new forces, smoothed, with the zero of the sensor; once the force has deviated from it and
returned, `find_touches` runs on all kept samples, and each contact that has ended is reported once. What the joints
remember of the load is kept without a limit of time.

Which clock is valid for both topics is judged as for a recording (`clock.judge_clocks`), by the samples kept: the
header stamps, shifted where the clocks differ, else the times at which the messages were received. Once these had to
be used, they are used on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.buffer import StreamPair
from scara_kinetostatic.touches.clock import Judgement
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
        self._pair = StreamPair(self._topics, _MOST)
        self._tare: NDArray[np.float64] | None = None
        self._width = 1
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
        """Whether a contact has ended, or `_LONGEST_WAIT` is over."""
        fresh = self._pair.wrench.fresh(self._width)
        if not len(fresh):
            return False
        if self._searched == _NEVER:
            first = self._pair.wrench.samples
            self._searched, self._searched_stamp = int(first.log_time[0]), int(first.stamp[0])
        wrench = self._pair.wrench
        waited = max(abs(wrench.received - self._searched), abs(wrench.now - self._searched_stamp))
        if self._tare is None:
            return waited > _SHORTEST_WAIT
        smooth = moving_mean(median_of_three(fresh), self._width)
        self._in_contact |= bool(np.any(_deviation(smooth, self._tare) > _ALERT * CONTACT_FORCE))
        last = self._pair.wrench.latest(4 * _CLEAR // 3).mean(axis=0)
        back = bool(_deviation(last, self._tare) < END_RATIO * CONTACT_FORCE)
        return self._in_contact and (waited > _LONGEST_WAIT or (back and waited > _SHORTEST_WAIT))

    def _search(self, open_too: bool) -> Detection:
        """The touches among the kept samples that are new and complete; with `open_too`, also those in contact."""
        none = Detection(no_touches())
        if not (len(self._pair.joints.samples.stamp) and len(self._pair.wrench.samples.stamp)):
            return none
        judged = self._pair.judged()
        if judged is None or not (open_too or self._pair.is_sure(judged)):
            self.clock_warning = self._pair.problem if judged is None else self.clock_warning
            self._note_search()
            self._forget()
            return none
        self._correct(judged)
        self._note_search()
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

    def _correct(self, judged: Judgement) -> None:
        """Puts the kept samples, and those to come, on the clock that was found valid."""
        wrench = self._pair.wrench
        if self._reported != _NEVER:
            self._reported = self._pair.moved(self._reported, wrench, judged)
        if self._memory.turns:
            self._memory = self._memory._replace(stamp=self._pair.moved(self._memory.stamp, wrench, judged))
        self._pair.correct(judged)
        if self._pair.problem or any(judged.shifts):
            self.clock_warning = self._pair.problem

    def _note_search(self) -> None:
        """From here on it is counted how long the next search has waited."""
        self._searched, self._searched_stamp = self._pair.wrench.received, self._pair.wrench.now

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
