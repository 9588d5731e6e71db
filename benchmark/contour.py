"""Contours of objects that took no part in the calibration: error before and after, and whether the intervals hold.

    python -m benchmark.contour [--runs 20] [--robot actual|measured] [--effect NAME[TARGET]:PARAMETER=VALUE,…]
    python -m benchmark.contour --engine [--runs 20]

Per run: a simulated robot touches the three discs of the paper's cell and is calibrated and diagnosed; then it slides
along a disc and a rounded square that no calibration knows, with friction, under forces of 10 to 25 N. Each
contour is held against the true surface along its normal. Printed are the rms normal error of four models on the same
joint angles, forces and normals; that of the noise alone, an exactly known model on the same recordings; and the part
of the points whose 95 % interval holds the true surface. With `--engine` MuJoCo plays the slides along disc and square;
the touches are those of the simulator.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from benchmark.common import CELL as PAPER
from benchmark.common import normal_error, parser, save
from benchmark.engine_slides import SlideController
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import tip_places, trace_contour
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.mujoco.engine import Scene
from scara_kinetostatic.simulation.plan import Circle, Slide, default_plan, polygon
from scara_kinetostatic.simulation.streams import SensorModel, recorded, simulate_streams, simulate_touches
from scara_kinetostatic.simulation.truth import parse_effect, with_effects
from scara_kinetostatic.touches.streams import Streams

CELL = replace(PAPER, tip_radius=0.005)
ROBOTS = {'actual': PAPER_ACTUAL, 'measured': PAPER_MEASURED}
OBJECTS = {
    'disc': Circle((0.20, 0.30), 0.06),
    'rounded square': polygon([[0.10, 0.30], [0.20, 0.30], [0.20, 0.40], [0.10, 0.40]], 0.01),
}
PER_DISC = 18
"""Places of the touches around each disc."""
FORCES = (10.0, 15.0, 20.0, 25.0)
FRICTION = 0.1
MOVED_DISC = 'object_position[disc_2]:x=1.2e-4,y=-0.9e-4'
"""A disc that is not where the cell description says."""
SPEED, TURNS = 0.03, 1.02
"""Of the slides, m/s and turns round the object."""
QUANTILE = 1.96
"""Of a 95 % interval, in standard uncertainties."""
HEAD = (
    'object',
    'rigid nominal',
    'rigid calibrated',
    'deformable',
    'with effects',
    'noise alone',
    '95 % holds',
    'closed',
)
UNITS = ('', 'mm', 'mm', 'µm', 'µm', 'µm', '%', 'of runs')


Recorder = Callable[[ExtendedModel, Outline | Circle, float, int], Streams]
"""From robot, object, force and seed to a recording."""


class Held(NamedTuple):
    """One contour held against the true surface.

    Attributes:
        name: of the object.
        errors: rms normal error of the four models, m.
        noise: that of an exactly known model, m.
        inside: part of the points whose 95 % interval holds the true surface.
        closed: whether it is one closed outline.
    """

    name: str
    errors: tuple[float, float, float, float]
    noise: float
    inside: float
    closed: bool


def calibrated(robot: ExtendedModel, seed: int) -> Outcome:
    """A calibration of a simulated robot by touches of the discs of the cell."""
    return calibrate_touches(simulate_touches(CELL, robot, default_plan(CELL, PER_DISC), seed=seed), CELL)


def slide_along(robot: ExtendedModel, outline: Outline | Circle, force: float, seed: int) -> Streams:
    """The recording of a slide round an object."""
    return simulate_streams(CELL, robot, (Slide(outline, force, FRICTION, SPEED, end=TURNS),), seed=seed)


def played(robot: ExtendedModel, outline: Outline | Circle, force: float, seed: int) -> Streams:
    """The recording of a slide round an object in MuJoCo."""
    scene = Scene(parameters=robot.parameters, contact_friction=FRICTION)
    motion = SlideController(scene, CELL, Slide(outline, force, speed=SPEED, end=TURNS)).run()
    return recorded('simulation', CELL, robot, motion, SensorModel(), seed)


def held_out(robot: ExtendedModel, seed: int, record: Recorder = slide_along) -> list[Held]:
    """The contours of one calibration."""
    outcome = calibrated(robot, seed)
    base, final = outcome.calibration.arm, outcome.final.arm
    exact = known_exactly(final, robot)
    found = []
    for number, (name, outline) in enumerate(OBJECTS.items()):
        force = FORCES[(seed + number) % len(FORCES)]
        streams = record(robot, outline, force, 1000 + 10 * seed + number)
        try:
            contour = trace_contour(streams, final)
        except UnsupportedDataError as error:
            print(f'run {seed}, {name}: {error}', file=sys.stderr)
            continue
        inside = np.abs(normal_error(outline, contour.surface)) < QUANTILE * contour.std_normal
        errors = errors_of(contour, outline, base, final)
        noise = rms(normal_error(outline, trace_contour(streams, exact).surface))
        closed = len(contour.outlines) == 1 and contour.outlines[0].closed
        found.append(Held(name, errors, noise, float(inside.mean()), closed))
        text = f'run {seed}, {name}: {1e6 * errors[-1]:.1f} µm, {100 * inside.mean():.1f} %'
        print(text, file=sys.stderr, flush=True)
    return found


def surfaces_of(contour: Contour, arm: CalibratedArm) -> tuple[Floats, Floats, Floats]:
    """The surface of a contour, (n, 2), m, by three models: rigid nominal, rigid calibrated, deformable calibrated."""
    removed = contour.tip_radius * contour.normal
    return (
        forward(arm.cell.nominal, contour.joints) - removed,
        forward(arm.model.parameters, contour.joints) - removed,
        tip_places(arm, contour.joints, contour.force).center - removed,
    )


def errors_of(
    contour: Contour, outline: Outline | Circle, base: CalibratedArm, final: CalibratedArm
) -> tuple[float, float, float, float]:
    """Rms normal error: rigid nominal, rigid calibrated, deformable, deformable with the effects found, m."""
    found = [*surfaces_of(contour, base), contour.surface]
    return tuple(rms(normal_error(outline, surface)) for surface in found)  # type: ignore[return-value]


def known_exactly(arm: CalibratedArm, robot: ExtendedModel) -> CalibratedArm:
    """An arm whose model is that of the robot: what it leaves is the noise of the slide."""
    size = len(robot.names)
    return replace(arm, model=robot, covariance=np.zeros((size, size)), undetermined=np.zeros((size, 0)))


def row(name: str, held: list[Held]) -> tuple[str, ...]:
    """One row of the table: rms over the runs."""
    nominal, rigid, deformable, effects = (root_mean(np.array([item.errors[k] for item in held])) for k in range(4))
    noise = root_mean(np.array([item.noise for item in held]))
    inside = np.array([item.inside for item in held])
    spread = f' ± {100 * inside.std(ddof=1) / np.sqrt(len(held)):.1f}' if len(held) > 1 else ''
    return (
        name,
        f'{1e3 * nominal:.2f}',
        f'{1e3 * rigid:.3f}',
        f'{1e6 * deformable:.1f}',
        f'{1e6 * effects:.1f}',
        f'{1e6 * noise:.1f}',
        f'{100 * inside.mean():.1f}{spread}',
        f'{sum(item.closed for item in held)} of {len(held)}',
    )


def root_mean(values: Floats) -> float:
    """Root of the mean square over the runs."""
    return float(np.sqrt(np.mean(values**2)))


def main() -> int:
    """Runs the command."""
    options = parser(__doc__)
    options.add_argument('--runs', type=int, default=20)
    options.add_argument('--robot', choices=ROBOTS, default='actual')
    options.add_argument('--effect', action='append', default=[])
    options.add_argument('--engine', action='store_true')
    args = options.parse_args()
    robot = with_effects(ROBOTS[args.robot], [parse_effect(text, CELL) for text in args.effect])
    held = [item for seed in range(args.runs) for item in held_out(robot, seed, played if args.engine else slide_along)]
    for line in (HEAD, UNITS, ['---'] * len(HEAD)):
        print('| ' + ' | '.join(line) + ' |')
    rows = {name: [item for item in held if item.name == name] for name in OBJECTS}
    for name, part in rows.items():
        if part:
            print('| ' + ' | '.join(row(name, part)) + ' |')
    save(args.json, {name: [item._asdict() for item in part] for name, part in rows.items()})
    return 0


if __name__ == '__main__':
    sys.exit(main())
