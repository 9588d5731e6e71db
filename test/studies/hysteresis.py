"""Loops by an independent simulator: sample by sample, finely, the spring's end dragged along when it slips."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.studies.hysteresis.laws import sine
from scara_kinetostatic.studies.hysteresis.motion import Motion, cut_at_reversals

TRUTH = {'zero': 0.001, 'compliance': 1e-6, 'half_gap': 2e-3, 'force_zero': 50.0}
SLIP_POSITIVE, SLIP_NEGATIVE = 8e3, 6e3
FINE = 40


def slipping(noise: float = 0.0, seed: int = 0, samples: int = 640) -> Motion:
    """A joint with gap that slips, in many small steps."""
    time, moved = sine(samples)
    p, g = TRUTH['compliance'], TRUTH['half_gap']
    fine = np.interp(np.linspace(0, len(time) - 1, FINE * (len(time) - 1) + 1), np.arange(len(time)), moved)
    anchor, forces = 0.0, []
    for k, x in enumerate(fine.tolist()):
        stretch = x - anchor
        force = np.sign(stretch) * max(abs(stretch) - g, 0.0) / p
        if force > SLIP_POSITIVE:
            anchor, force = x - g - p * SLIP_POSITIVE, SLIP_POSITIVE
        elif force < -SLIP_NEGATIVE:
            anchor, force = x + g + p * SLIP_NEGATIVE, -SLIP_NEGATIVE
        if k % FINE == 0:
            forces.append(force)
    force = np.array(forces) + TRUTH['force_zero']
    return cut_at_reversals(time, moved, force + noise * np.random.default_rng(seed).standard_normal(len(force)))
