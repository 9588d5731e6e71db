"""A rosbag2 folder with MCAP files that is being written, and can be read at every moment.

The recording is split, as `ros2 bag record --max-bag-size` splits it: every checkpoint completes one file, and so does
every `SPLIT_SIZE`. A thread merges small files meanwhile, `MERGED` at a time, up to `LARGEST_FILE` (`file_merging`), so
that a recording of days has hundreds of files. The folder appears in one step, complete, with the cell description as
its first message in `<name>_0.mcap`. Messages then go into a hidden file, `.<name>_<k>.mcap.part`, which no reader of
rosbag2 opens. `checkpoint` completes that file, waits until it is on the disk, renames it to `<name>_<k>.mcap` and
replaces `metadata.yaml` in one step; when it returns, everything written before is part of the recording, also after a
kill or a power failure. A kill between any two of these steps leaves a folder with a valid `metadata.yaml` and every
file listed there. This package's own reader also recovers what the hidden file holds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType

from rosbags.interfaces import Qos

from scara_kinetostatic.bags.bag_folder import METADATA
from scara_kinetostatic.bags.encoding import Channel, channels, discard_channel, string_message, transform_channel
from scara_kinetostatic.bags.file_merging import SPLIT_SIZE, FileMerging
from scara_kinetostatic.bags.mcap_writer import McapWriter
from scara_kinetostatic.bags.metadata import FileInfo, metadata_text
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
        topics: names of joint states and wrenches; by default those of the cell, in the root namespace.

    Attributes:
        folder: the folder.

    Raises:
        OutputError: the folder exists, or cannot be written; so do all methods. The recording up to the last checkpoint
            stays.
    """

    def __init__(
        self, folder: str | Path, cell: Cell, *, log_time: int | None = None, topics: tuple[str, str] | None = None
    ) -> None:
        self.folder = Path(folder)
        self._channels = list(channels(cell, topics))
        self._lock = threading.RLock()
        self._merging = FileMerging(self.folder, self._lock, self._write_metadata)
        self._completed = 0
        self._open: McapWriter | None = None
        self._state = 'open'
        with all_or_nothing(self.folder) as workshop:
            home = workshop / self.folder.name
            home.mkdir()
            first = McapWriter(home / self._name(0), self._channels)
            first.write(CELL, string_message(dump_cell(cell)), time.time_ns() if log_time is None else log_time)
            info = first.finish(self._name(0))
            replace_text(home / METADATA, metadata_text(self._channels, [info]))
        self._add(info)

    @property
    def recorded(self) -> int:
        """Number of joint states and wrenches up to the last checkpoint."""
        return sum(sum(file.counts[JOINTS : WRENCH + 1]) for file in self._merging.files)

    def offer(self, joint_states: Qos | None, wrench: Qos | None) -> None:
        """States the quality of service that the drivers offer, for the files that follow; None where it is unknown."""
        with self._lock:
            for channel, qos in ((JOINTS, joint_states), (WRENCH, wrench)):
                if qos is not None and qos != self._channels[channel].qos:
                    self._complete_file()
                    self._channels[channel] = self._channels[channel]._replace(qos=qos)

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

    def write_discard(self, text: str, log_time: int) -> None:
        """Add that a touch is discarded, and make it part of the recording.

        Args:
            text: which one, as `encoding.DISCARD_TOPIC` describes.
            log_time: now, ns.
        """
        with self._lock:
            self._write(self._added(discard_channel()), string_message(text), log_time)
            self.checkpoint()

    def write_transforms(self, data: bytes, log_time: int) -> None:
        """Add fixed transforms.

        Args:
            data: a `tf2_msgs/msg/TFMessage` as it came, CDR.
            log_time: when it came, ns.
        """
        with self._lock:
            self._write(self._added(transform_channel()), data, log_time)

    def _added(self, channel: Channel) -> int:
        """The number of a channel that not every recording has; from its first use on every file has it."""
        for number, known in enumerate(self._channels):
            if known.topic == channel.topic:
                return number
        self.checkpoint()
        self._channels.append(channel)
        return len(self._channels) - 1

    def checkpoint(self) -> None:
        """Makes everything written so far part of the recording on the disk; call it before reporting a touch."""
        with self._lock, self._guarded():
            self._complete_file()

    def close(self) -> None:
        """Checkpoint and end of the recording. A second call does nothing."""
        with self._lock:
            try:
                if self._state == 'open':
                    self.checkpoint()
                    self._state = 'closed'
            finally:
                self._merging.cancel()
        self._merging.stop()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, channel: int, data: bytes, log_time: int) -> None:
        with self._lock, self._guarded():
            if self._open is None:
                self._open = McapWriter(self._draft(), self._channels)
            self._open.write(channel, bytes(data), log_time)
            if self._open.size > SPLIT_SIZE:
                self._complete_file()

    def _complete_file(self) -> None:
        if self._open is None:
            return
        draft, name = self._draft(), self._name(self._completed)
        info = self._open.finish(name)
        self._open = None
        draft.rename(self.folder / name)
        sync_folder(self.folder)
        self._write_metadata([*self._merging.files, info])
        self._add(info)

    def _write_metadata(self, files: Sequence[FileInfo]) -> None:
        replace_text(self.folder / METADATA, metadata_text(self._channels, files))

    def _add(self, info: FileInfo) -> None:
        self._completed += 1
        self._merging.add(info, tuple(self._channels))

    def _name(self, number: int) -> str:
        return f'{self.folder.name}_{number}.mcap'

    def _draft(self) -> Path:
        return self.folder / f'.{self._name(self._completed)}.part'

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Raises after the end of the recording, and ends it where the disk fails."""
        if self._state != 'open':
            raise OutputError(self.folder, f'the recording was {self._state}', 'start a new one')
        try:
            with writing(self.folder):
                yield
        except OutputError:
            self._state = 'stopped by an error'
            self._drop_draft()
            self._merging.cancel()
            raise

    def _drop_draft(self) -> None:
        draft, self._open = self._open, None
        if draft is not None:
            draft.discard()
            with suppress(OSError):
                self._draft().unlink(missing_ok=True)
