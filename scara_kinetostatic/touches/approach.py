"""The approach to a hold: the last movement of each joint, from its last reversal to the hold.

Its sense determines the friction in the joint, whatever came before. A joint without a reversal is followed back to
the free pose, where the arm last rested away from the contact, or, if it never rests, to the previous contact. The
part of the movement in contact, the press, drags the tip along the disc.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.holds import Hold
from scara_kinetostatic.touches.signals import SMOOTHING, Topic, median_of_three, moving_mean

SMALLEST_REVERSAL = 5e-6
"""A movement back by less than this is not a reversal, rad,"""
_REVERSAL_SIGMAS = 8.0
"""nor by less than this many standard deviations of the smoothed joint angle,"""
_REVERSAL_STEPS = 2.0
"""nor by less than this many steps of the encoder."""
_LONGEST_APPROACH = 5.0
"""The movement before a contact is followed back for at most so long, s."""
_REST_TIME = 0.04
"""The arm rests if during this time, s,"""
_REST_SPEED = 1e-3
"""no joint moves faster than this, rad/s."""
_CLEAR = 2e-3
"""A pose is free if a joint is at least so far from its angle at the contact, rad."""


class Approach(NamedTuple):
    """The last movement of the joints before a hold.

    Attributes:
        approach: last movement of each joint, (2,), rad.
        press: the part of it in contact, (2,), rad.
    """

    approach: Floats
    press: Floats


def last_movement(path: ArrayLike, hold: ArrayLike, least: ArrayLike = SMALLEST_REVERSAL) -> Floats:
    """Movement of each joint from its last reversal to the hold.

    Args:
        path: joint angles from the free pose on, in the order of time, (k, ..., 2), rad.
        hold: joint angles of the hold, (..., 2), rad.
        least: smallest movement back that is a reversal, rad.

    Returns:
        (..., 2), rad; positive where the angle grew, 0 where a joint moves by less than `least`.
    """
    offset = (np.asarray(hold) - np.asarray(path))[::-1]
    left = np.abs(offset) > least
    first = np.take_along_axis(offset, left.argmax(axis=0)[None], axis=0)[0]
    sense = np.where(left.any(axis=0), np.sign(first), 0.0)
    offset = np.where(np.maximum.accumulate(left, axis=0), sense * offset, 0.0)
    turned = np.maximum.accumulate(offset, axis=0) - offset > least
    return np.asarray(sense * np.where(np.maximum.accumulate(turned, axis=0), 0.0, offset).max(axis=0))


def resolution(joints: Topic) -> float:
    """Resolution of the encoders, the coarser of both, rad; near 0 where the readings are not rounded."""
    gaps = [np.diff(np.unique(np.round(column, 12))) for column in joints.value.T]
    return max((float(gap.min()) for gap in gaps if len(gap)), default=0.0)


def approach_of_hold(joints: Topic, hold: Hold, contact: float, earliest: float, step: float) -> Approach:
    """The last movement of each joint before a hold, and its part in contact.

    Args:
        joints: the joint angles of the recording.
        hold: the hold.
        contact: begin of the contact, s.
        earliest: end of the previous contact, s, or -inf.
        step: resolution of the encoders, rad.

    Returns:
        Both as by `last_movement`. The press does not contain the movement while the force was still below the noise
        of the sensor.
    """
    part = joints.stretch(max(earliest, contact - _LONGEST_APPROACH), float(hold.intervals[0, 0]))
    time, value = joints.time[part], joints.value[part]
    if not len(time):
        return Approach(np.zeros(2), np.zeros(2))
    width = 2 * round(0.5 * SMOOTHING / joints.period) + 1
    smooth = moving_mean(median_of_three(value), width)
    scatter = hold.joint_scatter / np.sqrt(width)
    least = np.maximum(max(SMALLEST_REVERSAL, _REVERSAL_STEPS * step), _REVERSAL_SIGMAS * scatter)
    touching = int(np.searchsorted(time, contact))
    begin = _free_pose(time, smooth, touching, float(least.max()))
    pressed = moving_mean(median_of_three(value[touching:]), width)
    return Approach(last_movement(smooth[begin:], hold.joints, least), last_movement(pressed, hold.joints, least))


def _free_pose(time: Floats, value: Floats, contact: int, least: float) -> int:
    """Index of the last sample before the contact at which the arm rests in a free pose; 0 if there is none."""
    time, value = time[: contact + 1], value[: contact + 1]
    later = np.searchsorted(time, time + _REST_TIME)
    earlier = np.flatnonzero(later < len(time))
    later = later[earlier]
    moved = np.abs(value[later] - value[earlier]).max(axis=1)
    rests: NDArray[np.bool_] = moved <= _REST_SPEED * (time[later] - time[earlier]) + least
    clear = np.abs(value[later] - value[-1]).max(axis=1) > max(_CLEAR, least)
    free = later[rests & clear]
    return int(free[-1]) if len(free) else 0
