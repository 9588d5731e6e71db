"""The list of effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import EFFECTS, LABELS, random_scene

from benchmark.population import SIZES
from scara_kinetostatic.effects.base import JointEffect, SensorEffect
from scara_kinetostatic.effects.joints import EncoderGain, JointHardening
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.effects.registry import catalogue, evaluate_once, find, register, unregister
from scara_kinetostatic.effects.undetected import TYPICAL
from scara_kinetostatic.effects.variables import VARIABLES
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter

NAMES = {
    'contact_friction', 'sensor_rotation', 'sensor_bias', 'sensor_nonlinearity', 'encoder_gain', 'transmission_error',
    'joint_hardening', 'joint_hysteresis', 'joint_slip', 'anisotropic_gripper', 'anisotropic_backlash', 'link_bending',
    'base_compliance', 'contact_compliance', 'object_position', 'object_radius', 'thermal_drift', 'base_tilt',
    'sensor_cross_talk', 'shift', 'joint_coupling', 'cable_pull', 'tip_shape', 'load_friction',
}  # fmt: skip


def test_all_kinds_of_effects_are_listed():
    assert {effect.name for effect in EFFECTS} == NAMES
    assert len(set(LABELS)) == len(LABELS)
    assert all('during the recording' in effect.title for effect in EFFECTS if effect.name == 'shift')
    kinds = 'encoder_gain', 'transmission_error', 'joint_hardening', 'joint_hysteresis', 'joint_slip', 'thermal_drift'
    for kind in (*kinds, 'joint_coupling', 'cable_pull'):
        assert {f'{kind}[joint1]', f'{kind}[joint2]'} <= set(LABELS)
    assert {'shift[base]', 'shift[tool]', 'shift[sensor]', 'shift[joint1]', 'shift[joint2]'} <= set(LABELS)
    assert {f'tip_shape[{shape}]' for shape in ('oval', 'three-lobed', 'four-lobed', 'five-lobed')} <= set(LABELS)
    for kind in ('contact_compliance', 'contact_friction', 'object_position', 'object_radius', 'shift'):
        assert {f'{kind}[{disc.name}]' for disc in CELL.discs} <= set(LABELS)


def test_a_cell_of_one_disc_has_no_soft_or_rough_one_among_others():
    labels = [effect.label for effect in catalogue(replace(CELL, discs=CELL.discs[:1]))]
    assert 'contact_compliance' in labels
    assert not {'contact_compliance[disc_1]', 'contact_friction[disc_1]'} & set(labels)


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_an_effect_says_what_it_is(effect):
    assert effect.plot_variable in VARIABLES
    assert len(effect.confounded_with) > 10
    assert len(effect.identified_by) > 10
    assert all(parameter.scale > 0 and parameter.meaning and parameter.unit for parameter in effect.parameters)
    assert len(effect.labels) == len(effect.start) == len(effect.typical) == len(effect.parameters)
    assert effect.label.startswith(effect.name)
    assert find(CELL, effect.label) == effect
    assert effect.is_plausible(np.array(effect.typical))


def test_variables_have_one_value_per_touch():
    at = random_scene(0, 30).touch_state
    at = at._replace(tangents=(np.arange(30) % 2)[:, None] * at.tangent)  # every other touch is of an edge
    for variable in VARIABLES.values():
        for joint in (None, 0, 1):
            axis = variable.axis(at, joint)
            assert axis.values.shape == (30,)
            assert np.isfinite(axis.values).all()
            assert np.ptp(axis.values) > 0
            assert '{' not in axis.title
    title, unit, values = VARIABLES['torque'].axis(at, 1)
    np.testing.assert_array_equal(values, at.torques[:, 1])
    assert (title, unit) == ('torque of joint 2', 'Nm')


def test_no_such_effect():
    with pytest.raises(ParameterError, match=r'no such target .*; give encoder_gain\[joint\d\] or encoder_gain'):
        find(CELL, 'encoder_gain[joint3]')
    with pytest.raises(ParameterError, match=r'no such target in this cell; give object_radius\[disc_\d\] or'):
        find(CELL, 'object_radius')
    with pytest.raises(ParameterError, match=r'no such target in this cell; give sensor_bias$'):
        find(CELL, 'sensor_bias[joint1]')
    with pytest.raises(ParameterError, match=r'no such effect; did you mean object_radius\[disc_1\] or'):
        find(CELL, 'object_radios[disc_1]')


def test_one_of_my_own_is_listed_until_taken_back():
    def mine(cell):
        return [EncoderGain(target='my joint', joint=1)]

    try:
        assert register(register(mine)) is mine
        assert catalogue(CELL)[:-1] == EFFECTS
        assert find(CELL, 'encoder_gain[my joint]').joint == 1
    finally:
        unregister(mine)
    unregister(mine)
    assert catalogue(CELL) == EFFECTS


def test_a_class_may_be_registered_as_its_entry_point_may_be():
    class MyGain(EncoderGain):
        name = 'my_gain'

    assert register(MyGain) is MyGain
    try:
        assert [effect.label for effect in catalogue(CELL)[-2:]] == ['my_gain[joint1]', 'my_gain[joint2]']
    finally:
        unregister(MyGain)
    assert catalogue(CELL) == EFFECTS
    with pytest.raises(ParameterError, match='expected a class derived from Effect or a function'):
        register(EncoderGain.of(0))


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_every_effect_of_the_catalogue_can_be_evaluated_at_a_few_touches(effect):
    evaluate_once(effect, CELL)


def test_an_effect_that_depends_on_more_of_the_force_than_it_says_is_refused():
    class Stiff(JointHardening):
        force_dependence = ForceDependence.NONE

    class Larger(ObjectRadius):
        force_dependence = ForceDependence.NONE

    with pytest.raises(ValueError, match='force_dependence: NONE is stated, but the shift depends on the magnitude'):
        evaluate_once(Stiff.of(0), CELL)
    with pytest.raises(ValueError, match='force_dependence: NONE is stated, but the shift depends on the direction'):
        evaluate_once(Larger.of(0, 'disc_1'), CELL)


def test_two_of_one_label_are_refused():
    def again(cell):
        return [EncoderGain.of(0)]

    register(again)
    try:
        with pytest.raises(ParameterError, match=r'encoder_gain\[joint1\]'):
            catalogue(CELL)
    finally:
        unregister(again)


def test_every_effect_says_what_it_means_of_the_cell() -> None:
    titles = [effect.title for effect in EFFECTS]
    assert len(set(titles)) == len(titles)
    for effect in EFFECTS:
        assert effect.is_physical
        assert '{' not in effect.title
        if effect.target and effect.target != 'sensor':
            assert effect.target in effect.title.replace('joint ', 'joint').replace('link ', 'link')


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
    with pytest.raises(TypeError, match=rf"test_registry\.Sample: '{missing}' is missing"):
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
    friction = ['contact_friction', *(f'contact_friction[{disc.name}]' for disc in CELL.discs)]
    assert LABELS[:6] == [*friction, 'sensor_rotation', 'sensor_bias']
    shifts = [label for label in LABELS if label.startswith('shift')]
    targets = ['base', 'tool', *(disc.name for disc in CELL.discs), 'joint1', 'joint2', 'sensor']
    assert shifts == [f'shift[{target}]' for target in targets]


def test_each_kind_has_a_typical_size_and_takes_part_in_the_population():
    for effect in catalogue(CELL):
        assert {effect.name, effect.label} & TYPICAL.keys(), effect.label
        assert {effect.name, effect.label} & SIZES.keys(), effect.label
