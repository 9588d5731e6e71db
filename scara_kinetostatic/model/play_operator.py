"""The play operator: what friction remembers of the load, from touch to touch.

The state that friction leaves depends on the turning points of the torque alone, and on those only that later ones have
not wiped out (Madelung's rule): the nested extremes, each swing smaller than the one before. So a hold needs its last
few turning points, not a whole stream.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats


def remembered(torques: Sequence[tuple[float, float]]) -> list[int]:
    """The points of a load that a memory can still hold after it: nested extremes of either joint, and the last point.

    Args:
        torques: of the load since its begin in the relaxed state, in the order of time, Nm.

    Returns:
        Their places, ascending.
    """
    places = set[int]()
    for torque in zip(*torques, strict=True):
        found = [*(at - 1 for at in nested_extremes([0.0, *torque])), len(torque) - 1]
        # what began relaxed forgets an extreme that a later one exceeds on the other side
        is_wiped = len(found) > 1 and abs(torque[found[0]]) <= abs(torque[found[1]])
        places.update(found[is_wiped:])
    return sorted(places)


def nested_extremes(path: ArrayLike, least: float = 0.0) -> list[int]:
    """The moments of a path that a memory holds at its end, whatever came before it.

    The largest and the smallest value; from the later one on the opposite extreme of the rest; and so on.

    Args:
        path: torques, (k,), k >= 1.
        least: an extreme counts only if the path comes to it and back from it by more than this.

    Returns:
        Positions in the order of time, without those of the values at which the path starts and ends.
    """
    values = np.asarray(path, dtype=float)
    last, back = len(values) - 1, values[::-1]
    high, low = last - int(back.argmax()), last - int(back.argmin())
    found, rising = [min(high, low), max(high, low)], high < low
    while True:
        rest = back[: last + 1 - found[-1]]
        at = last - int(rest.argmax() if rising else rest.argmin())
        if abs(values[at] - values[found[-1]]) <= least:
            break
        found.append(at)
        rising = not rising
    while found and abs(values[found[-1]] - values[-1]) <= least:
        found.pop()
    while found and abs(values[found[0]] - values[0]) <= least:
        found.pop(0)
    return found


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
    if not np.any(ratio):
        return low, high
    return low / (1 + ratio * np.sign(low)), high / (1 - ratio * np.sign(high))


def play_operator(history: Floats, load: Floats, half_width: Floats | float, ratio: Floats | float = 0.0) -> PlayState:
    """What friction lets through of a load, |load - p| ≤ r + μ |p|: p that rested at 0, driven through a history.

    Friction of half width r, and of a part μ < 1 of what it lets through, holds p until the load drives it:

        p ← min(max(p, low), high),   low = a / (1 + μ sign a), a = load - r;   high = b / (1 - μ sign b), b = load + r.

    With μ = 0 this is the play of Krasnosel'skii and Pokrovskii (Systems with Hysteresis, 1989), with μ > 0 a
    generalised play: both limits rise with the load, so that the state depends on the nested extremes of the load
    alone (Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, section 2.2).

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
