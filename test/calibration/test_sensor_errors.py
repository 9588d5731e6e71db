"""Errors of the force sensor in the adjustment: derivatives, and where a reading has no force behind it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import EXACT
from diagnosis.simulated import CELL, PLAN, effect

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.gauss_helmert import first_guess, linearise
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.model.extension import Extension
from scara_kinetostatic.model.law import TouchMetadata
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.simulation.streams import simulate_touches

READING = {'sensor_nonlinearity': (6e-3,), 'sensor_rotation': (0.3,), 'sensor_bias': (3.0, -2.0)}


def played(label, noise):
    cell = replace(CELL, effects=(effect(label),))
    return cell, simulate_touches(cell, PAPER_ACTUAL.replace(extra=READING[label]), PLAN, noise, 2)


@pytest.mark.parametrize('label', READING)
def test_the_derivative_by_an_error_of_the_sensor(label):
    cell, touches = played(label, EXACT)
    o, p = observe(touches, cell), PAPER_ACTUAL.replace(extra=READING[label])
    adjusted = first_guess(o, p)
    derivative = linearise(o, p, adjusted).derivative
    for k, value in enumerate(READING[label]):
        step = 1e-6 * max(abs(value), 1e-3)
        ends = []
        for sign in (1, -1):
            extra = list(READING[label])
            extra[k] += sign * step
            ends.append(linearise(o, p.replace(extra=tuple(extra)), adjusted).misclosure)
        expected = (ends[0] - ends[1]) / (2 * step)
        found = derivative[:, :, len(NAMES) + k]
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('label', READING)
def test_a_strong_error_of_the_sensor_is_fitted_in_few_steps(label):
    cell, touches = played(label, CELL.noise)
    fit = calibrate(touches, cell)
    assert fit.termination is Termination.CONVERGED
    assert fit.iterations <= 20
    np.testing.assert_array_less(np.abs(fit.parameters.extra - np.array(READING[label])), 4 * fit.extra_std)


def test_no_force_is_behind_a_reading_that_errs_by_as_much():
    extension = Extension((effect('sensor_nonlinearity'),), TouchMetadata.plain(2))
    p = PAPER_ACTUAL.replace(extra=(-0.02,))
    true = np.array([[5.0, 3.0], [0.0, 12.0]])
    np.testing.assert_allclose(extension.true_force(p, extension.read(p, true)), true, rtol=1e-12)
    assert np.isnan(extension.true_force(p, np.array([[40.0, 0.0], [0.0, 12.0]]))).any()
