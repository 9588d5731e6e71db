"""Recordings appear whole or not at all, and never over another."""

from __future__ import annotations

import errno

import pytest
from bags.forms import CELL, make_streams

from scara_kinetostatic.bags import writer
from scara_kinetostatic.bags.writer import fresh_folder, write_streams
from scara_kinetostatic.errors import OutputError

NAMES = ('bag', 'bare.mcap')


@pytest.mark.parametrize('there', ['file', 'folder', 'dangling link'])
def test_nothing_is_overwritten(tmp_path, streams, there):
    path = tmp_path / 'bag'
    {'file': path.touch, 'folder': path.mkdir, 'dangling link': lambda: path.symlink_to('nowhere')}[there]()
    with pytest.raises(OutputError, match='exists already and is never overwritten'):
        write_streams(path, streams, CELL)
    assert [item.name for item in tmp_path.iterdir()] == ['bag']
    assert there != 'file' or path.read_bytes() == b''


def test_somebody_else_is_faster(tmp_path, streams, monkeypatch):
    """Another recording takes the name while this one is being written."""
    messages, path = writer._messages, tmp_path / 'bag'

    def slow(*args: object, **options: object):  # type: ignore[no-untyped-def]
        path.mkdir()
        yield from messages(*args, **options)

    monkeypatch.setattr(writer, '_messages', slow)
    with pytest.raises(OutputError, match='exists already'):
        write_streams(path, streams, CELL)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('fault', [OSError(errno.ENOSPC, 'No space left on device'), KeyboardInterrupt()])
def test_all_or_nothing(tmp_path, streams, name, fault, monkeypatch):
    messages = writer._messages

    def failing(*args: object, **options: object):  # type: ignore[no-untyped-def]
        for number, message in enumerate(messages(*args, **options)):
            if number == 400:
                raise fault
            yield message

    monkeypatch.setattr(writer, '_messages', failing)
    expected = OutputError if isinstance(fault, OSError) else KeyboardInterrupt
    with pytest.raises(expected) as caught:
        write_streams(tmp_path / 'deep' / name, streams, CELL)
    assert list((tmp_path / 'deep').iterdir()) == []
    if expected is OutputError:
        assert 'cannot be written: No space left on device' in str(caught.value)


def test_places_that_cannot_be_written(tmp_path, streams):
    (tmp_path / 'file').write_text('')
    with pytest.raises(OutputError, match='file/bag: cannot be written: File exists; choose another place'):
        write_streams(tmp_path / 'file' / 'bag', streams, CELL)
    for path in ('/proc/nowhere/bag', tmp_path / 'a\0b', tmp_path / ('x' * 300)):
        with pytest.raises(OutputError):
            write_streams(path, streams, CELL)


def test_what_is_not_recorded(tmp_path, streams):
    with pytest.raises(OutputError, match='nothing to record'):
        write_streams(tmp_path / 'bag', make_streams(0, 0), CELL)
    with pytest.raises(OutputError, match=r'a\.bag: is written as MCAP alone; .*rosbags-convert'):
        write_streams(tmp_path / 'a.bag', streams, CELL)
    assert list(tmp_path.iterdir()) == []


def test_fresh_folder(tmp_path):
    first = fresh_folder(tmp_path, 'touches')
    assert first.parent == tmp_path and first.name.startswith('touches_20') and not first.exists()
    first.mkdir()
    second = fresh_folder(tmp_path, 'touches')
    assert second != first and not second.exists()
