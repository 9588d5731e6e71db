"""`calibration.json` keeps its contract."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import GROWN, NASTY

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files import calibration_file
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, UNITS
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document, write_results

REAL = (int, float)
CONTRACT = {
    'schema': str,
    'parameters': dict,
    'touches': {'found': int, 'used': int, 'rejected': list},
    'noise': {'joint': REAL, 'force': REAL, 'source': str},
    'force_error': {'nominal': REAL, 'calibrated': REAL, 'extended': REAL},
    'held_out_force_error': {'calibrated': REAL, 'extended': REAL, 'folds': int},
    'reduced_chi_square': {'calibrated': REAL, 'extended': REAL},
    'identifiability': {'rank': int, 'condition': REAL, 'confounded': list},
    'diagnosis': {'verdict': str, 'p_value': REAL, 'effects': list, 'rivals': list, 'advice': str},
}


def read(outcome: Outcome) -> dict[str, Any]:
    """Through the file, with a reader that takes no NaN."""

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(json_text(as_document(outcome)), parse_constant=refuse)


def check(found: Any, expected: Any, path: str) -> None:
    if isinstance(expected, dict):
        assert expected.keys() <= found.keys(), path
        for key, inner in expected.items():
            check(found[key], inner, f'{path}.{key}')
    else:
        assert isinstance(found, expected), path
        assert not isinstance(found, bool), path


@pytest.mark.parametrize('which', ['confounded', 'nasty', 'grown'])
def test_contract(which: str, request: pytest.FixtureRequest) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    found = read(outcome)
    check(found, CONTRACT, '')
    assert found['schema'] == 'scara_kinetostatic/calibration/1'
    assert list(found['parameters']) == list(NAMES)
    for name, entry in found['parameters'].items():
        assert {'nominal', 'value', 'std', 'unit', 'status'} <= entry.keys()
        assert entry['unit'] == UNITS[name]
        assert entry['value'] == getattr(outcome.final.parameters, name)
    assert found['touches']['used'] + len(found['touches']['rejected']) == found['touches']['found']
    assert found['touches']['rejected'][0]['index'] == 0
    assert all(entry['reason'] for entry in found['touches']['rejected'])
    assert found['noise'] == {'joint': 1e-5, 'force': 0.3, 'source': 'given'}
    assert found['diagnosis']['verdict'] in ('none', 'explained', 'ambiguous', 'unexplained')


@pytest.mark.parametrize('which', ['plain', 'confounded'])
def test_nothing_found_extended_is_calibrated(which: str, request: pytest.FixtureRequest) -> None:
    found = read(request.getfixturevalue(which))
    assert [entry['index'] for entry in found['touches']['rejected']] == [0, 8]
    for group in ('force_error', 'held_out_force_error', 'reduced_chi_square', 'tip_error'):
        assert found[group]['extended'] == found[group]['calibrated']
    assert found['tip_error']['bias'] == {'rms': 0, 'largest': 0}
    for entry in found['parameters'].values():
        assert entry['base_model']['value'] == entry['value']
        assert entry['base_model']['bias'] == 0
    assert found['diagnosis']['verdict'] == 'none'
    assert found['diagnosis']['effects'] == found['diagnosis']['rivals'] == []


def test_an_effect_with_its_value_and_the_errors_without_it(grown: Outcome) -> None:
    found = read(grown)
    diagnosis = found['diagnosis']
    assert (diagnosis['verdict'], diagnosis['rivals']) == ('explained', [])
    (effect,) = diagnosis['effects']
    assert (effect['name'], effect['target']) == ('object_radius', NASTY[1])
    radius = effect['parameters']['radius']
    assert abs(radius['value'] - GROWN) < 4 * radius['std'] < 0.1 * GROWN
    assert radius['unit'] == 'm'
    for group in ('force_error', 'held_out_force_error', 'reduced_chi_square', 'tip_error'):
        assert found[group]['extended'] < 0.5 * found[group]['calibrated']
    tip = found['tip_error']
    assert tip['extended'] < tip['held_out']['extended'] < 2 * tip['noise']
    assert tip['held_out']['calibrated'] > tip['calibrated'] > 2 * tip['extended']
    assert GROWN / 10 < tip['bias']['rms'] < tip['bias']['largest'] < 10 * GROWN
    roles = {(item['name'], item['target']): item['role'] for item in diagnosis['candidates']}
    assert roles['object_radius', NASTY[1]] == 'found'
    assert roles['link_bending', 'link2'] == 'unidentifiable'
    assert all(item['p_value'] is None for item in diagnosis['candidates'] if item['role'] == 'unidentifiable')


def test_the_parameters_are_those_of_the_extended_model(grown: Outcome) -> None:
    found = read(grown)
    truth = PAPER_ACTUAL.as_dict()
    for name, entry in found['parameters'].items():
        alone = entry['base_model']
        assert abs(entry['value'] - truth[name]) < 4 * entry['std']
        assert alone['value'] == getattr(grown.calibration.parameters, name) != entry['value']
        assert alone['bias'] == alone['value'] - entry['value']
        assert alone['bias_in_std'] == pytest.approx(alone['bias'] / alone['std'])
    assert found['identifiability']['rank'] == 12
    assert found['covariance']['names'] == list(NAMES)
    whole = found['covariance_extended']
    assert whole['names'] == [*NAMES, f'object_radius[{NASTY[1]}].radius']
    std = found['diagnosis']['effects'][0]['parameters']['radius']['std']
    assert whole['matrix'][12][12] ** 0.5 == pytest.approx(std)
    assert np.array(whole['matrix'])[:12, :12].tolist() == found['covariance']['matrix']


def test_the_joint_covariance_has_all_values(grown: Outcome) -> None:
    found = read(grown)
    whole = found['covariance_with_cell']
    model = grown.final.full_model
    assert whole['names'] == list(model.names)
    assert whole['names'][: len(grown.final.model.names)] == found['covariance_extended']['names']
    assert whole['values'] == model.as_array().tolist()
    parts = {part.label: part.covariance for part in grown.final.contributions}
    stays = parts['undetected[large_effect]'], parts['undetected[assumed_places]']  # the same in later predictions
    assert all(part.any() for part in stays)
    assert np.allclose(whole['matrix'], grown.final.covariance - sum(stays), rtol=1e-9, atol=0)


def test_rivals_are_named_together_and_none_of_them_as_found(ambiguous: Outcome) -> None:
    diagnosis = read(ambiguous)['diagnosis']
    assert diagnosis['verdict'] == 'ambiguous'
    assert diagnosis['effects'] == []
    assert [set(group) for group in diagnosis['rivals']] == [{'contact_friction', 'sensor_rotation'}]
    ((first, second),) = diagnosis['rival_effects']
    assert {first['name'], second['name']} == {'contact_friction', 'sensor_rotation'}
    assert all(item['target'] is None and item['parameters'] for item in (first, second))
    assert diagnosis['advice']


def test_what_has_no_name_has_a_description(unnamed: Outcome) -> None:
    diagnosis = read(unnamed)['diagnosis']
    assert diagnosis['verdict'] == 'unexplained'
    (effect,) = diagnosis['effects']
    assert effect['name'] == 'unnamed'
    assert effect['description'] == 'joint 1 deviates by an angle, depending on the angle of joint 2'


def test_rank_is_that_of_the_twelve(plain: Outcome) -> None:
    groups = (('contact_friction.coefficient', 'sensor_rotation.angle'), ('g_ee', 'object_radius[disc_1].radius'))
    seen = replace(plain.calibration.identifiability, confounded=groups)
    found = read(replace(plain, calibration=replace(plain.calibration, identifiability=seen)))['identifiability']
    assert found['rank'] == 11
    assert found['confounded'] == [list(groups[1])]
    assert found['confounded_effects'] == [list(groups[0])]


def test_status_and_std(confounded: Outcome) -> None:
    found = read(confounded)
    entries = found['parameters']
    assert (entries['l1']['status'], entries['l1']['std'], entries['l1']['value']) == ('fixed', 0, 0.3302)
    for name in ('p_ee', 'g_ee'):
        assert (entries[name]['status'], entries[name]['std']) == ('confounded', None)
    assert entries['x0']['status'] == 'estimated'
    assert entries['x0']['std'] > 0
    assert found['identifiability']['confounded'] == [['p_ee', 'g_ee']]
    assert found['identifiability']['rank'] == 10
    assert 'add touches at another force' in found['identifiability']['advice']
    assert found['covariance']['names'] == [name for name in NAMES if name not in ('l1', 'p_ee', 'g_ee')]


def test_covariance_and_touches_agree_with_the_rest(plain: Outcome) -> None:
    found = read(plain)
    matrix = np.array(found['covariance']['matrix'])
    stds = [found['parameters'][name]['std'] for name in found['covariance']['names']]
    np.testing.assert_allclose(np.sqrt(np.diag(matrix)), stds, rtol=1e-12)
    used = [entry for entry in found['touches']['fitted'] if entry['used']]
    assert len(used) == found['touches']['used']
    mean = np.mean([math.hypot(*entry['residual']) for entry in used])
    assert mean == pytest.approx(found['force_error']['calibrated'], rel=1e-12)


def test_what_could_not_be_read_again_is_not_written(
    plain: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibration_file, '_MOST_VALUES', 1000)
    with pytest.raises(UnsupportedDataError, match=r'36 touches make a calibration\.json too large .* leave some out'):
        write_results(plain, tmp_path / 'result', report=False)
    assert not (tmp_path / 'result').exists()
