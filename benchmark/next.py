"""Touches chosen by `next` against touches spread evenly, in random cells.

    python -m benchmark.next [--cells 20] [--simulated 3] [--runs 20] [--decide] [--json FILE]

Random cells: links of 0.2 to 0.4 m, three discs, limits of the joints, an obstacle in every other one, a region. The
robot is some millimetres, milliradians and compliances off its nominal values, which the choice does not know. Even
touches are spread over all places that can be reached, in both postures, the forces in turn; of five such sets the
median counts. The measure is the largest expanded uncertainty of the tip (k = 2) over the region, predicted for the
true robot:

- first: twelve touches, nothing known before;
- further: twelve more after twelve even ones;
- until: touches until a tolerance, which is what 48 even ones reach, in sets of six after the first twelve.

In some of the cells the first and the further touches are simulated and calibrated, with independent noise: the tip's
rms error over the region. Times are those of a plan of twelve touches, after import, of one processor.

With `--decide` the robot has one effect of `EFFECTS`, 0.5 to 1.5 times its typical size. Where fourteen first touches
leave it with rivals, twelve more are simulated and all calibrated: in how many cells is this effect alone found then?
The twelve are those of `--goal decide`, of `--goal accuracy`, the latter with nothing suspected, and even ones.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from math import cos, sin
from typing import NamedTuple

import numpy as np

from benchmark.common import NOISE, parser, print_and_save
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc, Region, layout_problems
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.candidate_touches import prepare_candidates
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.planning.prediction import RobotModel, tip_in_use
from scara_kinetostatic.planning.program import next_files
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import simulate_touches

WANTED = 1.3
EFFECTS = (
    'cable_pull[joint2]',
    'object_position[disc_2]',
    'transmission_error[joint1]',
    'joint_hysteresis[joint1]',
    'object_position[disc_3]',
    'object_radius[disc_1]',
    'transmission_error[joint2]',
    'joint_slip[joint1]',
    'contact_friction[disc_2]',
    'object_radius[disc_2]',
    'contact_compliance',
    'encoder_gain[joint2]',
)
"""Of which one is there, in turn, with `--decide`."""


class Case(NamedTuple):
    """A random cell and the robot in it.

    Attributes:
        planner: that knows nothing but the cell.
        truth: the robot.
        tip: of it over the region.
    """

    planner: Planner
    truth: RobotModel
    tip: Floats

    def expanded(self, plan: Plan) -> float:
        """Largest expanded uncertainty of the tip with the touches of a plan, m."""
        candidates = prepare_candidates(self.truth, plan, self.tip, mean=True)
        covariance = np.linalg.inv(candidates.information_of(range(len(plan)))) * np.outer(SCALES, SCALES)
        variance = np.linalg.eigvalsh(self.tip @ covariance @ self.tip.swapaxes(-1, -2))
        return float(COVERAGE_FACTOR * np.sqrt(variance.max()))


def random_cell(random: np.random.Generator) -> Cell:
    """A cell in which discs can be touched."""
    while True:
        l1, l2 = random.uniform(0.2, 0.4, 2).tolist()
        nominal = Parameters(l1=l1, l2=l2, p_ee=1e-5, p1=1e-5, p2=1e-5)
        discs = []
        for k in range(3):
            away, turn = random.uniform(0.4, 0.85) * (l1 + l2), random.uniform(-0.6, np.pi + 0.6)
            discs.append(Disc(f'disc_{k + 1}', away * cos(turn), away * sin(turn), random.uniform(0.03, 0.12)))
        limits = random.uniform(2.2, 2.8, 2).tolist()
        obstacles = ()
        if random.random() < 0.5:
            x, y = random.uniform([-0.3, 0.1], [0.3, 0.4]).tolist()
            obstacles = (((x, y), (x + 0.08, y), (x, y + 0.08)),)
        span = 0.7 * (l1 + l2)
        cell = Cell(
            nominal,
            tuple(discs),
            noise=NOISE,
            region=Region(-span, span, 0.2 * span, span),
            limits=((-limits[0], limits[0]), (-limits[1], limits[1])),
            obstacles=obstacles,
        )
        gaps = np.array([[np.hypot(a.x - b.x, a.y - b.y) - a.radius - b.radius for a in discs] for b in discs])
        apart = gaps[np.triu_indices(3, 1)].min() > 0.05
        if apart and not layout_problems(cell, cell.centers, cell.radii):
            return cell


def true_robot(cell: Cell, random: np.random.Generator) -> Parameters:
    """A robot off its nominal values."""
    off = random.standard_normal(6) * [3e-3, 3e-3, 3e-3, 3e-4, 3e-3, 3e-4]
    values = cell.nominal.as_array()
    values[:6] += off
    values[6:9] = 10 ** random.uniform(-5.3, -4.2, 3)
    values[9:] = random.uniform(0.5e-4, 3e-4, 3)
    return Parameters.from_array(values)


def case(seed: int) -> Case:
    """The first cell from a seed on in which touches can be reached on two discs."""
    random = np.random.default_rng([3101, seed])
    while True:
        planner = Planner(nominal_arm(random_cell(random)))
        cell = planner.arm.cell
        try:
            reached = len(np.unique(planner.candidates.plan.disc))
            truth = RobotModel.of(cell, true_robot(cell, random))
            tip = tip_in_use(truth, float(np.mean(cell.touch.force)))
        except ScaraKinetostaticError:
            continue
        if reached > 1:
            return Case(planner, truth, tip)


def even(one: Case, number: int, turn: float) -> Plan:
    """Touches spread evenly over all that can be reached."""
    plan = one.planner.candidates.plan
    levels = np.unique(plan.force)
    plan = plan.select((plan.force == levels[0]) & (plan.preload == 0))
    around = plan.select(np.lexsort((plan.angle, plan.posture, plan.disc)))
    at = ((np.arange(number) + turn) * len(plan) / number).astype(np.intp) % len(plan)
    chosen = around.select(at)
    return Plan(chosen.disc, chosen.angle, chosen.posture, levels[np.arange(number) % len(levels)])


def after(one: Case, made: Plan, number: int) -> Plan:
    """What `next` chooses with touches made, by the nominal model still."""
    touches = simulate_touches(one.planner.arm.cell, one.truth.parameters, made, seed=0)
    return Planner(one.planner.arm, touches=touches).accurate(number).plan


def until(one: Case, tolerance: float, first: Plan, most: int = 96) -> int:
    """Touches that `next` needs to a tolerance, in sets of six."""
    made = first
    while one.expanded(made) > tolerance and len(made) < most:
        made = Plan.joined([made, after(one, made, 6)])
    return len(made)


def joined(made: TouchSet, more: TouchSet) -> TouchSet:
    """Touches of two recordings, one after the other."""
    later = more.replace(index=more.index + len(made), order=more.order + len(made), recording=more.recording + 1)
    return TouchSet.concatenate([made, later.replace(time=more.time + made.time.max() + 10.0)])


def decided(number: int, first: int) -> dict[str, float] | None:
    """Whether twelve more touches decide, after a first few that leave one effect with rivals; None where they do not.

    Args:
        number: of the cell, which says the effect and its size, too.
        first: touches made at first, chosen from the nominal model.
    """
    one, random = case(number), np.random.default_rng([3102, number])
    cell, label = one.planner.arm.cell, EFFECTS[number % len(EFFECTS)]
    effect = find(cell, label)
    sizes = effect.amplitudes(np.ones(len(effect.typical))) != 0
    values = np.where(sizes, random.uniform(0.5, 1.5), 1.0) * effect.typical
    truth = ExtendedModel(one.truth.parameters, (effect,), (tuple(values.tolist()),))
    even_plan = even(one, 12, 0.5)
    even_plan = replace(even_plan, preload=0.3 * (np.arange(12) % 2))
    try:
        made = simulate_touches(cell, truth, one.planner.accurate(first).plan, seed=number)
        outcome = calibrate_touches(made, cell)
    except ScaraKinetostaticError:
        return None
    planner, result = Planner.of_outcome(outcome), dict[str, float]()
    decision = planner.decision() if outcome.verdict == 'ambiguous' else None
    if decision is None:
        return None
    ways: dict[str, Callable[[], Plan]] = {
        'decide': lambda: planner.discriminating(decision, 12).plan,
        'accuracy': lambda: planner.accurate(12).plan,
        'tip alone': lambda: replace(planner, suspected=frozenset()).accurate(12).plan,
        'even': lambda: even_plan,
    }
    for name, plan in ways.items():
        try:
            more = simulate_touches(cell, truth, plan(), seed=number + 1000)
            after = calibrate_touches(joined(made, more), cell).diagnosis
            right = after.verdict == 'explained' and [item.effect.label for item in after.found] == [label]
        except ScaraKinetostaticError:
            right = False
        result[name] = right
    return result | {'foreseen': decision.outlook.expected, 'before': decision.outlook.now}


def decide(cells: int, first: int) -> dict[str, object]:
    """In how many of the cells whose first touches leave rivals twelve more name the one effect that is there; the sums
    of the probabilities of the likeliest set, before and as foreseen.
    """
    rows = [row for number in range(first, first + cells) if (row := decided(number, 14)) is not None]
    return {'with rivals': len(rows), **{name: sum(row[name] for row in rows) for name in rows[0]}}


def rms_error(one: Case, plan: Plan, runs: int) -> float:
    """Rms error of the tip over the region in simulated calibrations, m."""
    cell, truth, errors = one.planner.arm.cell, one.truth.parameters, list[Floats]()
    for seed in range(runs):
        found = calibrate(simulate_touches(cell, truth, plan, seed=seed), cell)
        errors.append(found.parameters.as_array() - truth.as_array())
    moved = np.einsum('gdik,nk->ngdi', one.tip, np.array(errors)[:, : len(NAMES)])
    return float(np.sqrt((moved**2).sum(axis=-1).mean()))


def main() -> int:
    """Runs the cells."""
    options_of = parser(__doc__)
    options_of.add_argument('--cells', type=int, default=20)
    options_of.add_argument('--simulated', type=int, default=3, help='cells whose calibrations are simulated')
    options_of.add_argument('--runs', type=int, default=20, help='simulated calibrations of each set')
    options_of.add_argument('--first', type=int, default=0, help='number of the first cell')
    options_of.add_argument('--decide', action='store_true', help='decide between rivals instead')
    options = options_of.parse_args()
    if options.decide:
        print_and_save(options.json, decide(options.cells, options.first))
        return 0
    rows = []
    for number in range(options.first, options.first + options.cells):
        one = case(number)
        began = time.process_time()
        fresh = Planner(one.planner.arm)
        planned = fresh.accurate(12)
        next_files(fresh, planned)
        took = time.process_time() - began
        evens = {n: [even(one, n, turn) for turn in (0.1, 0.3, 0.5, 0.7, 0.9)] for n in (12, 24, 36, 48)}
        spread = {n: float(np.median([one.expanded(plan) for plan in plans])) for n, plans in evens.items()}
        before = evens[12][2]
        further = Plan.joined([before, after(one, before, 12)])
        row = {
            'cell': number,
            'first': spread[12] / one.expanded(planned.plan),
            'further': spread[24] / one.expanded(further),
            'until': until(one, spread[48], planned.plan),
            'even': spread,
            'seconds': took,
            'discs': np.bincount(planned.plan.disc, minlength=3).tolist(),
        }
        if number - options.first < options.simulated:
            sets = {'first': planned.plan, 'even 12': before, 'further': further, 'even 24': evens[24][2]}
            row['simulated'] = {name: rms_error(one, plan, options.runs) for name, plan in sets.items()}
        print(
            {key: round(float(value), 6) if isinstance(value, float) else value for key, value in row.items()},
            flush=True,
        )
        rows.append(row)
    ratios = {name: sorted(row[name] for row in rows) for name in ('first', 'further')}
    result = {
        'cells': rows,
        **{f'{name}, smallest and median': [values[0], float(np.median(values))] for name, values in ratios.items()},
        'touches until the tolerance of 48 even ones, median': float(np.median([row['until'] for row in rows])),
        'seconds, largest and median': [max(row['seconds'] for row in rows), np.median([r['seconds'] for r in rows])],
    }
    print_and_save(options.json, {key: value for key, value in result.items() if key != 'cells'} | {'rows': rows})
    reached = all(np.median(values) >= WANTED for values in ratios.values())
    return 0 if reached else 1


if __name__ == '__main__':
    sys.exit(main())
