"""Candidates for touches: every hold and every contact without a hold, with the reason to reject it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.holds import SHORTEST_HOLD, Hold, HoldSearch, find_holds
from scara_kinetostatic.touches.segmentation import Contacts
from scara_kinetostatic.touches.signals import Signals, median, white_noise
from scara_kinetostatic.touches.tare import AFTER_CONTACT, SHORTEST_FREE, Tare, tare_before

_LARGEST_DRIFT = 0.03
"""Accepted change of the force from the first to the last third of a hold, relative to the force,"""
_FASTEST_DRIFT = 0.1
"""and the same per second, 1/s; the smaller one holds,"""
_DRIFT_SIGMAS = 6.0
"""but never less than this many standard deviations of that change by noise."""
_LARGEST_SCATTER = 0.1
"""Accepted standard deviation of the force in a hold, relative to the force,"""
_SCATTER_SIGMAS = 4.0
"""but never less than this many times the noise before the contact."""
_LARGEST_JOINT_SCATTER = 1e-3
"""Accepted standard deviation of a joint angle in a hold, rad: ten times the noise with which a hold is found."""
_LARGEST_SLIDE = 3e-4
"""Accepted change of a joint angle from the first to the last third of a hold, rad."""
_WEAK_FORCE = 0.5
"""A contact without a hold under less force than this part of the smallest force of a hold,"""
_WEAK_TRAVEL = 0.03
"""in which a joint moves by more than this, rad, is not a touch: the force is that of the arm's acceleration."""
_MOTION_BEFORE = 0.1
"""Joint readings that have not changed from this long before a contact on are frozen, s."""
_FEWEST_FROZEN = 5
"""So many equal readings are not yet frozen."""
_SHORTEST_NAMED = 0.05
"""A hold must last for this, s, to be named in the reason."""


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

    Contacts without a hold, with far less force than any hold (`_WEAK_FORCE`) and while the joints move far
    (`_WEAK_TRAVEL`), are left out: the force comes from the acceleration of the arm.

    Args:
        signals: the recording.
        contacts: its contacts.
    """
    found = _all_candidates(signals, contacts)
    loads = [float(np.hypot(*c.hold.force)) for c in found if c.hold is not None and not c.reason]
    held = [c.contact[1] for c in found if c.hold is not None]
    weak = contacts.peak < _WEAK_FORCE * min(loads, default=0.0)
    weak &= ~np.isin(contacts.end, held) & (contacts.travel > _WEAK_TRAVEL)
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
    if search.loaded < SHORTEST_HOLD:
        return f'hold too short: under load for {search.loaded:.2f} s, expected {SHORTEST_HOLD} s at rest'
    if search.slides:
        return 'the tip slides: the joints keep moving during the contact'
    if search.parts == 1 and search.longest > _SHORTEST_NAMED:
        return f'hold too short: at rest for {search.longest:.2f} s, expected {SHORTEST_HOLD} s'
    return f'no steady force: it is steady during only {100 * search.steady:.0f} % of the contact'


def _slow_change(signals: Signals, tare: Tare, hold: Hold) -> str:
    """What changes slowly during a hold, in words; empty if nothing does."""
    joints, force = signals.joints.during(hold.intervals), signals.wrench.during(hold.intervals)
    load, noise = float(np.hypot(*hold.force)), max(tare.noise, white_noise(force))
    scatter = float(hold.force_scatter.max())
    slide = _drift(joints)
    if slide > _LARGEST_SLIDE:
        return f'the tip slides: the joints move by {slide:.1e} rad during the hold'
    wide = float(hold.joint_scatter.max())
    if wide > _LARGEST_JOINT_SCATTER:
        return f'the joint angles scatter by {wide:.1e} rad during the hold: messages of two robots on one topic?'
    drift = _drift(force)
    apart = 2.0 / 3.0 * float(hold.intervals[-1, 1] - hold.intervals[0, 0])
    allowed = load * min(_LARGEST_DRIFT, _FASTEST_DRIFT * apart)
    white = _DRIFT_SIGMAS * noise / np.sqrt(max(len(force) / 3, 1.0))
    slow = min(_DRIFT_SIGMAS * tare.slow_noise, 2.0 * allowed)
    if drift > max(allowed, white, slow):
        return f'no steady force: it changes by {drift:.2f} N during the hold'
    if scatter > max(_LARGEST_SCATTER * load, _SCATTER_SIGMAS * tare.noise):
        return f'no steady force: its standard deviation during the hold is {scatter:.2f} N'
    return ''


def _frozen(signals: Signals, tare: Tare, hold: Hold) -> str:
    """Frozen readings during a hold, in words: a component of the force that is noisy before, or both joints.

    The readings of joints at rest may be equal to the last bit, but they change while the arm presses.
    """
    force = signals.wrench.during(hold.intervals)
    still = ~np.any(np.diff(force, axis=0), axis=0) & _is_noisy(signals, tare)
    for axis, name in enumerate('xy'):
        if len(force) > _FEWEST_FROZEN and still[axis]:
            return f'the force reading is frozen or saturated: {len(force)} samples of f{name} = {force[0, axis]:.6g} N'
    joints = signals.joints.value[signals.joints.stretch(tare.contact - _MOTION_BEFORE, hold.end)]
    if len(joints) > _FEWEST_FROZEN and not np.any(np.diff(joints, axis=0)):
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
