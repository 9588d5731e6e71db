"""The bound of a diagnosis: what is left out is said, and nothing is stated as found."""

from __future__ import annotations

import pytest
from diagnosis.simulated import CELL, calibrate, diagnose, effect, simulate

from scara_kinetostatic.diagnosis import diagnose as module
from scara_kinetostatic.diagnosis.refit import Effort

TWO = (effect('object_position[disc_2]'), (2e-4, 1e-4)), (effect('encoder_gain[joint1]'), (3e-3,))


def test_steps_are_counted_in_those_of_a_fit_with_two_effects():
    effort, touches = Effort(most=10), simulate(seed=0)
    assert effort.allows()
    steps = effort.fit(touches, CELL).iterations / 2
    steps += effort.fit(touches, CELL, [effect for effect, _ in TWO]).iterations
    assert effort.steps == pytest.approx(steps)
    assert effort.steps > effort.most
    assert not effort.has_left_out
    assert not effort.allows()
    assert effort.has_left_out


def test_a_search_that_is_cut_short_states_nothing_as_found(monkeypatch):
    calibration = calibrate(simulate(*TWO, seed=0), CELL)
    whole = diagnose(calibration)
    assert whole.verdict == 'explained'
    assert 'ended early' not in whole.advice
    monkeypatch.setattr(module, 'Effort', lambda *_: Effort(5))
    found = diagnose(calibration)
    assert found.verdict == 'unexplained'
    assert 'ended early' in found.advice
    assert not [item for item in found.found if item.is_found]
    assert 'found' not in {item.role for item in found.ranking}
