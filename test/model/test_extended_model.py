"""The extended model: values by name, one vector for solvers, misuse."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import CELL

from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL

GAIN, PLACE = find(CELL, 'encoder_gain[joint1]'), find(CELL, 'object_position[disc_2]')
MODEL = ExtendedModel(PAPER_ACTUAL, (GAIN, PLACE), ((1e-3,), (1e-4, -2e-4)))


def test_values_are_reached_by_name():
    assert MODEL.values['encoder_gain[joint1]'] == {'gain': 1e-3}
    assert MODEL.values['object_position[disc_2]'] == {'x': 1e-4, 'y': -2e-4}
    assert MODEL.names[len(NAMES) :] == (
        'encoder_gain[joint1].gain',
        'object_position[disc_2].x',
        'object_position[disc_2].y',
    )


def test_the_vector_gives_the_model_back():
    np.testing.assert_array_equal(MODEL.as_array()[len(NAMES) :], [1e-3, 1e-4, -2e-4])
    assert MODEL.with_array(MODEL.as_array()) == MODEL


def test_other_effects_keep_the_values_of_those_that_stay():
    assert MODEL.with_effects([PLACE]).values == {'object_position[disc_2]': {'x': 1e-4, 'y': -2e-4}}
    assert ExtendedModel(PAPER_ACTUAL).with_effects([GAIN]) == ExtendedModel.at_start(PAPER_ACTUAL, [GAIN])


@pytest.mark.parametrize('values', [(), ((1e-3,),), ((1e-3,), (1e-4,)), ((1e-3,), (1e-4, np.nan))])
def test_values_must_be_finite_and_one_per_parameter(values):
    with pytest.raises(ParameterError, match='expected'):
        ExtendedModel(PAPER_ACTUAL, (GAIN, PLACE), values)
