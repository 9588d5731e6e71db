"""The diagnosis on recordings of an independent physics engine.

    python -m benchmark.mujoco [--scene NAME …] [--per-disc 18] [--seed 1 …] [--noise given|estimated] [--rates 80 98]

Each scene is simulated once in MuJoCo and recorded, once per seed of the noise; the recording is calibrated with the
cell description alone. Printed is a table: before -> after the effects found are in the model. In parentheses behind
e_f is that of the fit whose effects are those that were built, where the catalogue has their law.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmark.common import CELL
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.mujoco import (
    SimulatedMotion,
    TouchController,
    as_streams,
    built_effects,
    expected_parameters,
    preload_plan,
)
from scara_kinetostatic.simulation.mujoco.engine import SCENES, Scene, scene_named
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import SensorModel
from scara_kinetostatic.simulation.truth import parse_effect, with_effects

SAME_LAW = ('joint_slip', 'object_position', 'base_compliance', 'link_bending')
"""Effects that are built by the law that the catalogue has."""
HEAD = ('scene', 'verdict', 'named, values ± std (built)', 'χ²', 'e_f held out, N', 'largest z of L̄', 'touches')


def row(
    scene: Scene, plan: Plan, motion: SimulatedMotion, sensors: SensorModel, seed: int, cell: Cell
) -> tuple[str, ...]:
    """Records a motion, calibrates the recording; one row of the table."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'recording.mcap'
        write_streams(path, as_streams(motion, scene, CELL, sensors, seed=seed), CELL, with_cell=False)
        try:
            outcome = calibrate_recordings([path], cell)
        except InputError as error:
            return (f'`{scene.name}`', f'no result: {error}'.replace(f'{path}: ', ''), *[''] * (len(HEAD) - 2))
    before, after, diagnosis = outcome.calibration, outcome.final, outcome.diagnosis
    found = '; '.join(effect_text(item, true_values(scene, motion, plan)) for item in diagnosis.found) or 'nothing'
    return (
        f'`{scene.name}`',
        diagnosis.verdict,
        found,
        arrow(before.reduced_chi_square, after.reduced_chi_square),
        arrow(outcome.held_out.force_error, outcome.extended_held_out.force_error) + force_error_given(outcome, scene),
        arrow(deviation(before, scene), deviation(after, scene)),
        used(outcome, len(plan)),
    )


def true_values(scene: Scene, motion: SimulatedMotion, plan: Plan) -> dict[str, float]:
    """True values of the effects, by label and name; of friction, the off-normal angle of the forces."""
    values = {}
    for effect in built_effects(scene, CELL):
        values.update({f'{built_label(effect)} {name}': value for name, value in effect['parameters'].items()})
    values['contact_friction off_normal_angle'] = off_normal(scene, motion, plan)
    return values


def off_normal(scene: Scene, motion: SimulatedMotion, plan: Plan) -> float:
    """Root mean square of the angle between the engine's force and the disc's normal, rad."""
    force, links = motion.force[motion.holds], motion.links[motion.holds]
    yields = scene.parameters.p_ee + np.array(scene.base_compliance)
    backlash = scene.parameters.g_ee * force / np.linalg.norm(force, axis=1)[:, None]
    inward = CELL.centers[plan.disc] - (kinematics.forward(scene.parameters, links) - yields * force - backlash)
    cross = inward[:, 0] * force[:, 1] - inward[:, 1] * force[:, 0]
    return float(np.sqrt(np.mean(np.arctan2(cross, (inward * force).sum(axis=1)) ** 2)))


def effect_text(item: Found, truth: dict[str, float]) -> str:
    """An effect that was found, its values beside those built; one that has rivals with a question mark."""
    label = item.effect.label
    if isinstance(item.effect, Unnamed):
        return f'`{label}`' + '?' * (not item.in_every_model)
    values = [
        f'{value.name} {value.value:.3g} ± {value.std:.1g}'
        + (f' ({truth[key]:.3g})' if (key := f'{label} {value.name}') in truth else '')
        for value in item.values
    ]
    return f'`{label}`{"?" * (not item.in_every_model)} {", ".join(values)}'


def built_text(effect: dict[str, Any]) -> str:
    """A built effect as `parse_effect` reads it."""
    return f'{built_label(effect)}:' + ','.join(f'{name}={value!r}' for name, value in effect['parameters'].items())


def built_label(effect: dict[str, Any]) -> str:
    """Name and target of a built effect."""
    return effect['name'] + (f'[{effect["target"]}]' if effect['target'] else '')


def force_error_given(outcome: Outcome, scene: Scene) -> str:
    """e_f on held-out touches of a fit that starts from the built robot and its effects, in parentheses, or nothing."""
    built = built_effects(scene, CELL)
    if not built or any(effect['name'] not in SAME_LAW for effect in built):
        return ''
    fit = outcome.calibration
    effects = [parse_effect(built_text(effect), CELL) for effect in built]
    model = with_effects(expected_parameters(scene), effects)
    start = WarmStart(model, fit.noise, outcome.final.used)
    given = calibrate(fit.touches, fit.cell, model.effects, warm_start=start)
    return f' ({held_out_force_error(given).force_error:.3g})'


def deviation(fit: Calibration, scene: Scene) -> float:
    """Largest deviation of the parameters from the identifiable ones, in standard deviations; NaN if one has none."""
    expected = expected_parameters(scene).as_array()
    return float(np.abs((fit.parameters.as_array() - expected) / fit.std).max())


def arrow(before: float, after: float) -> str:
    """Both figures; the dash is for none."""
    texts = [f'{value:.3g}' if np.isfinite(value) else '–' for value in (before, after)]
    return ' → '.join(dict.fromkeys(texts)) if before == after else ' → '.join(texts)


def used(outcome: Outcome, simulated: int) -> str:
    """Touches used by the first and the last fit, of those simulated; the number found if not all."""
    text = arrow(outcome.calibration.used.sum(), outcome.final.used.sum()) + f' of {simulated}'
    return text + (f' ({outcome.found} found)' if outcome.found != simulated else '')


def rows(args: argparse.Namespace) -> Iterator[tuple[str, ...]]:
    """The rows that the arguments ask for."""
    cell = CELL if args.noise == 'given' else replace(CELL, noise=None)
    sensors = SensorModel(joint_rate=args.rates[0], wrench_rate=args.rates[1])
    plan = preload_plan(CELL, args.per_disc)
    for scene in map(scene_named, args.scene):
        motion = TouchController(scene, CELL, plan).run()
        yield from (row(scene, plan, motion, sensors, seed, cell) for seed in args.seed)


def main() -> int:
    """Runs the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else '')
    parser.add_argument('--scene', nargs='+', default=list(SCENES), metavar='NAME')
    parser.add_argument('--per-disc', type=int, default=18)
    parser.add_argument('--seed', type=int, nargs='+', default=[1])
    parser.add_argument('--noise', choices=('given', 'estimated'), default='given')
    parser.add_argument('--rates', type=float, nargs=2, default=(80.0, 98.0), metavar=('JOINTS', 'FORCES'), help='Hz')
    args = parser.parse_args()
    for line in (HEAD, ['---'] * len(HEAD)):
        print('| ' + ' | '.join(line) + ' |')
    for line in rows(args):
        print('| ' + ' | '.join(line) + ' |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
