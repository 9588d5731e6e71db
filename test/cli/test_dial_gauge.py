"""The verb `dial-gauge`: tables in, tables and a page out, one line where something is wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cli.command import refused
from studies.gauge_table import dump_readings

from scara_kinetostatic.studies.paper.study import simulate_experiments

DIRECTIONS = np.radians([0, 60, 120]).tolist()
TABLE = dump_readings(simulate_experiments(directions=DIRECTIONS, seed=2))
ONE = 'force_N;displacement_um\n' + ''.join(
    f'{force};{37 * force + (60 if force > 0 else -60) + wobble}\n'
    for force, wobble in zip([10, 20, 30, 20, 10, -10, -20, -30, -20, -10] * 2, [1, 0, -2, 0, 2] * 4, strict=True)
)


def test_json_and_page_in_a_folder(run, tmp_path):
    (tmp_path / '<b>&$.csv').write_text(TABLE)
    result = run('dial-gauge', '<b>&$.csv', '--out', 'result')
    assert (result.status, result.err) == (0, '')
    assert 'Joint 1' in result.out and 'The gap depends on the direction' in result.out
    assert {path.name for path in (tmp_path / 'result').iterdir()} == {'dial_gauge.json', 'dial_gauge.html'}
    document = json.loads((tmp_path / 'result' / 'dial_gauge.json').read_text(encoding='utf-8'))
    assert document['schema'] == 'scara_kinetostatic/dial_gauge/1'
    joint = document['parts']['joint1']
    assert joint['compliance']['value'] == pytest.approx(3.23e-5, abs=5 * joint['compliance']['std'])
    assert joint['half_gap']['value'] == joint['gap']['value'] / 2
    assert joint['gap']['unit'] == 'rad'
    page = (tmp_path / 'result' / 'dial_gauge.html').read_text(encoding='utf-8')
    assert page.count('<svg') == 2 + 2 + 2
    assert '<b>' not in page and '&lt;b&gt;&amp;$.csv' in page


def test_options_say_what_the_table_does_not(run, tmp_path):
    (tmp_path / 'one.csv').write_text(ONE)
    gripper = json.loads(run('dial-gauge', 'one.csv', '--direction', '30', '--json').out)['parts']['gripper']
    assert gripper['runs'][0]['direction'] == pytest.approx(np.pi / 6)
    options = ['--part', 'joint2', '--lever', '0.5', '--json']
    joint = json.loads(run('dial-gauge', 'one.csv', *options).out)['parts']['joint2']
    assert joint['compliance']['value'] == pytest.approx(gripper['compliance']['value'] / 0.25)
    assert joint['gap']['value'] == pytest.approx(gripper['gap']['value'] / 0.5)


@pytest.mark.parametrize(
    ('text', 'options', 'status', 'message'),
    [
        (None, [], 2, 'one.csv: there is no such file'),
        (ONE, ['--part', 'joint1'], 2, 'one.csv: line 2: a joint needs its lever'),
        (ONE, ['one.csv'], 2, 'one.csv: is given twice'),
        (ONE, ['--part', 'joint2', '--lever', '330'], 2, 'it is in m, not mm: give 0.33'),
        ('force_N,displacement_m\n1,0\n-1,0\n', [], 3, 'too few'),
    ],
)
def test_what_is_wrong_is_one_line(run, tmp_path, text, options, status, message):
    if text is not None:
        (tmp_path / 'one.csv').write_text(text)
    refused(run('dial-gauge', 'one.csv', *options), status, message)
    assert not (tmp_path / 'result').exists()
