"""`contour` writes what the contract says, and refuses what is no slide with one line and no file."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cli.command import refused
from cli.conftest import CELL, SLOW
from conftest import page_left_out

from scara_kinetostatic.cli.main import main

SLIDE = '- {slide: {center: [0.2, 0.3], radius: 0.06}, force: 15, friction: 0.1, speed: 0.05, to: 1.05}\n'


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `cell.yaml`, `touches`, `slide`, and `result` with a calibration."""
    made = tmp_path_factory.mktemp('contour')
    (made / 'cell.yaml').write_text(CELL + 'tip: {radius: 0.005}\n')
    (made / 'slides.yaml').write_text(SLIDE)
    cell = ['--cell', str(made / 'cell.yaml')]
    assert main(['simulate', '--out', str(made / 'touches'), *SLOW, *cell]) == 0
    with page_left_out():
        assert main(['calibrate', str(made / 'touches'), '--out', str(made / 'result')]) == 0
    slides = ['--plan', str(made / 'slides.yaml'), '--seed', '3']
    assert main(['simulate', '--out', str(made / 'slide'), *slides, *cell]) == 0
    return made


def test_files_and_text(folder, run):
    calibration = folder / 'result' / 'calibration.json'
    result = run('contour', folder / 'slide', '--calibration', calibration, '--fit', 'circle', '--out', 'made')
    assert (result.status, result.err) == (0, '')
    assert result.out.startswith('Closed outline of 377.')
    assert 'Outline 1: circle' in result.out
    assert sorted(path.suffix for path in Path('made').iterdir()) == ['.csv', '.dxf', '.html', '.svg']
    with Path('made/contour.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ['time_s', 'x_m', 'y_m', 'nx', 'ny', 'std_normal_m', 'force_N']
    x, y, std = (np.array([float(row[name]) for row in rows]) for name in ('x_m', 'y_m', 'std_normal_m'))
    error = np.hypot(x - 0.2, y - 0.3) - 0.06
    assert np.sqrt(np.mean(error**2)) < 2 * np.sqrt(np.mean(std**2)) < 2e-5
    assert '<svg' in Path('made/contour.html').read_text()


def test_another_tip(folder, run):
    more = ['--calibration', folder / 'result' / 'calibration.json', '--fit', 'circle']
    result = run('contour', folder / 'slide', *more, '--tip-radius', '0.004', '--json', '--out', 'made')
    document = json.loads(result.out)
    assert document['outlines'][0]['closed'] is True
    assert document['fits'][0]['values']['radius']['value'] == pytest.approx(0.061, abs=2e-5)


@pytest.mark.parametrize(
    ('bag', 'calibration', 'status', 'message'),
    [
        ('nothing', 'result/calibration.json', 2, 'nothing'),
        ('slide', 'cell.yaml', 2, 'cell.yaml'),
        ('touches', 'result/calibration.json', 3, 'the tip does not slide'),
    ],
)
def test_wrong_files(folder, run, bag, calibration, status, message):
    result = run('contour', folder / bag, '--calibration', folder / calibration, '--out', 'made')
    refused(result, status, message)
    assert not Path('made').exists()


def test_a_sensor_in_another_frame_is_refused(folder, run):
    text = (folder / 'cell.yaml').read_text().replace('frame: base, sign: on_object', 'frame: tool, sign: on_robot')
    Path('cell.yaml').write_text(text)
    slide = (folder / 'slide', '--calibration', folder / 'result' / 'calibration.json')
    refused(run('contour', *slide, '--cell', 'cell.yaml', '--out', 'made'), 3, 'the force is not across the motion')
    assert not Path('made').exists()
    refused(run('contour', *slide, '--out', 'made', '--tip-radius', '5'), 2, 'tip: expected 0 to 0.1 m, got 5')


def test_another_robot_is_refused(folder, run):
    calibration = folder / 'result' / 'calibration.json'
    document = json.loads(calibration.read_text())
    document['cell']['identification'] = {'robot': 'A 1'}
    Path('calibration.json').write_text(json.dumps(document))
    Path('cell.yaml').write_text((folder / 'cell.yaml').read_text() + 'identification: {robot: B 77}\n')
    result = run('contour', folder / 'slide', '--calibration', 'calibration.json', '--cell', 'cell.yaml', '--out', 'x')
    assert result.status == 2 and "is of robot 'B 77'" in result.err


def test_pieces_and_a_fit_that_is_not_possible(folder, run):
    (folder / 'two.yaml').write_text(
        '- {slide: {outline: [[0.10, 0.30], [0.20, 0.30], [0.20, 0.40]], closed: false}, speed: 0.05}\n'
        '- {slide: {outline: [[-0.20, 0.40], [-0.20, 0.3965]], closed: false}, speed: 0.03}\n'
    )
    cell = ['--cell', folder / 'cell.yaml']
    assert run('simulate', '--plan', folder / 'two.yaml', '--out', 'two', *cell).status == 0
    more = ['--fit', 'pieces', '--fit', 'line', '--out', 'made']
    result = run('contour', 'two', '--calibration', folder / 'result' / 'calibration.json', *more, '--json')
    assert result.status == 0
    document = json.loads(result.out)
    assert [(fit['shape'], fit['piece']) for fit in document['fits'][:2]] == [('line', 0), ('line', 1)]
    assert len(document['outlines']) == 2
    assert any('no line through outline 2' in warning for warning in document['warnings'])
    assert 'Outline 1: line' in Path('made/contour.html').read_text()
