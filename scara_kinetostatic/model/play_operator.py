"""Play operator: what friction lets through of a load, |load - p| ≤ r + μ |p|.

Friction of half width r, and of a part μ < 1 of what it lets through, holds p until the load drives it:

    p ← min(max(p, low), high),   low = a / (1 + μ sign a), a = load - r;   high = b / (1 - μ sign b), b = load + r.

With μ = 0 this is the play of Krasnosel'skii and Pokrovskii (Systems with Hysteresis, 1989), with μ > 0 a generalised
play: both limits rise with the load, so that the state depends on the nested extremes of the load alone
(Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, section 2.2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats

LARGEST_RATIO = 0.95
"""Of μ: at 1 friction holds any load."""


class PlayState(NamedTuple):
    """A play after a load.

    Attributes:
        value: p, of the unit of the load.
        by_half_width: ∂p/∂r, 0 where it has never moved.
        by_ratio: ∂p/∂μ, likewise.
    """

    value: Floats
    by_half_width: Floats
    by_ratio: Floats


def play_limits(load: Floats, half_width: Floats | float, ratio: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """The least and the largest p under a load, of the shape of all three together."""
    low, high = load - half_width, load + half_width
    return low / (1 + ratio * np.sign(low)), high / (1 - ratio * np.sign(high))


def play_operator(history: Floats, load: Floats, half_width: Floats | float, ratio: Floats | float = 0.0) -> PlayState:
    """The play that rested at 0, driven through a history to a load.

    Args:
        history: turning points of the load, the oldest first, (n, K).
        load: the load at last, (n,).
        half_width: r ≥ 0, one, or (t, 1) for t plays at once.
        ratio: μ, 0 to below 1, likewise.

    Returns:
        Of every load, (n,); of t plays, (t, n).
    """
    width, mu = np.maximum(half_width, 0.0), np.clip(ratio, 0.0, LARGEST_RATIO)
    value = sense = np.zeros(np.broadcast_shapes(np.shape(width), np.shape(mu), load.shape))
    for turn in (*history.T, load):
        low, high = play_limits(turn, width, mu)
        sense = np.where(value < low, -1.0, np.where(value > high, 1.0, sense))
        value = np.minimum(np.maximum(value, low), high)
    slope = sense / (1 - sense * mu * np.sign(value))  # of the limit that drove it last
    return PlayState(value, slope, slope * np.abs(value))


def play_range(load: Floats, half_width: float, ratio: float = 0.0) -> tuple[Floats, Floats]:
    """Limits (n,) between which p lies after each sample of a load (n,), whatever it was before.

    Each step is a clip, and a clip after a clip is a clip: a parallel prefix of log2(n) vector operations.
    """
    low, high = play_limits(load, half_width, ratio)
    step = 1
    while step < len(load):
        lower, upper = low[step:], high[step:]
        low = np.concatenate([low[:step], np.clip(low[:-step], lower, upper)])
        high = np.concatenate([high[:step], np.clip(high[:-step], lower, upper)])
        step *= 2
    return low, high
