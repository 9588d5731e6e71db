"""The verdict on data of a complete model, and of one that lacks something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL, NOISE, touches

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches


@pytest.mark.parametrize('given', [True, False])
def test_clean_data_raise_no_alarm(given):
    cell = replace(CELL, noise=NOISE if given else None)
    verdicts = [
        diagnose(calibrate(touches(robot, seed), cell))
        for robot in (PAPER_ACTUAL, PAPER_MEASURED)
        for seed in range(10)
    ]
    assert sum(item.verdict != 'none' for item in verdicts) <= 1
    assert 0 < np.min([item.p_value for item in verdicts]) <= 1
    assert all(not item.found and item.extended is None for item in verdicts if item.verdict == 'none')


@pytest.mark.parametrize('seed', [0, 3])
def test_two_force_levels_show_no_curve_over_the_force(seed):
    noise, cell = Noise(5e-6, 0.5), replace(CELL, noise=None)
    plan = default_plan(CELL, per_disc=18, levels=(10, 25), preload=0.3)
    fit = calibrate(simulate_touches(CELL, PAPER_MEASURED, plan, noise, seed), cell)
    assert diagnose(fit).verdict == 'none'


@pytest.mark.parametrize('given', [True, False])
def test_a_wrong_radius_is_named(given):
    cell = replace(CELL, discs=(CELL.discs[0]._replace(radius=0.1501), *CELL.discs[1:]), noise=NOISE if given else None)
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1), cell))
    assert found.verdict in ('explained', 'ambiguous')
    assert found.p_value < 1e-6
    assert any(item.effect.label == 'object_radius[disc_1]' for item in found.found)


def test_a_joint_that_is_not_round_is_named():
    data = touches(PAPER_ACTUAL, 1)
    joints = data.joints.copy()
    joints[:, 1] += 8e-5 * np.sin(2 * joints[:, 1] + 0.4)
    found = diagnose(calibrate(data.replace(joints=joints), CELL))
    assert [item.effect.label for item in found.found] == ['transmission_error[joint2]']
    assert any('joint' in trace.name for trace in found.dependences)


def test_understated_noise_is_distinguished_from_an_effect():
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1, noise=Noise(3e-5, 0.9)), CELL))
    assert found.verdict == 'unexplained'
    assert not found.dependences
    assert 'too small' in found.advice


def test_overstated_noise_is_reported():
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1, noise=Noise(3e-6, 0.1)), CELL))
    assert found.verdict == 'none'
    assert 'too large' in found.advice


@pytest.mark.parametrize('given', [True, False])
def test_a_displaced_disc_shows_whether_the_noise_is_known_or_not(given):
    cell = replace(CELL, noise=NOISE if given else None)
    for move in (1e-4, 2e-3, 3e-2):
        moved = replace(cell, discs=(cell.discs[0], cell.discs[1]._replace(x=cell.discs[1].x + move), cell.discs[2]))
        found = diagnose(calibrate(touches(PAPER_ACTUAL, 1), moved))
        assert found.verdict != 'none'
        assert not any('disc number' in item.name for item in found.dependences)
        if move < 1e-3:
            assert any(item.effect.label == 'object_position[disc_2]' for item in found.found)


@pytest.mark.parametrize('given', [True, False])
def test_a_joint_that_lost_its_zero_midway_shows(given):
    data = touches(PAPER_ACTUAL, 1)
    joints = data.joints.copy()
    joints[36:, 1] += 3e-4
    found = diagnose(calibrate(data.replace(joints=joints), replace(CELL, noise=NOISE if given else None)))
    assert any('zero of joint 2' in trace.name for trace in found.dependences)
    assert {'shift[joint2]', 'shift[tool]'} in [set(group) for group in found.rivals]
    assert all(item.effect.name == 'shift' for item in found.found)


def test_exact_data_are_not_unexplained():
    for robot in (PAPER_ACTUAL, PAPER_ACTUAL.replace(g_ee=0.0, g1=0.0, g2=0.0)):
        for noise in (NOISE, None):
            found = calibrate(touches(robot, noise=Noise(0.0, 0.0)), replace(CELL, noise=noise))
            assert diagnose(found).verdict == 'none'
