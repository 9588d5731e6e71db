"""The verb `export`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.command import Run

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.render.json_file import json_text
from scara_kinetostatic.report.document import as_document


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
    ('change', 'words'),
    [
        ({'schema': 'scara_kinetostatic/calibration/2'}, 'schema'),
        ({'schema': None}, 'schema'),
        ({'model': None}, 'damaged'),
    ],
)
def test_another_file_is_one_line(run: Run, calibration: Path, change: dict[str, object], words: str) -> None:
    document = json.loads(calibration.read_text())
    calibration.write_text(json.dumps(document | change))
    result = run('export', calibration, '--format', 'header', '--out', 'arm.h')
    assert result.status == 2 and result.out == ''
    assert result.err.count('\n') == 1 and words in result.err
    assert not Path('arm.h').exists()


def test_the_input_is_not_replaced(run: Run, calibration: Path) -> None:
    assert run('export', calibration, '--format', 'dh', '--out', calibration).status == 2
    assert json.loads(calibration.read_text())['schema']
    assert run('export', calibration, '--format', 'dh', '--out', calibration.parent).status == 2
    assert run('export', 'none.json', '--format', 'dh').status == 2
