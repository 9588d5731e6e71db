"""The source for a recording: a reader for its form, which its first bytes show."""

from __future__ import annotations

import stat
import tempfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, cast

import zstandard

from scara_kinetostatic.bags.bag_folder import BagFolder
from scara_kinetostatic.bags.decompression import ZSTD_MAGIC, unpack
from scara_kinetostatic.bags.mcap_file import McapFile
from scara_kinetostatic.bags.mcap_records import MAGIC as MCAP_MAGIC
from scara_kinetostatic.bags.messages import Batches, Source, Topic, reading
from scara_kinetostatic.errors import RecordingError

_SQLITE_MAGIC = b'SQLite format 3\0'
_ROS1_MAGIC = b'#ROSBAG V'
_FORMS = 'a rosbag2 folder, an .mcap or .db3 file, a ROS 1 .bag, or a touch table (.csv)'


def open_recording(path: str | Path) -> Source:
    """The source of a recording.

    Args:
        path: a rosbag2 folder, an `.mcap` or `.db3` file, plain or `.zstd`, or a ROS 1 `.bag`.

    Raises:
        RecordingError: it does not exist, or its form is not known.
    """
    path = Path(path)
    with reading(path):
        if not path.exists():
            raise RecordingError(path, 'there is no such recording', 'check the path')
        if path.is_dir():
            return BagFolder(path, _open_file)
        return _open_file(path)


def _open_file(path: Path) -> Source:
    """The source of a single file.

    Raises:
        RecordingError: it is empty, or its form is not known.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise RecordingError(path, 'neither a file nor a folder', f'give {_FORMS}')
    with path.open('rb') as stream:
        start = stream.read(16)
    if not start:
        raise RecordingError(path, 'the file is empty', 'the recorder was perhaps not stopped properly; record again')
    if start.startswith(ZSTD_MAGIC):
        return _open_compressed(path)
    source = _plain(path, start)
    if source is None:
        remedy = f'give the folder {path.parent}' if path.name == 'metadata.yaml' else f'give {_FORMS}'
        raise RecordingError(path, 'not a recording', remedy)
    return source


def _plain(path: Path, start: bytes) -> Source | None:
    if start.startswith(MCAP_MAGIC):
        return McapFile(path)
    if start.startswith(_SQLITE_MAGIC):
        from scara_kinetostatic.bags.sqlite_file import SqliteFile

        return SqliteFile(path)
    if start.startswith(_ROS1_MAGIC):  # `rosbags` takes its time to import
        from scara_kinetostatic.bags.ros1_file import Ros1File

        return Ros1File(path)
    return None


def _open_compressed(path: Path) -> Source:
    """A file compressed as a whole (rosbag2's compression mode `file`)."""
    with zstandard.open(path, 'rb') as stream:
        start = stream.read(16)
    if start.startswith(MCAP_MAGIC):
        return McapFile(path, cast('IO[bytes]', zstandard.open(path, 'rb')))
    if start.startswith((_SQLITE_MAGIC, _ROS1_MAGIC)):
        return _Decompressed(path)
    raise RecordingError(path, 'contains no recording after decompression', f'give {_FORMS}')


class _Decompressed:
    """A compressed file whose reader must seek: decompressed into a temporary file while it is read; a `Source`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._topics: list[Topic] = []

    def topics(self) -> list[Topic]:
        """Every topic of the file."""
        return self._topics

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics."""
        with tempfile.TemporaryDirectory(prefix='scara_kinetostatic_') as folder:
            plain = Path(folder) / self.path.stem
            with zstandard.open(self.path, 'rb') as packed, plain.open('wb') as unpacked:
                try:
                    unpack(packed, unpacked, self.path.stat().st_size)
                except zstandard.ZstdError as error:
                    self.warnings.append(f'{self.path.name} ends early ({error}): read up to there')
            yield from self._read(plain, wanted)

    def _read(self, plain: Path, wanted: Collection[str]) -> Batches:
        try:
            source = _open_file(plain)
            yield from source.batches(wanted)
        except RecordingError as error:
            raise RecordingError(self.path, error.problem, error.remedy) from error
        self._topics = source.topics()
        self.warnings += source.warnings
