"""Online detection: the touches in two streams that are still running.

The latest `_HORIZON` of samples is kept. A poll compares only the new forces with the zero of the sensor; once the
force has deviated from it and returned, `find_touches` runs on all kept samples, and each contact that has ended is
reported once. What the joints remember of the load is kept without a limit of time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.detection import Detection, find_touches, no_touches
from scara_kinetostatic.touches.load_history import LoadMemory
from scara_kinetostatic.touches.segmentation import CONTACT_FORCE, END_RATIO
from scara_kinetostatic.touches.signals import as_signals
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream
from scara_kinetostatic.touches.tare import coarse_tare

SECOND = 1_000_000_000
_HORIZON = 30 * SECOND
"""Older samples are dropped, ns: the longest contact that can be found."""
_CLEAR = SECOND // 7
"""A contact is over when the force has been back at its zero for so long, ns."""
_LONGEST_WAIT = 5 * SECOND
"""During a contact the detection runs once in so long, ns,"""
_SHORTEST_WAIT = SECOND // 2
"""and never more often than once in so long, ns."""
_LARGEST_STEP_BACK = SECOND
"""Stamps that step back by more than this start new streams, ns."""
_LARGEST_STEP_AHEAD = 86_400 * SECOND
"""So do stamps that step ahead by more than this, ns."""


class OnlineDetector:
    """Finds touches in two streams that are still running.

    Not thread-safe: add and poll from one thread, or under a lock.

    Args:
        cell: nominal parameters, discs, frame and sign of the sensor.
        horizon: length of the streams that is kept, ns.
    """

    def __init__(self, cell: Cell, horizon: int = _HORIZON) -> None:
        self._cell = cell
        self._horizon = horizon
        self._found = 0
        self._reset()

    @property
    def found(self) -> int:
        """Touches reported so far, accepted or rejected."""
        return self._found

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float]) -> None:
        """One sample of q1, q2, rad, with its header stamp, ns."""
        self._check_clock(stamp_ns, self._joints.newest)
        self._joints.append(stamp_ns, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float]) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its header stamp, ns."""
        self._check_clock(stamp_ns, self._wrench.newest)
        self._wrench.append(stamp_ns, force)

    def _check_clock(self, stamp: int, newest: int) -> None:
        if newest and not -_LARGEST_STEP_BACK <= stamp - newest <= _LARGEST_STEP_AHEAD:
            self._reset()

    def poll(self) -> Detection:
        """The touches completed since the last poll, numbered from the first of all; `found` counts the new ones."""
        return self._search(open_too=False) if self._is_due() else Detection(no_touches())

    def finish(self) -> Detection:
        """The touches not yet reported, at the end of the streams; one still in contact counts as well."""
        return self._search(open_too=True)

    def _reset(self) -> None:
        self._joints, self._wrench = _Samples(), _Samples()
        self._tare: NDArray[np.float64] | None = None
        self._reported = self._searched = self._polled = 0
        self._in_contact = False
        self._memory = LoadMemory()

    def _is_due(self) -> bool:
        """Whether a contact has ended, or `_LONGEST_WAIT` is over."""
        wrench = self._wrench
        fresh = wrench.values[wrench.stamps > self._polled]
        if not len(fresh):
            return False
        self._polled, self._searched = wrench.newest, self._searched or int(wrench.stamps[0])
        waited = wrench.newest - self._searched
        if self._tare is None:
            return waited > _SHORTEST_WAIT
        self._in_contact |= bool(np.any(_deviation(fresh, self._tare) > CONTACT_FORCE))
        last = wrench.values[wrench.stamps > wrench.newest - 4 * _CLEAR // 3].mean(axis=0)
        back = bool(_deviation(last, self._tare) < END_RATIO * CONTACT_FORCE)
        return self._in_contact and (waited > _LONGEST_WAIT or (back and waited > _SHORTEST_WAIT))

    def _search(self, open_too: bool) -> Detection:
        """The touches among the kept samples that are new and complete; with `open_too`, also those in contact."""
        streams = Streams(
            'online',
            JointStream(self._joints.stamps, self._joints.values),
            WrenchStream(self._wrench.stamps, self._wrench.values),
        )
        self._searched = self._wrench.newest
        signals = as_signals(streams, self._cell)
        if signals is None:
            return Detection(no_touches())
        self._tare = coarse_tare(signals)[-1]
        latest = min(self._wrench.newest - _CLEAR, self._joints.newest)
        new = self._new(find_touches(streams, self._cell, self._memory), np.iinfo(np.int64).max if open_too else latest)
        self._joints.drop_before(self._wrench.newest - self._horizon)
        self._wrench.drop_before(self._wrench.newest - self._horizon)
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


class _Samples:
    """Stamps and pairs of values in the order of arrival, in arrays that grow."""

    def __init__(self) -> None:
        self._stamps = np.empty(1024, dtype=np.int64)
        self._values = np.empty((1024, 2))
        self._first = self._last = 0
        self.newest = 0

    @property
    def stamps(self) -> NDArray[np.int64]:
        return self._stamps[self._first : self._last]

    @property
    def values(self) -> NDArray[np.float64]:
        return self._values[self._first : self._last]

    def append(self, stamp: int, value: Sequence[float]) -> None:
        if self._last == len(self._stamps):
            self._make_room()
        self._stamps[self._last] = stamp
        self._values[self._last] = value
        self._last += 1
        self.newest = max(self.newest, stamp)

    def drop_before(self, stamp: int) -> None:
        self._first += int(np.searchsorted(self.stamps, stamp))

    def _make_room(self) -> None:
        """Moves the kept samples to the front of arrays of twice their length."""
        stamps, values = self.stamps, self.values
        size = max(1024, 2 * len(stamps))
        self._stamps, self._values = np.empty(size, dtype=np.int64), np.empty((size, 2))
        self._stamps[: len(stamps)], self._values[: len(stamps)] = stamps, values
        self._first, self._last = 0, len(stamps)


def _deviation(force: NDArray[np.float64], tare: NDArray[np.float64]) -> NDArray[np.float64]:
    distance: NDArray[np.float64] = np.linalg.norm(force - tare, axis=-1)
    return distance
