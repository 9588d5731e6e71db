"""Touches found while the samples come in: the same code on what was kept of the streams.

A poll looks at the new forces only. Once the force has left the sensor's zero and come
back, `find_touches` runs on the kept samples and the contacts that ended are reported,
each once. What is kept is bounded in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.touches.detection import Detection, find_touches, no_touches
from scara_kinetostatic.touches.segmentation import OFF_PART, ON, coarse_tare
from scara_kinetostatic.touches.signals import as_signals
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

SECOND = 1_000_000_000
HORIZON = 30 * SECOND
"""Samples older than this are forgotten: the longest contact that can be found, ns."""
CLEAR = SECOND // 7
"""A contact is over once the force has been back at its zero for this long, ns."""
PATIENCE = 5 * SECOND
"""Where the force does not come back, one looks this often, ns."""
SHORTEST_WAIT = SECOND // 2
"""One never looks more often than this, ns."""
CLOCK_JUMP = SECOND
"""Stamps that run back by more than this start a new stream, ns."""
CLOCK_LEAP = 86_400 * SECOND
"""So do stamps that run ahead by more than this, ns."""


class OnlineDetector:
    """Finds touches in two streams that are still running.

    Not for several threads at once: add and poll from one, or under a lock.

    Args:
        cell: nominal parameters, discs, frame and sign of the sensor.
        horizon: how much of the streams is kept, ns.
    """

    def __init__(self, cell: Cell, horizon: int = HORIZON) -> None:
        self._cell = cell
        self._horizon = horizon
        self._found = 0
        self._forget()

    @property
    def found(self) -> int:
        """Touches reported so far, accepted or rejected."""
        return self._found

    def add_joint_state(self, stamp_ns: int, joints: Sequence[float]) -> None:
        """One sample of q1, q2, rad, with its header stamp, ns."""
        self._mind_the_clock(stamp_ns, self._joints.newest)
        self._joints.append(stamp_ns, joints)

    def add_wrench(self, stamp_ns: int, force: Sequence[float]) -> None:
        """One sample of fx, fy as the sensor reports them, N, with its header stamp, ns."""
        self._mind_the_clock(stamp_ns, self._wrench.newest)
        self._wrench.append(stamp_ns, force)

    def _mind_the_clock(self, stamp: int, newest: int) -> None:
        if newest and not -CLOCK_JUMP <= stamp - newest <= CLOCK_LEAP:
            self._forget()

    def poll(self) -> Detection:
        """The touches completed since the last poll: `index` runs on, `found` counts the new ones."""
        return self._look(open_too=False) if self._worth_a_look() else Detection(no_touches())

    def finish(self) -> Detection:
        """The touches not yet reported, at the end of the streams; one still in contact counts as well."""
        return self._look(open_too=True)

    def _forget(self) -> None:
        self._joints, self._wrench = _Samples(), _Samples()
        self._tare: NDArray[np.float64] | None = None
        self._reported = self._looked = self._polled = 0
        self._touched = False

    def _worth_a_look(self) -> bool:
        """Whether a contact has ended, or one has not looked for long."""
        wrench = self._wrench
        fresh = wrench.values[wrench.stamps > self._polled]
        if not len(fresh):
            return False
        self._polled, self._looked = wrench.newest, self._looked or int(wrench.stamps[0])
        waited = wrench.newest - self._looked
        if self._tare is None:
            return waited > SHORTEST_WAIT
        self._touched |= bool(np.any(_deviation(fresh, self._tare) > ON))
        last = wrench.values[wrench.stamps > wrench.newest - 4 * CLEAR // 3].mean(axis=0)
        back = bool(_deviation(last, self._tare) < OFF_PART * ON)
        return self._touched and (waited > PATIENCE or (back and waited > SHORTEST_WAIT))

    def _look(self, open_too: bool) -> Detection:
        """Run the detection on the kept samples and take out what is new and complete."""
        streams = Streams(
            'live',
            JointStream(self._joints.stamps, self._joints.values),
            WrenchStream(self._wrench.stamps, self._wrench.values),
        )
        self._looked = self._wrench.newest
        signals = as_signals(streams, self._cell)
        if signals is None:
            return Detection(no_touches())
        self._tare = coarse_tare(signals)[-1]
        latest = min(self._wrench.newest - CLEAR, self._joints.newest)
        new = self._new(find_touches(streams, self._cell), np.iinfo(np.int64).max if open_too else latest)
        self._joints.drop_before(self._wrench.newest - self._horizon)
        self._wrench.drop_before(self._wrench.newest - self._horizon)
        return new

    def _new(self, detection: Detection, latest: int) -> Detection:
        """The part of a detection that has not been reported and was over at `latest`, ns."""
        ends = [detection.start + round(1e9 * episode.contact[1]) for episode in detection.episodes]
        begins = [detection.start + round(1e9 * episode.contact[0]) for episode in detection.episodes]
        self._touched = any(end > latest for end in ends)
        new = [n for n, begin in enumerate(begins) if begin > self._reported and ends[n] <= latest]
        self._reported = max([self._reported, *(ends[number] for number in new)])
        number_of = {old: self._found + place for place, old in enumerate(new)}
        self._found += len(new)
        return _part(detection, number_of)


class _Samples:
    """Stamps and pairs of values in the order they came, in arrays that grow."""

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
        """Move the kept samples to the front of an array with room for as many again."""
        stamps, values = self.stamps, self.values
        size = max(1024, 2 * len(stamps))
        self._stamps, self._values = np.empty(size, dtype=np.int64), np.empty((size, 2))
        self._stamps[: len(stamps)], self._values[: len(stamps)] = stamps, values
        self._first, self._last = 0, len(stamps)


def _deviation(force: NDArray[np.float64], tare: NDArray[np.float64]) -> NDArray[np.float64]:
    distance: NDArray[np.float64] = np.linalg.norm(force - tare, axis=-1)
    return distance


def _part(detection: Detection, number_of: dict[int, int]) -> Detection:
    """The touches of a detection that are keys of `number_of`, renumbered with its values."""
    kept = detection.touches.select(np.isin(detection.touches.index, list(number_of)))
    return replace(
        detection,
        touches=kept.replace(index=np.array([number_of[old] for old in kept.index.tolist()], dtype=np.intp)),
        rejected=tuple(Rejection(number_of[r.index], r.reason) for r in detection.rejected if r.index in number_of),
        found=len(number_of),
        episodes=tuple(replace(e, index=number_of[e.index]) for e in detection.episodes if e.index in number_of),
    )
