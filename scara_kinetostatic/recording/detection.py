"""Touches found in a stream: free motion, contact, settled hold, retraction.

`segmentation` finds the contacts, `zero` what the sensor reads before each,
`settling` the settled parts, `assignment` the discs. Every contact without a settled part is one
rejected touch; every settled part is one touch, accepted or rejected. The collector's
count (`live`) and the calibration of a recording run this same code.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.touch import Rejection, TouchSet
from scara_kinetostatic.recording.assignment import assign
from scara_kinetostatic.recording.segmentation import Contacts, find_contacts
from scara_kinetostatic.recording.settling import SHORTEST_HOLD, Plateau, Settling, settle
from scara_kinetostatic.recording.signals import Floats, Signals, Topic, as_signals
from scara_kinetostatic.recording.streams import Streams
from scara_kinetostatic.recording.zero import SHORTEST_FREE, Zero, zero_before

LARGEST_DRIFT = 0.03
"""Change of the force from the first to the last third of a hold, of the force."""
LARGEST_SLIDE = 3e-4
"""The same of the joint angles, rad."""
LARGEST_SCATTER = 0.1
"""Standard deviation of the force in a hold, of the force."""
BEFORE_CONTACT = 0.05
"""The approach is measured from this long before the contact, s."""
ZERO_CHANGE = 1.0
"""A change of the sensor's zero within a recording that is worth a warning, N."""


@dataclass(frozen=True)
class Episode:
    """Where one touch lies in the recording, used or rejected; times in s since its first stamp.

    Attributes:
        index: number of the touch.
        contact: begin and end of the contact.
        hold: begin and end of the settled part; of the contact where nothing settles.
        zero: what the sensor reads without force, in its frame and sign, (2,), N; NaN where unknown.
        reason: why the touch is rejected; empty if it is not.
    """

    index: int
    contact: tuple[float, float]
    hold: tuple[float, float]
    zero: Floats
    reason: str


@dataclass(frozen=True)
class Detection:
    """The touches of a recording, numbered from 0 in the order of time.

    Attributes:
        touches: the accepted ones.
        rejected: the others, with the reason.
        found: number of both.
        warnings: what is odd about the recording, one sentence each.
        episodes: where each touch lies, accepted or not.
        start: first stamp of the recording, ns.
    """

    touches: TouchSet
    rejected: tuple[Rejection, ...] = ()
    found: int = 0
    warnings: tuple[str, ...] = ()
    episodes: tuple[Episode, ...] = field(default=(), repr=False)
    start: int = 0


class _Candidate(NamedTuple):
    """A contact or a settled part of one, on its way to a touch."""

    contact: tuple[float, float]
    zero: Zero | None
    plateau: Plateau | None
    reason: str
    disc: int = -1
    posture: int = 0


def find_touches(streams: Streams, cell: Cell) -> Detection:
    """All touches of a recording.

    Args:
        streams: joint angles and forces as they came; stamps may be irregular.
        cell: nominal parameters, discs, frame and sign of the sensor.

    Returns:
        Accepted and rejected touches; `found` is 0 where there is no contact at all.
    """
    signals = as_signals(streams, cell)
    if signals is None:
        return Detection(no_touches())
    contacts = find_contacts(signals)
    candidates = _candidates(signals, contacts)
    candidates, advice = _with_discs(candidates, cell)
    episodes = tuple(_episode(number, candidate) for number, candidate in enumerate(candidates))
    return Detection(
        touches=_touch_set(signals, candidates, cell),
        rejected=tuple(Rejection(episode.index, episode.reason) for episode in episodes if episode.reason),
        found=len(candidates),
        warnings=(*signals.warnings, *_warnings(contacts, candidates), *advice),
        episodes=episodes,
        start=signals.start,
    )


def no_touches() -> TouchSet:
    """A set of no touches."""
    none = np.empty((0, 2))
    return TouchSet(none, none, np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))


def _candidates(signals: Signals, contacts: Contacts) -> list[_Candidate]:
    """Every settled part of every contact, and one for each contact without."""
    found = []
    previous = -np.inf
    for begin, end in zip(contacts.begin.tolist(), contacts.end.tolist(), strict=True):
        zero = zero_before(signals.wrench, begin, previous)
        if zero is None:
            free = max(0.0, begin - max(previous, float(signals.wrench.time[0])))
            reason = f'no free motion before it: {free:.2f} s, expected {SHORTEST_FREE} s or more, so no force zero'
            found.append(_Candidate((begin, end), None, None, reason))
        else:
            found += _settled_parts(signals, zero, end)
        previous = end
    return found


def _settled_parts(signals: Signals, zero: Zero, end: float) -> list[_Candidate]:
    settling = settle(signals, zero, end)
    contact = (zero.contact, end)
    if not settling.plateaus:
        reason = _gap(signals, zero.contact, end) or _why_unsettled(settling, end - zero.contact)
        return [_Candidate(contact, zero, None, reason)]
    return [
        _Candidate(contact, zero, plateau, _gap(signals, zero.contact, plateau.end) or _fault(signals, zero, plateau))
        for plateau in settling.plateaus
    ]


def _gap(signals: Signals, begin: float, end: float) -> str:
    """Which topic pauses too long between two times; empty if neither does."""
    for topic in (signals.joints, signals.wrench):
        pause = topic.longest_pause(begin, end)
        if pause > topic.gap_limit:
            return f'straddles a gap of {pause:.2f} s in {topic.name}, expected {topic.gap_limit:.2f} s at most'
    return ''


def _why_unsettled(settling: Settling, duration: float) -> str:
    """Why a contact has no settled part that is long enough."""
    if duration < SHORTEST_HOLD:
        return f'hold too short: the whole contact lasts {duration:.2f} s, expected {SHORTEST_HOLD} s at rest'
    if settling.at_rest < 0.5:
        moving = 100 * (1 - settling.at_rest)
        return f'slides: the joints move during {moving:.0f} % of the contact'
    if settling.parts == 1 and settling.longest > 0.05:
        return f'hold too short: at rest for {settling.longest:.2f} s, expected {SHORTEST_HOLD} s'
    return f'never settles: the force is steady during {100 * settling.steady:.0f} % of the contact only'


def _fault(signals: Signals, zero: Zero, plateau: Plateau) -> str:
    """What is wrong with a settled part; empty if nothing is."""
    joints, force = signals.joints.during(plateau.intervals), signals.wrench.during(plateau.intervals)
    load = float(np.hypot(*plateau.force))
    slide = _drift(joints)
    if slide > LARGEST_SLIDE:
        return f'slides: the joints move by {slide:.1e} rad during the hold'
    drift = _drift(force)
    if drift > max(LARGEST_DRIFT * load, 6.0 * zero.noise / np.sqrt(max(len(force) / 3, 1.0))):
        return f'never settles: the force changes by {drift:.2f} N during the hold'
    scatter = float(force.std(axis=0).max())
    if scatter > max(LARGEST_SCATTER * load, 4.0 * zero.noise):
        return f'never settles: the force scatters by {scatter:.2f} N during the hold'
    if zero.noise > 0 and len(force) > 5 and not np.any(np.diff(force, axis=0)) and _flickers(signals, zero):
        return f'the force reading is frozen or saturated: {len(force)} equal samples'
    return ''


def _drift(values: Floats) -> float:
    """Change from the first to the last third, the larger of both components."""
    third = max(len(values) // 3, 1)
    return float(np.abs(np.median(values[-third:], axis=0) - np.median(values[:third], axis=0)).max())


def _flickers(signals: Signals, zero: Zero) -> bool:
    """Whether the free force before a contact shows more noise than the step of its digits could hide."""
    free = signals.wrench.value[signals.wrench.stretch(zero.contact - 1.0, zero.contact)]
    steps = np.abs(np.diff(free, axis=0))
    return bool(np.all(np.median(steps, axis=0) > 0))


def _with_discs(candidates: list[_Candidate], cell: Cell) -> tuple[list[_Candidate], tuple[str, ...]]:
    """The candidates with their discs, those that touch none rejected, and advice."""
    good = [number for number, candidate in enumerate(candidates) if not candidate.reason]
    if not good:
        return candidates, ()
    assignment = assign(*_means([candidates[number] for number in good], cell), cell)
    hint = f': {assignment.advice}' if assignment.advice else ''
    for place, number in enumerate(good):
        disc, miss = int(assignment.disc[place]), 1e3 * assignment.miss[place]
        reason = f'touches nothing known: {miss:.0f} mm off the nearest disc, {cell.discs[disc].name!r}{hint}'
        reason = '' if assignment.known[place] else reason
        side = int(assignment.posture[place])
        candidates[number] = candidates[number]._replace(disc=disc, posture=side, reason=reason)
    lost = int(np.sum(~assignment.known))
    return candidates, (f'{lost} of {len(good)} touches meet no disc{hint}',) if hint else ()


def _means(candidates: list[_Candidate], cell: Cell) -> tuple[Floats, Floats]:
    """Mean joint angles and force on the object of settled candidates, (n, 2) each."""
    sign = -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    plateaus = [candidate.plateau for candidate in candidates if candidate.plateau is not None]
    return np.array([p.joints for p in plateaus]), sign * np.array([p.force for p in plateaus])


def _touch_set(signals: Signals, candidates: list[_Candidate], cell: Cell) -> TouchSet:
    index = [number for number, candidate in enumerate(candidates) if not candidate.reason]
    if not index:
        return no_touches()
    kept = [candidates[number] for number in index]
    joints, force = _means(kept, cell)
    intervals = [candidate.plateau.intervals for candidate in kept if candidate.plateau is not None]
    before = [signals.joints.at(candidate.contact[0] - BEFORE_CONTACT) for candidate in kept]
    return TouchSet(
        joints=joints,
        force=force,
        disc=np.array([candidate.disc for candidate in kept]),
        posture=np.array([candidate.posture for candidate in kept]),
        time=np.array([0.5 * (stretch[0, 0] + stretch[-1, 1]) for stretch in intervals]),
        index=np.array(index),
        approach=joints - np.array(before),
        joint_scatter=_scatter(signals.joints, intervals),
        force_scatter=_scatter(signals.wrench, intervals),
        samples=np.array([len(signals.wrench.during(stretch)) for stretch in intervals]),
    )


def _scatter(topic: Topic, intervals: list[Floats]) -> Floats:
    return np.array([topic.during(stretch).std(axis=0) for stretch in intervals])


def _episode(number: int, candidate: _Candidate) -> Episode:
    plateau = candidate.plateau
    hold = candidate.contact if plateau is None else (plateau.begin, plateau.end)
    zero = np.full(2, np.nan) if candidate.zero is None else candidate.zero.force
    return Episode(number, candidate.contact, hold, zero, candidate.reason)


def _warnings(contacts: Contacts, candidates: list[_Candidate]) -> list[str]:
    warnings = []
    if contacts.glitches:
        warnings.append(f'{contacts.glitches} spikes of the force too short for a touch were passed over')
    zeros = np.array([candidate.zero.force for candidate in candidates if candidate.zero is not None])
    change = float(np.ptp(zeros, axis=0).max()) if len(zeros) else 0.0
    if change > ZERO_CHANGE:
        warnings.append(f"the sensor's zero changes by {change:.1f} N within the recording")
    return warnings
