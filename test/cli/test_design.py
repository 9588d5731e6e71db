"""`scara-kinetostatic design`, end to end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from scara_kinetostatic.cli.main import main
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import parse_plan

ROOT = Path(__file__).parents[2]
_LAYOUT_EFFORT = ['--accuracy', '1.1e-5', '--per-disc', '9', '--levels', '10', '40']


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Of the paper's cell without its noise and what is declared of its discs."""
    where = tmp_path_factory.mktemp('design')
    described = yaml.safe_load((ROOT / 'config' / 'cell.yaml').read_text())
    kept = {k: v for k, v in described.items() if k not in ('noise', 'region')}
    kept['objects'] = [{k: v for k, v in each.items() if k != 'uncertainty'} for each in kept['objects']]
    (where / 'cell.yaml').write_text(yaml.safe_dump(kept))
    assert main(['design', '--cell', str(where / 'cell.yaml'), *_LAYOUT_EFFORT, '--out', str(where / 'out')]) == 0
    return where / 'out'


def test_the_document(folder):
    assert {path.name for path in folder.iterdir()} == {'design.html', 'design.json', 'plan.yaml'}
    document = json.loads((folder / 'design.json').read_text())
    recommended = document['recommended']
    assert document['schema'] == 'scara_kinetostatic/design/1'
    assert recommended['tip_free']['largest'] < recommended['value'] <= 1.1e-5
    assert recommended['touches'] == len(recommended['plan'])
    assert recommended['rank'] == 12
    assert max(recommended['without_each_touch']) <= 1.1e-5
    assert max(recommended['leverage']) == recommended['largest_leverage'] <= 0.8
    assert document['robot']['noise_assumed'] == ['joint', 'force']
    assert document['declared_uncertainties'] is None
    expected = document['expected']
    assert expected['recommended']['expanded'] > expected['of_these']['expanded'] > 0
    assert expected['touches'] == 72


def test_the_plan_is_one_for_simulate(folder, tmp_path, capsys):
    plan = parse_plan((folder / 'plan.yaml').read_text(), Cell(PAPER_NOMINAL, PAPER_DISCS))
    assert main(['simulate', '--plan', str(folder / 'plan.yaml'), '--out', str(tmp_path / 'bag')]) == 0
    assert f'{len(plan)} touches' in capsys.readouterr().out


def test_an_accuracy_that_declared_uncertainties_do_not_allow(tmp_path, capsys):
    described = yaml.safe_load((ROOT / 'config' / 'cell.yaml').read_text())
    described['objects'] = [
        {'name': d.name, 'center': [d.x, d.y], 'radius': d.radius, 'uncertainty': {'center': 1.5e-5}}
        for d in PAPER_DISCS
    ]
    (tmp_path / 'cell.yaml').write_text(yaml.safe_dump(described))
    assert main(['design', '--cell', str(tmp_path / 'cell.yaml'), *_LAYOUT_EFFORT]) == 3
    assert 'object_position alone' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('options', 'status', 'said'),
    [
        (['--accuracy', '5'], 2, 'at most 0.005, in SI units'),
        (['--expected', 'nowhere.yaml'], 2, 'nowhere.yaml'),
        (['--accuracy', '1e-8', '--per-disc', '6'], 3, 'out of reach'),
    ],
)
def test_what_is_wrong_is_said(options, status, said, capsys):
    assert main(['design', *options]) == status
    assert said in capsys.readouterr().err
