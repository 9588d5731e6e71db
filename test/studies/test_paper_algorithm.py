"""The paper's algorithm and section 5.1."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL, EXACT, NOISE, touches

from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.effects.robot import AnisotropicGripper
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Sensor, SensorFrame
from scara_kinetostatic.model.contact import all_derivatives, extended_equations
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G_EE, P_EE, PAPER_ACTUAL
from scara_kinetostatic.studies.paper.study import CELL as PAPER_CELL
from scara_kinetostatic.studies.paper.study import (
    ONE_LEVEL,
    THREE_LEVELS,
    determined_combination,
    excess_derivative,
    expected_force_error,
    linearise_at_truth,
    noise_for_force_error,
    observable_parts,
    paper_calibrate,
    paper_touches,
    run,
    study_noise,
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


def test_one_force_hides_one_direction_and_weighting_never_loses():
    linear, three = linearise_at_truth(ONE_LEVEL), linearise_at_truth(THREE_LEVELS)
    assert (linear.rank, three.rank) == (11, 12)
    unidentifiable = linear.unidentifiable[:, 0] / linear.unidentifiable[P_EE, 0]
    np.testing.assert_allclose(unidentifiable[G_EE] * 1e-3 / 1e-4, 40.0, rtol=1e-6)
    np.testing.assert_allclose(unidentifiable[OTHERS], 0.0, atol=1e-8)
    difference = three.unweighted_covariance(NOISE) - three.weighted_covariance(NOISE)
    scale = np.sqrt(np.diag(three.unweighted_covariance(NOISE)))
    assert np.linalg.eigvalsh(difference / np.outer(scale, scale)).min() > -1e-9


def test_prediction_of_e_f_agrees_with_fits():
    linear = linearise_at_truth(THREE_LEVELS)
    noise = noise_for_force_error(linear, 1e-4, 1.3)
    mean, spread = expected_force_error(linear, noise)
    assert mean == pytest.approx(1.3, rel=0.01)
    fitted = [paper_calibrate(paper_touches(THREE_LEVELS, noise, seed), PAPER_CELL).force_error for seed in range(6)]
    assert abs(np.mean(fitted) - mean) < 4 * spread / np.sqrt(6)


def test_the_noisy_column_is_near_in_each_parameter_but_not_in_all_together():
    study = study_noise(linearise_at_truth(ONE_LEVEL), 1e-4)
    assert study.force_error == pytest.approx(1.312684, rel=0.01)
    assert np.abs(study.z).max() < 2
    assert study.chi_square > 100


def test_tool_frame_is_not_the_papers_business():
    cell = replace(CELL, sensor=Sensor(frame=SensorFrame.TOOL))
    with pytest.raises(ParameterError, match='base'):
        paper_calibrate(touches(PAPER_ACTUAL, noise=EXACT, cell=cell), cell)


def test_entries_of_the_compliance_of_the_gripper_are_those_of_p_ee_and_of_its_coupling():
    o = observe(touches(PAPER_ACTUAL, noise=EXACT), CELL)
    model = ExtendedModel(PAPER_ACTUAL, (AnisotropicGripper(),), ((0.0,),))
    adjusted = project(o, model, NOISE).adjusted
    problem = o.contact_problem(adjusted.joints)
    equations = extended_equations(model, problem, adjusted.state)
    wanted = all_derivatives(model, problem, adjusted.state, equations)
    found = excess_derivative(adjusted.state, equations, o.gripper)
    np.testing.assert_allclose(found[..., 0] + found[..., 3], wanted[..., P_EE], rtol=0, atol=1e-12)
    coupling = found[..., 1] + found[..., 2]  # the effect leaves out what the lever arms change
    np.testing.assert_allclose(coupling, wanted[..., 12], rtol=0, atol=5e-3 * np.abs(coupling).max())


def test_a_gripper_softer_across_link_2_hides_in_p2_and_turned_axes_do_not():
    found = observable_parts(touches(PAPER_ACTUAL, noise=EXACT), CELL, PAPER_ACTUAL, NOISE)
    parts = {part.part: part for part in found}
    alias = parts['p22 - p11']
    assert alias.explained_by_base_model == pytest.approx(1.0, abs=1e-12)
    assert np.isinf(alias.std)
    assert alias.biases['p2'] == pytest.approx(1 / PAPER_ACTUAL.l2**2, rel=1e-6)
    assert parts['p12 + p21'].explained_by_base_model < 0.1
    assert parts['p12 + p21'].std < 1e-7
