"""Rejected touches that are scattered by chance, and such that are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import hypergeom

from scara_kinetostatic.assessment.evidence import concentrations, hypergeometric_tail

OBJECT = np.arange(72) % 3
RECORDING = (np.arange(72) >= 48).astype(np.intp)
LABELS = {'object': OBJECT, 'recording': RECORDING}


def marked(*places: int) -> np.ndarray:
    rejected = np.zeros(72, dtype=bool)
    rejected[list(places)] = True
    return rejected


@pytest.mark.parametrize(('least', 'total', 'drawn', 'special'), [(3, 24, 8, 3), (5, 72, 24, 8), (9, 500, 40, 60)])
def test_the_tail_is_that_of_the_hypergeometric_distribution(least: int, total: int, drawn: int, special: int) -> None:
    exact = hypergeom.sf(least - 1, total, special, drawn)
    found = float(hypergeometric_tail(least, total, drawn, special))
    assert exact <= found * (1 + 1e-9)
    assert found < 1.2 * exact


def test_one_object_one_recording_one_span() -> None:
    assert concentrations(marked(1, 10, 22, 37, 46, 58, 67), LABELS)[0][:2] == ('object', 1)
    assert concentrations(marked(50, 52, 57, 59, 63, 66, 68, 71, 49), LABELS)[0][:2] == ('recording', 1)
    worst = concentrations(marked(20, 21, 22, 23, 25), LABELS)[0]
    assert worst.kind == 'span'
    assert np.flatnonzero(worst.members).tolist() == [20, 21, 22, 23, 24, 25]
    assert worst.p_value < 1e-3


def test_scattered_ones_are_by_chance_as_often_as_stated() -> None:
    random = np.random.default_rng(0)
    least = [
        concentrations(marked(*random.choice(72, random.integers(2, 12), replace=False)), LABELS)[0].p_value
        for _ in range(500)
    ]
    assert np.mean(np.array(least) < 0.05) < 0.065


def test_one_alone_says_nothing() -> None:
    assert concentrations(marked(5), LABELS) == []
