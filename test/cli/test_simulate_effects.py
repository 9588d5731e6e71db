"""`simulate --effect`: what is played stands in the truth file and nowhere else."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command import refused

from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.touches.detection import find_touches

pytestmark = pytest.mark.usefixtures('without_page')

RADIUS = 'object_radius[disc_2]:radius=6e-5'
BIAS = 'sensor_bias:x=1.5,y=-0.5'


def touches_of(path: Path):
    cell = embedded_cell(path)
    assert cell is not None
    return find_touches(read_streams(path, cell), cell).touches


def test_effects_are_played_and_not_told(run, tmp_path):
    plain = run('simulate', '--out', 'plain.mcap', '--per-disc', '2')
    made = run('simulate', '--out', 'a.mcap', '--per-disc', '2', '--effect', RADIUS, '--effect', BIAS)
    assert (made.status, made.err) == (0, '')
    assert made.out.splitlines()[2:] == [
        'effect: object_radius[disc_2]: radius 6e-05 m',
        'effect: sensor_bias: x 1.5 N, y -0.5 N',
    ]
    assert made.out.splitlines()[1:2] == plain.out.splitlines()[1:]
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a.mcap', 'plain.mcap']
    for word in (b'object_radius', b'sensor_bias', b'effect'):
        assert word not in (tmp_path / 'a.mcap').read_bytes()
    one, other = touches_of(tmp_path / 'plain.mcap'), touches_of(tmp_path / 'a.mcap')
    np.testing.assert_allclose(np.median(other.force - one.force, axis=0), [1.5, -0.5], atol=0.05)
    moved = np.abs(other.joints - one.joints).max(axis=1)
    assert moved[one.disc == 1].min() > 5e-5
    assert moved[one.disc != 1].max() < 2e-6


def test_truth_file_plays_the_same_again(run, tmp_path):
    first = ('simulate', '--out', 'a.mcap', '--per-disc', '2', '--seed', '3', '--truth', 'measured')
    assert run(*first, '--effect', RADIUS, '--truth-file', 'truth/a.yaml').status == 0
    again = ('simulate', '--out', 'b.mcap', '--per-disc', '2', '--seed', '3', '--truth', 'truth/a.yaml')
    assert run(*again).status == 0
    assert (tmp_path / 'a.mcap').read_bytes() == (tmp_path / 'b.mcap').read_bytes()
    assert run(*(part.replace('b.mcap', 'c.mcap') for part in again), '--effect', BIAS).status == 0
    assert (tmp_path / 'c.mcap').read_bytes() != (tmp_path / 'b.mcap').read_bytes()


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        (('--effect', 'object_radius[disc_9]:radius=1e-4'), ('no such target', 'object_radius[disc_3]')),
        (('--effect', RADIUS, '--effect', RADIUS), ('object_radius[disc_2]', 'twice')),
        (('--effect', RADIUS, '--truth-file', 'taken'), ('taken', 'exists')),
        (('--effect', RADIUS, '--truth-file', 'taken/deeper'), ('taken', 'cannot be written')),
    ],
)
def test_what_cannot_be_played_leaves_nothing(run, recordings, tmp_path, options, words):
    (tmp_path / 'taken').write_text('mine')
    beside = () if '--truth-file' in options else ('--truth-file', 'truth.yaml')
    refused(run('simulate', '--out', 'x', '--plan', recordings / 'few.yaml', *options, *beside), 2, *words)
    assert [path.name for path in tmp_path.iterdir()] == ['taken']
    assert (tmp_path / 'taken').read_text() == 'mine'


def test_slip_with_memory_is_found_in_a_recording(run, tmp_path):
    """The preloads and the unloading between the touches come from the streams; the touches alone do not show it."""
    effect = ('--effect', 'joint_slip[joint1]:compliance=6e-5,slip_torque=1.5')
    plan = ('--per-disc', '8', '--preload', '0.3', '--seed', '9', '--joint-rate', '25', '--wrench-rate', '40')
    assert run('simulate', '--out', 'a.mcap', *plan, *effect).status == 0
    assert run('calibrate', 'a.mcap', '--out', 'result').status == 0
    found = json.loads((tmp_path / 'result' / 'calibration.json').read_text())['diagnosis']
    assert found['verdict'] == 'explained'
    assert [(item['name'], item['target']) for item in found['effects']] == [('joint_slip', 'joint1')]
    for name, true in (('compliance', 6e-5), ('slip_torque', 1.5)):
        value = found['effects'][0]['parameters'][name]
        assert abs(value['value'] - true) < 4 * value['std']
