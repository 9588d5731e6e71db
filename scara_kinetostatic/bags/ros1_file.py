"""A `.bag` file of ROS 1, read by `rosbags`, which also converts its messages to those of ROS 2."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError

from scara_kinetostatic.bags.cdr import ros2_types
from scara_kinetostatic.bags.messages import BATCH, Batch, Batches, Topic, ros2_type, ros_topic
from scara_kinetostatic.errors import RecordingError


class Ros1File:
    """A bag of format 2.0, plain or compressed chunk by chunk; a `Source`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._topics: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """Every topic of the file."""
        return list(dict.fromkeys(self._topics.values()))

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, in the order of their recording."""
        try:
            with Reader(self.path) as reader:
                for item in reader.connections:
                    self._topics[item.id] = Topic(ros_topic(item.topic), ros2_type(item.msgtype), 'cdr')
                for topic in self.topics():
                    connections = [item for item in reader.connections if self._topics[item.id] == topic]
                    if topic.name in wanted:
                        yield from self._messages(reader, connections, topic)
        except ReaderError as error:
            indexed = 'index' not in str(error)
            remedy = 'copy it or record it again' if indexed else 'copy it again, or run "rosbag reindex" on it'
            raise RecordingError(self.path, f'the bag cannot be read: {error}', remedy) from error

    def _messages(self, reader: Reader, connections: list[Connection], topic: Topic) -> Iterator[Batch]:
        times: list[int] = []
        payloads: list[bytes] = []
        count = 0
        try:
            for _, time, payload in reader.messages(connections):
                times.append(time)
                payloads.append(_as_cdr(payload, topic.msgtype))
                count += 1
                if len(times) == BATCH:
                    yield Batch.from_payloads(topic, times, payloads)
                    times, payloads = [], []
        except (ReaderError, AssertionError, ArithmeticError, LookupError, OSError, RuntimeError, ValueError) as error:
            self.warnings.append(f'{self.path.name} is damaged ({error}): messages of {topic.name} may be missing')
        if times:
            yield Batch.from_payloads(topic, times, payloads)
        expected = sum(item.msgcount for item in connections)
        if count != expected and not self.warnings:
            self.warnings.append(
                f'{self.path.name}: its index states {expected} messages of {topic.name}, read were {count}'
            )


def _as_cdr(payload: bytes, msgtype: str) -> bytes:
    """A message as ROS 2 sends it; empty where it is damaged."""
    try:
        return bytes(ros2_types().ros1_to_cdr(payload, msgtype))
    except Exception:  # rosbags raises whatever the bytes lead to
        return b''
