"""The smallest set that checks itself: its proof from below, its minimality, its agreement with calibrations."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.candidates import (
    MOST_LEVERAGE,
    PRIOR,
    TOUCHES_PER_DISC,
    candidate_plan,
    least_on_discs,
    leverage_with_each,
    leverages,
    pack,
    prepare_candidates,
)
from scara_kinetostatic.studies.design.optimal_design import Requirements, optimal_design
from scara_kinetostatic.studies.design.prediction import Robot, exact_plan, free_tip, make_workspace, predict, tip_std
from scara_kinetostatic.studies.design.search import (
    best_set,
    check_set,
    find_lower_bound,
    improve,
    largest_of_sets,
    largest_variance,
    random_sets,
    smallest_set,
    variance_with_each,
)

NOISE = Noise(joint=1e-5, force=0.3)
CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=NOISE)
ROBOT = Robot.of(CELL, PAPER_ACTUAL)
TARGET = 1.5e-5


@pytest.fixture(scope='module')
def candidates():
    plan = candidate_plan(ROBOT, (10.0, 40.0), per_disc=18)
    return prepare_candidates(ROBOT, plan, free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=18)))


@pytest.fixture(scope='module')
def bound(candidates):
    return find_lower_bound(candidates, TARGET)


@pytest.fixture(scope='module')
def found(candidates, bound):
    return smallest_set(candidates, bound, TARGET)


def test_candidates_keep_off_the_axes(candidates):
    assert exact_plan(ROBOT, candidates.plan).arms.min() >= 0.02


def test_pool_judges_as_the_prediction_does(candidates):
    chosen = random_sets(candidates, 30, 1)[0]
    tip = free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=18))
    expected = tip_std(tip, predict(ROBOT, candidates.plan.select(chosen))).largest
    assert np.sqrt(largest_variance(candidates, chosen.tolist())) == pytest.approx(expected, rel=1e-4)
    assert largest_of_sets(candidates, chosen[None])[0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize('smooth', [False, True])
def test_an_added_touch_is_judged_as_if_it_were_in_the_set(candidates, smooth):
    chosen = random_sets(candidates, 14, 1)[0].tolist()
    values = variance_with_each(candidates, chosen, smooth=smooth)
    for other in (0, 17, 101):
        assert values[other] == pytest.approx(largest_variance(candidates, [*chosen, other], smooth=smooth), rel=1e-9)


def test_exchange_never_makes_it_worse(candidates):
    chosen = random_sets(candidates, 14, 1)[0].tolist()
    better = improve(candidates, chosen)
    assert len(set(better)) == 14
    assert largest_variance(candidates, better) < largest_variance(candidates, chosen)


def test_bound_holds_and_is_tight(candidates, bound):
    assert 0.97 * bound.reached < bound.variance(1) <= bound.reached
    for number in (14, 24, 60):
        assert best_set(candidates, bound, number, starts=1).value ** 2 >= bound.variance(number)


def test_the_smallest_set_is_minimal_and_survives_every_loss(candidates, bound, found):
    number, plan = len(found.chosen), candidates.plan.select(np.array(found.chosen))
    assert bound.number(TARGET) < number <= 18
    assert list(found.tried) == list(range(bound.number(TARGET) + 1, number))
    assert min(found.tried.values(), default=np.inf) > TARGET >= found.value
    checked = check_set(ROBOT, candidates, found.chosen, plan, _tip(), seed=1)
    assert checked.without_each.max() == pytest.approx(found.value, rel=1e-6)
    assert checked.growth.max() <= 1 / np.sqrt(1 - MOST_LEVERAGE) + 1e-6
    assert checked.random[0] > tip_std(_tip(), predict(ROBOT, plan)).largest
    assert checked.more_compliant > tip_std(_tip(), predict(ROBOT, plan)).largest


def test_the_smallest_set_has_no_large_leverage_and_touches_every_disc(candidates, bound, found):
    plan = candidates.plan.select(np.array(found.chosen))
    any_set = best_set(candidates, bound, len(plan) - 3, starts=2)
    assert predict(ROBOT, plan).leverage.max() <= MOST_LEVERAGE < leverages(candidates, list(any_set.chosen)).max()
    assert np.bincount(plan.disc, minlength=3).min() >= TOUCHES_PER_DISC


def test_leverage_bounds_what_a_loss_does(candidates):
    """√(1 / (1 - λ)) bounds the growth of every standard deviation, with and without a touch that matters."""
    chosen = random_sets(candidates, 18, 1)[0].tolist()
    own, c = leverages(candidates, chosen), candidates.information_of(chosen)
    for k, touch in enumerate(chosen):
        before, after = (np.diag(np.linalg.inv(part)) for part in (c, c - candidates.information[touch]))
        assert np.sqrt((after / before).max()) <= 1 / np.sqrt(1 - own[k]) + 1e-9


def test_leverage_of_an_added_touch(candidates):
    chosen = random_sets(candidates, 18, 1)[0].tolist()
    largest = leverage_with_each(candidates, chosen)
    for other in (0, 17, 101):
        assert largest[other] == pytest.approx(leverages(candidates, [*chosen, other]).max(), rel=1e-9)


def test_more_discs_than_touches_suffice_for(candidates):
    weights = np.bincount(np.flatnonzero(candidates.plan.disc == 1), minlength=len(candidates.plan)).astype(float)
    assert least_on_discs(candidates, weights, 20).tolist() == [3, 3, 3]
    assert least_on_discs(candidates, weights, 5).tolist() == [0, 3, 0]


def test_one_disc_does_not_determine_the_tip():
    robot = Robot.of(Cell(PAPER_NOMINAL, PAPER_DISCS[:1], noise=NOISE))
    with pytest.raises(UnsupportedDataError, match='second disc'):
        optimal_design(robot, Requirements(per_disc=12))


def test_out_of_reach_is_said(candidates, bound):
    with pytest.raises(UnsupportedDataError, match='out of reach'):
        smallest_set(candidates, bound, 1e-7)


def test_scatter_of_calibrations_with_the_smallest_set(candidates, found):
    """Balanced noise: the sample covariance is exactly the stated one, so that no sampling error is left."""
    plan, runs = candidates.plan.select(np.array(found.chosen)), 72
    predicted = predict(ROBOT, plan)
    exact = simulate_touches(CELL, PAPER_ACTUAL, plan, Noise(0.0, 0.0))
    drawn = np.random.default_rng(1).standard_normal((runs, 4 * len(plan)))
    left, _, right = np.linalg.svd(drawn - drawn.mean(axis=0), full_matrices=False)
    noise = (np.sqrt(runs - 1) * left @ right).reshape(runs, len(plan), 2, 2)
    errors = []
    for joint, force in zip(noise[:, :, 0], noise[:, :, 1], strict=True):
        touches = exact.replace(joints=exact.joints + NOISE.joint * joint, force=exact.force + NOISE.force * force)
        errors.append(calibrate(touches, CELL).parameters.as_array() - PAPER_ACTUAL.as_array())
    np.testing.assert_allclose(np.std(errors, axis=0, ddof=1) / predicted.std, 1.0, atol=0.05)


def test_packed_matrices_give_traces():
    a, b = (m @ m.T for m in np.random.default_rng(0).standard_normal((2, 5, 5)))
    assert pack(a) @ pack(b, twice=True) == pytest.approx(np.trace(a @ b))
    assert len(PRIOR) == 12


def _tip():
    return free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=18))
