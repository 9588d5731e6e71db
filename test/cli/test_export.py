"""The verb `export`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cli.command import Run, refused

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.report.json_file import json_text
from scara_kinetostatic.results.calibration_json import as_document


@pytest.fixture
def calibration(plain: Outcome, tmp_path: Path) -> Path:
    path = tmp_path / 'calibration.json'
    path.write_text(json_text(as_document(plain)), encoding='utf-8')
    return path


def test_to_stdout_and_to_a_file(run: Run, calibration: Path) -> None:
    printed = run('export', calibration, '--format', 'urdf')
    assert printed.status == 0 and printed.err == ''
    written = run('export', calibration, '--format', 'urdf', '--out', 'deep/arm.urdf')
    assert written.out.strip() == 'deep/arm.urdf'
    assert Path('deep/arm.urdf').read_text() == printed.out
    assert list(Path('deep').iterdir()) == [Path('deep/arm.urdf')]


@pytest.mark.parametrize(
    ('change', 'words'), [({'schema': 'scara_kinetostatic/calibration/2'}, 'schema'), ({'model': None}, 'damaged')]
)
def test_another_file_is_one_line(run: Run, calibration: Path, change: dict[str, object], words: str) -> None:
    document = json.loads(calibration.read_text())
    calibration.write_text(json.dumps(document | change))
    refused(run('export', calibration, '--format', 'header', '--out', 'arm.h'), 2, words)
    assert not Path('arm.h').exists()


def test_the_input_is_not_replaced(run: Run, calibration: Path) -> None:
    assert run('export', calibration, '--format', 'dh', '--out', calibration).status == 2
    assert json.loads(calibration.read_text())['schema']
    assert run('export', calibration, '--format', 'dh', '--out', calibration.parent).status == 2
    assert run('export', 'none.json', '--format', 'dh').status == 2


def test_a_device_is_not_replaced(run: Run, calibration: Path) -> None:
    os.mkfifo('pipe')
    refused(run('export', calibration, '--format', 'urdf', '--out', 'pipe'), 2, 'is a device or pipe')
    assert Path('pipe').is_fifo()


@pytest.mark.parametrize(
    ('options', 'status', 'words'),
    [
        (['--step', '0.001'], 2, 'bound the region of the cell'),
        (['--step', '2'], 3, 'no place of the grid'),
        (['--force', '1e9'], 3, 'no place of the grid'),
    ],
)
def test_tables_that_are_too_large_or_empty(
    run: Run, calibration: Path, options: list[str], status: int, words: str
) -> None:
    refused(run('export', calibration, '--format', 'csv', '--out', 'table.csv', *options), status, words)
    assert not Path('table.csv').exists()


def test_any_name_of_a_file_makes_a_valid_comment(run: Run, calibration: Path) -> None:
    name = calibration.rename(calibration.with_name('a---b\n-->*.json'))
    for kind in ('urdf', 'dh', 'csv'):
        assert run('export', name, '--format', kind, '--out', f'arm.{kind}').status == 0
    ElementTree.parse('arm.urdf')
    assert Path('arm.dh').read_text().splitlines()[1].startswith('#')
