"""A class of effect of which something is missing is refused when it is defined."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import random_scene

from scara_kinetostatic.effects.base import Effect, JointEffect, Parameter, SensorEffect
from scara_kinetostatic.effects.registry import built_in, catalogue
from scara_kinetostatic.model.effect_law import TouchState

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
    assert define().of(1).finding == 'joint 2 is a sample'


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


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'name': 'two words'}, r"'name': expected letters, digits and _, got 'two words'"),
        ({'plot_variable': 'colour'}, r"'plot_variable': expected one of angle, torque, .* got 'colour'"),
        ({'statement': 'it {verb}'}, r"'statement': only \{target\} may stand in braces"),
        ({'parameters': 'size'}, r"'parameters' is missing, expected a tuple of Parameter, got 'size'"),
        ({'parameters': (Parameter('size', '', 1.0, 'm'),)}, r"'parameters': 'size': 'unit' is missing"),
        ({'parameters': (Parameter('size', 'm', 1.0, ''),)}, r"'parameters': 'size': 'meaning' is missing"),
        (
            {'parameters': (Parameter('size', 'm', 0.0, 'm'),)},
            r"'parameters': 'size': 'scale': expected a plausible size",
        ),
        ({'grid_parameter': 'cycles'}, r"'grid_parameter': no parameter is called 'cycles'"),
    ],
)
def test_a_wrong_attribute_is_named_with_the_class(changes, message):
    with pytest.raises(TypeError, match=rf'Sample: {message}'):
        define(**changes)


def test_all_built_in_ones_are_found_in_their_order():
    assert len(built_in()) == 24
    assert [kind.order for kind in built_in()[:-2]] == [*range(1, 22), 26]
    labels = [effect.label for effect in catalogue(CELL)]
    assert labels[:4] == ['contact_friction', 'sensor_rotation', 'sensor_bias', 'sensor_nonlinearity']
    shifts = [label for label in labels if label.startswith('shift')]
    targets = ['base', 'tool', *(disc.name for disc in CELL.discs), 'joint1', 'joint2', 'sensor']
    assert shifts == [f'shift[{target}]' for target in targets]


@pytest.mark.parametrize('effect', catalogue(CELL), ids=lambda effect: effect.label)
def test_what_an_effect_says_is_usable(effect: Effect, touch_state: TouchState):
    values = effect.random_values(np.random.default_rng(1))
    assert values.shape == (len(effect.parameters),)
    assert effect.is_plausible(values)
    title, _, plotted = effect.plot_axis(touch_state, values)
    assert title
    assert plotted.shape == effect.acts_on(touch_state).shape == (len(touch_state.magnitude),)
    assert effect.difference(values, values) == pytest.approx(0)


@pytest.fixture(scope='module')
def touch_state() -> TouchState:
    return random_scene(1, 30).touch_state
