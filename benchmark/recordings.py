"""The stated standard deviations against the errors of many simulated recordings, from streams to L̄.

    python -m benchmark.recordings [--number 200] [--noise given|estimated] [--json FILE]

Half of the recordings have the paper's L̄a, half the compliances and backlashes of figure 4(d);
three force levels, both postures, 72 touches. Each is simulated as two streams, its
touches are found, and the calibration's error is divided by its own standard deviation.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import stats

from benchmark.common import CELL, NOISES, ROBOTS, counted, parser, print_and_save
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import find_touches


def evaluate(number: int, given: bool) -> Iterator[dict[str, object]]:
    """One record per recording: robot, z-scores, touches, reduced chi-square, verdict."""
    cell = CELL if given else replace(CELL, noise=None)
    plan = default_plan(CELL)
    for seed in range(number):
        name, truth = list(ROBOTS.items())[seed % len(ROBOTS)]
        detection = find_touches(simulate_streams(CELL, truth, plan, seed=seed), cell)
        found = calibrate(detection.touches, cell)
        yield {
            'robot': name,
            'z': ((found.parameters.as_array() - truth.as_array()) / found.std).tolist(),
            'found': detection.found,
            'used': int(found.used.sum()),
            'reduced_chi_square': found.reduced_chi_square,
            'alarm': diagnose(found).verdict != 'none',
        }


def summarise(records: list[dict[str, object]], planned: int) -> dict[str, object]:
    """Pooled figures of all recordings."""
    z = np.array([record['z'] for record in records])
    return {
        'recordings': len(records),
        'rms': float(np.sqrt((z**2).mean())),
        'rms_by_parameter': dict(zip(NAMES, np.sqrt((z**2).mean(axis=0)).round(4).tolist(), strict=True)),
        'mean_by_parameter': dict(zip(NAMES, z.mean(axis=0).round(4).tolist(), strict=True)),
        'largest': float(np.abs(z).max()),
        'within_95': float((np.abs(z) < stats.norm.ppf(0.975)).mean()),
        'mean_reduced_chi_square': float(np.mean([record['reduced_chi_square'] for record in records])),
        'touches_missed_or_rejected': int(sum(planned - int(str(record['used'])) for record in records)),
        'false_alarms': int(sum(bool(record['alarm']) for record in records)),
    }


def main() -> int:
    """Run, print, save."""
    options_of = parser(__doc__)
    options_of.add_argument('--number', type=int, default=200)
    options_of.add_argument('--noise', choices=NOISES, default='given')
    options = options_of.parse_args()
    records = list(counted(evaluate(options.number, options.noise == 'given'), options.number))
    summary = summarise(records, len(default_plan(CELL)))
    print_and_save(options.json, summary)
    return 0


if __name__ == '__main__':
    sys.exit(main())
