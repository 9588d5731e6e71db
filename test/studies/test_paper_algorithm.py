"""The paper's algorithm and section 5.1."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.model.parameters import G_EE, P_EE, PAPER_ACTUAL
from scara_kinetostatic.studies.paper.study import (
    NOISE,
    ONE_LEVEL,
    THREE_LEVELS,
    determined_combination,
    predicted_covariances,
    run,
)

TRUTH = PAPER_ACTUAL.as_array()
OTHERS = [j for j in range(12) if j not in (P_EE, G_EE)]


def test_one_level_without_noise_as_in_table_2():
    result = run(ONE_LEVEL)
    assert result.paper.force_error < 1e-9
    assert result.paper.iterations <= 30
    assert (np.diff(result.paper.merit) < 0).all()  # each step lowers the error
    assert result.paper.history[0] > 1
    assert result.weighted.force_error < 1e-9
    assert result.weighted.iterations <= 10
    for found in (result.paper.parameters, result.weighted.parameters):
        values = found.as_array()
        np.testing.assert_allclose(values[OTHERS], TRUTH[OTHERS], rtol=1e-8)
        np.testing.assert_allclose(determined_combination(values), determined_combination(TRUTH), rtol=1e-8)
    assert result.paper.rank == result.weighted.identifiability.rank == 11
    assert result.weighted.identifiability.confounded == (('p_ee', 'g_ee'),)


def test_three_levels_without_noise_give_all_twelve():
    result = run(THREE_LEVELS)
    np.testing.assert_allclose(result.paper.parameters.as_array(), TRUTH, rtol=1e-6)
    np.testing.assert_allclose(result.weighted.parameters.as_array(), TRUTH, rtol=1e-6)
    assert result.paper.rank == 12


def test_the_errors_of_both_estimators_are_as_predicted_and_weighting_never_loses():
    fits, predicted = [run(THREE_LEVELS, NOISE, seed) for seed in range(4)], predicted_covariances()
    for estimates, covariance in zip(zip(*fits, strict=True), predicted, strict=True):
        errors = [each.parameters.as_array() - TRUTH for each in estimates]
        chi_square = sum(error @ np.linalg.solve(covariance, error) for error in errors)
        assert 25 < chi_square < 80  # 48 degrees of freedom
    unweighted, weighted = predicted
    scale = np.sqrt(np.diag(unweighted))
    assert np.linalg.eigvalsh((unweighted - weighted) / np.outer(scale, scale)).min() > -1e-9
    assert np.mean([each.paper.force_error for each in fits]) == pytest.approx(1.3, abs=0.35)
