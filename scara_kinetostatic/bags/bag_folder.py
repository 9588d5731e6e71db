"""A rosbag2 folder: `metadata.yaml` and the files it lists.

A folder whose metadata is missing or damaged is read as well, its files in the order of their names, with a warning.
So are the files that follow the last listed one by their number, which a killed recorder leaves (see `bag_writer`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath

from scara_kinetostatic.bags.messages import Batch, Batches, Source, Topic, reading, ros_topic
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.yaml_text import parse_strings

METADATA = 'metadata.yaml'
_MAX_METADATA = 1 << 24
"""Largest metadata file that is read, bytes; a recording of 10 000 files has about 2 MB."""
_STORED = re.compile(r'.+\.(mcap|db3)(\.zstd)?\Z')
_NUMBERED = re.compile(r'\.?(?P<stem>.+)_((?P<first>[0-9]+)-)?(?P<number>[0-9]+)\.mcap(\.part)?\Z')
"""A file of a split recording, `<stem>_<number>.mcap`, hidden and with `.part` while it is being written, or
`<stem>_<first>-<number>.mcap`, merged of several."""


class BagFolder:
    """Reads the files of a folder in turn; a `Source`.

    Args:
        path: the folder.
        open_file: gives the source of one file.

    Attributes:
        vanished: whether a file was not there any more when it was to be read.

    Raises:
        RecordingError: the folder holds no recording.
    """

    def __init__(self, path: Path, open_file: Callable[[Path], Source]) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.vanished = False
        self._open_file = open_file
        self._topics: list[Topic] = []
        self._counts: dict[str, int] = {}
        self._read_counts: Counter[str] = Counter()
        listed = self._listed_files()
        self._files = self._all_files() if listed is None else listed
        self._left_over = [] if listed is None else self._left_over_files()
        if not self._files and listed is None:
            raise self._no_recording()

    def topics(self) -> list[Topic]:
        """Every topic of the folder."""
        return list(dict.fromkeys(self._topics))

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of all files in turn, then what left-over files add."""
        for path in self._files:
            yield from self._read(path, wanted)
        self._compare_counts(wanted)
        for path in self._left_over:
            yield from self._read_left_over(path, wanted)

    def _read(self, path: Path, wanted: Collection[str]) -> Iterator[Batch]:
        try:
            with reading(path):
                source = self._open_file(path)
                for batch in source.batches(wanted):
                    self._read_counts[batch.topic.name] += len(batch.start)
                    yield batch
        except RecordingError as error:
            self.vanished |= not path.exists()
            if len(self._files) == 1:
                raise
            self.warnings.append(f'{path.name} was skipped: {error.problem}')
            return
        self._topics += source.topics()
        self.warnings += source.warnings

    def _read_left_over(self, path: Path, wanted: Collection[str]) -> Iterator[Batch]:
        """The messages of a file that the metadata does not list; that it ends early is expected and not reported."""
        count = 0
        with suppress(RecordingError), reading(path):
            for batch in self._open_file(path).batches(wanted):
                count += len(batch.start)
                yield batch
        if count:
            self.warnings.append(f'{count} messages recovered from {path.name}, which {METADATA} does not list')

    def _compare_counts(self, wanted: Collection[str]) -> None:
        """Warns where other numbers of messages were read than the metadata states: a database has no checksums."""
        for topic in wanted:
            lost = self._counts.get(topic, self._read_counts[topic]) - self._read_counts[topic]
            if lost and not self.warnings:
                more = 'more' if lost > 0 else 'fewer'
                self.warnings.append(f'{topic}: {METADATA} states {abs(lost)} {more} messages than the files contain')

    def _listed_files(self) -> list[Path] | None:
        """The files that the metadata lists; None where there is no usable list."""
        metadata = self.path / METADATA
        if not metadata.exists():
            return None
        try:
            names, self._counts = _contents(metadata)
        except (AttributeError, LookupError, OSError, RecursionError, TypeError, ValueError) as error:
            reason = ' '.join(str(error).split())[:80] or type(error).__name__
            self.warnings.append(f'{METADATA} cannot be read ({reason}): all files of the folder were read, in order')
            return None
        files = [self.path / name for name in names]
        missing = [file.name for file in files if not file.exists()]
        self.vanished = bool(missing)
        if missing and len(missing) == len(files):
            self.warnings.append(
                f'{METADATA} lists {missing[0]}, which is missing: all files of the folder were read, in order'
            )
            return None
        if missing:
            self.warnings.append(f'{METADATA} lists {", ".join(missing)}, which is missing: the others were read')
        return [file for file in files if file.exists()]

    def _all_files(self) -> list[Path]:
        """The MCAP and SQLite files in the folder by number, `…_2` before `…_10`."""
        files = [file for file in self._entries() if _STORED.match(file.name) and not file.name.startswith('.')]
        files = _without_merged(files)
        if files and not (self.path / METADATA).exists():
            self.warnings.append(f'{METADATA} is missing: all files of the folder were read, in order')
        return sorted(files, key=_natural)

    def _left_over_files(self) -> list[Path]:
        """The files that follow the last listed one by their number, complete or not."""
        last = _NUMBERED.match(self._files[-1].name) if self._files else None
        if last is None:
            return []
        matches = [(file, _NUMBERED.match(file.name)) for file in self._entries()]
        following = [
            file
            for file, match in matches
            if match and match['stem'] == last['stem'] and int(match['number']) > int(last['number'])
        ]
        return sorted(following, key=_natural)

    def _entries(self) -> list[Path]:
        return [entry for entry in self.path.iterdir() if entry.is_file()]

    def _no_recording(self) -> RecordingError:
        inside = [
            entry for entry in sorted(self.path.iterdir()) if (entry / METADATA).exists() or entry.suffix == '.bag'
        ]
        remedy = f'did you mean {inside[0]}?' if inside else f'expected {METADATA} and .mcap or .db3 files'
        return RecordingError(self.path, 'no recording in this folder', remedy)


def _contents(metadata: Path) -> tuple[list[str], dict[str, int]]:
    """File names in the metadata (old versions prefix the folder) and the number of messages by topic."""
    if metadata.stat().st_size > _MAX_METADATA:
        raise ValueError('too large')
    data = parse_strings(metadata.read_text('utf-8'))['rosbag2_bagfile_information']
    names = list(dict.fromkeys(PurePosixPath(name).name for name in data['relative_file_paths']))
    topics = data['topics_with_message_count']
    return names, {ros_topic(item['topic_metadata']['name']): int(item['message_count']) for item in topics}


def _without_merged(files: list[Path]) -> list[Path]:
    """The files without those that another one contains, because they were merged to it."""
    spans = {file: (match['stem'], _span(match)) for file in files if (match := _NUMBERED.match(file.name))}

    def is_contained(file: Path) -> bool:
        stem, (first, last) = spans[file]
        others = [span for other, span in spans.values() if other == stem and span != (first, last)]
        return any(begin <= first and last <= end for begin, end in others)

    return [file for file in files if file not in spans or not is_contained(file)]


def _span(match: re.Match[str]) -> tuple[int, int]:
    """First and last number of what a file was merged of."""
    return int(match['first'] or match['number']), int(match['number'])


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), '') if part.isdigit() else (0, part) for part in re.split(r'([0-9]+)', path.name.lstrip('.'))]
