"""The closed forms of the diagnosis against explicit fits."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis.simulated import CELL, examined, simulate
from scipy import stats

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.candidates import gather, significance
from scara_kinetostatic.diagnosis.linear_problem import f_test, pose_problem
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


def test_f_test_is_that_of_the_textbook():
    """Against a regression by hand: two columns, beside three that are in the fit already."""
    rng = np.random.default_rng(4)
    design, values = rng.normal(size=(40, 5)), rng.normal(size=40)
    values += 0.4 * design[:, 4]
    base, _ = np.linalg.qr(design[:, :3])
    residual = values - base @ (base.T @ values)
    more, _ = np.linalg.qr(design[:, 3:] - base @ (base.T @ design[:, 3:]))
    before = residual @ residual
    after = np.linalg.lstsq(design, values, rcond=None)[1][0]
    expected = stats.f.sf((before - after) / 2 / (after / 35), 2, 35)
    assert f_test(more, residual, 37) == pytest.approx((expected, 1 - after / before))
    assert f_test(more[:, :0], residual, 37) is None
    assert f_test(more, residual, 2) is None
    assert f_test(more, 0 * residual, 37) is None
    expected = stats.f.sf((before - after) / 2 / 4.0, 2, 35)  # where the noise is known to be larger
    assert f_test(more, residual, 37, 4.0) == pytest.approx((expected, 1 - after / before))
