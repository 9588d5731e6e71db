"""The holds of a contact, intervals with the joints at rest and a steady force, and the reasons to reject one.

At every wrench sample the mean of either topic over a short window (`Signals.window`) before it is compared with the
mean over the same window after it. Where both agree within the noise, the sample belongs to a hold. A contact may
have several holds (a force raised in steps); each is a touch. Consecutive holds with the same force and joint angles
are one that was disturbed. Every hold, and every contact without one, is a candidate for a touch.

A motion that is too slow to be detected does no harm: joint angles and force are averaged over the same interval, and
the contact is in equilibrium throughout.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.contacts import AFTER_CONTACT, SHORTEST_FREE, Contacts, Tare, tare_before
from scara_kinetostatic.touches.signals import Signals, Topic, median, robust_mean, runs, steps_of_mean, white_noise

_BEGIN_OMITTED, _END_OMITTED = 0.25, 0.1
"""Parts of a hold, less half of `SETTINGS.shortest_hold`, that are not averaged: at first the force may creep."""


@dataclass(frozen=True)
class HoldSettings:
    """What a hold is, and why one is rejected.

    Attributes:
        shortest_hold: a shorter hold is not a touch, s.
        sigmas: a difference of neighbouring means is a change if it exceeds this many of its standard deviations.
        steady_force: difference of neighbouring means of the force up to which it is steady, relative to the force.
        rough_contact: white noise of the force in contact is accepted up to this part of the force, where it
            exceeds that before.
        largest_slow_noise: slow noise of the force before the contact is accepted up to this part of the force.
        steady_joint: speed up to which a joint is at rest, rad/s.
        highest_joint_noise: noise of the joint readings is accepted up to this, rad; more is a motion.
        farthest_joint: the tip slides if a joint moves by more than this, rad,
        softest: plus this times the change of the force, rad/N: the largest compliance of a joint that is expected.
        same_force: two holds are one if their forces differ by less, relative to the force,
        same_joint: and their joint angles by less, rad.
        creep: two holds whose forces differ by less, relative to the force,
        creep_time: and that follow each other within this time, s, are one in which the force creeps; the longer is
            kept.
        loaded: a contact is under load while the force exceeds this part of its largest value.
        shortest_searched: shorter stretches of steady samples, s, or those of less than three windows, are not
            considered.
        peak: a hold shorter than three windows and than this part of the longest one in its contact is left out:
            the means on both sides of a peak of the force agree as well.
        largest_drift: accepted change of the force from the first to the last third of a hold, relative to the
            force,
        fastest_drift: and the same per second, 1/s; the smaller one holds,
        drift_sigmas: but never less than this many standard deviations of that change by noise.
        largest_scatter: accepted standard deviation of the force in a hold, relative to the force,
        scatter_sigmas: but never less than this many times the noise before the contact.
        largest_joint_scatter: accepted standard deviation of a joint angle in a hold, rad: ten times the noise with
            which a hold is found.
        largest_slide: accepted change of a joint angle from the first to the last third of a hold, rad.
        weak_force: a contact without a hold under less force than this part of the smallest force of a hold,
        weak_travel: in which a joint moves by more than this, rad, is not a touch: the force is that of the arm's
            acceleration.
        motion_before: joint readings that have not changed from this long before a contact on are frozen, s.
        fewest_frozen: so many equal readings are not yet frozen.
        shortest_named: a hold must last for this, s, to be named in the reason.
    """

    shortest_hold: float = 0.2
    sigmas: float = 5.0
    steady_force: float = 0.004
    rough_contact: float = 0.02
    largest_slow_noise: float = 0.01
    steady_joint: float = 1e-3
    highest_joint_noise: float = 1e-4
    farthest_joint: float = 5e-3
    softest: float = 3e-4
    same_force: float = 0.01
    same_joint: float = 5e-5
    creep: float = 0.05
    creep_time: float = 0.1
    loaded: float = 0.5
    shortest_searched: float = 0.1
    peak: float = 0.5
    largest_drift: float = 0.03
    fastest_drift: float = 0.1
    drift_sigmas: float = 6.0
    largest_scatter: float = 0.1
    scatter_sigmas: float = 4.0
    largest_joint_scatter: float = 1e-3
    largest_slide: float = 3e-4
    weak_force: float = 0.5
    weak_travel: float = 0.03
    motion_before: float = 0.1
    fewest_frozen: int = 5
    shortest_named: float = 0.05


SETTINGS = HoldSettings()


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
    shortest = SETTINGS.shortest_hold - 1.5 * max(joints.period, signals.wrench.period)
    loaded = np.flatnonzero(state.load >= SETTINGS.loaded * state.load.max())
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
    noise = max(tare.noise, min(white_noise(force), SETTINGS.rough_contact * float(median(load))))
    slow_noise = min(tare.slow_noise, SETTINGS.largest_slow_noise * float(load.max()))
    force_limit = max(SETTINGS.sigmas * max(_step_std(noise, wrench, window), slow_noise), _resolution(force))
    joint_noise = min(white_noise(joints.value[joints.stretch(time[0], time[-1])]), SETTINGS.highest_joint_noise)
    joint_limit = SETTINGS.steady_joint * window + SETTINGS.sigmas * _step_std(joint_noise, joints, window)
    return _Steadiness(
        load=load,
        steady=np.hypot(*force_step.T) <= np.maximum(force_limit, SETTINGS.steady_force * load),
        at_rest=np.abs(steps_of_mean(joints, time, window)[0]).max(axis=1) <= joint_limit,
        noise=noise,
    )


def _is_sliding(joints: Floats, load: Floats, at_rest: NDArray[np.bool_]) -> bool:
    """Whether the joints, mostly not at rest, move farther than their compliance explains."""
    if at_rest.mean() > 0.5 or not len(joints):
        return False
    return bool(np.ptp(joints, axis=0).max() > SETTINGS.farthest_joint + SETTINGS.softest * np.ptp(load))


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
        if end - begin + 2 * window < min(SETTINGS.shortest_searched, 3 * window):
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
    return [hold for hold in found if hold.duration >= min(3 * window, SETTINGS.peak * longest)]


def _inner(begin: float, end: float, window: float) -> tuple[float, float]:
    """The interval to average, from the first to the last steady sample of a hold: (begin, end), s."""
    extra = end - begin - SETTINGS.shortest_hold / 2
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
    """Whether two holds of nearly the same force follow each other within `SETTINGS.creep_time`."""
    nearly = np.hypot(*(one.force - other.force)) <= SETTINGS.creep * np.hypot(*one.force)
    return bool(nearly and other.begin - one.end < SETTINGS.creep_time)


def _same_hold(one: Hold, other: Hold, noise: float) -> bool:
    """Whether two holds have the same force and joint angles."""
    limit = max(SETTINGS.sigmas * noise / 3.0, SETTINGS.same_force * float(np.hypot(*one.force)))
    same_force = np.hypot(*(one.force - other.force)) <= limit
    return bool(same_force and np.abs(one.joints - other.joints).max() <= SETTINGS.same_joint)


class TouchCandidate(NamedTuple):
    """A hold of a contact, or a contact without one, that may become a touch.

    Attributes:
        contact: begin and end of the contact, s.
        tare: the zero of the force before it; None where unknown.
        hold: the hold; None if there is none.
        reason: why it is rejected; empty if it is not.
        disc: index of the touched disc, -1 until it is known.
        posture: elbow posture, +1 or -1, 0 until it is known.
    """

    contact: tuple[float, float]
    tare: Tare | None
    hold: Hold | None
    reason: str
    disc: int = -1
    posture: int = 0


class TouchCandidates(NamedTuple):
    """All candidates in the order of time, and the number of weak contacts that are not among them."""

    found: list[TouchCandidate]
    weak: int


def find_candidates(signals: Signals, contacts: Contacts) -> TouchCandidates:
    """Every hold of every contact, and every contact without a hold.

    Contacts without a hold, with far less force than any hold (`SETTINGS.weak_force`) and while the joints move far
    (`SETTINGS.weak_travel`), are left out: the force comes from the acceleration of the arm.

    Args:
        signals: the recording.
        contacts: its contacts.
    """
    found = _all_candidates(signals, contacts)
    loads = [float(np.hypot(*c.hold.force)) for c in found if c.hold is not None and not c.reason]
    held = [c.contact[1] for c in found if c.hold is not None]
    weak = contacts.peak < SETTINGS.weak_force * min(loads, default=0.0)
    weak &= ~np.isin(contacts.end, held) & (contacts.travel > SETTINGS.weak_travel)
    if not weak.any():
        return TouchCandidates(found, 0)
    return TouchCandidates(_all_candidates(signals, contacts.select(~weak)), int(weak.sum()))


def _all_candidates(signals: Signals, contacts: Contacts) -> list[TouchCandidate]:
    found = []
    previous = -np.inf
    for begin, end in zip(contacts.begin.tolist(), contacts.end.tolist(), strict=True):
        tare = tare_before(signals, begin, previous)
        if tare is None:
            free = max(0.0, begin - max(previous + AFTER_CONTACT, float(signals.wrench.time[0])))
            reason = f'no free motion before it: {free:.2f} s, expected {SHORTEST_FREE} s or more for the force zero'
            found.append(TouchCandidate((begin, end), None, None, reason))
        else:
            found += _candidates_of_contact(signals, tare, begin, end)
        previous = end
    return found


def _candidates_of_contact(signals: Signals, tare: Tare, begin: float, end: float) -> list[TouchCandidate]:
    """The candidates of one contact: its holds, or a single rejected one where all of them are rejected."""
    search = find_holds(signals, tare, begin, end)
    contact = (tare.contact, end)
    parts = []
    for hold in search.holds:
        defect = _gap(signals, tare.contact, hold.end) or _frozen(signals, tare, hold)
        parts.append((defect, TouchCandidate(contact, tare, hold, defect or _slow_change(signals, tare, hold))))
    if any(not part.reason for _, part in parts):
        return [part for defect, part in parts if defect or not part.reason]
    if parts:
        return [parts[0][1]]
    reason = _gap(signals, tare.contact, end) or _why_no_hold(search)
    return [TouchCandidate(contact, tare, None, reason)]


def _gap(signals: Signals, begin: float, end: float) -> str:
    """The topic with a gap between two times, in words; empty if there is none."""
    for topic in (signals.joints, signals.wrench):
        pause = topic.longest_pause(begin, end)
        if pause > topic.gap_limit:
            return f'gap of {pause:.3f} s in {topic.name}, expected {topic.gap_limit:.3f} s at most'
    return ''


def _why_no_hold(search: HoldSearch) -> str:
    """Why a contact has no hold that is long enough."""
    if search.loaded < SETTINGS.shortest_hold:
        return f'hold too short: under load for {search.loaded:.2f} s, expected {SETTINGS.shortest_hold} s at rest'
    if search.slides:
        return 'the tip slides: the joints keep moving during the contact'
    if search.parts == 1 and search.longest > SETTINGS.shortest_named:
        return f'hold too short: at rest for {search.longest:.2f} s, expected {SETTINGS.shortest_hold} s'
    return f'no steady force: it is steady during only {100 * search.steady:.0f} % of the contact'


def _slow_change(signals: Signals, tare: Tare, hold: Hold) -> str:
    """What changes slowly during a hold, in words; empty if nothing does."""
    joints, force = signals.joints.during(hold.intervals), signals.wrench.during(hold.intervals)
    load, noise = float(np.hypot(*hold.force)), max(tare.noise, white_noise(force))
    scatter = float(hold.force_scatter.max())
    slide = _drift(joints)
    if slide > SETTINGS.largest_slide:
        return f'the tip slides: the joints move by {slide:.1e} rad during the hold'
    wide = float(hold.joint_scatter.max())
    if wide > SETTINGS.largest_joint_scatter:
        return f'the joint angles scatter by {wide:.1e} rad during the hold: messages of two robots on one topic?'
    drift = _drift(force)
    apart = 2.0 / 3.0 * float(hold.intervals[-1, 1] - hold.intervals[0, 0])
    allowed = load * min(SETTINGS.largest_drift, SETTINGS.fastest_drift * apart)
    white = SETTINGS.drift_sigmas * noise / np.sqrt(max(len(force) / 3, 1.0))
    slow = min(SETTINGS.drift_sigmas * tare.slow_noise, 2.0 * allowed)
    if drift > max(allowed, white, slow):
        return f'no steady force: it changes by {drift:.2f} N during the hold'
    if scatter > max(SETTINGS.largest_scatter * load, SETTINGS.scatter_sigmas * tare.noise):
        return f'no steady force: its standard deviation during the hold is {scatter:.2f} N'
    return ''


def _frozen(signals: Signals, tare: Tare, hold: Hold) -> str:
    """Frozen readings during a hold, in words: a component of the force that is noisy before, or both joints.

    The readings of joints at rest may be equal to the last bit, but they change while the arm presses.
    """
    force = signals.wrench.during(hold.intervals)
    still = ~np.any(np.diff(force, axis=0), axis=0) & _is_noisy(signals, tare)
    for axis, name in enumerate('xy'):
        if len(force) > SETTINGS.fewest_frozen and still[axis]:
            return f'the force reading is frozen or saturated: {len(force)} samples of f{name} = {force[0, axis]:.6g} N'
    joints = signals.joints.value[signals.joints.stretch(tare.contact - SETTINGS.motion_before, hold.end)]
    if len(joints) > SETTINGS.fewest_frozen and not np.any(np.diff(joints, axis=0)):
        return f'the joint readings are frozen: {len(joints)} samples of {joints[0, 0]:.6g}, {joints[0, 1]:.6g} rad'
    return ''


def _drift(values: Floats) -> float:
    """Difference of the medians of the last and the first third of samples (n, 2), the larger of both components."""
    third = max(len(values) // 3, 1)
    return float(np.abs(median(values[-third:]) - median(values[:third])).max())


def _is_noisy(signals: Signals, tare: Tare) -> NDArray[np.bool_]:
    """Whether most readings of the force in free motion differ from the previous one, for each component, (2,)."""
    free = signals.wrench.value[signals.wrench.stretch(tare.contact - 1.0, tare.contact)]
    changing: NDArray[np.bool_] = np.mean(np.diff(free, axis=0) != 0, axis=0) > 0.5
    return changing
