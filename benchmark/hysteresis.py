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

from scara_kinetostatic.studies.hysteresis.fit import fit
from scara_kinetostatic.studies.hysteresis.laws import (
    BACKLASH,
    CANDIDATES,
    FRICTION,
    SLIP,
    SLIP_NO_GAP,
    SOFTENING,
    VISCOUS,
    Law,
    simulate_record,
)
from scara_kinetostatic.studies.hysteresis.model_selection import (
    LEVEL,
    NONE,
    UNEXPLAINED,
    ModelSelection,
    dependences,
    p_independent,
    select_model,
)
from scara_kinetostatic.studies.hysteresis.motion import Motion

NOISE = 100.0
CORRELATIONS = (0.0, 0.9)
TRUTH = {'zero': 0.001, 'compliance': 1e-6, 'half_gap': 2e-3, 'force_zero': 50.0}
"""Peak force of law (6): 17 to 19 kN."""
SIZES = {
    SOFTENING.name: (40e3, 20e3, 10e3),
    VISCOUS.name: (1e3, 3e3, 10e3),
    FRICTION.name: (100.0, 300.0, 1000.0),
    SLIP_NO_GAP.name: (18e3, 14e3, 8e3),
    SLIP.name: (16e3, 12e3, 7e3),
}


def values(law: Law, size: float) -> dict[str, float]:
    """Parameters of a law at a size."""
    more = {'start': 0.0, 'slip_positive': size, 'slip_negative': 0.9 * size, 'damping': size, 'friction': size}
    return {each.name: {**TRUTH, **more}[each.name] for each in law.parameters}


def named(selection: ModelSelection) -> str:
    """What came out, in a word."""
    if selection.selected is None:
        return selection.verdict
    return (
        selection.selected.law.name
        if not selection.rivals
        else '|'.join(sorted((selection.selected.law.name, *selection.rivals)))
    )


def alarmed(motion: Motion) -> bool:
    """Whether the residual of law (6) is found to have structure."""
    residual = fit(BACKLASH, motion, motion.scored | ~motion.scored).residual
    return p_independent(dependences(motion, residual)) < LEVEL


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
        for law in CANDIDATES:
            for size in SIZES[law.name]:
                records = (
                    simulate_record(law, values(law, size), NOISE, seed, correlation) for seed in range(args.seeds)
                )
                counts = Counter(named(select_model(record)) for record in records)
                found[f'{law.name} {size:g}, correlation {correlation:g}'] = dict(counts)
    right = sum(counts.get(name.split()[0], 0) for name, counts in found.items() if not name.startswith('backlash'))
    total = sum(sum(counts.values()) for name, counts in found.items() if not name.startswith('backlash'))
    for name, counts in found.items():
        print(f'{name:40}', ', '.join(f'{word}: {count}' for word, count in counts.items()))
    missed = sum(counts.get(NONE, 0) + counts.get(UNEXPLAINED, 0) for name, counts in found.items() if name[0] != 'b')
    print(f'named alone and rightly: {right} of {total}; not named at all: {missed}')
    if args.json:
        args.json.write_text(json.dumps(found, indent=2) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
