"""Which disc a touch belongs to, and with which elbow posture, told from the nominal model.

A frictionless force F on disc d puts the tip at c_d - r_d F/|F|. The nominal tip
H(L_n, Q) misses that place by

    m_d = H(L_n, Q) - (c_d - r_d F/|F|),

distance and direction in one. The disc of the smallest miss is the touched one. As the
nominal geometry may be wrong by 20 mm and 3°, misses of some centimetres are usual; where
there are enough touches, the six geometric parameters are first fitted to the misses (robustly,
with these errors as their prior), and what remains tells a known disc from an unknown object.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell, Sensor, SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import forward, link_vectors, posture, quarter_turn, rotate
from scara_kinetostatic.model.parameters import Parameters

Floats = NDArray[np.float64]

LENGTH_PRIOR = 0.015
"""1-sigma of the nominal lengths and offsets, m."""
ANGLE_PRIOR = np.deg2rad(2.5)
"""1-sigma of the nominal angles, rad."""
MISS_SIGMA = 0.005
"""1-sigma of a miss of the right disc with the right geometry, m."""
FARTHEST_NOMINAL = 0.08
"""A larger miss under the nominal geometry is no touch of the disc, m."""
FARTHEST_FITTED = 0.03
"""A larger miss under the fitted geometry is no touch of the disc, m."""
FEWEST = 8
"""Touches needed to trust the fitted geometry."""
OBLIQUE = 0.35
"""A force may be this far from the normal (noise, friction), rad."""


class Association(NamedTuple):
    """What n touches touch.

    Attributes:
        disc: index of the nearest disc, (n,).
        posture: +1 or -1, (n,).
        miss: distance to that disc's place of contact, m; obliqueness up to `OBLIQUE` is not counted, (n,).
        known: whether the touch belongs to the disc, (n,).
        advice: not empty where the sensor's frame or sign in the cell description seem wrong.
    """

    disc: NDArray[np.intp]
    posture: NDArray[np.intp]
    miss: Floats
    known: NDArray[np.bool_]
    advice: str


def associate(joints: Floats, force: Floats, cell: Cell) -> Association:
    """Disc and posture of n touches.

    Args:
        joints: Q, (n, 2), rad.
        force: on the object, in the frame of the sensor, (n, 2), N.
        cell: nominal parameters, discs, frame of the sensor.
    """
    fitted = _fit_geometry(joints, force, cell)
    disc, miss = _nearest(cell.nominal, joints, force, cell)
    known = miss <= FARTHEST_NOMINAL
    if len(joints) >= FEWEST:
        fitted_disc, fitted_miss = _nearest(fitted, joints, force, cell)
        close = fitted_miss <= FARTHEST_FITTED
        if np.sum(close) >= max(FEWEST, len(joints) / 2):
            disc, miss = fitted_disc, fitted_miss
            known = miss <= max(FARTHEST_FITTED, 6.0 * float(np.median(miss)))
    advice = '' if known.mean() > 0.8 else _other_convention(joints, force, cell)
    return Association(disc, posture(cell.nominal, joints), miss, known, advice)


def _misses(parameters: Parameters, joints: Floats, force: Floats, cell: Cell) -> tuple[Floats, Floats]:
    """Miss of every disc, (n, m, 2), m, and the unit force in the base frame, (n, 2)."""
    if cell.sensor.frame is SensorFrame.TOOL:
        force = rotate(force, joints.sum(axis=1) + parameters.theta1 + parameters.theta2)
    unit = force / np.maximum(np.linalg.norm(force, axis=1), 1e-300)[:, None]
    place = cell.centers[None] - cell.radii[None, :, None] * unit[:, None]
    return forward(parameters, joints)[:, None] - place, unit


def _nearest(parameters: Parameters, joints: Floats, force: Floats, cell: Cell) -> tuple[NDArray[np.intp], Floats]:
    """The disc of the smallest miss and that miss, obliqueness forgiven."""
    misses, unit = _misses(parameters, joints, force, cell)
    disc = np.argmin(np.linalg.norm(misses, axis=2), axis=1)
    miss = misses[np.arange(len(disc)), disc]
    radial = np.sum(miss * unit, axis=1)
    tangential = np.abs(np.sum(miss * quarter_turn(unit), axis=1))
    return disc, np.hypot(radial, np.maximum(tangential - OBLIQUE * cell.radii[disc], 0.0))


def _fit_geometry(joints: Floats, force: Floats, cell: Cell, rounds: int = 8) -> Parameters:
    """Geometry under which the touches miss their nearest discs least, by reweighted least squares."""
    nominal = cell.nominal.as_array()
    prior = np.array([LENGTH_PRIOR, LENGTH_PRIOR, ANGLE_PRIOR, LENGTH_PRIOR, ANGLE_PRIOR, LENGTH_PRIOR])
    change = np.zeros(6)
    for _ in range(rounds):
        parameters = Parameters.from_array(nominal + np.append(change, np.zeros(6)))
        misses, unit = _misses(parameters, joints, force, cell)
        disc = np.argmin(np.linalg.norm(misses, axis=2), axis=1)
        miss = misses[np.arange(len(disc)), disc]
        jacobian = _miss_jacobian(parameters, joints, cell.radii[disc, None] * unit, cell.sensor)
        size = np.linalg.norm(miss, axis=1)
        weight = 1.0 / np.sqrt(1.0 + (size / max(4 * MISS_SIGMA, float(np.median(size)))) ** 2)
        rows = (weight / MISS_SIGMA)[:, None, None] * jacobian * prior
        right = (weight / MISS_SIGMA)[:, None] * (np.einsum('nij,j->ni', jacobian, change) - miss)
        system = np.vstack([rows.reshape(-1, 6), np.eye(6)])
        change = prior * np.linalg.lstsq(system, np.append(right.ravel(), np.zeros(6)), rcond=None)[0]
    return Parameters.from_array(nominal + np.append(change, np.zeros(6)))


def _miss_jacobian(parameters: Parameters, joints: Floats, lever: Floats, sensor: Sensor) -> Floats:
    """Derivative of the miss with respect to x0, y0, theta1, l1, theta2, l2, (n, 2, 6)."""
    link1, link2 = link_vectors(parameters, joints)
    turned = quarter_turn(lever) if sensor.frame is SensorFrame.TOOL else np.zeros_like(lever)
    x, y = np.broadcast_to([1.0, 0.0], link1.shape), np.broadcast_to([0.0, 1.0], link1.shape)
    theta1, theta2 = quarter_turn(link1 + link2) + turned, quarter_turn(link2) + turned
    columns = [x, y, theta1, link1 / parameters.l1, theta2, link2 / parameters.l2]
    return np.stack(columns, axis=-1)


def _other_convention(joints: Floats, force: Floats, cell: Cell) -> str:
    """Advice, if another frame or sign of the sensor would make nearly all touches meet a disc."""
    for frame in SensorFrame:
        for sign in SensorSign:
            if (frame, sign) == (cell.sensor.frame, cell.sensor.sign):
                continue
            turned = force if sign is cell.sensor.sign else -force
            other = Cell(cell.nominal, cell.discs, sensor=cell.sensor._replace(frame=frame, sign=sign))
            meet = int(np.sum(_nearest(cell.nominal, joints, turned, other)[1] <= FARTHEST_NOMINAL))
            if meet >= max(3, 0.9 * len(joints)):
                return f'with sensor frame {frame.value!r} and sign {sign.value!r} {meet} of {len(joints)} would'
    return ''
