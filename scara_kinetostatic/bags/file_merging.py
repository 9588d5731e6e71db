"""Keeps the number of files of a recording small while it goes on.

Each touch that is reported completes a file. Readers open all files of a recording at once, and a process may open 1024
or so; so files of the same level are merged, `MERGED` at a time, to one of the next level, until it has `LARGEST_FILE`
bytes. Each message is copied three times at most. A merge runs in a thread; it only reads complete files and ends with
two steps under the lock of the writer: the merged file `<name>_<first>-<last>.mcap` gets its name, and `metadata.yaml`
lists it in place of the others. A kill before the second step leaves a file that nothing lists, and readers pass over.

The files that were merged are kept for `KEPT`, for readers that have begun, and removed at the end of the recording.
"""

from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import accumulate, groupby
from pathlib import Path
from time import monotonic

from scara_kinetostatic.bags.encoding import Channel
from scara_kinetostatic.bags.mcap_merge import MergeCancelledError, merge_files
from scara_kinetostatic.bags.metadata import FileInfo
from scara_kinetostatic.files.atomic import sync_folder

SPLIT_SIZE = 1 << 26
"""A file is completed at this size, bytes, even if nothing is touched."""
LARGEST_FILE = 1 << 30
"""Files are merged up to this size, bytes."""
MERGED = 16
"""So many files become one."""
KEPT = 600.0
"""Files that were merged are removed after this time, s."""
_ROOM = 3
"""Files are merged only where so many times their size is free on the disk."""
_FULL = 99
"""Level of files that are not merged any more."""
_NAME = re.compile(r'(?P<stem>.+)_(?P<first>[0-9]+)(?:-(?P<last>[0-9]+))?\.mcap\Z')


@dataclass(frozen=True)
class _File:
    """A complete file.

    Attributes:
        info: what it holds.
        channels: number of the set of channels that it has; only files with the same one can be merged.
        level: how often it was merged.
        size: bytes.
    """

    info: FileInfo
    channels: int
    level: int
    size: int


class FileMerging:
    """The complete files of a recording.

    Args:
        folder: the recording.
        lock: held by the writer while it changes the folder.
        write_metadata: writes `metadata.yaml` with these files.
    """

    def __init__(
        self, folder: Path, lock: threading.RLock, write_metadata: Callable[[Sequence[FileInfo]], None]
    ) -> None:
        self._folder = folder
        self._lock = lock
        self._write_metadata = write_metadata
        self._files: list[_File] = []
        self._channels: list[tuple[Channel, ...]] = []
        self._merged: list[tuple[float, Path]] = []
        self._thread: threading.Thread | None = None
        self._cancelled = threading.Event()

    @property
    def files(self) -> list[FileInfo]:
        """The files that make up the recording, in the order of time."""
        return [file.info for file in self._files]

    def add(self, info: FileInfo, channels: tuple[Channel, ...]) -> None:
        """Adds a file that was completed, and begins to merge where there are enough; the lock is held."""
        size = (self._folder / info.name).stat().st_size
        if not self._channels or self._channels[-1] != channels:
            self._channels.append(channels)
        self._files.append(_File(info, len(self._channels), 0, size))
        self._remove(before=monotonic() - KEPT)
        if self._thread is None and not self._cancelled.is_set() and (group := self._group()):
            self._thread = threading.Thread(target=self._merge, args=(group,), daemon=True)
            self._thread.start()

    def cancel(self) -> None:
        """Merges nothing any more."""
        self._cancelled.set()

    def stop(self) -> None:
        """Ends a merge that is running, and removes the files that were merged; the lock is not held."""
        self.cancel()
        if self._thread is not None:
            self._thread.join()
        self._remove(before=float('inf'))

    def wait(self) -> None:
        """Waits for a merge that is running; the lock is not held."""
        if (thread := self._thread) is not None:
            thread.join()

    def _group(self) -> list[_File]:
        """The next files to merge: `MERGED` neighbours of one level and the same channels, as far as they fit."""
        group: list[_File] = []
        for (level, _), run in groupby(self._files, key=lambda file: (file.level, file.channels)):
            files = list(run)
            if level < _FULL and len(files) >= MERGED:
                group = files[:MERGED]
        fitting = sum(total <= LARGEST_FILE for total in accumulate(file.size for file in group))
        return group[: max(fitting, 2)]

    def _merge(self, group: Sequence[_File]) -> None:
        """Merges files of the recording; where that fails they stay as they are."""
        paths = [self._folder / file.info.name for file in group]
        names = [_NAME.match(path.name) for path in (paths[0], paths[-1])]
        assert names[0] is not None
        assert names[1] is not None
        last = names[1]['last'] or names[1]['first']
        target = self._folder / f'{names[0]["stem"]}_{names[0]["first"]}-{last}.mcap'
        draft = self._folder / f'.{target.name}.merging'
        merged: list[_File] = []
        with suppress(OSError, ValueError, MergeCancelledError):
            if shutil.disk_usage(self._folder).free > _ROOM * sum(file.size for file in group):
                draft.unlink(missing_ok=True)
                merge_files(paths, draft, self._cancelled.is_set)
                merged = [self._as_one(group, target.name, draft.stat().st_size)]
        with self._lock:
            self._thread = None
            try:
                self._put(group, merged, draft, target)
            except OSError:
                self.cancel()

    def _put(self, group: Sequence[_File], merged: Sequence[_File], draft: Path, target: Path) -> None:
        """Puts the merged file in place of the others; where there is none, these are not merged again."""
        at = self._files.index(group[0])
        before, after = self._files[:at], self._files[at + len(group) :]
        if not merged:
            given_up = [replace(file, level=_FULL) for file in group]
            self._files = [*before, *given_up, *after]
            return
        draft.rename(target)
        sync_folder(self._folder)
        self._write_metadata([file.info for file in (*before, *merged, *after)])
        self._files = [*before, *merged, *after]
        self._merged += [(monotonic(), self._folder / file.info.name) for file in group]

    def _as_one(self, group: Sequence[_File], name: str, size: int) -> _File:
        infos = [file.info for file in group]
        filled = [info for info in infos if sum(info.counts)] or infos
        info = FileInfo(
            name,
            min(info.start for info in filled),
            max(info.end for info in filled),
            tuple(map(sum, zip(*(info.counts for info in infos), strict=True))),
        )
        level = _FULL if 2 * size > LARGEST_FILE else group[0].level + 1
        return _File(info, group[0].channels, level, size)

    def _remove(self, before: float) -> None:
        """Removes the files that were merged before some time."""
        old = [path for time, path in self._merged if time < before]
        self._merged = [(time, path) for time, path in self._merged if time >= before]
        for path in old:
            with suppress(OSError):
                path.unlink()
