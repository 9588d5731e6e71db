"""The list of effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL
from effects.scenes import EFFECTS, LABELS, random_scene

from scara_kinetostatic.effects import registry
from scara_kinetostatic.effects.base import VARIABLES, JointEffect
from scara_kinetostatic.effects.joints import EncoderGain, JointHardening
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.effects.registry import catalogue, evaluate_once, find, register, unregister
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter

NAMES = {
    'contact_friction', 'sensor_rotation', 'sensor_bias', 'sensor_nonlinearity', 'encoder_gain', 'transmission_error',
    'joint_hardening', 'joint_hysteresis', 'joint_slip', 'anisotropic_gripper', 'anisotropic_backlash', 'link_bending',
    'base_compliance', 'contact_compliance', 'object_position', 'object_radius', 'thermal_drift', 'base_tilt',
    'sensor_cross_talk', 'shift', 'joint_coupling', 'cable_pull', 'tip_shape', 'load_friction',
}  # fmt: skip


@pytest.fixture
def nothing_registered(monkeypatch):
    monkeypatch.setattr(registry, '_registered', [])


def test_all_kinds_of_effects_are_listed_in_their_order():
    assert {effect.name for effect in EFFECTS} == NAMES
    assert len(set(LABELS)) == len({effect.title for effect in EFFECTS}) == len(LABELS)
    friction = ['contact_friction', *(f'contact_friction[{disc.name}]' for disc in CELL.discs)]
    assert LABELS[:6] == [*friction, 'sensor_rotation', 'sensor_bias']
    targets = ['base', 'tool', *(disc.name for disc in CELL.discs), 'joint1', 'joint2', 'sensor']
    assert [label for label in LABELS if label.startswith('shift')] == [f'shift[{target}]' for target in targets]
    assert {f'tip_shape[{shape}]' for shape in ('oval', 'three-lobed', 'four-lobed', 'five-lobed')} <= set(LABELS)
    of_joints = NAMES & {effect.name for effect in EFFECTS if effect.label.endswith('[joint1]')}
    assert len(of_joints) == 10 and {f'{name}[joint2]' for name in of_joints} <= set(LABELS)
    for kind in ('contact_compliance', 'object_position', 'object_radius'):
        assert {f'{kind}[{disc.name}]' for disc in CELL.discs} <= set(LABELS)


def test_what_is_named_in_the_order_is_there_and_every_kind_is_listed_by_itself():
    names = {kind.name for kind in registry.BUILT_IN}
    assert set(registry.ORDER.split()) <= names and names - {'object_rotation', 'object_offset', 'edge_bow'} <= {
        *NAMES,
        'plate_position',
    }


def test_a_cell_of_one_disc_has_no_soft_or_rough_one_among_others():
    labels = [effect.label for effect in catalogue(replace(CELL, discs=CELL.discs[:1]))]
    assert 'contact_compliance' in labels
    assert not {'contact_compliance[disc_1]', 'contact_friction[disc_1]'} & set(labels)


@pytest.mark.parametrize('effect', EFFECTS, ids=LABELS)
def test_an_effect_says_what_it_is_and_can_be_evaluated(effect):
    assert effect.plot_variable in VARIABLES and effect.is_physical
    assert len(effect.confounded_with) > 10 and len(effect.identified_by) > 10
    assert all(parameter.scale > 0 and parameter.meaning and parameter.unit for parameter in effect.parameters)
    assert len(effect.start) == len(effect.typical) == len(effect.parameters)
    assert effect.label.startswith(effect.name)
    assert find(CELL, effect.label) == effect
    assert effect.is_plausible(np.array(effect.typical))
    assert '{' not in effect.title and ('during the recording' in effect.title) == (effect.name == 'shift')
    if effect.target and effect.target != 'sensor':
        assert effect.target in effect.title.replace('joint ', 'joint').replace('link ', 'link')
    assert effect.typical_size is not None and effect.size() > 0
    evaluate_once(effect, CELL)


def test_variables_have_one_value_per_touch():
    at = random_scene(0, 30).touch_state
    at = at._replace(tangents=(np.arange(30) % 2)[:, None] * at.tangent)  # every other touch is of an edge
    for variable in VARIABLES.values():
        for joint in (0, 1):
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
    with pytest.raises(ParameterError, match=r'no such target in this cell; give sensor_bias$'):
        find(CELL, 'sensor_bias[joint1]')
    with pytest.raises(ParameterError, match=r'no such effect; did you mean .object_radius.?'):
        find(CELL, 'object_radios[disc_1]')


def test_one_of_my_own_is_listed_until_taken_back(nothing_registered):
    def mine(cell):
        return [EncoderGain(target='my joint', joint=1)]

    assert register(register(mine)) is mine
    assert catalogue(CELL)[:-1] == EFFECTS
    assert find(CELL, 'encoder_gain[my joint]').joint == 1
    for _ in range(2):
        unregister(mine)
    assert catalogue(CELL) == EFFECTS


def test_a_class_may_be_registered_as_its_entry_point_may_be(nothing_registered):
    class MyGain(EncoderGain):
        name = 'my_gain'

    assert register(MyGain) is MyGain
    assert [effect.label for effect in catalogue(CELL)[-2:]] == ['my_gain[joint1]', 'my_gain[joint2]']
    with pytest.raises(ParameterError, match='expected a class derived from Effect or a function'):
        register(EncoderGain.of(0))


def test_an_effect_that_depends_on_more_of_the_force_than_it_says_is_refused():
    class Stiff(JointHardening):
        force_dependence = ForceDependence.NONE

    class Larger(ObjectRadius):
        force_dependence = ForceDependence.NONE

    with pytest.raises(ValueError, match='force_dependence: NONE is stated, but the shift depends on the magnitude'):
        evaluate_once(Stiff.of(0), CELL)
    with pytest.raises(ValueError, match='force_dependence: NONE is stated, but the shift depends on the direction'):
        evaluate_once(Larger.of(0, 'disc_1'), CELL)


def test_two_of_one_label_are_refused(nothing_registered):
    register(lambda cell: [EncoderGain.of(0)])
    with pytest.raises(ParameterError, match=r'encoder_gain\[joint1\]'):
        catalogue(CELL)


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


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        *(
            ({name: None}, rf"test_registry\.Sample: '{name}' is missing")
            for name in ('name', 'parameters', 'statement', 'confounded_with', 'identified_by', 'plot_variable')
        ),
        ({'angles': None}, "Sample: the method 'angles' is missing"),
        ({'plot_variable': 'colour'}, "Sample: 'plot_variable': expected one of angle, torque, .* got 'colour'"),
    ],
)
def test_what_is_missing_or_unknown_is_named_with_the_class(wrong, words):
    with pytest.raises(TypeError, match=words):
        define(**wrong)
