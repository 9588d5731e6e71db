"""Readings of a gauge as a table."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings


def dump_readings(readings: DialGaugeReadings) -> str:
    """A CSV text with the columns that have values."""
    numbers = {
        'force_N': readings.force,
        'displacement_um': 1e6 * readings.displacement,
        'direction_deg': np.degrees(readings.direction),
        'lever_m': readings.lever,
        'cycle': readings.cycle,
        'time_s': readings.time,
    }
    columns = {
        name: [f'{value:.9g}' if np.isfinite(value) else '' for value in values]
        for name, values in numbers.items()
        if np.any(np.isfinite(values))
    } | {'part': readings.part, 'gauge_at': readings.gauge_at}
    lines = [','.join(columns), *(','.join(row) for row in zip(*columns.values(), strict=True))]
    return '\n'.join(lines) + '\n'
