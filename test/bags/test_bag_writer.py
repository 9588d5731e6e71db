"""The crash-safe writer: what a checkpoint has secured survives a kill, and the folder opens at every moment."""

from __future__ import annotations

import errno
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from bags.forms import CELL, assert_same, make_streams, messages
from bags.forms import count as samples
from bags.forms import record as write
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.errors import OutputError, RecordingError


def strict_count(folder: Path) -> int:
    """Messages of the robot in an ended recording by strict readers: metadata, index, checksums, footer."""
    with Reader(folder) as reader:
        found = [item.topic for item, _, _ in reader.messages()]
        assert len(found) == reader.message_count
        assert found.count('/cell_description') == 1
    with next(folder.glob('*.mcap')).open('rb') as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == len(found)
    return len(found) - 1


def count(folder: Path) -> int:
    """Messages of the robot that our reader finds, ended or not, none lost of those that the metadata state."""
    assert embedded_cell(folder) == CELL
    metadata = yaml.load((folder / 'metadata.yaml').read_text(), yaml.CSafeLoader)['rosbag2_bagfile_information']
    try:
        read = read_streams(folder, CELL)
    except RecordingError as error:
        assert metadata['message_count'] == 1, error
        return 0
    assert not [warning for warning in read.warnings if 'stamp' in warning or 'more messages' in warning]
    found = samples(read)
    assert found >= metadata['message_count'] - 1
    return found


def names(folder: Path) -> list[str]:
    return sorted(item.name for item in folder.iterdir())


def test_a_run(tmp_path, streams):
    folder, items = tmp_path / 'run', messages(streams)
    with BagWriter(folder, CELL, log_time=items[0].log_time) as bag:
        for first, last in ((0, 100), (100, 100), (100, 400)):
            write(bag, items[first:last])
            assert count(folder) == bag.recorded == first
            bag.checkpoint()
            assert count(folder) == bag.recorded == last
        write(bag, items[400:])
    assert names(folder) == ['metadata.yaml', 'run_0.mcap']
    assert strict_count(folder) == bag.recorded == 640
    read = read_streams(folder, CELL)
    assert_same(read, streams)
    assert read.warnings == ()
    assert embedded_cell(folder) == CELL


def test_metadata_as_jazzy_writes_it(tmp_path):
    items = messages(make_streams(20, 20))
    with BagWriter(tmp_path / 'run', CELL, log_time=items[0].log_time) as bag:
        write(bag, items)
    data = yaml.safe_load((tmp_path / 'run/metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert (data['version'], data['storage_identifier'], data['ros_distro']) == (9, 'mcap', 'jazzy')
    assert data['starting_time'] == {'nanoseconds_since_epoch': items[0].log_time}
    assert data['duration'] == {'nanoseconds': items[-1].log_time - items[0].log_time}
    topics = {item['topic_metadata']['name']: item for item in data['topics_with_message_count']}
    counts = {name: item['message_count'] for name, item in topics.items()}
    assert counts == {'/cell_description': 1, '/joint_states': 20, '/wrench': 20}
    qos = topics['/cell_description']['topic_metadata']['offered_qos_profiles'][0]
    assert (qos['durability'], qos['reliability'], qos['depth']) == ('transient_local', 'reliable', 1)
    assert topics['/wrench']['topic_metadata']['type_description_hash'].startswith('RIHS01_8dc3deaf06b2')


def test_a_run_without_messages_and_after_its_end(tmp_path):
    with BagWriter(tmp_path / 'run', CELL) as bag:
        bag.checkpoint()
        before = names(tmp_path / 'run')
        with pytest.raises(OutputError, match='exists already and is never overwritten'):
            BagWriter(tmp_path / 'run', CELL)
        assert names(tmp_path / 'run') == before == ['metadata.yaml', 'run_0.mcap']
    bag.close()
    assert names(tmp_path) == ['run']
    assert strict_count(tmp_path / 'run') == 0
    for action in (bag.checkpoint, lambda: bag.write_wrench(b'', 0)):
        with pytest.raises(OutputError, match='the recording was closed; start a new one'):
            action()


def test_several_threads(tmp_path, streams):
    items = messages(streams)
    with BagWriter(tmp_path / 'run', CELL, log_time=0) as bag:

        def work(topic: str) -> None:
            for number, item in enumerate(item for item in items if item.topic == topic):
                write(bag, [item])
                if number % 50 == 0:
                    bag.checkpoint()

        threads = [threading.Thread(target=work, args=(topic,)) for topic in ('/joint_states', '/wrench')]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert strict_count(tmp_path / 'run') == 640
    assert_same(read_streams(tmp_path / 'run', CELL), streams)


@pytest.mark.parametrize('calls', range(3))
def test_the_disk_is_full(tmp_path, streams, calls, monkeypatch):
    """At whatever point of a checkpoint: the one before stays, one line says why, nothing more is taken."""
    folder, items = tmp_path / 'run', messages(streams)
    bag = BagWriter(folder, CELL, log_time=items[0].log_time)
    write(bag, items[:100])
    bag.checkpoint()
    write(bag, items[100:200])
    fsync, left = os.fsync, [calls]

    def full(handle: int) -> None:
        if left[0] == 0:
            raise OSError(errno.ENOSPC, 'No space left on device')
        left[0] -= 1
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(os, 'fsync', full)
        with pytest.raises(OutputError, match='run: cannot be written: No space left on device'):
            bag.checkpoint()
    assert bag.recorded == 100
    assert count(folder) in (100, 200)
    with pytest.raises(OutputError, match='the recording was stopped by an error'):
        bag.write_wrench(b'', 0)
    bag.close()
    assert count(folder) in (100, 200)


def test_death_between_any_two_steps(tmp_path, monkeypatch):
    """What is on the disk before each dealing with the file system is what a process leaves that vanishes there."""
    left: list[tuple[Path, int]] = []
    (tmp_path / 'disk').mkdir()

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*args: Any, **options: Any) -> Any:
            left.append((tmp_path / f'left{len(left)}', secured))
            with monkeypatch.context() as patch:
                patch.undo()
                shutil.copytree(tmp_path / 'disk', left[-1][0])
            return function(*args, **options)

        return wrapper

    secured, items = 0, messages(make_streams(40, 40))
    with pytest.MonkeyPatch.context() as patch:
        for name in ('mkdir', 'open', 'rename', 'replace', 'unlink'):
            patch.setattr(Path, name, watched(getattr(Path, name)))
        for name in ('fsync', 'open', 'link'):
            patch.setattr(os, name, watched(getattr(os, name)))
        with BagWriter(tmp_path / 'disk' / 'run', CELL, log_time=items[0].log_time) as bag:
            for number, item in enumerate(items, start=1):
                write(bag, [item])
                if number % 32 == 0:
                    bag.checkpoint()
                    secured = bag.recorded
    opened = [count(disk / 'run') - before for disk, before in left if (disk / 'run').exists()]
    assert len(left) > 30 and len(opened) > 20 and min(opened) >= 0
    assert all(before == 0 for disk, before in left if not (disk / 'run').exists())
    assert strict_count(tmp_path / 'disk' / 'run') == 80


def test_messages_since_the_last_checkpoint_are_recovered(tmp_path):
    streams = make_streams(3000, 3000)
    items = messages(streams)
    bag = BagWriter(tmp_path / 'run', CELL, log_time=items[0].log_time)
    write(bag, items[:100])
    bag.checkpoint()
    write(bag, items[100:])
    assert 3000 < count(tmp_path / 'run') < 6000
    assert read_streams(tmp_path / 'run', CELL).warnings == ()
    (tmp_path / 'run/metadata.yaml').unlink()
    missing, cut_off = read_streams(tmp_path / 'run', CELL).warnings
    assert 'metadata.yaml cannot be read (No such file' in missing and 'run_0.mcap ends early, after' in cut_off
    bag.close()
    assert_same(read_streams(tmp_path / 'run', CELL), streams)
