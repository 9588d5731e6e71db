"""H̄ and Ḡ of calibrated arms: whether they are each other's inverse, their time, whether their uncertainties hold.

    python -m benchmark.compensation [--calibrations 200] [--poses 1000] [--timed 1000000] [--json FILE]

Inverse: places over the workspace, in both postures, forces of 0 to 40 N and through the dead bands on purpose, with
each effect of the catalogue that acts on the robot. Uncertainty: in both cells of `benchmark.diagnosis`, with exactly
known discs and with everything declared, touches of a simulated robot are calibrated; the truth at new poses is that of
the simulated robot, by law (6) itself. Of `locate` both coordinates are counted, of `compensate` the place along the
force, each within 1.96 standard uncertainties.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from benchmark.common import machine, parser, peak_memory, print_targets, repeat, reset_peak_memory, save
from benchmark.diagnosis.cells import SETUPS, Setup, random_effect
from benchmark.uncertainty.worlds import declared_setup
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.arm import CHUNK, CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World

LARGEST_ERROR = 1e-9
"""Of one function after the other, m."""
LONGEST = 3.0
"""Processor time of a million poses, s."""
COVERED = (0.93, 0.97)
WITHIN = 1.96
LARGEST_FORCE = 40.0
"""Of the poses, N; that of the touches."""
KINDS = ('exact', 'everything')
"""What the cell description declares: nothing, or discs, plate, sensor and some nominal values."""


class Poses(NamedTuple):
    """Places of the tip, forces on the object and elbow postures."""

    tip: Floats
    force: Floats
    posture: Indices


def random_poses(p: Parameters, count: int, random: np.random.Generator) -> Poses:
    """Poses all over the workspace."""
    posture = random.choice([1, -1], count)
    links = np.stack([random.uniform(-np.pi, np.pi, count), posture * random.uniform(0.15, 2.9, count)], axis=-1)
    return Poses(
        forward(p, links), polar(random.uniform(0, LARGEST_FORCE, count), random.uniform(0, 7, count)), posture
    )


def dead_band_poses(p: Parameters, count: int, random: np.random.Generator) -> Poses:
    """The same with forces along link 2, towards joint 1, or hardly any: pulling and pressing."""
    poses = random_poses(p, count, random)
    links = inverse_kinetostatics(p.replace(g1=0.0, g2=0.0), poses.tip, 0 * poses.force, poses.posture)[0]
    along = links.sum(axis=1) + p.theta1 + p.theta2
    towards = np.arctan2(poses.tip[:, 1] - p.y0, poses.tip[:, 0] - p.x0)
    angle = np.where(random.random(count) < 0.5, along, towards) + random.normal(0, 0.01, count)
    size = np.where(random.random(count) < 0.2, 0.1, 1.0) * np.hypot(*poses.force.T)
    size[: count // 20] = 0.0
    return poses._replace(force=polar(random.choice([-1, 1], count) * size, angle))


def polar(size: Floats, angle: Floats) -> Floats:
    """Vectors (n, 2)."""
    return np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1)


def inverse_errors(count: int = 20000) -> Iterator[tuple[str, float]]:
    """Largest distance of S from H̄(Ḡ(S)), and of H̄(Q) from H̄(Ḡ(H̄(Q))), of each cell and effect, m."""
    random = np.random.default_rng(1)
    for name, setup in SETUPS.items():
        arm = calibrate(simulate_touches(setup.cell, setup.truth, setup.plan), setup.cell).arm
        for effect in (None, *catalogue(setup.cell)):
            model = arm.model if effect is None else random_effect(effect, 1).robot(arm.model.parameters)
            if effect is not None and effect.on_object:
                continue
            size = len(model.names)
            values = {'model': model, 'covariance': np.eye(size), 'undetermined': np.zeros((size, 0))}
            predictor = Predictor(CalibratedArm(**(vars(arm) | values)))
            for poses in (f(setup.truth, count, random) for f in (random_poses, dead_band_poses)):
                yield f'{name}, {"base" if effect is None else effect.label}', _inverse_error(predictor, poses)


def _inverse_error(predictor: Predictor, poses: Poses) -> float:
    """NaN where a pose is lost on the way."""
    angles = predictor.compensate(*poses)
    reached = np.isfinite(angles.joints).all(axis=1)
    back = predictor.locate(angles.joints[reached], poses.force[reached])
    return float(np.abs(back.position - poses.tip[reached]).max())


def times(count: int) -> dict[str, Any]:
    """Processor time of a million poses, s, and growth of the memory beyond inputs and results, bytes."""
    setup = SETUPS['paper']
    predictor = Predictor(calibrate(simulate_touches(setup.cell, setup.truth, setup.plan), setup.cell).arm)
    poses = random_poses(setup.truth, count, np.random.default_rng(2))
    joints = predictor.compensate(*poses).joints
    reset_peak_memory()
    before = peak_memory()
    functions = {
        'compensate': lambda: predictor.compensate(*poses),
        'locate': lambda: predictor.locate(joints, poses.force),
    }
    seconds = {name: repeat(run)['median'] * 1e6 / count for name, run in functions.items()}
    return {'seconds': seconds, 'memory': peak_memory() - before, 'chunk': CHUNK}


def coverage(cell: str, kind: str, calibrations: int, count: int) -> dict[str, float]:
    """Parts of the deviations from the truth that are within 1.96 standard uncertainties."""
    setup = SETUPS[cell] if kind == 'exact' else declared_setup(cell, kind)
    counts: dict[str, list[float]] = {}
    for number in range(calibrations):
        random = np.random.default_rng([number, 15])
        robot, arm = _calibrated(setup, random)
        for name, inside in _inside(arm, robot, random_poses(robot, count, random)).items():
            counts.setdefault(name, []).append(float(np.mean(inside)))
    return {name: float(np.mean(parts)) for name, parts in counts.items()}


def _calibrated(setup: Setup, random: np.random.Generator) -> tuple[Parameters, CalibratedArm]:
    world = World.draw(setup.cell, random)
    robot = world.robot(setup.truth)
    touches = simulate_touches(world.cell, robot, setup.plan, setup.cell.noise, int(random.integers(2**31)))
    return robot, calibrate(world.reported(touches), setup.cell).arm


def _inside(arm: CalibratedArm, robot: Parameters, poses: Poses) -> dict[str, Floats]:
    """Whether the truth is within the interval, by function."""
    predictor, gripper = Predictor(arm), arm.cell.gripper_sign
    joints, _ = inverse_kinetostatics(robot, *poses, gripper)
    found = predictor.locate(joints, poses.force)
    angles = predictor.compensate(*poses)
    tip, _ = direct_kinetostatics(ExtendedModel(robot), angles.joints, poses.force, gripper)
    normal = poses.force / np.hypot(*poses.force.T)[:, None]
    aside = np.abs(((tip - poses.tip) * normal).sum(axis=1))
    known = np.isfinite(angles.std_normal)
    return {
        'locate': np.abs(found.position - poses.tip) < WITHIN * found.std,
        'compensate': aside[known] < WITHIN * angles.std_normal[known],
    }


def main() -> int:
    """Runs everything; 0 where all targets are met."""
    options = parser(__doc__)
    options.add_argument('--calibrations', type=int, default=200)
    options.add_argument('--poses', type=int, default=1000)
    options.add_argument('--timed', type=int, default=1_000_000)
    args = options.parse_args()
    errors = list(inverse_errors())
    where, worst = max(errors, key=lambda item: np.nan_to_num(item[1], nan=np.inf))
    timed = times(args.timed)
    covered = {
        f'{cell}, {kind}': coverage(cell, kind, args.calibrations, args.poses) for cell in SETUPS for kind in KINDS
    }
    print(f'memory beyond inputs: {timed["memory"] / 2**20:.0f} MiB, results of {args.timed} poses included')
    save(args.json, {'machine': machine(), 'inverse': errors, 'time': timed, 'coverage': covered})
    targets = [(f'inverse to {LARGEST_ERROR:g} m: {worst:.1e} ({where})', worst <= LARGEST_ERROR)]
    targets += [
        (f'{name}: a million poses in {LONGEST:g} s: {seconds:.2f} s', seconds <= LONGEST)
        for name, seconds in timed['seconds'].items()
    ]
    targets += [
        (f'{where}, {name}: {100 * part:.1f} % within 95 % intervals', COVERED[0] <= part <= COVERED[1])
        for where, parts in covered.items()
        for name, part in parts.items()
    ]
    return 0 if print_targets(targets) else 1


if __name__ == '__main__':
    raise SystemExit(main())
