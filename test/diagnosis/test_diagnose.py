"""The verdict: quiet on clean data, loud where the model is not enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL, NOISE, touches

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED


@pytest.mark.parametrize('given', [True, False])
def test_clean_data_raise_no_alarm(given):
    cell = replace(CELL, noise=NOISE if given else None)
    verdicts = [
        diagnose(calibrate(touches(robot, seed), cell))
        for robot in (PAPER_ACTUAL, PAPER_MEASURED)
        for seed in range(25)
    ]
    assert sum(item.verdict != 'none' for item in verdicts) <= 2
    assert 0 < np.min([item.p_value for item in verdicts]) <= 1
    assert all(not item.effects for item in verdicts)


@pytest.mark.parametrize('given', [True, False])
def test_a_wrong_radius_shows_on_the_disc(given):
    cell = replace(CELL, discs=(CELL.discs[0]._replace(radius=0.1501), *CELL.discs[1:]), noise=NOISE if given else None)
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1), cell))
    assert found.verdict == 'unexplained'
    assert found.p_value < 1e-6
    assert any('disc' in trace.name for trace in found.traces)
    assert 'do not trust' in found.advice


def test_a_joint_that_is_not_round_shows_over_its_angle():
    data = touches(PAPER_ACTUAL, 1)
    joints = data.joints.copy()
    joints[:, 1] += 8e-5 * np.sin(2 * joints[:, 1] + 0.4)
    found = diagnose(calibrate(data.replace(joints=joints), CELL))
    assert found.verdict == 'unexplained'
    assert any('joint 2' in trace.name for trace in found.traces)


def test_understated_noise_is_told_from_structure():
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1, noise=Noise(3e-5, 0.9)), CELL))
    assert found.verdict == 'unexplained'
    assert not found.traces
    assert 'too small' in found.advice


def test_overstated_noise_is_told():
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1, noise=Noise(3e-6, 0.1)), CELL))
    assert found.verdict == 'none'
    assert 'too large' in found.advice
