"""Detection of the touches in a recording: free motion, contact, hold, retraction.

In turn: `contacts` (and the force zero before each), `holds` (joints at rest, force steady; reasons to reject one),
`association` (the touched disc), `load_history` (the movement and the load before the hold).
Every hold is one touch, accepted or rejected; every contact without a hold is one rejected touch. The collector's
count (`online`) and the calibration of a recording use this same code.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.touch import Rejection, TouchSet, stacked_histories
from scara_kinetostatic.touches.association import associate
from scara_kinetostatic.touches.contacts import find_contacts
from scara_kinetostatic.touches.holds import TouchCandidate, find_candidates
from scara_kinetostatic.touches.load_history import LoadMemory, approach_of_hold, load_history, resolution
from scara_kinetostatic.touches.signals import Signals, as_signals, runs
from scara_kinetostatic.touches.streams import Streams

DISCARDED = 'discarded while recording'
"""Reason of a touch that was accepted and then discarded."""


@dataclass(frozen=True)
class Episode:
    """Where one touch lies in the recording, used or rejected; times in s since its first stamp.

    Attributes:
        index: number of the touch.
        contact: begin and end of the contact.
        hold: begin and end of the hold; of the contact where there is none.
        tare: the force zero in the frame and sign of the sensor, (2,), N; NaN where unknown.
        reason: why the touch is rejected; empty if it is not.
    """

    index: int
    contact: tuple[float, float]
    hold: tuple[float, float]
    tare: Floats
    reason: str


@dataclass(frozen=True)
class Detection:
    """The touches of a recording, numbered from 0 in the order of time.

    Attributes:
        touches: the accepted ones.
        rejected: the others, with the reason.
        found: number of both.
        warnings: what is unusual in the recording, one sentence each.
        episodes: where each touch lies in the recording, accepted or not.
        start: first stamp of the recording, ns; 0 where unknown. Of several recordings, of the first.
        starts: first stamp of each recording, ns; empty for one.
        first_touches: number of the first touch of each recording.
        turned: how the forces of each recording were turned by their `frame_id`, empty where not; or no entries.
        sequence_known: whether the touches of several recordings are in the order of time.
        contradiction: where most touches meet no disc but would with another frame or sign of the sensor, the wrong
            keys of the cell description, and what contradicts them; None otherwise.
        memories: what the joints remember of the load after each contact, in the order of time.
        elsewhere: touches that are rejected because no object is there, each with the nearest one.
    """

    touches: TouchSet
    rejected: tuple[Rejection, ...] = ()
    found: int = 0
    warnings: tuple[str, ...] = ()
    episodes: tuple[Episode, ...] = field(default=(), repr=False)
    start: int = 0
    starts: tuple[int, ...] = ()
    first_touches: tuple[int, ...] = (0,)
    turned: tuple[str, ...] = ()
    sequence_known: bool = True
    contradiction: tuple[str, str] | None = None
    memories: tuple[LoadMemory, ...] = field(default=(), repr=False)
    elsewhere: TouchSet = field(default_factory=lambda: no_touches(), repr=False)

    @property
    def held(self) -> TouchSet:
        """All touches with a steady force, those that seem to meet no object as well."""
        if not len(self.elsewhere):
            return self.touches
        held = TouchSet.concatenate([self.touches, self.elsewhere])
        return held.select(np.argsort(held.index))

    def part(self, numbers: Sequence[int]) -> Detection:
        """Some of the touches, numbered from 0 in the order given; `found` is their number."""
        place = {number: place for place, number in enumerate(numbers)}

        def numbered(touches: TouchSet) -> TouchSet:
            kept = touches.select(np.isin(touches.index, numbers))
            index = np.array([place[old] for old in kept.index.tolist()], dtype=np.intp)
            return kept.replace(index=index, order=index)

        return replace(
            self,
            touches=numbered(self.touches),
            elsewhere=numbered(self.elsewhere),
            rejected=tuple(replace(item, index=place[item.index]) for item in self.rejected if item.index in place),
            found=len(place),
            episodes=tuple(replace(item, index=place[item.index]) for item in self.episodes if item.index in place),
        )

    def without(self, numbers: Collection[int], reason: str) -> Detection:
        """The same with some of the touches rejected for a reason; one that is rejected already keeps its own."""
        listed = np.fromiter(numbers, dtype=np.intp, count=len(numbers))
        left_out = {int(index) for index in self.held.index if index in numbers}
        left_out |= {item.index for item in self.episodes if item.index in numbers and not item.reason}
        known = {item.index for item in self.rejected}
        added = [Rejection(index, reason) for index in sorted(left_out - known)]
        return replace(
            self,
            touches=self.touches.select(~np.isin(self.touches.index, listed)),
            elsewhere=self.elsewhere.select(~np.isin(self.elsewhere.index, listed)),
            rejected=tuple(sorted((*self.rejected, *added), key=lambda item: item.index)),
            episodes=tuple(
                replace(item, reason=reason) if item.index in left_out - known else item for item in self.episodes
            ),
        )

    def renumbered(self, first: int, recording: int = 0, first_in_time: int | None = None) -> Detection:
        """The same with the touches numbered from `first`, as those of one of several recordings.

        Their order in time starts at `first_in_time`, at `first` where that is not given.
        """
        before = first if first_in_time is None else first_in_time

        def numbered(t: TouchSet) -> TouchSet:
            return t.replace(index=t.index + first, order=t.order + before, recording=np.full(len(t), recording))

        return replace(
            self,
            touches=numbered(self.touches),
            elsewhere=numbered(self.elsewhere),
            rejected=tuple(replace(item, index=item.index + first) for item in self.rejected),
            episodes=tuple(replace(item, index=item.index + first) for item in self.episodes),
        )


def find_touches(streams: Streams, cell: Cell, earlier: LoadMemory | None = None) -> Detection:
    """All touches of a recording.

    Args:
        streams: joint angles and forces as they came; stamps may be irregular.
        cell: nominal parameters, discs, frame and sign of the sensor.
        earlier: of streams whose beginning was dropped: what the joints remember of the load from then.

    Returns:
        Accepted and rejected touches; `found` is 0 where there is no contact at all.
    """
    signals = as_signals(streams, cell)
    if signals is None:
        return Detection(no_touches())
    contacts = find_contacts(signals)
    found, weak = find_candidates(signals, contacts)
    candidates, contradiction = _with_discs(found, cell)
    advice = [': '.join(contradiction)] if contradiction else []
    episodes = tuple(_episode(number, candidate) for number, candidate in enumerate(candidates))
    held, history = _held_touches(signals, candidates, cell), load_history(signals, candidates, cell, earlier)
    known = np.array([not candidates[number].reason for number in held.index.tolist()], dtype=bool)
    touches = held.select(known)
    before = [[turn.state for turn in history.before.get(number, ())] for number in touches.index.tolist()]
    detection = Detection(
        touches=touches.replace(history=stacked_histories(before, touches.joints)),
        rejected=tuple(Rejection(episode.index, episode.reason) for episode in episodes if episode.reason),
        found=len(candidates),
        warnings=(*signals.warnings, *_warnings(contacts.spikes, weak, candidates), *advice),
        episodes=episodes,
        start=signals.start,
        contradiction=contradiction,
        memories=history.memories,
        elsewhere=held.select(~known),
    )
    return _without_discarded(detection, streams.discarded) if streams.discarded else detection


def _without_discarded(detection: Detection, stamps: Sequence[int]) -> Detection:
    """The detection without the touches in whose holds these stamps lie; a warning where there is none."""
    times = [1e-9 * (stamp - detection.start) for stamp in stamps]
    numbers = {e.index for e in detection.episodes if any(e.hold[0] <= time <= e.hold[1] for time in times)}
    lost = sum(not any(e.hold[0] <= time <= e.hold[1] for e in detection.episodes) for time in times)
    warnings = [f'{lost} touches were discarded while recording that are not found in the recording'] if lost else []
    return replace(detection.without(numbers, DISCARDED), warnings=(*detection.warnings, *warnings))


def no_touches() -> TouchSet:
    """A set of no touches."""
    none = np.empty((0, 2))
    return TouchSet(none, none, np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))


def _with_discs(candidates: list[TouchCandidate], cell: Cell) -> tuple[list[TouchCandidate], tuple[str, str] | None]:
    """The candidates with their discs, those that meet none rejected; and `Association.contradiction`."""
    good = [number for number, candidate in enumerate(candidates) if not candidate.reason]
    if not good:
        return candidates, None
    association = associate(*_means([candidates[number] for number in good], cell), cell)
    hint = f': {association.advice}' if association.advice else ''
    for place, number in enumerate(good):
        disc, miss = int(association.disc[place]), 1e3 * association.miss[place]
        reason = f'no object there; the nearest, {cell.discs[disc].name!r}, is {miss:.0f} mm away{hint}'
        reason = '' if association.known[place] else reason
        side = int(association.posture[place])
        candidates[number] = candidates[number]._replace(disc=disc, posture=side, reason=reason)
    return candidates, association.contradiction


def _means(candidates: list[TouchCandidate], cell: Cell) -> tuple[Floats, Floats]:
    """Mean joint angles, rad, and force on the object, N, of candidates with a hold, (n, 2) each."""
    sign = -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    holds = [candidate.hold for candidate in candidates if candidate.hold is not None]
    return np.array([p.joints for p in holds]), sign * np.array([p.force for p in holds])


def _held_touches(signals: Signals, candidates: list[TouchCandidate], cell: Cell) -> TouchSet:
    """The candidates with a steady hold, be there an object or not."""
    index = [number for number, candidate in enumerate(candidates) if candidate.disc >= 0]
    if not index:
        return no_touches()
    kept = [candidates[number] for number in index]
    joints, force = _means(kept, cell)
    ends = np.unique([candidate.contact[1] for candidate in candidates])
    step = resolution(signals.joints)
    holds, approaches = [], []
    for candidate in kept:
        assert candidate.hold is not None
        contact = candidate.contact[0]
        earliest = float(ends[ends <= contact].max(initial=-np.inf))
        holds.append(candidate.hold)
        approaches.append(approach_of_hold(signals.joints, candidate.hold, contact, earliest, step))
    return TouchSet(
        joints=joints,
        force=force,
        disc=np.array([candidate.disc for candidate in kept]),
        posture=np.array([candidate.posture for candidate in kept]),
        time=np.array([0.5 * (p.intervals[0, 0] + p.intervals[-1, 1]) for p in holds]),
        index=np.array(index),
        approach=np.array([one.approach for one in approaches]),
        press=np.array([one.press for one in approaches]),
        joint_scatter=np.array([p.joint_scatter for p in holds]),
        force_scatter=np.array([p.force_scatter for p in holds]),
        samples=np.array([p.samples for p in holds]),
    )


def _episode(number: int, candidate: TouchCandidate) -> Episode:
    hold = candidate.contact if candidate.hold is None else (candidate.hold.begin, candidate.hold.end)
    tare = np.full(2, np.nan) if candidate.tare is None else candidate.tare.force
    return Episode(number, candidate.contact, hold, tare, candidate.reason)


def _warnings(spikes: int, weak: int, candidates: list[TouchCandidate]) -> list[str]:
    warnings = []
    if spikes:
        warnings.append(f'{spikes} spikes of the force are too short for a touch and were ignored')
    if weak:
        warnings.append(f'{weak} weak forces during a motion of the arm are no touches and were ignored')
    zeros = np.array([candidate.tare.force for candidate in candidates if candidate.tare is not None])
    change = float(np.ptp(zeros, axis=0).max()) if len(zeros) else 0.0
    if change > 1.0:
        warnings.append(f'the zero of the force sensor changes by {change:.1f} N within the recording')
    return warnings


UNKNOWN_SEQUENCE = "the recordings' order in time is not known, that of the command is taken"
"""What is said where something shifted and `sequence_of` gives None."""


def sequence_of(parts: Sequence[Detection]) -> Indices | None:
    """Numbers of the recordings in the order of time; None where a start is unknown or two of them overlap."""
    if len(parts) == 1:
        return np.zeros(1, dtype=np.intp)
    begins = np.array([part.start for part in parts], dtype=np.int64)
    lasts = [max((max(one.hold[1], one.contact[1]) for one in part.episodes), default=0.0) for part in parts]
    ends = begins + np.array([int(1e9 * last) for last in lasts], dtype=np.int64)
    order = np.argsort(begins, kind='stable')
    known = bool(np.all(begins > 0) and np.all(ends[order[:-1]] <= begins[order[1:]]))
    return order if known else None


def first_places(parts: Sequence[Detection], sequence: Indices) -> list[int]:
    """Of each recording, how many touches were found in those before it in a sequence."""
    found = np.array([part.found for part in parts], dtype=np.intp)
    first = np.zeros(len(parts), dtype=np.intp)
    first[sequence] = np.cumsum(found[sequence]) - found[sequence]
    return first.tolist()


def offset_touches(streams: Streams, cell: Cell, found: Detection) -> tuple[float, Detection] | None:
    """By how much the wrenches are stamped later than the joint states, s, and the touches without that difference.

    Args:
        streams: of a recording.
        cell: the cell.
        found: the touches as the streams are.

    Returns:
        None where most contacts are touches, or no difference makes most contacts touches.
    """
    signals = as_signals(streams, cell)
    if signals is None or _is_usual(found):
        return None
    tried = [(0.0, found)]
    tried += [(offset, _shifted(streams, cell, offset)) for offset in _offsets(signals)]
    offset, best = max(tried, key=lambda item: len(item[1].touches))
    return (offset, best) if abs(offset) > 0.2 and _is_usual(best) else None


def _is_usual(detection: Detection) -> bool:
    return len(detection.touches) >= 0.7 * detection.found


def _shifted(streams: Streams, cell: Cell, offset: float) -> Detection:
    """The touches with the wrenches stamped earlier by so many s."""
    stamp = streams.wrench.stamp - round(1e9 * offset)
    return find_touches(replace(streams, wrench=replace(streams.wrench, stamp=stamp)), cell)


def _offsets(signals: Signals) -> list[float]:
    """Differences at which the joints move least during the contacts, s: up to eight, half a second or more apart."""
    joints, contacts = signals.joints, find_contacts(signals)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(joints.value, axis=0)).sum(axis=1))])
    offsets = 0.05 * np.arange(-200, 201)
    begin, end = (np.interp(time - offsets[:, None], joints.time, path) for time in (contacts.begin, contacts.end))
    moved = (end - begin).sum(axis=1)
    least = sliding_window_view(np.pad(moved, 10, mode='edge'), 21).min(axis=1)
    lows, ends = runs(moved <= least)
    middles = sorted(zip(lows, ends, strict=True), key=lambda run: moved[run[0]])[:8]
    return [float(offsets[(low + high) // 2]) for low, high in middles]
