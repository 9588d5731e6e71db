"""One large flaw of a robot whose other errors are none: a small arm, two discs, 56 touches, sensor in the tool frame.

    python -m benchmark.lone_flaws [--robots N] [--first N] [--size N] [--effect LABEL] [--jobs N] [--json FILE]

Each effect of the catalogue in a random way, so many times its typical size (default: 10); discs not declared, the
noise given and estimated in turn. Whether it is named, alone or among rivals; whether the parameters are within 5
standard deviations.

Beside it what any test could do that knows the kind of the flaw: the likelihood ratio of the true model against the
base model, or against the special case that is named in its place, beyond what one robot in a hundred without a flaw
gives somewhere in the catalogue. Where the touches show less, no test names it, and no uncertainty that is right for a
robot without a flaw covers it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmark.common import NO_OTHERS, in_processes, parser, save
from benchmark.diagnosis.cells import NOISE, PRELOAD, Setup, SimulatedEffects, random_values, seed_of, simulate
from benchmark.diagnosis.runs import ALIAS_OF
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.interface import diagnose as assessed
from scara_kinetostatic.model.cell import Cell, Disc, Sensor, SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import default_plan

DISCS = Disc('disc_1', 0.20, 0.16, 0.04), Disc('disc_2', -0.22, 0.10, 0.05)
FALSE_ALARMS, FORMS = 0.01, 50
"""Of the test; forms among which it looks for a step or a wave."""
LARGEST_Z = 5.0


class Task(NamedTuple):
    """One robot."""

    label: str
    size: float
    seed: int


@cache
def small() -> Setup:
    """Links of 0.25 and 0.20 m."""
    cell = Cell(PAPER_NOMINAL.replace(l1=0.25, l2=0.20), DISCS, noise=NOISE, sensor=Sensor(frame=SensorFrame.TOOL))
    return Setup(cell, PAPER_ACTUAL.replace(l1=0.2502, l2=0.1998), default_plan(cell, 14, preload=PRELOAD))


def flaw(task: Task) -> SimulatedEffects:
    """The effect of a task."""
    random = np.random.default_rng([task.seed, seed_of(task.label, 'flaw')])
    return of_size(find(small().cell, task.label), task.size, random)


def of_size(effect: Effect, size: float, random: np.random.Generator) -> SimulatedEffects:
    """An effect in a random way, of a size in its typical one."""
    values = random_values(effect, random)
    amplitudes = effect.amplitudes(values)
    acts = amplitudes != 0
    typical = np.array([effect.size(k) if acts[k] else 1.0 for k in range(len(values))])
    part = amplitudes / np.array([p.scale for p in effect.parameters])[: len(values)]
    return SimulatedEffects((effect,), (np.where(acts, size * part / np.linalg.norm(part) * typical, values),))


def _misfit(touches: TouchSet, model: ExtendedModel) -> float:
    """χ² of all touches of a fit with the effects of a model, nothing undetected, noise given, from the model on."""
    warm = WarmStart(model, NOISE, np.ones(len(touches), dtype=bool))
    cell = replace(small().cell, uncertainty=NO_OTHERS)
    return float(calibrate(touches, cell, model.effects, warm_start=warm).projection.distance.sum())


def run_task(task: Task) -> dict[str, Any]:
    """A robot calibrated, diagnosed and judged."""
    record: dict[str, Any] = task._asdict()
    setup, simulated = small(), flaw(task)
    effect = simulated.effects[0]
    try:
        touches = simulate(setup, simulated, seed=seed_of(*task))
        before = calibrate(touches, setup.cell if task.seed % 2 else replace(setup.cell, noise=None))
        found = diagnose(before)
        final = found.extended or found.refitted or before
        plain, true = ExtendedModel(setup.truth), _misfit(touches, simulated.robot(setup.truth))
        gain = {'': _misfit(touches, plain) - true}
        for label in effect.special_cases:
            gain[label] = _misfit(touches, plain.with_effects((find(setup.cell, label),))) - true
    except ScaraKinetostaticError as error:
        return record | {'failure': str(error)}
    forms = FORMS if effect.is_stepwise or effect.grid_parameter else 1
    limit = float(chi2.isf(FALSE_ALARMS / len(catalogue(setup.cell)) / forms, len(effect.parameters)))
    names = {item.effect.label for item in found.found}.union(*map(set, found.rivals))
    z = float(np.nanmax(np.abs(final.parameters.as_array() - setup.truth.as_array()) / final.std))
    grade = assessed(touches, before.cell).assessment.grade.value if z > LARGEST_Z else ''
    right = {ALIAS_OF.get(task.label, task.label), *(label for label, more in gain.items() if more <= limit)}
    return record | {
        'verdict': found.verdict,
        'names': sorted(names),
        'gain': gain[''],
        'shows': gain[''] > limit,
        'named': bool(names & right),
        'z': z,
        'grade': grade,
    }


def main() -> int:
    """Run, print, save."""
    options = parser(__doc__)
    options.add_argument('--robots', type=int, default=20, help='of each effect (default: 20)')
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--size', type=float, default=10.0, help='of the flaw, in its typical size (default: 10)')
    options.add_argument('--effect', metavar='LABEL', help='only this one')
    options.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    given = options.parse_args()
    labels = [given.effect] if given.effect else [effect.label for effect in catalogue(small().cell)]
    seeds = range(given.first, given.first + given.robots)
    tasks = [Task(label, given.size, seed) for seed in seeds for label in labels]
    every = list(in_processes(run_task, tasks, given.jobs))
    records = [record for record in every if 'failure' not in record]
    print(f'{len(every)} robots, {len(every) - len(records)} could not hold a touch')
    for shows, what in ((True, 'touches show it'), (False, 'no test names it')):
        group = [record for record in records if record['shows'] is shows]
        off = [record for record in group if record['z'] > LARGEST_Z]
        print(f'{what}: {len(group)}, named {sum(r["named"] for r in group)}, beyond {LARGEST_Z:g} std {len(off)}')
        for record in group:
            if record['z'] > LARGEST_Z or (shows and not record['named']):
                text = ', '.join(record['names']) or '-'
                print(
                    f'  {record["label"]} {record["seed"]}: gain {record["gain"]:.0f}, {record["verdict"]}: {text}; '
                    f'{record["z"]:.1f} std {record["grade"]}'
                )
    save(given.json, every)
    return 0


if __name__ == '__main__':
    sys.exit(main())
