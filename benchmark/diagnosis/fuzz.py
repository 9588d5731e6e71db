"""Random sets of effects: the diagnosis must end in a result or in an error that says what is wrong with the data.

    python -m benchmark.diagnosis.fuzz [--first N] [--count N] [--render N] [--json FILE]

Each set has one to four effects of the catalogue, of random size and direction, in one of two cells with 24 to 108
touches; some have friction of either sense as well, and in half of them the noise is estimated. Every Nth outcome is
also written as JSON, text, page and parameter file. A set depends on its number alone, so that a run can be split.
Printed are the internal errors, the sets that take longer than 10 s (CPU), and how often each verdict occurs.
"""

from __future__ import annotations

import json
import sys
import traceback
import warnings
from collections import Counter
from dataclasses import asdict, dataclass, replace
from time import process_time

import numpy as np

from benchmark.common import parser, save
from benchmark.diagnosis.cells import NOISE, PRELOAD, SETUPS, SimulatedEffects, random_values
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.contact_friction import OffNormalForce
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.calibration_json import as_document
from scara_kinetostatic.results.parameter_file import parameter_text
from scara_kinetostatic.results.report import html_text, text_report
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

LONGEST = 10.0
"""CPU time that a diagnosis may take, s."""
SMALLEST, LARGEST = 0.01, 3.0
"""Size of an effect, in plausible sizes; the logarithm is uniform."""
MOST_HALVINGS = 12
FRICTION = 0.2
"""Part of the sets with friction of either sense."""


@dataclass
class Trial:
    """One set.

    Attributes:
        number: of the set.
        cell: name in `SETUPS`.
        touches: how many.
        noise: ``given`` or ``estimated``.
        effects: labels.
        verdict: of the diagnosis, or ``refused``.
        message: of the refusal, or the internal error.
        internal: whether it is an internal error.
        cpu: time of calibration and diagnosis, s.
    """

    number: int
    cell: str = ''
    touches: int = 0
    noise: str = ''
    effects: tuple[str, ...] = ()
    verdict: str = ''
    message: str = ''
    internal: bool = False
    cpu: float = 0.0


def run(number: int, render: bool) -> Trial:
    """Simulate a set, calibrate, diagnose."""
    random = np.random.default_rng([number, 13])
    trial = Trial(number, str(random.choice(list(SETUPS))), int(random.integers(24, 109)))
    setup = SETUPS[trial.cell]
    per_disc = -(-trial.touches // len(setup.cell.discs))
    per_disc += per_disc % 2
    plan = default_plan(setup.cell, per_disc, preload=float(random.choice([0.0, PRELOAD])))
    plan = plan.select(np.arange(min(trial.touches, len(plan))))
    trial.touches, trial.noise = len(plan), str(random.choice(['given', 'estimated']))
    simulated = _random_set(catalogue(setup.cell), trial.touches, random)
    touches = None
    for _ in range(MOST_HALVINGS):
        try:
            touches = simulate_touches(setup.cell, simulated.robot(setup.truth), plan, NOISE, number)
            break
        except UnsupportedDataError:
            simulated = simulated.scaled(0.5)
    trial.effects = simulated.labels
    if touches is None:
        trial.verdict = 'not simulated'
        return trial
    if random.random() < FRICTION:
        touches = _with_friction(touches, setup.cell, simulated, setup.truth, random)
        trial.effects += ('friction of either sense',)
    _diagnose(trial, touches, setup.cell if trial.noise == 'given' else replace(setup.cell, noise=None), render)
    return trial


def _random_set(known: tuple[Effect, ...], touches: int, random: np.random.Generator) -> SimulatedEffects:
    """One to four effects with values; a moment lies within the touches."""
    chosen = random.choice(len(known), int(random.integers(1, 5)), replace=False)
    effects, values = [], []
    for k in chosen:
        effect = known[k]
        size = float(np.exp(random.uniform(np.log(SMALLEST), np.log(LARGEST))))
        value = random_values(effect, random)
        if effect.is_stepwise:
            value[effect.grid_parameter_index] = random.integers(0, touches) + 0.5
        value = value + (size - 1) * effect.amplitudes(value)
        effects.append(effect)
        values.append(value)
    return SimulatedEffects(tuple(effects), tuple(values))


def _with_friction(touches: TouchSet, cell: Cell, simulated: SimulatedEffects, truth, random) -> TouchSet:  # type: ignore[no-untyped-def]
    """The same touches, each force off the normal by a random angle; those without an equilibrium stay as they are."""
    robot = simulated.robot(truth)
    robot = replace(robot, effects=(*robot.effects, OffNormalForce()), effect_values=(*robot.effect_values, ()))
    angle = random.uniform(0.005, 0.1) * random.standard_normal(len(touches))
    found = contact(
        robot,
        touches.joints,
        cell.centers[touches.disc],
        cell.radii[touches.disc],
        cell.gripper,
        warm_start=touches.force,
        metadata=TouchMetadata.of(touches),
        off_normal=angle,
    )
    noisy = found.force + NOISE.force_rms * random.standard_normal(touches.force.shape)
    solved = found.solved & np.isfinite(noisy).all(axis=1)
    return touches.replace(force=np.where(solved[:, None], noisy, touches.force))


def _diagnose(trial: Trial, touches: TouchSet, cell: Cell, render: bool) -> None:
    began = process_time()
    try:
        outcome = calibrate_touches(touches, cell)
        trial.verdict = outcome.verdict
        trial.cpu = process_time() - began
        if render:
            json.dumps(as_document(outcome), allow_nan=False)
            text_report(outcome)
            html_text(outcome)
            parameter_text(outcome)
    except ScaraKinetostaticError as error:
        trial.verdict, trial.message = 'refused', str(error)
        trial.cpu = process_time() - began
    except Exception as error:  # what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f'{last.filename.rpartition("/")[2]}:{last.lineno} {last.name}'
        trial.internal, trial.message = True, f'{type(error).__name__}: {error} ({where})'
        trial.cpu = process_time() - began


def main() -> int:
    """Run, print, save."""
    options = parser(__doc__)
    options.add_argument('--first', type=int, default=0, help='number of the first set (default: 0)')
    options.add_argument('--count', type=int, default=2000, help='sets (default: 2000)')
    options.add_argument('--render', type=int, default=20, help='every how many sets the outcome is written, too')
    chosen = options.parse_args()
    trials = []
    for number in range(chosen.first, chosen.first + chosen.count):
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            trial = run(number, number % chosen.render == 0)
        trials.append(trial)
        if trial.internal or trial.cpu > LONGEST:
            about = f'{trial.touches} touches, noise {trial.noise}, {", ".join(trial.effects)}'
            print(f'{number}: {trial.cpu:.1f} s, {about}: {trial.verdict} {trial.message}', flush=True)
        if (len(trials) % 50) == 0:
            print(f'... {number + 1}', file=sys.stderr, flush=True)
            save(chosen.json, [asdict(each) for each in trials])
    save(chosen.json, [asdict(each) for each in trials])
    cpu = np.array([trial.cpu for trial in trials])
    internal, slow = sum(trial.internal for trial in trials), int((cpu > LONGEST).sum())
    print(f'{len(trials)} sets: {internal} internal errors, {slow} over {LONGEST:g} s')
    print(f'CPU time: median {np.median(cpu):.2f} s, longest {cpu.max():.1f} s')
    print(dict(Counter(trial.verdict for trial in trials)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
