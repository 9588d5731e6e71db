"""Readings of a gauge as a table, and simulated loops as one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from studies.load_records import play

from scara_kinetostatic.files.tables import csv_lines
from scara_kinetostatic.studies.loops.dial_gauge import Readings


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


def loops(heading: str = 'time_s,displacement_m,force_N', slip: float = 6e3) -> str:
    """Loops of a joint with a gap of 4 mm that slips at a load, as a table."""
    time = np.arange(0, 8, 1 / 50)
    places = 0.02 * np.minimum(0.4 + time / 6, 1) * np.sin(np.pi * time)
    stretch = places - play(places, 2e-3 + 1e-6 * slip)
    force = np.sign(stretch) * np.maximum(abs(stretch) - 2e-3, 0) / 1e-6
    noisy = force + 20 * np.random.default_rng(0).standard_normal(len(force))
    rows = [f'{t:.4f},{x:.9f},{f:.3f}' for t, x, f in zip(time, places, noisy, strict=True)]
    return '\n'.join([heading, *rows]) + '\n'
