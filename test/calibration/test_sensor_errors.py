"""Errors of the force sensor in the adjustment: derivatives, and where a reading has no force behind it."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import EXACT
from diagnosis.simulated import CELL, PLAN, effect

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.gauss_helmert import first_guess, linearise
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.model.extended_model import ExtendedModel, reported_force, true_force
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.simulation.streams import simulate_touches

READING = {'sensor_nonlinearity': (6e-3,), 'sensor_rotation': (0.3,), 'sensor_bias': (3.0, -2.0)}


def played(label, noise):
    model = ExtendedModel(PAPER_ACTUAL, (effect(label),), (READING[label],))
    return model, simulate_touches(CELL, model, PLAN, noise, 2)


@pytest.mark.parametrize('label', READING)
def test_the_derivative_by_an_error_of_the_sensor(label):
    model, touches = played(label, EXACT)
    o, values = observe(touches, CELL), model.as_array()
    adjusted = first_guess(o, model)
    derivative = linearise(o, model, adjusted).derivative
    for k, value in enumerate(READING[label]):
        step = 1e-6 * max(abs(value), 1e-3)
        ends = []
        for sign in (1, -1):
            change = sign * step * (np.arange(len(values)) == len(NAMES) + k)
            ends.append(linearise(o, model.with_array(values + change), adjusted).misclosure)
        expected = (ends[0] - ends[1]) / (2 * step)
        found = derivative[:, :, len(NAMES) + k]
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('label', READING)
def test_a_strong_error_of_the_sensor_is_fitted_in_few_steps(label):
    model, touches = played(label, CELL.noise)
    fit = calibrate(touches, CELL, model.effects)
    assert fit.termination is Termination.CONVERGED
    assert fit.iterations <= 20
    np.testing.assert_array_less(np.abs(fit.model.effect_arrays[0] - np.array(READING[label])), 4 * fit.effect_std)


def test_no_force_is_behind_a_reading_that_errs_by_as_much():
    model = ExtendedModel(PAPER_ACTUAL, (effect('sensor_nonlinearity'),), ((-0.02,),))
    true = np.array([[5.0, 3.0], [0.0, 12.0]])
    np.testing.assert_allclose(true_force(model, reported_force(model, true)), true, rtol=1e-12)
    assert np.isnan(true_force(model, np.array([[40.0, 0.0], [0.0, 12.0]]))).any()
