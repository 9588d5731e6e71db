"""The settled parts of all contacts, each with what speaks against it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.touches.plateaus import SHORTEST_HOLD, Plateau, PlateauSearch, find_plateaus
from scara_kinetostatic.touches.segmentation import Contacts
from scara_kinetostatic.touches.signals import Floats, Signals, median, white_noise
from scara_kinetostatic.touches.tare import AFTER_CONTACT, SHORTEST_FREE, Tare, tare_before

LARGEST_DRIFT = 0.03
"""Change of the force from the first to the last third of a hold, of the force."""
FASTEST_DRIFT = 0.1
"""The same per second."""
FAINT = 0.5
"""A contact under less force than this part of the lightest settled one,"""
FAR = 0.03
"""in which a joint goes farther than this, rad, is none."""
LARGEST_SLIDE = 3e-4
"""Change of the joint angles from the first to the last third of a hold, rad."""
BEFORE = 0.1
"""From this long before a contact on the joints must have moved, s."""
LARGEST_SCATTER = 0.1
"""Standard deviation of the force in a hold, of the force."""


class Candidate(NamedTuple):
    """A contact or a settled part of one, on its way to a touch."""

    contact: tuple[float, float]
    tare: Tare | None
    plateau: Plateau | None
    reason: str
    disc: int = -1
    posture: int = 0


class Candidates(NamedTuple):
    """All candidates in the order of time, and how many faint contacts were passed over."""

    found: list[Candidate]
    faint: int


def find_candidates(signals: Signals, contacts: Contacts) -> Candidates:
    """Every settled part of every contact, and one for each contact without.

    A contact that does not settle, under far less force than every touch that does and while
    the joints go a long way, is no contact: the arm's acceleration made the sensor deviate.
    """
    found = _all_candidates(signals, contacts)
    loads = [float(np.hypot(*c.plateau.force)) for c in found if c.plateau is not None and not c.reason]
    settled = [c.contact[1] for c in found if c.plateau is not None]
    faint = contacts.peak < FAINT * min(loads, default=0.0)
    faint &= ~np.isin(contacts.end, settled) & (contacts.way > FAR)
    if not faint.any():
        return Candidates(found, 0)
    return Candidates(_all_candidates(signals, contacts.select(~faint)), int(faint.sum()))


def _all_candidates(signals: Signals, contacts: Contacts) -> list[Candidate]:
    found = []
    previous = -np.inf
    for begin, end in zip(contacts.begin.tolist(), contacts.end.tolist(), strict=True):
        tare = tare_before(signals, begin, previous)
        if tare is None:
            free = max(0.0, begin - max(previous + AFTER_CONTACT, float(signals.wrench.time[0])))
            reason = f'no free motion before it: {free:.2f} s, expected {SHORTEST_FREE} s or more, so no force zero'
            found.append(Candidate((begin, end), None, None, reason))
        else:
            found += _settled_parts(signals, tare, begin, end)
        previous = end
    return found


def _settled_parts(signals: Signals, tare: Tare, begin: float, end: float) -> list[Candidate]:
    """The settled parts of one contact; a single rejected candidate where there is none without fault."""
    settling = find_plateaus(signals, tare, begin, end)
    contact = (tare.contact, end)
    parts = []
    for plateau in settling.plateaus:
        spoilt = _gap(signals, tare.contact, plateau.end) or _frozen(signals, tare, plateau)
        parts.append((spoilt, Candidate(contact, tare, plateau, spoilt or _unrest(signals, tare, plateau))))
    if any(not part.reason for _, part in parts):
        return [part for spoilt, part in parts if spoilt or not part.reason]
    if parts:
        return [parts[0][1]]
    reason = _gap(signals, tare.contact, end) or _why_unsettled(settling)
    return [Candidate(contact, tare, None, reason)]


def _gap(signals: Signals, begin: float, end: float) -> str:
    """Which topic pauses too long between two times; empty if neither does."""
    for topic in (signals.joints, signals.wrench):
        pause = topic.longest_pause(begin, end)
        if pause > topic.gap_limit:
            return f'straddles a gap of {pause:.3f} s in {topic.name}, expected {topic.gap_limit:.3f} s at most'
    return ''


def _why_unsettled(settling: PlateauSearch) -> str:
    """Why a contact has no settled part that is long enough."""
    if settling.loaded < SHORTEST_HOLD:
        return f'hold too short: under load for {settling.loaded:.2f} s, expected {SHORTEST_HOLD} s at rest'
    if settling.slides:
        return 'slides: the joints keep moving while in contact'
    if settling.parts == 1 and settling.longest > 0.05:
        return f'hold too short: at rest for {settling.longest:.2f} s, expected {SHORTEST_HOLD} s'
    return f'never settles: the force is steady during {100 * settling.steady:.0f} % of the contact only'


def _unrest(signals: Signals, tare: Tare, plateau: Plateau) -> str:
    """What still changes slowly in a settled part; empty if nothing does."""
    joints, force = signals.joints.during(plateau.intervals), signals.wrench.during(plateau.intervals)
    load, noise = float(np.hypot(*plateau.force)), max(tare.noise, white_noise(force))
    scatter = float(plateau.force_scatter.max())
    slide = _drift(joints)
    if slide > LARGEST_SLIDE:
        return f'slides: the joints move by {slide:.1e} rad during the hold'
    drift = _drift(force)
    apart = 2.0 / 3.0 * float(plateau.intervals[-1, 1] - plateau.intervals[0, 0])
    allowed = load * min(LARGEST_DRIFT, FASTEST_DRIFT * apart)
    if drift > max(allowed, 6.0 * noise / np.sqrt(max(len(force) / 3, 1.0)), min(6.0 * tare.wander, 2.0 * allowed)):
        return f'never settles: the force changes by {drift:.2f} N during the hold'
    if scatter > max(LARGEST_SCATTER * load, 4.0 * tare.noise):
        return f'never settles: the force scatters by {scatter:.2f} N during the hold'
    return ''


def _frozen(signals: Signals, tare: Tare, plateau: Plateau) -> str:
    """Whether a component of the force reads the same all along, though it is noisy elsewhere, or both joints do.

    Joints at rest may read the same to the last bit; joints that press against something do not.
    """
    force = signals.wrench.during(plateau.intervals)
    still = ~np.any(np.diff(force, axis=0), axis=0) & _flickers(signals, tare)
    for axis, name in enumerate('xy'):
        if len(force) > 5 and still[axis]:
            return f'the force reading is frozen or saturated: {len(force)} samples of f{name} = {force[0, axis]:.6g} N'
    joints = signals.joints.value[signals.joints.stretch(tare.contact - BEFORE, plateau.end)]
    if len(joints) > 5 and not np.any(np.diff(joints, axis=0)):
        return f'the joint readings are frozen: {len(joints)} samples of {joints[0, 0]:.6g}, {joints[0, 1]:.6g} rad'
    return ''


def _drift(values: Floats) -> float:
    """Change from the first to the last third, the larger of both components."""
    third = max(len(values) // 3, 1)
    return float(np.abs(median(values[-third:]) - median(values[:third])).max())


def _flickers(signals: Signals, tare: Tare) -> NDArray[np.bool_]:
    """Which components of the free force before a contact change from nearly every sample to the next, (2,)."""
    free = signals.wrench.value[signals.wrench.stretch(tare.contact - 1.0, tare.contact)]
    changing: NDArray[np.bool_] = np.mean(np.diff(free, axis=0) != 0, axis=0) > 0.5
    return changing
