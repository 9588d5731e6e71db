"""Simulated records of one joint that is driven by its load."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord

RATE = 80.0
COMPLIANCE = 150e-6
TORQUE_NOISE, ANGLE_NOISE = 5e-3, 2e-6


def torque(level: float = -2.0, rest: int = 200, held: int = 400, after: int = 300) -> np.ndarray:
    """Nothing, a load within 20 samples, nothing again, (n,), Nm."""
    ramp = np.linspace(0.0, level, 20)
    return np.concatenate([np.zeros(rest), ramp, np.full(held, level), ramp[::-1], np.zeros(after)])


def columns(load: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, torque and angle of an elastic joint, with noise; s, Nm, rad."""
    random = np.random.default_rng(seed)
    angle = 0.7 + COMPLIANCE * load + ANGLE_NOISE * random.standard_normal(len(load))
    return np.arange(len(load)) / RATE, load + TORQUE_NOISE * random.standard_normal(len(load)), angle


def load_record(load: np.ndarray | None = None, seed: int = 0, source: str = 'one.csv') -> LoadRecord:
    """One record."""
    return LoadRecord(source, *columns(torque() if load is None else load, seed))


def table(load: np.ndarray | None = None, heading: str = 'time_s,angle_rad,torque_Nm', seed: int = 0) -> str:
    """One record as CSV."""
    time, measured, angle = columns(torque() if load is None else load, seed)
    rows = [f'{t:.5f},{q:.9f},{tau:.6f}' for t, q, tau in zip(time, angle, measured, strict=True)]
    return '\n'.join([heading, *rows]) + '\n'


def slipping(load: np.ndarray, state: float, slip_load: float = 1.0, slip: float = 120e-6) -> np.ndarray:
    """Angle of the slipping part of a joint, (n,), rad: friction that holds up to a torque, one sample after the other.

    Args:
        load: (n,), Nm.
        state: of friction at the start, -1 to 1.
        slip_load: at which it slips, Nm.
        slip: compliance of the slipping part, rad/Nm.
    """
    anchor, moved = state * slip_load, []
    for each in load.tolist():
        held = each - anchor
        if abs(held) > slip_load:
            anchor = each - np.sign(held) * slip_load
        moved.append(slip * anchor)
    return np.array(moved)


def slip_table(level: float, state: float, seed: int, heading: str = 'time_s,angle_rad,torque_Nm') -> str:
    """One record of a joint that slips, as CSV."""
    load = torque(level)
    time, measured, angle = columns(load, seed)
    angle = angle + slipping(load, state)
    rows = [f'{t:.5f},{q:.9f},{tau:.6f}' for t, q, tau in zip(time, angle, measured, strict=True)]
    return '\n'.join([heading, *rows]) + '\n'
