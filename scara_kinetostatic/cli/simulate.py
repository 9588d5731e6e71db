"""Write a recording of a simulated cell.

Simulates a robot that touches the discs of a cell, and records joint angles and
forces as its sensors would report them: approach, press, hold, retract, noise,
sensor zero, irregular rates. The same seed gives the same recording. With
--effect the robot has physical effects beyond the base model; nothing in
the recording mentions them.

Example:
  scara-kinetostatic simulate --cell cell.yaml --truth measured --seed 7 --out recording
  scara-kinetostatic simulate --effect 'object_radius[disc_2]:radius=6e-5' --truth-file truth.yaml --out recording
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import SEED, SEVERAL, cell_option, cell_or_paper, real, whole
from scara_kinetostatic.errors import InputError

_OUT = 'recording to make: a rosbag2 folder, or a file .mcap; must not exist'
_EFFECT = 'an effect beyond the parameters, SI; repeatable'
ARGUMENTS = (
    ('--out', 'BAG', Path, _OUT, {'required': True}),
    ('--truth', 'WHAT', str, '"paper", "measured" or a YAML file (default: paper)', {'default': 'paper'}),
    ('--effect', 'NAME[TARGET]:PARAMETER=VALUE,...', str, _EFFECT, SEVERAL),
    ('--truth-file', 'FILE', Path, 'true parameters and effects; must not exist'),
    cell_option(),
    SEED,
    'touches',
    ('--plan', 'FILE', Path, 'plan of touches, or of slides along objects (see docs/reference/formats.md)'),
    ('--per-disc', 'N', whole(1), 'points around each disc (default: 12)'),
    ('--levels', 'F', real(0, above=True), 'force levels, N (default: 10 25 40)', {'nargs': '+'}),
    ('--preload', 'PART', real(0), 'press every other touch beyond its force by this part of it (default: 0)'),
    'sensors',
    ('--noise-joint', 'S', real(0), 'of the joint angles, per touch, rad (default: as the cell)'),
    ('--noise-force', 'S', real(0), 'of the force, per touch, N (default: as the cell)'),
    ('--joint-rate', 'HZ', real(1), 'joint states per second (default: 80)', {'default': 80.0}),
    ('--wrench-rate', 'HZ', real(1), 'wrenches per second (default: 98)', {'default': 98.0}),
    'form of the recording',
    ('--compression', '', ('zstd',), 'of its chunks (default: none)'),
    ('--plain', '', bool, 'the two topics only, as `ros2 bag record` writes them; no cell description'),
)


def run(args: argparse.Namespace) -> None:
    """Simulates.

    Raises:
        InputError: the cell, the plan, the truth, an effect or an option is wrong, or BAG or the truth file exists
            or cannot be written.
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """
    given = {name: getattr(args, name) for name in ('per_disc', 'levels', 'preload')}
    choices = {name: value for name, value in given.items() if value is not None}
    if args.plan and choices:
        advice = 'leave out --per-disc, --levels and --preload'
        raise InputError('--plan', 'a plan defines all touches', advice)
    from scara_kinetostatic.bags.writer import write_streams
    from scara_kinetostatic.files.atomic import all_or_nothing
    from scara_kinetostatic.model.parameters import NANO
    from scara_kinetostatic.model.quantities import count
    from scara_kinetostatic.simulation.plan import default_plan, load_plan
    from scara_kinetostatic.simulation.streams import TYPICAL_NOISE, SensorModel, simulate_streams
    from scara_kinetostatic.simulation.truth import parse_effect, truth_named, truth_text, with_effects

    cell = cell_or_paper(args.cell)
    levels = {'joint': args.noise_joint, 'force': args.noise_force}
    levels = {name: level for name, level in levels.items() if level is not None}
    noise = (cell.noise or TYPICAL_NOISE)._replace(**levels)
    sensors = SensorModel(touch_noise=noise, joint_rate=args.joint_rate, wrench_rate=args.wrench_rate)
    truth = with_effects(truth_named(args.truth, cell), [parse_effect(text, cell) for text in args.effect])
    plan = load_plan(args.plan, cell) if args.plan else default_plan(cell, **choices)
    with ExitStack() as together:
        if args.truth_file:
            workshop = together.enter_context(all_or_nothing(args.truth_file))
            (workshop / args.truth_file.name).write_text(truth_text(truth, args.seed), encoding='utf-8')
        streams = simulate_streams(cell, truth, plan, sensors=sensors, seed=args.seed)
        write_streams(args.out, streams, cell, compression=args.compression, with_cell=not args.plain)
    duration = NANO * float(max(streams.joints.stamp[-1], streams.wrench.stamp[-1]) - streams.joints.stamp[0])
    what = count(len(plan), *(('slide',) if isinstance(plan, tuple) else ('touch', 'touches')))
    print(f'{args.out}: {what} in {duration:.0f} s of simulated time')
    print('truth: ' + ', '.join(f'{name} {value:.6g}' for name, value in truth.parameters.as_dict().items()))
    for effect, values in zip(truth.effects, truth.effect_values, strict=True):
        shown = (f'{p.name} {value:.6g} {p.unit}' for p, value in zip(effect.parameters, values, strict=True))
        print(f'effect: {effect.label}: ' + ', '.join(shown))
