"""Hysteresis loops of known laws: false alarms on law (6), and the effects named.

    python -m benchmark.hysteresis [--seeds N] [--alarms N] [--json FILE]

Every candidate is simulated at three sizes, with white noise and with noise that is correlated over some 20 samples,
and examined as measured loops are. Sizes: of slip and of softening, the load at which it begins; of the others, their
force over the elastic one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.loops.fit import FittedLaw, evaluate
from scara_kinetostatic.studies.loops.laws import BACKLASH, MOTION_LAWS, RecordLaw, Values
from scara_kinetostatic.studies.loops.record import LEVEL, MOTION, Record, RecordPath
from scara_kinetostatic.studies.loops.selection import (
    NONE,
    UNDECIDED,
    UNEXPLAINED,
    Selection,
    Study,
    p_independent,
    select_model,
)

NOISE = 100.0
CORRELATIONS = (0.0, 0.9)
TRUTH = {'zero': 0.001, 'compliance': 1e-6, 'half_gap': 2e-3, 'force_zero': 50.0}
"""Peak force of law (6): 17 to 19 kN."""
SIZES = {
    'softening': (40e3, 20e3, 10e3),
    'viscous': (1e3, 3e3, 10e3),
    'friction': (100.0, 300.0, 1000.0),
    'slip_no_gap': (18e3, 14e3, 8e3),
    'slip': (16e3, 12e3, 7e3),
}


def sine(samples: int = 640, cycles: int = 5) -> tuple[Floats, Floats]:
    """Time (s) and displacement (m) of a motion like that of measured loops: its amplitude grows for two cycles."""
    time = np.linspace(0, 2.0 * cycles, samples)
    return time, 0.02 * np.minimum(0.4 + 0.15 * time, 1.0) * np.sin(np.pi * time)


def simulate_record(law: RecordLaw, values: Values, noise: float, seed: int, correlation: float = 0.0) -> Record:
    """Simulated record of a law.

    Args:
        law: the law.
        values: its parameters, SI.
        noise: standard deviation of the force readings, N.
        seed: of the noise.
        correlation: of the noise from one sample to the next, r^k over k samples.
    """
    time, displacement = sine()
    rest = np.zeros(len(time))
    rest[-1] = 1.0  # no record has a constant force
    path = RecordPath(Record('simulated', time, rest, displacement, 'N'), MOTION)
    force = exact_force(law, path, values)
    white = np.random.default_rng(seed).standard_normal(len(force))
    white[1:] *= np.sqrt(1 - correlation**2)
    measured = force + noise * lfilter([1.0], [1.0, -correlation], white)
    return Record('simulated', path.time, measured, path.driver, 'N')


def exact_force(law: RecordLaw, path: RecordPath, values: Values) -> Floats:
    """The force of a law along a motion, its parameters those that are reported, 'state' that of friction."""
    p = values['compliance']
    slips = {f'limit_{sense}': p * values.get(f'slip_{sense}', 0.0) for sense in ('positive', 'negative')}
    zero = values.get('force_zero', (slips['limit_positive'] - slips['limit_negative']) / (2 * p))
    fitted = {'stiffness': 1 / p, 'limit': sum(slips.values()) / 2, **slips, **values}
    return zero + evaluate(FittedLaw(law, fitted, np.empty(0), 0.0), path, values.get('state', 0.0))


def values(law: RecordLaw, size: float) -> dict[str, float]:
    """Parameters of a law at a size."""
    found = {**TRUTH, 'slip_positive': size, 'slip_negative': 0.9 * size, 'damping': size, 'friction': size}
    if law.name == 'slip_no_gap':
        del found['force_zero']
    return found


def named(selection: Selection) -> str:
    """What came out, in a word."""
    if selection.selected is None:
        return selection.verdict
    return '|'.join(sorted(each.law.name for each in (selection.selected, *selection.rivals)))


def alarmed(record: Record) -> bool:
    """Whether the residual of law (6) is found to have structure."""
    return p_independent(Study([record], MOTION).law6()[1]) < LEVEL / 2


def main() -> int:
    """Runs the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, default=10, help='of each effect at each size (default: 10)')
    parser.add_argument('--alarms', type=int, default=500, help='records of law (6) alone (default: 500)')
    parser.add_argument('--json', type=Path, help='write the counts there')
    args = parser.parse_args()
    found: dict[str, dict[str, int]] = {}
    for correlation in CORRELATIONS:
        alarms = sum(alarmed(simulate_record(BACKLASH, TRUTH, NOISE, seed, correlation)) for seed in range(args.alarms))
        found[f'backlash, correlation {correlation:g}'] = {'alarm': alarms, NONE: args.alarms - alarms}
        for law in MOTION_LAWS:
            for size in SIZES[law.name]:
                records = (
                    simulate_record(law, values(law, size), NOISE, seed, correlation) for seed in range(args.seeds)
                )
                counts = Counter(named(select_model(Study([record], MOTION))) for record in records)
                found[f'{law.name} {size:g}, correlation {correlation:g}'] = dict(counts)
    right = sum(counts.get(name.split()[0], 0) for name, counts in found.items() if not name.startswith('backlash'))
    total = sum(sum(counts.values()) for name, counts in found.items() if not name.startswith('backlash'))
    for name, counts in found.items():
        print(f'{name:40}', ', '.join(f'{word}: {count}' for word, count in counts.items()))
    missed = sum(
        sum(counts.get(each, 0) for each in (NONE, UNDECIDED, UNEXPLAINED))
        for name, counts in found.items()
        if name[0] != 'b'
    )
    print(f'named alone and rightly: {right} of {total}; not named at all: {missed}')
    if args.json:
        args.json.write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
