"""Parameters that are held: of the base model, and of effects that are in the model with a known value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import deviations

import scara_kinetostatic as sk
from scara_kinetostatic.calibration.calibrate import check_units, fixed_effects, fixed_values, parse_fixed
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_NOMINAL

NAME = 'object_radius[disc_2].radius'


def test_texts_give_names_and_values():
    assert fixed_values(['l1=0.3302', 'p1', NAME], PAPER_NOMINAL) == {'l1': 0.3302, 'p1': 1e-5, NAME: 0.0}
    assert parse_fixed('l1') == ('l1', None)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('theta_1=0', "did you mean 'theta1'"),
        ('l1=long', "expected a number, got 'long'"),
        ('object_radius[disc_2]=0', 'such as object_radius'),
    ],
)
def test_wrong_texts(text, message):
    with pytest.raises(ParameterError, match=message):
        parse_fixed(text)


@pytest.mark.parametrize(
    ('name', 'far', 'usual'),
    [
        ('x0', 2.5, 0.05), ('theta1', 2.0, -0.2), ('g_ee', 0.095, 0.0), ('p1', 0.11, 1e-3),
        ('g1', 0.29, 0.0), ('p_ee', -0.0011, 1e-5), ('l1', 3.3, 0.4),
    ],
)  # fmt: skip
def test_values_far_from_nominal_have_another_unit(name, far, usual):
    check_units({name: usual, NAME: 1}, PAPER_NOMINAL)
    off = abs(far - getattr(PAPER_NOMINAL, name))
    with pytest.raises(ParameterError, match=f'is {off:.3g} .* from its nominal value; give it in'):
        check_units({name: far}, PAPER_NOMINAL)


@pytest.mark.parametrize(
    ('fixed', 'message'),
    [
        ({'object_radius[disc_2].raduis': 0.0}, r'\.radius is free: .*give object_radius\[disc_2\]\.radius'),
        ({'objct_radius[disc_2].radius': 0.0}, "did you mean 'object_radius"),
        ({'transmission_error[joint1].cycles': 3.0}, r'amplitude is free: an effect is held by all of its parameters'),
    ],
)
def test_wrong_effects(fixed, message):
    with pytest.raises(ParameterError, match=message):
        fixed_effects(fixed, PAPER_CELL)


@pytest.mark.parametrize(
    ('text', 'fixed'),
    [
        ('object_radius[disc_2]:radius=2e-4', {NAME: 2e-4}),
        ('sensor_rotation:angle=0.02', {'sensor_rotation.angle': 0.02}),
    ],
)
def test_an_effect_with_a_known_value_is_in_the_model_and_not_found(text, fixed):
    touches = sk.simulate(PAPER_CELL, PAPER_ACTUAL, effects=text, per_disc=8, seed=2)
    outcome = sk.diagnose(touches, PAPER_CELL, fixed=fixed)
    assert outcome.verdict == 'none'
    ((label, parameters),) = outcome.final.effects.items()
    for name, estimate in parameters.items():
        assert (estimate.value, estimate.status, estimate.std) == (fixed[f'{label}.{name}'], 'fixed', 0.0)
    assert np.abs(deviations(outcome.final)).max() < 4


def test_another_effect_is_found_beside_one_that_is_held():
    effects = ['object_radius[disc_2]:radius=2e-4', 'encoder_gain[joint2]:gain=2e-3']
    touches = sk.simulate(PAPER_CELL, PAPER_ACTUAL, effects=effects, per_disc=8, seed=2)
    outcome = sk.diagnose(touches, PAPER_CELL, fixed={NAME: 2e-4})
    assert list(outcome.effects) == ['encoder_gain[joint2]']
    assert outcome.final.effects['object_radius[disc_2]']['radius'].value == 2e-4
    (shown,) = outcome.effect_residuals  # what the figure of the report shows: without it the deviation is there
    assert np.abs(shown.expected).max() > 10 * shown.std_after.max()
    np.testing.assert_allclose(shown.before - shown.after, shown.expected, atol=1e-12)
    assert np.abs(deviations(outcome.final)).max() < 4


def test_what_is_held_is_as_uncertain_as_the_cell_declares():
    touches = sk.simulate(PAPER_CELL, PAPER_ACTUAL, effects='object_radius[disc_2]:radius=2e-4', seed=1)
    cell = replace(PAPER_CELL, discs=tuple(disc._replace(radius_std=2e-5) for disc in PAPER_CELL.discs))
    found = sk.calibrate(touches, cell, fixed_effects({NAME: 2e-4}, cell), fixed={NAME: 2e-4})
    assert 'object_radius[disc_2]' in [part.label for part in found.contributions]
    assert found.std_of('g_ee') > 2 * found.std_noise[NAMES.index('g_ee')]
    assert np.abs(deviations(found)).max() < 4
