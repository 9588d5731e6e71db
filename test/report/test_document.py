"""`calibration.json` keeps its contract."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report.document import as_document
from scara_kinetostatic.report.json_file import json_text

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


@pytest.mark.parametrize('which', ['plain', 'confounded', 'nasty'])
def test_contract(which: str, request: pytest.FixtureRequest) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    found = read(outcome)
    check(found, CONTRACT, '')
    assert found['schema'] == 'scara_kinetostatic/calibration/1'
    assert list(found['parameters']) == list(NAMES)
    for name, entry in found['parameters'].items():
        assert {'nominal', 'value', 'std', 'unit', 'status'} <= entry.keys()
        assert entry['unit'] == UNITS[name]
        assert entry['value'] == getattr(outcome.calibration.parameters, name)
    assert found['touches']['used'] + len(found['touches']['rejected']) == found['touches']['found'] == 37
    assert [entry['index'] for entry in found['touches']['rejected']] == [0, 8]
    assert all(entry['reason'] for entry in found['touches']['rejected'])
    assert found['noise'] == {'joint': 1e-5, 'force': 0.3, 'source': 'given'}
    assert found['diagnosis']['verdict'] in ('none', 'explained', 'ambiguous', 'unexplained')
    for group in ('force_error', 'held_out_force_error', 'reduced_chi_square'):
        assert found[group]['extended'] == found[group]['calibrated']


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
    assert 'another level' in found['identifiability']['advice']
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


def test_text_is_the_document_and_refuses_what_is_not_json(plain: Outcome) -> None:
    document = as_document(plain)
    text = json_text(document)
    assert json.loads(text) == document
    assert max(map(len, text.splitlines())) < 400
    with pytest.raises(ValueError, match='JSON compliant'):
        json_text({'value': float('nan')})
