"""Cut and corrupted files: what is left of them is read with a warning, or one line says that nothing is."""

from __future__ import annotations

import random
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bags.forms import CELL, make_streams, messages, write_mcap
from mcap.writer import CompressionType

from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.errors import InputError, RecordingError
from scara_kinetostatic.touches.streams import Streams


def check_part(read: Streams, whole: Streams) -> int:
    """Everything read was really recorded; how many samples."""
    for stream, values, original, recorded in (
        (read.joints.stamp, read.joints.position, whole.joints.stamp, whole.joints.position),
        (read.wrench.stamp, read.wrench.force, whole.wrench.stamp, whole.wrench.force),
    ):
        where = np.searchsorted(original, stream)
        np.testing.assert_array_equal(original[where], stream)
        np.testing.assert_array_equal(recorded[where], values)
    return len(read.joints.stamp) + len(read.wrench.stamp)


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_mcap_without_its_end(tmp_path: Path, streams: Streams, compression: CompressionType) -> None:
    """The recorder was killed: every complete chunk is there."""
    write_mcap(tmp_path / 'a.mcap', messages(streams), compression=compression, finish=False)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert check_part(read, streams) > 500
    assert len(read.warnings) == 1
    assert 'a.mcap ends early, after' in read.warnings[0]


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_mcap_cut_anywhere(tmp_path: Path, streams: Streams, compression: CompressionType) -> None:
    """Every complete chunk before the cut is read."""
    write_mcap(tmp_path / 'a.mcap', messages(streams), compression=compression)
    content = (tmp_path / 'a.mcap').read_bytes()
    found = []
    for share in (0.2, 0.4, 0.6, 0.8, 0.999):
        (tmp_path / 'cut.mcap').write_bytes(content[: int(share * len(content))])
        read = read_streams(tmp_path / 'cut.mcap', CELL)
        assert 'ends early' in read.warnings[0]
        found.append(check_part(read, streams))
    assert found == sorted(found)
    assert found[0] > 60
    assert found[-1] == 640


def test_a_damaged_chunk_costs_that_chunk(tmp_path: Path, streams: Streams) -> None:
    write_mcap(tmp_path / 'a.mcap', messages(streams))
    content = bytearray((tmp_path / 'a.mcap').read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / 'a.mcap').write_bytes(content)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert 500 < check_part(read, streams) < 640
    assert 'the damaged chunk at byte' in read.warnings[0]


def test_a_damaged_index_is_not_believed(tmp_path: Path, streams: Streams) -> None:
    write_mcap(tmp_path / 'a.mcap', messages(streams))
    content = bytearray((tmp_path / 'a.mcap').read_bytes())
    content[-200] ^= 0xFF
    (tmp_path / 'a.mcap').write_bytes(content)
    assert check_part(read_streams(tmp_path / 'a.mcap', CELL), streams) == 640


def test_sqlite_cut_off(tmp_path: Path, streams: Streams) -> None:
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    file = next((tmp_path / 'bag').glob('*.db3'))
    content = file.read_bytes()
    for size in range(4096, len(content), 8192):
        file.write_bytes(content[:size])
        try:
            read = read_streams(tmp_path / 'bag', CELL)
        except RecordingError:
            continue
        assert check_part(read, streams) < 640
        assert 'is cut off' in read.warnings[0]


def test_lost_rows_are_noticed_by_the_count(tmp_path: Path, streams: Streams) -> None:
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    with closing(sqlite3.connect(next((tmp_path / 'bag').glob('*.db3')))) as database, database:
        database.execute('DELETE FROM messages WHERE topic_id = 3 AND id % 2')
    read = read_streams(tmp_path / 'bag', CELL)
    lost = 640 - check_part(read, streams)
    assert lost > 100
    assert read.warnings == (f'/wrench: metadata.yaml states {lost} more messages than the files contain',)


def test_a_database_that_was_still_open(tmp_path: Path, streams: Streams) -> None:
    """Killed in write-ahead mode: what stands in the log alone is read, too, and nothing is written."""
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    file = next((tmp_path / 'bag').glob('*.db3'))
    script = (
        'import os, sqlite3, sys; database = sqlite3.connect(sys.argv[1]); '
        'database.execute("PRAGMA journal_mode=WAL"); '
        'database.execute("DELETE FROM messages WHERE topic_id = 2 AND id > 300"); database.commit(); os._exit(9)'
    )
    assert subprocess.run([sys.executable, '-c', script, str(file)], check=False).returncode == 9
    assert Path(f'{file}-wal').stat().st_size > 0
    read = read_streams(file, CELL)
    assert 100 < len(read.joints.stamp) < 200


@pytest.mark.parametrize('name', ['a.mcap', 'b.mcap', 'c.bag', 'd', 'e'])
def test_whatever_happens_to_a_file(tmp_path: Path, name: str) -> None:
    """Bytes cut, flipped, overwritten: an answer or an `InputError`, at once, nothing else."""
    streams = make_streams(60, 60)
    options = {'b.mcap': {'compression': 'zstd'}, 'd': {'storage': 'sqlite3'}}
    options['e'] = {'storage': 'sqlite3', 'compression': 'zstd'}
    write_streams(tmp_path / name, streams, CELL, **options.get(name, {}))
    file = tmp_path / name
    if file.is_dir():
        file = next(item for item in file.iterdir() if item.name != 'metadata.yaml')
    content = file.read_bytes()
    rng = random.Random(7)
    outcomes = set()
    for number in range(60):
        spoilt = bytearray(content)
        at = rng.randrange(len(spoilt))
        if number % 3 == 0:
            del spoilt[at:]
        elif number % 3 == 1:
            spoilt[at] = rng.randrange(256)
        else:
            spoilt[at : at + rng.randrange(200)] = rng.choice([b'\0', b'\xff']) * rng.randrange(200)
        file.write_bytes(spoilt)
        for action in (lambda: read_streams(tmp_path / name, CELL), lambda: embedded_cell(tmp_path / name)):
            try:
                action()
            except InputError as error:
                assert '\n' not in str(error)
                outcomes.add('refused')
            else:
                outcomes.add('read')
    assert outcomes == {'read', 'refused'}
