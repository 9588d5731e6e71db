"""Messages of two robots in one stream: the joint angles jump back and forth between two motions.

In a motion of one robot a step from sample to sample is followed by its like. With two robots in turn, or a few
messages of each in turn, many large steps are undone by the next large one, almost exactly where the robots rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats

INTERLEAVED = 'the joint angles jump back and forth: messages of two robots on one topic'
_JUMP = 5e-3
"""Smaller steps may be noise, or the resolution of an encoder, rad."""
_SAME = 0.05
"""A jump is undone by the next one if their sum is below this part of it."""
_FEWEST_SAMPLES = 50
_FEWEST_JUMPS = 6
_SHARE = 0.05
"""Fewer jumps that are undone than this part of the samples are no sign of two robots."""
_SECOND = 1_000_000_000
_FEWEST_SECONDS = 3
"""So many seconds of a recording show it; messages out of order do not last."""


def is_interleaved(values: Floats) -> bool:
    """Whether the joint angles of about a second, (n, 2), rad, in the order of arrival, are those of two robots."""
    if len(values) < _FEWEST_SAMPLES:
        return False
    steps = np.diff(values[:, int(np.argmax(np.ptp(values, axis=0)))])
    jumps = steps[np.abs(steps) > _JUMP]
    undone = int(np.sum(np.abs(jumps[1:] + jumps[:-1]) < _SAME * np.abs(jumps[1:])))
    return undone >= max(_FEWEST_JUMPS, _SHARE * len(values))


def interleaved_seconds(received: NDArray[np.int64], values: Floats) -> int:
    """How many seconds of a recording have joint angles of two robots; 0 where they are too few to be sure.

    Args:
        received: when each sample was recorded, (n,), ns.
        values: joint angles in that order, (n, 2), rad.
    """
    edges = np.flatnonzero(np.diff(received // _SECOND)) + 1
    number = sum(map(is_interleaved, np.split(values, edges)))
    return number if number >= _FEWEST_SECONDS else 0
