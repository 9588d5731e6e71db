"""The closed forms of the diagnosis against explicit fits."""

from __future__ import annotations

from diagnosis.simulated import CELL, examined, simulate

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.candidates import gather, significance
from scara_kinetostatic.diagnosis.linear_problem import pose_problem
from scara_kinetostatic.effects.registry import catalogue


def test_a_fitted_effect_that_adds_nothing_to_the_base_model_is_not_significant():
    problem = pose_problem(calibrate(simulate(), CELL))
    candidate = gather(problem, catalogue(CELL)).candidates[0]
    assert significance(problem, candidate)[0] < 1
    assert significance(problem, candidate._replace(unit=candidate.unit[:, :0])) == (1.0, 0.0)


def test_everything_in_the_catalogue_is_ranked_once():
    _, found = examined('encoder_gain[joint1]', (6e-5,))
    labels = [item.effect.label for item in found.ranking if item.effect.name != 'unnamed']
    assert sorted(labels) == sorted(item.label for item in catalogue(CELL))
    best = found.ranking[0]
    assert best.effect.label == 'encoder_gain[joint1]'
    assert best.role == 'found'
