"""A calibrated arm survives `calibration.json`; what is none is refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import CalibrationFileError
from scara_kinetostatic.files.calibration_file import arm_document, load_calibration, read_arm
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document


def same(one: CalibratedArm, other: CalibratedArm) -> None:
    assert one.model == other.model
    assert one.cell == other.cell
    np.testing.assert_array_equal(one.covariance, other.covariance)
    np.testing.assert_array_equal(one.undetermined, other.undetermined)
    for name in ('noise', 'sensor', 'used', 'grade', 'verdict', 'created'):
        assert getattr(one, name) == getattr(other, name), name


@pytest.mark.parametrize('which', ['plain', 'confounded'])
def test_the_file_holds_the_arm(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    arm = outcome.arm
    path = tmp_path / 'calibration.json'
    path.write_text(json_text(as_document(outcome)), encoding='utf-8')
    same(load_calibration(path), arm)
    assert arm.undetermined.shape[1] == (which == 'confounded')


def test_every_effect_of_the_catalogue_is_read_back(plain: Outcome) -> None:
    arm = plain.arm
    for effect in (*catalogue(PAPER_CELL), OffNormalForce(off_normal=0.07), Unnamed(None, 'joint2', 'q2', 0.1, 2.0)):
        model = ExtendedModel(arm.model.parameters, (effect,), (effect.typical,))
        size = len(model.names)
        other = replace(arm, cell=PAPER_CELL, model=model, covariance=np.eye(size), undetermined=np.zeros((size, 0)))
        same(read_arm(json.loads(json.dumps(arm_document(other))), 'x'), other)


@pytest.mark.parametrize('label', ['base_compliance', 'anisotropic_gripper'])
def test_a_file_of_before_the_part_that_the_arm_contains_is_read(label: str, plain: Outcome) -> None:
    """That part is then 0, and exactly so."""
    effect = find(PAPER_CELL, label)
    model = ExtendedModel(plain.arm.model.parameters, (effect,), ((*[1e-6] * (len(effect.parameters) - 1), 0.0),))
    size = len(model.names)
    covariance = np.diag([*np.ones(size - 1), 0.0])
    arm = replace(plain.arm, cell=PAPER_CELL, model=model, covariance=covariance, undetermined=np.eye(size)[:, :1])
    document = json.loads(json.dumps(arm_document(arm)))
    stored = document['model']
    for rows in (
        stored['names'],
        stored['values'],
        *stored['covariance'],
        stored['covariance'],
        *stored['undetermined'],
    ):
        del rows[-1]
    same(read_arm(document, 'x'), arm)
    del stored['names'][-1]
    with pytest.raises(CalibrationFileError, match='other parameters'):
        read_arm(document, 'x')


def _without(key: str) -> Callable[[dict[str, Any]], Any]:
    def change(document: dict[str, Any]) -> Any:
        del document[key]
        return document

    return change


def _with(*path: str | int, value: Any) -> Callable[[dict[str, Any]], Any]:
    def change(document: dict[str, Any]) -> Any:
        inner: Any = document
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
        return document

    return change


def odds(*values: float) -> list[dict[str, Any]]:
    return [{'effects': [f'effect{k}'], 'probability': value} for k, value in enumerate(values)]


EFFECT = {'label': 'l', 'name': 'unnamed', 'class': 'Unnamed', 'fields': {}}
FRICTION = {
    'label': 'contact_friction[disc_1]',
    'name': 'contact_friction',
    'class': 'ContactFriction',
    'fields': {'target': 'disc_1', 'disc': 7},
}


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        (_without('schema'), 'expected the schema scara_kinetostatic/calibration/1, got None'),
        (_with('schema', value='scara_kinetostatic/calibration/2'), 'calibrate of this version'),
        (lambda document: [document], 'expected the schema'),
        (_without('model'), "no 'model'"),
        (_without('cell'), "no 'cell'"),
        (_without('assessment'), "no 'grade'|no 'assessment'"),
        (_with('model', 'values', value=[1.0]), 'damaged'),
        (_with('model', 'covariance', value=[[None] * 12] * 12), 'damaged'),
        (_with('model', 'names', value=['x0']), 'other parameters'),
        (_with('model', 'covariance', 3, 3, value=-1e-12), 'a variance is negative'),
        (_with('model', 'covariance', 3, 4, value=1.0), 'the covariance is not symmetric'),
        (_with('model', 'values', 3, value=-0.33), 'a link has no length'),
        (_with('model', 'values', 3, value=0.34), r'parameters.l1 is 0.33.*, but the calibrated model has 0.34'),
        (_with('parameters', 'l1', 'value', value=0.34), r'parameters.l1 is 0.34, but the calibrated model has 0.33'),
        (_with('parameters', 'l1', 'value', value='long'), "parameters.l1 is 'long'"),
        (_with('model', 'sensor', 'gain', value=-1.0), 'damaged: sensor'),
        (_with('model', 'noise', value={'joint': -1, 'force': 0.3}), 'damaged'),
        (_with('model', 'used', 'highest_force', value=-1.0), 'damaged'),
        (_with('model', 'effects', value=[EFFECT | {'name': 'n', 'class': 'N'}]), "'l' of this calibration"),
        (_with('model', 'effects', value=[EFFECT | {'fields': 3}]), 'damaged'),
        (_with('model', 'effects', value=[FRICTION]), r'contact_friction\[disc_1\]: disc is 7, not 0'),
        (_with('diagnosis', 'probabilities', value=odds(0.9, 0.2)), r'adding up to 1, got \[0.9, 0.2\]'),
        (_with('diagnosis', 'probabilities', value=odds(1.2, -0.2)), 'probabilities: expected 0 to 1'),
        (_with('diagnosis', 'probabilities', value=odds(float('nan'))), 'probabilities: expected 0 to 1'),
        (_with('diagnosis', 'probabilities', value=[{'effects': []}]), "no 'probability'"),
        (_with('diagnosis', 'inclusion', value={'base_tilt': 1.2}), 'inclusion: expected 0 to 1'),
        (_with('cell', 'nominal', value={'l1': 'long'}), 'cell: robot.nominal'),
        (_with('cell', 'gripper_excess', value=[[1e-6, 0.0], [0.0, 0.0]]), 'no general gripper; calibrate again'),
    ],
)
def test_anything_else_is_refused(
    change: Callable[[dict[str, Any]], Any], message: str, plain: Outcome, tmp_path: Path
) -> None:
    path = tmp_path / 'calibration.json'
    path.write_text(json.dumps(change(as_document(plain))), encoding='utf-8')
    with pytest.raises(CalibrationFileError, match=message) as caught:
        load_calibration(path)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    'change',
    [_with('diagnosis', value={'verdict': 'none'}), _with('diagnosis', 'probabilities', value=odds(0.97, 0.0304))],
)
def test_probabilities_are_right_or_absent_as_in_older_files(
    change: Callable[[dict[str, Any]], Any], plain: Outcome
) -> None:
    assert read_arm(json.loads(json.dumps(change(as_document(plain)))), 'x').model == plain.arm.model


def test_a_gripper_that_older_files_state_to_be_isotropic_is_read(plain: Outcome, tmp_path: Path) -> None:
    path = tmp_path / 'calibration.json'
    path.write_text(json.dumps(_with('cell', 'gripper_excess', value=[[0.0, 0.0]] * 2)(as_document(plain))))
    assert load_calibration(path).cell == plain.calibration.cell


@pytest.mark.parametrize('content', [b'', b'{"schema": ', b'\xff\xfe', b'[' * 100_000, b'/**: {ros__parameters: 3}'])
def test_files_that_are_none(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / 'calibration.json'
    path.write_bytes(content)
    with pytest.raises(CalibrationFileError):
        load_calibration(path)
