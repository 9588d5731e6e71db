"""Detection of the touches in a recording: free motion, contact, hold, retraction.

In turn: `contacts` (and the force zero before each), `holds` (joints at rest, force steady; reasons to reject one),
association (the touched disc), `load_history` (the movement and the load before the hold).
Every hold is one touch, accepted or rejected; every contact without a hold is one rejected touch. The collector's
count (`online`) and the calibration of a recording use this same code. `touches_of_table` gives the touches of a table.

**Association**: the disc that a touch belongs to and the elbow posture, by the nominal model.

A frictionless force F on disc d puts the tip at c_d - r_d F/|F|. The nominal tip
H(L_n, Q) misses that place by

    m_d = H(L_n, Q) - (c_d - r_d F/|F|).

The disc with the smallest |m_d| is the touched one. The nominal geometry may be wrong by 20 mm and 3°, so that misses
of some centimetres are usual. Where there are enough touches, the model is first fitted to them, coarsely and robustly
(`assessment.mistakes`); the remaining misses distinguish a known disc from an unknown object.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.mistakes import coarse_parameters
from scara_kinetostatic.errors import InputError, RecordingError
from scara_kinetostatic.files.tables import TouchTable, is_touch_table, load_touch_table
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import forward, posture, quarter_turn
from scara_kinetostatic.model.outline import PER_ANGLE
from scara_kinetostatic.model.parameters import MILLI, NANO, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet, order_of_time, stacked_histories
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.contacts import CONTACT_FORCE, TurningZero, find_contacts, find_turning_zero
from scara_kinetostatic.touches.holds import Episode as Episode
from scara_kinetostatic.touches.holds import find_episodes
from scara_kinetostatic.touches.load_history import LoadMemory, approach_of_hold, load_history
from scara_kinetostatic.touches.streams import NAMES, Signals, Streams, Thresholds, as_signals


class Association(NamedTuple):
    """Discs and postures of n touches.

    Attributes:
        disc: index of the nearest disc, (n,).
        posture: +1 or -1, (n,).
        miss: |m| of that disc, less what an oblique force explains (`largest_friction_angle`), (n,), m.
        known: whether the touch belongs to the disc, (n,).
        both: whether it is in an inner corner, into which the tip does not reach, (n,).
    """

    disc: Indices
    posture: Indices
    miss: Floats
    known: Mask
    both: Mask

    def reason(self, number: int, cell: Cell) -> str:
        """Why a touch that is not known is rejected."""
        nearest = cell.discs[int(self.disc[number])].name
        if self.both[number]:
            return f'in an inner corner of {nearest!r} the tip touches both edges: touch it farther from the corner'
        return f'no object there; the nearest, {nearest!r}, is {self.miss[number] / MILLI:.0f} mm away'


def associate(joints: Floats, force: Floats, cell: Cell) -> Association:
    """Discs and postures of n touches.

    Args:
        joints: Q, (n, 2), rad.
        force: F on the object, in the frame of the sensor, (n, 2), N.
        cell: nominal parameters, discs, frame of the sensor.
    """
    fitted, used = coarse_parameters(joints, force, cell), cell.nominal
    disc, miss = _nearest_disc(cell.nominal, joints, force, cell)
    known = miss <= Thresholds.largest_miss_nominal
    fitted_disc, fitted_miss = _nearest_disc(fitted, joints, force, cell)
    close = fitted_miss <= Thresholds.largest_miss_fitted
    if np.sum(close) >= max(Thresholds.fewest_for_fit, len(joints) / 2):
        disc, miss, used = fitted_disc, fitted_miss, fitted
        known = miss <= max(Thresholds.largest_miss_fitted, Thresholds.sigmas * float(np.median(miss)))
    both = cell.surfaces.touch_both(forward(used, joints), Thresholds.inner_corner)
    return Association(disc, posture(cell.nominal, joints), miss, known, both)


def _nearest_disc(parameters: Parameters, joints: Floats, force: Floats, cell: Cell) -> tuple[Indices, Floats]:
    """The disc with the smallest miss, (n,), and that miss less what an oblique force explains, (n,), m."""
    force, tip = cell.sensor.frame.to_base(force, joints, parameters), forward(parameters, joints)
    unit = force / np.maximum(np.linalg.norm(force, axis=1), 1e-300)[:, None]
    if cell.has_outlines:
        misses = cell.surfaces.misses(tip, unit, PER_ANGLE)
    else:
        misses = tip[:, None] - (cell.centers[None] - cell.radii[None, :, None] * unit[:, None])
    surface = np.argmin(np.linalg.norm(misses, axis=2), axis=1)
    miss = misses[np.arange(len(surface)), surface]
    radial = np.sum(miss * unit, axis=1)
    tangential = np.abs(np.sum(miss * quarter_turn(unit), axis=1))
    lever = np.where(cell.surfaces.halves < np.pi, PER_ANGLE, cell.surfaces.radii)[surface]
    miss = np.hypot(radial, np.maximum(tangential - Thresholds.largest_friction_angle * lever, 0.0))
    return cell.surfaces.object[surface], miss


DISCARDED = 'discarded while recording'
"""Reason of a touch that was accepted and then discarded."""


@dataclass(frozen=True)
class Detection:
    """The touches of a recording, numbered from 0 in the order of time.

    Attributes:
        held: all touches with a steady force, those that seem to meet no object as well.
        episodes: where each touch lies in the recording, accepted or not, and why not.
        warnings: what is unusual in the recording, one sentence each.
        start: first stamp of the recording, ns; 0 where unknown. Of several recordings, of the first.
        memories: what the joints remember of the load after each contact, in the order of time.
        starts: first stamp of each recording, ns; empty for one.
        first_touches: number of the first touch of each recording.
        turned: how the forces of each recording were turned by their `frame_id`, empty where not; or no entries.
        turning: what turns with link 2 in the readings of the sensor, of one recording.
        sequence_known: whether the touches of several recordings are in the order of time.
    """

    held: TouchSet
    episodes: tuple[Episode, ...] = field(default=(), repr=False)
    warnings: tuple[str, ...] = ()
    start: int = 0
    memories: tuple[LoadMemory, ...] = field(default=(), repr=False)
    starts: tuple[int, ...] = ()
    first_touches: tuple[int, ...] = (0,)
    turned: tuple[str, ...] = ()
    turning: TurningZero = TurningZero()  # noqa: RUF009 - immutable
    sequence_known: bool = True

    @classmethod
    def of(cls, touches: TouchSet, rejected: Sequence[Rejection] = ()) -> Detection:
        """Touches that come from elsewhere, and others that are rejected."""
        unknown = (np.nan, np.nan)
        rows = zip(touches.index.tolist(), touches.time.tolist(), strict=True)
        episodes = [Episode(index, (time, time), (time, time)) for index, time in rows]
        episodes += [Episode(r.index, unknown, unknown, r.reason, r.kind) for r in rejected]
        return cls(touches, tuple(sorted(episodes, key=lambda episode: episode.index)))

    @property
    def found(self) -> int:
        """Number of touches, accepted or rejected."""
        return len(self.episodes)

    @cached_property
    def touches(self) -> TouchSet:
        """The accepted ones."""
        return self.held.select(~np.isin(self.held.index, [item.index for item in self.rejected]))

    @cached_property
    def rejected(self) -> tuple[Rejection, ...]:
        """The others, with the reason."""
        return tuple(Rejection(one.index, one.reason, one.kind) for one in self.episodes if one.reason)

    def without(self, numbers: Collection[int], reason: str) -> Detection:
        """The same with some of the touches rejected for a reason; one that is rejected already keeps its own."""
        return replace(
            self,
            held=self.held.select(~np.isin(self.held.index, list(numbers))),
            episodes=tuple(
                replace(one, reason=reason, kind='request') if one.index in numbers and not one.reason else one
                for one in self.episodes
            ),
        )

    def renumbered(
        self, numbers: Sequence[int], first: int, in_time: int | None = None, recording: int = 0
    ) -> Detection:
        """Some of the touches, numbered from `first` in the order given, as those of one of several recordings.

        Args:
            numbers: which.
            first: number of the first of them.
            in_time: how many touches were before in time; None: `first`.
            recording: number of the recording.
        """
        place = {number: place for place, number in enumerate(numbers)}
        kept = self.held.select(np.isin(self.held.index, list(place)))
        index = np.array([place[number] for number in kept.index.tolist()], dtype=np.intp)
        order = kept.order - kept.index + index + (first if in_time is None else in_time)
        return replace(
            self,
            held=kept.replace(index=index + first, order=order, recording=np.full(len(index), recording)),
            episodes=tuple(replace(one, index=first + place[one.index]) for one in self.episodes if one.index in place),
        )


def find_touches(
    streams: Streams, cell: Cell, earlier: LoadMemory | None = None, known: TurningZero | None = None
) -> Detection:
    """All touches of a recording.

    Args:
        streams: joint angles and forces as they came; stamps may be irregular.
        cell: nominal parameters, discs, frame and sign of the sensor.
        earlier: of streams whose beginning was dropped: what the joints remember of the load from then.
        known: what was found earlier to turn with link 2 in the readings of the sensor.

    Returns:
        Accepted and rejected touches; `found` is 0 where there is no contact at all.

    Raises:
        RecordingError: no touch has a force along one of the axes in the plane, which fz has.
    """
    signals = as_signals(streams, cell)
    if signals is None:
        return Detection(no_touches())
    turning = min(known or TurningZero(), find_turning_zero(signals, cell), key=lambda found: found.std)
    signals = turning.out_of(signals, cell)
    contacts = find_contacts(signals)
    episodes, weak = find_episodes(signals, contacts)
    _reject_moved_joints(episodes, streams, signals.start, cell)
    held = _held_touches(signals, episodes, cell)
    _check_axes(streams, held, cell)
    before, memories = load_history(signals, episodes, cell, earlier)
    states = [[] if episodes[k].reason else [turn.state for turn in before.get(k, ())] for k in held.index.tolist()]
    detection = Detection(
        held.replace(history=stacked_histories(states, held.joints)),
        tuple(episodes),
        warnings=(*signals.warnings, *turning.remarks(cell), *_warnings(contacts.spikes, weak, episodes)),
        start=signals.start,
        memories=memories,
        turning=turning,
    )
    return _without_discarded(detection, streams.discarded) if streams.discarded else detection


def _check_axes(streams: Streams, held: TouchSet, cell: Cell) -> None:
    """Check that the axes in the plane, fx and fy, carry the force of contact.

    An axis does if its range is at least 0.3 of the largest, and does not where its range and all touches are below a
    tenth of that of fz.

    Raises:
        RecordingError: fz does, and one of them does not, in any touch.
    """
    if streams.force_ranges is None:
        return
    *plane, z = np.maximum(streams.force_ranges, [*np.abs(held.force).max(axis=0, initial=0.0), 0.0]).tolist()
    idle = [name for name, one in zip(('fx', 'fy'), plane, strict=True) if one < 0.1 * z]
    if idle and z > max(2 * CONTACT_FORCE, 0.3 * max(plane)):
        topic, carry = (streams.topics or cell.sensor.topics)[1], [n for n in ('fx', 'fy', 'fz') if n not in idle]
        problem = f'{topic} has the force of contact in {" and ".join(carry)}, none in {" and ".join(idle)}'
        where = f'record how it is mounted in {NAMES[cell.sensor.frame][0]} on /tf_static'
        remedy = f'{where}, state sensor.axes, or have the driver turn the forces'
        raise RecordingError(streams.source, f'{problem}: the sensor lies on its side', remedy)


def _reject_moved_joints(episodes: list[Episode], streams: Streams, start: int, cell: Cell) -> None:
    """Rejects in the list those in which a joint that is to be held is elsewhere before the hold has ended."""
    joints, moved = streams.joints, streams.joints.moved(cell)
    if joints.others is None or not moved.any():
        return
    time, others = NANO * (joints.stamp[moved] - start), joints.others[moved]
    for number, one in enumerate(episodes):
        during = (time >= one.contact[0]) & (time <= one.hold[1])
        if not one.reason and during.any():
            episodes[number] = replace(one, reason=cell.moved_joint(others[during][0]), kind='other joint')


def _without_discarded(detection: Detection, stamps: Sequence[int]) -> Detection:
    """The detection without the touches in whose holds these stamps lie; a warning where there is none."""
    begin, end = np.array([one.hold for one in detection.episodes]).reshape(-1, 2).T
    time = NANO * (np.array(stamps)[:, None] - detection.start)
    inside = (begin <= time) & (time <= end)
    found = detection.without({detection.episodes[number].index for number in np.nonzero(inside)[1]}, DISCARDED)
    lost = int(np.sum(~inside.any(axis=1)))
    warning = f'{lost} touches were discarded while recording that are not found in the recording'
    return replace(found, warnings=(*found.warnings, warning)) if lost else found


def no_touches() -> TouchSet:
    """A set of no touches."""
    none = np.empty((0, 2))
    return TouchSet(none, none, np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))


def _held_touches(signals: Signals, episodes: list[Episode], cell: Cell) -> TouchSet:
    """Those with a steady hold, with their discs; those that meet none are rejected in the list."""
    holds = {number: one.steady for number, one in enumerate(episodes) if one.steady is not None and not one.reason}
    if not holds:
        return no_touches()
    sign = cell.sensor.sign.factor
    index, means = list(holds), list(holds.values())
    joints, force = np.array([hold.joints for hold in means]), sign * np.array([hold.force for hold in means])
    found = associate(joints, force, cell)
    for place in np.flatnonzero(~found.known).tolist():
        one = episodes[index[place]]
        episodes[one.index] = replace(one, reason=found.reason(place, cell), kind='no object')
    ends = np.unique([one.contact[1] for one in episodes])
    step, movements = signals.resolution, []
    for number, hold in holds.items():
        contact = episodes[number].contact[0]
        earliest = float(ends[ends <= contact].max(initial=-np.inf))
        movements.append(approach_of_hold(signals.joints, hold, contact, earliest, step))
    approach, press = np.swapaxes(movements, 0, 1)
    return TouchSet(
        joints=joints,
        force=force,
        disc=found.disc,
        posture=found.posture,
        time=np.array([0.5 * (p.intervals[0, 0] + p.intervals[-1, 1]) for p in means]),
        index=np.array(index),
        approach=approach,
        press=press,
        joint_scatter=np.array([p.joint_scatter for p in means]),
        force_scatter=np.array([p.force_scatter for p in means]),
        samples=np.array([p.samples for p in means]),
    )


def _warnings(spikes: int, weak: int, episodes: list[Episode]) -> list[str]:
    warnings = [f'{spikes} spikes of the force are too short for a touch and were ignored'] * bool(spikes)
    warnings += [f'{weak} weak forces during a motion of the arm are no touches and were ignored'] * bool(weak)
    if 2 * sum(one.kind == 'no object' for one in episodes) > len(episodes):
        keys = 'sensor.frame, sensor.sign, the joint names and the places of the objects'
        warnings.append(f'most touches meet no object: check {keys}')
    zeros = np.array([one.tare.force for one in episodes if one.tare is not None])
    change = float(np.ptp(zeros, axis=0).max()) if len(zeros) else 0.0
    if change > 1.0:
        warnings.append(f'the zero of the force sensor changes by {change:.1f} N within the recording')
    return warnings


def order_in_time(parts: Sequence[Detection]) -> Indices | None:
    """The recordings in the order of time; None where a start is unknown or two of them overlap."""
    if len(parts) == 1:
        return np.zeros(1, dtype=np.intp)
    begins = np.array([part.start for part in parts], dtype=np.int64)
    lasts = [max((max(one.hold[1], one.contact[1]) for one in part.episodes), default=0.0) for part in parts]
    ends = begins + np.array([int(SECOND * last) for last in lasts], dtype=np.int64)
    order = np.argsort(begins, kind='stable')
    known = bool(np.all(begins > 0) and np.all(ends[order[:-1]] <= begins[order[1:]]))
    return order if known else None


def as_in_table(cell: Cell, frame: SensorFrame) -> Cell:
    """The cell with a sensor that reports the force on the object, as tables hold it, in a frame."""
    return replace(cell, sensor=cell.sensor._replace(frame=frame, sign=SensorSign.ON_OBJECT))


def touches_of_table(table: TouchTable, cell: Cell) -> Detection:
    """The touches of a table, rejected where no object of the cell is there.

    Args:
        table: the table.
        cell: nominal parameters and discs.

    Raises:
        RecordingError: a row names an object that the cell does not have.
    """
    cell = as_in_table(cell, table.frame)
    joints, approach = cell.angles(table.joints), approach_of(table.approach, cell)
    names = [disc.name for disc in cell.discs]
    association = associate(joints, table.force, cell)
    disc, known = association.disc.copy(), association.known.copy()
    for row, (line, name) in enumerate(zip(table.lines, table.objects, strict=True)):
        if name and name not in names:
            problem = f'line {line}: the cell has no object {name!r}'
            raise RecordingError(table.source, problem, f'its objects are {", ".join(names)}')
        if name:
            disc[row], known[row] = names.index(name), True
    touches = TouchSet(
        joints=joints,
        force=table.force,
        disc=disc,
        posture=posture(cell.nominal, joints),
        time=table.time,
        approach=approach,
        press=press_of(approach),
        order=order_of_time(table.time),
    )
    found = Detection.of(touches)
    episodes = tuple(
        one if known[one.index] else replace(one, reason=association.reason(one.index, cell), kind='no object')
        for one in found.episodes
    )
    return replace(found, episodes=episodes, warnings=table.notes)


def approach_of(readings: Floats, cell: Cell) -> Floats:
    """The last movements of the angles of a coupled arm; of senses, ±1, alone that of joint 2 is taken as it is."""
    return cell.angles(readings) if press_of(readings).any() else cell.in_sense(readings)


def press_of(approach: Floats) -> Floats:
    """The part of the last movements that is in contact: all of it, or 0, unknown, if they are only senses, ±1."""
    return np.zeros_like(approach) if np.isin(np.abs(approach), (0.0, 1.0)).all() else approach


def cell_of_files(cell: Cell, paths: Sequence[str | Path]) -> Cell:
    """The cell as the sensor of recordings and tables sees it: the forces of tables are those on the object in their
    frame.

    Raises:
        InputError: some forces are in the base frame, others in that of the tool.
        RecordingError: a table cannot be read.
    """
    tables = [path for path in paths if is_touch_table(path)]
    recordings = [path for path in paths if path not in tables]
    found = [(path, load_touch_table(path).frame) for path in tables]
    found += [(path, cell.sensor.frame) for path in recordings] if found else []
    for path, frame in found:
        if frame is not found[0][1]:
            problem = f'a table has its forces in the {found[0][1].value} frame, {path} in the {frame.value} frame'
            raise InputError(tables[0], problem, 'calibrate the tables and the recordings separately')
    return as_in_table(cell, found[0][1]) if found and not recordings else cell
