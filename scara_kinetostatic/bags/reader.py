"""Any supported recording to `Streams`.

A recording is a rosbag2 folder (MCAP or SQLite, split, compressed or not), a bare `.mcap` or `.db3` file, or a ROS 1
`.bag`. The cell's two topics become arrays. Messages that cannot be used are dropped and counted in the warnings; a
recording that cannot be used is a `RecordingError` that says what to do.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import closing, suppress
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.bags.bag_folder import METADATA
from scara_kinetostatic.bags.cell_topics import cell_topics
from scara_kinetostatic.bags.decoding import Decoder, Samples, decode_string
from scara_kinetostatic.bags.decompression import decompress_messages
from scara_kinetostatic.bags.encoding import DISCARD_TOPIC
from scara_kinetostatic.bags.messages import (
    JOINT_STATE,
    STRING,
    WRENCH_STAMPED,
    Batch,
    Source,
    Topic,
    printable,
    reading,
)
from scara_kinetostatic.bags.sources import open_recording
from scara_kinetostatic.bags.transforms import TF_MESSAGE, TF_STATIC, decode_transforms
from scara_kinetostatic.errors import CellError, RecordingError, one_line
from scara_kinetostatic.files.cell_file import CELL_TOPIC, parse_cell
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Sensor
from scara_kinetostatic.touches import clock
from scara_kinetostatic.touches.clock import counted
from scara_kinetostatic.touches.streams import (
    INTERLEAVED,
    FixedTransform,
    JointStream,
    Streams,
    WrenchFrame,
    WrenchStream,
    interleaved_seconds,
)

_ENCODINGS = ('cdr', 'ros1')
_ATTEMPTS = 5
"""So often a folder is read if files vanish from it because they are merged."""


class _Discard(NamedTuple):
    """A touch that was discarded while recording: a stamp within its hold, and when that was received, ns."""

    stamp: int
    received: int


class _Contents(NamedTuple):
    """What a recording holds of two topics.

    Attributes:
        source: of the recording, which then knows all topics.
        samples: the messages of the two topics, decoded.
        discarded: touches that were discarded while recording.
        frame_ids: of the wrenches.
        transforms: those that are fixed, in the order of recording.
    """

    source: Source
    samples: dict[str, Samples]
    discarded: tuple[_Discard, ...]
    frame_ids: tuple[str, ...]
    transforms: tuple[FixedTransform, ...]


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
        contents = _samples(path, names, cell)
        source = contents.source
        found = cell_topics(str(path), source.topics(), cell.sensor, lambda: _recorded_sensor(path, source))
        if found != names:
            names = found
            contents = _samples(path, names, cell)
        frame = _frame(contents, cell)
        turns = {name: turn for name in contents.frame_ids if (turn := frame.turn(name)) is not None}
        if turns:
            contents = _samples(path, names, cell, turns)
        streams, warnings = contents.samples, list(contents.source.warnings)
        for (topic, samples), msgtype in zip(streams.items(), (JOINT_STATE, WRENCH_STAMPED), strict=True):
            if len(samples.stamp) == 0:
                raise _nothing_usable(path, contents.source, topic, msgtype, samples, cell)
            warnings += [f'{topic}: {counted(number)} {why} dropped' for why, number in samples.dropped.items()]
        if interleaved_seconds(streams[names[0]].log_time, streams[names[0]].values):
            warnings.append(f'{names[0]}: {INTERLEAVED}')
        warnings += [f'{names[1]}: {said}' for name in contents.frame_ids if (said := frame.complaint(name))]
        clocked = [clock.Samples(*samples[:3]) for samples in streams.values()]
        offset = cell.sensor.time_offset
        (joints, wrench), valid = clock.on_one_clock(str(path), names, clocked, warnings, offset)
        return Streams(
            str(path),
            JointStream(*joints),
            WrenchStream(*wrench),
            warnings=tuple(map(one_line, warnings)),
            topics=names,
            discarded=tuple(item.received if valid.by_log_time else item.stamp for item in contents.discarded),
            turned=one_line('; '.join(map(frame.description, turns))),
        )


def _frame(contents: _Contents, cell: Cell) -> WrenchFrame:
    """What the fixed transforms of a recording say of the wrenches."""
    frame = WrenchFrame(cell.sensor.frame)
    for transform in contents.transforms:
        frame.add(transform)
    return frame


def _samples(
    path: str | Path, names: tuple[str, str], cell: Cell, turns: Mapping[str, Floats] | None = None
) -> _Contents:
    """What a recording holds of two topics, the forces turned by their `frame_id`."""
    for _ in range(_ATTEMPTS - 1):
        before = _version(path)
        contents = _read_once(path, names, cell, turns)
        if not getattr(contents.source, 'vanished', False) or _version(path) == before:
            return contents
    return _read_once(path, names, cell, turns)


def _version(path: str | Path) -> tuple[int, int]:
    """Changes where the list of the files of a folder does: a recorder merges files while they are read."""
    metadata = Path(path) / METADATA
    with suppress(OSError):
        state = metadata.stat()
        return state.st_ino, state.st_mtime_ns
    return 0, 0


def _read_once(path: str | Path, names: tuple[str, str], cell: Cell, turns: Mapping[str, Floats] | None) -> _Contents:
    """As `_samples`, whatever happens to the folder meanwhile."""
    types = dict(zip(names, (JOINT_STATE, WRENCH_STAMPED), strict=True))
    wrenches = Decoder(turns=turns)
    decoders = dict(zip(names, (Decoder(cell.joint_names), wrenches), strict=True))
    source, discarded, transforms = open_recording(path), list[_Discard](), list[FixedTransform]()
    for batch in source.batches((*types, DISCARD_TOPIC, TF_STATIC)):
        if batch.topic.encoding not in _ENCODINGS:
            continue
        for portion in decompress_messages(batch):
            if batch.topic.msgtype == types.get(batch.topic.name):
                decoders[batch.topic.name].add(portion)
            elif (batch.topic.name, batch.topic.msgtype) == (DISCARD_TOPIC, STRING):
                discarded += _discarded(portion)
            elif (batch.topic.name, batch.topic.msgtype) == (TF_STATIC, TF_MESSAGE):
                for payload in portion.payloads():
                    transforms += decode_transforms(payload, batch.topic.encoding)
    samples = {topic: decoder.samples() for topic, decoder in decoders.items()}
    return _Contents(source, samples, tuple(discarded), tuple(sorted(wrenches.frame_ids)), tuple(transforms))


def _discarded(batch: Batch) -> list[_Discard]:
    """The discarded touches."""
    found = []
    for payload in batch.payloads():
        said = json.loads(decode_string(payload, batch.topic.encoding))
        discard = _Discard(said['stamp'], said.get('received') or said['stamp'])
        if not all(isinstance(time, int) for time in discard):
            raise ValueError(f'{DISCARD_TOPIC}: expected times in ns, got {said!r}')
        found.append(discard)
    return found


def _recorded_sensor(path: str | Path, source: Source) -> Sensor | None:
    """The sensor of the cell description in the recording; None where there is none that is valid."""
    if not any(item.name == CELL_TOPIC for item in source.topics()):
        return None
    with suppress(CellError):
        cell = embedded_cell(path)
        return cell.sensor if cell else None
    return None


def embedded_cell(path: str | Path) -> Cell | None:
    """The cell description in a recording, on topic `/cell_description`; None where there is none.

    Raises:
        RecordingError: there is no such recording, or it cannot be read.
        CellError: the message on that topic is not a valid cell description.
    """
    with reading(path), closing(open_recording(path).batches({CELL_TOPIC})) as batches:
        for batch in batches:
            if batch.topic.msgtype == STRING and batch.topic.encoding in _ENCODINGS:
                text = decode_string(next(decompress_messages(batch)).payload(0), batch.topic.encoding)
                return parse_cell(text, f'{path}: {CELL_TOPIC}')
    return None


def _nothing_usable(
    path: str | Path, source: Source, topic: str, msgtype: str, samples: Samples, cell: Cell
) -> RecordingError:
    """Why a topic gave no samples."""
    topics = source.topics()
    here = [item for item in topics if item.name == topic]
    if source.warnings and not samples.dropped:
        problem = f'no message of {topic} can be read: {"; ".join(source.warnings[:2])}'
        return RecordingError(path, problem, 'copy the file again, or record again')
    if not here:
        return _missing(path, topic, msgtype, topics)
    if all(item.msgtype != msgtype for item in here):
        problem = f'topic {topic} carries {here[0].msgtype}, expected {msgtype}'
        return RecordingError(path, problem, _suggestion(topics, msgtype, topic))
    if all(item.encoding not in _ENCODINGS for item in here):
        return RecordingError(path, f'topic {topic} is serialized as {here[0].encoding!r}, expected cdr', 'convert it')
    if samples.names and not any(name in samples.names for name in cell.joint_names):
        problem = f'topic {topic} has no joints {" and ".join(cell.joint_names)}, only {_some(sorted(samples.names))}'
        return RecordingError(path, problem, 'put the right names into robot.joint_names of the cell description')
    if samples.dropped:
        reasons = ', '.join(f'{number} {why}' for why, number in samples.dropped.most_common())
        return RecordingError(path, f'no message of {topic} can be used: {reasons}', 'check what publishes the topic')
    return RecordingError(path, f'topic {topic} has no messages', 'record while the driver publishes')


def _missing(path: str | Path, topic: str, msgtype: str, topics: list[Topic]) -> RecordingError:
    if not topics:
        return RecordingError(path, 'the recording has no topics', f'record {topic} ({msgtype})')
    return RecordingError(path, f'the recording has no topic {topic}', _suggestion(topics, msgtype, topic))


def _suggestion(topics: list[Topic], msgtype: str, topic: str) -> str:
    right = [item.name for item in topics if item.msgtype == msgtype and item.encoding in _ENCODINGS]
    key = 'sensor.joint_states' if msgtype == JOINT_STATE else 'sensor.wrench'
    if right:
        return f'{msgtype} is on {_some(right)}: put that into {key} of the cell description'
    return f'it has {_some([f"{item.name} ({item.msgtype})" for item in topics])}: record {topic} ({msgtype})'


def _some(names: list[str], most: int = 8) -> str:
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return printable(', '.join(names[:most])) + more
