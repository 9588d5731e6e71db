"""The load before a hold, and the memory of a play operator that it leaves.

A play of half width r follows a torque C only where C drives it: p ← min(max(p, C - r), C + r). Its state depends on
the turning points of C alone, and on those only that later ones have not wiped out (Madelung's rule): the nested
extremes, each swing smaller than the one before. So a hold needs its last few turning points, not a whole stream.

Source: Brokate and Sprekels, Hysteresis and Phase Transitions (1996), section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import Parameters

Phasors = NDArray[np.complex128]


class PlayState(NamedTuple):
    """A play operator after a load.

    Attributes:
        value: P_r, of the unit of the load.
        by_half_width: ∂P_r/∂r: -1 where it follows a rising load, +1 a falling one, 0 where it has never moved.
    """

    value: Floats
    by_half_width: Floats


def play_operator(history: Floats, load: Floats, half_width: Floats | float) -> PlayState:
    """The play of half width r that rested at 0, driven through a history to a load.

    Args:
        history: turning points of the load, the oldest first, (n, K).
        load: the load at last, (n,).
        half_width: r > 0, one, or (t, 1) for t plays at once.

    Returns:
        Of every load, (n,); of t plays, (t, n).
    """
    width = np.maximum(half_width, 0.0)
    value = by_half_width = np.zeros(np.broadcast_shapes(np.shape(width), load.shape))
    for turn in (*history.T, load):
        low, high = turn - width, turn + width
        by_half_width = np.where(value < low, -1.0, np.where(value > high, 1.0, by_half_width))
        value = np.minimum(np.maximum(value, low), high)
    return PlayState(value, by_half_width)


def play_value(history: Floats, load: Floats, half_width: Floats | float) -> Floats:
    """`play_operator` without the derivative."""
    width = np.maximum(half_width, 0.0)
    value: Floats = np.zeros(np.broadcast_shapes(np.shape(width), load.shape))
    for turn in (*history.T, load):
        value = np.minimum(np.maximum(value, turn - width), turn + width)
    return value


class TorquePhasors(NamedTuple):
    """Torques as imaginary parts of complex numbers, (..., ) each, Nm: a force turned by an angle and stretched by a
    factor has the torques of the phasors times that complex number.
    """

    first: Phasors
    second: Phasors


def torque_phasors(parameters: Parameters, points: Floats, frame: SensorFrame = SensorFrame.BASE) -> TorquePhasors:
    """Phasors of C = JᵀF with J at the measured angles Q, in place of Q*: an approximation of relative order p C.

    Args:
        parameters: L̄.
        points: q1, q2, rad, fx, fy, N, as in `TouchSet.history`, (..., 4).
        frame: that of the forces.
    """
    force: Phasors = points[..., 2] + 1j * points[..., 3]
    elbow = points[..., 1] + parameters.theta2
    if frame is SensorFrame.BASE:  # seen from the frame of link 2
        force = force * np.exp(-1j * (points[..., 0] + parameters.theta1 + elbow))
    second: Phasors = parameters.l2 * force
    return TorquePhasors(second + parameters.l1 * force * np.exp(1j * elbow), second)


@lru_cache(maxsize=16)
def torque_phasors_again(parameters: Parameters, points: ById, frame: SensorFrame) -> TorquePhasors:
    """`torque_phasors`, which many evaluations of the same touches with the same parameters share."""
    return torque_phasors(parameters, points.array, frame)


class ById:
    """An array that is the same only if it is this one."""

    def __init__(self, array: Floats) -> None:
        self.array = array

    def __hash__(self) -> int:
        return id(self.array)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ById) and other.array is self.array


def torques_of(parameters: Parameters, points: Floats, frame: SensorFrame = SensorFrame.BASE) -> Floats:
    """C of points as `torque_phasors` takes them, (..., 2), Nm."""
    phasors = torque_phasors(parameters, points, frame)
    return np.stack([phasors.first.imag, phasors.second.imag], axis=-1)


def remembered(torques: Sequence[tuple[float, float]]) -> list[int]:
    """The points of a load that a memory can still hold after it: nested extremes of either joint, and the last point.

    Args:
        torques: of the load since its begin in the relaxed state, in the order of time, Nm.

    Returns:
        Their places, ascending.
    """
    return sorted({place for torque in zip(*torques, strict=True) for place in _nested_extremes(torque)})


def _nested_extremes(torque: Sequence[float]) -> list[int]:
    """The largest in size, the opposite extreme after it, and so on to the end; the last of equal ones."""
    last, back = len(torque) - 1, torque[::-1]
    high, low = last - back.index(max(torque)), last - back.index(min(torque))
    found = [max((abs(torque[high]), high), (abs(torque[low]), low))[1]]
    falling = torque[found[0]] > 0
    while found[-1] < last:
        rest = torque[found[-1] + 1 :]
        found.append(last - back.index(min(rest) if falling else max(rest)))
        falling = not falling
    return found
