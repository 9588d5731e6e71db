"""`calibrate` and `inspect` with tables of touches, and the table of residuals."""

from __future__ import annotations

import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis.simulated import CELL, MORE, effect, simulate

from benchmark.common import dump_touch_table
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.files.cell_file import dump_cell, load_cell
from scara_kinetostatic.files.tables import TouchTable, load_touch_table
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import gather_touches
from scara_kinetostatic.touches.detection import cell_of_files

pytestmark = pytest.mark.usefixtures('without_page')
UNDIAGNOSED = pytest.mark.usefixtures('undiagnosed')

TOUCHES = simulate((effect('object_radius[disc_2]'), (6e-5,)), plan=MORE)


def as_table(touches: TouchSet, named: bool = True) -> TouchTable:
    names = tuple(CELL.discs[disc].name if named else '' for disc in touches.disc)
    return TouchTable(touches.joints, touches.force, names, touches.time, touches.approach, (), '')


def write(path: Path, touches: TouchSet, named: bool = True) -> str:
    path.write_text(dump_touch_table(as_table(touches, named)), encoding='utf-8')
    return str(path)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A table, the same without names of the objects, and the cell."""
    folder = tmp_path_factory.mktemp('tables')
    write(folder / 'touches.csv', TOUCHES)
    write(folder / 'unnamed.csv', TOUCHES, named=False)
    for name, frame in (('cell', SensorFrame.BASE), ('tool', SensorFrame.TOOL)):
        cell = replace(CELL, sensor=CELL.sensor._replace(frame=frame))
        (folder / f'{name}.yaml').write_text(dump_cell(cell), encoding='utf-8')
    return folder


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def document(folder: Path) -> dict:
    return json.loads((folder / 'calibration.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def result(folder):
    """The calibration of the table, with its residuals."""
    out = folder / 'result'
    options = ('--cell', folder / 'cell.yaml', '--out', out, '--residuals', out / 'deep' / 'residuals.csv')
    assert run('calibrate', folder / 'touches.csv', *options) == 0
    return document(out)


def test_a_table_is_calibrated_and_diagnosed(result, folder):
    digest = hashlib.sha256((folder / 'touches.csv').read_bytes()).hexdigest()
    assert result['recordings'] == [{'path': str(folder / 'touches.csv'), 'sha256': digest, 'start': None}]
    assert [result['touches'][key] for key in ('found', 'used', 'rejected')] == [108, 108, []]
    assert [found['name'] for found in result['diagnosis']['effects']] == ['object_radius']
    radius = result['diagnosis']['effects'][0]['parameters']['radius']
    assert abs(radius['value'] - 6e-5) < 4 * radius['std']
    for name, about in result['parameters'].items():
        assert abs(about['value'] - getattr(PAPER_ACTUAL, name)) < 4.5 * about['std'], name


def test_one_row_of_residuals_per_touch(result, folder):
    text = (folder / 'result' / 'deep' / 'residuals.csv').read_text(encoding='utf-8')
    rows = list(csv.DictReader(text.splitlines()))
    assert [int(row['index']) for row in rows] == list(range(108))
    assert [row['object'] for row in rows] == [CELL.discs[disc].name for disc in TOUCHES.disc]
    assert {row['posture'] for row in rows} == {'left', 'right'}
    numbers = {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name[-2:] == '_N'}
    np.testing.assert_array_equal(numbers['fx_N'], TOUCHES.force[:, 0])
    for model in ('calibrated', 'extended'):
        for axis in 'xy':
            residual = numbers[f'f{axis}_N'] - numbers[f'f{axis}_{model}_N']
            found = numbers[f'residual_{axis}_{model}_N']
            np.testing.assert_allclose(found, residual, rtol=0, atol=0.05)  # the sensor's own errors
        used = np.array([row['used'] == '1' for row in rows])
        error = np.hypot(*(numbers[f'residual_{axis}_{model}_N'][used] for axis in 'xy')).mean()
        assert error == pytest.approx(result['force_error'][model], rel=1e-9)
    assert all(float(row['standardized_distance_extended']) > 0 and not row['reason'] for row in rows)


def test_without_names_the_objects_are_found_and_the_frame_of_the_sensor_does_not_matter(folder):
    """The same touches, and so the same calibration."""
    cells = [load_cell(folder / f'{name}.yaml') for name in ('cell', 'tool')]
    cells[1] = cell_of_files(cells[1], [folder / 'unnamed.csv'])
    tables = (folder / 'touches.csv', folder / 'unnamed.csv')
    named, unnamed = (gather_touches([table], cell).touches for table, cell in zip(tables, cells, strict=True))
    assert cells[0] == cells[1]
    for one, other in ((named.joints, unnamed.joints), (named.force, unnamed.force), (named.disc, unnamed.disc)):
        np.testing.assert_array_equal(one, other)


def test_forces_in_the_tool_frame_are_turned_as_the_angles_are_estimated(result, folder, tmp_path):
    """What is estimated is that of the same forces in the base frame, whatever the cell says of its sensor."""
    table = tmp_path / 'tool.csv'
    angle = TOUCHES.joints.sum(axis=1) + PAPER_ACTUAL.theta1 + PAPER_ACTUAL.theta2
    force = np.stack([rotate(f, -a) for f, a in zip(TOUCHES.force, angle, strict=True)])
    turned = SensorFrame.TOOL.to_base(force, TOUCHES.joints, PAPER_ACTUAL)
    np.testing.assert_allclose(turned, TOUCHES.force, atol=1e-9)
    rows = map(','.join, np.column_stack([TOUCHES.joints, force]).astype(str).tolist())
    table.write_text('\n'.join(['q1_rad,q2_rad,fx_tool_N,fy_tool_N', *rows]), encoding='utf-8')
    assert run('calibrate', table, '--cell', folder / 'cell.yaml', '--out', tmp_path / 'out') == 0
    found = document(tmp_path / 'out')
    assert found['touches']['used'] == result['touches']['used'] == 108
    for key, about in found['parameters'].items():
        assert abs(about['value'] - getattr(PAPER_ACTUAL, key)) < 4.5 * about['std'], key
    cells = [cell_of_files(load_cell(folder / f'{name}.yaml'), [table]) for name in ('cell', 'tool')]
    assert cells[0] == cells[1]


@UNDIAGNOSED
def test_a_table_with_rows_of_nan_is_calibrated_and_they_are_said(folder, tmp_path, capsys):
    lines = (folder / 'touches.csv').read_text(encoding='utf-8').splitlines()
    (tmp_path / 'a.csv').write_text('\n'.join([*lines, *['nan,nan,nan,nan'] * 100]), encoding='utf-8')
    assert run('calibrate', tmp_path / 'a.csv', '--cell', folder / 'cell.yaml', '--out', tmp_path / 'out') == 0
    said = 'not finite: 100 of 208 rows, line 110, 111, 112, 113, 114, 115, 116, 117 and 92 more; not used'
    assert said in ' '.join(capsys.readouterr().out.split())
    assert document(tmp_path / 'out')['touches']['found'] == 108


def test_tables_in_both_frames_are_not_calibrated_together(folder, tmp_path, capsys):
    text = (folder / 'unnamed.csv').read_text(encoding='utf-8')
    (tmp_path / 'tool.csv').write_text(text.replace('fx_N,fy_N', 'fx_tool_N,fy_tool_N'), encoding='utf-8')
    tables, out = (folder / 'unnamed.csv', tmp_path / 'tool.csv'), tmp_path / 'out'
    assert run('calibrate', *tables, '--cell', folder / 'cell.yaml', '--out', out) == 2
    assert f'a table has its forces in the base frame, {tables[1]} in the tool frame' in capsys.readouterr().err
    assert run('calibrate', tables[1], '--cell', folder / 'cell.yaml', '--out', out) == 2
    assert 'name the columns fx_N and fy_N' in capsys.readouterr().err
    mistaken = tmp_path / 'mistaken.csv'
    angle = TOUCHES.joints.sum(axis=1)
    force = np.stack([rotate(f, -a) for f, a in zip(TOUCHES.force, angle, strict=True)])
    write(mistaken, replace(TOUCHES, force=force), named=False)
    assert run('calibrate', mistaken, '--cell', folder / 'cell.yaml', '--out', out) == 2
    assert 'name the columns fx_tool_N and fy_tool_N' in capsys.readouterr().err


@UNDIAGNOSED
def test_a_touch_of_nothing_is_rejected_and_stands_among_the_residuals(folder, tmp_path, capsys):
    joints = np.vstack([TOUCHES.joints, [[0.0, 0.1]]])
    force = np.vstack([TOUCHES.force, [[20.0, 0.0]]])
    strange = TouchSet(joints, force, np.append(TOUCHES.disc, 0), np.append(TOUCHES.posture, 1))
    table = write(tmp_path / 'strange.csv', strange, named=False)
    residuals = tmp_path / 'residuals.csv'
    options = ('--cell', folder / 'cell.yaml', '--out', tmp_path / 'out', '--residuals', residuals)
    assert run('calibrate', table, *options) == 0
    last = list(csv.DictReader(residuals.read_text(encoding='utf-8').splitlines()))[-1]
    assert (last['index'], last['used'], last['q1_rad']) == ('108', '0', '')
    assert last['reason'].startswith('no object there; the nearest, ')
    back = load_touch_table(residuals)
    np.testing.assert_array_equal(back.joints, TOUCHES.joints)
    np.testing.assert_array_equal(back.force, TOUCHES.force)
    assert back.objects == as_table(TOUCHES).objects
    assert any("'fx_calibrated_N'" in note for note in back.notes)
    assert 'line 110: no joint angles and no force; not used' in back.notes
    capsys.readouterr()
    assert run('inspect', table, '--cell', folder / 'cell.yaml', '--json') == 0
    found = json.loads(capsys.readouterr().out)
    assert (found['topics'], [touch['accepted'] for touch in found['touches']]) == ([], [True] * 108 + [False])
    assert found['touches'][0]['object'] == 'disc_1'
    assert found['touches'][0]['force'] == pytest.approx(TOUCHES.force[0].tolist())


@pytest.mark.parametrize(
    ('change', 'status', 'message'),
    [
        (lambda table: table._replace(objects=('disc_9', *table.objects[1:])), 2, "the cell has no object 'disc_9'"),
        (lambda table: table._replace(objects=('',) * 54, joints=table.joints + 9), 3, 'no object there'),
        (lambda table: table._replace(force=0.02 * table.force), 3, 'check the units and the order of joint angles'),
    ],
)  # fmt: skip
@UNDIAGNOSED
def test_wrong_tables_leave_nothing_behind(folder, tmp_path, capsys, change, status, message):
    path = tmp_path / 'wrong.csv'
    path.write_text(dump_touch_table(change(as_table(TOUCHES.select(np.arange(108) % 2 == 0)))), encoding='utf-8')
    out, residuals = tmp_path / 'out', tmp_path / 'residuals.csv'
    options = ('--cell', folder / 'cell.yaml', '--out', out, '--residuals', residuals)
    assert run('calibrate', path, *options) == status
    shown = capsys.readouterr().err.strip().splitlines()[-1]
    assert message in shown and 'wrong.csv' in shown
    assert not out.exists() and not residuals.exists()


@UNDIAGNOSED
def test_neither_an_input_nor_a_result_is_replaced(folder, tmp_path, capsys):
    cell, out, bag = tmp_path / 'cell.csv', tmp_path / 'out.csv', tmp_path / 'bag'
    text = (folder / 'cell.yaml').read_text(encoding='utf-8')
    cell.write_text(text, encoding='utf-8')
    bag.mkdir()
    (tmp_path / 'link.csv').symlink_to(cell)
    (tmp_path / 'result.csv').symlink_to(out / 'calibration.json')
    table = Path(write(tmp_path / 'residuals.csv', TOUCHES))
    for place, message in (
        (table, 'is an input and would be replaced'),
        (cell, 'is an input and would be replaced'),
        (tmp_path / 'link.csv', 'is an input and would be replaced'),
        (bag / 'residuals.csv', 'is inside the input'),
        (tmp_path / 'residuals.yaml', 'expected a file name that ends in .csv'),
        (tmp_path / 'result.csv', 'is a result and would be replaced'),
        (out, 'is a result and would be replaced'),
    ):
        assert run('calibrate', table, bag, '--cell', cell, '--out', out, '--residuals', place) == 2
        assert message in capsys.readouterr().err
    for options, message in (
        (('--cell', cell, '--out', out, '--residuals', folder), 'is a folder where a file is to be written'),
        (('--cell', cell, '--out', tmp_path), 'is an input and would be replaced by the result'),
        (('--out', out), 'a table contains no cell description; give one by --cell'),
    ):
        assert run('calibrate', table, *options) == 2
        assert message in capsys.readouterr().err
    assert cell.read_text(encoding='utf-8') == text
    assert not out.exists()
    assert list(bag.iterdir()) == []


def test_recordings_in_the_tool_frame_are_not_mixed_with_tables(folder, tmp_path, capsys):
    bag = tmp_path / 'bag'
    options = ('--per-disc', 3, '--joint-rate', 20, '--wrench-rate', 25)
    assert run('simulate', '--cell', folder / 'tool.yaml', '--out', bag, *options) == 0
    both = (folder / 'touches.csv', bag, '--cell', folder / 'tool.yaml', '--out', tmp_path / 'out')
    assert run('calibrate', *both) == 2
    assert 'calibrate the tables and the recordings separately' in capsys.readouterr().err


@UNDIAGNOSED
def test_touches_are_left_out_on_request(folder, tmp_path, capsys):
    options = ('--cell', folder / 'cell.yaml', '--out', tmp_path / 'result')
    left_out = ('--leave-out', '3', '--leave-out', '5-6')
    assert run('calibrate', folder / 'touches.csv', *options, *left_out) == 0
    rejected = document(tmp_path / 'result')['touches']['rejected']
    assert [item['index'] for item in rejected if item['reason'] == 'left out on request'] == [3, 5, 6]
    assert run('calibrate', folder / 'touches.csv', *options, '--leave-out', '9-7') == 2
    assert '--leave-out: 9-7: expected a range of touches such as 10-14' in capsys.readouterr().err
    assert run('calibrate', folder / 'touches.csv', *options, '--leave-out', '0-107') == 3
    assert 'touches can be used: left out on request; keep some\n' in capsys.readouterr().err
