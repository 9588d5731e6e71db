"""Readings of a gauge as a table, and a made-up record of loops."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from scara_kinetostatic.files.columns import csv_lines
from scara_kinetostatic.studies.loops.record import Readings, Record


def dump_readings(runs: Iterable[Readings]) -> str:
    """A CSV text with the columns that have values."""
    numbers = {
        'force_N': [each.force for each in runs],
        'displacement_um': [1e6 * each.displacement for each in runs],
        'direction_deg': [np.full(len(each), np.degrees(each.direction)) for each in runs],
        'lever_m': [np.full(len(each), each.lever) for each in runs],
        'cycle': [each.cycle for each in runs],
    }
    columns = {
        name: [f'{value:.9g}' if np.isfinite(value) else '' for value in np.concatenate(several)]
        for name, several in numbers.items()
        if np.any(np.isfinite(np.concatenate(several)))
    }
    for name in ('part', 'gauge_at'):
        columns[name] = [getattr(each, name) for each in runs for _ in range(len(each))]
    return csv_lines(columns)


def dump_record(given: Record) -> str:
    """A CSV text of a record of loops."""
    columns = {'force_N': given.load, 'displacement_um': 1e6 * given.response, 'time_s': given.time}
    return csv_lines({name: [f'{value:.9g}' for value in values] for name, values in columns.items()})


def some(given: Record, rows: object) -> Record:
    """Some of the samples, by mask or index."""
    return replace(given, time=given.time[rows], load=given.load[rows], response=given.response[rows])


RATE, PERIOD = 512.0, 2.0
SLIP, INSIDE, UNLOADING, COMPLIANCE, GAP = 10e3, 0.0, 2e-7, 4e-7, 2.5e-3


def record(
    gap: float = GAP, lag: float = 0.0, offset: float = 0.0, noise: tuple[float, float] = (1e-6, 2.0), seed: int = 0
) -> Record:
    """Seven swings that grow, then fade, 0.5 Hz, after which nothing moves.

    After each reversal: unloading to 0, the gap, loading, slip. `lag` (s) makes the gap grow with the speed.
    """
    time = np.arange(0, 18, 1 / RATE)
    size = 0.025 * np.clip(np.minimum(time / 6, (16 - time) / 4), 0, 1)
    displacement = size * np.sin(2 * np.pi * time / PERIOD)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(displacement, append=displacement[-1]))) != 0) + 1
    turns = turns[time[turns] < 15.9]
    force = np.zeros_like(time)
    edges = [0, *turns.tolist(), len(time)]
    speed = np.abs(np.gradient(displacement, time))
    for first, last in pairwise(edges):
        rows = slice(first, last)
        sense = np.sign(displacement[last - 1] - displacement[first]) or 1.0
        distance = sense * (displacement[rows] - displacement[first])
        crossing = np.argmax(distance >= SLIP * UNLOADING + gap / 2) if len(distance) else 0
        width = gap + lag * (speed[rows][crossing] - 0.03)
        knots = np.cumsum([0.0, SLIP * UNLOADING, width, SLIP * COMPLIANCE])
        force[rows] = sense * np.interp(distance, knots, [-SLIP, -1e-3, 1e-3, SLIP])
    force[: turns[0]] = SLIP * np.tanh(displacement[: turns[0]] / 1e-4)
    rng = np.random.default_rng(seed)
    displacement = displacement + noise[0] * rng.standard_normal(len(time))
    force = force + offset + noise[1] * rng.standard_normal(len(time))
    return Record('readings', time, force, displacement, 'N')
