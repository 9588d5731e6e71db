"""Trusted nominal values that the touches contradict: named, left out, never a complete model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import CELL, simulate

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import contradictions, diagnose
from scara_kinetostatic.model.cell import Uncertainty
from scara_kinetostatic.model.parameters import PAPER_ACTUAL

TOUCHES = simulate()
OFF = PAPER_ACTUAL.l1 - CELL.nominal.l1


def trusting(noise: bool, **nominal: float):
    cell = replace(CELL, uncertainty=Uncertainty(nominal=nominal), noise=CELL.noise if noise else None)
    return calibrate(TOUCHES, cell)


@pytest.mark.parametrize('noise', [True, False])
def test_a_wrong_one_is_named_and_left_out(noise):
    found = diagnose(trusting(noise, l1=abs(OFF) / 20))
    assert found.verdict == 'unexplained'
    assert found.p_value < 1e-6
    assert [test.name for test in found.contradicted] == ['l1']
    assert '20 times its uncertainty) off' in found.advice
    free = trusting(noise)
    assert found.refitted is not None
    assert found.refitted['l1'].value == pytest.approx(free['l1'].value, abs=3 * found.refitted['l1'].std)


def test_one_that_is_right_within_its_uncertainty_stays():
    found = diagnose(trusting(False, l1=abs(OFF)))
    assert found.verdict == 'none'
    assert not found.contradicted


def test_the_test_is_that_of_a_fit_without_the_value():
    u = 2 * abs(OFF)
    (test,) = contradictions(trusting(True, l1=u))
    free = trusting(True)
    expected = abs(free['l1'].value - CELL.nominal.l1) / np.hypot(u, free['l1'].std / np.sqrt(free.enlargement))
    assert test.deviation == pytest.approx(expected, rel=1e-3)
    assert abs(test.off) == pytest.approx(abs(free['l1'].value - CELL.nominal.l1), rel=1e-3)
