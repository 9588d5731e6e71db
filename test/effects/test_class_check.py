"""A class of effect of which something is missing is refused when it is defined."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import random_scene

from scara_kinetostatic.effects.base import Effect, JointEffect, SensorEffect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.effect_law import Parameter, TouchState

COMPLETE = {
    'name': 'sample',
    'parameters': (Parameter('size', 'rad', 1e-3, 'how large it is'),),
    'statement': '{target} is a sample',
    'confounded_with': 'nothing',
    'identified_by': 'any touches',
    'plot_variable': 'angle',
    'angles': lambda self, at: (at.joints[:, self.joint],),
    '__module__': __name__,
}


def define(**changes: object) -> type[JointEffect]:
    """A class of effect with some attributes changed, or left out where None."""
    body = {name: value for name, value in (COMPLETE | changes).items() if value is not None}
    return type('Sample', (JointEffect,), body)


def test_a_complete_one_is_defined():
    labels = [effect.label for effect in define().instances(CELL)]
    assert labels == ['sample[joint1]', 'sample[joint2]']
    assert define().of(1).title == 'joint 2 is a sample'


@pytest.mark.parametrize('missing', ['parameters', 'statement', 'confounded_with', 'identified_by', 'plot_variable'])
def test_a_missing_attribute_is_named_with_the_class(missing):
    with pytest.raises(TypeError, match=rf"test_class_check\.Sample: '{missing}' is missing"):
        define(**{missing: None})


def test_a_missing_method_is_named_with_the_class():
    with pytest.raises(TypeError, match=r"Sample: the method 'angles' is missing"):
        define(angles=None)
    with pytest.raises(TypeError, match=r"the method 'sensor_error"):

        class NoError(SensorEffect):
            name = 'no_error'


def test_a_missing_name_is_named_with_the_class():
    with pytest.raises(TypeError, match=r"Sample: 'name' is missing"):
        define(name=None)


def test_an_unknown_plot_variable_is_named_with_the_class():
    with pytest.raises(TypeError, match=r"Sample: 'plot_variable': expected one of angle, torque, .* got 'colour'"):
        define(plot_variable='colour')


def test_all_built_in_ones_are_listed_in_their_order():
    labels = [effect.label for effect in catalogue(CELL)]
    friction = ['contact_friction', *(f'contact_friction[{disc.name}]' for disc in CELL.discs)]
    assert labels[:6] == [*friction, 'sensor_rotation', 'sensor_bias']
    shifts = [label for label in labels if label.startswith('shift')]
    targets = ['base', 'tool', *(disc.name for disc in CELL.discs), 'joint1', 'joint2', 'sensor']
    assert shifts == [f'shift[{target}]' for target in targets]


@pytest.mark.parametrize('effect', catalogue(CELL), ids=lambda effect: effect.label)
def test_what_an_effect_says_is_usable(effect: Effect, touch_state: TouchState):
    values = np.array(effect.typical)
    assert effect.is_plausible(values)
    title, _, plotted = effect.plot_axis(touch_state, values)
    assert title
    assert plotted.shape == effect.acts_on(touch_state).shape == (len(touch_state.magnitude),)


@pytest.fixture(scope='module')
def touch_state() -> TouchState:
    return random_scene(1, 30).touch_state
