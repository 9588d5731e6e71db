"""A recording in progress: every message is written to the bag, every touch counted once the bag holds it durably."""

from __future__ import annotations

from contextlib import suppress
from enum import Enum
from pathlib import Path
from time import monotonic

import numpy as np

from scara_kinetostatic.bags.writer import BagWriter, fresh_folder
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.nodes.conversion import Sample
from scara_kinetostatic.touches.detection import Detection
from scara_kinetostatic.touches.online import OnlineDetector

QUIET = 1.0
"""Time without a message after which the bag is written durably, s."""
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

    Attributes:
        folder: the bag.
        touches: touches found and durably recorded.
        rejected: the same of touches that were rejected.
        news: last touch or warning, one line; empty before the first.

    Raises:
        OutputError: the folder cannot be made or written to; also in every method.
    """

    def __init__(self, parent: Path, cell: Cell, log_time: int) -> None:
        self.touches = 0
        self.rejected = 0
        self.news = ''
        self._cell = cell
        self._writer = _new_bag(parent, cell, log_time)
        self.folder = self._writer.folder
        self._detector = OnlineDetector(cell)
        self._secured, self._last_message = True, monotonic()

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
        self._secured, self._last_message = False, monotonic()
        if sample is None:
            return
        if stream is Stream.JOINTS:
            self._detector.add_joint_state(sample.stamp_ns, (sample.first, sample.second))
        else:
            self._detector.add_wrench(sample.stamp_ns, (sample.first, sample.second))

    def poll(self) -> list[str]:
        """Looks for touches that have ended since the last call; the bag holds them when this returns.

        Also secures the end of streams that have fallen silent, so that a calibration now and one after `close` agree.

        Returns:
            One line for each.
        """
        lines = self._secure(self._detector.poll())
        if not self._secured and monotonic() - self._last_message > QUIET:
            self._checkpoint()
        return lines

    def close(self) -> list[str]:
        """Completes the bag; a touch still under way counts.

        Returns:
            One line for each touch not yet reported.
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
        return {'touches': str(self.touches), 'rejected': str(self.rejected), 'last touch': self.news or 'none yet'}

    def _secure(self, new: Detection) -> list[str]:
        if not new.found:
            return []
        self._checkpoint()
        self.touches += len(new.touches)
        self.rejected += len(new.rejected)
        lines = self._describe(new)
        self.news = lines[-1]
        return lines

    def _checkpoint(self) -> None:
        self._writer.checkpoint()
        self._secured = True

    def _describe(self, new: Detection) -> list[str]:
        """One line for each touch, in the order of time."""
        touches = new.touches
        lines = {rejection.index: f'touch {rejection.index} rejected: {rejection.reason}' for rejection in new.rejected}
        for index, disc, force in zip(touches.index, touches.disc, touches.force, strict=True):
            lines[int(index)] = f'touch {index}: {self._cell.discs[disc].name}, {np.hypot(*force):.1f} N'
        return [lines[index] for index in sorted(lines)]


def _new_bag(parent: Path, cell: Cell, log_time: int) -> BagWriter:
    """A bag in a folder of its own, even if another collector begins at the same moment."""
    for _ in range(ATTEMPTS - 1):
        folder = fresh_folder(parent, 'touches')
        try:
            return BagWriter(folder, cell, log_time=log_time)
        except OutputError:
            if not folder.exists():
                raise
    return BagWriter(fresh_folder(parent, 'touches'), cell, log_time=log_time)
