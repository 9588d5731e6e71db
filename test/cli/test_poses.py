"""`compensate` and `locate`: tables in, tables out."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cli.command import refused
from cli.conftest import SLOW

from scara_kinetostatic.cli.compensate import metadata_of
from scara_kinetostatic.files.calibration_file import load_calibration, load_predictor
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.tables import STATES, load_pose_table, load_touch_table
from scara_kinetostatic.interface import compensate
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.pipeline import gather_touches
from scara_kinetostatic.touches.detection import touches_of_table

POSES = """\
x_m,y_m,fx_N,fy_N,elbow,id
0.30,0.20,0.0,30.0,right,a
-0.2,0.35,-12.5,4.0,left,"b, c"
-0.2,-0.3,0,0,right,c
0.9,0.0,10,0,left,d
0.3,0.2,0,90,right,e
"""
RESULTS = ['q1_rad', 'q2_rad', 'c1_Nm', 'c2_Nm', 'std_normal_m', 'status']
PLACES = ['x_m', 'y_m', 'std_x_m', 'std_y_m', 'cov_xy_m2', 'status']


@pytest.fixture
def result(results: Path) -> Path:
    """The folder of a calibration."""
    return results / 'a'


def rows(path: str) -> list[dict[str, str]]:
    with Path(path).open(newline='') as stream:
        return list(csv.DictReader(stream))


def test_the_pose_to_command_brings_the_nominal_arm_to_the_compensated_angles(run, result):
    Path('poses.csv').write_text(POSES)
    assert run('compensate', result / 'calibration.json', 'poses.csv', '--out', 'c.csv', '--command').status == 0
    p = load_calibration(result / 'calibration.json').cell.nominal
    for row in rows('c.csv'):
        if row['q1_rad'] == 'nan':
            assert row['x_command_m'] == row['phi_command_rad'] == 'nan'
            continue
        x, y, phi = (float(row[f'{name}_command_{unit}']) for name, unit in (('x', 'm'), ('y', 'm'), ('phi', 'rad')))
        # the controller's own inverse kinematics, by the law of cosines and the elbow of the row
        x, y = x - p.x0, y - p.y0
        bend = np.arccos((x * x + y * y - p.l1**2 - p.l2**2) / (2 * p.l1 * p.l2)) * (
            1 if row['elbow'] == 'left' else -1
        )
        first = np.arctan2(y, x) - np.arctan2(p.l2 * np.sin(bend), p.l1 + p.l2 * np.cos(bend))
        turns = [(first - p.theta1 - float(row['q1_rad'])), (bend - p.theta2 - float(row['q2_rad']))]
        assert np.abs(np.sin(np.array(turns) / 2)).max() < 5e-10
        assert abs(np.sin((first + bend - phi) / 2)) < 5e-10


def test_there_and_back(run, result):
    Path('poses.csv').write_text(POSES)
    found = run('compensate', result / 'calibration.json', 'poses.csv', '--out', 'deep/commands.csv')
    assert (found.status, found.err) == (0, '')
    assert '5 rows: 2 ok, 1 unloaded, 1 extrapolated, 1 out_of_reach' in found.out
    commands = rows('deep/commands.csv')
    assert list(commands[0]) == ['x_m', 'y_m', 'fx_N', 'fy_N', 'elbow', 'id', *RESULTS]
    assert [row['status'] for row in commands] == ['ok', 'ok', 'unloaded', 'out_of_reach', 'extrapolated']
    assert [row['id'] for row in commands] == ['a', 'b, c', 'c', 'd', 'e']
    assert (commands[0]['x_m'], commands[3]['q1_rad']) == ('0.30', 'nan')
    assert (commands[2]['c1_Nm'], commands[2]['c2_Nm']) == ('0.0', '0.0')
    assert 0 < float(commands[0]['std_normal_m']) < 1e-4
    reached = [row for row in commands if row['q1_rad'] != 'nan']
    Path('states.csv').write_text(
        'q1_rad,q2_rad,fx_N,fy_N\n'
        + ''.join(','.join(row[name] for name in ('q1_rad', 'q2_rad', 'fx_N', 'fy_N')) + '\n' for row in reached)
    )
    assert run('locate', result / 'calibration.json', 'states.csv', '--out', 'places.csv').err == ''
    places = rows('places.csv')
    assert list(places[0]) == ['q1_rad', 'q2_rad', 'fx_N', 'fy_N', *PLACES]
    for place, wanted in zip(places, reached, strict=True):
        assert float(place['x_m']) == pytest.approx(float(wanted['x_m']), abs=1e-12)
        assert float(place['y_m']) == pytest.approx(float(wanted['y_m']), abs=1e-12)
    directly = run('locate', result / 'calibration.json', 'deep/commands.csv', '--out', 'again.csv')
    assert directly.status == 2
    assert 'line 5: q1_rad: expected a number' in directly.err


def test_poses_beyond_the_limits_are_marked(run, recordings):
    limits = '  limits: {joint1: [1.3, 6.0], joint2: [-2.5, 2.5]}\n'
    Path('cell.yaml').write_text((recordings / 'cell.yaml').read_text().replace('objects:', limits + 'objects:'))
    Path('poses.csv').write_text(POSES)
    found = run('compensate', 'cell.yaml', 'poses.csv', '--out', 'commands.csv')
    assert '5 rows: 2 ok, 1 unloaded, 1 out_of_reach, 1 beyond_limits' in found.out
    commands = rows('commands.csv')
    assert [row['status'] for row in commands] == ['ok', 'beyond_limits', 'unloaded', 'out_of_reach', 'ok']
    assert float(commands[1]['q1_rad']) < 1.3
    assert 1.3 < float(commands[2]['q1_rad']) < 6.0  # in the turn of the limits
    Path('poses.csv').write_text('x_m,y_m,fx_N,fy_N\n-0.2,0.35,-12.5,4.0\n')
    message = 'reach of the arm, and within robot.limits; choose other places, or the other elbow\n'
    refused(run('compensate', 'cell.yaml', 'poses.csv', '--out', 'commands.csv'), 3, message)


def test_rigid_and_nominal(run, result):
    Path('states.csv').write_text('q1_rad;q2_rad;fx_N;fy_N\n0,4;1,1;20;-30\n')
    tips = []
    for options in ((), ('--rigid',), ('--nominal',), ('--nominal', '--rigid')):
        assert run('locate', result / 'calibration.json', 'states.csv', '--out', 'x.csv', *options).status == 0
        (row,) = rows('x.csv')
        tips.append((float(row['x_m']), float(row['y_m'])))
        assert (row['std_x_m'] == 'nan') == ('--nominal' in options)
        assert row['status'] == 'ok'
    nominal = 0.33 * np.array([np.cos(0.4) + np.cos(1.5), np.sin(0.4) + np.sin(1.5)])
    np.testing.assert_allclose(tips[3], nominal, rtol=0, atol=1e-12)
    assert 3e-4 < np.hypot(*np.subtract(tips[0], tips[1])) < 2e-3
    assert 1e-3 < np.hypot(*np.subtract(tips[1], tips[3])) < 1e-2
    assert 1e-4 < np.hypot(*np.subtract(tips[2], tips[3])) < 1e-3


def test_columns_of_a_spreadsheet_stay_in_their_places(run, result):
    table = '"Force, x";q1_rad;q2_rad;fx_N;fy_N;id;id;;\r\n a;0,4;1,1;\N{MINUS SIGN}20;-30;b;c;;\r\n\r\n'
    Path('states.csv').write_text(table, encoding='utf-8')
    assert run('locate', result / 'calibration.json', 'states.csv', '--out', 'x.csv').err == ''
    with Path('x.csv').open(newline='') as stream:
        heading, row = csv.reader(stream)
    assert heading == ['Force, x', 'q1_rad', 'q2_rad', 'fx_N', 'fy_N', 'id', 'id', *PLACES]
    assert row[:7] == [' a', '0.4', '1.1', '-20', '-30', 'b', 'c']
    assert (len(row), row[-1]) == (len(heading), 'ok')


def test_a_drive_reports_and_is_commanded_in_its_own_angles(run, recordings, without_page):
    """Joint 1 turns the other way, and the reading of joint 2 contains 0.25 of it."""
    stated = '[joint1, joint2]\n  direction: [-1, 1]\n  coupling: 0.25'
    Path('cell.yaml').write_text((recordings / 'cell.yaml').read_text().replace('[joint1, joint2]', stated))
    assert run('simulate', '--cell', 'cell.yaml', '--out', 'bag', '--per-disc', 6, '--plain', *SLOW).status == 0
    assert run('calibrate', 'bag', '--cell', 'cell.yaml', '--out', 'result').status == 0
    values = json.loads(Path('result/calibration.json').read_text())['parameters']
    for name in NAMES:
        assert abs(values[name]['value'] - getattr(PAPER_ACTUAL, name)) < 4.5 * values[name]['std']
    cell = load_cell('cell.yaml')
    touches, again = (gather_touches([source], cell).touches for source in ('bag', 'result/residuals.csv'))
    np.testing.assert_allclose(again.joints, touches.joints, rtol=0, atol=1e-12)
    Path('poses.csv').write_text('x_m,y_m,fx_N,fy_N\n-0.2,0.35,-12.5,4\n')
    assert run('compensate', 'result/calibration.json', 'poses.csv', '--out', 'commands.csv').status == 0
    (command,) = rows('commands.csv')
    q1, q2 = float(command['q1_rad']), float(command['q2_rad'])
    found = compensate(load_calibration('result/calibration.json'), [-0.2, 0.35], [-12.5, 4.0])
    ((angle1, angle2),), (torques,) = found.joints, found.torques
    assert (q1, q2) == pytest.approx((-angle1, angle2 - 0.25 * angle1), abs=1e-12)
    assert np.sign(float(command['c1_Nm'])) == -np.sign(float(torques[0]))
    Path('states.csv').write_text(f'q1_rad,q2_rad,fx_N,fy_N\n{q1!r},{q2!r},-12.5,4\n')
    assert run('locate', 'result/calibration.json', 'states.csv', '--out', 'places.csv').status == 0
    (place,) = rows('places.csv')
    assert (float(place['x_m']), float(place['y_m'])) == pytest.approx((-0.2, 0.35), abs=1e-12)


@pytest.mark.parametrize(('given', 'taken'), [('1e-3,1e-4', (1e-3, -1.5e-4)), ('1,-1', (1.0, -1.0))])
def test_the_last_movements_of_a_coupled_drive_are_those_of_its_angles(recordings, tmp_path, given, taken):
    plain, cell = (recordings / 'cell.yaml').read_text(), tmp_path / 'cell.yaml'
    cell.write_text(plain.replace('[joint1, joint2]', '[joint1, joint2]\n  coupling: 0.25'))
    table = tmp_path / 'states.csv'
    table.write_text(f'q1_rad,q2_rad,fx_N,fy_N,approach1,approach2\n0.4,1.1,20,-30,{given}\n')
    state = metadata_of(load_pose_table(table, STATES), np.ones(1, dtype=np.intp), load_predictor(cell))
    np.testing.assert_allclose(state.approach, [taken], rtol=1e-12)
    touch = touches_of_table(load_touch_table(table), load_cell(cell)).held
    np.testing.assert_allclose(touch.approach, [taken], rtol=1e-12)


def test_what_is_to_be_known_is_said(run, result):
    document = json.loads((result / 'calibration.json').read_text())
    document['assessment']['grade'], document['diagnosis']['verdict'] = 'unfit', 'unexplained'
    Path('unfit.json').write_text(json.dumps(document))
    Path('poses.csv').write_text('x_m,y_m,fx_N,fy_N,status\n-0.2,0.35,-12.5,4,old\n')
    found = run('compensate', 'unfit.json', 'poses.csv', '--out', 'x.csv')
    assert found.status == 0
    assert found.err.splitlines() == [
        'note: the calibration is unfit for use; its calibration.json says why (assessment.reasons)',
        'note: the calibration has a model error of unknown cause; the uncertainty does not cover it',
        'note: poses.csv: replaced by results: status',
        'note: poses.csv: no column elbow; left is taken for all rows',
    ]
    assert rows('x.csv')[0]['status'] == 'ok'


@pytest.mark.parametrize(
    ('table', 'status', 'message'),
    [
        ('x_m,y_m,fx_N,fy_N\n9,9,0,0\n', 3, 'no pose is within reach of the arm; check the unit in the heading'),
        ('x_m,y_m,fx_N,fy_N,elbow\n0.3,0.2,0,0,up\n', 2, 'elbow: expected left or right'),
    ],
)  # fmt: skip
def test_wrong_tables_are_one_line_and_leave_nothing(run, result, table, status, message):
    Path('poses.csv').write_text(table)
    Path('out').mkdir()
    refused(run('compensate', result / 'calibration.json', 'poses.csv', '--out', 'out/x.csv'), status, message)
    assert list(Path('out').iterdir()) == []


@pytest.mark.parametrize('verb', ['compensate', 'locate'])
def test_wrong_places(run, result, verb):
    calibration = result / 'calibration.json'
    Path('t.csv').write_text('x_m,y_m,q1_rad,q2_rad,fx_N,fy_N\n0.3,0.2,0.4,1.1,0,0\n')
    for arguments, message in (
        ((calibration, 't.csv', '--out', 't.csv'), 'is an input'),
        ((calibration, 't.csv', '--out', 'x.txt'), 'ends in .csv'),
        ((calibration, 't.csv', '--out', '.'), 'is a folder'),
        ((calibration, 'none.csv', '--out', 'x.csv'), 'no such file'),
        ((result, 't.csv', '--out', 'x.csv'), 'expected a file of JSON, got a folder'),
        ((calibration, 't.csv'), '--out'),
    ):
        refused(run(verb, *arguments), 2, message)
    assert sorted(path.name for path in Path().iterdir()) == ['t.csv']
