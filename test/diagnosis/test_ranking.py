"""The closed forms of the diagnosis against explicit fits."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis.simulated import CELL, examined, simulate

from benchmark.odds import declaring
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.candidates import gains, gather, scan_trials, significance
from scara_kinetostatic.diagnosis.linear_problem import pose_problem
from scara_kinetostatic.effects.registry import catalogue


def test_a_fitted_effect_that_adds_nothing_to_the_base_model_is_not_significant():
    problem = pose_problem(calibrate(simulate(), CELL))
    candidate = gather(problem, catalogue(CELL)).candidates[0]
    assert significance(problem, candidate)[0] < 1
    assert significance(problem, candidate._replace(rank=0)) == (1.0, 0.0)


@pytest.mark.parametrize('declared', [False, True])
@pytest.mark.parametrize('label', ['transmission_error[joint1]', 'joint_slip[joint2]', 'shift[disc_1]'])
def test_a_scan_of_a_grid_has_the_inner_products_of_its_columns(label, declared):
    """Against the columns of each trial, whitened for what declared errors add."""
    cell = declaring(CELL, declared)
    problem = pose_problem(calibrate(simulate(), cell))
    effects = {item.label: item for item in catalogue(cell)}
    (other,) = effects['encoder_gain[joint1]'].trials(problem.touch_state, problem.force)
    effect, beside = effects[label], problem.independent_part(other)
    trials = effect.trials(problem.touch_state, problem.force)
    scan = scan_trials(problem, effect, trials, len(trials))
    gained = gains(problem, scan, beside)
    for k in (3, len(trials) // 2):
        columns = problem.columns(trials[k])
        left = columns - problem.base @ (problem.base.T @ columns)
        np.testing.assert_allclose(scan.gram[k], left.T @ left, rtol=1e-7, atol=1e-9 * np.abs(columns).max() ** 2)
        np.testing.assert_allclose(scan.projected[k], left.T @ problem.left, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(problem.marginal.apply(scan.columns.of_trial(k)), columns, rtol=1e-9, atol=1e-12)
        unit = np.linalg.qr(left - beside @ (beside.T @ left))[0]
        assert gained[k] == pytest.approx(float(np.square(unit.T @ problem.left).sum()), rel=2e-3, abs=2e-3)


def test_everything_in_the_catalogue_is_ranked_once():
    _, found = examined('encoder_gain[joint1]', (6e-5,))
    labels = [item.effect.label for item in found.ranking if item.effect.name != 'unnamed']
    assert sorted(labels) == sorted(item.label for item in catalogue(CELL))
    best = found.ranking[0]
    assert best.effect.label == 'encoder_gain[joint1]'
    assert best.role == 'found'


def test_of_no_effects_there_are_no_candidates():
    problem = pose_problem(calibrate(simulate(), CELL))
    assert gather(problem, []).candidates == ()
    (columns, additions) = problem.additions([])
    assert (columns, additions.rank) == ([], [])
