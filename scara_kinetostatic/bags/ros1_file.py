"""A `.bag` file of ROS 1, read by `rosbags`."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError

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
                    self._topics[item.id] = Topic(ros_topic(item.topic), ros2_type(item.msgtype), 'ros1')
                for name in wanted:
                    connections = [item for item in reader.connections if self._topics[item.id].name == name]
                    if connections:
                        yield from self._messages(reader, connections)
        except ReaderError as error:
            indexed = 'index' not in str(error)
            remedy = 'copy it or record it again' if indexed else 'copy it again, or run "rosbag reindex" on it'
            raise RecordingError(self.path, f'the bag cannot be read: {error}', remedy) from error

    def _messages(self, reader: Reader, connections: list[Connection]) -> Iterator[Batch]:
        times: list[int] = []
        payloads: list[bytes] = []
        previous, count = None, 0
        try:
            for connection, time, payload in reader.messages(connections):
                topic = self._topics[connection.id]
                if topic != previous or len(times) == BATCH:
                    if previous is not None:
                        yield Batch.from_payloads(previous, times, payloads)
                    previous, times, payloads = topic, [], []
                times.append(time)
                payloads.append(payload)
                count += 1
        except (ReaderError, AssertionError, ArithmeticError, LookupError, OSError, RuntimeError, ValueError) as error:
            name = connections[0].topic
            self.warnings.append(f'{self.path.name} is damaged ({error}): messages of {name} may be missing')
        if previous is not None and times:
            yield Batch.from_payloads(previous, times, payloads)
        expected = sum(item.msgcount for item in connections)
        if count != expected and not self.warnings:
            self.warnings.append(
                f'{self.path.name}: its index states {expected} messages of {connections[0].topic}, read were {count}'
            )
