"""Declared uncertainties and errors of the sensor in the fit: derivatives, aliases, contributions, sigmas that hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import EXACT
from diagnosis.simulated import CELL, PLAN, effect

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.gauss_helmert import first_guess, linearise
from scara_kinetostatic.calibration.observations import DeclaredErrors, Prior, observe
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.model.cell import Cell, Noise, Plate, SensorFrame, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel, reported_force, true_force
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.simulation.streams import simulate_touches

MODEL = ExtendedModel(PAPER_ACTUAL)


def declared(center: float = 0.0, size: float = 0.0, plate: Plate | None = None, **common: float) -> Cell:
    name = '' if plate is None else plate.name
    discs = tuple(disc._replace(center_std=center, radius_std=size, plate=name) for disc in CELL.discs)
    plates = () if plate is None else (plate,)
    return replace(CELL, discs=discs, plates=plates, uncertainty=Uncertainty(**common))


FULL = declared(1.5e-5, 5e-6, Plate('a', 0.0, 0.3, 1e-3, 2e-3), radius=5e-6, force_gain=5e-3, force_rotation=1e-3)
TOUCHES = simulate_touches(CELL, MODEL, PLAN, CELL.noise, 3)


def played(cell: Cell, seed: int, noise: Noise):
    """Touches in a cell that differs from the description by errors drawn from its uncertainties."""
    known = DeclaredErrors.of(cell)
    errors = np.random.default_rng(seed).standard_normal(known.count)
    places = zip(cell.discs, known.centers(errors), known.radii(errors), strict=True)
    discs = tuple(disc._replace(x=x, y=y, radius=r) for disc, (x, y), r in places)
    touches = simulate_touches(replace(cell, discs=discs), MODEL, PLAN, noise, seed)
    u = cell.uncertainty
    sizes = {'force_gain': u.force_gain, 'force_rotation': u.force_rotation}
    gain, angle = (errors[known.places[k]].sum() * std if k in known.places else 0.0 for k, std in sizes.items())
    return replace(touches, force=(1 + gain) * rotate(touches.force, np.full(len(touches), angle))), errors


def assert_columns(found, misclosure, steps):
    """Derivatives (n, 2, k) against differences of a function of a change (k,)."""
    for k, change in enumerate(np.diag(steps)):
        expected = (misclosure(change) - misclosure(-change)) / (2 * steps[k])
        np.testing.assert_allclose(found[:, :, k], expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('frame', SensorFrame)
def test_the_derivative_by_each_declared_error(frame):
    cell = replace(FULL, sensor=FULL.sensor._replace(frame=frame))
    errors = np.random.default_rng(1).standard_normal(DeclaredErrors.of(cell).count)
    o = observe(TOUCHES, cell, errors)
    adjusted = first_guess(o, MODEL)

    def misclosure(change):
        return linearise(o.with_errors(errors + change), MODEL, adjusted).misclosure

    assert_columns(linearise(o, MODEL, adjusted).by_errors, misclosure, np.full(len(errors), 1e-3))


READING = {'sensor_nonlinearity': (6e-3,), 'sensor_rotation': (0.3,), 'sensor_bias': (3.0, -2.0)}


@pytest.mark.parametrize('label', READING)
def test_a_strong_error_of_the_sensor_has_right_derivatives_and_is_fitted_in_few_steps(label):
    model = ExtendedModel(PAPER_ACTUAL, (effect(label),), (READING[label],))
    o = observe(simulate_touches(CELL, model, PLAN, EXACT, 2), CELL)
    adjusted, values = first_guess(o, model), model.as_array()

    def misclosure(change):
        return linearise(o, model.with_array(values + np.concatenate([np.zeros(12), change])), adjusted).misclosure

    steps = 1e-6 * np.abs(READING[label])
    assert_columns(linearise(o, model, adjusted).derivative[:, :, len(NAMES) :], misclosure, steps)
    fit = calibrate(simulate_touches(CELL, model, PLAN, CELL.noise, 2), CELL, model.effects)
    assert fit.termination is Termination.CONVERGED and fit.iterations <= 20
    np.testing.assert_array_less(np.abs(fit.model.effect_arrays[0] - np.array(READING[label])), 4 * fit.effect_std)


def test_true_errors_and_model_close_the_equations():
    touches, errors = played(FULL, 5, EXACT)
    o = observe(touches, FULL, errors)
    assert np.abs(linearise(o, MODEL, first_guess(o, MODEL)).misclosure).max() < 1e-9


def test_contributions_add_up_and_nothing_declared_changes_nothing():
    fit, plain = calibrate(TOUCHES, FULL), calibrate(TOUCHES, CELL)
    total = np.sum([part.covariance for part in fit.contributions], axis=0)
    np.testing.assert_allclose(np.diag(total), np.concatenate([fit.std, fit.effect_std]) ** 2, rtol=1e-9)
    scaled = [part.covariance / np.outer(fit.std, fit.std) for part in fit.contributions]
    assert all(np.linalg.eigvalsh(covariance).min() > -1e-9 for covariance in scaled)
    assert [part.label for part in plain.contributions] == ['noise']
    np.testing.assert_array_equal(plain.std_noise, plain.std)
    np.testing.assert_allclose(fit.std_noise[6:], plain.std[6:], rtol=0.1)
    assert fit.chi_square == pytest.approx(plain.chi_square, abs=15)
    assert fit.degrees_of_freedom == plain.degrees_of_freedom


@pytest.mark.parametrize(
    ('cell', 'name', 'std'),
    [
        (declared(size=4e-5), 'g_ee', None),
        (replace(CELL, uncertainty=Uncertainty(radius=4e-5)), 'g_ee', 4e-5),
        (declared(plate=Plate('a', 0.0, 0.3, 1e-3)), 'x0', 1e-3),
        (replace(CELL, uncertainty=Uncertainty(force_gain=0.2)), 'p1', 0.2 * PAPER_ACTUAL.p1),
    ],
)
def test_an_exact_alias_is_as_uncertain_as_declared(cell, name, std):
    fit = calibrate(TOUCHES, cell)
    assert fit[name].status == 'estimated'
    if std is None:  # three independent radii
        assert 1.5e-5 < fit[name].std < 4e-5
    else:
        assert fit[name].std == pytest.approx(std, rel=0.06)


def test_a_plate_hides_nothing_but_the_place_of_the_robot():
    fit, plain = calibrate(TOUCHES, declared(3e-6, plate=Plate('a', 0.0, 0.3, 1e-3, 2e-3))), calibrate(TOUCHES, CELL)
    for name in ('l1', 'l2', 'theta2', 'p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2'):
        assert fit[name].std < max(1.2 * plain[name].std, 1.5e-5)
    assert min(fit[name].std for name in ('x0', 'y0')) > 9e-4


@pytest.mark.parametrize(('cell', 'noise'), [(FULL, None), (declared(5e-5, 2e-5), CELL.noise)], ids=['full', '50 µm'])
def test_sigmas_hold(cell, noise):
    fits = [calibrate(played(cell, seed, CELL.noise)[0], replace(cell, noise=noise)) for seed in range(8)]
    assert all(set(fit.status.values()) == {'estimated'} for fit in fits)
    z = [(fit.parameters.as_array() - PAPER_ACTUAL.as_array()) / fit.std for fit in fits]
    assert 0.7 < float(np.sqrt(np.mean(np.square(z)))) < 1.3
    assert np.abs(z).max() < 5
    if noise is None:
        assert np.mean([fit.noise.force_rms for fit in fits]) == pytest.approx(CELL.noise.force_rms, rel=0.1)
        assert np.mean([fit.noise.joint_rms for fit in fits]) == pytest.approx(CELL.noise.joint_rms, rel=0.25)


def test_a_trusted_nominal_value_counts_as_measured():
    true = PAPER_ACTUAL.l1
    near = CELL.nominal.replace(l1=true + 1e-6)
    trusted = replace(CELL, nominal=near, uncertainty=Uncertainty(nominal={'l1': 1e-6}))
    fit, fixed = calibrate(TOUCHES, trusted), calibrate(TOUCHES, trusted, fixed={'l1': true})
    assert fit['l1'].std < 1e-6
    assert abs(fit['l1'].value - true) < 3e-6
    assert [part.label for part in fit.contributions] == ['noise', 'nominal[l1]']
    assert fit.degrees_of_freedom == fixed.degrees_of_freedom == 2 * len(TOUCHES) - 11
    assert (fixed.prior_cost, fixed['l1'].status) == (0.0, 'fixed')


def test_a_value_whose_size_is_estimated_as_zero_is_held_without_a_warning():
    prior = Prior((), np.zeros(1, dtype=int), np.ones(1), np.zeros(1), 0)
    assert np.isfinite(prior.rows(1)).all() and prior.residual(np.ones(1), np.zeros(0)) == 0


def test_estimated_noise_of_few_touches_does_not_grow_with_what_is_declared():
    cell = replace(declared(1.5e-5, 5e-6, radius=5e-6, force_gain=5e-3, force_rotation=1e-3), noise=None)
    rows = np.sort(np.random.default_rng(3).permutation(len(TOUCHES))[:10])
    fit = calibrate(TOUCHES.select(rows), cell)
    assert 0.4 < fit.noise.force_rms / CELL.noise.force_rms < 2
    assert 0.4 < fit.noise.joint_rms / CELL.noise.joint_rms < 2
    assert fit.enlargement == 1


def test_no_force_is_behind_a_reading_that_errs_by_as_much():
    model = ExtendedModel(PAPER_ACTUAL, (effect('sensor_nonlinearity'),), ((-0.02,),))
    true = np.array([[5.0, 3.0], [0.0, 12.0]])
    np.testing.assert_allclose(true_force(model, reported_force(model, true)), true, rtol=1e-12)
    assert np.isnan(true_force(model, np.array([[40.0, 0.0], [0.0, 12.0]]))).any()
