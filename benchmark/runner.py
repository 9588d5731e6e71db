"""A robot that calibrates itself, in random simulated cells, by simulated time.

    python -m benchmark.runner [--cells 50] [--first 0] [--tolerance 3e-5] [--touches 100]
        [--jobs 1] [--json FILE]
    python -m benchmark.runner --mujoco --urdf ur5 --cells 5 --tolerance 1e-4

Cells as in `benchmark.next`; every other one has a lift. The robot's base and offsets are 3 mm and 3 mrad off, the
discs 3 µm (declared), friction of the contact 0 to 0.1, the sensor's bias 2 N, both sensors 250 Hz (`--rate`; the
robot moves in steps of a sample), the robot's lag 20 ms. The run is that of the node `touch_runner`; a calibration
takes 4 s of simulated time. Reported: why it ended, z of all parameters, the largest force, contacts that were not
planned, joint limits, touches and time.

With `--mujoco` the physics engine is the robot; that the tip stays out of the obstacles is then judged by its place.
With `--undetected none` effects that are not detected count for nothing. With `--even` an even plan is made until the
same tolerance. With `--effect` the robot has these effects instead of the friction, and it is noted after how many
touches the diagnosis names each. With `--upright` gravity of 9.81 m/s² against y loads the joints: static moments of
0.5 to 2 and 0.1 to 0.6 kg m, of which the nominal ones, declared to a fifth, are up to a fifth off. With `--urdf` the
cells are those of `benchmark.urdf`, without a lift, the friction is 0.05. The tip's error is that under 40 N at random
poses around the objects, with the nominal values before and with the calibration after.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmark.common import parser, print_and_save
from benchmark.next import case, even
from benchmark.rehearsal import Rehearsal
from benchmark.urdf import SOURCES, displaced, masses_of, true_robot, urdf_cell
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.cell import Cell, EffectSizes, Lift, SizeMode, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import MOMENTS
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.planning.motion import inside
from scara_kinetostatic.planning.next_touches import known_or_infinite
from scara_kinetostatic.simulation.commanded import COMMANDED_SENSORS, Body, ModelBody, Plant
from scara_kinetostatic.simulation.mujoco.engine import EngineBody, Scene
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

GRAVITY = (0.0, -9.81)
DISC = 3e-6
"""Standard uncertainty of the places and radii of the discs, m."""


class Options(NamedTuple):
    """What the cells have in common.

    Attributes:
        tolerance: of the tip, m.
        even: whether an even plan is made as well.
        effects: of the robot in place of the friction.
        undetected: size of the effects that are not detected.
        mujoco: whether the physics engine is the robot.
        upright: whether gravity loads the joints.
        urdf: name of the robot; empty: a random arm.
        most: touches after which it ends.
        rate: samples of both sensors per second, and steps of the robot.
    """

    tolerance: float = 3e-5
    even: bool = False
    effects: tuple[str, ...] = ()
    undetected: SizeMode = SizeMode.ESTIMATED
    mujoco: bool = False
    upright: bool = False
    urdf: str = ''
    most: int = 100
    rate: float = 250.0


def cell_of(seed: int, options: Options) -> tuple[Cell, Cell, ExtendedModel]:
    """The cell as described, as it is, and the robot in it."""
    random = np.random.default_rng([31, seed])
    sizes = Uncertainty(effects=EffectSizes(options.undetected))
    if options.urdf:
        cell = urdf_cell(options.urdf, seed, DISC)
        cell = replace(cell, uncertainty=replace(sizes, nominal=cell.uncertainty.nominal))
        parameters, friction = true_robot(cell, random), 0.05
    else:
        one = case(seed)
        parameters, friction, cell = one.truth.parameters, random.uniform(0.0, 0.1), one.planner.arm.cell
        discs = tuple(disc._replace(center_std=DISC, radius_std=DISC) for disc in cell.discs)
        lift = Lift('joint3', 0.02, 0.0) if seed % 2 else None
        cell = replace(cell, discs=discs, lift=lift, uncertainty=sizes)
    cell = replace(cell, tolerance=options.tolerance)
    true = displaced(cell, DISC, random)
    texts = options.effects or [f'contact_friction:coefficient={friction}']
    truth = with_effects(parameters, [parse_effect(text, cell) for text in texts])
    if options.upright:
        cell, truth = stood_up(cell, truth, random)
    return cell, replace(cell, discs=true), truth


def stood_up(cell: Cell, truth: ExtendedModel, random: np.random.Generator) -> tuple[Cell, ExtendedModel]:
    """A cell and its robot with gravity in the plane of the arm."""
    moments = np.array([random.uniform(0.5, 2.0), random.uniform(0.1, 0.6)])
    stated = dict(zip(MOMENTS, (moments * random.uniform(0.8, 1.2, 2)).tolist(), strict=True))
    nominal = cell.nominal.replace(gravity=GRAVITY, **stated)
    known = replace(cell.uncertainty, nominal={name: 0.2 * value for name, value in stated.items()})
    weight = dict(zip(MOMENTS, moments.tolist(), strict=True))
    heavy = truth.parameters.replace(gravity=GRAVITY, **weight)
    return replace(cell, nominal=nominal, uncertainty=known), replace(truth, parameters=heavy)


def body_of(true: Cell, truth: ExtendedModel, options: Options) -> Body:
    """The robot; that of the engine has the contact friction of a model, and no obstacles."""
    if not options.mujoco:
        body = ModelBody(true, truth)
        body.tick = 1 / options.rate
        return body
    (friction,) = truth.effect_values[0]
    masses = masses_of(options.urdf) if options.urdf else Scene().masses
    scene = Scene('friction', truth.parameters, contact_friction=friction, masses=masses)
    return EngineBody(scene, replace(true, obstacles=()))


def run(seed: int, options: Options) -> dict[str, object]:
    """One cell."""
    cell, true, truth = cell_of(seed, options)
    random = np.random.default_rng([32, seed])
    turn = random.uniform(0, 2 * np.pi)
    sensors = replace(COMMANDED_SENSORS, bias=(2 * np.cos(turn), 2 * np.sin(turn)))
    began = time.monotonic()
    row: dict[str, object] = {'cell': seed, 'lift': cell.lift is not None}
    try:
        plant = Plant(cell, body_of(true, truth, options), sensors=sensors, seed=seed)
        rehearsal = Rehearsal(cell, plant, options.most, options.rate, patience=30.0)
    except Exception as error:  # said before anything moves
        return row | {'refused': f'{type(error).__name__}: {error}'}
    runner = rehearsal.runner
    runner.start()
    low, high = np.array(cell.limits).T
    beyond, hit, read, named = 0, 0, 0.0, dict[str, int]()

    def watch(one: Rehearsal) -> bool:
        nonlocal beyond, hit, read
        for effect in options.effects:
            label = effect.partition(':')[0]
            if label in one.runner.campaign.knowledge.verdict:
                named.setdefault(label, one.runner.campaign.accepted)
        joints, read = one.runner.senses.joints, max(read, one.runner.senses.force)
        if np.isfinite(joints).all():
            beyond += bool(((joints < low) | (joints > high)).any())
            if options.mujoco and cell.lift is None:
                tip = forward(truth.parameters, joints)[None]
                hit += any(inside(np.array(outline), tip)[0] for outline in cell.obstacles)
        return False

    rehearsal.run(watch)
    end, campaign = runner.end, runner.campaign
    row |= {
        'status': None if end is None else end.status,
        'reason': 'still running' if end is None else end.reason,
        'touches': campaign.accepted,
        'failed': campaign.failed,
        'peak_N': plant.peak_force,
        'peak_read_N': read,
        'unplanned': [pair for pair in rehearsal.contacts if pair[0] != pair[1]],
        'beyond_limits': beyond,
        'in_obstacles': hit,
        'fastest_rad_s': rehearsal.fastest,
        'simulated_s': rehearsal.time,
        'took_s': time.monotonic() - began,
        'verdict': campaign.knowledge.verdict,
        'named': named,
    }
    if options.even and end is not None and end.reason.startswith('enough'):
        row['even'] = even_touches(seed, options.tolerance, cell, truth)
    if campaign.touches:
        try:
            final = calibrate_touches(TouchSet.concatenate(campaign.touches), cell).final
        except ScaraKinetostaticError as error:
            return row | {'not_calibrated': str(error)}
        names = truth.parameters.names
        std = np.array([final[name].std for name in names])
        off = np.array([final[name].value for name in names]) - truth.parameters.as_array()
        row['z'] = dict(zip(names, np.round(off / std, 2).tolist(), strict=True))
        row['largest_z'] = float(np.nanmax(np.abs(off / std)))
        row['not_determined'] = [name for name, value in zip(names, std, strict=True) if not np.isfinite(value)]
        row['tip_before_um'], row['tip_after_um'] = tip_errors(final, truth, random)
    return row


def tip_errors(final: Calibration, truth: ExtendedModel, random: np.random.Generator) -> tuple[float, float]:
    """Of the tip under 40 N at 500 poses around the objects, rms, with nominal values and with the estimates, µm.

    The truth has all effects of the robot.
    """
    centers, (low, high) = final.cell.centers, np.array(final.cell.limits or [(-np.pi, np.pi)] * 2).T
    joints = random.uniform(np.maximum(low, -np.pi), np.minimum(high, np.pi), (20000, 2))
    places = forward(truth.parameters, joints)
    joints = joints[((places > centers.min(axis=0)) & (places < centers.max(axis=0))).all(axis=1)][:500]
    angle = random.uniform(-np.pi, np.pi, len(joints))
    force = 40.0 * np.array([np.cos(angle), np.sin(angle)]).T
    metadata = TouchMetadata.plain(len(joints))._replace(posture=posture(truth.parameters, joints))
    tip, _ = direct_kinetostatics(truth, joints, force, metadata=metadata)
    found = [Predictor(final.arm, nominal=nominal).locate(joints, force, metadata) for nominal in (True, False)]
    before, after = (float(1e6 * np.sqrt(np.nanmean(((one.position - tip) ** 2).sum(axis=1)))) for one in found)
    return before, after


def even_touches(seed: int, tolerance: float, cell: Cell, truth: ExtendedModel) -> int | None:
    """Touches of an even plan (`benchmark.next`) until the tolerance, in steps of an eighth; None for more than 200."""
    one, number = case(seed), 12
    while number <= 200:
        touches = simulate_touches(cell, truth, even(one, number, 0.5), seed=seed)
        try:
            outcome = calibrate_touches(touches, cell)
        except ScaraKinetostaticError:
            pass
        else:
            tip = outcome.tip_uncertainty
            reached = known_or_infinite(tip.worst, tip.undetermined) <= tolerance
            if reached and outcome.assessment.grade.value != 'unfit':
                return number
        number += max(1, number // 8)
    return None


def spread(values: list[float | None]) -> tuple[float, float] | None:
    """Median and largest; None without any."""
    known = [value for value in values if value is not None]
    return (float(np.median(known)), max(known)) if known else None


def main() -> int:
    """Runs the cells."""
    options_of = parser(__doc__)
    options_of.add_argument('--cells', type=int, default=50)
    options_of.add_argument('--first', type=int, default=0, help='number of the first cell')
    options_of.add_argument('--tolerance', type=float, default=3e-5, help='m')
    options_of.add_argument('--even', action='store_true', help='also the touches of an even plan')
    options_of.add_argument('--effect', action='append', default=[], help='of the robot, as for `simulate`')
    modes = [mode.value for mode in (SizeMode.ESTIMATED, SizeMode.TYPICAL, SizeMode.NONE)]
    options_of.add_argument('--undetected', choices=modes, default='estimated', help='effects that are not detected')
    options_of.add_argument('--mujoco', action='store_true', help='the physics engine is the robot')
    options_of.add_argument('--upright', action='store_true', help='gravity loads the joints')
    options_of.add_argument('--urdf', choices=SOURCES, default='', help='the robot of a URDF, upright')
    options_of.add_argument('--touches', type=int, default=100, help='at most')
    options_of.add_argument('--rate', type=float, default=250.0, help='samples per second')
    options_of.add_argument('--jobs', type=int, default=1)
    options = options_of.parse_args()
    if options.mujoco and options.effect:
        options_of.error('the robot of --mujoco has contact friction alone')
    if options.urdf and (options.even or options.upright):
        options_of.error('--urdf goes without --even and --upright')
    seeds = range(options.first, options.first + options.cells)
    rows = []
    with ProcessPoolExecutor(options.jobs) as pool:
        given = Options(
            options.tolerance,
            options.even,
            tuple(options.effect),
            SizeMode(options.undetected),
            options.mujoco,
            options.upright,
            options.urdf,
            options.touches,
            options.rate,
        )
        for row in pool.map(run, seeds, [given] * len(seeds)):
            print({key: value for key, value in row.items() if key != 'z'}, flush=True)
            rows.append(row)
    ran = [row for row in rows if 'refused' not in row]
    result = {
        'ended with status 0': sum(row['status'] == 0 for row in ran),
        'refused at the start': len(rows) - len(ran),
        'largest z': max((row.get('largest_z', 0.0) for row in ran), default=None),
        'cells with z above 4.5': sum(row.get('largest_z', 0.0) > 4.5 for row in ran),
        'peak force, N': max((row['peak_N'] for row in ran), default=None),
        'peak force as read, N': max((row['peak_read_N'] for row in ran), default=None),
        'contacts not planned': sum(len(row['unplanned']) for row in ran),
        'samples in obstacles': sum(row['in_obstacles'] for row in ran),
        'samples beyond limits': sum(row['beyond_limits'] for row in ran),
        'tip under 40 N before, median and largest, µm': spread([row.get('tip_before_um') for row in ran]),
        'tip under 40 N after, median and largest, µm': spread([row.get('tip_after_um') for row in ran]),
        'touches, median': float(np.median([row['touches'] for row in ran])) if ran else None,
        'simulated s, median': float(np.median([row['simulated_s'] for row in ran])) if ran else None,
        'took s, median': float(np.median([row['took_s'] for row in ran])) if ran else None,
    }
    compared = [row['touches'] / (row['even'] or 200) for row in ran if 'even' in row]
    result['touches in those of an even plan, median'] = float(np.median(compared)) if compared else None
    print_and_save(options.json, result | {'rows': rows})
    well = [
        row['status'] == 0 and not row['unplanned'] and not row['beyond_limits'] + row['in_obstacles'] for row in ran
    ]
    return 0 if ran and all(well) else 1


if __name__ == '__main__':
    sys.exit(main())
