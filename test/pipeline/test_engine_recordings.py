"""Recordings of a robot in MuJoCo with an undeclared effect: it is named, and the base parameters are right.

They are simulated by others' code. Reading them needs no MuJoCo; the truth is in `truth/`, which nothing but tests
reads. Made by `mujoco_cell.engine_recordings`, in the tests' folder `physics`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml
from pipeline.undeclared import TRUTH, cell_of, outcome_of

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.model.parameters import NAMES

TOUCHES = {'engine_f': 36}
USUAL_TOUCHES = 84
WITHOUT_EFFECT, FRICTION, WITHOUT_CELL, RIVALS = 'engine_a', 'engine_b', 'engine_c', ('engine_e', 'engine_f')
NAMED = ('engine_b', 'engine_c', 'engine_d')
ALL = pytest.mark.parametrize('name', [WITHOUT_EFFECT, *NAMED, *RIVALS])


@cache
def truth_of(name: str) -> dict[str, Any]:
    truth: dict[str, Any] = yaml.safe_load((TRUTH / f'{name}.yaml').read_text(encoding='utf-8'))
    return truth


def built_effect(name: str) -> tuple[str, dict[str, float]]:
    """Label and values of the one effect that was built."""
    (effect,) = truth_of(name)['effects']
    return effect['name'] + (f'[{effect["target"]}]' if effect['target'] else ''), effect['parameters']


def found_effect(outcome: Outcome, name: str) -> Found:
    """What the diagnosis says of the effect that was built."""
    (found,) = (item for item in outcome.diagnosis.found if item.effect.label == built_effect(name)[0])
    return found


def largest_deviation(outcome: Outcome, name: str) -> float:
    """Of the parameters L̄ that are to be used from those that touches show, in standard deviations.

    What touches show is what was built but for one: the mean of what a base yields in x and y is p_ee.
    """
    expected = np.array([truth_of(name)['expected'][parameter] for parameter in NAMES])
    assert np.isfinite(outcome.final.std).all()
    return float(np.abs((outcome.final.parameters.as_array() - expected) / outcome.final.std).max())


@ALL
def test_all_touches_are_found_and_nearly_all_used(name):
    outcome = outcome_of(name)
    assert outcome.found == TOUCHES.get(name, USUAL_TOUCHES)
    assert outcome.final.used.sum() >= outcome.found - 2
    assert outcome.calibration.noise_source == ('estimated' if name == WITHOUT_CELL else 'given')
    assert (cell_of(name).noise is None) == (name == WITHOUT_CELL)


def test_without_an_effect_nothing_is_found():
    outcome = outcome_of(WITHOUT_EFFECT)
    assert truth_of(WITHOUT_EFFECT)['effects'] == []
    assert outcome.diagnosis.verdict == 'none'
    assert outcome.diagnosis.found == ()
    assert outcome.diagnosis.p_value > 0.01
    assert largest_deviation(outcome, WITHOUT_EFFECT) < 4


@pytest.mark.parametrize('name', NAMED)
def test_the_effect_is_named_and_the_base_parameters_are_right(name):
    outcome = outcome_of(name)
    assert outcome.verdict == 'explained'
    assert outcome.diagnosis.p_value < 1e-6
    assert [item.effect.label for item in outcome.diagnosis.found] == [built_effect(name)[0]]
    assert largest_deviation(outcome, name) < 4
    if name == FRICTION:  # at most μ N; most touches stick with less, so the root mean square is below μ
        (off_normal,) = found_effect(outcome, name).values
        assert off_normal.name == 'off_normal_angle'
        assert 4 * off_normal.std < off_normal.value
        assert off_normal.value + 4 * off_normal.std < built_effect(name)[1]['coefficient']


@pytest.mark.parametrize('name', RIVALS)
def test_what_has_rivals_is_named_alone_or_beside_them(name):
    """Another disc displaced the other way and smaller explains the touches of one recording, too, friction those of
    the other, at odds that do not rule it out.
    """
    outcome, label = outcome_of(name), built_effect(name)[0]
    assert outcome.diagnosis.p_value < 1e-4  # of 36 touches
    assert outcome.verdict in ('explained', 'ambiguous')
    labels = {item.effect.label for item in outcome.diagnosis.found}
    assert label in labels
    assert labels == {label, *(one for group in outcome.diagnosis.rivals for one in group)}
    assert largest_deviation(outcome, name) < 4


@pytest.mark.parametrize('name', ['engine_c', 'engine_d', *RIVALS])
def test_its_values_are_those_built_and_touches_not_used_are_predicted(name):
    outcome, built = outcome_of(name), built_effect(name)[1]
    for value in found_effect(outcome, name).values:
        assert abs(value.value - built.get(value.name, 0.0)) < 4 * value.std  # what is expected of p_ee has an alias
    clean = outcome_of(WITHOUT_EFFECT).held_out.force_error
    assert (
        outcome.comparison.base.reduced_chi_square > 3
    )  # errors of discs beyond what is declared lower the force error
    assert outcome.extended_held_out.force_error < 1.15 * clean
