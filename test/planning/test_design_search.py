"""The smallest set that checks itself: its checks, its agreement with calibrations; what limits it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.planning.candidate_touches import (
    MOST_LEVERAGE,
    TOUCHES_PER_DISC,
    candidate_plan,
    checked,
    choose,
    largest_variance,
    prepare_candidates,
    variance_with_each,
    without_each,
)
from scara_kinetostatic.planning.optimal_design import Requirements, optimal_design, required
from scara_kinetostatic.planning.prediction import RobotModel, exact_plan, predict, tip_in_use, tip_std
from scara_kinetostatic.simulation.streams import simulate_touches

NOISE = Noise(joint=1e-5, force=0.3)
CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=NOISE)
ROBOT = RobotModel.of(CELL, PAPER_ACTUAL)
DECLARED = replace(CELL, discs=tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in PAPER_DISCS))
EASY = Requirements(accuracy=1.05e-5, levels=(10.0, 40.0), per_disc=9)


def tip_of(robot):
    return tip_in_use(robot, 40.0, 9)[:, :1]


def prepared(robot, mean=False):
    return prepare_candidates(robot, candidate_plan(robot, (10.0, 40.0), per_disc=9), tip_of(robot), mean=mean)


@pytest.fixture(scope='module')
def candidates():
    return prepared(ROBOT)


@pytest.fixture(scope='module')
def judged():
    """With the mean over the workspace, and the parameters, as what counts."""
    return prepared(ROBOT, mean=True).counting(np.arange(12), 0.1, 30)


@pytest.fixture(scope='module')
def design():
    return optimal_design(ROBOT, EASY)


@pytest.fixture(scope='module')
def some(candidates):
    return np.random.default_rng(1).permutation(len(candidates.plan))[:18].tolist()


@pytest.mark.parametrize('cell', [CELL, DECLARED], ids=['exact', 'declared'])
def test_candidates_judge_as_the_prediction_does(cell):
    robot = RobotModel.of(cell, PAPER_ACTUAL)
    candidates, tip = prepared(robot), tip_of(robot)
    assert exact_plan(robot, candidates.plan).arms.min() >= 0.02
    chosen = np.arange(0, len(candidates.plan), 5)
    expected = tip_std(tip, predict(robot, candidates.plan.select(chosen))).max()
    assert np.sqrt(largest_variance(candidates, chosen.tolist())) == pytest.approx(expected, rel=1e-3)


def test_an_added_touch_is_judged_as_if_it_were_in_the_set(judged, some):
    values = variance_with_each(judged, some)
    for other in sorted(set(range(5)) - set(some))[:3]:
        assert values[other] == pytest.approx(largest_variance(judged, [*some, other]), rel=1e-9)


def test_no_exchange_gains_and_no_other_set_is_better(judged, some):
    chosen = choose(judged, 18)
    reached = largest_variance(judged, chosen)
    assert len(set(chosen)) == 18
    assert reached < 0.8 * largest_variance(judged, some)
    for place in range(18):
        others = chosen[:place] + chosen[place + 1 :]
        values = np.delete(variance_with_each(judged, others), others)
        assert values.min() > 0.98 * reached


def test_a_touch_that_no_other_checks_gets_others(judged):
    low = judged.plan.force < 40.0  # a single touch of another level separates p_ee from g_ee alone
    chosen = [*np.flatnonzero(~low)[:60:4].tolist(), int(np.flatnonzero(low)[0])]
    assert judged.leverages(chosen)[-1] > MOST_LEVERAGE
    more = checked(judged, chosen)
    assert more[: len(chosen)] == chosen and len(more) < len(chosen) + 10
    assert judged.leverages(more).max() <= MOST_LEVERAGE
    assert checked(judged, more) == more


def test_leverage_bounds_what_a_loss_does(candidates, some):
    """√(1 / (1 - λ)) bounds the growth of every standard deviation, with and without a touch that matters."""
    own, c = candidates.leverages(some), candidates.information_of(some)
    for k, touch in enumerate(some):
        before, after = (np.diag(np.linalg.inv(part)) for part in (c, c - candidates.information[touch]))
        assert np.sqrt((after / before).max()) <= 1 / np.sqrt(1 - own[k]) + 1e-9


def test_the_set_reaches_the_accuracy_after_every_loss_and_checks_itself(design):
    number = len(design.plan)
    assert number <= 24
    assert design.accuracy >= design.without_each.max()
    tip = required(design.tip, design.requirements)
    for k, expected in enumerate(design.without_each[:4]):
        rest = predict(ROBOT, design.plan.select(np.delete(np.arange(number), k)))
        assert tip_std(tip, rest).max() == pytest.approx(expected, rel=1e-3)
    assert design.prediction.leverage.max() <= MOST_LEVERAGE
    assert np.bincount(design.plan.disc, minlength=3).min() >= TOUCHES_PER_DISC
    np.testing.assert_allclose(without_each(ROBOT, design.plan, tip), design.without_each)
    assert (np.diff(design.curve.chosen) < 0).all()
    assert (design.curve.chosen < design.curve.evenly_distributed).all()


def test_every_other_touch_of_a_disc_and_posture_has_a_preload(design):
    plan = design.plan
    for disc, side in {*zip(plan.disc.tolist(), plan.posture.tolist(), strict=True)}:
        preload = plan.preload[(plan.disc == disc) & (plan.posture == side)]
        assert np.unique(preload).tolist() in ([0.0, 0.3], [0.3])
        assert (preload == 0.3).sum() == -(-len(preload) // 2)


@pytest.mark.parametrize('number', [5, 9, 20])
def test_every_disc_is_touched_as_often_as_touches_suffice_for(judged, number):
    on_each = np.bincount(judged.plan.disc[choose(judged, number, 3)], minlength=3)
    assert on_each.sum() == number
    assert (on_each >= 3).all() if number >= 9 else (on_each <= 3).all()


def test_declared_uncertainties_limit_the_accuracy_and_are_named():
    found = optimal_design(RobotModel.of(DECLARED), replace(EASY, accuracy=None, per_disc=6))
    assert found.accuracy < 1e-4
    assert found.accuracy == pytest.approx(1.1 * found.least_possible)
    parts = found.contributions
    assert sum(value**2 for value in parts.values()) == pytest.approx(found.tip_std**2)
    assert max(parts, key=parts.get) == 'object_position'
    with pytest.raises(UnsupportedDataError, match='object_position alone') as caught:
        optimal_design(RobotModel.of(replace(DECLARED, tolerance=2e-6)), replace(EASY, accuracy=None))
    assert str(caught.value).startswith('an accuracy of 1 µm (half of tolerance.tip: k = 2) is out of reach')


def test_scatter_of_calibrations_with_the_recommended_set(design):
    """Balanced noise: the sample covariance is exactly the stated one, so that no sampling error is left."""
    plan, runs = design.plan, 4 * len(design.plan) + 2
    exact = simulate_touches(CELL, PAPER_ACTUAL, plan, Noise(0.0, 0.0))
    drawn = np.random.default_rng(1).standard_normal((runs, 4 * len(plan)))
    left, _, right = np.linalg.svd(drawn - drawn.mean(axis=0), full_matrices=False)
    noise = (np.sqrt(runs - 1) * left @ right).reshape(runs, len(plan), 2, 2)
    errors = []
    for joint, force in zip(noise[:, :, 0], noise[:, :, 1], strict=True):
        touches = exact.replace(joints=exact.joints + NOISE.joint * joint, force=exact.force + NOISE.force * force)
        errors.append(calibrate(touches, CELL).parameters.as_array() - PAPER_ACTUAL.as_array())
    np.testing.assert_allclose(np.std(errors, axis=0, ddof=1) / design.prediction.std, 1.0, atol=0.05)
