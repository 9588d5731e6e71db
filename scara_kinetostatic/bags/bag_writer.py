"""A rosbag2 MCAP folder that is being written, and opens at every moment.

How a kill cannot hurt it. The folder appears in one step, complete, with the
cell description as its first message. From then on messages go into a hidden
file, `.<name>_piece_<k>.mcap.part`, which no reader of bags looks at.
`checkpoint` completes that file, sees it to the disk, gives it its name,
`<name>_piece_<k>.mcap`, and then replaces `metadata.yaml` in one step; after it returns,
what was written before is part of the recording, whatever happens next.
Killed between any two of these steps, the folder holds a valid
`metadata.yaml` and every file it lists. (Our own reader takes in what the
hidden file holds as well.)

`close` joins the pieces into `<name>_0.mcap`, the form that `ros2 bag record`
leaves, in the same manner: the new file complete, then the metadata, then
the pieces deleted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType

from scara_kinetostatic.bags.bag_folder import METADATA
from scara_kinetostatic.bags.encoding import channels, string_message
from scara_kinetostatic.bags.mcap_join import join
from scara_kinetostatic.bags.mcap_writer import McapPiece
from scara_kinetostatic.bags.metadata import Piece, metadata_text
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.files.atomic import all_or_nothing, replace_text, sync_folder, writing
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import Cell

CELL, JOINTS, WRENCH = range(3)


class BagWriter:
    """Records one run of a cell; may be used from several threads.

    Args:
        folder: the new folder; `fresh_folder` finds a name.
        cell: the cell, whose description becomes the first message.
        log_time: time of that message, ns; now by default.

    Attributes:
        folder: the folder.

    Raises:
        OutputError: the folder exists, or cannot be written; also in every method. What the last
            checkpoint had secured stays.
    """

    def __init__(self, folder: str | Path, cell: Cell, *, log_time: int | None = None) -> None:
        self.folder = Path(folder)
        self._channels = channels(cell)
        self._lock = threading.RLock()
        self._pieces: list[Piece] = []
        self._open: McapPiece | None = None
        self._state = 'open'
        with all_or_nothing(self.folder) as workshop:
            home = workshop / self.folder.name
            home.mkdir()
            piece = McapPiece(home / self._name(0), self._channels)
            now = time.time_ns() if log_time is None else log_time
            piece.write(CELL, string_message(dump_cell(cell)), now)
            self._pieces.append(piece.finish(self._name(0)))
            replace_text(home / METADATA, metadata_text(self._channels, self._pieces))

    @property
    def recorded(self) -> int:
        """Messages of the robot, joint states and wrenches, that checkpoints have secured."""
        return sum(sum(piece.counts[JOINTS:]) for piece in self._pieces)

    def write_joint_state(self, data: bytes, log_time: int) -> None:
        """Add a `JointState`.

        Args:
            data: the message as it came, CDR.
            log_time: when it came, ns.
        """
        self._write(JOINTS, data, log_time)

    def write_wrench(self, data: bytes, log_time: int) -> None:
        """Add a `WrenchStamped`.

        Args:
            data: the message as it came, CDR.
            log_time: when it came, ns.
        """
        self._write(WRENCH, data, log_time)

    def checkpoint(self) -> None:
        """Secure everything written so far; what is reported as recorded must have passed through here."""
        with self._lock, self._guarded():
            self._checkpoint()

    def close(self) -> None:
        """Secure everything and join the pieces into one file. A second call does nothing."""
        with self._lock:
            if self._state != 'open':
                return
            with self._guarded():
                self._checkpoint()
            self._state = 'closed'
            with suppress(OSError):  # the recording is complete; one file instead of many is a nicety
                self._join()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, channel: int, data: bytes, log_time: int) -> None:
        with self._lock, self._guarded():
            if self._open is None:
                self._open = McapPiece(self._draft(), self._channels)
            self._open.write(channel, bytes(data), log_time)

    def _checkpoint(self) -> None:
        if self._open is None:
            return
        draft, name = self._draft(), self._name(len(self._pieces))
        piece = self._open.finish(name)
        self._open = None
        draft.rename(self.folder / name)
        sync_folder(self.folder)
        replace_text(self.folder / METADATA, metadata_text(self._channels, [*self._pieces, piece]))
        self._pieces.append(piece)

    def _join(self) -> None:
        name = f'{self.folder.name}_0.mcap'
        draft = self.folder / f'.{name}.part'
        parts = [self.folder / piece.name for piece in self._pieces]
        counts = tuple(sum(count) for count in zip(*(piece.counts for piece in self._pieces), strict=True))
        start = min(piece.start for piece in self._pieces)
        whole = Piece(name, start, max(piece.end for piece in self._pieces), counts)
        try:
            join(parts, draft)
            draft.rename(self.folder / name)
            replace_text(self.folder / METADATA, metadata_text(self._channels, [whole]))
        except OSError:
            draft.unlink(missing_ok=True)
            raise
        for part in parts:
            part.unlink()

    def _name(self, number: int) -> str:
        return f'{self.folder.name}_piece_{number}.mcap'

    def _draft(self) -> Path:
        return self.folder / f'.{self._name(len(self._pieces))}.part'

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Refuse work after the end, and make it the end where the disk fails."""
        if self._state != 'open':
            raise OutputError(self.folder, f'the recording is {self._state}', 'start a new one')
        try:
            with writing(self.folder):
                yield
        except OutputError:
            self._state = 'broken off'
            self._drop_draft()
            raise

    def _drop_draft(self) -> None:
        draft, self._open = self._open, None
        if draft is not None:
            draft.discard()
            with suppress(OSError):
                self._draft().unlink(missing_ok=True)
