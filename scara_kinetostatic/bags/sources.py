"""The source for a recording: a reader for its form, which its first bytes show; a folder is read file by file.

A rosbag2 folder has a `metadata.yaml` and the files it lists. One whose metadata is missing or damaged is read as well,
its files in the order of their names, with a warning. That a file ends amid its data is no warning where all messages
are there that the metadata state.
"""

from __future__ import annotations

import re
import stat
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path, PurePosixPath

import zstandard

from scara_kinetostatic.bags.mcap_file import MAGIC, McapFile
from scara_kinetostatic.bags.messages import ZSTD_MAGIC, Batch, Batches, Budget, BudgetError, Source, reading, ros_topic
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.yaml_file import parse_strings

METADATA = 'metadata.yaml'
_FORMS = 'a rosbag2 folder, an .mcap or .db3 file, a ROS 1 .bag, or a touch table (.csv)'


def open_recording(path: str | Path, budget: Budget | None = None) -> Source:
    """The source of a recording.

    Args:
        path: a rosbag2 folder, an `.mcap` or `.db3` file, plain or `.zstd`, or a ROS 1 `.bag`.
        budget: of the recording; None: one in proportion to its size.

    Raises:
        RecordingError: it does not exist, or its form is not known.
    """
    path = Path(path)
    with reading(path):
        if not path.exists():
            raise RecordingError(path, 'there is no such recording', 'check the path')
        budget = budget or Budget(path)
        return BagFolder(path, budget) if path.is_dir() else _open_file(path, budget)


def _open_file(path: Path, budget: Budget) -> Source:
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
        return _Decompressed(path, budget)
    if start.startswith(MAGIC):
        return McapFile(path, budget)
    if start.startswith(b'SQLite format 3\0'):
        from scara_kinetostatic.bags.sqlite_file import SqliteFile

        return SqliteFile(path, budget)
    if start.startswith(b'#ROSBAG V'):
        from scara_kinetostatic.bags.ros1_file import Ros1File

        return Ros1File(path, budget)
    remedy = f'give the folder {path.parent}' if path.name == METADATA else f'give {_FORMS}'
    raise RecordingError(path, 'not a recording', remedy)


class _Decompressed(Source):
    """A file compressed as a whole: decompressed into a temporary file while it is read."""

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics."""
        with tempfile.TemporaryDirectory(prefix='scara_kinetostatic_') as folder:
            plain = Path(folder) / self.path.stem
            with zstandard.open(self.path, 'rb') as packed, plain.open('wb') as unpacked:
                try:
                    while part := packed.read(1 << 20):
                        self._budget.charge(len(part))  # nothing beyond the limit is written
                        unpacked.write(part)
                except zstandard.ZstdError as error:
                    self.warnings.append(f'{self.path.name} ends early ({error}): read up to there')
            try:
                source = _open_file(plain, self._budget)
                yield from source.batches(wanted)
            except RecordingError as error:
                raise type(error)(self.path, f'decompressed: {error.problem}', error.remedy) from error
            self._topics |= {topic: topic for topic in source.topics()}
            self.warnings += source.warnings


class BagFolder(Source):
    """Reads the files of a rosbag2 folder in turn.

    Raises:
        RecordingError: the folder holds no recording.
    """

    def __init__(self, path: Path, budget: Budget) -> None:
        super().__init__(path, budget)
        self._counts: dict[str, int] = {}
        self._read_counts: Counter[str] = Counter()
        self._cut_off: list[str] = []
        self._files = self._listed_files()
        if not self._files:
            stored = r'[^.].*\.(mcap|db3)(\.zstd)?\Z'
            self._files = sorted(
                (file for file in path.iterdir() if file.is_file() and re.match(stored, file.name)), key=_natural
            )
        if not self._files:
            inside = [one for one in sorted(path.iterdir()) if (one / METADATA).exists() or one.suffix == '.bag']
            remedy = f'did you mean {inside[0]}?' if inside else f'expected {METADATA} and .mcap or .db3 files'
            raise RecordingError(path, 'no recording in this folder', remedy)

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of all files in turn."""
        for path in self._files:
            yield from self._read(path, wanted)
        lost = {topic: self._counts[topic] - self._read_counts[topic] for topic in wanted if topic in self._counts}
        if self._counts and all(number <= 0 for number in lost.values()):  # still written, or its writer was killed
            self.warnings = [text for text in self.warnings if text not in self._cut_off]
        for topic, number in lost.items():  # a database has no checksums
            if number > 0 and not self.warnings:
                self.warnings.append(f'{topic}: {METADATA} states {number} more messages than the files contain')

    def _read(self, path: Path, wanted: Collection[str]) -> Iterator[Batch]:
        try:
            with reading(path):
                source = _open_file(path, self._budget)
                for batch in source.batches(wanted):
                    self._read_counts[batch.topic.name] += len(batch.start)
                    yield batch
        except RecordingError as error:
            if len(self._files) == 1 or isinstance(error, BudgetError):
                raise
            self.warnings.append(f'{path.name} was skipped: {error.problem}')
            return
        self._topics |= {topic: topic for topic in source.topics()}
        self.warnings += source.warnings
        self._cut_off.append(source.cut_off)

    def _listed_files(self) -> list[Path]:
        """The files that the metadata lists and that are there; where there are none, all are to be read in order."""
        metadata = self.path / METADATA
        try:
            if metadata.stat().st_size > 1 << 24:  # a recording of 10 000 files has 2 MB
                raise ValueError('too large')
            data = parse_strings(metadata.read_text('utf-8'))['rosbag2_bagfile_information']
            names = dict.fromkeys(PurePosixPath(name).name for name in data['relative_file_paths'])  # old: with folder
            topics = data['topics_with_message_count']
            counts = {ros_topic(item['topic_metadata']['name']): int(item['message_count']) for item in topics}
        except (AttributeError, LookupError, OSError, RecursionError, TypeError, ValueError) as error:
            reason = getattr(error, 'strerror', '') or ' '.join(str(error).split())[:80] or type(error).__name__
            self.warnings.append(f'{METADATA} cannot be read ({reason}): all files of the folder were read, in order')
            return []
        self._counts = counts
        if missing := [name for name in names if not (self.path / name).exists()]:
            listed = f'{METADATA} lists {", ".join(missing[:3])}, which is missing'
            self.warnings.append(f'{listed}: the files that are there were read')
        return [self.path / name for name in names if name not in missing]


def _natural(path: Path) -> list[tuple[int, str]]:
    """Orders names by their numbers, `…_2` before `…_10`."""
    return [(int(part), '') if part.isdigit() else (0, part) for part in re.split(r'([0-9]+)', path.name)]
