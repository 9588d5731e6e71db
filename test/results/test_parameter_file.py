"""`calibration.yaml` is YAML in which every number is a real number."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found, Value
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.results.parameter_file import effect_parameters, facts, load_result, parameter_text


@pytest.mark.parametrize('which', ['plain', 'confounded'])
def test_values(which: str, request: pytest.FixtureRequest) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    c = outcome.calibration
    tree = yaml.safe_load(parameter_text(outcome))
    found = tree['/**']['ros__parameters']
    assert list(found) == ['calibrated', 'calibrated_std', 'calibration']
    assert found['calibrated'] == c.parameters.as_dict()
    for name in NAMES:
        std = found['calibrated_std'][name]
        assert isinstance(std, float)
        assert std == c.std_of(name) or (math.isnan(std) and c.status[name] == 'confounded')


@pytest.mark.parametrize('value', [0.0, 1e-5, 1e22, 5e-324])
def test_every_number_is_read_as_a_real_one(plain: Outcome, value: float) -> None:
    model = plain.calibration.model.replace(x0=value)
    outcome = replace(plain, calibration=replace(plain.calibration, model=model))
    found = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']['calibrated']['x0']
    assert isinstance(found, float)
    assert found == value


def test_effects_stand_behind_the_twelve(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    curve = [value.name for value in unnamed.diagnosis.found[0].values]
    for outcome, expected in (
        (grown, {'object_radius': {'_x_q_frac_': ['radius']}}),
        (ambiguous, {'contact_friction': {'all': ['coefficient']}, 'sensor_rotation': {'all': ['angle']}}),
        (unnamed, {'unnamed': {'joint1_over_q2': curve}}),
    ):
        found = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']
        assert list(found) == ['calibrated', 'calibrated_std', 'effects', 'effects_std', 'calibration']
        assert found['calibrated'] == outcome.final.parameters.as_dict()
        for group, kind in (('effects', 0), ('effects_std', 1)):
            tree = found[group]
            assert {n: {t: list(values) for t, values in inner.items()} for n, inner in tree.items()} == expected
            numbers = {
                path: float(number)
                for name, inner in tree.items()
                for target, values in inner.items()
                for path, number in (((name, target, key), number) for key, number in values.items())
            }
            stated = effect_parameters(outcome.diagnosis.found)
            wanted = {path: (value.value, value.std)[kind] for path, value in stated.items()}
            np.testing.assert_equal(numbers, wanted)


def test_names_that_yaml_takes_for_something_else(plain: Outcome) -> None:
    targets = ('no', '7', 'null', 'a.b', 'a b', '1e5')
    value = Value('radius', 1e-5, math.nan, 'm', 'more: # of it\nindeed')
    found = tuple(Found(ObjectRadius.of(0, target), (value,), True) for target in targets)
    outcome = replace(plain, diagnosis=replace(plain.diagnosis, found=found))
    tree = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']
    assert list(tree['effects']['object_radius']) == ['no', '7', 'null', 'a_b', 'a_b_2', '1e5']
    assert math.isnan(tree['effects_std']['object_radius']['a_b']['radius'])


def test_the_file_says_what_the_numbers_are_made_from_and_worth(plain: Outcome, ambiguous: Outcome) -> None:
    for outcome in (plain, replace(ambiguous, warnings=('a "quoted": # one', 'b\nc'), sources=('C:\\bag', '~/é'))):
        tree = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']['calibration']
        flat = {}
        for name, value in tree.items():
            flat |= {f'{name}.{key}': item for key, item in value.items()} if isinstance(value, dict) else {name: value}
        expected = {name: value for name, value in facts(outcome).items() if value != []}
        if outcome is not plain:
            expected['warnings'] = ['a "quoted": # one', 'b\nc']
        np.testing.assert_equal(flat, expected)
        assert {name: type(value) for name, value in flat.items()} == {n: type(v) for n, v in expected.items()}
    assert flat['assessment'] == 'caution'
    assert flat['rivals'] == ['sensor_rotation, contact_friction']


def test_a_result_comes_back_from_its_file(
    plain: Outcome, confounded: Outcome, grown: Outcome, unnamed: Outcome, tmp_path: Path
) -> None:
    path = tmp_path / 'calibration.yaml'
    for outcome in (plain, confounded, grown, unnamed):
        path.write_text(parameter_text(outcome), encoding='utf-8')
        stored = load_result(path)
        assert stored.values == list(outcome.final.parameters.as_dict().values())
        np.testing.assert_array_equal(stored.deviations, outcome.final.std)
        np.testing.assert_equal(stored.facts, facts(outcome))


@pytest.mark.parametrize(
    'text', ['', '[]', 'a: 1', '/**: {ros__parameters: 3}', '/**: {ros__parameters: {calibrated: {x0: 1.0}}}', 'x: [']
)
def test_a_file_that_is_no_result_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / 'other.yaml'
    path.write_text(text)
    with pytest.raises(ParameterError, match=r'other\.yaml'):
        load_result(path)


@pytest.mark.parametrize('wrong', ['.nan', 'far'])
def test_a_value_that_is_no_number_is_refused(plain: Outcome, wrong: str, tmp_path: Path) -> None:
    path = tmp_path / 'calibration.yaml'
    path.write_text(re.sub(r'l1: 0\.3.*', f'l1: {wrong}', parameter_text(plain), count=1))
    with pytest.raises(ParameterError, match='no result of a calibration'):
        load_result(path)
