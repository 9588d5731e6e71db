"""How each joint came to a hold: its last movement, from where it last turned round.

Friction in a joint is settled by the sense of this movement, whatever came before it. A
joint that never turns round on its way is followed back to the free pose: where the arm
last rested, clear of the contact, or, where it never rests, to the contact before. The part
of it in contact, the press, is what drags the tip along the disc.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.touches.plateaus import Plateau
from scara_kinetostatic.touches.segmentation import SMOOTHING, moving_mean
from scara_kinetostatic.touches.signals import Floats, Topic, median_of_three

LEAST_TURN = 5e-6
"""A joint that comes back by less than this has not turned round, rad,"""
TURN_SIGMAS = 8.0
"""nor by less than this many standard deviations of its smoothed samples,"""
TURN_DIGITS = 2.0
"""nor by fewer steps of the encoder."""
LONGEST_APPROACH = 5.0
"""The way to a contact is followed back no farther than this, s."""
REST_TIME = 0.04
"""The arm rests where no joint moves during this time, s,"""
REST_SPEED = 1e-3
"""faster than this, rad/s."""
CLEAR = 2e-3
"""Closer to the contact than this, in every joint, is no free pose, rad."""


class Arrival(NamedTuple):
    """How the joints came to a hold.

    Attributes:
        approach: last movement of each joint, (2,), rad.
        press: the part of it in contact, (2,), rad.
    """

    approach: Floats
    press: Floats


def last_movement(path: ArrayLike, hold: ArrayLike, least: ArrayLike = LEAST_TURN) -> Floats:
    """Motion from where each joint last turned round to the hold.

    Args:
        path: joint angles from the free pose on, in the order of time, (k, ..., 2), rad.
        hold: joint angles of the hold, (..., 2), rad.
        least: a way back shorter than this is no turning round, rad.

    Returns:
        (..., 2), rad; positive where the angle grew; 0 where a joint hardly moves all along.
    """
    way = (np.asarray(hold) - np.asarray(path))[::-1]
    left = np.abs(way) > least
    first = np.take_along_axis(way, left.argmax(axis=0)[None], axis=0)[0]
    sense = np.where(left.any(axis=0), np.sign(first), 0.0)
    way = np.where(np.maximum.accumulate(left, axis=0), sense * way, 0.0)
    turned = np.maximum.accumulate(way, axis=0) - way > least
    return np.asarray(sense * np.where(np.maximum.accumulate(turned, axis=0), 0.0, way).max(axis=0))


def resolution(joints: Topic) -> float:
    """Step of the encoders, the coarser of both, rad; near 0 where the readings are not rounded."""
    gaps = [np.diff(np.unique(np.round(column, 12))) for column in joints.value.T]
    return max((float(gap.min()) for gap in gaps if len(gap)), default=0.0)


def arrival(joints: Topic, plateau: Plateau, contact: float, earliest: float, step: float) -> Arrival:
    """The last movement of each joint before a settled part, and its part in contact.

    Args:
        joints: the joint angles of the recording.
        plateau: the settled part.
        contact: where the force leaves its zero, s.
        earliest: end of the contact before, s, or -inf.
        step: of the encoders, rad.

    Returns:
        Both as `last_movement`. The press is that of the samples from the contact on, so it lacks what the joints
        did while the force was still lost in the sensor's noise.
    """
    part = joints.stretch(max(earliest, contact - LONGEST_APPROACH), float(plateau.intervals[0, 0]))
    time, value = joints.time[part], joints.value[part]
    if not len(time):
        return Arrival(np.zeros(2), np.zeros(2))
    width = 2 * round(0.5 * SMOOTHING / joints.period) + 1
    smooth = moving_mean(median_of_three(value), width)
    scatter = plateau.joint_scatter / np.sqrt(width)
    least = np.maximum(max(LEAST_TURN, TURN_DIGITS * step), TURN_SIGMAS * scatter)
    touching = int(np.searchsorted(time, contact))
    begin = _free_pose(time, smooth, touching, float(least.max()))
    pressed = moving_mean(median_of_three(value[touching:]), width)
    return Arrival(last_movement(smooth[begin:], plateau.joints, least), last_movement(pressed, plateau.joints, least))


def _free_pose(time: Floats, value: Floats, contact: int, least: float) -> int:
    """Number of the last sample before the contact, clear of it, at which the arm rests; 0 where there is none."""
    time, value = time[: contact + 1], value[: contact + 1]
    later = np.searchsorted(time, time + REST_TIME)
    earlier = np.flatnonzero(later < len(time))
    later = later[earlier]
    moved = np.abs(value[later] - value[earlier]).max(axis=1)
    rests: NDArray[np.bool_] = moved <= REST_SPEED * (time[later] - time[earlier]) + least
    clear = np.abs(value[later] - value[-1]).max(axis=1) > max(CLEAR, least)
    free = later[rests & clear]
    return int(free[-1]) if len(free) else 0
