"""The search for the frequency of a transmission error."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import random_scene

from scara_kinetostatic.effects.joints import HIGHEST, LOWEST, TransmissionError, frequencies
from scara_kinetostatic.model.extended_model import TouchState


def joints(kind: str, n: int = 120) -> np.ndarray:
    rng = np.random.default_rng(1)
    one_side = rng.uniform(0.3, 2.6, n)
    return one_side if kind == 'one posture' else one_side * rng.choice([-1, 1], n)


def touch_state(angle: np.ndarray, joint: int) -> TouchState:
    at = random_scene(0, len(angle)).touch_state
    both = np.zeros((len(angle), 2))
    both[:, joint] = angle
    return at._replace(joints=both)


@pytest.mark.parametrize('kind', ['one posture', 'both postures'])
@pytest.mark.parametrize('joint', [0, 1])
def test_no_wave_is_lost_between_the_frequencies(kind, joint):
    """The best trial explains 85 % of any wave, and says what it is nearly."""
    angle, rng = joints(kind), np.random.default_rng(2)
    effect = TransmissionError.of(joint)
    at = touch_state(angle, joint)
    trials = effect.trials(at, at.force)
    columns = np.array([[part.joints[:, joint] for part in trial.columns] for trial in trials])
    bases = np.linalg.qr(np.moveaxis(columns, 1, 2))[0]
    grid = np.diff(frequencies(angle)).max()
    for _ in range(60):
        cycles, phase = rng.uniform(3, HIGHEST), rng.uniform(-np.pi, np.pi)
        wave = effect.shift(at, np.array([1e-4, phase, cycles])).joints[:, joint]
        power = (np.einsum('tnk,n->tk', bases, wave) ** 2).sum(axis=1) / (wave @ wave)
        best = int(power.argmax())
        assert power[best] > 0.85
        coefficients = np.linalg.lstsq(columns[best].T, wave, rcond=None)[0]
        found = trials[best].values(coefficients)
        assert found[0] == pytest.approx(1e-4, rel=0.15)
        assert abs(found[2] - cycles) <= grid
        np.testing.assert_allclose(effect.shift(at, found).joints[:, joint], coefficients @ columns[best], atol=1e-12)


def test_the_grid_is_bounded():
    for kind in ('one posture', 'both postures'):
        grid = frequencies(joints(kind))
        assert grid[0] == LOWEST
        assert grid[-1] == HIGHEST
        assert len(grid) < 500
    assert list(frequencies(np.full(10, 0.7))) == [LOWEST]
