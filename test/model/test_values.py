"""Values that guard themselves, and are reached by name: parameters, models with effects, touches, cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL

from scara_kinetostatic.diagnosis.advice import many_small
from scara_kinetostatic.diagnosis.result import Found, Value
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.model.touch import TouchSet

GAIN, PLACE = find(CELL, 'encoder_gain[joint1]'), find(CELL, 'object_position[disc_2]')
MODEL = ExtendedModel(PAPER_ACTUAL, (GAIN, PLACE), ((1e-3,), (1e-4, -2e-4)))


def test_parameters_keep_order_and_value():
    assert ' '.join(NAMES) == 'x0 y0 theta1 l1 theta2 l2 p_ee p1 p2 g_ee g1 g2'
    assert Parameters.from_array(PAPER_ACTUAL.as_array()) == PAPER_ACTUAL
    assert Parameters.from_mapping(PAPER_ACTUAL.as_dict()) == PAPER_ACTUAL


@pytest.mark.parametrize('value', [float('nan'), float('inf'), 'a', True, None])
def test_parameters_refuse_what_is_no_number(value):
    with pytest.raises(ParameterError, match='l1'):
        Parameters(l1=value)


def test_parameters_name_what_is_missing_or_unknown():
    values = PAPER_ACTUAL.as_dict()
    with pytest.raises(ParameterError, match="missing parameter 'g2'"):
        Parameters.from_mapping({name: value for name, value in values.items() if name != 'g2'})
    with pytest.raises(ParameterError, match="unknown parameter 'g3'"):
        Parameters.from_mapping({**values, 'g3': 0.0})


def test_touches_are_read_only_and_checked():
    touches = TouchSet(np.zeros((3, 2)), np.ones((3, 2)), np.zeros(3), np.ones(3))
    with pytest.raises(ValueError, match='read-only'):
        touches.joints[0, 0] = 1.0
    with pytest.raises(ValueError, match='shape'):
        TouchSet(np.zeros((3, 2)), np.ones((2, 2)), np.zeros(3), np.ones(3))
    with pytest.raises(ValueError, match='finite'):
        TouchSet(np.full((1, 2), np.nan), np.ones((1, 2)), np.zeros(1), np.ones(1))
    assert len(TouchSet.concatenate([touches, touches.select(np.array([0]))])) == 4


def test_histories_are_filled_up_by_the_unloaded_joints_of_the_hold():
    joints = np.array([[0.3, 1.0], [0.5, 1.2]])
    bare = TouchSet(joints, np.ones((2, 2)), np.zeros(2), np.ones(2))
    assert bare.history.shape == (2, 0, 4)
    loaded = bare.replace(history=np.full((2, 1, 4), 7.0))
    both = TouchSet.concatenate([loaded, bare])
    assert both.history.shape == (4, 1, 4)
    np.testing.assert_array_equal(both.history[2:, 0], np.hstack([joints, np.zeros((2, 2))]))
    np.testing.assert_array_equal(both.select([0]).history, [[[7.0] * 4]])
    for wrong in (np.zeros((2, 4)), np.zeros((3, 1, 4)), np.zeros((2, 1, 3))):
        with pytest.raises(ValueError, match='history: expected shape'):
            bare.replace(history=wrong)


def test_a_pose_is_within_the_limits_in_any_turn():
    cell = replace(PAPER_CELL, limits=((0.0, 5.0), (-2.2, 2.2)))
    joints = np.array([[-2.0, 1.0], [5.5, 1.0], [1.0, -2.3], [np.nan, np.nan]])
    np.testing.assert_allclose(cell.in_turn(joints)[0], [2 * np.pi - 2.0, 1.0])
    assert cell.can_take(joints).tolist() == [True, False, False, False]
    assert cell.beyond_limits(joints)[:3].tolist() == [[False, False], [True, False], [False, True]]
    assert not cell.can_take(np.array([4.99, 1.0]), 0.02)
    assert PAPER_CELL.can_take(joints).tolist() == [True, True, True, False]
    assert PAPER_CELL.in_turn(joints) is joints
    wide = replace(PAPER_CELL, limits=((-1.0, 5.5), (-4.0, 4.0)))
    given = np.array([[-0.95, 3.5], [5.4, -3.5], [-1.1, 4.1]])
    np.testing.assert_array_equal(wide.in_turn(given)[:2], given[:2])  # they are within
    np.testing.assert_allclose(wide.in_turn(given)[2], given[2] + [2 * np.pi, -2 * np.pi])


def test_values_of_effects_are_reached_by_name_and_by_one_vector():
    assert MODEL.values['encoder_gain[joint1]'] == {'gain': 1e-3}
    assert MODEL.values['object_position[disc_2]'] == {'x': 1e-4, 'y': -2e-4}
    names = 'encoder_gain[joint1].gain object_position[disc_2].x object_position[disc_2].y'
    assert ' '.join(MODEL.names[len(NAMES) :]) == names
    np.testing.assert_array_equal(MODEL.as_array()[len(NAMES) :], [1e-3, 1e-4, -2e-4])
    assert MODEL.with_array(MODEL.as_array()) == MODEL


def test_other_effects_keep_the_values_of_those_that_stay():
    assert MODEL.with_effects([PLACE]).values == {'object_position[disc_2]': {'x': 1e-4, 'y': -2e-4}}
    assert ExtendedModel(PAPER_ACTUAL).with_effects([GAIN]) == ExtendedModel.at_start(PAPER_ACTUAL, [GAIN])


@pytest.mark.parametrize('values', [(), ((1e-3,),), ((1e-3,), (1e-4,)), ((1e-3,), (1e-4, np.nan))])
def test_values_must_be_finite_and_one_per_parameter(values):
    with pytest.raises(ParameterError, match='expected'):
        ExtendedModel(PAPER_ACTUAL, (GAIN, PLACE), values)


@pytest.mark.parametrize(
    ('value', 'unit', 'text'),
    [
        (3e-5, '1/rad^2', '30 ppm/rad^2'),
        (-2e-3, '1', '-0.002'),
        (1e-4, '1', '100 ppm'),
        (7.3, '1/turn', '7.3 1/turn'),
        (943e-6, 'm', '943 µm'),
        (-12e-6, 'm/N', '-12 µm/N'),
    ],
)
def test_a_quantity_has_a_unit_that_exists(value, unit, text):
    assert quantity(value, unit) == text


def test_a_suspicion_says_what_its_value_means():
    effect = find(CELL, 'cable_pull[joint1]')
    values = tuple(Value(p.name, -3e-5, 1e-5, p.unit, p.meaning) for p in effect.parameters[2:])
    said = many_small(0.01, [Found(effect, values, False)])
    assert said.endswith('(change of the slope with the square of the angle: −30 ppm/rad^2 ± 10 ppm/rad^2)')
