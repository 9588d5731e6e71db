"""`calibration.yaml` is YAML in which every number is a real number."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import yaml

from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report.parameter_file import parameter_text


@pytest.mark.parametrize('which', ['plain', 'confounded', 'nasty'])
def test_values(which: str, request: pytest.FixtureRequest) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    c = outcome.calibration
    tree = yaml.safe_load(parameter_text(outcome))
    found = tree['/**']['ros__parameters']
    assert list(found) == ['calibrated', 'calibrated_std']
    assert found['calibrated'] == c.parameters.as_dict()
    for name in NAMES:
        std = found['calibrated_std'][name]
        assert isinstance(std, float)
        assert std == c.std_of(name) or (math.isnan(std) and c.status[name] == 'confounded')


@pytest.mark.parametrize('value', [0.0, 1e-5, -2e-17, 1e22, 123456.0, 5e-324])
def test_every_number_is_read_as_a_real_one(plain: Outcome, value: float) -> None:
    parameters = plain.calibration.parameters.replace(x0=value)
    outcome = replace(plain, calibration=replace(plain.calibration, parameters=parameters))
    found = yaml.safe_load(parameter_text(outcome))['/**']['ros__parameters']['calibrated']['x0']
    assert isinstance(found, float)
    assert found == value


def test_a_name_with_a_line_break_stays_in_its_comment(plain: Outcome) -> None:
    outcome = replace(plain, sources=('a\n/**: {b: c}\u2028d',))
    assert list(yaml.safe_load(parameter_text(outcome))) == ['/**']
