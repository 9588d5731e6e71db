"""Simulated records of one joint that is driven by its load."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.studies.loops.record import Record

RATE = 80.0
COMPLIANCE = 150e-6
TORQUE_NOISE, ANGLE_NOISE = 5e-3, 2e-6
SLIP, SLIP_LOAD = 120e-6, 1.0
"""Compliance of the part that slips, rad/Nm, and the torque up to which its friction holds, Nm."""


def torque(level: float = -2.0, rest: int = 200, held: int = 400, after: int = 300) -> np.ndarray:
    """Nothing, a load within 20 samples, nothing again, (n,), Nm."""
    ramp = np.linspace(0.0, level, 20)
    return np.concatenate([np.zeros(rest), ramp, np.full(held, level), ramp[::-1], np.zeros(after)])


def columns(load: np.ndarray, seed: int = 0, state: float | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, torque and angle of an elastic joint, or of one that slips from such a state on, with noise; s, Nm, rad."""
    random = np.random.default_rng(seed)
    angle = 0.7 + COMPLIANCE * load + ANGLE_NOISE * random.standard_normal(len(load))
    angle += 0.0 if state is None else SLIP * play(load, SLIP_LOAD, state * SLIP_LOAD)
    return np.arange(len(load)) / RATE, load + TORQUE_NOISE * random.standard_normal(len(load)), angle


def play(load: np.ndarray, half_width: float, start: float = 0.0) -> np.ndarray:
    """The play operator, one sample after the other, (n,): where friction holds up to a half-width, its other end."""
    output, here = [], start
    for each in load.tolist():
        here = min(max(here, each - half_width), each + half_width)
        output.append(here)
    return np.array(output)


def record(load: np.ndarray, seed: int = 0, state: float | None = None, half_gap: float = 0.0) -> Record:
    """A joint with a gap by law (6), with slip where it has a state."""
    time, measured, angle = columns(load, seed, state)
    return Record(f'{seed}.csv', time, measured, angle + half_gap * np.sign(load))


def table(
    load: np.ndarray, heading: str = 'time_s,angle_rad,torque_Nm', seed: int = 0, state: float | None = None
) -> str:
    """One record as CSV."""
    rows = [f'{t:.5f},{q:.9f},{tau:.6f}' for t, tau, q in zip(*columns(load, seed, state), strict=True)]
    return '\n'.join([heading, *rows]) + '\n'
