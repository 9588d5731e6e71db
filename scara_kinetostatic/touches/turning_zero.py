"""The part of the zero of the force sensor that turns with link 2: the weight of a tool that the sensor does not know.

A sensor at the flange carries the tool. Its electrical zero is constant in its own frame, the weight in the base. So
the readings of a free arm are, with the components of a force as a complex number and a = q1 + q2,

    f = c + d exp(∓i a) + m x'',

in the frame of the tool with - and d of the weight, in the base with + and d of the zero that the driver turns along;
x'' is the acceleration of the tip in that frame. c follows a drift, as `contacts.coarse_tare`. All are found by least
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

from scara_kinetostatic.model.arrays import Complexes, Floats, Indices, as_complex, pairs
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.touches.contacts import grid_means
from scara_kinetostatic.touches.signals import Signals, median_of_three


class Settings:
    """How it is found, and when it counts.

    Attributes:
        least: a smaller one changes no touch: the zero before each takes most of it, N. Source: 50 g.
        sigmas: a significant one exceeds so many of its standard deviations.
        block: c is constant in so long, s: that of the coarse zero.
        cluster: residuals further apart than this are independent, s.
        fewest_clusters: less do not show a standard deviation.
        step: over which joint angles are differenced for the acceleration, s.
        outlying: residuals beyond this many times their median are left out.
        rounds: of the fit, each without the outliers of the one before.
    """

    least: float = 0.2
    sigmas: float = 6.0
    block: float = 10.0
    cluster: float = 2.5
    fewest_clusters: int = 4
    step: float = 0.05
    outlying: float = 3.0
    rounds: int = 6


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
        sign = -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
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
    s, joints = Settings, signals.joints
    if cell.sensor.tool_weight is not None or not cell.nominal.has_gravity:
        return TurningZero()
    time, force, travel = grid_means(joints, signals.filtered)
    moving = travel > 0.02 * travel.max(initial=0.0)
    time, travel = time[moving], travel[moving]
    block, cluster = ((time / length).astype(np.intp) for length in (s.block, s.cluster))
    if len(np.unique(cluster)) < s.fewest_clusters:
        return TurningZero()
    before, at, after = (joints.at(time + side * s.step) for side in (-1, 0, 1))
    turn = _turn(at.sum(axis=1), cell)
    low, mid, high = (as_complex(forward(cell.nominal, angles)) for angles in (before, at, after))
    acceleration = (high - 2.0 * mid + low) / s.step**2 * (turn if cell.sensor.frame is SensorFrame.TOOL else 1.0)
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
    is_significant = abs(found[0]) > max(s.least, s.sigmas * std)
    return TurningZero(complex(found[0]), std) if is_significant else TurningZero()
