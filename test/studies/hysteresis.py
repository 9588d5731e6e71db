"""Loops by an independent simulator: sample by sample, finely, the spring's end dragged along when it slips."""

from __future__ import annotations

import numpy as np

from benchmark.hysteresis import sine
from scara_kinetostatic.studies.loops.record import Record

TRUTH = {'zero': 0.001, 'compliance': 1e-6, 'half_gap': 2e-3, 'force_zero': 50.0}
SLIPS = {'slip_positive': 8e3, 'slip_negative': 6e3}


def slipping(noise: float = 0.0, seed: int = 0, fine: int = 40) -> Record:
    """A joint with gap that slips, in many small steps."""
    time, moved = sine()
    p, g = TRUTH['compliance'], TRUTH['half_gap']
    places = np.interp(np.linspace(0, len(time) - 1, fine * (len(time) - 1) + 1), np.arange(len(time)), moved)
    anchor, forces = 0.0, []
    for k, x in enumerate(places.tolist()):
        stretch = x - anchor
        force = np.sign(stretch) * max(abs(stretch) - g, 0.0) / p
        if force > SLIPS['slip_positive']:
            force = SLIPS['slip_positive']
            anchor = x - g - p * force
        elif force < -SLIPS['slip_negative']:
            force = -SLIPS['slip_negative']
            anchor = x + g - p * force
        if k % fine == 0:
            forces.append(force)
    noisy = np.array(forces) + TRUTH['force_zero'] + noise * np.random.default_rng(seed).standard_normal(len(time))
    return Record('loops.csv', time, noisy, moved, 'N')
