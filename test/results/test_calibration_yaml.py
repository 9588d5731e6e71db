"""`calibration.yaml` is YAML in which every number is a real number."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from scara_kinetostatic.assessment.grade import rivals_in_words
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found, Value
from scara_kinetostatic.effects.objects import ObjectRadius
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.results.document import facts, load_result, parameter_text


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


def flat(tree: Any, path: str = '') -> dict[str, Any]:
    """The values of a tree by the names of their branches."""
    if not isinstance(tree, dict):
        return {path[1:]: tree}
    return {key: value for name in tree for key, value in flat(tree[name], f'{path}.{name}').items()}


def test_effects_stand_behind_the_twelve(grown: Outcome, ambiguous: Outcome, unnamed: Outcome) -> None:
    for outcome, places in (
        (grown, ['object_radius._x_q_frac_']),
        (ambiguous, ['sensor_rotation.all', 'contact_friction.all']),
        (unnamed, ['unnamed.joint1_over_q2']),
    ):
        found = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']
        assert list(found) == ['calibrated', 'calibrated_std', 'effects', 'effects_std', 'calibration']
        assert found['calibrated'] == outcome.final.parameters.as_dict()
        rows = [(place, v) for place, f in zip(places, outcome.diagnosis.found, strict=True) for v in f.values]
        np.testing.assert_equal(flat(found['effects']), {f'{place}.{v.name}': v.value for place, v in rows})
        np.testing.assert_equal(flat(found['effects_std']), {f'{place}.{v.name}': v.std for place, v in rows})


def test_names_that_yaml_takes_for_something_else(plain: Outcome) -> None:
    targets = ('no', '7', 'null', 'a.b', 'a b', '1e5')
    value = Value('radius', 1e-5, math.nan, 'm', 'more: # of it\nindeed')
    found = tuple(Found(ObjectRadius.of(0, target), (value,), True) for target in targets)
    outcome = replace(plain, diagnosis=replace(plain.diagnosis, found=found))
    tree = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']
    assert list(tree['effects']['object_radius']) == ['no', '7', 'null', 'a_b', 'a_b_2', '1e5']
    assert math.isnan(tree['effects_std']['object_radius']['a_b']['radius'])


def test_the_file_says_what_the_numbers_are_made_from_and_worth(ambiguous: Outcome) -> None:
    outcome = replace(ambiguous, warnings=('a "quoted": # one', 'b\nc'), sources=('C:\\bag', '~/é'))
    found = flat(yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']['calibration'])
    assert found == {name: value for name, value in facts(outcome).items() if value != []}
    assert (found['assessment'], found['rivals']) == ('caution', ['sensor_rotation, contact_friction'])
    assert found['possible_causes'] == [rivals_in_words(outcome.diagnosis, outcome.diagnosis.rivals[0])]
    assert found['possible_causes'][0].count(' %)') == 2
    assert found['warnings'] == ['a "quoted": # one', 'b\nc']


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
