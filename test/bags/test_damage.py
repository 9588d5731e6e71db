"""Cut and corrupted files: what is left of them is read with a warning, or one line says that nothing is.

Damage that leaves a file readable is noticed wherever the file has a checksum, a count or a rule for it.
"""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from bags.forms import CELL, count, messages, spoil, write_mcap, write_ros1, write_sqlite
from mcap.writer import CompressionType
from rosbags.rosbag1 import Reader, Writer

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.errors import RecordingError
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
    return count(read)


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_mcap_cut_anywhere(tmp_path, streams, compression):
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


@pytest.mark.parametrize(('spoilt', 'least', 'most'), [('chunk', 501, 639), ('index', 640, 640)])
def test_what_damage_in_the_middle_costs(tmp_path, streams, spoilt, least, most):
    """A damaged chunk costs that chunk; a damaged index is not believed, and costs nothing."""
    write_mcap(tmp_path / 'a.mcap', messages(streams))
    spoil(tmp_path / 'a.mcap', -200 if spoilt == 'index' else (tmp_path / 'a.mcap').stat().st_size // 2)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert least <= check_part(read, streams) <= most
    assert spoilt == 'index' or 'the damaged chunk at byte' in read.warnings[0]


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_a_damaged_first_chunk_costs_what_is_in_it(tmp_path, streams, compression):
    """It defines the topics; the summary does so again, where the file has one."""
    file = tmp_path / 'a.mcap'
    write_mcap(file, messages(streams), compression=compression)
    spoil(file, 250)
    read = read_streams(file, CELL)
    assert 501 <= check_part(read, streams) < 640
    (warning,) = read.warnings
    assert warning.startswith('a.mcap: the damaged chunk at byte 45 was skipped')
    write_mcap(file, messages(streams), compression=compression, repeat_channels=False, use_summary_offsets=False)
    spoil(file, 250)
    assert 'no message of /joint_states can be read: a.mcap: the damaged chunk at byte ' in reported(file)


@pytest.mark.parametrize('compression', [None, Writer.CompressionFormat.BZ2])
def test_a_bag_of_ros_1_cut_anywhere(tmp_path, streams, compression):
    """Every complete chunk before the cut is read; what was cut at the end of one is missed by the number of chunks."""
    file = tmp_path / 'a.bag'
    write_ros1(file, messages(streams), compression)
    with Reader(file) as reader:
        second, chunks = reader.chunk_infos[1].pos, len(reader.chunk_infos)
    content, found = file.read_bytes(), []
    for size in (second, second + 1000, len(content) - 10):
        file.write_bytes(content[:size])
        read = read_streams(file, CELL)
        found.append((check_part(read, streams), read.warnings[0]))
    (one, cut), (same, early), (all_of_them, end) = found
    assert 0 < one == same < all_of_them == 640
    assert cut == f'a.bag states {chunks} chunks, read were 1: it was not closed'
    assert early == end == 'a.bag is damaged (it ends early): read up to there'
    file.write_bytes(content)
    spoil(file, second + 1000)
    assert compression is None or one < check_part(read_streams(file, CELL), streams) < 640


def test_sqlite_cut_off(tmp_path, streams):
    file = write_sqlite(tmp_path / 'bag', messages(streams))
    content = file.read_bytes()
    for size in range(4096, len(content), 8192):
        file.write_bytes(content[:size])
        try:
            read = read_streams(tmp_path / 'bag', CELL)
        except RecordingError:
            continue
        assert check_part(read, streams) < 640
        assert 'is cut off' in read.warnings[0]


def test_lost_rows_are_noticed_by_the_count(tmp_path, streams):
    with closing(sqlite3.connect(write_sqlite(tmp_path / 'bag', messages(streams)))) as database, database:
        database.execute('DELETE FROM messages WHERE topic_id = 2 AND id % 2')
    read = read_streams(tmp_path / 'bag', CELL)
    lost = 640 - check_part(read, streams)
    assert lost > 100
    assert read.warnings == (f'/wrench: metadata.yaml states {lost} more messages than the files contain',)


def test_a_database_that_was_still_open(tmp_path, streams):
    """Killed in write-ahead mode: what stands in the log alone is read, too, and nothing is written."""
    file = write_sqlite(tmp_path / 'bag', messages(streams))
    script = (
        'import os, sqlite3, sys; database = sqlite3.connect(sys.argv[1]); '
        'database.execute("PRAGMA journal_mode=WAL"); '
        'database.execute("DELETE FROM messages WHERE topic_id = 1 AND id > 300"); database.commit(); os._exit(9)'
    )
    assert subprocess.run([sys.executable, '-c', script, str(file)], check=False).returncode == 9
    assert Path(f'{file}-wal').stat().st_size > 0
    read = read_streams(file, CELL)
    assert 100 < len(read.joints.stamp) < 200


def reported(path: Path) -> str:
    """What a damaged recording gives: the error, or the warnings."""
    try:
        return '; '.join(read_streams(path, CELL).warnings)
    except RecordingError as error:
        return str(error)


@pytest.mark.parametrize('use_chunking', [True, False])
def test_messages_lost_without_a_checksum_are_missed(tmp_path, streams, use_chunking):
    """The third wrench becomes a record of a kind that nobody knows."""
    write_mcap(tmp_path / 'a.mcap', messages(streams), enable_crcs=False, use_chunking=use_chunking)
    spoil(tmp_path / 'a.mcap', messages(streams)[5].payload, b'\x85', -31)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert count(read) == 639
    (warning,) = read.warnings
    assert 'its index states' in warning
    if use_chunking:
        spoil(tmp_path / 'a.mcap', messages(streams)[100].payload, b'\xff' * 8, -30)
        read = read_streams(tmp_path / 'a.mcap', CELL)
        assert 500 < count(read) < 639
        assert 'was skipped (invalid records)' in read.warnings[0]


def test_rows_that_got_lost_in_a_bare_database_are_missed(tmp_path, streams):
    file = write_sqlite(tmp_path / 'bag', messages(streams))
    assert reported(file) == ''
    with closing(sqlite3.connect(file)) as database, database:
        database.execute('UPDATE messages SET topic_id = 77 WHERE id = 50')
    assert '1 messages belong to no topic' in reported(file)


def test_a_page_that_got_mixed_up_is_noticed(tmp_path, streams):
    """A row takes a number that is not its turn: it is stored and counted, and cannot be found."""
    file = write_sqlite(tmp_path / 'bag', messages(streams))
    content = bytearray(file.read_bytes())
    page = 4096 * (content.index(messages(streams)[10].payload) // 4096)
    assert content[page] == 13, 'a leaf of a table'
    cells = page + 8
    content[cells : cells + 4] = content[cells + 2 : cells + 4] + content[cells : cells + 2]
    file.write_bytes(content)
    assert 'is damaged' in reported(file)
