"""The verb `hysteresis` on records driven by their load: law (6), slip with memory, further records predicted."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli.command import Run
from studies.load_records import COMPLIANCE, slip_table, table, torque

RECORDS = ((-2.0, 0.3), (-2.6, -0.8), (-3.0, 0.7), (-1.6, 0.9), (-2.3, -0.2))
"""Load and state of friction at the start."""


@pytest.fixture(scope='module')
def slipping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of a joint that slips, one more to predict, and the same as forces and displacements."""
    folder = tmp_path_factory.mktemp('slipping')
    for number, (level, state) in enumerate(RECORDS):
        (folder / f'slip{number}.csv').write_text(slip_table(level, state, number), encoding='utf-8')
    (folder / 'other.csv').write_text(slip_table(-2.8, -0.5, 9), encoding='utf-8')
    return folder


def test_slip_is_named_and_predicts(run: Run, slipping: Path, tmp_path: Path) -> None:
    files = sorted(slipping.glob('slip*.csv'))
    result = run('hysteresis', *files, '--predict', slipping / 'other.csv', '--out', 'result')
    assert result.status == 0, result
    assert result.err == ''
    for words in (
        'Driven by their load: the angle is predicted from the torque.',
        'Law (6) is not sufficient: slip in series with memory',
        '5 records together',
        'Each record predicted from the others',
        'µrad/Nm',
        'other.csv',
    ):
        assert words in result.out, words
    assert {path.name for path in (tmp_path / 'result').iterdir()} == {'hysteresis.json', 'hysteresis.html'}
    document = json.loads((tmp_path / 'result' / 'hysteresis.json').read_text(encoding='utf-8'))
    assert document['driven'] == 'load'
    assert document['effects'] == ['slip']
    assert document['p_value'] < 1e-9
    assert document['response_error']['after']['held_out'] < 0.1 * document['response_error']['before']['held_out']
    (predicted,) = document['predicted']
    assert set(predicted) >= {'file', 'before', 'after', 'unit'}
    assert predicted['file'].endswith('other.csv')
    assert predicted['unit'] == 'rad'
    assert predicted['after'] < 0.1 * predicted['before']
    assert predicted['after'] < 4e-6
    check_page((tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8'))


def check_page(page: str) -> None:
    """The page of five records and one predicted, of angles and torques."""
    assert page.count('<svg') == 2 * 6
    assert '#01020' not in page  # no stand-in colour left
    assert 'http' not in page.replace('http://www.w3.org', '')
    assert 'Law (6) is not sufficient: slip in series with memory' in page
    for other in ('force', 'displacement', 'kN', '[mm]'):
        assert other not in re.sub(r'<svg.*?</svg>', '', page, flags=re.DOTALL), other
    identifiers = re.findall(r' id="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))


def test_parameters_and_states_are_those_simulated(run: Run, slipping: Path) -> None:
    document = json.loads(run('hysteresis', *sorted(slipping.glob('slip*.csv')), '--json').out)
    slip = next(each for each in document['candidates'] if each['name'] == 'slip')
    for name, truth, unit in (
        ('compliance', COMPLIANCE, 'rad/Nm'),
        ('slip_compliance', 120e-6, 'rad/Nm'),
        ('slip_load', 1.0, 'Nm'),
    ):
        assert slip['parameters'][name]['value'] == pytest.approx(truth, rel=0.03)
        assert slip['parameters'][name]['unit'] == unit
    assert document['law']['after'] == 'slip'
    states = [each['state'] for each in document['records']]
    assert states == pytest.approx([state for _, state in RECORDS], abs=0.1)
    assert document['predicted'] == []


def test_an_elastic_joint_needs_nothing(run: Run, tmp_path: Path) -> None:
    for number, level in enumerate((-2.0, -2.5, -3.0)):
        (tmp_path / f'{number}.csv').write_text(table(torque(level), 'time_s,displacement_mm,force_N', number))
    result = run('hysteresis', '0.csv', '1.csv', '--predict', '2.csv', '--out', 'result')
    assert 'Driven by their load: the displacement is predicted from the force.' in result.out
    assert 'Law (6), slope and gap, is sufficient' in result.out
    assert 'nm/N' in result.out
    document = json.loads((tmp_path / 'result' / 'hysteresis.json').read_text(encoding='utf-8'))
    assert (document['verdict'], document['effects'], document['law']['after']) == ('none', [], None)
    (predicted,) = document['predicted']
    assert predicted['after'] == predicted['before'] == pytest.approx(2e-9, rel=0.3)
    assert predicted['unit'] == 'm'


def test_names_of_files_come_out_as_they_are(run: Run, tmp_path: Path) -> None:
    for number, name in enumerate(('<b>&$\\frac$.csv', 'b.csv')):
        (tmp_path / name).write_text(table(seed=number))
    assert run('hysteresis', '<b>&$\\frac$.csv', 'b.csv', '--out', 'result').status == 0
    page = (tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8')
    assert '<b>' not in page
    assert '&lt;b&gt;&amp;$\\frac$.csv' in page


def test_one_record_is_predicted_in_its_later_half(run: Run, slipping: Path, tmp_path: Path) -> None:
    result = run('hysteresis', slipping / 'slip0.csv', '--out', 'result')
    assert result.status == 0
    assert 'The later half predicted from the earlier half' in result.out
    page = (tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8')
    assert 'One record gives no standard deviation' in page


def test_nothing_after_the_unloading_is_used(run: Run, slipping: Path, tmp_path: Path) -> None:
    heading, *rows = (slipping / 'other.csv').read_text(encoding='utf-8').splitlines()
    changed = [row if number < 660 else re.sub(r'^([^,]*),0', r'\1,1', row) for number, row in enumerate(rows)]
    (tmp_path / 'changed.csv').write_text('\n'.join([heading, *changed]) + '\n', encoding='utf-8')
    files = [slipping / 'slip1.csv', slipping / 'slip2.csv', '--json', '--predict']
    as_measured, altered = (
        json.loads(run('hysteresis', *files, other).out)['predicted'][0]
        for other in (slipping / 'other.csv', 'changed.csv')
    )
    assert altered['state'] == as_measured['state']
    assert altered['unloaded'] == as_measured['unloaded'] < 660 / 80
    assert altered['after'] > 0.09
