"""The verbs `verify` and `compare`."""

from __future__ import annotations

import json
from functools import reduce
from operator import getitem
from pathlib import Path

import pytest
from cli.command import refused
from cli.conftest import SLOW

TOLERANCE = 'tolerance: {tip: 0.004}\n'


def test_verify(run, recordings, results):
    done = run('verify', recordings / 'plain', '--calibration', results / 'a' / 'calibration.json', '--strict')
    assert done.status == 0 and done.err == ''
    assert done.out.startswith('Confirmed, no tolerance stated: 36 touches agree with the calibration')
    document = json.loads(Path('verification/verification.json').read_text())
    assert document['grade'] == 'fit' and document['independent']
    assert 0 < document['tip_error'] < 2 * document['expected'] < 1e-4 and document['p_value'] > 1e-3
    assert '<svg' in Path('verification/verification.html').read_text()
    seen = run('verify', recordings / 'good', '--calibration', results / 'a' / 'calibration.json', '--json')
    assert json.loads(seen.out)['grade'] == 'caution'
    assert json.loads(seen.out)['recordings'][0]['part_of_calibration'] is True


def test_verify_a_changed_robot(run, recordings, results):
    path = results / 'a' / 'calibration.json'
    document = json.loads(path.read_text())
    place = document['model']['names'].index('l1')
    for key in ('model', 'covariance_with_cell'):
        document[key]['values'][place] += 4e-4
    document['parameters']['l1']['value'] += 4e-4
    Path('changed.json').write_text(json.dumps(document))
    strict = run('verify', recordings / 'plain', '--calibration', 'changed.json', '--strict')
    assert strict.status == 3 and strict.err.count('\n') == 1
    assert 'Not fit for use' in strict.out and 'link 1 changed its length' in strict.out
    written = json.loads(Path('verification/verification.json').read_text())
    assert written['part']['name'] == 'l1'
    assert written['touches']['outlying'] == []  # what disagrees is explained by the part


def test_verify_a_recording_of_another_robot_or_cell(run, recordings, results):
    text = (recordings / 'cell.yaml').read_text()
    calibration = results / 'a' / 'calibration.json'
    moved = text.replace('[0.05, 0.25]', '[0.0501, 0.25]')
    cells = {'robot': text.replace('l1: 0.33', 'l1: 0.36'), 'object': moved, 'tolerance': text + TOLERANCE}
    for name, changed in cells.items():
        Path('cell.yaml').write_text(changed)
        assert run('simulate', '--cell', 'cell.yaml', '--out', name, '--per-disc', 6, '--seed', 5, *SLOW).status == 0
    refused(run('verify', 'robot', '--calibration', calibration), 2, 'another robot')
    done = run('verify', 'object', '--calibration', calibration)
    assert done.status == 0 and 'contains another cell description (disc_3)' in done.out
    assert json.loads(Path('verification/verification.json').read_text())['grade'] != 'fit'
    assert run('verify', 'tolerance', '--calibration', calibration).out.startswith('Confirmed, no tolerance stated')


def test_compare(run, results):
    paths = [results / name / 'calibration.json' for name in 'ab']
    done = run('compare', *paths)
    assert done.status == 0 and 'No change beyond the uncertainty' in done.out
    document = json.loads(Path('comparison/comparison.json').read_text())
    (change,) = document['changes']
    assert change['p_value'] > 1e-3 and change['changed'] is False and change['degrees_of_freedom'] == 12
    assert '<h1>What changed between calibrations</h1>' in Path('comparison/comparison.html').read_text()


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'covariance_with_cell': {'names': ['x0'], 'values': [0.0], 'matrix': [[0.0]]}}, 'covariance_with_cell'),
        ({'covariance_with_cell': None}, 'damaged'),
        ({'covariance_with_cell.matrix.0.0': -1.0}, 'a variance is negative'),
        ({'covariance_with_cell.values.3': float('nan')}, 'finite numbers'),
        ({'covariance_with_cell.values.3': 0.34}, 'differ from those of the model'),
        ({'fit.enlargement': 0.0}, 'enlargement'),
        ({'noise.source': 'estimated', 'fit.degrees_of_freedom': None}, 'damaged'),
    ],
)
def test_bad_files_are_one_line(run, recordings, results, change, words):
    good = results / 'a' / 'calibration.json'
    document = json.loads(good.read_text())
    for place, value in change.items():
        *parents, last = (int(key) if key.isdigit() else key for key in place.split('.'))
        reduce(getitem, parents, document)[last] = value
    Path('bad.json').write_text(json.dumps(document))
    for arguments in (('compare', good, 'bad.json'), ('verify', recordings / 'plain', '--calibration', 'bad.json')):
        refused(run(*arguments), 2, words, 'bad.json')
    assert not Path('comparison').exists() and not Path('verification').exists()


def test_misuse(run, results):
    good = results / 'a' / 'calibration.json'
    assert 'two or more' in run('compare', good).err
    assert 'given twice' in run('compare', good, good).err
    assert run('verify', 'none.mcap', '--calibration', good).status == 2


def test_calibrate_from_an_earlier_calibration(run, recordings, results):
    calibration = results / 'a' / 'calibration.json'
    done = run('calibrate', recordings / 'plain', '--from', calibration, '--free', 'tool', '--out', 'new')
    assert done.status == 0 and 'freed: theta2, l2, p_ee, g_ee; the touches agree' in ' '.join(done.out.split())
    document = json.loads(Path('new/calibration.json').read_text())
    assert document['from']['path'] == str(calibration) and len(document['from']['sha256']) == 64
    assert document['assessment']['grade'] != 'unfit'
    old = json.loads(calibration.read_text())['parameters']
    for name, entry in document['parameters'].items():
        assert abs(entry['value'] - old[name]['value']) < 5 * (entry['std'] + old[name]['std']), name
    again = run('verify', recordings / 'plain', '--calibration', 'new/calibration.json')
    assert 'part of the calibration' in again.out
    refused(run('calibrate', recordings / 'good', '--from', calibration), 2, 'part of the earlier calibration')
    refused(run('calibrate', recordings / 'plain', '--from', calibration, '--free', 'tol'), 2, "did you mean 'tool'")
    refused(run('calibrate', recordings / 'plain', '--free', 'tool'), 2, '--from')
    refused(run('calibrate', recordings / 'plain', '--from', calibration, '--fix', 'l1'), 2, '--fix')
    refused(run('calibrate', recordings / 'plain', '--from', 'none.json'), 2, 'there is no such file')
    document['assessment']['grade'] = 'unfit'
    Path('unfit.json').write_text(json.dumps(document))
    refused(run('calibrate', recordings / 'plain', '--from', 'unfit.json'), 2, 'no prior')


def test_next_plans_the_fewest_touches_of_an_update(run, recordings, results):
    calibration, cell = results / 'a' / 'calibration.json', Path('cell.yaml')
    limits = '  limits: {joint1: [-3.1, 3.1], joint2: [-2.8, 2.8]}\n'
    cell.write_text((recordings / 'cell.yaml').read_text().replace('objects:', limits + 'objects:'))
    done = run('next', '--cell', cell, '--from', calibration, '--free', 'tool', '--out', 'plan')
    assert done.status == 0 and 'now not determined' in done.out and 'a slip of joint 1 by' in done.out
    number = int(done.out.split(' touches')[0])
    assert 4 <= number <= 12 and len(Path('plan/next.csv').read_text().splitlines()) == number + 1
    nothing = run('next', '--cell', cell, '--from', calibration, '--out', 'plan')
    assert int(nothing.out.split(' touches')[0]) < number and 'a slip of joint 2 by' in nothing.out
    refused(run('next', '--cell', cell, '--from', calibration, '--free', 'tol', '--out', 'x'), 2, "did you mean 'tool'")
