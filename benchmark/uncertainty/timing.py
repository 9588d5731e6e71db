"""Time of a fit with declared uncertainties over one without."""

from __future__ import annotations

from typing import Any

from benchmark.common import repeat
from benchmark.diagnosis.cells import SETUPS
from benchmark.uncertainty.worlds import KINDS
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

PER_DISC = {36: 6, 72: 12, 360: 60}
"""Touches of each disc and posture of the paper's cell, by the number of all touches."""
LARGEST_RATIO = 1.5


def run() -> list[dict[str, Any]]:
    """Times fits of 36, 72 and 360 touches."""
    setup = SETUPS['paper']
    records = []
    for count, per_disc in PER_DISC.items():
        plan = default_plan(setup.cell, per_disc)
        touches = simulate_touches(setup.cell, setup.truth, plan, setup.cell.noise)
        seconds = {}
        for kind in ('exact', 'small', 'plate', 'everything'):
            cell = KINDS[kind](setup.cell)
            seconds[kind] = repeat(lambda cell=cell, touches=touches: calibrate(touches, cell))  # type: ignore[misc]
        least = seconds['exact']['median']
        records.append({'touches': count, 'ratio': {kind: each['median'] / least for kind, each in seconds.items()}})
        ratios = ', '.join(f'{kind} {ratio:.2f}' for kind, ratio in records[-1]['ratio'].items() if kind != 'exact')
        print(f'{count} touches: {1e3 * least:.1f} ms without, times {ratios}', flush=True)
    return records


def targets(records: list[dict[str, Any]]) -> list[tuple[str, bool]]:
    """Whether the ratio is kept."""
    largest = max(ratio for record in records for ratio in record['ratio'].values())
    return [(f'at most {LARGEST_RATIO} times as long: {largest:.2f}', largest <= LARGEST_RATIO)]
