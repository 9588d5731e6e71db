"""The uncertainty budget against Monte Carlo (JCGM 101): errors are drawn, the fit is repeated."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from benchmark.diagnosis.cells import SETUPS, Setup, seed_of
from benchmark.uncertainty.worlds import declared_setup
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, WorstPose, tip_uncertainty
from scara_kinetostatic.calibration.uncertainty_budget import NOISE, Item, uncertainty_budget
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World

KIND = 'everything'
"""What is declared: discs to 15 µm and 5 µm, others to 3 µm on a plate, common radius, sensor, trusted values."""
ALL = 'all sources'
LARGEST_DEVIATION = 0.07
LEAST_SHARE = 0.01
"""A contribution below this part of the combined standard uncertainty is not compared."""
ADDED_UP = 1e-9
EXACT = Noise(0.0, 0.0)


class Task(NamedTuple):
    """Draws that are made one after the other."""

    cell: str
    source: str
    draws: range


class Reference(NamedTuple):
    """What is checked: the budget at the truth."""

    setup: Setup
    truth: Parameters
    calibration: Calibration
    budget: tuple[Item, ...]
    at: WorstPose


@cache
def reference(cell: str) -> Reference:
    """The budget of a cell, from exact touches of a world without errors."""
    setup = declared_setup(cell, KIND)
    declared = DeclaredErrors.of(setup.cell)
    assert declared is not None
    world = World.of(setup.cell, np.zeros(declared.count), dict.fromkeys(setup.cell.uncertainty.nominal, 0.0))
    truth = world.robot(setup.truth)
    c = calibrate(simulate_touches(world.cell, truth, setup.plan, EXACT), setup.cell)
    tip = tip_uncertainty(c)
    assert tip.at is not None
    return Reference(setup, truth, c, uncertainty_budget(c, tip), tip.at)


def tasks(first: int, count: int, at_once: int = 50) -> list[Task]:
    """Draws `first` to `first + count` of every source and of all together, in both cells."""
    parts = [range(start, min(start + at_once, first + count)) for start in range(first, first + count, at_once)]
    sources = {cell: [*(item.label for item in reference(cell).budget), ALL] for cell in SETUPS}
    return [Task(cell, label, part) for cell, labels in sources.items() for label in labels for part in parts]


def run_task(task: Task) -> dict[str, Any]:
    """Deviations of the parameters and of the tip, estimate less truth, one row per draw."""
    there = reference(task.cell)
    rows = [_draw(there, task, number).tolist() for number in task.draws]
    return {'cell': task.cell, 'source': task.source, 'deviations': rows}


def _draw(there: Reference, task: Task, number: int) -> Floats:
    """One draw: the deviations of L̄ and that of the tip, (13,)."""
    random = np.random.default_rng([number, seed_of(task.cell, task.source)])
    world = World.draw(there.setup.cell, random)
    if task.source != ALL:
        declared = DeclaredErrors.of(there.setup.cell)
        assert declared is not None
        kept = np.zeros(declared.count)
        kept[declared.places.get(task.source, np.zeros(0, dtype=np.intp))] = 1.0
        named = {name: error * (task.source == f'nominal[{name}]') for name, error in world.nominal_errors.items()}
        world = World.of(there.setup.cell, kept * world.errors, named)
    robot = world.robot(there.setup.truth)
    noise = there.setup.cell.noise if task.source in (NOISE, ALL) else EXACT
    touches = simulate_touches(world.cell, robot, there.setup.plan, noise, int(random.integers(2**31)))
    c0 = there.calibration
    start = WarmStart(c0.model, c0.noise, c0.used, c0.errors)
    c = calibrate(world.reported(touches), there.setup.cell, warm_start=start)
    joints, force = there.at.joints[None], there.at.force[None]
    tips = [
        direct_kinetostatics(model, joints, force, there.setup.cell.gripper_sign)[0][0]
        for model in (c.model, ExtendedModel(robot))
    ]
    return np.append(c.parameters.as_array() - robot.as_array(), there.at.direction @ (tips[0] - tips[1]))


def summarise(records: Sequence[dict[str, Any]]) -> tuple[list[str], list[tuple[str, bool]]]:
    """A line for each source, and the targets."""
    lines, worst, added = [], 0.0, 0.0
    for cell in dict.fromkeys(record['cell'] for record in records):
        there = reference(cell)
        items = {item.label: np.append(item.parameters, item.tip) for item in there.budget}
        combined = np.sqrt(np.sum([each**2 for each in items.values()], axis=0))
        total = np.append(there.calibration.std, tip_uncertainty(there.calibration).worst / COVERAGE_FACTOR)
        added = max(added, float(np.abs(combined**2 / total**2 - 1).max()))
        for label, expected in {**items, ALL: combined}.items():
            rows = [row for r in records if (r['cell'], r['source']) == (cell, label) for row in r['deviations']]
            if not rows:
                continue
            found = np.sqrt(np.mean(np.array(rows) ** 2, axis=0))
            compared = expected > LEAST_SHARE * combined
            off = np.where(compared, found / expected - 1, 0.0)
            where = int(np.argmax(np.abs(off)))
            worst = max(worst, float(np.abs(off).max()))
            lines.append(
                f'{cell:6} {label:26} {len(rows):5} draws: {int(compared.sum()):2} of 13 compared, tip '
                f'{1e6 * expected[-1]:7.2f} and {1e6 * found[-1]:7.2f} µm, farthest off {(*NAMES, "tip")[where]} '
                f'{100 * off[where]:+.1f} %'
            )
    return lines, [
        (f'each contribution within {100 * LARGEST_DEVIATION:.0f} %: {100 * worst:.1f} %', worst <= LARGEST_DEVIATION),
        (f'variances add up to {ADDED_UP:g}: {added:.1e}', added <= ADDED_UP),
    ]
