"""Something that shifts at a moment; cross-talk of the force sensor; names beside which something is missing."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import (
    CELL,
    MORE,
    PLAN,
    calibrate,
    check_explained,
    check_parameters,
    effect,
    examined,
    named,
    simulate,
)

from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.document import as_document
from scara_kinetostatic.results.report import text_report

SHIFTS = {
    'shift[base]': (6e-5, -6e-5, 53.5),
    'shift[disc_2]': (4e-5, 4e-5, 40.5),
    'shift[sensor]': (0.8, -0.5, 53.5),
    'sensor_cross_talk': (0.02, 0.02, -0.01),
}


@pytest.mark.parametrize('label', SHIFTS)
def test_it_is_named_and_estimated_and_its_bias_removed(label):
    _, found = examined(label, SHIFTS[label])
    check_explained(found, label, SHIFTS[label])
    assert found.found[0].is_found


def test_the_zero_of_joint_2_and_the_tool_across_link_2_are_rivals():
    _, found = examined('shift[joint2]', (1e-4, 53.5))
    assert found.verdict == 'ambiguous'
    assert {'shift[joint2]', 'shift[tool]'} in [set(group) for group in found.rivals]
    check_parameters(found)


def test_a_small_shift_of_a_zero_is_no_certain_drift():
    """Half of a wave is near a line: each explains the touches of the other, and the zero at the start differs."""
    found = diagnose(calibrate(simulate((effect('shift[joint2]'), (-3e-5, 47.5)), seed=25, plan=MORE), CELL))
    assert 'shift[joint2]' in {*named(found)}.union(*found.rivals)
    check_parameters(found)


def test_the_moment_is_said_with_its_uncertainty():
    _, found = examined('shift[base]', (6e-5, -6e-5, 53.5))
    said = re.match(r'the base shifted during the recording between the touches (\d+) and (\d+)', found.advice)
    assert said is not None
    low, high = (int(number) for number in said.groups())
    assert 50 <= low < 53.5 < high <= 57
    _, found = examined('shift[disc_2]', (2.5e-5, 0.0, 40.5))
    *_, moment = found.found[0].values
    assert 0.5 < moment.std < 10
    assert abs(moment.value - 40.5) < 3 * moment.std


def test_between_two_recordings():
    """The clock of the second starts anew; the base has moved, and base and offsets are those after it."""
    first = simulate(seed=3)
    later = PAPER_ACTUAL.replace(x0=PAPER_ACTUAL.x0 + 8e-5)
    second = simulate(truth=later, seed=4)
    n = len(first)
    touches = TouchSet.concatenate(
        [first, second.replace(index=second.index + n, order=second.order + n, recording=np.ones(n, dtype=np.intp))]
    )
    found = diagnose(calibrate(touches, CELL))
    assert named(found) == ['shift[base]']
    assert 'between the recordings 1 and 2' in found.advice
    check_parameters(found, later)


def test_touches_of_a_table_that_are_not_in_the_order_of_time():
    law, values = effect('shift[base]'), (6e-5, -6e-5, 53.5)
    touches = simulate((law, values))
    mixed = np.random.default_rng(1).permutation(len(PLAN))
    shuffled = touches.select(mixed).replace(index=np.arange(len(PLAN)))
    start = ExtendedModel(CELL.nominal, (law,), ((0.0, 0.0, values[-1]),))
    one, other = (calibrate(each, CELL, start=start) for each in (touches, shuffled))
    np.testing.assert_allclose(other.model.as_array(), one.model.as_array(), rtol=0, atol=1e-9)
    assert one.reduced_chi_square < 1.3


def test_a_name_beside_an_incomplete_model_is_only_possible():
    """Noise that is twice as large as stated leaves a lack of fit: nothing is stated as found."""
    touches = simulate((effect('encoder_gain[joint1]'), (3e-4,)))
    cell = replace(CELL, noise=Noise(6e-6, 0.18))
    outcome = calibrate_touches(touches, cell)
    assert outcome.verdict == 'unexplained'
    assert not any(item.is_found and item.effect.is_physical for item in outcome.diagnosis.found)
    document = as_document(outcome)['diagnosis']
    assert not document['effects']
    assert [item['name'] for item in document['possible']] == ['encoder_gain']
    assert 'possible' in {item['role'] for item in document['candidates']}
    text = ' '.join(text_report(outcome).split())
    assert 'possible, not proved' in text
    assert 'Model error found and corrected' not in text
    json.dumps(document, allow_nan=False)


def test_the_budget_adds_up_where_a_moment_was_found():
    _, found = examined('shift[base]', SHIFTS['shift[base]'])
    together = np.sum([part.covariance for part in found.extended.contributions], axis=0)
    np.testing.assert_allclose(np.diag(together)[:12], found.extended.std**2, rtol=1e-9)
