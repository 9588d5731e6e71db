"""The settled parts of one contact: joints at rest, force steady.

At every wrench sample the mean of either topic over a short time (`Signals.half`) before it is
compared with the mean over the same time after it. Where both agree within the noise, the
contact is settled. A contact may hold several plateaus (a force raised in steps);
each is a touch. Plateaus that agree are one, disturbed in between.

A motion so slow that it passes does no harm: angles and force are averaged over the
same time, and in between the contact is in equilibrium.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.touches.signals import (
    Floats,
    Signals,
    Topic,
    mean_steps,
    median,
    robust_mean,
    runs,
    white_noise,
)
from scara_kinetostatic.touches.tare import Tare

SHORTEST_HOLD = 0.2
"""A hold shorter than this is no touch, s."""
SIGMAS = 5.0
STEADY_FORCE = 0.004
"""Change of the force between neighbouring means that is no change, of the force."""
ROUGH_CONTACT = 0.02
"""In contact the force may be noisier than before, up to this part of it."""
LARGEST_WANDER = 0.01
"""The slow noise of the force is believed up to this part of it."""
STEADY_JOINT = 1e-3
"""Speed of a joint that is no motion, rad/s."""
HIGHEST_JOINT_NOISE = 1e-4
"""Joint readings noisier than this are not at rest, rad."""
FARTHEST_JOINT = 5e-3
"""A joint that goes farther than this, rad,"""
SOFTEST = 3e-4
"""and farther than this by the change of the force, rad/N, slides."""
SAME_FORCE = 0.01
"""Plateaus closer than this are one, of the force."""
CREEP = 0.05
"""Plateaus that differ by less than this, of the force,"""
CREEP_TIME = 0.1
"""and follow each other within this time, s, are one that creeps."""
PEAK = 0.5
"""A plateau shorter than this part of another in the same contact, and settled for less than the time of
a mean, is none: the means on both sides of a peak agree as well."""
SAME_JOINT = 5e-5
"""Plateaus closer than this are one, rad."""


class Plateau(NamedTuple):
    """A settled part of a contact.

    Attributes:
        intervals: the stretches of time that are averaged, (k, 2), s.
        begin: where it begins, s.
        end: where it ends, s.
        joints: mean angles, (2,), rad.
        force: mean force in the frame and sign of the sensor, its zero removed, (2,), N.
        joint_scatter: standard deviation of the angles, (2,), rad.
        force_scatter: standard deviation of the force, (2,), N.
        samples: number of force samples.
    """

    intervals: Floats
    begin: float
    end: float
    joints: Floats
    force: Floats
    joint_scatter: Floats
    force_scatter: Floats
    samples: int

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.end - self.begin


class PlateauSearch(NamedTuple):
    """How a contact settles.

    Attributes:
        plateaus: those long enough, in the order of time.
        longest: duration of the longest settled part, long enough or not, s.
        parts: number of settled parts.
        loaded: time from the first to the last sample with more than half of the largest force, s.
        steady: part of that time with a steady force.
        slides: whether the joints go farther meanwhile than the force can bend them.
    """

    plateaus: tuple[Plateau, ...] = ()
    longest: float = 0.0
    parts: int = 0
    loaded: float = 0.0
    steady: float = 0.0
    slides: bool = False


def find_plateaus(signals: Signals, tare: Tare, begin: float, end: float) -> PlateauSearch:
    """The settled parts of one contact.

    Args:
        signals: the recording.
        zero: the force zero, and where the force leaves it.
        begin: from where on the force is clearly above the zero, s.
        end: where the contact ends, s.
    """
    joints, half = signals.joints, signals.half
    time = signals.calm.time[signals.calm.stretch(tare.contact, end)]
    if len(time) < 2:
        return PlateauSearch()
    calm = _calmness(signals, tare, time)
    settled = calm.steady & calm.at_rest & (time >= begin)
    found = _plateaus(signals, tare, time, settled, half, calm.noise)
    shortest = SHORTEST_HOLD - 1.5 * max(joints.period, signals.wrench.period)
    loaded = np.flatnonzero(calm.load >= 0.5 * calm.load.max())
    span = slice(int(loaded[0]), int(loaded[-1]) + 1)
    under_load = joints.value[joints.stretch(time[span][0], time[span][-1])]
    return PlateauSearch(
        plateaus=tuple(plateau for plateau in found if plateau.duration >= shortest),
        longest=max((plateau.duration for plateau in found), default=0.0),
        parts=len(found),
        loaded=float(time[span][-1] - time[span][0]),
        steady=float(calm.steady[span].mean()),
        slides=_slides(under_load, calm.load[span], calm.at_rest[span]),
    )


class _Calmness(NamedTuple):
    """At k times of a contact: size of the force and its noise, N, whether it is steady, whether the joints rest."""

    load: Floats
    steady: NDArray[np.bool_]
    at_rest: NDArray[np.bool_]
    noise: float


def _calmness(signals: Signals, tare: Tare, time: Floats) -> _Calmness:
    joints, wrench, half = signals.joints, signals.calm, signals.half
    force_step, load = mean_steps(wrench, time, half)
    load = np.hypot(*(load - tare.force).T)
    force = wrench.value[wrench.stretch(time[0], np.nextafter(time[-1], np.inf))]
    noise = max(tare.noise, min(white_noise(force), ROUGH_CONTACT * float(median(load))))
    wander = min(tare.wander, LARGEST_WANDER * float(load.max()))
    force_limit = max(SIGMAS * max(_of_step(noise, wrench, half), wander), _digit(force))
    joint_noise = min(white_noise(joints.value[joints.stretch(time[0], time[-1])]), HIGHEST_JOINT_NOISE)
    joint_limit = STEADY_JOINT * half + SIGMAS * _of_step(joint_noise, joints, half)
    return _Calmness(
        load=load,
        steady=np.hypot(*force_step.T) <= np.maximum(force_limit, STEADY_FORCE * load),
        at_rest=np.abs(mean_steps(joints, time, half)[0]).max(axis=1) <= joint_limit,
        noise=noise,
    )


def _slides(joints: Floats, load: Floats, at_rest: NDArray[np.bool_]) -> bool:
    """Whether joints that hardly rest go farther than a change of the force can bend them."""
    if at_rest.mean() > 0.5 or not len(joints):
        return False
    return bool(np.ptp(joints, axis=0).max() > FARTHEST_JOINT + SOFTEST * np.ptp(load))


def _digit(values: Floats) -> float:
    """The smallest change of a reading: its last digit, where that is coarse."""
    steps = np.abs(np.diff(values, axis=0))
    return float(np.min(steps, where=steps > 0, initial=np.inf)) if steps.any() else 0.0


def _of_step(noise: float, topic: Topic, half: float) -> float:
    """Standard deviation of the difference of two neighbouring means."""
    return noise * float(np.sqrt(2.0 * topic.period / half))


def _plateaus(
    signals: Signals, tare: Tare, time: Floats, settled: NDArray[np.bool_], half: float, noise: float
) -> list[Plateau]:
    """Settled parts, those that agree with the one before joined to it."""
    found: list[Plateau] = []
    for first, last in zip(*runs(settled), strict=True):
        begin, end = float(time[first]), float(time[last])
        if end - begin + 2 * half < min(0.1, 3 * half):
            continue
        inner = _inner(begin, end, half)
        plateau = _plateau(signals, tare, np.array([inner]), begin - half, end + half)
        if plateau is None:
            continue
        if found and _agree(found[-1], plateau, noise):
            before = found.pop()
            both = np.vstack([before.intervals, plateau.intervals])
            plateau = _plateau(signals, tare, both, before.begin, plateau.end) or plateau
        elif found and _creeps(found[-1], plateau):
            plateau = max(found.pop(), plateau, key=lambda one: one.duration)
        found.append(plateau)
    longest = max((plateau.duration for plateau in found), default=0.0)
    return [plateau for plateau in found if plateau.duration >= min(3 * half, PEAK * longest)]


def _inner(begin: float, end: float, half: float) -> tuple[float, float]:
    """The stretch to average: a settled part without its beginning, which may still creep, and without its end."""
    extra = end - begin - SHORTEST_HOLD / 2
    if extra > 0:
        return begin + 0.25 * extra, end - 0.1 * extra
    more = min(-0.5 * extra, half)
    return begin - more, end + more


def _plateau(signals: Signals, tare: Tare, intervals: Floats, begin: float, end: float) -> Plateau | None:
    joints, force = signals.joints.during(intervals), signals.wrench.during(intervals)
    if len(joints) < 2 or len(force) < 2:
        return None
    angles, load = robust_mean(joints), robust_mean(force)
    return Plateau(intervals, begin, end, angles.mean, load.mean - tare.force, angles.scatter, load.scatter, len(force))


def _creeps(one: Plateau, other: Plateau) -> bool:
    """Whether two plateaus follow each other so closely that the shorter is but the creeping end of the longer."""
    nearly = np.hypot(*(one.force - other.force)) <= CREEP * np.hypot(*one.force)
    return bool(nearly and other.begin - one.end < CREEP_TIME)


def _agree(one: Plateau, other: Plateau, noise: float) -> bool:
    """Whether two plateaus are the same one, disturbed in between."""
    limit = max(SIGMAS * noise / 3.0, SAME_FORCE * float(np.hypot(*one.force)))
    same_force = np.hypot(*(one.force - other.force)) <= limit
    return bool(same_force and np.abs(one.joints - other.joints).max() <= SAME_JOINT)
