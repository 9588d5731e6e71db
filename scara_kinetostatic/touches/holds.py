"""The holds of one contact: intervals with the joints at rest and a steady force.

At every wrench sample the mean of either topic over a short window (`Signals.window`) before it is compared with the
mean over the same window after it. Where both agree within the noise, the sample belongs to a hold. A contact may
have several holds (a force raised in steps); each is a touch. Consecutive holds with the same force and joint angles
are one that was disturbed.

A motion that is too slow to be detected does no harm: joint angles and force are averaged over the same interval, and
the contact is in equilibrium throughout.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.signals import Signals, Topic, median, robust_mean, runs, steps_of_mean, white_noise
from scara_kinetostatic.touches.tare import Tare

SHORTEST_HOLD = 0.2
"""A shorter hold is not a touch, s."""
_SIGMAS = 5.0
"""A difference of neighbouring means is a change if it exceeds this many of its standard deviations."""
_STEADY_FORCE = 0.004
"""Difference of neighbouring means of the force up to which it is steady, relative to the force."""
_ROUGH_CONTACT = 0.02
"""White noise of the force in contact is accepted up to this part of the force, where it exceeds that before."""
_LARGEST_SLOW_NOISE = 0.01
"""Slow noise of the force before the contact is accepted up to this part of the force."""
_STEADY_JOINT = 1e-3
"""Speed up to which a joint is at rest, rad/s."""
_HIGHEST_JOINT_NOISE = 1e-4
"""Noise of the joint readings is accepted up to this, rad; more is a motion."""
_FARTHEST_JOINT = 5e-3
"""The tip slides if a joint moves by more than this, rad,"""
_SOFTEST = 3e-4
"""plus this times the change of the force, rad/N: the largest compliance of a joint that is expected."""
_SAME_FORCE = 0.01
"""Two holds are one if their forces differ by less, relative to the force,"""
_SAME_JOINT = 5e-5
"""and their joint angles by less, rad."""
_CREEP = 0.05
"""Two holds whose forces differ by less, relative to the force,"""
_CREEP_TIME = 0.1
"""and that follow each other within this time, s, are one in which the force creeps; the longer is kept."""
_LOADED = 0.5
"""A contact is under load while the force exceeds this part of its largest value."""
_SHORTEST_SEARCHED = 0.1
"""Shorter stretches of steady samples, s, or those of less than three windows, are not considered."""
_BEGIN_OMITTED, _END_OMITTED = 0.25, 0.1
"""Parts of a hold, less half of `SHORTEST_HOLD`, that are not averaged: at its begin the force may still creep."""
_PEAK = 0.5
"""A hold shorter than three windows and than this part of the longest one in its contact is left out: the means on
both sides of a peak of the force agree as well."""


class Hold(NamedTuple):
    """An interval of a contact with the joints at rest and a steady force.

    Attributes:
        intervals: begin and end of the intervals that are averaged, (k, 2), s.
        begin: when it begins, s.
        end: when it ends, s.
        joints: mean angles, (2,), rad.
        force: mean force in the frame and sign of the sensor, the zero subtracted, (2,), N.
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


class HoldSearch(NamedTuple):
    """The holds of a contact, and figures that explain why there is none.

    Attributes:
        holds: those that are long enough, in the order of time.
        longest: duration of the longest hold, long enough or not, s.
        parts: number of holds, long enough or not.
        loaded: time from the first to the last sample with more than half of the largest force, s.
        steady: part of that time with a steady force.
        slides: whether the joints move farther meanwhile than their compliance explains.
    """

    holds: tuple[Hold, ...] = ()
    longest: float = 0.0
    parts: int = 0
    loaded: float = 0.0
    steady: float = 0.0
    slides: bool = False


def find_holds(signals: Signals, tare: Tare, begin: float, end: float) -> HoldSearch:
    """The holds of one contact.

    Args:
        signals: the recording.
        tare: the zero of the contact.
        begin: time of the first sample that is clearly in contact, s.
        end: time of the last sample of the contact, s.
    """
    joints, window = signals.joints, signals.window
    time = signals.filtered.time[signals.filtered.stretch(tare.contact, end)]
    if len(time) < 2:
        return HoldSearch()
    state = _steadiness(signals, tare, time)
    is_hold = state.steady & state.at_rest & (time >= begin)
    found = _holds_of_contact(signals, tare, time, is_hold, window, state.noise)
    shortest = SHORTEST_HOLD - 1.5 * max(joints.period, signals.wrench.period)
    loaded = np.flatnonzero(state.load >= _LOADED * state.load.max())
    span = slice(int(loaded[0]), int(loaded[-1]) + 1)
    under_load = joints.value[joints.stretch(time[span][0], time[span][-1])]
    return HoldSearch(
        holds=tuple(hold for hold in found if hold.duration >= shortest),
        longest=max((hold.duration for hold in found), default=0.0),
        parts=len(found),
        loaded=float(time[span][-1] - time[span][0]),
        steady=float(state.steady[span].mean()),
        slides=_is_sliding(under_load, state.load[span], state.at_rest[span]),
    )


class _Steadiness(NamedTuple):
    """At k times of a contact: force and its white noise, N; whether the force is steady and the joints are at rest."""

    load: Floats
    steady: NDArray[np.bool_]
    at_rest: NDArray[np.bool_]
    noise: float


def _steadiness(signals: Signals, tare: Tare, time: Floats) -> _Steadiness:
    joints, wrench, window = signals.joints, signals.filtered, signals.window
    force_step, load = steps_of_mean(wrench, time, window)
    load = np.hypot(*(load - tare.force).T)
    force = wrench.value[wrench.stretch(time[0], np.nextafter(time[-1], np.inf))]
    noise = max(tare.noise, min(white_noise(force), _ROUGH_CONTACT * float(median(load))))
    slow_noise = min(tare.slow_noise, _LARGEST_SLOW_NOISE * float(load.max()))
    force_limit = max(_SIGMAS * max(_step_std(noise, wrench, window), slow_noise), _resolution(force))
    joint_noise = min(white_noise(joints.value[joints.stretch(time[0], time[-1])]), _HIGHEST_JOINT_NOISE)
    joint_limit = _STEADY_JOINT * window + _SIGMAS * _step_std(joint_noise, joints, window)
    return _Steadiness(
        load=load,
        steady=np.hypot(*force_step.T) <= np.maximum(force_limit, _STEADY_FORCE * load),
        at_rest=np.abs(steps_of_mean(joints, time, window)[0]).max(axis=1) <= joint_limit,
        noise=noise,
    )


def _is_sliding(joints: Floats, load: Floats, at_rest: NDArray[np.bool_]) -> bool:
    """Whether the joints, mostly not at rest, move farther than their compliance explains."""
    if at_rest.mean() > 0.5 or not len(joints):
        return False
    return bool(np.ptp(joints, axis=0).max() > _FARTHEST_JOINT + _SOFTEST * np.ptp(load))


def _resolution(values: Floats) -> float:
    """Resolution of the readings: their smallest change, which is small where they are not rounded."""
    steps = np.abs(np.diff(values, axis=0))
    return float(np.min(steps, where=steps > 0, initial=np.inf)) if steps.any() else 0.0


def _step_std(noise: float, topic: Topic, window: float) -> float:
    """Standard deviation of the difference of neighbouring means of white noise."""
    return noise * float(np.sqrt(2.0 * topic.period / window))


def _holds_of_contact(
    signals: Signals, tare: Tare, time: Floats, is_hold: NDArray[np.bool_], window: float, noise: float
) -> list[Hold]:
    """The holds of any length, each joined to the previous one where both are the same."""
    found: list[Hold] = []
    for first, last in zip(*runs(is_hold), strict=True):
        begin, end = float(time[first]), float(time[last])
        if end - begin + 2 * window < min(_SHORTEST_SEARCHED, 3 * window):
            continue
        inner = _inner(begin, end, window)
        hold = _hold(signals, tare, np.array([inner]), begin - window, end + window)
        if hold is None:
            continue
        if found and _same_hold(found[-1], hold, noise):
            before = found.pop()
            both = np.vstack([before.intervals, hold.intervals])
            hold = _hold(signals, tare, both, before.begin, hold.end) or hold
        elif found and _is_creep(found[-1], hold):
            hold = max(found.pop(), hold, key=lambda one: one.duration)
        found.append(hold)
    longest = max((hold.duration for hold in found), default=0.0)
    return [hold for hold in found if hold.duration >= min(3 * window, _PEAK * longest)]


def _inner(begin: float, end: float, window: float) -> tuple[float, float]:
    """The interval to average, from the first to the last steady sample of a hold: (begin, end), s."""
    extra = end - begin - SHORTEST_HOLD / 2
    if extra > 0:
        return begin + _BEGIN_OMITTED * extra, end - _END_OMITTED * extra
    more = min(-0.5 * extra, window)
    return begin - more, end + more


def _hold(signals: Signals, tare: Tare, intervals: Floats, begin: float, end: float) -> Hold | None:
    joints, force = signals.joints.during(intervals), signals.wrench.during(intervals)
    if len(joints) < 2 or len(force) < 2:
        return None
    angles, load = robust_mean(joints), robust_mean(force)
    return Hold(intervals, begin, end, angles.mean, load.mean - tare.force, angles.scatter, load.scatter, len(force))


def _is_creep(one: Hold, other: Hold) -> bool:
    """Whether two holds of nearly the same force follow each other within `_CREEP_TIME`."""
    nearly = np.hypot(*(one.force - other.force)) <= _CREEP * np.hypot(*one.force)
    return bool(nearly and other.begin - one.end < _CREEP_TIME)


def _same_hold(one: Hold, other: Hold, noise: float) -> bool:
    """Whether two holds have the same force and joint angles."""
    limit = max(_SIGMAS * noise / 3.0, _SAME_FORCE * float(np.hypot(*one.force)))
    same_force = np.hypot(*(one.force - other.force)) <= limit
    return bool(same_force and np.abs(one.joints - other.joints).max() <= _SAME_JOINT)
