"""Contacts of a recording, from the force alone, and the zero of the force sensor: coarsely, and before each contact.

A contact begins where the smoothed force deviates from the zero of the sensor by more than a threshold, and ends where
the deviation falls below a part of it (hysteresis).

The zero is unknown and may be larger than a light touch. `coarse_tare`, which serves to find the contacts, uses that
the arm moves freely between the contacts and hardly in them: the zero is the mode of the force readings, each weighted
with the travel of the joints meanwhile, estimated block by block so that it follows a drift. `tare_before` is the zero
of one touch, from the free motion right before its contact.

**The part of the zero that turns with link 2**: the weight of a tool that the sensor does not know.

A sensor at the flange carries the tool. Its electrical zero is constant in its own frame, the weight in the base. So
the readings of a free arm are, with the components of a force as a complex number and a = q1 + q2,

    f = c + d exp(∓i a) + m x'',

in the frame of the tool with - and d of the weight, in the base with + and d of the zero that the driver turns along;
x'' is the acceleration of the tip in that frame. c follows a drift, as `coarse_tare`. All are found by least
squares over the free motion: each interval of time has the weight that it has there, and what is farther from the fit
than most is left out, as contacts are. d is taken away from all readings before anything is looked for in them; where
it is not significant, or so small that the zero before each touch is enough, or where the cell states no gravity,
readings stay as they are.

The standard deviation of d is that of the sums of residuals over some seconds (White, Econometrica 48 (1980) 817, in
clusters), as they are correlated within a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Complexes, Floats, Indices, Mask, as_complex, interpolated, pairs
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.quantities import rounded_down
from scara_kinetostatic.touches.streams import (
    SMOOTHING,
    Signal,
    Signals,
    Thresholds,
    median,
    median_of_three,
    moving_mean,
    robust_mean,
    runs,
    steps_of_mean,
    white_noise,
)

CONTACT_FORCE = 1.0
"""Deviation from the zero at which a contact begins, N; above the drift of a zero, below usual touches."""
END_RATIO = 0.5
"""A contact ends below this part of the deviation at which it begins."""


SHORTEST_FREE = Thresholds.pause
"""Free motion needed for a zero, s."""
AFTER_CONTACT = Thresholds.brief
"""Left out after the previous contact, s."""


class Contacts(NamedTuple):
    """The contacts of a recording.

    Attributes:
        begin: time of the first sample of each in contact, (m,), s.
        end: time of the last sample, (m,), s.
        peak: largest deviation from the coarse zero in each, (m,), N.
        travel: range of the joint that moves most in each, (m,), rad.
        spikes: number of deviations that were too short for a contact.
        threshold: deviation at which a contact begins, N.
        smoothing: time over which the force was smoothed for it, s.
    """

    begin: Floats
    end: Floats
    peak: Floats
    travel: Floats
    spikes: int
    threshold: float
    smoothing: float

    def select(self, which: Mask) -> Contacts:
        """The contacts where a mask, (m,), is true."""
        return self._replace(**{name: getattr(self, name)[which] for name in self._fields[:4]})


def find_contacts(signals: Signals, zero: Floats | None = None, longest_smoothing: float = SMOOTHING) -> Contacts:
    """All contacts in the order of time.

    Args:
        signals: the recording.
        zero: of the force sensor where it is known, (2,), N; None to take it from where the arm moves most.
        longest_smoothing: where the noise asks for it the force is smoothed for so long, s.
    """
    wrench, noise = signals.wrench, white_noise(signals.wrench.value)
    shortest, longest = (2 * round(0.5 * time / wrench.period) + 1 for time in (SMOOTHING, longest_smoothing))
    needed = 2 * round(0.5 * (Thresholds.sigmas * noise / CONTACT_FORCE) ** 2) + 1
    width = int(np.clip(needed, shortest, longest))
    smooth = moving_mean(signals.filtered.value, width)
    smooth -= coarse_tare(signals) if zero is None else zero
    deviation = np.hypot(smooth[:, 0], smooth[:, 1])
    on = max(CONTACT_FORCE, Thresholds.sigmas * noise / float(np.sqrt(width)))
    first, last = runs(_with_hysteresis(deviation, on, END_RATIO * on))
    begin, end = wrench.time[first], wrench.time[last]
    apart = begin[1:] - end[:-1] >= Thresholds.brief
    begin, end = begin[np.append(True, apart)[: len(begin)]], end[np.append(apart, True)[: len(end)]]
    lasting = end - begin > max(Thresholds.brief, (width + 1) * wrench.period)
    begin, end = begin[lasting], end[lasting]
    peak = [deviation[wrench.stretch(b, e)].max() for b, e in zip(begin, end, strict=True)]
    inside = [signals.joints.value[signals.joints.stretch(b, e)] for b, e in zip(begin, end, strict=True)]
    travel = [np.ptp(joints, axis=0).max() if len(joints) else 0.0 for joints in inside]
    smoothing = SMOOTHING if width == shortest else width * wrench.period
    return Contacts(begin, end, np.array(peak), np.array(travel), int(np.sum(~lasting)), on, smoothing)


def _with_hysteresis(deviation: Floats, on: float, off: float) -> Mask:
    """Whether each sample is in contact, (n,): from where the deviation exceeds `on` to where it falls below `off`."""
    decided = np.where(deviation > on, 1, np.where(deviation < off, -1, 0)).astype(np.int8)
    latest = np.where(decided != 0, np.arange(len(decided)), 0)
    contact: Mask = decided[np.maximum.accumulate(latest)] > 0
    return contact


class Tare(NamedTuple):
    """The zero of the force sensor before one contact.

    Attributes:
        force: the zero in the frame and sign of the sensor, (2,), N.
        noise: standard deviation of the white noise of one component, N.
        slow_noise: standard deviation of one component of the difference of neighbouring means (`steps_of_mean`), to
            which noise of low frequency contributes as well, N.
        contact: when the contact begins, s since the start of the recording.
    """

    force: Floats
    noise: float
    slow_noise: float
    contact: float


def tare_before(signals: Signals, begin: float, previous_end: float) -> Tare | str:
    """The zero of a contact.

    Args:
        signals: the recording.
        begin: time of the first sample that is clearly in contact, s.
        previous_end: time of the last sample of the previous contact, s, or -inf.

    Returns:
        The zero; why there is none where the free motion before the contact is too short, or sampled too slowly.
    """
    wrench, fewest = signals.wrench, Thresholds.few
    earliest = max(previous_end + AFTER_CONTACT, begin - Thresholds.longest_free)
    free = wrench.stretch(earliest, begin)
    time, force = wrench.time[free], wrench.value[free]
    lasting = begin - (float(time[0]) if len(time) >= fewest else max(earliest, float(wrench.time[0])))
    if lasting < SHORTEST_FREE:
        expected = f'expected {SHORTEST_FREE} s or more for the force zero'
        return f'no free motion before it: {rounded_down(max(lasting, 0.0))} s, {expected}'
    if len(time) < fewest:
        samples = f'{len(time)} of {fewest} samples needed for the force zero'
        return f'{wrench.name} is sampled too slowly: {samples} in the {lasting:.2f} s of free motion before it'
    noise = white_noise(force)
    contact = _first_contact(time, signals.filtered.value[free], noise, wrench.period)
    before = time < contact - Thresholds.before_contact
    if np.sum(before) < 3:
        before = np.arange(len(time)) < 3
    steps, _ = steps_of_mean(signals.filtered, time[before], signals.window)
    # the median of the length of a vector with two normal components is 1.18 sigma
    slow_noise = float(median(np.hypot(*steps.T))) / 1.18
    return Tare(robust_mean(force[before])[0], noise, slow_noise, contact)


def _first_contact(time: Floats, force: Floats, noise: float, period: float) -> float:
    """Time after which the force stays away from the median of the free samples, s; in their later half."""
    width = 2 * round(0.5 * SMOOTHING / period) + 1
    smooth = moving_mean(force - median(force), width)
    limit = max(Thresholds.smallest_deviation, Thresholds.onset_sigmas * noise / np.sqrt(width))
    at_zero = np.flatnonzero(np.hypot(smooth[:, 0], smooth[:, 1]) < limit)
    latest = max(int(at_zero[-1]) if len(at_zero) else 0, len(time) // 2)
    return float(time[latest])


def coarse_tare(signals: Signals) -> Floats:
    """The zero of the force sensor at every wrench sample, (n, 2), N, in its frame and sign."""
    wrench = signals.wrench
    time, force, travel = grid_means(signals.joints, signals.filtered)
    block = (time // Thresholds.block).astype(np.intp)
    whole = _weighted_mode(force, travel)
    enough = Thresholds.least_share * travel.sum() / (block[-1] + 1)
    centers, zeros = [], []
    for first, last in zip(*_equal_runs(block), strict=True):
        part = slice(first, last + 1)
        if travel[part].sum() > enough:
            centers.append(time[part].mean())
            zeros.append(_weighted_mode(force[part], travel[part]))
    if not zeros:
        return np.broadcast_to(whole, wrench.value.shape)
    course = median_of_three(np.array(zeros))
    return interpolated(wrench.time, np.array(centers), course)


def grid_means(joints: Signal, wrench: Signal) -> tuple[Floats, Floats, Floats]:
    """Time (k,), s, mean force (k, 2), N, and joint travel (k,), rad, of every interval with force samples."""
    size = max(Thresholds.grid, Thresholds.samples * wrench.period)
    first, last = _equal_runs((wrench.time // size).astype(np.intp))
    count = (last - first + 1)[:, None]
    force = np.add.reduceat(wrench.value, first, axis=0) / count
    time = (np.floor(wrench.time[first] / size) + 0.5) * size
    begin, end = joints.at(time - 0.5 * size), joints.at(time + 0.5 * size)
    return time, force, np.minimum(np.abs(end - begin).sum(axis=1), Thresholds.largest_weight)


def _weighted_mode(values: Floats, weight: Floats) -> Floats:
    """Mode of weighted points in the plane: the half-sample mode, along x and y in turn.

    The shortest interval with half of the weight is kept, again and again, until few points are left; the mode is
    their weighted mean (Robertson and Cryer 1974; Bickel and Fruehwirth 2006).

    Args:
        values: points, (n, 2).
        weight: their weights, (n,); all are 1 where their sum is 0.

    Returns:
        The mode, (2,).
    """
    if not weight.sum() > 0:
        weight = np.ones(len(values))
    axis, unchanged = 0, 0
    while len(values) > 8 and unchanged < 2:
        order = np.argsort(values[:, axis], kind='stable')
        total = np.cumsum(weight[order])
        half = 0.5 * total[-1]
        start = np.flatnonzero(total - weight[order] <= half)
        stop = np.searchsorted(total, total[start] - weight[order][start] + half * (1 - 1e-12))
        stop = np.minimum(stop, len(order) - 1)
        best = np.argmin(values[order[stop], axis] - values[order[start], axis])
        keep = order[start[best] : stop[best] + 1]
        unchanged = unchanged + 1 if len(keep) == len(values) else 0
        values, weight, axis = values[keep], weight[keep], 1 - axis
    mode: Floats = np.average(values, axis=0, weights=np.maximum(weight, 1e-300))
    return mode


def _equal_runs(labels: Indices) -> tuple[Indices, Indices]:
    """First and last index of every run of equal labels."""
    change = np.flatnonzero(np.diff(labels))
    return np.append(0, change + 1), np.append(change, len(labels) - 1)


class TurningZero(NamedTuple):
    """What turns with link 2 in the readings of a sensor.

    Attributes:
        force: d, as the sensor reports it, N.
        std: its standard deviation, N; infinite where nothing is known.
    """

    force: complex = 0j
    std: float = np.inf

    def at(self, joints: Floats, cell: Cell) -> Floats:
        """What it adds to readings at Q, (n, 2), rad: (n, 2), N."""
        return pairs(self.force * _turn(joints.sum(axis=1), cell))

    def out_of(self, signals: Signals, cell: Cell) -> Signals:
        """Signals without it; those that are given where there is none."""
        if not self.force:
            return signals
        wrench, joints = signals.wrench, signals.joints
        value = wrench.value - self.at(joints.at(wrench.time), cell)
        filtered = signals.filtered._replace(value=median_of_three(value))
        return signals._replace(wrench=wrench._replace(value=value), filtered=filtered)

    def remarks(self, cell: Cell) -> list[str]:
        """What it is, and what to do about it; nothing where there is none."""
        n, is_tool = cell.nominal, cell.sensor.frame is SensorFrame.TOOL
        if not self.force:
            return []
        sign = cell.sensor.sign.factor
        mass = -sign * self.force * np.exp(1j * (n.theta1 + n.theta2)) / complex(*n.gravity)
        if is_tool and abs(mass.imag) < 0.3 * abs(mass.real):
            what = 'does not know' if mass.real > 0 else 'takes off too much for'
            tool = f'the sensor {what} a tool of {abs(mass.real):.3g} kg ({abs(self.force):.2g} N), which is corrected'
            return [f'{tool}: set it in the driver, or state sensor.tool_weight: {mass.real:.3g}']
        why = 'check the direction of gravity, sensor.rotation and joint_names, as it is not along the weight'
        why = why if is_tool else 'have the driver set the zero before it turns the forces into the base'
        return [f'the zero of the sensor turns with link 2, by {abs(self.force):.2g} N, which is corrected: {why}']


def _turn(angle: Floats, cell: Cell) -> Complexes:
    return np.asarray(np.exp((-1j if cell.sensor.frame is SensorFrame.TOOL else 1j) * angle))


def find_turning_zero(signals: Signals, cell: Cell) -> TurningZero:
    """The significant part of the zero that turns with link 2, with its standard deviation; 0 where there is none.

    Args:
        signals: the recording.
        cell: frame of the sensor, and the nominal arm.
    """
    s, joints = Thresholds, signals.joints
    if cell.sensor.tool_weight is not None or not cell.nominal.has_gravity:
        return TurningZero()
    time, force, travel = grid_means(joints, signals.filtered)
    moving = travel > 0.02 * travel.max(initial=0.0)
    time, travel = time[moving], travel[moving]
    block, cluster = ((time / length).astype(np.intp) for length in (s.block, s.cluster))
    if len(np.unique(cluster)) < s.fewest_clusters:
        return TurningZero()
    before, at, after = (joints.at(time + side * s.brief) for side in (-1, 0, 1))
    turn = _turn(at.sum(axis=1), cell)
    low, mid, high = (as_complex(forward(cell.nominal, angles)) for angles in (before, at, after))
    acceleration = (high - 2.0 * mid + low) / s.brief**2 * (turn if cell.sensor.frame is SensorFrame.TOOL else 1.0)
    columns, weight = np.array([turn, acceleration, as_complex(force[moving])]), travel

    def sums(values: Complexes, labels: Indices) -> Complexes:
        return np.asarray(np.bincount(labels, weight * values.real) + 1j * np.bincount(labels, weight * values.imag))

    for _ in range(s.rounds):
        total = np.maximum(np.bincount(block, weight), 1e-300)
        *rows, y = (column - (sums(column, block) / total)[block] for column in columns)
        x = np.array(rows)
        inverse = np.linalg.pinv((x.conj() * weight) @ x.T, hermitian=True)
        found = inverse @ ((x.conj() * weight) @ y)
        residual = y - found @ x
        size = np.abs(residual)
        order = np.argsort(size)
        half = np.searchsorted(np.cumsum(travel[order]), 0.5 * travel.sum())
        weight = travel * (size <= s.outlying * size[order[half]])
    scores = np.array([sums(row.conj() * residual, cluster) for row in x])
    std = float(np.sqrt((inverse @ scores @ scores.conj().T @ inverse)[0, 0].real))
    is_significant = abs(found[0]) > max(s.least_turning, s.sigmas * std)
    return TurningZero(complex(found[0]), std) if is_significant else TurningZero()
