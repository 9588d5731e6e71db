"""Any supported recording to `Streams`.

A recording is a rosbag2 folder (MCAP or SQLite, split, compressed or not), a bare `.mcap` or `.db3` file, or a ROS 1
`.bag`. The cell's two topics become arrays. Messages that cannot be used are dropped and counted in the warnings; a
recording that cannot be used is a `RecordingError` that says what to do.
`recorded_cell` gives the cell description that several recordings contain.

Which form it has its first bytes show; a folder is read file by file. A rosbag2 folder has a `metadata.yaml` and the
files it lists. One whose metadata is missing or damaged is read as well, its files in the order of their names, with a
warning. That a file ends amid its data is no warning where all messages are there that the metadata state.
"""

from __future__ import annotations

import json
import re
import stat
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath

import zstandard

from scara_kinetostatic.bags.decoding import (
    DISCARD_TOPIC,
    JOINT_STATE,
    LARGEST_MESSAGE,
    METADATA,
    PORTION,
    STRING,
    TF_MESSAGE,
    TF_STATIC,
    WRENCH_STAMPED,
    ZSTD_MAGIC,
    Batch,
    Batches,
    Budget,
    BudgetError,
    Decoder,
    Storage,
    Topic,
    batched,
    decode_string,
    decode_transforms,
    reading,
    ros_topic,
    unpack,
)
from scara_kinetostatic.bags.mcap_file import MAGIC, McapFile
from scara_kinetostatic.errors import CellError, InputError, RecordingError, one_line, some_of
from scara_kinetostatic.files.atomic import MIB
from scara_kinetostatic.files.cell_file import CELL_TOPIC, parse_cell
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.files.yaml_file import parse_strings
from scara_kinetostatic.model.cell import Cell, Sensor, different_parts
from scara_kinetostatic.model.quantities import count
from scara_kinetostatic.touches.clock import on_one_clock
from scara_kinetostatic.touches.streams import ALTERNATE, JointStream, Streams, WrenchFrame, WrenchStream, alternate

_JSON = 100
"""Messages on `/tf_static` and of discarded touches cost as much as so many others."""


def read_streams(path: str | Path, cell: Cell) -> Streams:
    """Read the joint angles and forces of a recording.

    Args:
        path: the recording.
        cell: names its topics and joints.

    Returns:
        Both streams in the order of their header stamps; each stamp once.

    Raises:
        RecordingError: there is no such recording, it cannot be read, or it lacks what is needed.
    """
    with reading(path):
        names = cell.sensor.topics
        source, decoders, discarded, frame = _read(path, names, cell)
        if (found := _cell_topics(path, source.topics(), cell.sensor)) != names:
            names = found
            source, decoders, discarded, frame = _read(path, names, cell)
        joint_decoder, wrench_decoder = decoders.values()
        frame_ids = sorted(wrench_decoder.frame_ids)
        turns = {name: turn for name in frame_ids if (turn := frame.turn(name)) is not None}
        streams = {names[0]: joint_decoder.samples(), names[1]: wrench_decoder.samples(turns)}
        warnings = list(source.warnings)
        for (topic, decoder), msgtype in zip(decoders.items(), (JOINT_STATE, WRENCH_STAMPED), strict=True):
            if len(streams[topic].stamp) == 0:
                raise _nothing_usable(path, source, topic, msgtype, decoder, cell)
            warnings += [
                f'{topic}: {count(number, "message")} {why} dropped' for why, number in decoder.dropped.items()
            ]
        warnings += [f'{names[1]}: {said}' for name in frame_ids if (said := frame.complaint(name))]
        samples, offset = list(streams.values()), cell.sensor.time_offset
        (joints, wrench), valid = on_one_clock(str(path), names, samples, warnings, offset)
        if alternate(joints[1][:, :2]):
            warnings.append(f'{names[0]}: {ALTERNATE}')
        moved = JointStream.of(*joints).moved(cell)
        if moved.any():
            where = cell.moved_joint(joints[1][moved][0, 2:])
            warnings.append(f'{names[0]}: {count(int(moved.sum()), "message")} while {where}')
        return Streams(
            str(path),
            replace(JointStream.of(*joints), position=cell.angles(joints[1][:, :2])),
            WrenchStream(*wrench),
            warnings=tuple(map(one_line, warnings)),
            topics=names,
            discarded=tuple(times[valid.by_log_time] for times in discarded),
            force_ranges=None if turns else wrench_decoder.force_ranges(),
            turned=one_line('; '.join(map(frame.description, turns))),
        )


def _read(
    path: str | Path, names: tuple[str, str], cell: Cell
) -> tuple[Storage, dict[str, Decoder], list[tuple[int, int]], WrenchFrame]:
    """What a recording holds of two topics.

    Returns:
        Its source, which then knows all topics; the decoders of the two; of each touch that was discarded while
        recording a stamp within its hold, and when that was received, ns; and what the fixed transforms say of the
        wrenches.
    """
    types = dict(zip(names, (JOINT_STATE, WRENCH_STAMPED), strict=True))
    decoders = dict(zip(names, (Decoder(cell.joint_names, cell.other_joints), Decoder()), strict=True))
    discarded, frame, transforms = list[tuple[int, int]](), WrenchFrame(cell), 0
    budget = Budget(Path(path))
    source = open_recording(path, budget)
    for batch in source.batches((*types, DISCARD_TOPIC, TF_STATIC)):
        topic = batch.topic
        for portion in _decompressed(batch, budget) if topic.encoding == 'cdr' else ():
            if topic.msgtype == types.get(topic.name):
                decoders[topic.name].add(portion)
            elif (topic.name, topic.msgtype) == (DISCARD_TOPIC, STRING):
                budget.charge(0, _JSON * len(portion.start))
                discarded += _discarded(portion)
            elif (topic.name, topic.msgtype) == (TF_STATIC, TF_MESSAGE):
                # a driver that sends them in every cycle says nothing new
                number = min(len(portion.start), 1000 - transforms)
                transforms += number
                budget.charge(0, _JSON * number + int(portion.length[:number].sum()) // _JSON)
                for place in range(number):
                    for transform in decode_transforms(portion.payload(place)):
                        frame.add(transform)
    return source, decoders, discarded, frame


def _decompressed(batch: Batch, budget: Budget) -> Iterator[Batch]:
    """The same messages, decompressed where each was compressed on its own (rosbag2's compression mode `message`).

    A message that is not compressed never starts with the magic number of zstd; one that is damaged or too large is
    empty.
    """
    if len(batch.start) == 0 or batch.payload(0)[:4] != ZSTD_MAGIC:
        yield batch
        return

    def content(index: int) -> bytes:
        with suppress(zstandard.ZstdError, ValueError):
            return unpack(batch.payload(index), LARGEST_MESSAGE)
        return b''

    times = batch.log_time.tolist()
    parts = (range(start, min(start + PORTION, len(times))) for start in range(0, len(times), PORTION))
    yield from batched(batch.topic, ((times[part.start : part.stop], [*map(content, part)]) for part in parts), budget)


def _discarded(batch: Batch) -> list[tuple[int, int]]:
    """The discarded touches, as `_read` has them."""
    found = []
    for place in range(len(batch.start)):
        said = json.loads(decode_string(batch.payload(place)))
        times = said['stamp'], said.get('received') or said['stamp']
        if not all(isinstance(time, int) for time in times):
            raise ValueError(f'{DISCARD_TOPIC}: expected times in ns, got {said!r}')
        found.append(times)
    return found


def embedded_cell(path: str | Path) -> Cell | None:
    """The cell description in a recording, on topic `/cell_description`; None where there is none.

    Raises:
        RecordingError: there is no such recording, or it cannot be read.
        CellError: the message on that topic is not a valid cell description.
    """
    return _embedded(path)[0]


def _embedded(path: str | Path) -> tuple[Cell | None, list[str]]:
    """The same, and what is wrong with the recording."""
    with reading(path):
        budget = Budget(Path(path))
        source = open_recording(path, budget)
    with reading(path), closing(source.batches({CELL_TOPIC})) as batches:
        for batch in batches:
            if batch.topic.msgtype == STRING and batch.topic.encoding == 'cdr':
                text = decode_string(next(_decompressed(batch, budget)).payload(0))
                return parse_cell(text, f'{path}: {CELL_TOPIC}'), source.warnings
    return None, source.warnings


def _nothing_usable(
    path: str | Path, source: Storage, topic: str, msgtype: str, decoder: Decoder, cell: Cell
) -> RecordingError:
    """Why a topic gave no samples."""
    topics = source.topics()
    here = [item for item in topics if item.name == topic]
    if source.warnings and not decoder.dropped:
        problem = f'no message of {topic} can be read: {"; ".join(source.warnings[:2])}'
        return RecordingError(path, problem, 'copy the file again, or record again')
    if Topic(topic, msgtype, 'cdr') not in here:
        problem = f'the recording has no topic {topic}'
        if here:
            problem = f'topic {topic} carries {here[0].msgtype} ({here[0].encoding}), expected {msgtype} (cdr)'
        return RecordingError(path, problem, _suggestion(topics, msgtype, topic))
    if decoder.names and (missing := [name for name in cell.joint_names if name not in decoder.names]):
        problem = f'topic {topic} does not have {" and ".join(missing)}, only {some_of(sorted(decoder.names))}'
        return RecordingError(path, problem, 'put the right names into robot.joint_names of the cell description')
    reasons = ', '.join(f'{number} {why}' for why, number in decoder.dropped.most_common()) or 'it has none'
    return RecordingError(path, f'no message of {topic} can be used: {reasons}', 'check what publishes the topic')


def _suggestion(topics: list[Topic], msgtype: str, topic: str) -> str:
    right = [item.name for item in topics if item.msgtype == msgtype and item.encoding == 'cdr']
    key = 'sensor.joint_states' if msgtype == JOINT_STATE else 'sensor.wrench'
    if right:
        return f'{msgtype} is on {some_of(right)}: put that into {key} of the cell description'
    there = some_of([f'{item.name} ({item.msgtype})' for item in topics]) or 'nothing'
    return f'it has {there}: record {topic} ({msgtype})'


def _cell_topics(path: str | Path, topics: Sequence[Topic], sensor: Sensor) -> tuple[str, str]:
    """The names of joint states and wrenches in a recording; those in the root namespace where there is nothing better.

    A name with a leading slash is taken as it stands. One without was recorded in the namespace of the nodes, which the
    recording shows: `joint_states` is found as `/joint_states` or `/left/joint_states`, both topics in the same
    namespace. A collector whose topics were remapped records a description whose names the recording does not have,
    beside the only two topics of these types.

    Args:
        path: the recording.
        topics: all its topics.
        sensor: of the cell description.

    Raises:
        RecordingError: several namespaces have both topics.
    """
    here = [[item.name for item in topics if item.msgtype == kind] for kind in (JOINT_STATE, WRENCH_STAMPED)]
    found = _by_namespace(here, sensor)
    if len(found) > 1:
        problem = f'several cells: {" and ".join(f"{joints} with {wrench}" for joints, wrench in found[:4])}'
        remedy = 'write the full names of one, with a leading slash, into sensor.joint_states and sensor.wrench'
        raise RecordingError(path, problem, f'{remedy} of the cell description')
    if found:
        return found[0]
    only = [list(dict.fromkeys(names)) for names in here]
    if all(len(names) == 1 for names in only) and any(item.name == CELL_TOPIC for item in topics):
        with suppress(CellError):
            described = embedded_cell(path)
            if described and described.sensor[:2] == sensor[:2]:
                return only[0][0], only[1][0]
    return sensor.topics


def _by_namespace(here: list[list[str]], sensor: Sensor) -> list[tuple[str, str]]:
    """The pairs of topics of the right types that the names of a cell description can mean."""
    spaces: list[set[str]] = []
    for names, wanted in zip(here, sensor[:2], strict=True):
        if wanted.startswith('/'):
            if wanted not in names:
                return []
        else:
            spaces.append({name[: -len(wanted) - 1] for name in names if name.endswith(f'/{wanted}')})
    common = set.intersection(*spaces) if spaces else {''}
    return [
        tuple(name if name.startswith('/') else f'{space}/{name}' for name in sensor[:2])  # type: ignore[misc]
        for space in sorted(common)
    ]


def recorded_cell(paths: Sequence[Path], option: str) -> Cell:
    """The cell description that all recordings contain.

    Args:
        paths: recordings, and touch tables, which contain none.
        option: how the user names a cell description instead, such as ``--cell``.

    Raises:
        RecordingError: a recording has no cell description or another one than the first, or all are tables.
        CellError: it is not valid.
    """
    found = {path: _embedded(path) for path in paths if not is_touch_table(path)}
    if not found:
        raise RecordingError(paths[0], 'a table contains no cell description', f'give one by {option}')
    first, (common, _) = next(iter(found.items()))
    for path, (cell, warnings) in found.items():
        if cell is None:
            problem = '; '.join(['contains no cell description', *warnings[:1]])
            raise RecordingError(path, problem, f'give one by {option}')
        if cell != common:
            raise RecordingError(path, f'contains another cell description than {first}', f'choose one by {option}')
    assert common is not None
    return common


def other_descriptions(cell: Cell, paths: Sequence[Path], option: str, without: Collection[str] = ()) -> list[str]:
    """One sentence for each recording that contains another cell description than the one in use.

    Args:
        cell: in use.
        paths: recordings and touch tables.
        option: what named it, such as ``--cell``.
        without: parts in which they may differ.
    """
    sentences = []
    for path in (path for path in paths if not is_touch_table(path)):
        with suppress(InputError):  # an invalid one may be the reason to name another
            recorded = embedded_cell(path)
            keys = [] if recorded is None else [k for k in different_parts(cell, recorded) if k not in without]
            if keys:
                other = f'{path} contains another cell description ({", ".join(keys)})'
                sentences.append(f'{other}; that of {option} is used')
    return sentences


_FORMS = 'a rosbag2 folder, an .mcap or .db3 file, a ROS 1 .bag, or a touch table (.csv)'


def open_recording(path: str | Path, budget: Budget | None = None) -> Storage:
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


def _open_file(path: Path, budget: Budget) -> Storage:
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


class _Decompressed(Storage):
    """A file compressed as a whole: decompressed into a temporary file while it is read."""

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics."""
        with tempfile.TemporaryDirectory(prefix='scara_kinetostatic_') as folder:
            plain = Path(folder) / self.path.stem
            with zstandard.open(self.path, 'rb') as packed, plain.open('wb') as unpacked:
                try:
                    while part := packed.read(MIB):
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


class BagFolder(Storage):
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
            if metadata.stat().st_size > 16 * MIB:  # a recording of 10 000 files has 2 MB
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
