"""The assessment of simulated results: which must not be fit, and which must.

    python -m benchmark.assessment [--runs 500] [--each 20] [--first 0] [--declared] [--jobs 1] [--json FILE]

- Not fit: results with one thing wrong, `--each` recordings of every kind, with other noise each.
- Good: `--runs` recordings of three cells, 24 to 108 touches, in an even plan or at random places, noise given and
  estimated; every fourth with an effect that is found and corrected.

`--first` is the first seed. With `--declared` the cells declare uncertainties, from which the places and radii of the
true discs are drawn, and a tolerance that they meet. Targets: none of the first is fit, 98 % of the second are.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from benchmark.common import CELL, NOISE, in_processes, parser, print_targets, save
from benchmark.diagnosis.cells import FOUR_DISCS
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.cell import Cell, Disc, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

GOOD, LEAST_GOOD = 500, 0.98
TWO_SIZES = (Disc('left', -0.30, 0.28, 0.04), Disc('middle', 0.10, 0.42, 0.06), Disc('right', 0.38, -0.12, 0.09))
CELLS = {
    'paper': (CELL, PAPER_ACTUAL),
    'soft': (replace(CELL, discs=FOUR_DISCS), PAPER_MEASURED),
    'small discs': (replace(CELL, discs=TWO_SIZES), PAPER_ACTUAL.replace(l1=0.3297, x0=-1.2e-3, g1=1.5e-4)),
}
EFFECTS = (
    'object_radius[{disc}]:radius=6e-5',
    'object_position[{disc}]:x=1.2e-4,y=-2e-4',
    'encoder_gain[joint2]:gain=1e-3',
    'sensor_rotation:angle=0.02',
)
"""Ordinary ones, of a size that is found."""
FEWEST_WITH_EFFECT = 72
CENTER_STD, RADIUS_STD, TOLERANCE = 1.5e-5, 5e-6, 5e-4


class Case(NamedTuple):
    """A recording to be assessed: touches, the cell as stated, parameters held."""

    touches: TouchSet
    cell: Cell
    fixed: Mapping[str, float] = MappingProxyType({})


class Task(NamedTuple):
    """What one process does: a kind, `good` or a key of `NOT_FIT`, and a seed."""

    kind: str
    seed: int
    declared: bool


class Record(NamedTuple):
    """What came of it."""

    kind: str
    seed: int
    detail: str
    grade: str
    verdict: str
    reason: str


def touch(plan: Plan, seed: int, cell: Cell = CELL, truth: Parameters = PAPER_ACTUAL, noise: Noise = NOISE) -> TouchSet:
    """Touches of a robot without effects."""
    return simulate_touches(cell, with_effects(truth, []), plan, noise, seed)


def restated(cell: Cell, number: int, x: float = 0.0, y: float = 0.0, radius: float = 0.0) -> Cell:
    """The cell with one disc stated otherwise."""
    discs = list(cell.discs)
    old = discs[number]
    discs[number] = old._replace(x=old.x + x, y=old.y + y, radius=old.radius + radius)
    return replace(cell, discs=tuple(discs))


def _few(seed: int) -> Case:
    plan = default_plan(CELL, 12)
    some = np.random.default_rng([seed, 1]).choice(len(plan), 8, replace=False)
    return Case(touch(plan.select(np.sort(some)), seed), CELL)


def _all_radii(by: float) -> Callable[[int], Case]:
    def make(seed: int) -> Case:
        cell = replace(CELL, discs=tuple(disc._replace(radius=disc.radius + by) for disc in CELL.discs))
        return Case(touch(default_plan(CELL, 12), seed), cell)

    return make


def _moved_disc(seed: int) -> Case:
    """disc_2 moves between two recordings of which the second is the shorter."""
    first = touch(default_plan(CELL, 12), seed)
    second = touch(default_plan(CELL, 5), seed + 1000, restated(CELL, 1, 3e-4, -2e-4))
    second = second.replace(index=second.index + len(first), order=second.order + len(first))
    second = second.replace(recording=np.ones(len(second), dtype=np.intp))
    return Case(TouchSet.concatenate([first, second]), CELL)


def _one_level(seed: int) -> Case:
    return Case(touch(default_plan(CELL, 12, levels=(40.0,)), seed), CELL)


def _one_disc(seed: int) -> Case:
    cell = replace(CELL, discs=CELL.discs[:1])
    return Case(touch(default_plan(cell, 18), seed, cell), cell)


def _beyond_tolerance(seed: int) -> Case:
    return Case(touch(default_plan(CELL, 6), seed), replace(CELL, tolerance=6e-6))


def _lone_posture(seed: int) -> Case:
    """One elbow posture, and one touch in the other."""
    plan = default_plan(CELL, 12)
    right = np.flatnonzero(plan.posture < 0)
    some = np.concatenate([np.flatnonzero(plan.posture > 0)[:10], right[:1]])
    return Case(touch(plan.select(np.sort(some)), seed), CELL)


def _one_posture(seed: int) -> Case:
    return Case(touch(default_plan(CELL, 18, postures=(1,)), seed), CELL)


def _near_discs(seed: int) -> Case:
    cell = replace(CELL, discs=(Disc('a', 0.30, 0.2, 0.02), Disc('b', 0.36, 0.2, 0.02)))
    return Case(touch(default_plan(cell, 18), seed, cell), cell)


def _outliers(seed: int) -> Case:
    random = np.random.default_rng([seed, 2])
    touches = touch(default_plan(CELL, 12), seed)
    joints = touches.joints.copy()
    which = random.choice(len(joints), 11, replace=False)
    joints[which] += random.choice([-1, 1], (11, 2)) * random.uniform(5e-4, 2e-3, (11, 2))
    return Case(touches.replace(joints=joints), CELL)


def _span(seed: int) -> Case:
    touches = touch(default_plan(CELL, 12), seed)
    joints = touches.joints.copy()
    joints[30:38] += np.random.default_rng([seed, 3]).normal(0.0, 6e-4, (8, 2))
    return Case(touches.replace(joints=joints), CELL)


def _unknown_effect(seed: int) -> Case:
    touches = touch(default_plan(CELL, 12), seed)
    joints = touches.joints.copy()
    joints[:, 0] += 2e-4 * np.sin(2 * joints[:, 1])
    return Case(touches.replace(joints=joints), CELL)


def _noise(factor: float) -> Callable[[int], Case]:
    def make(seed: int) -> Case:
        return Case(touch(default_plan(CELL, 12), seed, noise=Noise(factor * 1e-5, factor * 0.3)), CELL)

    return make


def _wrong_fixed(seed: int) -> Case:
    return Case(touch(default_plan(CELL, 12), seed), CELL, {'l1': 0.3295})


def _shaky_joints(seed: int) -> Case:
    cell = replace(CELL, noise=None)
    return Case(touch(default_plan(CELL, 12), seed, noise=Noise(1.5e-4, 0.3)), cell)


NOT_FIT: dict[str, Callable[[int], Case]] = {
    '8 touches': _few,
    'all radii 1 mm short': _all_radii(-1e-3),
    'disc_2 moves between recordings': _moved_disc,
    'tip uncertainty beyond the tolerance': _beyond_tolerance,
    'one force level': _one_level,
    'one disc': _one_disc,
    'all radii 1 mm too large': _all_radii(1e-3),
    '11 touches, one in the other posture': _lone_posture,
    'one elbow posture': _one_posture,
    'two small discs side by side': _near_discs,
    '11 of 72 touches bad': _outliers,
    '8 bad touches in a row': _span,
    'an effect without a name': _unknown_effect,
    'noise stated 5 times too small': _noise(5.0),
    'noise stated 5 times too large': _noise(0.2),
    'l1 held at a wrong value': _wrong_fixed,
    'joints repeat to 0.15 mrad, noise estimated': _shaky_joints,
}


def good(seed: int, declared: bool) -> tuple[Case, str]:
    """A good recording, and what it is."""
    random = np.random.default_rng([seed, 4])
    name = list(CELLS)[seed % len(CELLS)]
    cell, truth = CELLS[name]
    stated = replace(cell, noise=None) if random.random() < 0.5 else cell
    effects = random.random() < 0.25
    number = int(random.integers(FEWEST_WITH_EFFECT if effects else 24, 109))
    even = bool(random.random() < 0.7)
    plan = _plan(cell, number, even, random)
    text = EFFECTS[random.integers(len(EFFECTS))].format(disc=cell.discs[random.integers(len(cell.discs))].name)
    robot = with_effects(truth, [parse_effect(text, cell)] if effects else [])
    true = cell
    if declared:
        true, stated = _drawn(cell, random), _declared(stated)
    touches = simulate_touches(true, robot, plan, NOISE, seed)
    detail = f'{name}, {len(plan)} touches, {"even" if even else "random"}, noise {"given" if stated.noise else "est."}'
    return Case(touches, stated), f'{detail}, {text}' if effects else detail


def _plan(cell: Cell, number: int, even: bool, random: np.random.Generator) -> Plan:
    """So many touches, or nearly so: all round the discs, or at random places of a dense plan."""
    if even:
        per_disc = next(per for per in range(3, 40) if len(default_plan(cell, per)) >= number)
        return default_plan(cell, per_disc, preload=0.3)
    dense = default_plan(cell, 36, preload=0.3)
    return dense.select(np.sort(random.choice(len(dense), number, replace=False)))


def _drawn(cell: Cell, random: np.random.Generator) -> Cell:
    """The cell as it really is: places and radii drawn from their uncertainties."""
    for number in range(len(cell.discs)):
        cell = restated(cell, number, *random.normal(0, CENTER_STD, 2).tolist(), float(random.normal(0, RADIUS_STD)))
    return cell


def _declared(cell: Cell) -> Cell:
    discs = tuple(disc._replace(center_std=CENTER_STD, radius_std=RADIUS_STD) for disc in cell.discs)
    return replace(cell, discs=discs, tolerance=TOLERANCE)


def run_task(task: Task) -> Record:
    """One recording, assessed."""
    case, detail = good(task.seed, task.declared) if task.kind == 'good' else (NOT_FIT[task.kind](task.seed), '')
    cell = _declared(case.cell) if task.declared and task.kind != 'good' and not case.cell.tolerance else case.cell
    try:
        outcome = calibrate_touches(case.touches, cell, fixed=case.fixed)
    except ScaraKinetostaticError as error:
        return Record(task.kind, task.seed, detail, 'error', '', str(error))
    found = outcome.assessment
    return Record(task.kind, task.seed, detail, found.grade.value, outcome.verdict, found.reasons[0])


def _run(tasks: Sequence[Task], jobs: int) -> Iterator[Record]:
    """All tasks; a bad grade is printed at once."""
    for number, record in enumerate(map(run_task, tasks) if jobs == 1 else in_processes(run_task, tasks, jobs), 1):
        if (record.grade == 'fit') != (record.kind == 'good'):
            which = f'{record.kind}, seed {record.seed} ({record.detail})'
            print(f'  {number}. {which}: {record.grade}, {record.verdict}: {record.reason}', flush=True)
        yield record


def summarise(records: Sequence[Record]) -> tuple[dict[str, Any], bool]:
    """Prints the grades of each kind; whether the targets are met."""
    grades: dict[str, Counter[str]] = {}
    for record in records:
        grades.setdefault(record.kind, Counter())[record.grade] += 1
    print(f'{"":46} fit caution unfit error')
    for kind, count in grades.items():
        print(f'{kind:46} {count["fit"]:3d} {count["caution"]:7d} {count["unfit"]:5d} {count["error"]:5d}')
    passed = sum(count['fit'] for kind, count in grades.items() if kind != 'good')
    share = grades['good']['fit'] / max(grades['good'].total(), 1) if 'good' in grades else 1.0
    targets = [(f'none of the others fit: {passed}', passed == 0), (f'good ones fit: {share:.1%}', share >= LEAST_GOOD)]
    return {kind: dict(count) for kind, count in grades.items()}, print_targets(targets)


def main() -> int:
    """Runs the benchmark."""
    options_of = parser(__doc__)
    options_of.add_argument('--runs', type=int, default=GOOD)
    options_of.add_argument('--each', type=int, default=20)
    options_of.add_argument('--first', type=int, default=0)
    options_of.add_argument('--declared', action='store_true')
    options_of.add_argument('--jobs', type=int, default=1)
    options = options_of.parse_args()
    first, declared = options.first, options.declared
    tasks = [Task(kind, first + k, declared) for kind in NOT_FIT for k in range(options.each)]
    tasks += [Task('good', first + k, declared) for k in range(options.runs)]
    records = list(_run(tasks, options.jobs))
    summary, met = summarise(records)
    save(options.json, {'summary': summary, 'records': [record._asdict() for record in records]})
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())
