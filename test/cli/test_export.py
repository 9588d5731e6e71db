"""The verb `export`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cli.command import refused

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document


@pytest.fixture
def calibration(plain: Outcome, tmp_path: Path) -> Path:
    path = tmp_path / 'calibration.json'
    path.write_text(json_text(as_document(plain)), encoding='utf-8')
    return path


def test_to_stdout_and_to_a_file(run, calibration):
    printed = run('export', calibration, '--format', 'urdf')
    assert printed.status == 0 and printed.err == ''
    written = run('export', calibration, '--format', 'urdf', '--out', 'deep/arm.urdf')
    assert written.out.strip() == 'deep/arm.urdf'
    assert Path('deep/arm.urdf').read_text() == printed.out
    assert list(Path('deep').iterdir()) == [Path('deep/arm.urdf')]


def test_wrong_files_are_one_line(run, calibration):
    text = calibration.read_text()
    Path('damaged.json').write_text(json.dumps(json.loads(text) | {'model': None}))
    refused(run('export', 'damaged.json', '--format', 'header', '--out', 'arm.h'), 2, 'damaged')
    assert not Path('arm.h').exists()
    assert run('export', calibration, '--format', 'dh', '--out', calibration).status == 2
    assert calibration.read_text() == text


def test_a_device_is_not_replaced(run, calibration):
    os.mkfifo('pipe')
    refused(run('export', calibration, '--format', 'urdf', '--out', 'pipe'), 2, 'is a device or pipe')
    assert Path('pipe').is_fifo()


def test_tables_that_are_too_large_or_empty(run, calibration):
    table = ('export', calibration, '--format', 'csv', '--out', 'table.csv')
    refused(run(*table, '--step', '0.001'), 2, 'bound the region of the cell')
    refused(run(*table, '--force', '1e9'), 3, 'no place of the grid')
    assert not Path('table.csv').exists()


def test_any_name_of_a_file_makes_a_valid_comment(run, calibration):
    name = calibration.rename(calibration.with_name('a---b\n-->*.json'))
    for kind in ('urdf', 'dh', 'csv'):
        assert run('export', name, '--format', kind, '--out', f'arm.{kind}').status == 0
    ElementTree.parse('arm.urdf')
    assert Path('arm.dh').read_text().splitlines()[1].startswith('#')
