"""The commands with a gauge block: from a recording to the result, its verification, and the next touches."""

import csv
import json

import pytest
from cli.conftest import SLOW
from conftest import page_left_out

from scara_kinetostatic.cli.main import main

CELL = """
robot:
  nominal: {x0: 0.0, y0: 0.0, theta1: 0.0, l1: 0.33, theta2: 0.0, l2: 0.33,
            p_ee: 1.0e-5, p1: 1.0e-5, p2: 1.0e-5, g_ee: 0.0, g1: 0.0, g2: 0.0}
  limits: {joint1: [-2.6, 2.6], joint2: [-2.6, 2.6]}
  lift: {joint: joint3, up: 0.02, down: 0.0}
tip: {radius: 0.005}
noise: {joint: 1.0e-5, force: 0.3}
objects:
  - {name: block, outline: [[-0.05, 0.32], [0.07, 0.32], [0.07, 0.44], [-0.05, 0.44]], corner_radius: 0.002}
  - {name: disc, center: [0.24, 0.30], radius: 0.06}
  - {name: edge, outline: [[-0.40, 0.15], [-0.15, 0.45]], open: true}
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A cell with a recording of it, calibrated."""
    folder = tmp_path_factory.mktemp('outlines')
    cell = folder / 'cell.yaml'
    cell.write_text(CELL)
    for seed in ('1', '2'):
        assert main(['simulate', '--cell', str(cell), '--out', str(folder / f'bag{seed}'), '--seed', seed, *SLOW]) == 0
    with page_left_out():
        assert main(['calibrate', str(folder / 'bag1'), '--cell', str(cell), '--out', str(folder / 'out')]) == 0
    return folder


def test_the_result_is_fit(folder):
    document = json.loads((folder / 'out' / 'calibration.json').read_text())
    assert document['diagnosis']['verdict'] == 'none'
    assert document['identifiability']['rank'] == 12
    touches = document['touches']
    assert touches['used'] == touches['found'] > 50
    assert {touch['object'] for touch in touches['fitted']} == {'block', 'disc', 'edge'}
    assert len({touch['surface'] for touch in touches['fitted']}) >= 8


def test_touches_that_it_has_not_seen_agree(folder):
    result, out = str(folder / 'out' / 'calibration.json'), folder / 'verified'
    assert main(['verify', str(folder / 'bag2'), '--calibration', result, '--out', str(out)]) == 0
    found = json.loads((out / 'verification.json').read_text())
    assert found['p_value'] > 1e-3
    assert found['tip_error'] < 2e-5


def test_the_next_touches_are_on_its_sides(folder):
    out = folder / 'next'
    assert main(['next', '--cell', str(folder / 'cell.yaml'), '--touches', '14', '--out', str(out)]) == 0
    with (out / 'next.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 14
    for row in rows:
        x, y = float(row['x_m']), float(row['y_m'])
        if row['object'] == 'block':
            away = max(abs(x - 0.01), abs(y - 0.38)) - 0.06
            assert 0.0025 < away < 0.0051
