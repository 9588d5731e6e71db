"""The holds of a contact, intervals with the joints at rest and a steady force, and the reasons to reject one.

At every wrench sample the mean of either topic over a short window (`Signals.window`) before it is compared with the
mean over the same window after it. Where both agree within the noise, the sample belongs to a hold. A contact may
have several holds (a force raised in steps); each is a touch. Consecutive holds with the same force and joint angles
are one that was disturbed. Every hold, and every contact without one, is a candidate for a touch.

A motion that is too slow to be detected does no harm: joint angles and force are averaged over the same interval, and
the contact is in equilibrium throughout. Where force or joints change too much over a hold all the same, as in one with
a slow press before it, its steady parts are found by means over longer times.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.quantities import rounded_down
from scara_kinetostatic.touches.contacts import Contacts, Tare, tare_before
from scara_kinetostatic.touches.streams import (
    ALTERNATE,
    Signal,
    Signals,
    Thresholds,
    alternate,
    median,
    robust_mean,
    runs,
    steps_of_mean,
    white_noise,
)


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


class Defect(NamedTuple):
    """Why a hold or contact is no touch: `Rejection.kind`, and the reason in words."""

    kind: str
    reason: str


def find_holds(signals: Signals, tare: Tare, begin: float, end: float) -> tuple[list[Hold], Defect]:
    """The holds of one contact that are long enough, in the order of time, and why there are none where there are none.

    Args:
        signals: the recording.
        tare: the zero of the contact.
        begin: time of the first sample that is clearly in contact, s.
        end: time of the last sample of the contact, s.
    """
    joints, wrench, s = signals.joints, signals.filtered, Thresholds
    time = wrench.time[wrench.stretch(tare.contact, end)]
    if len(time) < 2:
        return [], _too_short(0.0)
    load, noise, changes = _changes(signals, tare, time, signals.window)
    steady, at_rest = changes <= 1.0
    found = _holds_of_contact(signals, tare, time, steady & at_rest & (time >= begin), noise, signals.window)
    shortest = s.shortest_hold - 1.5 * max(joints.period, signals.wrench.period)
    holds = [hold for hold in found if hold.duration >= shortest]
    if holds:
        return holds, _too_short(0.0)
    if alternate(joints.value[joints.stretch(time[0], time[-1])]):
        return [], Defect('scatter', ALTERNATE)
    loaded = np.flatnonzero(load >= s.loaded * load.max())
    span = slice(int(loaded[0]), int(loaded[-1]) + 1)
    lasting, slow = float(time[span][-1] - time[span][0]), max(joints, wrench, key=lambda topic: topic.period)
    samples = len(slow.during(np.array([[time[span][0], np.nextafter(time[span][-1], np.inf)]])))
    if samples < s.samples_of_hold and lasting + 2 * slow.period >= s.shortest_hold:
        how_many = f'{samples} of {s.samples_of_hold} samples needed for a hold in the {lasting:.2f} s under load'
        return [], Defect('sampling', f'{slow.name} is sampled too slowly: {how_many}')
    if lasting < s.shortest_hold:
        return [], _too_short(lasting, 'under load for')
    if len(found) == 1 and found[0].duration > s.brief:
        return [], _too_short(found[0].duration)
    percent, percent_steady = (100 * float(one[span].mean()) for one in (at_rest, steady))
    if percent < percent_steady:
        resting = f'they do during only {int(percent)} % of the contact, as in a slide'
        return [], Defect('unsteady', f'the joints do not rest: {resting}')
    steady_part = f'it is steady during only {int(percent_steady)} % of the contact'
    return [], Defect('unsteady', f'no steady force: {steady_part}')


def _changes(signals: Signals, tare: Tare, time: Floats, window: float) -> tuple[Floats, float, Floats]:
    """Mean force, (k,), N, its noise, N, and how much force and joints change, by what is none, (2, k).

    Args:
        signals: the recording.
        tare: the zero of the contact.
        time: samples of the force in it, (k,), s.
        window: the means before and after each are over so long, s.
    """
    joints, wrench, s = signals.joints, signals.filtered, Thresholds
    force_step, mean = steps_of_mean(wrench, time, window)
    load = np.hypot(*(mean - tare.force).T)
    force = wrench.value[wrench.stretch(time[0], np.nextafter(time[-1], np.inf))]
    noise = max(tare.noise, min(white_noise(force), s.rough_contact * float(median(load))))
    slow_noise = min(tare.slow_noise, s.same_force * float(load.max()))
    changes = np.abs(np.diff(force, axis=0))
    resolution = float(np.min(changes, where=changes > 0, initial=np.inf)) if changes.any() else 0.0
    force_limit = max(s.hold_sigmas * max(_step_std(noise, wrench, window), slow_noise), resolution)
    force_limits = np.maximum(force_limit, s.steady_force * load)
    joint_noise = min(white_noise(joints.value[joints.stretch(time[0], time[-1])]), s.highest_joint_noise)
    joint_limit = s.steady_joint * signals.window + s.hold_sigmas * _step_std(joint_noise, joints, window)
    joint_step = np.abs(steps_of_mean(joints, time, window)[0]).max(axis=1)
    parts = np.hypot(*force_step.T) / force_limits, joint_step / max(joint_limit, signals.resolution)
    return load, noise, np.array(parts)


def _too_short(lasting: float, how: str = 'at rest for') -> Defect:
    expected = f'expected {Thresholds.shortest_hold} s at rest'
    return Defect('short hold', f'hold too short: {how} {rounded_down(lasting)} s, {expected}')


def _step_std(noise: float, topic: Signal, window: float) -> float:
    """Standard deviation of the difference of neighbouring means of white noise."""
    return noise * float(np.sqrt(2.0 * topic.period / window))


def _holds_of_contact(
    signals: Signals, tare: Tare, time: Floats, is_hold: Mask, noise: float, window: float
) -> list[Hold]:
    """The holds of any length, each joined to the previous one where both are the same."""
    found: list[Hold] = []
    for first, last in zip(*runs(is_hold), strict=True):
        begin, end = float(time[first]), float(time[last])
        if end - begin + 2 * window < min(Thresholds.pause, 3 * window):
            continue
        inner = _inner(begin, end, window)
        hold = _hold(signals, tare, np.array([inner]), begin - window, end + window)
        if hold is None:
            continue
        if found and _same_hold(found[-1], hold, noise):
            before = found.pop()
            both = np.vstack([before.intervals, hold.intervals])
            hold = _hold(signals, tare, both, before.begin, hold.end) or hold
        found.append(hold)
    longest = max((hold.duration for hold in found), default=0.0)
    return [hold for hold in found if hold.duration >= min(3 * window, Thresholds.peak * longest)]


def _inner(begin: float, end: float, window: float) -> tuple[float, float]:
    """The interval to average, from the first to the last steady sample of a hold: (begin, end), s."""
    extra = end - begin - Thresholds.shortest_hold / 2
    if extra > 0:
        return begin + 0.25 * extra, end - 0.1 * extra  # at first the force may creep
    more = min(-0.5 * extra, window)
    return begin - more, end + more


def _hold(signals: Signals, tare: Tare, intervals: Floats, begin: float, end: float) -> Hold | None:
    joints, force = signals.joints.during(intervals), signals.wrench.during(intervals)
    if len(joints) < 2 or len(force) < 2:
        return None
    (angles, joint_scatter), (load, force_scatter) = robust_mean(joints), robust_mean(force)
    return Hold(intervals, begin, end, angles, load - tare.force, joint_scatter, force_scatter, len(force))


def _same_hold(one: Hold, other: Hold, noise: float) -> bool:
    """Whether two holds have the same force and joint angles."""
    limit = max(Thresholds.hold_sigmas * noise / 3.0, Thresholds.same_force * float(np.hypot(*one.force)))
    same_force = np.hypot(*(one.force - other.force)) <= limit
    return bool(same_force and np.abs(one.joints - other.joints).max() <= Thresholds.same_joint)


@dataclass(frozen=True)
class Episode:
    """Where one touch lies in the recording, used or rejected; times in s since its first stamp.

    Attributes:
        index: number of the touch.
        contact: begin and end of the contact.
        hold: begin and end of the hold; of the contact where there is none.
        reason: why the touch is rejected; empty if it is not.
        kind: of the reason (`Rejection.kind`).
        tare: the zero of the force before it; None where unknown.
        steady: what is measured in the hold; None where there is none.
    """

    index: int
    contact: tuple[float, float]
    hold: tuple[float, float]
    reason: str = ''
    kind: str = ''
    tare: Tare | None = field(default=None, repr=False, compare=False)
    steady: Hold | None = field(default=None, repr=False, compare=False)

    def rejected(self, defect: Defect | None) -> Episode:
        """The same with its defect, where there is one."""
        return self if defect is None else replace(self, reason=defect.reason, kind=defect.kind)

    @property
    def counts(self) -> bool:
        """Whether it is steady, or its readings are missing or frozen, so that nothing says more."""
        return not self.reason or self.kind in ('gap', 'frozen')


def find_episodes(signals: Signals, contacts: Contacts) -> tuple[list[Episode], int]:
    """Every hold of every contact, and every contact without a hold, in the order of time.

    Contacts without a hold, with far less force than any hold (`Thresholds.weak_force`) and while the joints move far
    (`Thresholds.weak_travel`), are left out: the force comes from the acceleration of the arm.

    Args:
        signals: the recording.
        contacts: its contacts.

    Returns:
        They, and the number of contacts left out.
    """
    found = _all_episodes(signals, contacts)
    holds = [(one, one.steady) for one in found if one.steady is not None]
    loads = [float(np.hypot(*hold.force)) for one, hold in holds if not one.reason]
    held = [one.contact[1] for one, _ in holds]
    weak = contacts.peak < Thresholds.weak_force * min(loads, default=0.0)
    weak &= ~np.isin(contacts.end, held) & (contacts.travel > Thresholds.weak_travel)
    found = _all_episodes(signals, contacts.select(~weak)) if weak.any() else found
    return [replace(one, index=number) for number, one in enumerate(found)], int(weak.sum())


def _all_episodes(signals: Signals, contacts: Contacts) -> list[Episode]:
    found = list[Episode]()
    previous = -np.inf
    for begin, end in zip(contacts.begin.tolist(), contacts.end.tolist(), strict=True):
        tare = tare_before(signals, begin, previous)
        if isinstance(tare, str):
            found.append(Episode(0, (begin, end), (begin, end), tare, 'no tare'))
        else:
            found += _of_contact(signals, tare, begin, end)
        previous = end
    return found


def _of_contact(signals: Signals, tare: Tare, begin: float, end: float) -> list[Episode]:
    """The touches of one contact: its holds, or a single rejected one where all of them are rejected."""
    holds, why = find_holds(signals, tare, begin, end)
    contact = (tare.contact, end)
    if not holds:
        return [Episode(0, contact, contact, tare=tare).rejected(_gap(signals, *contact) or why)]
    parts = [_judged(signals, tare, contact, hold) for hold in holds]
    return [part for part in parts if part.counts] or _steady_parts(signals, tare, parts) or parts[:1]


def _judged(signals: Signals, tare: Tare, contact: tuple[float, float], hold: Hold) -> Episode:
    """A hold with what its readings lack, or what changes slowly."""
    defect = _gap(signals, contact[0], hold.end) or _frozen(signals, tare, hold) or _slow_change(signals, tare, hold)
    return Episode(0, contact, (hold.begin, hold.end), tare=tare, steady=hold).rejected(defect)


def _steady_parts(signals: Signals, tare: Tare, slow: list[Episode]) -> list[Episode]:
    """The steady parts of holds that all change slowly, by means over the longest time that shows some."""
    window = 0.25 * max(part.hold[1] - part.hold[0] for part in slow)
    while window > signals.window:
        found = []
        for whole in slow:
            time = signals.wrench.time[signals.wrench.stretch(whole.hold[0] + window, whole.hold[1] - window)]
            if len(time) < 2:
                continue
            _, noise, changes = _changes(signals, tare, time, window)
            change = changes.max(axis=0)
            if (change > 1.0).any() and np.median(change[change > 1.0]) > Thresholds.clear_change:
                holds = _holds_of_contact(signals, tare, time, change <= 1.0, noise, window)
                lasting = [hold for hold in holds if hold.duration >= Thresholds.shortest_hold]
                found += [_judged(signals, tare, whole.contact, hold) for hold in lasting]
        if good := [part for part in found if part.counts]:
            return good
        window /= 2
    return []


def _gap(signals: Signals, begin: float, end: float) -> Defect | None:
    """The topic with a gap between two times; None if there is none."""
    for topic in (signals.joints, signals.wrench):
        pause, most = topic.longest_pause(begin, end), topic.gap_limit
        if pause > most:
            return Defect('gap', f'gap of {pause:.3f} s in {topic.name}, expected {most:.3f} s at most')
    return None


def _slow_change(signals: Signals, tare: Tare, hold: Hold) -> Defect | None:
    """What changes slowly during a hold; None if nothing does."""
    joints, force = signals.joints.during(hold.intervals), signals.wrench.during(hold.intervals)
    load, noise, s = float(np.hypot(*hold.force)), max(tare.noise, white_noise(force)), Thresholds
    scatter, wide = float(hold.force_scatter.max()), float(hold.joint_scatter.max())
    slide, drift, step = _drift(joints), _drift(force), signals.resolution
    if slide > max(s.largest_slide, 1.5 * step):  # a change by one step is none
        return Defect('slides', f'the tip slides: the joints move by {slide:.1e} rad during the hold')
    if wide > max(s.largest_joint_scatter, step):
        text = f'the joint angles scatter by {wide:.1e} rad during the hold: messages of two robots on one topic?'
        return Defect('scatter', text)
    apart = 2.0 / 3.0 * float(hold.intervals[-1, 1] - hold.intervals[0, 0])
    allowed = load * min(s.largest_drift, s.fastest_drift * apart)
    white = s.sigmas * noise / np.sqrt(max(len(force) / 3, 1.0))
    if drift > max(allowed, white, min(s.sigmas * tare.slow_noise, 2.0 * allowed)):
        return Defect('unsteady', f'no steady force: it changes by {drift:.2f} N during the hold')
    if scatter > max(s.largest_scatter * load, s.scatter_sigmas * tare.noise):
        return Defect('unsteady', f'no steady force: its standard deviation during the hold is {scatter:.2f} N')
    return None


def _frozen(signals: Signals, tare: Tare, hold: Hold) -> Defect | None:
    """Frozen readings during a hold: a component of the force that is noisy before, or both joints; None if there are
    none.

    The readings of joints at rest may be equal to the last bit, but they change while the arm presses.
    """
    force, fewest = signals.wrench.during(hold.intervals), Thresholds.few
    free = signals.wrench.value[signals.wrench.stretch(tare.contact - 1.0, tare.contact)]
    still = ~np.any(np.diff(force, axis=0), axis=0) & (np.mean(np.diff(free, axis=0) != 0, axis=0) > 0.5)
    for axis, name in enumerate('xy'):
        if len(force) > fewest and still[axis]:
            readings = f'{len(force)} samples of f{name} = {force[0, axis]:.6g} N'
            return Defect('frozen', f'the force reading is frozen or saturated: {readings}')
    joints = signals.joints.value[signals.joints.stretch(tare.contact - Thresholds.pause, hold.end)]
    if len(joints) > fewest and not np.any(np.diff(joints, axis=0)):
        readings = f'{len(joints)} samples of {joints[0, 0]:.6g}, {joints[0, 1]:.6g} rad'
        return Defect('frozen', f'the joint readings are frozen: {readings}')
    return None


def _drift(values: Floats) -> float:
    """Difference of the medians of the last and the first third of samples (n, 2), the larger of both components."""
    third = max(len(values) // 3, 1)
    return float(np.abs(median(values[-third:]) - median(values[:third])).max())
