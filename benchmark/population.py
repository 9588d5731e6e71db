"""Robots with every small error at once: whether the stated uncertainty of the tip holds, and how wide it is.

    python -m benchmark.population [--robots N] [--first N] [--sizes 0 0.3 1 3] [--kind all|outside] [--cell NAME]
                                   [--effects estimated|typical|none] [--jobs N] [--json FILE]

A robot has every error of the catalogue and eight from outside it, each normal with its size below times a factor. Of
the kind ``outside`` half of its errors are from outside: of those of the catalogue as many as there are others. All
are simulated by the laws of the arm, not linearised. The touches are 108 in two cells, with the noise not stated and
estimated; the discs' uncertainty is declared or not.

Judged is the tip that `locate` gives at places all over the workspace, under the mean force in any direction, by the
true tip there: the part of the places where it is within the 95 % ellipse, and the stated uncertainty over the error.

Beside it is a bound: the same model with the true sizes of the errors of the catalogue known, and nothing named. Errors
from outside the catalogue are in neither.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any, ClassVar, NamedTuple

import numpy as np

from benchmark.common import in_processes, parser, print_targets, save
from benchmark.diagnosis.cells import NOISE, SETUPS, Setup, seed_of
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import workspace
from scara_kinetostatic.diagnosis.comparison import objects_left_out
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.mixed_model import fit_mixed
from scara_kinetostatic.effects.base import DiscEffect, Effect, JointEffect, LinearEffect, SensorEffect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, EffectSizes, SizeMode
from scara_kinetostatic.model.extended_model import ExtendedModel, Parameter, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches

FACTORS = (0.0, 0.3, 1.0, 3.0)
DECLARED = 1e-5
"""Standard uncertainty of each coordinate of a disc's centre, times the factor, m; half of it of its radius."""
PLACES = 200
"""Poses at which the tip is judged."""
LEAST_PLACES, LARGEST_RATIO, LARGEST_Z = 0.7, 4.0, 5.0
QUANTILE = 5.991
"""95 % of chi-square with two degrees of freedom."""
MEDIAN_OF_ERROR = 0.8326
"""Median over root mean square of the length of a normal vector with equal axes, √ln 2."""
WAVE = 'transmission_error[joint2]', 1e-5
"""The one error that is not as large as `Effect.typical_size` has it, rad: joint 2 has the better gear."""
CYCLES = (1.0, 2.0, 3.0, 4.0, 11.0, 36.0, 100.0)
"""Waves per turn of a transmission error: eccentric, oval and bent wheels, teeth."""


class _Outside:
    """Texts of an error that the catalogue does not have."""

    confounded_with = identified_by = 'not examined'
    plot_variable = 'angle'
    statement = 'outside the catalogue'


def _parameter(unit: str) -> tuple[Parameter, ...]:
    return (Parameter('a', unit, 1.0, 'size'),)


@dataclass(frozen=True)
class LobedDisc(_Outside, DiscEffect):
    """A disc with three lobes: as `OvalDisc` with the support function r + a cos 3ψ."""

    name: ClassVar[str] = 'lobed_disc'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('m')

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        """(h - r) n + h' t, ψ the outward normal."""
        angle = 3 * (np.arctan2(at.normal[:, 1], at.normal[:, 0]) + np.pi)
        return (-np.cos(angle)[:, None] * -at.normal - 3 * np.sin(angle)[:, None] * at.tangent,)


@dataclass(frozen=True)
class StiffnessByElbow(_Outside, JointEffect):
    """The compliance of a joint changes with the elbow: δ = a c cos q2."""

    name: ClassVar[str] = 'stiffness_by_elbow'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('rad/Nm')

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """By the other joint, too."""
        return (at.torques[:, self.joint] * np.cos(at.joints[:, 1]),)


@dataclass(frozen=True)
class Creep(_Outside, JointEffect):
    """The zero of a joint creeps: δ = -a ln(1 + t / 60 s)."""

    name: ClassVar[str] = 'creep'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('rad')

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Over time."""
        return (-np.log1p(at.metadata.time / 60.0),)


@dataclass(frozen=True)
class ElbowRunOut(_Outside, LinearEffect):
    """The axis of joint 2 is no point: along link 1 it moves by a cos 3q2."""

    name: ClassVar[str] = 'elbow_run_out'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('m')

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """Along link 1."""
        return (Shift(place=np.cos(3 * at.joints[:, 1])[:, None] * at.link1),)


@dataclass(frozen=True)
class GripperSettling(_Outside, LinearEffect):
    """The gripper yields by the root of the force: d = -a √f n."""

    name: ClassVar[str] = 'gripper_settling'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('m/√N')

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """Along the force."""
        return (Shift(place=-np.sqrt(np.abs(at.magnitude))[:, None] * at.normal),)


@dataclass(frozen=True)
class SoftBacklash(_Outside, JointEffect):
    """A joint's teeth yield at their edges: δ = a c / (|c| + 1 Nm), beside its backlash."""

    name: ClassVar[str] = 'soft_backlash'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('rad')

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """A smooth step over the torque."""
        torque = at.torques[:, self.joint]
        return (torque / (np.abs(torque) + 1.0),)


@dataclass(frozen=True)
class CrossWave(_Outside, JointEffect):
    """A wave of a gear that both joints drive: δ = a sin(2 q1 - q2)."""

    name: ClassVar[str] = 'cross_wave'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('rad')

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """Over both angles."""
        return (np.sin(at.joints @ np.array([2.0, -1.0])),)


@dataclass(frozen=True)
class SensorLobes(_Outside, SensorEffect):
    """The force sensor has four lobes: e = a ‖F‖ (cos 4φ, sin 4φ) in its frame."""

    name: ClassVar[str] = 'sensor_lobes'
    parameters: ClassVar[tuple[Parameter, ...]] = _parameter('1')

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        """Fourth harmonic."""
        angle = 4 * np.arctan2(force[:, 1], force[:, 0])
        size = values[0] * np.hypot(force[:, 0], force[:, 1])
        return np.asarray(size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))


OUTSIDE = {
    'lobed_disc': 5e-6,
    'stiffness_by_elbow': 3e-7,
    'creep': 3e-6,
    'elbow_run_out': 5e-6,
    'gripper_settling': 1e-6,
    'soft_backlash': 1e-5,
    'cross_wave': 1e-5,
    'sensor_lobes': 1e-3,
}
"""The eight kinds of error from outside the catalogue, with their sizes."""


def outside(cell: Cell) -> list[Effect]:
    """The errors from outside the catalogue, of every disc and joint."""
    kinds = (StiffnessByElbow, Creep, SoftBacklash, CrossWave)
    return [
        *(LobedDisc.of(k, disc.name) for k, disc in enumerate(cell.discs)),
        *(kind.of(joint) for kind in kinds for joint in (0, 1)),
        ElbowRunOut(),
        GripperSettling(),
        SensorLobes(),
    ]


class Task(NamedTuple):
    """One robot."""

    cell: str
    kind: str
    factor: float
    declared: bool
    effects: str
    seed: int


def draw(task: Task) -> tuple[Setup, ExtendedModel, TouchSet]:
    """A cell as it is described, its robot with all its errors, and the touches that this makes.

    Raises:
        UnsupportedDataError: the robot cannot hold a touch.
    """
    setup, factor, cell = SETUPS[task.cell], task.factor, SETUPS[task.cell].cell
    random = np.random.default_rng([task.seed, seed_of(task.cell, task.kind, factor)])
    if task.declared:
        std = (factor or 0.1) * DECLARED  # none is exact
        cell = replace(cell, discs=tuple(d._replace(center_std=std, radius_std=std / 2) for d in cell.discs))
    uncertainty = replace(cell.uncertainty, effects=EffectSizes(SizeMode(task.effects)))
    cell = replace(cell, noise=None, uncertainty=uncertainty)
    others, listed = outside(cell), list(catalogue(setup.cell))
    sizes = sizes_of(listed) | OUTSIDE
    if task.kind == 'outside':
        kept = random.permutation(len(listed))[: len(others)]
        listed = [listed[k] for k in sorted(kept)]
    effects = (*listed, *others)
    values = [
        errors_of(effect, factor * np.array(sizes.get(effect.label, sizes.get(effect.name, 0.0))), random)
        for effect in effects
    ]
    robot = ExtendedModel(setup.truth, effects, tuple(values)) if factor else ExtendedModel(setup.truth)
    return setup._replace(cell=cell), robot, simulate_touches(setup.cell, robot, setup.plan, NOISE, task.seed)


def sizes_of(effects: Iterable[Effect]) -> dict[str, float | tuple[float, ...]]:
    """Size of each error of the catalogue by label: its standard deviation at the factor 1, SI."""
    return dict([*((effect.label, effect.typical_size or 0.0) for effect in effects), WAVE])


def errors_of(effect: Effect, size: Floats, random: np.random.Generator) -> tuple[float, ...]:
    """Normal with a size; a wave of any phase and of the frequencies of gears, a step between any two touches; none of
    what L̄ contains, which is last.
    """
    signs = np.array([p.sign for p in effect.parameters if not p.is_alias])
    drawn = size * random.standard_normal(len(signs))
    drawn = np.where(signs == 0, drawn, signs * np.abs(drawn))
    if effect.name == 'transmission_error':
        drawn[1:] = random.uniform(0, 2 * np.pi), random.choice(CYCLES)
    elif effect.name == 'joint_slip':
        drawn[1] = random.uniform(1.0, 4.0)
    elif effect.name == 'load_friction':
        drawn[1] = random.uniform(0.1, 0.3)
    elif effect.is_stepwise:
        drawn[-1] = random.integers(10, 98) + 0.5
    return (*drawn.tolist(), *[0.0] * (len(effect.parameters) - len(drawn)))


def run_task(task: Task) -> dict[str, Any]:
    """A robot calibrated, diagnosed and judged."""
    record: dict[str, Any] = task._asdict()
    try:
        setup, robot, touches = draw(task)
        before = calibrate(touches, setup.cell)
        begun = process_time()
        found = diagnose(before)
        seconds = process_time() - begun
    except ScaraKinetostaticError as error:
        return record | {'failure': str(error)}
    final = found.extended or found.refitted or before
    z = (final.parameters.as_array() - robot.parameters.as_array()) / np.where(final.std > 0, final.std, np.nan)
    left_out = objects_left_out(final)
    judged = judge(final, robot, task.seed) | {'left_out': left_out.error / left_out.stated}
    return (
        record
        | {'verdict': found.verdict, 'extended': found.extended is not None, 'seconds': seconds, 'z': z.tolist()}
        | judged
        | {'bound': judge(with_true_sizes(touches, setup.cell, task.factor), robot, task.seed)}
    )


def with_true_sizes(touches: TouchSet, cell: Cell, factor: float) -> Calibration:
    """The mixed model of touches with the sizes of a population known."""
    known = catalogue(cell)
    stated = {name: factor * (size[0] if isinstance(size, tuple) else size) for name, size in sizes_of(known).items()}
    sizes = cell.uncertainty.effects._replace(stated=stated)
    told = replace(cell, uncertainty=replace(cell.uncertainty, effects=sizes))
    return fit_mixed(calibrate(touches, told), known).fit


def judge(final: Calibration, robot: ExtendedModel, seed: int) -> dict[str, float]:
    """How well the tip is known at places all over the workspace, loaded, where the calibration determines it."""
    random, area = np.random.default_rng([seed, 7]), workspace(final).poses
    rows = random.choice(len(area.joints), PLACES, replace=False)
    joints, force = area.joints[rows], area.force[rows]
    metadata = TouchMetadata.plain(PLACES)._replace(posture=area.posture[rows])
    arm, noise = final.arm, final.contributions[0].covariance
    found = Predictor(arm).locate(joints, force, metadata)
    by_noise = Predictor(replace(arm, covariance=noise)).locate(joints, force, metadata).covariance
    true, _ = direct_kinetostatics(robot, joints, force, final.cell.gripper_sign, metadata)
    known = np.isfinite(found.covariance[:, 0, 0]) & found.loaded
    error, covariance, by_noise = (found.position - true)[known], found.covariance[known], by_noise[known]
    square = (error * np.linalg.solve(covariance, error[:, :, None])[:, :, 0]).sum(axis=1)
    size = np.median(np.linalg.norm(error, axis=1))
    stated, least = (np.nanmedian(np.sqrt(np.trace(each, axis1=1, axis2=2))) for each in (covariance, by_noise))
    return {
        'coverage': float(np.mean(square <= QUANTILE)),
        'error': float(size),
        'stated': float(stated),
        'ratio': float(stated / size * MEDIAN_OF_ERROR),
        'over_noise': float(stated / least),
    }


def line(name: str, records: Sequence[dict[str, Any]]) -> str:
    """The figures of some robots, and below them those with the true sizes known."""
    good = [record for record in records if 'failure' not in record]
    z = np.abs(np.array([record['z'] for record in good], dtype=float))
    of_z = f'z rms {np.sqrt(np.nanmean(z**2)):.2f}, beyond {LARGEST_Z:g} {100 * np.nanmean(z > LARGEST_Z):.2f} %'
    bound = [record['bound'] for record in good]
    return f'{name:28} {len(good):4} robots: {_figures(good)}; {of_z}\n{"  true sizes known":41}: {_figures(bound)}'


def _figures(judged: Sequence[dict[str, Any]]) -> str:
    """What `judge` says of some robots."""
    c, error, stated, ratio, over = (
        np.array([one[key] for one in judged]) for key in ('coverage', 'error', 'stated', 'ratio', 'over_noise')
    )
    return (
        f'ellipse holds in {100 * c.mean():.0f} %, in {LEAST_PLACES:.0%} of the places for '
        f'{100 * np.mean(c >= LEAST_PLACES):.0f} %; tip off {1e6 * np.median(error):.1f}, worst '
        f'{1e6 * error.max():.0f}, '
        f'stated {1e6 * np.median(stated):.1f} µm, ratio {np.median(ratio):.2f}, above {LARGEST_RATIO:g} in '
        f'{100 * np.mean(ratio > LARGEST_RATIO):.1f} %; over noise alone {np.nanmedian(over):.2f}'
    )


def targets(records: Sequence[dict[str, Any]], kind: str, least: float, wide: float) -> list[tuple[str, bool]]:
    """Those of robots of one kind with errors."""
    some = [r for r in records if r['kind'] == kind and r['factor'] > 0 and 'failure' not in r]
    if not some:
        return []
    c, ratio = (np.array([r[key] for r in some]) for key in ('coverage', 'ratio'))
    z = np.abs(np.array([r['z'] for r in some], dtype=float))
    holds, places, median, above = (
        c.mean(),
        np.mean(c >= LEAST_PLACES),
        np.median(ratio),
        np.mean(ratio > LARGEST_RATIO),
    )
    rms, beyond = np.sqrt(np.nanmean(z**2)), np.nanmean(z > LARGEST_Z)
    return [
        (f'{kind}: the ellipse holds in {least:.0%} to 98 %: {holds:.1%}', least <= holds <= 0.98),
        (f'{kind}: in {LEAST_PLACES:.0%} of the places for 95 % of the robots: {places:.1%}', places >= 0.95),
        (f'{kind}: stated over actual error 1 to {wide} (median): {median:.2f}', 1.0 <= median <= wide),
        (f'{kind}: above {LARGEST_RATIO:g} in at most 2 %: {above:.1%}', above <= 0.02),
        (f'{kind}: z of the parameters, rms at most 1.3: {rms:.2f}', rms <= 1.3),
        (f'{kind}: z beyond {LARGEST_Z:g} in at most 1 %: {beyond:.2%}', beyond <= 0.01),
    ]


def main() -> int:
    """Run, print, save."""
    options = parser(__doc__)
    options.add_argument('--robots', type=int, default=50, help='of each cell, kind and size (default: 50)')
    options.add_argument('--first', type=int, default=0, help='the first seed (default: 0)')
    options.add_argument('--sizes', type=float, nargs='+', default=FACTORS)
    options.add_argument('--kind', choices=('all', 'outside'), help='default: both')
    options.add_argument('--cell', choices=list(SETUPS), help='default: both')
    options.add_argument('--effects', choices=[mode.value for mode in SizeMode], default='estimated')
    options.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    given: argparse.Namespace = options.parse_args()
    cells, kinds = [given.cell] if given.cell else list(SETUPS), [given.kind] if given.kind else ['all', 'outside']
    listed = [
        Task(cell, kind, factor, declared, given.effects, seed)
        for seed in range(given.first, given.first + given.robots)
        for cell in cells
        for kind in kinds
        for factor in given.sizes
        for declared in (False, True)
        if factor or kind == kinds[0]
    ]
    records = list(in_processes(run_task, listed, given.jobs))
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault((record['kind'], record['factor'], record['declared']), []).append(record)
    for (kind, factor, declared), group in sorted(groups.items()):
        print(line(f'{kind} {factor:g} {"discs declared" if declared else "not declared"}', group))
    for record in records:
        if 'failure' in record:
            print(record['cell'], record['kind'], record['factor'], record['seed'], record['failure'])
    found = [*targets(records, 'all', 0.90, 1.6), *targets(records, 'outside', 0.85, 1.8)]
    clean = [
        record['over_noise']
        for record in records
        if not record['factor'] and record['declared'] and 'failure' not in record
    ]
    if clean:
        found.append(
            (f'without errors at most 1.6 times noise alone: {np.median(clean):.2f}', float(np.median(clean)) <= 1.6)
        )
    save(given.json, records)
    print_targets(found)
    return 0


if __name__ == '__main__':
    sys.exit(main())
