"""How a hold was reached: the movement of the joints before it, and the load that joints remember.

What a joint with memory remembers, `model.touch` says: the nested extremes of its torque. They are few: in a
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
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyfit
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats, Mask, interpolated
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import jacobian
from scara_kinetostatic.model.play_operator import nested_extremes, remembered
from scara_kinetostatic.model.touch import torques_of
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.contacts import Tare
from scara_kinetostatic.touches.holds import Episode, Hold
from scara_kinetostatic.touches.streams import SMOOTHING, Signal, Signals, Thresholds, median_of_three, moving_mean

SMALLEST_REVERSAL = 5e-6
"""A movement back by less than this is not a reversal, rad."""


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


def approach_of_hold(joints: Signal, hold: Hold, contact: float, earliest: float, step: float) -> tuple[Floats, Floats]:
    """The last movement of each joint before a hold, and its part in contact.

    Args:
        joints: the joint angles of the recording.
        hold: the hold.
        contact: begin of the contact, s.
        earliest: end of the previous contact, s, or -inf.
        step: resolution of the encoders, rad.

    Returns:
        Both as by `last_movement`, (2,), rad. The press does not contain the movement while the force was still below
        the noise of the sensor.
    """
    part = joints.stretch(max(earliest, contact - 5.0), float(hold.intervals[0, 0]))
    time, value = joints.time[part], joints.value[part]
    if not len(time):
        return np.zeros(2), np.zeros(2)
    width = 2 * round(0.5 * SMOOTHING / joints.period) + 1
    smooth = moving_mean(median_of_three(value), width)
    scatter = hold.joint_scatter / np.sqrt(width)
    # nor are less than two steps of the encoder, or eight standard deviations, a reversal
    least = np.maximum(max(SMALLEST_REVERSAL, 2.0 * step), 8.0 * scatter)
    touching = int(np.searchsorted(time, contact))
    begin = _free_pose(time, smooth, touching, float(least.max()))
    pressed = moving_mean(median_of_three(value[touching:]), width)
    return last_movement(smooth[begin:], hold.joints, least), last_movement(pressed, hold.joints, least)


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
    rests: Mask = moved <= 1e-3 * (time[later] - time[earlier]) + least
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


class _ContactLoad:
    """The load in one contact at k moments, and its turns; those that differ by no more than the noise are one.

    Args:
        signals: the recording.
        joints: its joint angles without spikes, (n, 2), rad.
        contact: when it begins and ends, s.
        tare: the zero of its force.
        holds: in it.
        cell: nominal parameters, frame and sign of the sensor.

    Attributes:
        time: since the start of the recording, (k,), s.
        torque: of both joints, (k, 2), Nm.
    """

    def __init__(
        self, signals: Signals, joints: Floats, contact: tuple[float, float], tare: Tare, holds: list[Hold], cell: Cell
    ) -> None:
        wrench, half = signals.filtered, round(0.5 * SMOOTHING / signals.filtered.period)
        inside = wrench.stretch(contact[0], np.nextafter(contact[1], np.inf))
        rows = slice(max(inside.start - half, 0), inside.stop + half)
        force = moving_mean(wrench.value[rows] - tare.force, 2 * half + 1)
        force *= cell.sensor.sign.factor
        inner = slice(half, len(force) - half)
        self._start, self.time = signals.start, wrench.time[rows][inner]
        state = np.column_stack([interpolated(self.time, signals.joints.time, joints), force[inner]])
        self.torque = torques_of(cell.nominal, state, cell.sensor.frame)
        self._value = np.hstack([state, self.torque])
        least = self._least_force(tare, holds, 2 * half + 1)
        middle = state[len(state) // 2 : len(state) // 2 + 1, :2]
        self._least = least * np.linalg.norm(jacobian(cell.nominal, middle), axis=1).ravel()
        self._ranges: list[tuple[int, int, Turn]] = []

    def _least_force(self, tare: Tare, holds: Sequence[Hold], width: int) -> float:
        """Change of the smoothed force that noise explains, N.

        The noise is that of the free motion before the contact, or of differences over one length of the moving mean in
        the holds, where that is larger: a slow change of the force has no influence. So is 0.4 % of the largest force.
        """
        noise, force = tare.noise / np.sqrt(width), self._value[:, 2:4]
        for hold in holds:
            first, end = np.searchsorted(self.time, hold.intervals[0])
            if end - first > 2 * width:
                held = force[first:end]
                steps = (held[width:] - held[:-width]).ravel()
                noise = max(noise, np.sqrt(steps @ steps / (2.0 * len(steps))))
        return max(Thresholds.sigmas * float(noise), Thresholds.steady_force * float(np.abs(force).max(initial=0.0)))

    def unloaded(self) -> Turn:
        """The end of the contact: no load."""
        state = (*self._value[-1, :2].tolist(), 0.0, 0.0)
        return Turn(self._start + round(SECOND * float(self.time[-1])) + 1, state, (0.0, 0.0))

    def turns(self, end: int, torques: Sequence[float]) -> _Turns:
        """The turns of either joint's torque from the begin of the contact to a sample, where the torques are these."""
        found: dict[int, Turn] = {}
        for least, torque, column in zip(self._least.tolist(), torques, self.torque[:end].T, strict=True):
            for at in nested_extremes(np.concatenate([[0.0], column, [torque]]), least):
                turn = self._turn(at - 1)
                found[turn.stamp] = turn
        return tuple(found[stamp] for stamp in sorted(found))

    def _turn(self, at: int) -> Turn:
        """The turn at a sample, estimated from those around it that differ from it by no more than the noise."""
        for first, end, turn in self._ranges:
            if first <= at < end:
                return turn
        off = np.flatnonzero((np.abs(self.torque - self.torque[at]) > self._least).any(axis=1))
        first = int(off[off < at].max(initial=-1)) + 1
        end = int(off[off > at].min(initial=len(self.time)))
        # in the middle of samples in even steps, by a parabola; the mean of less than five
        near = self._value[first:end]
        top = near.mean(axis=0) if len(near) < 5 else polyfit(np.linspace(-1.0, 1.0, len(near)), near, 2)[0]
        value = top.tolist()
        stamp = self._start + round(SECOND * float(self.time[at]))
        turn = Turn(stamp, tuple(value[:4]), (value[4], value[5]))
        self._ranges.append((first, end, turn))
        return turn


def load_history(
    signals: Signals, episodes: Sequence[Episode], cell: Cell, earlier: LoadMemory | None = None
) -> tuple[dict[int, _Turns], tuple[LoadMemory, ...]]:
    """The load before every hold of a recording.

    A contact without free motion before it has the zero of the previous one, the first ones that of the next.

    Args:
        signals: the recording.
        episodes: every hold and every contact without one, in the order of time.
        cell: nominal parameters, frame and sign of the sensor.
        earlier: of streams whose beginning was dropped: what the joints remember from then. Contacts that began before
            its stamp are contained in it.

    Returns:
        The turns before each hold, by its number; and the memory after each contact.
    """
    memory, memories = earlier or LoadMemory(), []
    before: dict[int, _Turns] = {}
    joints = median_of_three(signals.joints.value)
    tare = next((one.tare for one in episodes if one.tare is not None), None)
    for contact, group in groupby(enumerate(episodes), key=lambda item: item[1].contact):
        parts = list(group)
        tare = parts[0][1].tare or tare
        if tare is None:
            continue
        holds = {number: part.steady for number, part in parts if part.steady is not None}
        load = _ContactLoad(signals, joints, contact, tare, list(holds.values()), cell)
        if not len(load.time) or signals.start + SECOND * load.time[0] <= memory.stamp:
            continue
        for number, hold in holds.items():  # a disturbance of the hold counts
            first, end = np.searchsorted(load.time, hold.intervals[-1]).tolist()
            torque = load.torque[first : max(end, first + 1)].mean(axis=0).tolist()
            before[number] = _remembered((*memory.turns, *load.turns(first, torque)), torque)
        unloaded = load.unloaded()
        kept = _remembered((*memory.turns, *load.turns(len(load.time), unloaded.torque)), unloaded.torque)
        memory = LoadMemory(unloaded.stamp, (*kept[: MOST_TURNS - 1], unloaded))
        memories.append(memory)
    return before, tuple(memories)


def _remembered(path: _Turns, torque: Sequence[float]) -> _Turns:
    """The turns that the joints remember where the torques are these."""
    places = remembered([*(turn.torque for turn in path), (torque[0], torque[1])])
    return tuple(path[place] for place in places[:-1])
