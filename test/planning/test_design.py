"""Predictions of the design study: against the calibration itself, against theory, against simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmark.population import errors_of, sizes_of
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.tip_uncertainty import tip_uncertainty
from scara_kinetostatic.diagnosis.mixed_model import fit_mixed
from scara_kinetostatic.effects.objects import ContactFriction
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import (
    PAPER_DISCS,
    Cell,
    EffectSizes,
    Noise,
    Plate,
    Region,
    Sensor,
    SensorFrame,
    SizeMode,
    Uncertainty,
)
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import DRAG
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL
from scara_kinetostatic.model.quantities import micrometres
from scara_kinetostatic.planning.candidate_touches import MOST_HELD_OUT, held_out_ratio
from scara_kinetostatic.planning.optimal_design import Requirements, optimal_design
from scara_kinetostatic.planning.prediction import RobotModel, Statement, exact_plan, predict, tip_in_use, tip_std
from scara_kinetostatic.planning.report import design_report
from scara_kinetostatic.report.page import as_text
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
KNOWN = tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in PAPER_DISCS)
CELLS = {
    'exact': CELL,
    'common': replace(
        CELL, discs=KNOWN, uncertainty=Uncertainty(3e-6, force_gain=0.005, force_rotation=1e-3, nominal={'l1': 1e-5})
    ),
    'plate': replace(
        CELL,
        discs=tuple(disc._replace(center_std=3e-6, plate='a') for disc in KNOWN),
        plates=(Plate('a', 0.0, 0.3, center_std=1e-3, angle_std=2e-3),),
    ),
}
ROBOT = RobotModel.of(CELL, PAPER_ACTUAL)
PLAN = default_plan(CELL)


@pytest.mark.parametrize('truth', [PAPER_ACTUAL, PAPER_MEASURED])
@pytest.mark.parametrize('frame', list(SensorFrame))
def test_exact_touches_satisfy_the_conditions(truth, frame):
    cell = Cell(PAPER_NOMINAL, PAPER_DISCS, sensor=Sensor(frame=frame), noise=CELL.noise)
    exact = exact_plan(RobotModel.of(cell, truth), PLAN)
    assert np.abs(exact.point.linear.misclosure).max() < 1e-12
    simulated = simulate_touches(cell, truth, PLAN, Noise(0.0, 0.0))
    np.testing.assert_allclose(exact.observations.joints, simulated.joints, atol=1e-12)
    np.testing.assert_allclose(exact.observations.force, simulated.force, atol=1e-12)


def test_planned_touches_drag_the_tip_aside_also_back_from_a_preload():
    robot = replace(ROBOT, effects=(ContactFriction(),), effect_values=((0.0,),), effect_sizes=(0.1,))
    plan = default_plan(CELL, preload=0.3)
    planned = exact_plan(robot, plan).observations
    moved = (kinematics.jacobian(PAPER_ACTUAL, planned.joints) @ planned.metadata.press[..., None])[..., 0]
    inward = -(moved * plan.normal()).sum(axis=1)
    aside = (moved * kinematics.quarter_turn(-plan.normal())).sum(axis=1)
    assert ((inward < 0) == (plan.preload > 0)).all()
    assert (np.sign(aside) == np.sign(plan.aside)).all()
    assert (np.abs(aside / inward) >= np.tan(DRAG) - 1e-9).all()
    by_force = np.abs(inward) / plan.force / np.where(plan.preload > 0, plan.preload, 1.0)
    assert (by_force > PAPER_ACTUAL.p_ee).all(), 'arm and gripper yield'


def test_a_planned_touch_has_the_reading_of_a_sensor_that_errs():
    """At 75 N this one reads 50 N, and there is no force at which it reads 75 N."""
    robot = replace(
        ROBOT, effects=(find(CELL, 'sensor_nonlinearity'),), effect_values=((-0.0045,),), effect_sizes=(1.0,)
    )
    exact = exact_plan(robot, default_plan(CELL, levels=(75.0,)))
    assert np.hypot(*exact.observations.force.T) == pytest.approx(75 * (1 - 0.0045 * 75))
    assert np.abs(exact.point.linear.misclosure).max() < 1e-9


@pytest.mark.parametrize('name', CELLS)
@pytest.mark.parametrize('frame', list(SensorFrame))
def test_prediction_is_what_the_calibration_states(name, frame):
    cell = replace(CELLS[name], sensor=Sensor(frame=frame), nominal=PAPER_NOMINAL.replace(l1=PAPER_ACTUAL.l1))
    found = calibrate(simulate_touches(cell, PAPER_ACTUAL, PLAN, seed=3), cell)
    prediction = predict(RobotModel.of(cell, PAPER_ACTUAL), PLAN)
    np.testing.assert_allclose(prediction.std, found.std, rtol=0.03)
    tip = tip_in_use(ROBOT, 40.0)[:, :1]
    parts = prediction.contributions(tip)
    assert np.linalg.norm([*parts.values()]) == pytest.approx(tip_std(tip, prediction).max())
    assert (parts['noise'] > 0) and (set(parts) == {'noise'}) == (name == 'exact')


@pytest.fixture(scope='module')
def stated():
    return optimal_design(RobotModel.of(CELL))


def test_the_statement_is_that_of_robots_with_every_small_error(stated):
    """By the mixed model of the calibration, of robots with errors of typical sizes."""
    known, found = catalogue(CELL), []
    sizes = sizes_of(known)
    for seed in range(3):
        random = np.random.default_rng(seed)
        values = [errors_of(effect, np.array(sizes[effect.label]), random) for effect in known]
        robot = ExtendedModel(PAPER_ACTUAL, known, tuple(values))
        made = simulate_touches(CELL, robot, stated.plan, seed=seed)
        found.append(tip_uncertainty(fit_mixed(calibrate(made, CELL), catalogue(CELL)).fit).worst)
    assert 0.8 < np.median(found) / stated.statement.expanded < 1.25
    assert stated.statement.expanded > 5 * 2 * stated.tip_std


def test_what_limits_is_said_and_what_helps(stated):
    number, many = stated.many
    assert number == 108 and many.expanded < stated.statement.expanded
    for statement in (stated.statement, many):
        parts = np.array([*statement.parts.values()])
        assert np.hypot.reduce(parts) == pytest.approx(0.5 * statement.expanded, rel=1e-3)
    said = ' '.join(as_text(design_report(stated)).split())
    assert f'is expected to state {micrometres(stated.statement.expanded)} µm (k = 2)' in said
    assert f'108, evenly distributed, would leave {micrometres(many.expanded)} µm' in said
    assert 'from undetected object position: measure the objects better, and declare it' in said
    known = replace(CELL, discs=tuple(d._replace(center_std=1e-6, radius_std=1e-6) for d in CELL.discs))
    assert Statement.of(RobotModel.of(known), stated.plan).expanded < 0.9 * stated.statement.expanded
    nothing = EffectSizes(SizeMode.NONE)
    alone = Statement.of(
        RobotModel.of(replace(CELL, uncertainty=replace(CELL.uncertainty, effects=nothing))), stated.plan
    )
    assert [*alone.parts] == ['noise of the touches']
    # of one force, with both axes together in one and the worst direction in the other
    assert 0.5 < alone.expanded / (2 * stated.tip_std) < 2.0


def test_touches_count_and_check_each_other():
    once, twice = predict(ROBOT, PLAN), predict(ROBOT, PLAN, 2 * len(PLAN))
    np.testing.assert_allclose(once.covariance, 2 * twice.covariance, rtol=1e-9)
    assert twice.touches == 2 * len(PLAN)
    assert 0 < once.leverage.min() <= once.leverage.max() < 1
    assert once.leverage.sum() <= 12 + 1e-9


def test_one_level_confounds_the_gripper_and_leaves_the_free_tip():
    prediction = predict(ROBOT, default_plan(CELL, levels=(40.0,)))
    at_level, below = tip_in_use(ROBOT, 40.0), tip_in_use(ROBOT, 20.0)
    assert prediction.rank == 11
    assert prediction.confounded == (('p_ee', 'g_ee'),)
    assert np.isnan(prediction.std[[NAMES.index('p_ee'), NAMES.index('g_ee')]]).all()
    assert np.isfinite(np.delete(prediction.std, [6, 9])).all()
    assert tip_std(at_level[:, :1], prediction).max() < 1e-5
    assert np.isfinite(tip_std(at_level, prediction).max())
    assert np.isinf(tip_std(below, prediction).max())


def test_one_disc_leaves_the_robot_free_to_turn_about_it():
    cell = Cell(PAPER_NOMINAL, PAPER_DISCS[:1], noise=CELL.noise)
    robot = RobotModel.of(cell)
    prediction = predict(robot, default_plan(cell))
    assert prediction.rank == 11
    assert np.isinf(tip_std(tip_in_use(robot, 40.0)[:, :1], prediction).max())
    with pytest.raises(UnsupportedDataError, match='second disc'):
        optimal_design(robot, Requirements(per_disc=12))


def test_error_on_touches_not_seen_is_that_of_calibrations():
    plan, ratios = default_plan(CELL, per_disc=4), []
    for seed in range(6):
        found = calibrate(simulate_touches(CELL, PAPER_ACTUAL, plan, seed=seed), CELL)
        fitted = max(found.force_error, CELL.noise.force_rms)
        ratios.append(held_out_force_error(found).force_error / fitted)
    assert held_out_ratio(ROBOT, plan) == pytest.approx(np.mean(ratios), rel=0.25)
    assert held_out_ratio(ROBOT, plan.select(np.arange(13))) > 2 * MOST_HELD_OUT


def test_the_tip_keeps_to_region_and_limits_and_refuses_none():
    everywhere, prediction = tip_in_use(ROBOT, 30.0), predict(ROBOT, default_plan(CELL))
    limited, region = replace(CELL, limits=((-0.5, 2.0), (0.0, 2.2))), Region(0.0, 0.3, 0.2, 0.5)
    for cell in (limited, replace(CELL, region=region)):
        tip = tip_in_use(replace(ROBOT, cell=cell), 30.0)
        assert tip_std(tip, prediction).max() < tip_std(everywhere, prediction).max()
    assert len(tip_in_use(replace(ROBOT, cell=limited), 30.0)) < 0.5 * len(everywhere)
    for wrong, text in (
        ({'region': Region(2.0, 3.0, 2.0, 3.0)}, 'within reach'),
        ({'limits': ((0.0, 1e-3), (1.0, 1.001))}, r'robot\.limits: they leave 0.* % of the workspace within reach'),
    ):
        with pytest.raises(ParameterError, match=text):
            tip_in_use(replace(ROBOT, cell=replace(CELL, **wrong)), 30.0)


def test_unreachable_touch_is_named():
    far = replace(CELL, discs=(PAPER_DISCS[0], PAPER_DISCS[1]._replace(x=3.0), PAPER_DISCS[2]))
    with pytest.raises(UnsupportedDataError, match='cannot reach touch'):
        predict(RobotModel.of(far), PLAN)
