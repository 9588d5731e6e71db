"""The verb `paper`: one page, one file of numbers, nothing half-written."""

from __future__ import annotations

import json

from scara_kinetostatic.cli.main import main


def test_writes_the_page_and_the_numbers(tmp_path, capsys):
    assert main(['paper', '--out', str(tmp_path / 'out'), '--runs', '2']) == 0
    assert 'rank 11 of 12' in capsys.readouterr().out
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {'paper.html', 'paper.json'}
    numbers = json.loads((tmp_path / 'out' / 'paper.json').read_text())
    assert numbers['one_level']['paper_algorithm']['force_error'] < 1e-9
    assert numbers['one_level']['weighted']['confounded'] == [['p_ee', 'g_ee']]
    assert numbers['monte_carlo']['weighted']['runs'] == 2
    page = (tmp_path / 'out' / 'paper.html').read_text()
    assert page.count('<svg') >= 7
    assert 'http' not in page.replace('http://www.w3.org', '')


def test_senseless_number_of_runs(tmp_path, capsys):
    assert main(['paper', '--out', str(tmp_path), '--runs', '1']) == 2
    assert 'expected at least 2' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
