"""Every verb that takes a cell description runs on the example, `config/cell.yaml`."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path

import pytest
from cli.conftest import SLOW

from scara_kinetostatic.cli.main import build_parser, main

CELL = Path(__file__).parents[2] / 'config' / 'cell.yaml'
SLIDES = '- {slide: {center: [0.20, 0.30], radius: 0.06}, force: 15, friction: 0.1, to: 1.05}\n'
POSES = 'x_m,y_m,fx_N,fy_N,elbow\n0.1,0.4,10,5,left\n0.2,0.3,0,0,right\n'
STATES = 'q1_rad,q2_rad,fx_N,fy_N\n0.4,1.1,10,5\n'
ARGUMENTS: dict[str, tuple[str, ...]] = {
    'simulate': ('--out', 'touches', '--per-disc', '6', *SLOW),
    'inspect': ('touches',),
    'calibrate': ('touches', '--out', 'result'),
    'verify': ('touches', '--calibration', 'result/calibration.json', '--out', 'verified'),
    'contour': ('slide', '--calibration', 'result/calibration.json', '--out', 'contour'),
    'next': ('touches', '--touches', '6', '--out', 'more'),
    'design': ('--per-disc', '6', '--out', 'design'),
    'mujoco': ('engine', '--per-disc', '1'),
}
"""Arguments of each verb beside --cell, in an order in which each finds what it needs."""


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('example')
    for name, text in (('slides.yaml', SLIDES), ('poses.csv', POSES), ('states.csv', STATES)):
        (folder / name).write_text(text)
    return folder


def test_no_verb_that_takes_a_cell_is_left_out():
    (verbs,) = (item for item in build_parser()._actions if isinstance(item, argparse._SubParsersAction))
    takes = {name for name, parser in verbs.choices.items() if '--cell' in parser._option_string_actions}
    assert takes == ARGUMENTS.keys() | {
        'demo',
        'recalibrate',
    }  # test/nodes/test_demo.py, test/monitoring/test_archive.py


@pytest.mark.parametrize('verb', ARGUMENTS)
@pytest.mark.usefixtures('without_page', 'undiagnosed')
def test_it_runs(verb, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    if verb == 'mujoco' and not importlib.util.find_spec('mujoco'):
        pytest.skip('MuJoCo is not installed')
    if verb == 'contour':
        assert main(['simulate', '--cell', str(CELL), '--plan', 'slides.yaml', '--out', 'slide']) == 0
    assert main([verb, *ARGUMENTS[verb], '--cell', str(CELL)]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(('verb', 'table'), [('compensate', 'poses.csv'), ('locate', 'states.csv')])
def test_it_stands_for_the_nominal_arm(verb, table, folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert main([verb, str(CELL), table, '--out', f'{verb}.csv']) == 0
    assert 'beyond_limits' not in (folder / f'{verb}.csv').read_text()
