"""Recordings with an undeclared effect: it is found, and the base parameters are right with it.

The truth is in `truth/`, which nothing but tests reads.
"""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.undeclared import ALL, cell_of, make, outcome_of, path_of, true_robot

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.unnamed import Unnamed

RECORDINGS = pytest.mark.parametrize('name', [one.name for one in ALL])


@RECORDINGS
def test_the_base_parameters_are_right_with_the_effect(name):
    outcome, truth = outcome_of(name), true_robot(name, cell_of(name)).parameters.as_array()
    assert outcome.found == 108
    assert outcome.calibration.noise_source == ('estimated' if name == 'undeclared_b' else 'given')
    assert outcome.final.used.sum() >= 107
    assert outcome.diagnosis.p_value < 1e-6
    assert np.abs((outcome.final.parameters.as_array() - truth) / outcome.final.std).max() < 4
    assert outcome.extended_held_out.force_error < outcome.held_out.force_error
    found = outcome.comparison  # errors of the discs beyond their declared size may lower the force error
    assert found.extended.reduced_chi_square < 0.7 * found.base.reduced_chi_square


@pytest.mark.parametrize('name', ['undeclared_a', 'undeclared_b'])
def test_the_effect_is_named_with_its_values(name):
    outcome, truth = outcome_of(name), true_robot(name, cell_of(name))
    (true,), (true_values,) = truth.effects, truth.effect_values
    assert outcome.diagnosis.verdict == 'explained'
    (found,) = outcome.diagnosis.found
    assert found.effect.label == true.label
    for value, expected in zip(found.values, true_values, strict=True):
        assert abs(value.value - expected) < 4 * value.std
    best = calibrate(outcome.calibration.touches, cell_of(name), start=truth)
    assert outcome.final.force_error == pytest.approx(best.force_error, rel=0.1)


def test_an_effect_outside_the_catalogue_is_unexplained():
    outcome = outcome_of('undeclared_c')
    assert outcome.diagnosis.verdict == 'unexplained'
    (found,) = outcome.diagnosis.found
    assert isinstance(found.effect, Unnamed)
    assert 'disc_3' in found.effect.label


@RECORDINGS
def test_they_are_made_again_from_the_truth(name, tmp_path):
    """Their touches were pressed until the force was that of the plan to 0.1 %; the angles are in steps of 1 µrad."""
    again = make(next(one for one in ALL if one.name == name), tmp_path)
    cell = cell_of(name)
    kept, made = read_streams(path_of(name), cell), read_streams(again, cell)
    np.testing.assert_array_equal(kept.joints.stamp, made.joints.stamp)
    np.testing.assert_allclose(made.joints.position, kept.joints.position, rtol=0, atol=2.1e-6)
    np.testing.assert_allclose(made.wrench.force, kept.wrench.force, rtol=1e-3, atol=0.02)
