"""The verb `hysteresis`: records in, tables and a page out, one line where something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command import Run


def record(slip: float = 6e3, seed: int = 0) -> str:
    """Loops of a joint with a gap of 4 mm that slips at a load, as a table."""
    time = np.arange(0, 8, 1 / 50)
    moved = 0.02 * np.minimum(0.4 + time / 6, 1) * np.sin(np.pi * time)
    force = []
    anchor = 0.0
    for x in moved.tolist():
        anchor = min(max(anchor, x - 2e-3 - 1e-6 * slip), x + 2e-3 + 1e-6 * slip)
        stretch = x - anchor
        force.append(np.sign(stretch) * max(abs(stretch) - 2e-3, 0) / 1e-6)
    noisy = np.array(force) + 20 * np.random.default_rng(seed).standard_normal(len(force))
    rows = ['time_s,displacement_m,force_N']
    rows += [f'{t:.4f},{x:.9f},{f:.3f}' for t, x, f in zip(time, moved, noisy, strict=True)]
    return '\n'.join(rows) + '\n'


@pytest.fixture
def records(tmp_path: Path) -> list[str]:
    names = []
    for number, slip in enumerate((4e3, 6e3, 8e3)):
        (tmp_path / f'loop{number}.csv').write_text(record(slip, number))
        names.append(f'loop{number}.csv')
    return names


def test_tables_json_and_page(run: Run, records: list[str], tmp_path: Path) -> None:
    result = run('hysteresis', *records, '--tension', '4', '6', '8', '--out', 'result')
    assert result.status == 0
    assert result.err == ''
    for word in (
        'Law (6) is not sufficient: Coulomb friction in series',
        'selected',
        'Before and after',
        'held out',
        'predicted',
    ):
        assert word in result.out
    assert {path.name for path in (tmp_path / 'result').iterdir()} == {'hysteresis.json', 'hysteresis.html'}
    document = json.loads((tmp_path / 'result' / 'hysteresis.json').read_text(encoding='utf-8'))
    assert document['schema'] == 'scara_kinetostatic/hysteresis/1'
    for found, slip in zip(document['records'], (4e3, 6e3, 8e3), strict=True):
        assert found['effects'] == ['slip']
        assert found['force_error']['after']['held_out'] < 0.1 * found['force_error']['before']['held_out']
        estimate = found['parameters']['slip']['slip_positive']
        assert estimate['value'] == pytest.approx(slip, rel=0.01)
        assert estimate['unit'] == 'N'
    assert len(document['leave_one_out']) == 3
    page = (tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8')
    assert page.count('<svg') == 2 * 3 + 1
    assert '#01020' not in page  # no stand-in colour left
    assert 'http' not in page.replace('http://www.w3.org', '')


def test_json_on_stdout_is_that_of_the_file(run: Run, records: list[str], tmp_path: Path) -> None:
    printed = json.loads(run('hysteresis', records[0], '--json', '--out', 'result').out)
    assert printed == json.loads((tmp_path / 'result' / 'hysteresis.json').read_text(encoding='utf-8'))
    assert printed['leave_one_out'] == []


def test_a_joint_that_never_slips_needs_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / 'still.csv').write_text(record(slip=1e9))
    result = run('hysteresis', 'still.csv', '--out', 'result')
    assert result.status == 0
    assert 'Law (6), slope and gap, is sufficient' in result.out
    assert 'friction in series' not in result.out


@pytest.mark.parametrize(
    ('text', 'options', 'status', 'message'),
    [
        (None, [], 2, 'one.csv: there is no such file'),
        ('force_N,displacement_mm\n1,x\n', [], 2, 'one.csv: line 2: displacement_mm: expected a number'),
        (record(), ['one.csv'], 2, 'one.csv: is given twice'),
        (record(), ['--tension', '3', '4'], 2, 'tension: expected one per file, 1, got 2'),
        (record(), ['--tension', '3'], 2, 'tension: a line over the tension'),
        (record(), ['--tension', 'x'], 2, 'expected a number'),
        (record(), ['--out', 'one.csv'], 2, 'one.csv'),
        ('force_N,displacement_mm\n1,2\n2,3\n', [], 3, 'one.csv: loops need the time'),
        ('time_s,force_N,displacement_mm\n1,1,2\n0,2,3\n', [], 3, 'one.csv: the time does not rise'),
        ('time_s,force_N,displacement_mm\n1,1,2\n2,2,3\n3,1,2\n', [], 3, 'one.csv: 2 sweeps'),
    ],
)
def test_what_is_wrong_is_one_line(
    run: Run, tmp_path: Path, text: str | None, options: list[str], status: int, message: str
) -> None:
    if text is not None:
        (tmp_path / 'one.csv').write_text(text)
    result = run('hysteresis', 'one.csv', *options)
    assert result.status == status
    assert message in result.err
    assert result.err.count('\n') == 1
    assert 'Traceback' not in result.err
    assert result.out == ''
    assert not (tmp_path / 'result').exists()


def test_nothing_is_written_if_a_table_is_wrong(run: Run, records: list[str], tmp_path: Path) -> None:
    (tmp_path / records[2]).write_text(record() + 'oops\n')
    assert run('hysteresis', *records, '--out', 'result').status == 2
    assert not (tmp_path / 'result').exists()


def test_names_of_files_come_out_as_they_are(run: Run, tmp_path: Path) -> None:
    name = '<b>&$\\frac$.csv'
    (tmp_path / name).write_text(record())
    assert run('hysteresis', name, '--out', 'result').status == 0
    page = (tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8')
    assert '<b>' not in page
    assert '&lt;b&gt;&amp;$\\frac$.csv' in page


def test_a_torque_over_an_angle_is_said_in_their_units(run: Run, tmp_path: Path) -> None:
    heading, *rows = record().splitlines()
    scaled = [[float(cell) for cell in row.split(',')] for row in rows]
    lines = [f'{time:.4f},{moved * 1e3:.6f},{force * 1e-3:.6f}' for time, moved, force in scaled]
    (tmp_path / 'force.csv').write_text('\n'.join([heading, *rows]) + '\n')
    (tmp_path / 'torque.csv').write_text('\n'.join(['time_s,angle_mrad,torque_Nm', *lines]) + '\n')
    linear = json.loads(run('hysteresis', 'force.csv', '--json').out)
    result = run('hysteresis', 'torque.csv', '--out', 'result')
    assert 'Driven by their motion: the torque is predicted from the angle.' in result.out
    rotary = json.loads((tmp_path / 'result' / 'hysteresis.json').read_text(encoding='utf-8'))
    assert (linear['units'], rotary['units']) == ({'load': 'N', 'response': 'm'}, {'load': 'Nm', 'response': 'rad'})
    for name, unit, scale in (('slip_positive', 'Nm', 1e-3), ('compliance', 'rad/Nm', 1e3)):
        expected, found = (each['records'][0]['parameters']['slip'][name] for each in (linear, rotary))
        assert found['unit'] == unit
        assert found['value'] == pytest.approx(scale * expected['value'], rel=1e-3)
    page = (tmp_path / 'result' / 'hysteresis.html').read_text(encoding='utf-8')
    for words in (result.out, page):
        assert 'slip torque' in words
        assert 'µrad/Nm' in words
        for other in ('force', 'displacement', ' N ', 'kN', 'mm '):
            assert other not in words.replace('law (6)', ''), other
