"""A calibration brought up to date by a few touches: `calibrate --from`, the touches planned by `next --from`.

    python -m benchmark.update [--robots N] [--first N] [--kind KIND ...] [--touches N] [--jobs N] [--json FILE]

Each robot is calibrated by 60 touches, then a part is changed: the tool (l2 by 1 mm, theta2 by 3 mrad, p_ee and g_ee),
the zero of joint 1, both zeros (by 3 mrad), or nothing; or a joint slips by 200 µrad, with nothing freed or beside a
new tool.
Touches of the changed robot are planned and simulated, and the earlier calibration is brought up to date.

Beside each other: the expanded uncertainty of the tip after the update, by the 60 touches before, and by 60 of the
changed robot from nothing; what is stated of the tip over its actual error, at places and forces of the touches from
nothing; errors of the parameters in standard uncertainties; grades; whether a slip is named.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmark.common import in_processes, parser, save
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.interface import diagnose, simulate
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.update import freed_names, update
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World
from scara_kinetostatic.touches.detection import Detection

FREED = {
    'nothing': [],
    'tool': ['tool'],
    'homed': ['theta1'],
    'zeros': ['zeros'],
    'slip': [],
    'slip beside tool': ['tool'],
}
"""What is freed, by kind."""
SPREAD = dict(zip(NAMES, (2e-4, 2e-4, 1e-3, 2e-4, 1e-3, 2e-4, 2e-6, 2e-6, 2e-6, 1e-5, 3e-5, 3e-5), strict=True))
"""Standard deviations of the robots about the nominal values; backlashes are not negative."""
SLIP = 2e-4
CELL = load_cell(Path(__file__).parents[1] / 'config' / 'cell.yaml')


class Task(NamedTuple):
    """One robot."""

    kind: str
    seed: int
    touches: int


def changed(kind: str, robot: Parameters, rng: np.random.Generator) -> tuple[Parameters, str]:
    """The robot afterwards, and the zero that has slipped."""
    values, slipped = robot.as_dict(), ''
    if 'tool' in kind:
        values |= {'l2': robot.l2 + 1e-3 * rng.normal(), 'theta2': robot.theta2 + 3e-3 * rng.normal()}
        values |= {'p_ee': robot.p_ee * rng.uniform(0.7, 1.4), 'g_ee': abs(2e-5 * rng.normal())}
    if kind in ('homed', 'zeros'):
        values['theta1'] += 3e-3 * rng.normal()
    if kind == 'zeros':
        values['theta2'] += 3e-3 * rng.normal()
    if 'slip' in kind:
        slipped = 'theta1' if 'tool' in kind else str(rng.choice(['theta1', 'theta2']))
        values[slipped] += SLIP * rng.choice([-1, 1])
    return robot.replace(**{name: values[name] for name in NAMES}), slipped


def run(task: Task) -> dict[str, Any]:
    """The figures of one robot."""
    rng, world = np.random.default_rng(task.seed), World.draw(CELL, np.random.default_rng(task.seed))
    drawn = {name: getattr(CELL.nominal, name) + std * rng.normal() for name, std in SPREAD.items()}
    robot = CELL.nominal.replace(**{name: abs(value) if name[0] == 'g' else value for name, value in drawn.items()})
    first = diagnose(simulate(CELL, robot, per_disc=10, seed=task.seed, drawn=task.seed), CELL)
    record = CalibrationRecord.of_outcome(first)
    after, slipped = changed(task.kind, robot, rng)
    freed = freed_names(FREED[task.kind], record)
    planner = replace(record.planner(CELL, record.touches), freed=freed)
    plan = (planner.accurate(task.touches) if task.touches else planner.fewest()).plan
    touches = world.reported(simulate_touches(world.cell, after, plan, CELL.noise, task.seed + 1))
    found = update(Detection.of(touches), record, CELL, freed)
    anew = diagnose(simulate(CELL, after, per_disc=10, seed=task.seed + 2, drawn=task.seed), CELL)
    joints, force = anew.final.touches.joints, anew.final.force
    stated = Predictor(found.arm).locate(joints, force)
    off = stated.position - direct_kinetostatics(after, joints, force)[0]
    z = {name: (found[name].value - getattr(after, name)) / found[name].std for name in NAMES}
    assert found.earlier is not None
    causes = found.earlier.causes
    return {
        'kind': task.kind,
        'seed': task.seed,
        'touches': len(plan),
        'grade': found.assessment.grade.value,
        'contradicted': bool(found.earlier.contradiction),
        'possible': slipped and slipped in ((causes['part'] or {}).get('name'), *causes['rivals']),
        'named': slipped and (causes['part'] or {}).get('name') == slipped,
        'tip': found.tip_uncertainty.worst,
        'over the earlier': found.tip_uncertainty.worst / first.tip_uncertainty.worst,
        'over 60 from nothing': found.tip_uncertainty.worst / anew.tip_uncertainty.worst,
        'stated over actual': float(np.sqrt((stated.std**2).sum() / (off**2).sum())),
        'largest z': max(z.values(), key=abs),
        'rms z': float(np.sqrt(np.mean(np.square([*z.values()])))),
    }


def main() -> int:
    """Prints a row for each kind."""
    options_of = parser(__doc__)
    options_of.add_argument('--robots', type=int, default=20)
    options_of.add_argument('--first', type=int, default=1000)
    options_of.add_argument('--kind', nargs='+', choices=FREED, default=[*FREED])
    options_of.add_argument('--touches', type=int, default=0, help='how many (default: as planned)')
    options_of.add_argument('--jobs', type=int, default=2)
    options = options_of.parse_args()
    numbers = range(options.first, options.first + options.robots)
    tasks = [Task(kind, seed, options.touches) for kind in options.kind for seed in numbers]
    rows = [*in_processes(run, tasks, options.jobs)]
    for kind in options.kind:
        own = [row for row in rows if row['kind'] == kind]
        print(f'{kind}: {len(own)} robots, touches {dict(Counter(row["touches"] for row in own))}')
        print(
            f'  grades {dict(Counter(row["grade"] for row in own))}, contradicted {sum(r["contradicted"] for r in own)}'
        )
        if 'slip' in kind:
            named, possible = (sum(map(bool, (row[key] for row in own))) for key in ('named', 'possible'))
            print(f'  named as the likeliest {named}, among the likely {possible}')
            continue
        for key in ('tip', 'over the earlier', 'over 60 from nothing', 'stated over actual', 'rms z', 'largest z'):
            values = [abs(row[key]) for row in own]
            print(f'  {key}: {np.median(values):.3g} (median), {min(values):.3g} to {max(values):.3g}')
    save(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
