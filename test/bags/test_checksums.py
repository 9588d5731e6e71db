"""Damage that leaves a file readable is noticed wherever the file has a checksum, a count or a rule for it."""

from __future__ import annotations

import random
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from bags.forms import CELL, assert_same, make_streams, messages, write_mcap
from mcap.writer import CompressionType

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import BagWriter, write_streams
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.touches.streams import Streams


def reported(path: Path) -> str:
    """What a damaged recording gives: the error, or the warnings."""
    try:
        return '; '.join(read_streams(path, CELL).warnings)
    except RecordingError as error:
        return str(error)


def collected(folder: Path, streams: Streams) -> Path:
    """A collector's recording with a checkpoint on the way."""
    bag, items = BagWriter(folder, CELL, log_time=0), messages(streams)
    for count, item in enumerate(items, start=1):
        write = bag.write_joint_state if item.topic == '/joint_states' else bag.write_wrench
        write(item.payload, item.log_time)
        if count == len(items) // 2:
            bag.checkpoint()
    bag.close()
    return folder


@pytest.mark.parametrize('form', ['plain', 'zstd', 'collected'])
def test_no_byte_of_our_files_changes_a_sample_unreported(tmp_path: Path, form: str) -> None:
    path, streams = tmp_path / 'bag', make_streams(60, 60)
    if form == 'collected':
        collected(path, streams)
    else:
        write_streams(path, streams, CELL, compression='zstd' if form == 'zstd' else None)
    assert reported(path) == ''
    file = max(path.glob('*.mcap'), key=lambda item: item.stat().st_size)
    content = file.read_bytes()
    rng = random.Random(1)
    places = {*range(40), *range(len(content) - 60, len(content)), *rng.sample(range(len(content)), 40)}
    harmless = 0
    for at in places:
        spoilt = bytearray(content)
        spoilt[at] ^= 1 << rng.randrange(8)
        file.write_bytes(spoilt)
        if not reported(path):
            assert_same(read_streams(path, CELL), streams)
            harmless += 1
    assert harmless < len(places) - 30


def test_a_damaged_index_costs_nothing(tmp_path: Path, streams: Streams) -> None:
    write_mcap(tmp_path / 'a.mcap', messages(streams))
    content = bytearray((tmp_path / 'a.mcap').read_bytes())
    content[-200] ^= 0xFF
    (tmp_path / 'a.mcap').write_bytes(content)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert_same(read, streams)


@pytest.mark.parametrize('use_chunking', [True, False])
def test_messages_lost_without_a_checksum_are_missed(tmp_path: Path, streams: Streams, use_chunking: bool) -> None:
    """The third wrench becomes a record of a kind that nobody knows."""
    write_mcap(tmp_path / 'a.mcap', messages(streams), enable_crcs=False, use_chunking=use_chunking)
    content = bytearray((tmp_path / 'a.mcap').read_bytes())
    at = content.index(messages(streams)[5].payload) - 31
    assert content[at] == 5
    content[at] = 0x85
    (tmp_path / 'a.mcap').write_bytes(content)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert len(read.joints.stamp) + len(read.wrench.stamp) == 639
    assert len(read.warnings) == 1
    assert 'its index states' in read.warnings[0]


def test_a_chunk_of_invalid_records_is_reported(tmp_path: Path, streams: Streams) -> None:
    write_mcap(tmp_path / 'a.mcap', messages(streams), enable_crcs=False, compression=CompressionType.NONE)
    content = bytearray((tmp_path / 'a.mcap').read_bytes())
    at = content.index(messages(streams)[100].payload) - 30
    content[at : at + 8] = b'\xff' * 8
    (tmp_path / 'a.mcap').write_bytes(content)
    read = read_streams(tmp_path / 'a.mcap', CELL)
    assert 500 < len(read.joints.stamp) + len(read.wrench.stamp) < 640
    assert 'was skipped (invalid records)' in read.warnings[0]


def test_rows_that_got_lost_in_a_bare_database_are_missed(tmp_path: Path, streams: Streams) -> None:
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    file = next((tmp_path / 'bag').glob('*.db3'))
    assert reported(file) == ''
    with closing(sqlite3.connect(file)) as database, database:
        database.execute('UPDATE messages SET topic_id = 77 WHERE id = 50')
    assert '1 messages belong to no topic' in reported(file)


def test_a_page_that_got_mixed_up_is_noticed(tmp_path: Path, streams: Streams) -> None:
    """A row takes a number that is not its turn: it is stored and counted, and cannot be found."""
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    file = next((tmp_path / 'bag').glob('*.db3'))
    content = bytearray(file.read_bytes())
    page = 4096 * (content.index(messages(streams)[10].payload) // 4096)
    assert content[page] == 13, 'a leaf of a table'
    cells = page + 8
    content[cells : cells + 4] = content[cells + 2 : cells + 4] + content[cells : cells + 2]
    file.write_bytes(content)
    assert 'is damaged' in reported(file)


def test_more_messages_than_the_metadata_count(tmp_path: Path, streams: Streams) -> None:
    write_streams(tmp_path / 'bag', streams, CELL)
    metadata = tmp_path / 'bag/metadata.yaml'
    metadata.write_text(metadata.read_text().replace('message_count: 340', 'message_count: 240'))
    assert reported(tmp_path / 'bag') == '/wrench: metadata.yaml states 100 fewer messages than the files contain'


def test_what_is_said_can_be_printed(tmp_path: Path, streams: Streams) -> None:
    write_streams(tmp_path / 'bag', streams, CELL, storage='sqlite3')
    file = next((tmp_path / 'bag').glob('*.db3'))
    with closing(sqlite3.connect(file)) as database, database:
        database.execute("UPDATE topics SET type = ? WHERE name = '/wrench'", ('a\x1b[31m/b/c\0/d',))
    assert 'topic /wrench carries a' in reported(file)
    assert reported(file).isprintable()
