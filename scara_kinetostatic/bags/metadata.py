"""`metadata.yaml` of a rosbag2 folder, as Jazzy writes it (version 9)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

from rosbags.interfaces import Qos

from scara_kinetostatic.bags.encoding import Channel

_NONE_YET = (1 << 63) - 1
"""Start time that rosbag2 writes for a recording without messages, ns."""


class FileInfo(NamedTuple):
    """One file of a recording.

    Attributes:
        name: of the file.
        start: time of the first message, ns; meaningless without messages.
        end: time of the last message, ns.
        counts: messages of each channel; channels that came later are missing.
    """

    name: str
    start: int
    end: int
    counts: tuple[int, ...]


def metadata_text(channels: Sequence[Channel], files: Sequence[FileInfo], storage: str = 'mcap') -> str:
    """The file's content.

    Args:
        channels: the topics, in the order of the counts of the files.
        files: the files, in the order of recording.
        storage: `mcap` or `sqlite3`.
    """
    filled = [info for info in files if sum(info.counts)]
    start = min((info.start for info in filled), default=_NONE_YET)
    end = max((info.end for info in filled), default=_NONE_YET)
    totals = [sum(sum(info.counts[number : number + 1]) for info in files) for number in range(len(channels))]
    lines = [
        'rosbag2_bagfile_information:',
        '  version: 9',
        f'  storage_identifier: {storage}',
        *_span(start, end, '  '),
        f'  message_count: {sum(totals)}',
        '  topics_with_message_count:',
        *(line for channel, total in zip(channels, totals, strict=True) for line in _topic(channel, total)),
        '  compression_format: ""',
        '  compression_mode: ""',
        '  relative_file_paths:',
        *(f'    - {_quoted(info.name)}' for info in files),
        '  files:',
        *(line for info in files for line in _file(info)),
        '  custom_data: ~',
        '  ros_distro: jazzy',
    ]
    return '\n'.join(lines) + '\n'


def qos_text(qos: Qos, indent: str = '') -> str:
    """Quality of service, as it stands in the metadata and in each MCAP channel."""
    return '\n'.join(
        [
            f'{indent}- history: {qos.history.name.lower()}',
            f'{indent}  depth: {qos.depth}',
            f'{indent}  reliability: {qos.reliability.name.lower()}',
            f'{indent}  durability: {qos.durability.name.lower()}',
            *_time('deadline', *qos.deadline, indent),
            *_time('lifespan', *qos.lifespan, indent),
            f'{indent}  liveliness: {qos.liveliness.name.lower()}',
            *_time('liveliness_lease_duration', *qos.liveliness_lease_duration, indent),
            f'{indent}  avoid_ros_namespace_conventions: {str(qos.avoid_ros_namespace_conventions).lower()}',
        ]
    )


def _time(name: str, seconds: int, nanoseconds: int, indent: str) -> list[str]:
    return [f'{indent}  {name}:', f'{indent}    sec: {seconds}', f'{indent}    nsec: {nanoseconds}']


def _span(start: int, end: int, indent: str) -> list[str]:
    return [
        f'{indent}duration:',
        f'{indent}  nanoseconds: {end - start}',
        f'{indent}starting_time:',
        f'{indent}  nanoseconds_since_epoch: {start}',
    ]


def _topic(channel: Channel, count: int) -> list[str]:
    return [
        '    - topic_metadata:',
        f'        name: {channel.topic}',
        f'        type: {channel.msgtype}',
        '        serialization_format: cdr',
        '        offered_qos_profiles:',
        qos_text(channel.qos, ' ' * 10),
        f'        type_description_hash: {channel.digest}',
        f'      message_count: {count}',
    ]


def _file(info: FileInfo) -> list[str]:
    count = sum(info.counts)
    return [
        f'    - path: {_quoted(info.name)}',
        *_span(info.start if count else _NONE_YET, info.end if count else _NONE_YET, '      '),
        f'      message_count: {count}',
    ]


def _quoted(name: str) -> str:
    """A file name, in the quotes of JSON, which YAML shares."""
    return json.dumps(name, ensure_ascii=False)
