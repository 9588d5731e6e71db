"""Slip with memory: what it does to touches, and that the diagnosis tells it from what resembles it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL, EXACT
from diagnosis.simulated import check_explained

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.joints import JointHysteresis, JointSlip, LoadFriction
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.play_operator import LARGEST_RATIO
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

PLAN = default_plan(CELL, 18, preload=0.3).select(np.arange(108))
SLIP = ExtendedModel(PAPER_ACTUAL, (JointSlip.of(0),), ((6e-5, 1.5),))


def labels(touches: TouchSet) -> set[str]:
    """What is named, with rivals."""
    found = diagnose(calibrate(touches, CELL))
    return {item.effect.label for item in found.found} | {label for group in found.rivals for label in group}


def test_it_is_found_with_its_values():
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL))
    touches = simulate_touches(cell, SLIP, PLAN, seed=1)
    check_explained(diagnose(calibrate(touches, cell)), 'joint_slip[joint1]', (6e-5, 1.5))


def test_without_preload_and_beyond_twice_the_slip_torque_it_is_compliance_and_backlash():
    """Each joint: p + w, g - w r; so the verdict is that nothing is missing."""
    plan = default_plan(CELL, 18, levels=(20.0, 30.0, 40.0))
    small = ExtendedModel(PAPER_ACTUAL, (JointSlip.of(1),), ((1e-5, 0.02),))
    touches = simulate_touches(CELL, small, plan, EXACT)
    found = calibrate(touches, CELL)
    assert found['p2'].value == pytest.approx(PAPER_ACTUAL.p2 + 1e-5, rel=1e-3)
    assert found['g2'].value == pytest.approx(PAPER_ACTUAL.g2 - 2e-7, rel=1e-3)
    assert not labels(simulate_touches(CELL, small, plan, seed=2))


def test_it_is_told_from_hysteresis():
    lag = ExtendedModel(PAPER_ACTUAL, (JointHysteresis.of(0),), ((8e-5,),))
    assert labels(simulate_touches(CELL, lag, PLAN, seed=3)) == {'joint_hysteresis[joint1]'}


def test_without_a_history_it_is_not_named():
    """But the advice says that it was not examined."""
    touches = simulate_touches(CELL, SLIP, PLAN, seed=4)
    found = diagnose(calibrate(touches.replace(history=None), CELL))
    assert found.verdict == 'unexplained'
    assert not any(item.effect.name == 'joint_slip' for item in found.found)
    assert 'slip with memory in a joint was not examined' in found.advice


def test_a_fit_ends_at_a_kink_of_the_law():
    start = ExtendedModel(CELL.nominal, SLIP.effects, ((5e-5, 1.7),))
    assert calibrate(simulate_touches(CELL, SLIP, PLAN), CELL, start=start).termination is Termination.CONVERGED


SEVERAL = replace(PLAN, preload=np.where(PLAN.preload > 0, np.resize([0.15, 0.3, 1.0], len(PLAN)), 0.0))
"""The same touches with three preloads."""


def test_friction_that_grows_with_the_load_is_found_with_its_values():
    truth = ExtendedModel(PAPER_ACTUAL, (LoadFriction.of(1),), ((4e-5, 0.25),))
    found = diagnose(calibrate(simulate_touches(CELL, truth, SEVERAL, seed=1), CELL))
    check_explained(found, 'load_friction[joint2]', (4e-5, 0.25))


def test_loaded_from_rest_friction_that_grows_with_the_load_is_compliance():
    truth = ExtendedModel(PAPER_ACTUAL, (LoadFriction.of(1),), ((1e-5, 0.25),))
    plan = default_plan(CELL, 18)
    found = calibrate(simulate_touches(CELL, truth, plan, EXACT), CELL)
    assert found['p2'].value == pytest.approx(PAPER_ACTUAL.p2 + 1e-5, rel=1e-6)
    assert found.force_error < 1e-6


def test_one_preload_does_not_tell_its_parameters_from_compliance():
    start = ExtendedModel(CELL.nominal, (LoadFriction.of(1),), ((1.1e-5, 0.3),))
    truth = ExtendedModel(PAPER_ACTUAL, start.effects, ((1e-5, 0.25),))
    for plan, rank in ((PLAN, 13), (SEVERAL, 14)):
        found = calibrate(simulate_touches(CELL, truth, plan, EXACT), CELL, start=start)
        assert found.identifiability.rank == rank


def test_a_step_beyond_the_largest_friction_is_sent_back():
    at = np.linspace(-9.0, 9.0, 7)
    slip, history = LoadFriction.of(0), np.column_stack([1.5 * at, 1.3 * at])
    inside, beyond = (slip._slipped(history, at, slip._folded(value)[0])[0] for value in (0.5, -0.5))
    np.testing.assert_array_equal(inside, beyond)
    assert slip._folded(2 * LARGEST_RATIO - 0.5) == (pytest.approx(0.5), -1.0)
