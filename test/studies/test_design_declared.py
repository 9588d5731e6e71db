"""Declared uncertainties in a design: the prediction is that of the calibration, and the bound still holds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise, Plate, SensorFrame, Uncertainty
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.candidates import candidate_plan, prepare_candidates
from scara_kinetostatic.studies.design.layouts import TouchPattern, disc_stds, map_additional_disc
from scara_kinetostatic.studies.design.optimal_design import (
    AccuracySource,
    Requirements,
    check_attainable,
    contributions,
    limit,
    required_tip,
    with_usual_accuracy,
)
from scara_kinetostatic.studies.design.prediction import Robot, free_tip, make_workspace, predict, tip_std
from scara_kinetostatic.studies.design.search import best_set, find_lower_bound, largest_of_sets, random_sets

DISCS = tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in PAPER_DISCS)
EXACT = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
CELL = replace(EXACT, discs=DISCS)
COMMON = Uncertainty(radius=3e-6, force_gain=0.005, force_rotation=1e-3, nominal={'l1': 1e-5})
ON_PLATE = replace(
    CELL,
    discs=tuple(disc._replace(center_std=3e-6, plate='a') for disc in DISCS),
    plates=(Plate('a', 0.0, 0.3, center_std=1e-3, angle_std=2e-3),),
)
ROBOT = Robot.of(CELL, PAPER_ACTUAL)
PLAN = default_plan(CELL)


@pytest.fixture(scope='module')
def candidates():
    tip = free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=18))
    return prepare_candidates(ROBOT, candidate_plan(ROBOT, (10.0, 40.0), per_disc=12), tip)


@pytest.mark.parametrize('cell', [CELL, replace(CELL, uncertainty=COMMON), ON_PLATE], ids=['discs', 'common', 'plate'])
@pytest.mark.parametrize('frame', list(SensorFrame))
def test_prediction_is_what_the_calibration_states(cell, frame):
    nominal = PAPER_NOMINAL.replace(l1=PAPER_ACTUAL.l1)  # what is trusted holds
    cell = replace(cell, sensor=cell.sensor._replace(frame=frame), nominal=nominal)
    found = calibrate(simulate_touches(cell, PAPER_ACTUAL, PLAN, seed=3), cell)
    np.testing.assert_allclose(predict(Robot.of(cell, PAPER_ACTUAL), PLAN).std, found.std, rtol=0.03)


def test_very_small_uncertainties_change_nothing():
    tiny = replace(CELL, discs=tuple(disc._replace(center_std=1e-12, radius_std=1e-12) for disc in DISCS))
    expected = predict(Robot.of(EXACT, PAPER_ACTUAL), PLAN)
    got = predict(Robot.of(tiny, PAPER_ACTUAL), PLAN)
    np.testing.assert_allclose(got.covariance, expected.covariance, rtol=1e-5, atol=1e-20)
    np.testing.assert_allclose(got.leverage, expected.leverage, rtol=1e-5)
    assert got.indices == pytest.approx(expected.indices, rel=1e-5)


def test_contributions_add_up():
    tip = free_tip(ROBOT, make_workspace(ROBOT))
    prediction = predict(Robot.of(replace(CELL, uncertainty=COMMON), PAPER_ACTUAL), PLAN)
    parts = contributions(prediction, tip)
    assert sum(value**2 for value in parts.values()) == pytest.approx(tip_std(tip, prediction).largest ** 2)
    assert parts['the places of the discs'] > parts['noise']


def test_more_touches_do_not_reduce_what_the_discs_leave():
    tip, usual = required_tip(ROBOT, Requirements()), with_usual_accuracy(ROBOT, Requirements())
    lowest, prediction = limit(ROBOT, usual, tip)
    assert 1.08 * lowest < usual.accuracy < 1.13 * lowest
    assert tip_std(tip, predict(ROBOT, PLAN, 36)).largest < 1.05 * lowest  # without declared errors twice as much
    assert contributions(prediction, tip)['the places of the discs'] > 0.9 * lowest


def test_bound_holds_and_says_what_is_out_of_reach(candidates):
    tip = required_tip(ROBOT, Requirements())
    lowest, _ = limit(ROBOT, Requirements(), tip)
    bound = find_lower_bound(candidates, 1.1 * lowest)
    assert 0.9 * bound.reached < bound.variance(bound.touches) <= bound.reached
    for number in (14, 24, 60):
        assert best_set(candidates, bound, number, starts=1).value ** 2 >= bound.variance(number)
    for number in (30, 10**4):
        assert tip_std(tip, predict(ROBOT, candidates.plan, number)).largest ** 2 >= bound.variance(number)
    assert check_attainable(ROBOT, Requirements(accuracy=lowest), tip, bound) == lowest
    too_small = 0.8 * lowest
    with pytest.raises(UnsupportedDataError, match='the places of the discs alone'):
        check_attainable(ROBOT, Requirements(accuracy=too_small), tip, find_lower_bound(candidates, too_small))


def test_candidates_judge_as_the_prediction_does(candidates):
    tip = free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=18))
    chosen = random_sets(candidates, 30, 1)[0]
    expected = tip_std(tip, predict(ROBOT, candidates.plan.select(chosen))).largest
    assert largest_of_sets(candidates, chosen[None])[0] == pytest.approx(expected, rel=1e-3)


def test_layouts_judge_as_the_prediction_does():
    """Without the additional disc the map states what evenly distributed touches on the discs of the cell give."""
    for cell in (CELL, replace(CELL, uncertainty=COMMON)):
        robot = Robot.of(cell)
        tip = free_tip(robot, make_workspace(robot, radii=3, angles=12))
        pattern = TouchPattern(points=36)
        found = map_additional_disc(robot, tip, pattern=pattern, numbers=(24, 12), radius=0.05, grid=3)
        expected = tip_std(tip, predict(robot, candidate_plan(robot, pattern.levels), 36)).largest
        assert found.without == pytest.approx(expected, rel=0.03)


def test_the_plate_counts_to_the_place_of_a_disc():
    stds = disc_stds(ON_PLATE)
    assert (stds[:, :2] > 1e-3).all()
    assert stds[0, 1] == pytest.approx(np.sqrt(3e-6**2 + 1e-3**2 + (2e-3 * 0.25) ** 2))


def test_all_discs_on_one_plate_are_judged_in_its_frame():
    robot = Robot.of(ON_PLATE)
    tip = required_tip(robot, Requirements())
    assert robot.common_plate == ON_PLATE.plates[0]
    assert tip_std(tip, predict(robot, PLAN)).largest > 1e-3
    assert tip_std(tip, predict(robot.on_plate(), PLAN)).largest < 2e-5
    assert Robot.of(CELL).common_plate is None


def test_the_usual_accuracy_is_one_that_can_be_reached():
    tolerated = with_usual_accuracy(Robot.of(replace(CELL, tolerance=2e-4)), Requirements())
    assert (tolerated.accuracy, tolerated.accuracy_source) == (1e-4, AccuracySource.TOLERANCE)
    assert with_usual_accuracy(Robot.of(EXACT), Requirements()).accuracy == 1e-5
    assert with_usual_accuracy(ROBOT, Requirements()).accuracy_source is AccuracySource.ATTAINABLE


def test_trusted_nominal_values_are_as_certain_as_they_were_declared():
    trusted = replace(EXACT, uncertainty=Uncertainty(nominal={'l1': 1e-9}))
    assert predict(Robot.of(trusted), PLAN).std[NAMES.index('l1')] == pytest.approx(1e-9, rel=1e-3)


def test_noise_that_nobody_stated_is_marked():
    assert Robot.of(replace(CELL, noise=None)).assumed == ('joint', 'force')
    assert Robot.of(CELL).assumed == ()


def test_an_unattainable_tolerance_is_named_in_plain_lengths() -> None:
    robot = Robot.of(replace(CELL, tolerance=2e-6))
    wanted = with_usual_accuracy(robot, Requirements())
    bound = SimpleNamespace(variance=lambda count: np.inf)
    with pytest.raises(UnsupportedDataError) as caught:
        check_attainable(robot, wanted, required_tip(robot, wanted), bound)  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith('an accuracy of 1 µm (half of tolerance.tip: k = 2) is out of reach')
    assert 'e-0' not in message
    assert '(--accuracy 0.00' in message
