"""Touches planned for an arm that stands upright."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import scara_kinetostatic as sk
from scara_kinetostatic.model.cell import PAPER_DISCS, EffectSizes, SizeMode, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.candidate_touches import LEAST_ARM, candidate_plan
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.planning.prediction import RobotModel, exact_plan, predict, tip_in_use, tip_std
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

GRAVITY = (0.0, -9.81)
TRUTH = sk.PAPER_ACTUAL.replace(s1=1.6, s2=0.5, gravity=GRAVITY)
CELL = sk.Cell(
    sk.PAPER_NOMINAL.replace(s1=1.3, s2=0.4, gravity=GRAVITY),
    PAPER_DISCS,
    noise=sk.Noise(joint=1e-5, force=0.3),
    limits=((-3.1, 3.1), (-2.7, 2.7)),
)
FRICTION = parse_effect('contact_friction:coefficient=0.05', CELL)
NONE = EffectSizes(SizeMode.NONE)


def test_a_fit_scatters_as_predicted():
    robot = RobotModel.of(CELL, TRUTH)
    every = candidate_plan(robot, (10.0, 40.0), per_disc=12)
    predicted = predict(robot, every)
    assert predicted.rank == 14 and tip_std(tip_in_use(robot, 40.0)[:, :1], predicted).max() < 2e-5
    found = sk.calibrate(simulate_touches(CELL, ExtendedModel(TRUTH), every, CELL.noise, 5), CELL)
    np.testing.assert_allclose(found.std, predicted.std, rtol=0.15)
    assert np.abs((found.parameters.as_array() - TRUTH.as_array()) / found.std).max() < 4.0


def test_touches_whose_flank_is_doubtful_are_no_candidates():
    robot = RobotModel.of(CELL)
    kept = candidate_plan(robot, (10.0, 40.0))
    assert (exact_plan(robot, kept).arms >= LEAST_ARM).all()
    level = candidate_plan(RobotModel.of(replace(CELL, nominal=sk.PAPER_NOMINAL)), (10.0, 40.0))
    assert 0.2 * len(level) < len(kept) < 0.9 * len(level)
    force, modes = -kept.force[:, None] * kept.normal(CELL), []
    for lighter in (0.85, 1.0, 1.15):  # as long as the moments are about right
        arm = CELL.nominal.replace(s1=lighter * CELL.nominal.s1, s2=lighter * CELL.nominal.s2)
        modes.append(np.sign(inverse_kinetostatics(arm, kept.contact(CELL), force, kept.posture)[1]))
    assert np.ptp(modes, axis=0).max() == 0


def test_planned_touches_lose_fewer_than_even_ones():
    arm = sk.calibrate(sk.simulate(CELL, TRUTH, seed=3), CELL).arm
    planned = Planner(arm, now=1e-4).accurate(18).plan
    even = default_plan(CELL, 4, (20.0,))
    lost = []
    for plan in (planned, even):
        touches = simulate_touches(CELL, ExtendedModel(TRUTH), plan, CELL.noise, 5)
        lost.append(len(sk.calibrate(touches, CELL).rejected) / len(plan))
    assert lost[0] < 0.5 * lost[1]


def test_a_few_places_touched_again_and_again_are_not_fitted_alone():
    """More than half of the touches: by a backlash of milliradians they fit well, and all others are the outliers."""
    cell, random = replace(CELL, limits=None), np.random.default_rng(6)
    truth = with_effects(TRUTH, [FRICTION])
    some = default_plan(cell, 4, (20.0, 60.0), preload=0.3)
    again = np.repeat(random.choice(len(some), 4, replace=False), 20)
    plan = some.select(np.concatenate([np.arange(len(some)), again]))
    found = sk.calibrate(simulate_touches(cell, truth, plan, cell.noise, 6), cell)
    assert len(found.rejected) < 0.1 * len(plan)
    off = np.abs(found.parameters.as_array() - TRUTH.as_array())
    assert off[:6].max() < 1e-4 and off[9:12].max() < 5e-4


def test_one_touch_that_slid_the_other_way_does_not_hide_the_friction():
    """With it no model with friction settled, and friction was given up for a base model without nine touches."""
    cell = replace(CELL, limits=None, uncertainty=Uncertainty(nominal={'s1': 0.4, 's2': 0.12}, effects=NONE))
    truth = with_effects(TRUTH, [FRICTION])
    plan = default_plan(cell, 6, (20.0, 60.0), preload=0.3)
    plan = plan.select(np.random.default_rng(8).permutation(len(plan))[:26])
    touches = simulate_touches(cell, truth, plan, cell.noise, 8)
    force = touches.force.copy()
    force[5] = rotate(force[5:6], -0.1)[0]
    found = calibrate_touches(touches.replace(force=force), cell)
    assert [item.effect.label for item in found.diagnosis.found] == ['contact_friction']
    assert found.final.touches.index[~found.final.used].tolist() == [5]
