"""Odds of gross effects among small errors: what is named, whether stated probabilities hold, the tip, time.

    python -m benchmark.odds [--recordings N] [--first SEED] [--kind row1|disc|base|gain|friction] [--by KEY]
                             [--jobs N] [--log FILE] [--touches DIR] [--picture FILE.svg]
    python -m benchmark.odds --compare FILE.jsonl... [--by KEY] [--picture FILE.svg]

All touches are simulated. A recording has 30 to 150 touches (log-uniform) of an even plan in both postures, in one of
`cells`, of a robot some millimetres off its nominal values. None, one or two effects of the catalogue (40, 40, 20 %)
are gross: of 1 to 10 typical sizes (log-uniform). Every other effect is a small error, normal with its typical size
times the factor of the population, 1/3, 1 or 3. In every other recording, at random, the objects are declared to 3 µm,
with radii to 2 µm, and are so well where they are said to be. The noise is stated in three of four.

What counts: gross effects are the truth, and needed. A small error with an amplitude beyond 3 sizes of its population
is right where it is named, but not needed. In place of an effect one that it contains (`special_cases`), or whose
prediction is the same, is right, too. Any other name is wrong; of those it is counted how many are errors beyond 3
typical sizes, as a large population has. A gross effect that is not named is among the rivals or missed. An alarm is a
verdict other than ``none`` where nothing is gross.

The tip is that of every place of the map of its uncertainty under the mean force in a random direction. Stated over
actual is the median of the map over √2 times the rms error: 1 for normal errors with equal axes and k = 2. Covered are
places whose error is within the map.

With ``--kind`` the paper's cell, its discs declared, the noise stated, 30 to 108 touches: ``row1`` are robots whose
only error is disc_2, 90 and −60 µm off its place; the others have one effect of `KINDS` among small errors of typical
size. ``--log`` writes a line of JSON for every recording, ``--compare`` shows such files side by side, of the
recordings that they have in common.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from benchmark.common import NOISE, in_processes, json_value, parser, svg_figure
from benchmark.diagnosis.cells import PRELOAD, seed_of
from benchmark.diagnosis.runs import ALIAS_OF, ALIASES
from benchmark.lone_flaws import of_size, small
from benchmark.next import true_robot
from benchmark.outlines import OBJECTS, cell_with
from benchmark.population import errors_of
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

Record = dict[str, Any]

FACTORS = (1 / 3, 1.0, 3.0)
NUMBERS = (0.4, 0.4, 0.2)
"""Probabilities of no, one and two gross effects."""
LEAST_TOUCHES, MOST_TOUCHES, MOST_OF_KIND = 30, 150, 108
DECLARED = {'object_position': 3e-6, 'object_radius': 2e-6, 'object_offset': 2e-6, 'object_rotation': 3e-5}
"""Standard uncertainty of what is declared of an object, by the effect that it may have: m, rad."""
LARGE = 3.0
"""A small error beyond so many sizes of its population is right where it is named."""
KINDS: dict[str, tuple[list[str], float]] = {
    'row1': (['object_position[disc_2]'], 0.0),  # of `ROW_1`
    'disc': ([f'object_position[disc_{k}]' for k in (1, 2, 3)], 11.0),  # 110 µm
    'base': (['base_compliance'], 5.0),
    'gain': (['encoder_gain[joint1]', 'encoder_gain[joint2]'], 5.0),  # 1e-4
    'friction': (['contact_friction'], 7.5),  # 0.03
}
"""The effects of which a recording of a kind has one, and its size in typical ones."""
ROW_1, ROW_1_COUNT = (9e-5, -6e-5), 12
"""Displacement of disc_2, m, and number of recordings, of 30 to 108 touches in turn."""
BANDS = (0.5, 0.8, 0.95, 0.99, 1.0)
LARGEST_RATIO = 4.0
DIAGNOSED = 0.3, 0.8
"""Progress of a calibration at which the diagnosis begins and ends."""


class Task(NamedTuple):
    """One recording; of no kind where the kind is empty; simulated touches are kept in the folder."""

    kind: str
    seed: int
    folder: Path | None = None


class Drawn(NamedTuple):
    """A recording, and what is true.

    Attributes:
        record: what it is, for the log: its gross effects by label with their typical sizes, and the labels of small
            errors beyond `LARGE` sizes of their population.
        cell: as described.
        robot: with all its errors.
        plan: of its touches.
    """

    record: Record
    cell: Cell
    robot: ExtendedModel
    plan: Plan

    def touches(self, task: Task) -> TouchSet:
        """Its touches, read where the same robot has made them before.

        Raises:
            UnsupportedDataError: the robot cannot hold one.
        """
        file = task.folder and task.folder / f'{task.seed}_{seed_of(self.robot.names, *self.robot.as_array())}.npz'
        if file and file.exists():
            return TouchSet(**np.load(file))
        made = simulate_touches(self.cell, self.robot, self.plan, NOISE, task.seed)
        if file:
            np.savez(file, **vars(made))
        return made


@cache
def cells() -> dict[str, Cell]:
    """The paper's, two discs beside a block, and a small arm with two discs."""
    two = {'left': 'center: [-0.25, 0.25], radius: 0.07', 'right': OBJECTS['disc']}
    return {
        'paper': load_cell(Path(__file__).parents[1] / 'config' / 'cell.yaml'),
        'three objects': cell_with(**two, block=OBJECTS['block']),
        'small arm': small().cell,
    }


def declaring(cell: Cell, declared: bool) -> Cell:
    """A cell whose objects are declared as in `DECLARED`, or not at all."""
    position, radius, _, angle = (declared * size for size in DECLARED.values())
    objects = [d._replace(center_std=position, radius_std=radius) for d in cell.discs]
    turned = (d._replace(angle_std=angle) if isinstance(d, Outline) else d for d in objects)
    return replace(cell, discs=tuple(turned))


def even(cell: Cell, number: int) -> Plan:
    """So many touches of the even plan that is hardly longer."""
    per_disc = -(-number // (2 * len(cell.discs)))
    while len(plan := default_plan(cell, per_disc, preload=PRELOAD)) < number:
        per_disc += 1
    return plan.select(np.arange(number))


def draw(task: Task) -> Drawn:
    """The recording of a task; what an effect draws does not depend on the rest of the catalogue."""
    random, row1 = np.random.default_rng([task.seed, seed_of('odds', task.kind)]), task.kind == 'row1'
    name, factor, number = str(random.choice(list(cells()))), float(random.choice(FACTORS)), random.choice(3, p=NUMBERS)
    declared, stated = bool(random.random() < 0.5), bool(random.random() < 0.75)
    most, part = MOST_OF_KIND if task.kind else MOST_TOUCHES, random.random()
    if task.kind:
        name, factor, declared, stated = 'paper', 0.0 if row1 else 1.0, True, True
        part = task.seed % ROW_1_COUNT / (ROW_1_COUNT - 1) if row1 else part
    touches = round(LEAST_TOUCHES * (most / LEAST_TOUCHES) ** part)
    cell = declaring(replace(cells()[name], noise=NOISE if stated else None), declared)
    base = PAPER_ACTUAL if row1 else true_robot(cell, random)
    own = {e: np.random.default_rng([task.seed, seed_of('odds', task.kind, e.label)]) for e in catalogue(cell)}
    labels, size = KINDS.get(task.kind, ([], 0.0))
    first = sorted((rng.random(), k) for k, (e, rng) in enumerate(own.items()) if e.label != ALIASES[0])
    gross = [find(cell, random.choice(labels))] if labels else [[*own][k] for _, k in first[:number]]
    errors = {e: of_size(e, size or float(10 ** own[e].uniform()), own[e]).values[0] for e in gross}
    errors = dict.fromkeys(gross, np.array(ROW_1)) if row1 else errors
    truth = typical_sizes(errors.items())
    large = []
    for effect, of_effect in own.items():
        if factor and effect not in errors:
            sizes = sizes_of(effect, factor, DECLARED if declared else {})
            free = [not p.is_alias for p in effect.parameters]
            errors[effect] = np.array(errors_of(effect, sizes[free], of_effect))
            if np.abs(effect.amplitudes(errors[effect]) / sizes).max() > LARGE:
                large.append(effect.label)
        if effect.is_stepwise and effect in errors:
            errors[effect][-1] = of_effect.integers(touches // 6, touches - touches // 6) + 0.5
    robot = ExtendedModel(base, tuple(errors), tuple(tuple(values.tolist()) for values in errors.values()))
    about = {'cell': name, 'factor': factor, 'declared': declared, 'stated': stated, 'touches': touches}
    record = {'kind': task.kind, 'seed': task.seed, **about, 'truth': truth, 'large': large}
    return Drawn(record, cell, robot, even(cell, touches))


def typical_sizes(errors: Iterable[tuple[Any, Floats]]) -> dict[str, float]:
    """The size of each of some errors in typical ones, by label."""
    return {effect.label: float(np.linalg.norm(effect.amplitudes(v) / sizes_of(effect))) for effect, v in errors}


def sizes_of(effect: Effect, factor: float = 1.0, declared: Mapping[str, float] | None = None) -> Floats:
    """The size of each parameter of an effect in a population, (k,)."""
    usual = [factor * effect.size(k) for k in range(len(effect.parameters))]
    return np.array([(declared or {}).get(effect.name, size) for size in usual])


def run_task(task: Task) -> Record:
    """A recording calibrated and judged."""
    drawn, clock = draw(task), dict[float, float]()

    def note(_: str, part: float) -> None:
        clock.setdefault(part, process_time())

    stage = 'not simulated'
    try:
        touches = drawn.touches(task)
        stage = 'failure'
        outcome = calibrate_touches(touches, drawn.cell, progress=note)
        tip = judge_tip(outcome, drawn.robot, np.random.default_rng([task.seed, 7]))
        grade = outcome.assessment.grade.value
    except ScaraKinetostaticError as error:
        return drawn.record | {stage: str(error)}
    found = outcome.diagnosis
    begun, ended = (clock[part] for part in DIAGNOSED)
    sizes = typical_sizes(zip(drawn.robot.effects, drawn.robot.effect_arrays, strict=True))
    rivals, inclusion = {label for group in found.rivals for label in group}, dict(getattr(found, 'inclusion', {}))
    names = [item.effect.label for item in found.found if item.is_found and item.effect.is_physical]
    return drawn.record | {
        'verdict': found.verdict,
        'names': names,
        'rivals': sorted(rivals),
        'inclusion': inclusion,
        'sizes': {label: sizes.get(label, 0.0) for label in sorted({*names, *rivals, *inclusion})},
        'chi_square': outcome.calibration.reduced_chi_square,
        'p_value': found.p_value,
        'grade': grade,
        'seconds': ended - begun,
        'tip': tip,
    }


def judge_tip(outcome: Outcome, robot: ExtendedModel, random: np.random.Generator) -> dict[str, float]:
    """How far the tip is off at the places of the map of its uncertainty, and what is stated, m."""
    tip, final = outcome.tip_uncertainty, outcome.final
    size, predictor = float(np.hypot(*final.force[final.used].T).mean()), Predictor(final.arm)
    errors, stated = [np.zeros(0)], [np.zeros(0)]
    for area in tip.maps:
        rows, columns = np.nonzero(np.isfinite(area.expanded))
        places, angle = np.stack([area.x[columns], area.y[rows]], axis=1), random.uniform(0, 2 * np.pi, len(rows))
        joints = inverse(final.parameters, places, area.posture)
        force = size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        metadata = TouchMetadata.plain(len(rows))._replace(posture=np.full(len(rows), area.posture))
        true, _ = direct_kinetostatics(robot, joints, force, final.cell.gripper_sign, metadata)
        found = predictor.locate(joints, force, metadata)
        known = found.loaded & np.isfinite(true[:, 0])
        errors.append(np.linalg.norm(found.position - true, axis=1)[known])
        stated.append(area.expanded[rows, columns][known])
    error, radius = np.concatenate(errors), np.concatenate(stated)
    if not len(error):
        return {'undetermined': tip.undetermined}
    return {
        'rms': float(rms(error)),
        'largest': float(error.max()),
        'worst': tip.worst,
        'median': tip.median,
        'ratio': float(np.median(radius) / rms(error) / np.sqrt(2)),
        'coverage': float(np.mean(error <= radius)),
        'undetermined': tip.undetermined,
    }


@cache
def stands_for(label: str) -> set[str]:
    """The names that are right for an effect."""
    effects = {effect.label: effect for cell in cells().values() for effect in catalogue(cell)}
    return {label, ALIAS_OF.get(label, label), *effects[label].special_cases}


def naming(record: Record) -> tuple[set[str], ...]:
    """The gross effects that were named, among rivals, and missed; the names of large small errors, and wrong names."""
    truth, names, rivals = set(record['truth']), set(record['names']), set(record['rivals'])
    right = {label for label in truth if stands_for(label) & names}
    among = {label for label in truth - right if stands_for(label) & rivals}
    left = names - right_names(truth)
    large = left & right_names(record['large'])
    return right, among, truth - right - among, large, left - large


def right_names(labels: Iterable[str]) -> set[str]:
    """The names that are right for some effects."""
    return set[str]().union(*map(stands_for, labels))


def figures(records: Sequence[Record]) -> dict[str, str]:
    """What is said of some recordings, by what it is."""
    done = [record for record in records if 'verdict' in record]
    if not done:
        return {'recordings': str(len(records))}
    namings, clean = [naming(record) for record in done], [r for r in done if not r['truth']]
    right, among, missed, large, wrong = (sum(map(len, part)) for part in zip(*namings, strict=True))
    there = sum(r.get('sizes', {}).get(label, 0.0) > LARGE for r in done for label in naming(r)[-1])
    wrong_in, alarms = sum(bool(one[-1]) for one in namings), [r for r in clean if r['verdict'] != 'none']
    only_large = sum(bool(r['names']) and not naming(r)[-1] for r in alarms)
    unused = ', '.join(str(sum(key in r for r in records)) for key in ('not simulated', 'failure'))
    grades = ', '.join(str(sum(r['grade'] == grade for r in done)) for grade in ('fit', 'caution', 'unfit'))
    verdicts, tips = [r['verdict'] for r in done], [r['tip'] for r in done if 'rms' in r['tip']]
    keys = ('rms', 'largest', 'median', 'worst', 'ratio', 'coverage')
    off, largest, median, worst, ratio, coverage = np.array([[tip[k] for k in keys] for tip in tips], dtype=float).T
    half, most, longest = np.quantile([r['seconds'] for r in done], [0.5, 0.95, 1.0])
    return {
        'recordings': str(len(records)),
        'not simulated, refused': unused,
        'gross, named, among rivals': f'{right + among + missed}, {right}, {among}',
        'missed': str(missed),
        'wrong names, recordings': f'{wrong}, {wrong_in}',
        'of them beyond 3 typical sizes': str(there),
        'large small errors named': str(large),
        'alarms of clean, only large': f'{len(alarms)} of {len(clean)}, {only_large}',
        'ambiguous, unexplained': f'{verdicts.count("ambiguous")}, {verdicts.count("unexplained")}',
        'fit, caution, unfit': grades,
        'tip off, µm: rms, largest': f'{1e6 * np.median(off):.1f}, {1e6 * np.median(largest):.1f}',
        'stated, µm: median, worst': f'{1e6 * np.median(median):.1f}, {1e6 * np.median(worst):.1f}',
        'stated over actual, above 4': f'{np.median(ratio):.2f}, {np.mean(ratio > LARGEST_RATIO):.1%}',
        'covered, worst tenth': f'{coverage.mean():.1%}, {np.quantile(coverage, 0.1):.1%}',
        'diagnose, s: median, 95 %, most': f'{half:.2f}, {most:.2f}, {longest:.2f}',
    }


def bands(records: Sequence[Record]) -> list[tuple[float, ...]]:
    """Of the inclusions in each of `BANDS`: number, mean of those stated, share that is true, its 95 % limits, and the
    share that is gross; true is an effect that is gross, large in its population, or beyond `LARGE` typical sizes.
    """
    rows = list[tuple[float, bool, bool]]()
    for record in records:
        gross, large = right_names(record['truth']), right_names(record['large'])
        for label, p in record.get('inclusion', {}).items():
            rows.append((p, label in gross | large or record['sizes'].get(label, 0.0) > LARGE, label in gross))
    found = list[tuple[float, ...]]()
    for low, high in pairwise(BANDS):
        some = [row for row in rows if low <= row[0] < high or row[0] == high == 1]
        if some:
            stated, true, gross = np.mean(some, axis=0).tolist()
            limits = binomtest(round(true * len(some)), len(some)).proportion_ci()
            found.append((len(some), stated, true, float(limits.low), float(limits.high), gross))
    return found


def report(groups: Mapping[str, Sequence[Record]]) -> None:
    """Prints the figures of groups of recordings side by side, and their bands."""
    parts = {name: figures(records) for name, records in groups.items()}
    print(f'{"":32}', *(f'{name:>22}' for name in parts))
    for key in max(parts.values(), key=len):
        print(f'{key:32}', *(f'{part.get(key, "–"):>22}' for part in parts.values()))
    for name, records in groups.items():
        for n, stated, true, low, high, gross in bands(records):
            limits = f'{low:.1%} to {high:.1%}'
            print(f'{name}: {n} inclusions, stated {stated:.1%}, true {true:.1%} ({limits}), gross {gross:.1%}')


def draw_bands(groups: Mapping[str, Sequence[Record]], path: Path) -> None:
    """Draws the share that is true over the inclusion stated, SVG."""
    with svg_figure(path, 6.0, 5.0) as figure:
        axes = figure.subplots()
        axes.plot([50, 100], [50, 100], lw=0.8, color='gray')
        for name, records in groups.items():
            if found := bands(records):
                _, stated, true, low, high, _ = 100 * np.array(found).T
                axes.errorbar(stated, true, [true - low, high - true], fmt='o', ms=4, capsize=2, label=name)
        axes.set(xlabel='inclusion stated, %', ylabel='true, %, with 95 % limits')
        if axes.containers:
            axes.legend(frameon=False)


def common(logs: Sequence[Path]) -> dict[str, list[Record]]:
    """The recordings of some logs that all of them have, with the same truth."""
    read = [[json.loads(line) for line in log.read_text(encoding='utf-8').splitlines()] for log in logs]
    keyed = [{(r['kind'], r['seed'], *r['truth'].items()): r for r in records} for records in read]
    kept = [key for key in keyed[0] if all(key in other for other in keyed)]
    print(f'{len(kept)} recordings in common, of {", ".join(str(len(one)) for one in keyed)}')
    return {log.stem: [one[key] for key in kept] for log, one in zip(logs, keyed, strict=True)}


def grouped(records: Sequence[Record], key: str) -> dict[str, list[Record]]:
    """The recordings by what they have there, and all."""
    values = sorted({record[key] for record in records})
    names = [f'{value:.3g}' if isinstance(value, float) else str(value) for value in values]
    groups = {f'{key} {name}': [r for r in records if r[key] == v] for name, v in zip(names, values, strict=True)}
    return groups | {'all': list(records)}


def main() -> int:
    """Run, print, save."""
    options = parser(__doc__, json_file=False)
    options.add_argument('--recordings', type=int, help='default: 2000; of a kind 100, of row1 12')
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--kind', choices=[*KINDS], default='')
    options.add_argument('--by', choices=['factor', 'cell', 'declared', 'stated', 'kind'], default='factor')
    options.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    options.add_argument('--log', type=Path, metavar='FILE', help='write a line of JSON for each recording there')
    options.add_argument('--touches', type=Path, metavar='DIR', help='keep simulated touches there, and read them')
    options.add_argument('--picture', type=Path, metavar='FILE.svg', help='draw the inclusions there')
    options.add_argument('--compare', type=Path, nargs='+', metavar='FILE', help='show logs, and run nothing')
    given = options.parse_args()
    if given.compare:
        logs = common(given.compare)
        groups = logs if len(logs) > 1 else grouped(next(iter(logs.values())), given.by)
    else:
        number = given.recordings or {'': 2000, 'row1': ROW_1_COUNT}.get(given.kind, 100)
        tasks = [Task(given.kind, seed, given.touches) for seed in range(given.first, given.first + number)]
        records = []
        with (given.log or Path(os.devnull)).open('w', encoding='utf-8') as log:
            for record in in_processes(run_task, tasks, given.jobs):
                records.append(json_value(record))
                print(json.dumps(records[-1], ensure_ascii=False), file=log, flush=True)
        groups = grouped(records, given.by)
    report(groups)
    if given.picture:
        draw_bands(groups, given.picture)
    return 0


if __name__ == '__main__':
    sys.exit(main())
