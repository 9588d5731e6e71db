"""How a hold was reached: the movement of the joints before it (`Approach`), and the load that joints remember.

What a joint with memory remembers, `model.load_history` says: the nested extremes of its torque. They are few: in a
long recording as many as there are ever smaller loads of alternate sense, counted back from the hold.

The path is that of the whole recording up to the hold: every contact counts, with its preload, partial unloading and
oscillation, whether it is a touch or rejected. Between contacts the load is zero, and so it is where nothing was
recorded, below the force at which a contact begins (`contacts.CONTACT_FORCE`), and in `weak` contacts, whose force
comes from the acceleration of the arm. The collector records without interruption. A recording starts relaxed: what
the joints remember from before it is not known. At most `MOST_TURNS` moments are kept from contact to contact: beyond,
the latest and thus smallest swings are dropped, which only a play of a half-width below half of them would remember.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.kinematics import jacobian
from scara_kinetostatic.model.load_history import remembered, torques_of
from scara_kinetostatic.touches.contacts import Tare
from scara_kinetostatic.touches.holds import Hold, TouchCandidate
from scara_kinetostatic.touches.signals import SMOOTHING, Signals, Topic, median_of_three, moving_mean

SMALLEST_REVERSAL = 5e-6
"""A movement back by less than this is not a reversal, rad,"""


class Approach(NamedTuple):
    """The last movement of the joints before a hold.

    Attributes:
        approach: last movement of each joint, (2,), rad.
        press: the part of it in contact, (2,), rad.
    """

    approach: Floats
    press: Floats


def last_movement(path: ArrayLike, hold: ArrayLike, least: ArrayLike = SMALLEST_REVERSAL) -> Floats:
    """Movement of each joint from its last reversal to the hold.

    Args:
        path: joint angles from the free pose on, in the order of time, (k, ..., 2), rad.
        hold: joint angles of the hold, (..., 2), rad.
        least: smallest movement back that is a reversal, rad.

    Returns:
        (..., 2), rad; positive where the angle grew, 0 where a joint moves by less than `least`.
    """
    offset = (np.asarray(hold) - np.asarray(path))[::-1]
    left = np.abs(offset) > least
    first = np.take_along_axis(offset, left.argmax(axis=0)[None], axis=0)[0]
    sense = np.where(left.any(axis=0), np.sign(first), 0.0)
    offset = np.where(np.maximum.accumulate(left, axis=0), sense * offset, 0.0)
    turned = np.maximum.accumulate(offset, axis=0) - offset > least
    return np.asarray(sense * np.where(np.maximum.accumulate(turned, axis=0), 0.0, offset).max(axis=0))


def resolution(joints: Topic) -> float:
    """Resolution of the encoders, the coarser of both, rad; near 0 where the readings are not rounded."""
    gaps = [np.diff(np.unique(np.round(column, 12))) for column in joints.value.T]
    return max((float(gap.min()) for gap in gaps if len(gap)), default=0.0)


def approach_of_hold(joints: Topic, hold: Hold, contact: float, earliest: float, step: float) -> Approach:
    """The last movement of each joint before a hold, and its part in contact.

    Args:
        joints: the joint angles of the recording.
        hold: the hold.
        contact: begin of the contact, s.
        earliest: end of the previous contact, s, or -inf.
        step: resolution of the encoders, rad.

    Returns:
        Both as by `last_movement`. The press does not contain the movement while the force was still below the noise
        of the sensor.
    """
    part = joints.stretch(max(earliest, contact - 5.0), float(hold.intervals[0, 0]))
    time, value = joints.time[part], joints.value[part]
    if not len(time):
        return Approach(np.zeros(2), np.zeros(2))
    width = 2 * round(0.5 * SMOOTHING / joints.period) + 1
    smooth = moving_mean(median_of_three(value), width)
    scatter = hold.joint_scatter / np.sqrt(width)
    # nor are less than two steps of the encoder, or eight standard deviations, a reversal
    least = np.maximum(max(SMALLEST_REVERSAL, 2.0 * step), 8.0 * scatter)
    touching = int(np.searchsorted(time, contact))
    begin = _free_pose(time, smooth, touching, float(least.max()))
    pressed = moving_mean(median_of_three(value[touching:]), width)
    return Approach(last_movement(smooth[begin:], hold.joints, least), last_movement(pressed, hold.joints, least))


def _free_pose(time: Floats, value: Floats, contact: int, least: float) -> int:
    """Index of the last sample before the contact at which the arm rests in a free pose; 0 if there is none.

    It rests if for 0.04 s no joint moves faster than 1 mrad/s; the pose is free if a joint is 2 mrad off its angle at
    the contact.
    """
    time, value = time[: contact + 1], value[: contact + 1]
    later = np.searchsorted(time, time + 0.04)
    earlier = np.flatnonzero(later < len(time))
    later = later[earlier]
    moved = np.abs(value[later] - value[earlier]).max(axis=1)
    rests: NDArray[np.bool_] = moved <= 1e-3 * (time[later] - time[earlier]) + least
    clear = np.abs(value[later] - value[-1]).max(axis=1) > max(2e-3, least)
    free = later[rests & clear]
    return int(free[-1]) if len(free) else 0


class Turn(NamedTuple):
    """A moment at which the load turned.

    Attributes:
        stamp: when, ns.
        state: q1, q2, rad, and fx, fy on the object in the frame of the sensor, N.
        torque: of both joints by the nominal parameters, Nm.
    """

    stamp: int
    state: tuple[float, ...]
    torque: tuple[float, float]


class ContactLoad(NamedTuple):
    """A contact whose load is wanted: when it begins and ends, s, the zero of its force, and its holds."""

    begin: float
    end: float
    tare: Tare
    holds: tuple[Hold, ...]


class LoadPath(NamedTuple):
    """The load in one contact at k moments.

    Attributes:
        time: since the start of the recording, (k,), s.
        value: q1, q2, rad, fx, fy on the object in the frame of the sensor, N, and both torques, Nm, (k, 6).
        least: change of the torques that the noise explains, (2,), Nm.
        start: first stamp of the recording, ns.
    """

    time: Floats
    value: Floats
    least: Floats
    start: int

    @property
    def torque(self) -> Floats:
        """Torques of both joints, (k, 2), Nm."""
        return self.value[:, 4:]

    def neighbours(self, at: int) -> tuple[int, int]:
        """The samples around one that differ from it by no more than the noise: the first, the one after the last."""
        off = (np.abs(self.torque - self.torque[at]) > self.least).any(axis=1)
        before, after = np.flatnonzero(off[:at]), np.flatnonzero(off[at:])
        return int(before[-1]) + 1 if len(before) else 0, at + int(after[0]) if len(after) else len(off)

    def turn(self, at: int, first: int, end: int) -> Turn:
        """The turn at a sample, estimated from those of a range around it."""
        value = _top(self.value[first:end]).tolist()
        return Turn(self.start + round(1e9 * float(self.time[at])), tuple(value[:4]), (value[4], value[5]))

    def unloaded(self) -> Turn:
        """The end of the contact: no load."""
        joints = self.value[-1, :2].tolist() if len(self.value) else [0.0, 0.0]
        return Turn(self.start + round(1e9 * float(self.time[-1])) + 1, (*joints, 0.0, 0.0), (0.0, 0.0))


def load_paths(signals: Signals, contacts: list[ContactLoad], cell: Cell) -> list[LoadPath]:
    """The loads of contacts.

    Args:
        signals: the recording.
        contacts: the contacts in the order of time.
        cell: nominal parameters, frame and sign of the sensor.
    """
    if not contacts:
        return []
    wrench = signals.filtered
    half = round(0.5 * SMOOTHING / wrench.period)
    bounds = np.searchsorted(wrench.time, [(contact.begin, np.nextafter(contact.end, np.inf)) for contact in contacts])
    bounds = np.clip(bounds + np.array([-half, half]), 0, len(wrench.time))
    sizes = bounds[:, 1] - bounds[:, 0]
    rows = np.concatenate([np.arange(first, end) for first, end in bounds])
    stops = np.cumsum(sizes)
    zero = np.repeat([contact.tare.force for contact in contacts], sizes, axis=0)
    time, force = wrench.time[rows], moving_mean(wrench.value[rows] - zero, 2 * half + 1)
    force *= -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    angles = median_of_three(signals.joints.value)
    joints = np.column_stack([np.interp(time, signals.joints.time, column) for column in angles.T])
    state = np.hstack([joints, force])
    value = np.hstack([state, torques_of(cell.nominal, state, cell.sensor.frame)])
    levers = np.linalg.norm(jacobian(cell.nominal, joints[stops - (sizes + 1) // 2]), axis=1)
    paths = []
    for contact, begin, stop, lever in zip(contacts, stops - sizes, stops, levers, strict=True):
        inner = slice(begin + half, stop - half)
        least = _least_turn(contact, time[inner], force[inner], 2 * half + 1) * lever
        paths.append(LoadPath(time[inner], value[inner], least, signals.start))
    return paths


def _least_turn(contact: ContactLoad, time: Floats, force: Floats, width: int) -> float:
    """Change of the smoothed force that noise explains, N.

    The noise is that of the free motion before the contact, or of differences over one length of the moving mean in the
    holds, where that is larger: a slow change of the force has no influence. So is 0.4 % of the largest force.
    """
    noise = contact.tare.noise / np.sqrt(width)
    for hold in contact.holds:
        first, end = np.searchsorted(time, hold.intervals[0])
        if end - first > 2 * width:
            held = force[first:end]
            steps = (held[width:] - held[:-width]).ravel()
            noise = max(noise, np.sqrt(steps @ steps / (2.0 * len(steps))))
    return max(6.0 * float(noise), 0.004 * float(np.abs(force).max(initial=0.0)))


def _top(values: Floats) -> Floats:
    """Value in the middle of samples (n, m) in even steps, by a parabola; the mean of less than five, (m,)."""
    n = len(values)
    return np.asarray(values.mean(axis=0) if n < 5 else _weights(n) @ values)


@lru_cache(maxsize=256)
def _weights(n: int) -> Floats:
    """Weights by which n samples in even steps give the value in their middle of a parabola fitted to them, (n,)."""
    square = np.linspace(-1.0, 1.0, n) ** 2
    second, fourth = square.sum(), square @ square
    return np.asarray((fourth - second * square) / (n * fourth - second**2))


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
