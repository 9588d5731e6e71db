"""Any supported recording to `Streams`.

A recording is a rosbag2 folder (MCAP or SQLite, split, compressed or not), a bare `.mcap` or `.db3` file, or a ROS 1
`.bag`. The cell's two topics become arrays. Messages that cannot be used are dropped and counted in the warnings; a
recording that cannot be used is a `RecordingError` that says what to do.
`recorded_cell` gives the cell description that several recordings contain.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import zstandard

from scara_kinetostatic.bags.cdr import Decoder, decode_string, decode_transforms
from scara_kinetostatic.bags.messages import (
    DISCARD_TOPIC,
    JOINT_STATE,
    LARGEST_MESSAGE,
    PORTION,
    STRING,
    TF_MESSAGE,
    TF_STATIC,
    WRENCH_STAMPED,
    ZSTD_MAGIC,
    Batch,
    Budget,
    Source,
    Topic,
    batched,
    reading,
    unpack,
)
from scara_kinetostatic.bags.sources import open_recording
from scara_kinetostatic.errors import CellError, InputError, RecordingError, one_line
from scara_kinetostatic.files.cell_file import CELL_TOPIC, parse_cell
from scara_kinetostatic.files.touch_table import is_touch_table
from scara_kinetostatic.model.cell import Cell, Sensor, different_parts
from scara_kinetostatic.report.quantities import count
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
) -> tuple[Source, dict[str, Decoder], list[tuple[int, int]], WrenchFrame]:
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
    path: str | Path, source: Source, topic: str, msgtype: str, decoder: Decoder, cell: Cell
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
        problem = f'topic {topic} does not have {" and ".join(missing)}, only {_some(sorted(decoder.names))}'
        return RecordingError(path, problem, 'put the right names into robot.joint_names of the cell description')
    reasons = ', '.join(f'{number} {why}' for why, number in decoder.dropped.most_common()) or 'it has none'
    return RecordingError(path, f'no message of {topic} can be used: {reasons}', 'check what publishes the topic')


def _suggestion(topics: list[Topic], msgtype: str, topic: str) -> str:
    right = [item.name for item in topics if item.msgtype == msgtype and item.encoding == 'cdr']
    key = 'sensor.joint_states' if msgtype == JOINT_STATE else 'sensor.wrench'
    if right:
        return f'{msgtype} is on {_some(right)}: put that into {key} of the cell description'
    return f'it has {_some([f"{item.name} ({item.msgtype})" for item in topics])}: record {topic} ({msgtype})'


def _some(names: list[str], most: int = 8) -> str:
    more = f' and {len(names) - most} more' if len(names) > most else ''
    return (', '.join(names[:most]) or 'nothing') + more


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
