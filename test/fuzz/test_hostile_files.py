"""A part of `benchmark.faults.hostile` and `benchmark.faults.fuzz`: small files that cost little."""

from __future__ import annotations

import shutil
import time

import numpy as np
import pytest

from benchmark.common import CELL, peak_memory, reset_peak_memory
from benchmark.faults import fuzz, hostile
from benchmark.faults.formats import short_streams
from benchmark.faults.hostile import Cost
from benchmark.faults.outcomes import time_limit
from scara_kinetostatic.bags import decoding
from scara_kinetostatic.bags.decoding import MAX_BYTES, Budget
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.calibration_file import stored_covariance
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document

CHEAP = (
    'mcap_length_beyond_the_file', 'mcap_repeated_schemas', 'mcap_many_layouts', 'mcap_many_joints',
    'mcap_index_repeats_a_chunk', 'ros1_repeated_index', 'ros1_repeated_message', 'ros1_giant_header',
    'sqlite_overflow_chain', 'sqlite_endless_tree', 'heading_of_spaces',
    'plates_3000', 'yaml_dense', 'history_view',
    'sqlite_generated_column', 'mcap_giant_definition', 'table_of_many_rows', 'json_of_lists_within_the_limit',
)  # fmt: skip


@pytest.fixture
def quickly_made(plain, tmp_path_factory, monkeypatch):
    """What takes long to make and not to read: a calibration, and messages of one layout that are not the same."""
    calibration = tmp_path_factory.mktemp('calibration') / 'calibration.json'
    calibration.write_text(json_text(as_document(plain)), encoding='utf-8')
    (message,) = hostile.wrench_messages(hostile.STAMP, np.zeros((1, 2)), 8 * '#')
    monkeypatch.setattr(hostile, '_calibration', lambda folder: shutil.copy(calibration, folder))
    monkeypatch.setattr(hostile, 'wrench_messages', lambda *a: [message.replace(8 * b'#', a[2].encode())])


@pytest.mark.parametrize('name', CHEAP)
def test_a_hostile_file_is_refused_in_one_line(name, tmp_path, capsys, quickly_made):
    """In this process, what it holds already does not count; the benchmark gives each case one of its own."""
    arguments = hostile.CASES[name](tmp_path)
    reset_peak_memory()
    began, before = time.process_time(), peak_memory()
    with time_limit(hostile.KILLED):
        status = main(arguments)
    seconds, more = time.process_time() - began, peak_memory() - before
    cost = Cost(status, seconds, more / 1e6, capsys.readouterr().err.strip())
    assert (cost.status, cost.problem) == (2, ''), cost
    assert before > 10e6  # it is measured


@pytest.mark.usefixtures('without_page')
def test_mutated_files_of_every_format(monkeypatch, capsys):
    monkeypatch.setattr('sys.argv', ['fuzz', '--files', '81', '--seed', '1'])
    monkeypatch.setattr(fuzz, 'MEMORY', np.inf)  # of this process, which has done other things
    assert fuzz.main() == 0
    assert '81 files of 27 formats: 0 failures' in capsys.readouterr().out


def test_the_limit_can_be_raised(tmp_path, monkeypatch, capsys):
    path = tmp_path / 'a.mcap'
    streams = short_streams()
    write_streams(path, streams, CELL)
    monkeypatch.setenv(MAX_BYTES, '1000')
    read_streams(path, CELL)  # it never lowers the limit
    monkeypatch.setattr(decoding, '_BYTES', 1000)
    monkeypatch.setattr(decoding, '_BYTES_RATIO', 0)
    with pytest.raises(RecordingError, match='more than 1000 bytes, implausible for its size; if you trust it, raise'):
        read_streams(path, CELL)
    monkeypatch.setenv(MAX_BYTES, 'many')
    with pytest.raises(RecordingError, match="expected a number of bytes, got 'many'"):
        read_streams(path, CELL)
    assert main(['inspect', str(path), '--max-bytes', '1000']) == 2
    assert 'raise the limit, by --max-bytes 2000 or more' in capsys.readouterr().err
    assert main(['inspect', str(path), '--max-bytes', '1000000']) in (0, 3)
    assert main(['inspect', str(path), '--max-bytes', '-1']) == 2


def test_a_sparse_file_beside_a_recording_raises_no_limit(tmp_path):
    write_streams(tmp_path / 'a.mcap', short_streams(), CELL)
    records = Budget(tmp_path).records
    for name in ('notes.bin', 'b.mcap'):
        with (tmp_path / name).open('wb') as stream:
            stream.truncate(1 << 40)
    assert Budget(tmp_path).records == records


def test_a_covariance_has_to_be_positive_semidefinite():
    rows = np.array([[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]])
    with pytest.raises(ValueError, match=r'not positive semidefinite: the correlation has an eigenvalue -0\.8'):
        stored_covariance(rows.tolist(), np.ones(3, dtype=bool))
    singular = np.outer([1.0, 1e-6, 0.0], [1.0, 1e-6, 0.0])
    np.testing.assert_array_equal(stored_covariance(singular.tolist(), np.ones(3, dtype=bool)), singular)
