"""The messages of a diagnosis, and noise that is stated too large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import CELL, NOISE, deviations, effect, simulate

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import Cell, Noise

LOUD = replace(CELL, noise=Noise(20 * NOISE.joint, 20 * NOISE.force))


def test_sentences_after_the_first_begin_with_a_capital():
    assert advice.joined('', 'one thing', '', 'another', 'a third') == 'one thing. Another. A third'
    assert advice.joined('', '') == ''


@pytest.mark.parametrize(
    ('found', 'said'),
    [
        (('a', 'b'), 'these touches cannot distinguish a and b'),
        (('a', 'b', 'c', 'd', 'e'), 'these touches cannot distinguish a, b, c, d and 1 other'),
        (tuple('abcdefg'), 'these touches cannot distinguish a, b, c, d and 3 others'),
    ],
)
def test_rivals_are_counted(found, said):
    assert advice.open_questions('ambiguous', (), (found,), (), (), ()).startswith(said)


@pytest.mark.parametrize('cell', [LOUD, replace(CELL, noise=Noise(3 * NOISE.joint, 3 * NOISE.force))])
def test_noise_stated_too_large_neither_masks_nor_creates_an_effect(cell: Cell):
    clean = diagnose(calibrate(simulate(seed=0), cell))
    assert clean.verdict == 'none'
    assert 'it is stated too large' in clean.advice
    found = diagnose(calibrate(simulate((effect('encoder_gain[joint1]'), (6e-5,)), seed=3), cell))
    assert found.verdict == 'explained'
    assert [item.effect.label for item in found.found] == ['encoder_gain[joint1]']
    assert found.extended is not None
    assert found.extended.noise_source == 'estimated'
    assert np.abs(deviations(found.extended)).max() < 4


def test_correctly_stated_noise_is_kept():
    found = diagnose(calibrate(simulate((effect('encoder_gain[joint1]'), (6e-5,)), seed=3), CELL))
    assert found.extended is not None
    assert found.extended.noise_source == 'given'
    assert 'too large' not in found.advice
