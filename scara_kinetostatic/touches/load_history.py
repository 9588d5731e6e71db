"""The load before each hold, reduced to what a joint with memory can remember.

What that is, `model.load_history` says: the nested extremes of its torque. They are few: in a long recording as many as
there are ever smaller loads of alternate sense, counted back from the hold.

The path is that of the whole recording up to the hold: every contact counts, with its preload, partial unloading and
oscillation, whether it is a touch or rejected. Between contacts the load is zero, and so it is where nothing was
recorded, below the force at which a contact begins (`segmentation.CONTACT_FORCE`), and in `weak` contacts, whose force
comes from the acceleration of the arm. The collector records without interruption. A recording starts relaxed: what
the joints remember from before it is not known. At most `MOST_TURNS` moments are kept from contact to contact: beyond,
the latest and thus smallest swings are dropped, which only a play of a half-width below half of them would remember.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.load_history import remembered
from scara_kinetostatic.touches.candidates import TouchCandidate
from scara_kinetostatic.touches.holds import Hold
from scara_kinetostatic.touches.load_path import ContactLoad, LoadPath, Turn, load_paths
from scara_kinetostatic.touches.signals import Signals

MOST_TURNS = 64
"""So many moments are kept from contact to contact."""
_Turns = tuple[Turn, ...]


class LoadMemory(NamedTuple):
    """What the joints remember of the load.

    Attributes:
        stamp: end of the contact after which this holds, ns.
        turns: the nested extremes of either joint's torque, the oldest first; the last is the unloaded state.
    """

    stamp: int = 0
    turns: _Turns = ()


class LoadHistory(NamedTuple):
    """The load before the holds of a recording.

    Attributes:
        before: of each candidate with a hold, by its number: the turns before it.
        memories: after each contact, in the order of time.
    """

    before: dict[int, _Turns]
    memories: tuple[LoadMemory, ...]


def nested_extremes(path: ArrayLike, least: float = 0.0) -> list[int]:
    """The moments of a path that a memory holds at its end, whatever came before it.

    The largest and the smallest value; from the later one on the opposite extreme of the rest; and so on.

    Args:
        path: torques, (k,), k >= 1.
        least: an extreme counts only if the path comes to it and back from it by more than this.

    Returns:
        Positions in the order of time, without those of the values at which the path starts and ends.
    """
    values = np.asarray(path, dtype=float)
    last, back = len(values) - 1, values[::-1]
    high, low = last - int(back.argmax()), last - int(back.argmin())
    found, rising = [min(high, low), max(high, low)], high < low
    while True:
        rest = back[: last + 1 - found[-1]]
        at = last - int(rest.argmax() if rising else rest.argmin())
        if abs(values[at] - values[found[-1]]) <= least:
            break
        found.append(at)
        rising = not rising
    while found and abs(values[found[-1]] - values[-1]) <= least:
        found.pop()
    while found and abs(values[found[0]] - values[0]) <= least:
        found.pop(0)
    return found


def load_history(
    signals: Signals, candidates: Sequence[TouchCandidate], cell: Cell, earlier: LoadMemory | None = None
) -> LoadHistory:
    """The load before every hold of a recording.

    Args:
        signals: the recording.
        candidates: every hold and every contact without one, in the order of time.
        cell: nominal parameters, frame and sign of the sensor.
        earlier: of streams whose beginning was dropped: what the joints remember from then. Contacts that began before
            its stamp are contained in it.
    """
    memory = earlier or LoadMemory()
    before: dict[int, _Turns] = {}
    memories = []
    contacts, numbers = _contacts(candidates)
    for path, held in zip(load_paths(signals, contacts, cell), numbers, strict=True):
        if not len(path.time) or path.start + 1e9 * path.time[0] <= memory.stamp:
            continue
        turns = _ContactTurns(path)
        for number in held:
            before[number] = _before_hold(turns, memory, candidates[number].hold)
        memory = _after_contact(turns, memory)
        memories.append(memory)
    return LoadHistory(before, tuple(memories))


def _contacts(candidates: Sequence[TouchCandidate]) -> tuple[list[ContactLoad], list[list[int]]]:
    """The contacts and the numbers of the candidates with a hold in each.

    A contact without free motion before it has the zero of the previous one, the first ones that of the next.
    """
    tares = [candidate.tare for candidate in candidates if candidate.tare is not None]
    contacts: list[ContactLoad] = []
    numbers: list[list[int]] = []
    for number, candidate in enumerate(candidates):
        if not contacts or candidate.contact != (contacts[-1].begin, contacts[-1].end):
            tare = candidate.tare or (contacts[-1].tare if contacts else tares[0] if tares else None)
            if tare is None:
                continue
            contacts.append(ContactLoad(*candidate.contact, tare, ()))
            numbers.append([])
        if candidate.hold is not None:
            contacts[-1] = contacts[-1]._replace(holds=(*contacts[-1].holds, candidate.hold))
            numbers[-1].append(number)
    return contacts, numbers


def _before_hold(turns: _ContactTurns, memory: LoadMemory, hold: Hold | None) -> _Turns:
    """The turns before a hold that the joints remember in it; those of a disturbance of the hold count."""
    assert hold is not None
    first, end = np.searchsorted(turns.path.time, hold.intervals[-1]).tolist()
    torque = turns.path.torque[first : max(end, first + 1)].mean(axis=0).tolist()
    path = (*memory.turns, *turns.until(first, torque))
    return tuple(path[place] for place in remembered([*(turn.torque for turn in path), torque])[:-1])


def _after_contact(turns: _ContactTurns, memory: LoadMemory) -> LoadMemory:
    """What the joints remember after a contact."""
    unloaded = turns.path.unloaded()
    path = (*memory.turns, *turns.until(len(turns.path.time), unloaded.torque))
    kept = remembered([*(turn.torque for turn in path), unloaded.torque])[:-1]
    return LoadMemory(unloaded.stamp, (*(path[place] for place in kept[: MOST_TURNS - 1]), unloaded))


class _ContactTurns:
    """The turns of the load within a contact; neighbours that differ by no more than the noise are one."""

    def __init__(self, path: LoadPath) -> None:
        self.path = path
        self._ranges: list[tuple[int, int, Turn]] = []

    def until(self, end: int, torques: Sequence[float]) -> _Turns:
        """The turns of either joint's torque from the begin of the contact to a sample, where the torques are these."""
        found: dict[int, Turn] = {}
        for least, torque, column in zip(self.path.least.tolist(), torques, self.path.torque[:end].T, strict=True):
            for at in nested_extremes(np.concatenate([[0.0], column, [torque]]), least):
                turn = self._turn(at - 1)
                found[turn.stamp] = turn
        return tuple(found[stamp] for stamp in sorted(found))

    def _turn(self, at: int) -> Turn:
        for first, end, turn in self._ranges:
            if first <= at < end:
                return turn
        first, end = self.path.neighbours(at)
        turn = self.path.turn(at, first, end)
        self._ranges.append((first, end, turn))
        return turn
