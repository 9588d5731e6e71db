"""Results appear whole or not at all; the checksum of a recording is the one that its documentation computes."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import pytest

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.files.atomic import recording_checksum
from scara_kinetostatic.results import document
from scara_kinetostatic.results.document import write_results

DATE = datetime(2026, 11, 21, 14, 3, 22, tzinfo=timezone.utc)
FILES = {'calibration.yaml', 'calibration.json', 'report.html', 'residuals.csv'}


@pytest.fixture(autouse=True)
def quick_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(document.page, 'html_text', lambda outcome: '<!DOCTYPE html>\n')


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_three_files_in_a_new_folder(plain: Outcome, tmp_path: Path) -> None:
    files = write_results(plain, tmp_path / 'a' / 'b')
    assert files.folder == tmp_path / 'a' / 'b'
    assert names(files.folder) == FILES
    assert {path.name for path in files.paths} == FILES
    (tmp_path / 'usual').touch()
    assert files.document.stat().st_mode == (tmp_path / 'usual').stat().st_mode


@pytest.mark.parametrize('failure', [OSError(28, 'No space left on device'), KeyboardInterrupt()])
def test_a_failure_half_way_leaves_everything_as_it_was(
    plain: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    """Of the fourth of the files that are to be replaced."""
    write_results(plain, tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in FILES}
    sync, left = os.fsync, [3]

    def breaks_off(handle: int) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise failure
        sync(handle)

    monkeypatch.setattr(os, 'fsync', breaks_off)
    with pytest.raises(OutputError if isinstance(failure, OSError) else KeyboardInterrupt):
        write_results(replace(plain, created=DATE), tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in names(tmp_path)} == before


def test_ctrl_c_as_files_take_their_places_comes_when_all_have(
    plain: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_results(plain, tmp_path)
    rename, number = Path.replace, 0

    def interrupted(draft: Path, place: Path) -> Path:
        nonlocal number
        number += 1
        if number == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return rename(draft, place)

    monkeypatch.setattr(Path, 'replace', interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_results(replace(plain, created=DATE), tmp_path)
    assert number == 2 * len(FILES), 'the former ones are kept beside the new ones'
    assert '2026-11-21T14:03:22Z' in (tmp_path / 'calibration.json').read_text(encoding='utf-8')


def test_a_file_where_the_folder_should_be(plain: Outcome, tmp_path: Path) -> None:
    (tmp_path / 'taken').write_text('mine')
    for folder in (tmp_path / 'taken', tmp_path / 'taken' / 'deeper'):
        with pytest.raises(OutputError, match=r'taken.*cannot be written'):
            write_results(plain, folder)
    assert (tmp_path / 'taken').read_text() == 'mine'


def test_a_folder_where_a_file_should_be(plain: Outcome, tmp_path: Path) -> None:
    (tmp_path / 'report.html').mkdir()
    (tmp_path / 'elsewhere').write_text('mine')
    (tmp_path / 'calibration.json').symlink_to('elsewhere')
    with pytest.raises(OutputError, match=r'report\.html: is a folder'):
        write_results(plain, tmp_path)
    assert names(tmp_path) == {'report.html', 'elsewhere', 'calibration.json'}
    assert (tmp_path / 'calibration.json').is_symlink()


def test_an_earlier_result_is_kept_under_its_date(plain: Outcome, tmp_path: Path) -> None:
    """Its page, too, where the new result has none."""
    first = write_results(plain, tmp_path)
    assert (first.kept, first.note) == ((), '')
    before = {path.name: path.read_bytes() for path in first.paths}
    for path in first.paths:
        os.utime(path, (DATE.timestamp(),) * 2)
    (tmp_path / 'notes.txt').write_text('mine')
    second = write_results(replace(plain, created=DATE), tmp_path, report=False)
    dated = {name: name.replace('.', '_2026-11-21T14-03-22Z.') for name in FILES}
    assert {path.name for path in second.kept} == set(dated.values())
    assert {name: (tmp_path / kept).read_bytes() for name, kept in dated.items()} == before
    assert 'calibration_2026-11-21T14-03-22Z.json' in second.note
    assert names(tmp_path) == (FILES | set(dated.values()) | {'notes.txt'}) - {'report.html'}
    assert (tmp_path / 'calibration.json').read_bytes() != before['calibration.json']


def test_results_of_one_second_are_kept(plain: Outcome, tmp_path: Path) -> None:
    for _ in range(4):
        for path in tmp_path.glob('*.*'):
            os.utime(path, (DATE.timestamp(),) * 2)
        write_results(plain, tmp_path)
    assert len(names(tmp_path)) == 4 * len(FILES)


def test_the_checksum_of_a_folder_is_that_of_the_documented_command(tmp_path: Path) -> None:
    for name in ('metadata.yaml', 'bag_0.mcap', 'bag_10.mcap', 'Bag.db3', '.bag_11.mcap.part'):
        (tmp_path / name).write_text(name)
    found = recording_checksum(tmp_path)
    assert recording_checksum.__doc__ is not None
    lines = recording_checksum.__doc__.split('cd FOLDER\n', 1)[1].split('\n\n', 1)[0]
    output = subprocess.run(['sh', '-c', lines], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert output.split()[0] == found
    (tmp_path / 'report.html').write_text('not a part of the recording')
    assert recording_checksum(tmp_path) == found
    (tmp_path / '.bag_11.mcap.part').write_text('changed')
    assert recording_checksum(tmp_path) != found
    table = tmp_path / 'bag_0.mcap'
    assert recording_checksum(table) == hashlib.sha256(table.read_bytes()).hexdigest()
