"""Predictions of the design study: against the calibration itself, against theory, against simulation."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import held_out_force_error
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise, Sensor, SensorFrame
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.candidates import MOST_HELD_OUT, held_out_ratio
from scara_kinetostatic.studies.design.prediction import (
    Region,
    Robot,
    exact_plan,
    free_tip,
    loaded_tip,
    make_workspace,
    observability,
    predict,
    tip_std,
)

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
ROBOT = Robot.of(CELL, PAPER_ACTUAL)
PLAN = default_plan(CELL)


@pytest.mark.parametrize('truth', [PAPER_ACTUAL, PAPER_MEASURED])
@pytest.mark.parametrize('frame', list(SensorFrame))
def test_exact_touches_satisfy_the_conditions(truth, frame):
    cell = Cell(PAPER_NOMINAL, PAPER_DISCS, sensor=Sensor(frame=frame), noise=CELL.noise)
    exact = exact_plan(Robot.of(cell, truth), PLAN)
    assert np.abs(exact.point.linear.misclosure).max() < 1e-12
    simulated = simulate_touches(cell, truth, PLAN, Noise(0.0, 0.0))
    np.testing.assert_allclose(exact.observations.joints, simulated.joints, atol=1e-12)
    np.testing.assert_allclose(exact.observations.force, simulated.force, atol=1e-12)


def test_prediction_is_what_the_calibration_states():
    found = calibrate(simulate_touches(CELL, PAPER_ACTUAL, PLAN, seed=3), CELL)
    np.testing.assert_allclose(predict(ROBOT, PLAN).std, found.std, rtol=0.03)


def test_one_level_confounds_the_gripper_and_leaves_the_free_tip():
    prediction = predict(ROBOT, default_plan(CELL, levels=(40.0,)))
    workspace = make_workspace(ROBOT)
    assert prediction.rank == 11
    assert prediction.confounded == (('p_ee', 'g_ee'),)
    assert np.isnan(prediction.std[[NAMES.index('p_ee'), NAMES.index('g_ee')]]).all()
    assert np.isfinite(np.delete(prediction.std, [6, 9])).all()
    assert tip_std(free_tip(ROBOT, workspace), prediction).largest < 1e-5
    assert np.isfinite(tip_std(loaded_tip(ROBOT, workspace, 40.0), prediction).largest)
    assert np.isinf(tip_std(loaded_tip(ROBOT, workspace, 20.0), prediction).largest)


def test_one_disc_leaves_the_robot_free_to_turn_about_it():
    cell = Cell(PAPER_NOMINAL, PAPER_DISCS[:1], noise=CELL.noise)
    robot = Robot.of(cell)
    prediction = predict(robot, default_plan(cell))
    assert prediction.rank == 11
    assert np.isinf(tip_std(free_tip(robot, make_workspace(robot)), prediction).largest)


def test_twice_the_touches_halve_the_variance():
    once, twice = predict(ROBOT, PLAN), predict(ROBOT, PLAN, 2 * len(PLAN))
    np.testing.assert_allclose(once.covariance, 2 * twice.covariance, rtol=1e-9)
    assert twice.touches == 2 * len(PLAN)
    assert twice.condition == pytest.approx(once.condition)


def test_leverages_sum_to_at_most_the_rank():
    prediction = predict(ROBOT, PLAN)
    assert 0 < prediction.leverage.min() <= prediction.leverage.max() < 1
    assert prediction.leverage.sum() <= 12 + 1e-9


@pytest.mark.parametrize('load', [None, 30.0])
def test_derivative_of_the_tip(load):
    """At given joint angles and force, the tip moves by T ΔL̄: there, the moved robot reads the same angles."""
    workspace = make_workspace(ROBOT, radii=3, angles=4)
    places, change = workspace.places, 1e-7 * np.linspace(-1, 1, 12)
    moved = Parameters.from_array(PAPER_ACTUAL.as_array() + change)
    if load is None:
        tip = free_tip(ROBOT, workspace).derivative[:, 0] @ change
        joints = np.concatenate([kinematics.inverse(PAPER_ACTUAL, places, side) for side in (1, -1)])
        expected = kinematics.forward(moved, joints) - np.tile(places, (2, 1))
        np.testing.assert_allclose(tip, expected, atol=1e-12)
        return
    tip = loaded_tip(ROBOT, workspace, load, directions=1).derivative[:, 0] @ change
    force = np.tile([load, 0.0], (len(places), 1))
    for k, side in enumerate((1, -1)):
        step = tip[k * len(places) : (k + 1) * len(places)]
        before, _ = inverse_kinetostatics(PAPER_ACTUAL, places, force, side, CELL.gripper)
        after, _ = inverse_kinetostatics(moved, places + step, force, side, CELL.gripper)
        np.testing.assert_allclose(after, before, atol=1e-10)


def test_error_on_touches_not_seen_is_that_of_calibrations():
    plan, ratios = default_plan(CELL, per_disc=4), []
    for seed in range(6):
        found = calibrate(simulate_touches(CELL, PAPER_ACTUAL, plan, seed=seed), CELL)
        fitted = max(found.force_error, CELL.noise.force_rms)
        ratios.append(held_out_force_error(found).force_error / fitted)
    assert held_out_ratio(ROBOT, plan) == pytest.approx(np.mean(ratios), rel=0.25)
    assert held_out_ratio(ROBOT, plan.select(np.arange(13))) > 2 * MOST_HELD_OUT


def test_workspace_keeps_to_its_region_and_refuses_none():
    workspace = make_workspace(ROBOT, Region(0.0, 0.3, 0.2, 0.5))
    assert (workspace.places >= (0.0, 0.2)).all()
    assert (workspace.places <= (0.3, 0.5)).all()
    assert workspace.area.sum() == pytest.approx(1.0)
    with pytest.raises(ParameterError, match='within reach'):
        make_workspace(ROBOT, Region(2.0, 3.0, 2.0, 3.0))


def test_observability_indices():
    indices = observability(np.array([4.0, 1.0]), 4)
    assert indices == pytest.approx((1.0, 0.25, 1.0, 0.25, 0.8))
    assert observability(np.array([1.0, 0.0]), 4) == (0, 0, 0, 0, 0)


def test_noise_must_be_above_zero():
    with pytest.raises(ParameterError, match='noise'):
        Robot.of(CELL, noise=Noise(0.0, 0.3))


def test_unreachable_touch_is_named():
    plan = default_plan(CELL)
    far = Cell(PAPER_NOMINAL, (PAPER_DISCS[0], PAPER_DISCS[1]._replace(x=3.0), PAPER_DISCS[2]), noise=CELL.noise)
    with pytest.raises(UnsupportedDataError, match='cannot reach touch'):
        predict(Robot.of(far), plan)
