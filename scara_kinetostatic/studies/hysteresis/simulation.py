"""Loops played by a known law: what the decision is tried on.

The motion is that of the measured loops: a sine whose amplitude grows from cycle to cycle. The noise may hang together
from sample to sample, with the correlation r^k over k samples.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from scara_kinetostatic.studies.hysteresis.laws import Law, Values
from scara_kinetostatic.studies.hysteresis.motion import Floats, Motion, cut

AMPLITUDE, PERIOD = 0.02, 2.0
_GROWN = 2
"""Cycles after which the amplitude is reached."""
_FIRST = 0.4


def sine(samples: int = 640, cycles: int = 5) -> tuple[Floats, Floats]:
    """Time and displacement, (samples,), s and m."""
    time = np.linspace(0, PERIOD * cycles, samples)
    size = np.minimum(_FIRST + (1 - _FIRST) * time / (_GROWN * PERIOD), 1.0)
    return time, AMPLITUDE * size * np.sin(2 * np.pi * time / PERIOD)


def played(law: Law, values: Values, noise: float, seed: int, correlation: float = 0.0) -> Motion:
    """A record of a law.

    Args:
        law: which.
        values: its parameters, SI.
        noise: standard deviation of the force readings, N.
        seed: of the noise.
        correlation: from one sample of the noise to the next.
    """
    time, displacement = sine()
    rest = np.zeros(len(time))
    rest[-1] = 1.0  # no record has a constant force
    motion = cut(time, displacement, rest)
    force = law.force(values, motion)
    white = np.random.default_rng(seed).standard_normal(len(force))
    white[1:] *= np.sqrt(1 - correlation**2)
    return cut(motion.time, motion.displacement, force + noise * lfilter([1.0], [1.0, -correlation], white))
