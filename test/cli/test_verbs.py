"""What the verbs do when all is well."""

from __future__ import annotations

import json
import math

import pytest

from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED

pytestmark = pytest.mark.usefixtures('without_page')

TRUTH = PAPER_ACTUAL.as_dict()


def test_calibrate_writes_and_prints(run, recordings, tmp_path):
    result = run('calibrate', recordings / 'good', '--out', 'result')
    assert (result.status, result.err) == (0, '')
    document = json.loads((tmp_path / 'result' / 'calibration.json').read_text(encoding='utf-8'))
    for name, entry in document['parameters'].items():
        assert abs(entry['value'] - TRUTH[name]) < 4 * entry['std']
    assert result.out.startswith('Fit for use, no tolerance stated: the tip is known to ')
    assert '\n\nThe base model explains these touches.' in result.out
    assert '36 used of 36 found' in result.out
    assert result.out.rstrip().endswith('result/report.html')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['result']


@pytest.mark.usefixtures('undiagnosed')
def test_an_unfit_result_is_an_error_only_if_strict(run, recordings, tmp_path):
    cell = tmp_path / 'cell.yaml'
    cell.write_text((recordings / 'cell.yaml').read_text() + 'tolerance: {tip: 1.0e-6}\n')
    strict = run('calibrate', recordings / 'good', '--cell', cell, '--out', 'result', '--strict')
    assert strict.status == 3
    assert strict.out.startswith('Not fit for use: the expanded uncertainty of the tip is up to ')
    assessment = json.loads((tmp_path / 'result' / 'calibration.json').read_text(encoding='utf-8'))['assessment']
    assert assessment['grade'] == 'unfit'
    assert strict.err.startswith(f'scara-kinetostatic: unfit: {assessment["reasons"][0]}')
    assert strict.err.rstrip().endswith('the results are written to result all the same')
    assert (tmp_path / 'result' / 'report.html').is_file()
    assert run('calibrate', recordings / 'good', '--strict').status == 0


@pytest.mark.usefixtures('undiagnosed')
def test_several_recordings_count_as_one(run, recordings, tmp_path):
    cell = ('--cell', recordings / 'cell.yaml')
    assert run('calibrate', recordings / 'good', recordings / 'plain', *cell).status == 0
    document = json.loads((tmp_path / 'calibration' / 'calibration.json').read_text(encoding='utf-8'))
    assert document['touches']['found'] == 72
    assert document['sources'] == [str(recordings / 'good'), str(recordings / 'plain')]
    assert [entry['index'] for entry in document['touches']['fitted']] == list(range(72))
    for name, entry in document['parameters'].items():
        assert abs(entry['value'] - TRUTH[name]) < 5 * entry['std']


@pytest.mark.usefixtures('undiagnosed')
def test_fix_at_a_value_and_at_the_nominal_one(run, recordings, tmp_path):
    assert run('calibrate', recordings / 'good', '--fix', 'l1=0.3302', '--fix', 'p1').status == 0
    entries = json.loads((tmp_path / 'calibration' / 'calibration.json').read_text(encoding='utf-8'))['parameters']
    fixed = {name: entry for name, entry in entries.items() if entry['status'] == 'fixed'}
    assert {name: (entry['value'], entry['std']) for name, entry in fixed.items()} == {
        'l1': (0.3302, 0),
        'p1': (1e-5, 0),
    }


def test_inspect_lists_every_touch(run, recordings):
    result = run('inspect', recordings / 'good')
    assert result.status == 0
    assert '36 touches found: 36 accepted, 0 rejected' in result.out
    assert 'sensor_msgs/msg/JointState' in result.out
    (description,) = (line for line in result.out.splitlines() if line.startswith('/cell_description'))
    assert description.split()[-4:] == ['–'] * 4
    assert sum(' disc_' in line for line in result.out.splitlines()) == 36
    found = json.loads(run('inspect', recordings / 'good', '--json').out)
    assert found['streams']['/joint_states']['rate'] == pytest.approx(40, rel=0.05)
    assert {topic['name'] for topic in found['topics']} == {'/joint_states', '/wrench', '/cell_description'}
    assert [touch['index'] for touch in found['touches']] == list(range(36))
    for touch in found['touches']:
        assert touch['accepted'] and touch['hold'] > 0.4
        assert min(abs(math.hypot(*touch['force']) - level) for level in (10, 25, 40)) < 2


def test_inspect_says_why_a_touch_is_rejected(run, recordings, tmp_path):
    lines = (recordings / 'cell.yaml').read_text().splitlines(keepends=True)
    (tmp_path / 'two.yaml').write_text(''.join(line for line in lines if 'disc_2' not in line))
    result = run('inspect', recordings / 'good', '--cell', 'two.yaml')
    assert result.status == 0
    assert '24 accepted, 12 rejected' in result.out
    assert result.out.count('rejected: ') == 12


def test_simulate_is_repeatable_and_follows_its_options(run, recordings, tmp_path):
    def simulate(name: str, *options: object) -> bytes:
        assert run('simulate', '--out', name, '--plan', recordings / 'few.yaml', *options).status == 0
        return (tmp_path / name).read_bytes()

    first = simulate('a.mcap', '--seed', 4)
    assert simulate('b.mcap', '--seed', 4) == first
    assert simulate('c.mcap', '--seed', 5) != first
    simulate('e.mcap', '--plain')
    assert embedded_cell(tmp_path / 'e.mcap') is None


def test_simulate_takes_the_truth_by_name_or_from_a_file(run, recordings, tmp_path):
    def told(*options: object) -> dict[str, float]:
        out = run('simulate', '--plan', recordings / 'few.yaml', *options).out
        pairs = out.partition('truth: ')[2].split(', ')
        return {name: float(value) for name, value in (pair.split() for pair in pairs)}

    assert told('--out', 'a', '--compression', 'zstd') == pytest.approx(TRUTH)
    assert '3 touches found: 3 accepted' in run('inspect', 'a').out
    assert told('--out', 'b', '--truth', 'measured') == pytest.approx(PAPER_MEASURED.as_dict())
    other = (recordings / 'cell.yaml').read_text().replace('l1: 0.33,', 'l1: 0.34,')
    (tmp_path / 'other.yaml').write_text(other)
    shifted = told('--out', 'd', '--cell', 'other.yaml')
    assert list(shifted) == list(NAMES)
    assert shifted['l1'] == pytest.approx(0.3402)
