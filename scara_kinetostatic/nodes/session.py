"""A recording in progress: every message is written to the bag, every touch counted once the bag holds it durably."""

from __future__ import annotations

import json
from collections import deque
from contextlib import suppress
from enum import Enum
from pathlib import Path
from time import monotonic

from scara_kinetostatic.bags.writer import BagWriter, OfferedQos, fresh_folder
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.touch import common_reason
from scara_kinetostatic.nodes.conversion import Sample
from scara_kinetostatic.nodes.disk_room import MIB, DiskRoom
from scara_kinetostatic.nodes.judged_touch import JudgedTouch, judged_touches
from scara_kinetostatic.touches.detection import DISCARDED, Detection
from scara_kinetostatic.touches.online import OnlineDetector

QUIET = 1.0
"""Time without a message after which the bag is written durably, s;"""
LONGEST_FILE = 600.0
"""and so it is after this time without a touch, s."""
REMEMBERED = 1000
"""So many touches can be discarded, the latest first."""
_MANY = 0.2
"""A larger part of rejected touches is reported."""
ATTEMPTS = 10
"""Attempts to make a folder whose name no other collector takes at the same moment."""


class Stream(Enum):
    """The two topics."""

    JOINTS = 'joints'
    WRENCH = 'wrench'


class Session:
    """Writes a bag and finds the touches in it.

    Args:
        parent: folder in which a new one is made.
        cell: the cell description, which travels in the bag.
        log_time: now, ns, by the clock that gives the messages their log time.
        topics: full names of joint states and wrenches.

    Attributes:
        folder: the bag.
        touches: touches found and durably recorded.
        rejected: the same of touches that were rejected or discarded.
        news: last touch, one line; empty before the first.
        room: free space on the disk.

    Raises:
        OutputError: the folder cannot be made or written to; also in every method.
    """

    def __init__(self, parent: Path, cell: Cell, log_time: int, topics: tuple[str, str] | None = None) -> None:
        self.touches = 0
        self.rejected = 0
        self.news = ''
        self._cell = cell
        self._writer = _new_bag(parent, cell, log_time, topics)
        self.folder = self._writer.folder
        self.room = DiskRoom(self.folder)
        self._detector = OnlineDetector(cell, topics=topics)
        self._accepted: deque[JudgedTouch] = deque(maxlen=REMEMBERED)
        self._reasons: deque[str] = deque(maxlen=REMEMBERED)
        self._secured, self._last_message, self._secured_at = True, monotonic(), monotonic()

    def take(self, stream: Stream, message: bytes, log_time: int, sample: Sample | None) -> None:
        """Takes a message in.

        Args:
            stream: where it came from.
            message: as it came, CDR.
            log_time: when it came, ns.
            sample: its numbers; None if it cannot be used.
        """
        if stream is Stream.JOINTS:
            self._writer.write_joint_state(message, log_time)
        else:
            self._writer.write_wrench(message, log_time)
        self.room.add(len(message))
        self._secured, self._last_message = False, monotonic()
        if sample is None:
            return
        if stream is Stream.JOINTS:
            self._detector.add_joint_state(sample.stamp_ns, (sample.first, sample.second), log_time)
        else:
            self._detector.add_wrench(sample.stamp_ns, (sample.first, sample.second), log_time)

    def take_transforms(self, message: bytes, log_time: int, anew: bool = False) -> list[JudgedTouch]:
        """Takes fixed transforms in.

        Args:
            message: as it came, CDR.
            log_time: when it came, ns.
            anew: whether the forces to come are turned otherwise than those before.

        Returns:
            The touches before, not yet reported.
        """
        self._writer.write_transforms(message, log_time)
        self._secured = False
        if not anew:
            return []
        found = self._secure(self._detector.finish())
        self._detector.restart()
        return found

    def offer(self, joint_states: OfferedQos | None, wrench: OfferedQos | None) -> None:
        """States the quality of service that the drivers offer; None where it is unknown."""
        self._writer.offer(joint_states, wrench)

    def poll(self) -> list[JudgedTouch]:
        """Looks for touches that have ended since the last call; the bag holds them when this returns.

        Also secures the end of streams that have fallen silent, so that a calibration now and one after `close` agree.

        Returns:
            The touches.
        """
        found = self._secure(self._detector.poll())
        now = monotonic()
        if not self._secured and (now - self._last_message > QUIET or now - self._secured_at > LONGEST_FILE):
            self._checkpoint()
        return found

    def discard_last(self, log_time: int) -> JudgedTouch | None:
        """Discards the last accepted touch that is not discarded yet; the bag says so when this returns.

        Args:
            log_time: now, ns.

        Returns:
            The touch with that reason; None where there is none.
        """
        if not self._accepted:
            return None
        touch = self._accepted.pop()
        which = {'touch': touch.number, 'stamp': touch.stamp, 'received': touch.received}
        self._writer.write_discard(json.dumps(which), log_time)
        self.touches -= 1
        self.rejected += 1
        discarded = touch._replace(reason=DISCARDED)
        self.news = discarded.line
        return discarded

    def close(self) -> list[JudgedTouch]:
        """Completes the bag; a touch still under way counts.

        Returns:
            The touches not yet reported.
        """
        try:
            return self._secure(self._detector.finish())
        finally:
            self._writer.close()

    def abandon(self) -> None:
        """Lets go of a bag that cannot be written to any more; what was secured stays."""
        with suppress(OutputError):
            self._writer.close()

    def details(self) -> dict[str, str]:
        """The figures of the recording by name."""
        return {
            'recording': str(self.folder),
            'touches': str(self.touches),
            'rejected': str(self.rejected),
            'last touch': self.news or 'none yet',
            'clock': self.clock_warning or 'header stamps',
            'disk free [MiB]': str(self.room.free() // MIB),
        }

    @property
    def clock_warning(self) -> str:
        """What had to be corrected in the stamps to find touches; empty if nothing."""
        return self._detector.clock_warning

    def rejections(self) -> str:
        """How many touches are rejected and why, where they are many; else empty."""
        judged = self.touches + self.rejected
        if not self._reasons or len(self._reasons) <= _MANY * judged:
            return ''
        reason = common_reason(self._reasons, judged) or f'the last: {self._reasons[-1]}'
        return f'{len(self._reasons)} of {judged} touches rejected, {reason}'

    def _secure(self, new: Detection) -> list[JudgedTouch]:
        if not new.found:
            return []
        self._checkpoint()
        self.touches += len(new.touches)
        self.rejected += len(new.rejected)
        judged = [
            touch._replace(received=self._detector.received(touch.stamp)) for touch in judged_touches(new, self._cell)
        ]
        self._accepted += [touch for touch in judged if not touch.reason]
        self._reasons += [touch.reason for touch in judged if touch.reason]
        self.news = judged[-1].line
        return judged

    def _checkpoint(self) -> None:
        self._writer.checkpoint()
        self._secured, self._secured_at = True, monotonic()


def _new_bag(parent: Path, cell: Cell, log_time: int, topics: tuple[str, str] | None) -> BagWriter:
    """A bag in a folder of its own, even if another collector begins at the same moment."""
    for _ in range(ATTEMPTS - 1):
        folder = fresh_folder(parent, 'touches')
        try:
            return BagWriter(folder, cell, log_time=log_time, topics=topics)
        except OutputError:
            if not folder.exists():
                raise
    return BagWriter(fresh_folder(parent, 'touches'), cell, log_time=log_time, topics=topics)
