"""Monitoring: false alarms and power of the drift monitor, names of changes, p-values of `compare` and `verify`.

    python -m benchmark.drift [--calibrations N] [--first N] [--per-disc N] [--alarm-touches N] [--pairs N]
                              [--only SECTION…] [--jobs N] [--json FILE]

Simulated by this package: the paper's cell with 72 touches for each calibration; *declared*: discs known to 15 µm in
place and 5 µm in radius, the tip's radius to 5 µm, gain of the force sensor to 0.5 %, its rotation to 1 mrad; *exact*:
all that is exactly known, noise alone; *nominal values*: as declared, and l1, theta1 and p_ee trusted to 5 µm, 20 µrad
and 0.2 µm/N, their errors drawn from that; *noise estimated*: from the residuals. Every calibration has its own errors
of the cell, and its touches of production are made in that cell. A change is one of 5 standard uncertainties of the
parameter, up or down at random. A *bad touch* is one of 2 %, its joint angles off by 0.1, 0.3 or 1 mrad.

*Bound* is what no monitor can exceed: the power of the one-sided test that knows which parameter changed, in which
sense and when, at the rate of false alarms of 1 in 1000, given the calibration. *Bound of names* is how often the best
test that knows the change tells it from the single change of another kind that looks most like it, both as likely.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import kstest

from benchmark.common import CELL, in_processes, parser, print_and_save
from benchmark.common import record_of as as_record
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.interface import simulate
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.change import CalibratedState, measure
from scara_kinetostatic.monitoring.comparison import compare
from scara_kinetostatic.monitoring.drift import DriftMonitor
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.verification import verify
from scara_kinetostatic.touches.detection import Detection

DECLARED = replace(
    CELL,
    discs=tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in CELL.discs),
    uncertainty=replace(CELL.uncertainty, radius=5e-6, force_gain=0.005, force_rotation=1e-3),
)
CELLS = {'declared': DECLARED, 'exact': CELL}
ESTIMATED = {f'{name}, noise estimated': replace(cell, noise=None) for name, cell in CELLS.items()}
TRUSTED = {
    'nominal values': replace(
        DECLARED, uncertainty=replace(DECLARED.uncertainty, nominal={'l1': 5e-6, 'theta1': 2e-5, 'p_ee': 2e-7})
    )
}
CHANGE = 5.0
"""Standard uncertainties."""
WITHIN = 20
"""Touches."""
BEFORE = 30
"""Touches of production before the change in half of the runs; none in the others."""
RATE = 1e-3
"""Accepted rate of false alarms per touch."""
BAD = 0.02
"""Part of the touches that are bad."""
OFF = (1e-4, 3e-4, 1e-3)
"""By what, rad."""


def drawn(cell: Cell, seed: int) -> Cell:
    """The cell with nominal values that are off the true ones as it declares them; without any as it is."""
    random, trusted = np.random.default_rng(seed), cell.uncertainty.nominal.items()
    off = {name: getattr(PAPER_ACTUAL, name) + std * random.standard_normal() for name, std in trusted}
    return replace(cell, nominal=PAPER_ACTUAL.replace(**off)) if off else cell


def touches_of(cell: Cell, seed: int, world: int, count: int, truth: Parameters = PAPER_ACTUAL) -> TouchSet:
    """Touches of production in a random order."""
    random, parts = np.random.default_rng(seed), []
    while sum(map(len, parts)) < count:
        made = simulate(cell, truth, seed=seed + 10_000_000 * len(parts), drawn=world)
        parts.append(made.select(random.permutation(len(made))))
    return TouchSet.concatenate(parts).select(np.arange(count))


def record_of(cell: Cell, seed: int, world: int, per_disc: int) -> CalibrationRecord:
    """A calibration."""
    made = simulate(cell, PAPER_ACTUAL, seed=seed, drawn=world, per_disc=per_disc)
    return as_record(calibrate(made, cell))


def with_bad(touches: TouchSet, seed: int) -> TouchSet:
    """The same, some of them bad."""
    random = np.random.default_rng(seed)
    off = random.choice([-1, 1], (len(touches), 2)) * random.choice(OFF, (len(touches), 1))
    return touches.replace(joints=touches.joints + off * (random.random((len(touches), 1)) < BAD))


@dataclass(frozen=True)
class Job:
    """One calibration and what is done with it."""

    section: str
    cell: str
    seed: int
    touches: int
    per_disc: int


class Drift(NamedTuple):
    """What became of one change."""

    name: str
    raised: bool
    delay: int
    named: bool
    rival: bool
    bound: float
    name_bound: float


def run(job: Job) -> Any:
    """One job."""
    cell = drawn((CELLS | ESTIMATED | TRUSTED)[job.cell], job.seed)
    record = record_of(cell, job.seed, job.seed, job.per_disc)
    if job.section in ('alarms', 'bad'):
        touches = touches_of(cell, 1_000_000 + job.seed, job.seed, job.touches)
        return _alarms(record, touches if job.section == 'alarms' else with_bad(touches, job.seed))
    if job.section == 'compare':
        return compare(record, record_of(cell, 2_000_000 + job.seed, job.seed, job.per_disc)).p_value
    if job.section == 'verify':
        touches = touches_of(cell, 3_000_000 + job.seed, job.seed, 40)
        return verify(Detection.of(touches), record).p_value
    return [_drift(record, cell, name, job.seed) for name in NAMES]


def _alarms(record: CalibrationRecord, touches: TouchSet) -> int:
    """False alarms; the monitor begins anew after each."""
    monitor, alarms = DriftMonitor(record), 0
    for k in range(len(touches)):
        if monitor.add(touches.select([k])) is not None:
            alarms += 1
            monitor.reset()
    return alarms


def _drift(record: CalibrationRecord, cell: Cell, name: str, seed: int) -> Drift:
    place, before = NAMES.index(name), BEFORE * (seed % 2)
    sign = 1 if (seed // 2) % 2 else -1
    row = record.place(name)
    std = float(np.sqrt(record.covariance[row, row]))
    truth = PAPER_ACTUAL.replace(**{name: getattr(PAPER_ACTUAL, name) + sign * CHANGE * std})
    monitor = DriftMonitor(record)
    if before:
        monitor.add(touches_of(cell, 4_000_000 + seed, seed, before))
        if monitor.alarm is not None:  # a false one
            monitor.reset()
    after = touches_of(cell, 5_000_000 + 100 * seed + place, seed, WITHIN, truth)
    delay = 0
    for k in range(WITHIN):
        raised = monitor.add(after.select([k])) is not None
        delay = delay or (k + 1 if raised else 0)
    alarm = monitor.alarm
    return Drift(
        name=name,
        raised=alarm is not None,
        delay=delay,
        named=alarm is not None and alarm.best.name == name,
        rival=alarm is not None and name in (alarm.best.name, *alarm.rivals),
        **_bounds(record, after, place, monitor),
    )


def _bounds(record: CalibrationRecord, touches: TouchSet, place: int, monitor: DriftMonitor) -> dict[str, float]:
    """Power of the best test, and of the best one that names, from no touches before the change."""
    state = CalibratedState.of(record)
    matrix = state.known.change(measure(touches, record, state).information()).matrix
    size = CHANGE * np.sqrt(record.covariance[place, place]) / state.scale[place]
    single = [h.places[0] for h in monitor.hypotheses if len(h.places) == 1 and h.places[0] != place]
    known = [other for other in single if matrix[other, other] > 0]
    apart = min(matrix[place, place] - matrix[place, other] ** 2 / matrix[other, other] for other in known)
    return {
        'bound': float(ndtr(size * np.sqrt(matrix[place, place]) + ndtri(RATE))),
        'name_bound': float(ndtr(size * np.sqrt(max(apart, 0.0)) / 2)),
    }


def main() -> int:
    """Run all sections."""
    made = parser(__doc__)
    made.add_argument('--calibrations', type=int, default=100, metavar='N', help='of alarms and changes')
    made.add_argument('--first', type=int, default=0, metavar='N', help='seed of the first calibration')
    made.add_argument('--alarm-touches', type=int, default=500, metavar='N', help='per calibration without a change')
    made.add_argument(
        '--per-disc', type=int, default=12, metavar='N', help='touches per disc and elbow of a calibration'
    )
    made.add_argument('--pairs', type=int, default=200, metavar='N', help='of compare and verify')
    made.add_argument('--only', nargs='+', choices=('alarms', 'bad', 'changes', 'compare', 'verify'), metavar='SECTION')
    made.add_argument('--jobs', type=int, default=1, metavar='N')
    args = made.parse_args()
    sections = args.only or ['compare', 'verify', 'changes', 'alarms', 'bad']
    figures: dict[str, Any] = {}
    for section in sections:
        cells = CELLS | {'compare': ESTIMATED | TRUSTED, 'verify': ESTIMATED | TRUSTED, 'alarms': ESTIMATED}.get(
            section, {}
        )
        for cell in cells:
            count = args.pairs if section in ('compare', 'verify') else args.calibrations
            jobs = [
                Job(section, cell, seed, args.alarm_touches, args.per_disc)
                for seed in range(args.first, args.first + count)
            ]
            found = list(in_processes(run, jobs, args.jobs))
            figures[f'{section}, {cell}'] = _summary(section, found, args.alarm_touches)
    print_and_save(args.json, figures)
    return 0


def _summary(section: str, found: Sequence[Any], touches: int) -> dict[str, Any]:
    if section in ('alarms', 'bad'):
        return {
            'touches': touches * len(found),
            'alarms': sum(found),
            'per 1000': 1e3 * sum(found) / touches / len(found),
        }
    if section in ('compare', 'verify'):
        test = kstest(found, 'uniform')
        below = {f'below {level:g}': float(np.mean(np.array(found) < level)) for level in (0.01, 0.05)}
        return {'pairs': len(found), 'KS p-value': float(test.pvalue), **below}
    by_name = {name: [item for part in found for item in part if item.name == name] for name in NAMES}
    return {
        name: {
            'raised': float(np.mean([item.raised for item in items])),
            'bound': float(np.mean([item.bound for item in items])),
            'median delay': float(np.median([item.delay or np.inf for item in items])),
            'named': _share([item.named for item in items if item.raised]),
            'named or rival': _share([item.rival for item in items if item.raised]),
            'bound of names': float(np.mean([item.name_bound for item in items])),
        }
        for name, items in by_name.items()
    }


def _share(flags: Sequence[bool]) -> float:
    return float(np.mean(flags)) if len(flags) else float('nan')


if __name__ == '__main__':
    sys.exit(main())
