"""Touches found in a stream: free motion, contact, settled hold, retraction.

`segmentation` finds the contacts, `zero` what the sensor reads before each, `settling` the
settled parts, `candidates` what speaks against them, `approach` how the joints came to them,
`assignment` the discs. Every
contact without a settled part is one rejected touch; every settled part is one touch,
accepted or rejected. The collector's count (`live`) and the calibration of a
recording run this same code.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.touch import Rejection, TouchSet
from scara_kinetostatic.touches.approach import Arrival, arrival, resolution
from scara_kinetostatic.touches.association import associate
from scara_kinetostatic.touches.holds import Candidate, find_candidates
from scara_kinetostatic.touches.segmentation import find_contacts
from scara_kinetostatic.touches.signals import Floats, Signals, as_signals
from scara_kinetostatic.touches.streams import Streams

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
    tare: Floats
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
        contradiction: where most touches meet no disc but would with another frame or sign of
            the sensor, that; empty otherwise.
    """

    touches: TouchSet
    rejected: tuple[Rejection, ...] = ()
    found: int = 0
    warnings: tuple[str, ...] = ()
    episodes: tuple[Episode, ...] = field(default=(), repr=False)
    start: int = 0
    contradiction: str = ''

    def renumbered(self, first: int) -> Detection:
        """The same with the touches numbered from `first`."""
        return replace(
            self,
            touches=self.touches.replace(index=self.touches.index + first),
            rejected=tuple(replace(item, index=item.index + first) for item in self.rejected),
            episodes=tuple(replace(item, index=item.index + first) for item in self.episodes),
        )


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
    found, faint = find_candidates(signals, contacts)
    candidates, advice = _with_discs(found, cell)
    episodes = tuple(_episode(number, candidate) for number, candidate in enumerate(candidates))
    return Detection(
        touches=_touch_set(signals, candidates, cell),
        rejected=tuple(Rejection(episode.index, episode.reason) for episode in episodes if episode.reason),
        found=len(candidates),
        warnings=(*signals.warnings, *_warnings(contacts.glitches, faint, candidates), *advice),
        episodes=episodes,
        start=signals.start,
        contradiction=advice[0] if advice else '',
    )


def no_touches() -> TouchSet:
    """A set of no touches."""
    none = np.empty((0, 2))
    return TouchSet(none, none, np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))


def _with_discs(candidates: list[Candidate], cell: Cell) -> tuple[list[Candidate], tuple[str, ...]]:
    """The candidates with their discs, those that touch none rejected, and advice."""
    good = [number for number, candidate in enumerate(candidates) if not candidate.reason]
    if not good:
        return candidates, ()
    association = associate(*_means([candidates[number] for number in good], cell), cell)
    hint = f': {association.advice}' if association.advice else ''
    for place, number in enumerate(good):
        disc, miss = int(association.disc[place]), 1e3 * association.miss[place]
        reason = f'touches nothing known: {miss:.0f} mm off the nearest disc, {cell.discs[disc].name!r}{hint}'
        reason = '' if association.known[place] else reason
        side = int(association.posture[place])
        candidates[number] = candidates[number]._replace(disc=disc, posture=side, reason=reason)
    lost = int(np.sum(~association.known))
    return candidates, (f'{lost} of {len(good)} touches meet no disc{hint}',) if hint else ()


def _means(candidates: list[Candidate], cell: Cell) -> tuple[Floats, Floats]:
    """Mean joint angles and force on the object of settled candidates, (n, 2) each."""
    sign = -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    plateaus = [candidate.plateau for candidate in candidates if candidate.plateau is not None]
    return np.array([p.joints for p in plateaus]), sign * np.array([p.force for p in plateaus])


def _touch_set(signals: Signals, candidates: list[Candidate], cell: Cell) -> TouchSet:
    index = [number for number, candidate in enumerate(candidates) if not candidate.reason]
    if not index:
        return no_touches()
    kept = [candidates[number] for number in index]
    joints, force = _means(kept, cell)
    plateaus = [candidate.plateau for candidate in kept if candidate.plateau is not None]
    arrivals = _arrivals(signals, kept, candidates)
    return TouchSet(
        joints=joints,
        force=force,
        disc=np.array([candidate.disc for candidate in kept]),
        posture=np.array([candidate.posture for candidate in kept]),
        time=np.array([0.5 * (p.intervals[0, 0] + p.intervals[-1, 1]) for p in plateaus]),
        index=np.array(index),
        approach=np.array([one.approach for one in arrivals]),
        press=np.array([one.press for one in arrivals]),
        joint_scatter=np.array([p.joint_scatter for p in plateaus]),
        force_scatter=np.array([p.force_scatter for p in plateaus]),
        samples=np.array([p.samples for p in plateaus]),
    )


def _arrivals(signals: Signals, kept: list[Candidate], candidates: list[Candidate]) -> list[Arrival]:
    """How the joints came to each settled candidate."""
    ends = np.unique([candidate.contact[1] for candidate in candidates])
    step = resolution(signals.joints)
    found = []
    for candidate in kept:
        if candidate.plateau is not None:
            contact = candidate.contact[0]
            before = ends[ends <= contact]
            earliest = float(before[-1]) if len(before) else -np.inf
            found.append(arrival(signals.joints, candidate.plateau, contact, earliest, step))
    return found


def _episode(number: int, candidate: Candidate) -> Episode:
    plateau = candidate.plateau
    hold = candidate.contact if plateau is None else (plateau.begin, plateau.end)
    tare = np.full(2, np.nan) if candidate.tare is None else candidate.tare.force
    return Episode(number, candidate.contact, hold, tare, candidate.reason)


def _warnings(glitches: int, faint: int, candidates: list[Candidate]) -> list[str]:
    warnings = []
    if glitches:
        warnings.append(f'{glitches} spikes of the force too short for a touch were passed over')
    if faint:
        warnings.append(f'{faint} faint forces while the arm moved far were not taken for touches')
    zeros = np.array([candidate.tare.force for candidate in candidates if candidate.tare is not None])
    change = float(np.ptp(zeros, axis=0).max()) if len(zeros) else 0.0
    if change > ZERO_CHANGE:
        warnings.append(f"the sensor's zero changes by {change:.1f} N within the recording")
    return warnings
