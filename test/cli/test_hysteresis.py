"""The verb `hysteresis`: records in, tables and a page out, one line where something is wrong."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli.command import refused
from studies.gauge_table import loops
from studies.load_records import COMPLIANCE, table, torque

STATES = ((-2.0, 0.3), (-2.6, -0.8))
"""Load and state of friction at the start."""


@pytest.fixture(scope='module')
def slipping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of a joint that slips, and one more to predict."""
    folder = tmp_path_factory.mktemp('slipping')
    for number, (level, state) in enumerate(STATES):
        (folder / f'slip{number}.csv').write_text(table(torque(level), seed=number, state=state), encoding='utf-8')
    (folder / 'other.csv').write_text(table(torque(-2.8), seed=9, state=-0.5), encoding='utf-8')
    return folder


def result_of(folder: Path) -> tuple[dict, str]:  # type: ignore[type-arg]
    assert {path.name for path in folder.iterdir()} == {'hysteresis.json', 'hysteresis.html'}
    page = (folder / 'hysteresis.html').read_text(encoding='utf-8')
    assert '#01020' not in page  # no stand-in colour left
    assert 'http' not in page.replace('http://www.w3.org', '')
    identifiers = re.findall(r' id="([^"]+)"', page)
    assert len(identifiers) == len(set(identifiers))
    return json.loads((folder / 'hysteresis.json').read_text(encoding='utf-8')), page


def test_loops(run, tmp_path):
    name = '<b>&$\\frac$.csv'
    (tmp_path / name).write_text(loops())
    (tmp_path / 'stuck.csv').write_text(loops(slip=1e9))
    result = run('hysteresis', name, 'stuck.csv', '--out', 'result')
    assert (result.status, result.err) == (0, '')
    said = ' '.join(result.out.split())
    assert 'Law (6) is sufficient for 1 of 2 records' in said
    assert 'Law (6) is not sufficient: slip in series' in said
    document, page = result_of(tmp_path / 'result')
    assert document['schema'] == 'scara_kinetostatic/hysteresis/1'
    assert (document['driven'], document['units']) == ('motion', {'load': 'N', 'response': 'm'})
    slips, stuck = document['records']
    assert (slips['verdict'], slips['effects']) == ('explained', ['slip'])
    assert (stuck['verdict'], stuck['effects'], stuck['force_error']['after']) == ('none', [], None)
    assert slips['force_error']['after']['held_out'] < 0.1 * slips['force_error']['before']['held_out']
    for parameter, truth in (('slip_positive', 6e3), ('compliance', 1e-6)):
        assert slips['parameters']['slip'][parameter]['value'] == pytest.approx(truth, rel=0.01)
    assert slips['parameters']['slip']['compliance']['unit'] == 'm/N'
    assert page.count('<svg') == 2
    assert '<b>' not in page
    assert '&lt;b&gt;&amp;$\\frac$.csv' in page


def test_slip_under_load_is_named_and_predicts(run, slipping, tmp_path):
    files = sorted(slipping.glob('slip*.csv'))
    result = run('hysteresis', *files, '--predict', slipping / 'other.csv', '--out', 'result')
    assert (result.status, result.err) == (0, '')
    said = ' '.join(result.out.split())
    for words in ('Law (6) is not sufficient: slip in series with memory', '2 records together', 'other.csv'):
        assert words in said, words
    document, page = result_of(tmp_path / 'result')
    assert (document['driven'], document['effects'], document['law']['after']) == ('load', ['slip'], 'slip')
    assert document['p_value'] < 1e-9
    assert document['response_error']['after']['held_out'] < 0.1 * document['response_error']['before']['held_out']
    slip = next(each for each in document['candidates'] if each['name'] == 'slip')['parameters']
    for name, truth, unit in (
        ('compliance', COMPLIANCE, 'rad/Nm'),
        ('slip_compliance', 120e-6, 'rad/Nm'),
        ('slip_load', 1.0, 'Nm'),
    ):
        assert (slip[name]['value'], slip[name]['unit']) == (pytest.approx(truth, rel=0.03), unit)
    states = [each['state'] for each in document['records']]
    assert states == pytest.approx([state for _, state in STATES], abs=0.1)
    (predicted,) = document['predicted']
    assert set(predicted) >= {'file', 'before', 'after', 'unit'}
    assert (Path(predicted['file']).name, predicted['unit']) == ('other.csv', 'rad')
    assert predicted['after'] < min(0.1 * predicted['before'], 4e-6)
    assert predicted['from_s'] < 660 / 80
    assert page.count('<svg') == 3
    for other in ('force', 'displacement', 'kN', '[mm]'):
        assert other not in re.sub(r'<(svg|style).*?</\1>', '', page, flags=re.DOTALL), other


RAMP = 'time_s,force_N,displacement_mm\n' + ''.join(f'{k},{k},{2 * k}\n' for k in range(1, 100))


@pytest.mark.parametrize(
    ('text', 'options', 'status', 'message'),
    [
        (None, [], 2, 'one.csv: there is no such file'),
        (None, ['--out', 'other.csv'], 2, 'other.csv cannot be written'),
        (loops(), ['one.csv'], 2, 'one.csv: is given twice'),
        (loops(), ['--predict', 'other.csv'], 2, '--predict: one.csv is driven by its motion'),
        (RAMP, ['--driven', 'load'], 3, 'one.csv: the load is not at rest at first'),
        (loops('time_s,angle_rad,torque_Nm'), ['other.csv'], 2, 'other.csv: its load is in N, that of one.csv in Nm'),
    ],
)
def test_what_is_wrong_is_one_line(run, tmp_path, text, options, status, message):
    (tmp_path / 'other.csv').write_text(loops())
    if text is not None:
        (tmp_path / 'one.csv').write_text(text)
    refused(run('hysteresis', 'one.csv', *options), status, message)
    assert not (tmp_path / 'result').exists()
