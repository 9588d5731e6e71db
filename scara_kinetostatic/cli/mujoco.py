"""Write a recording of a cell in the engine MuJoCo.

Builds a robot and its discs in the physics engine MuJoCo (bodies, springs,
friction, contact; none of this package's own equations of the arm), simulates
the touches, and records joint angles and forces. The true parameters and
effects are written to OUT.truth.yaml; the recording and its cell description do
not contain them. Needs MuJoCo: pip install '.[physics]' in the repository

The scenes are plain, contact_friction, joint_friction, winding_friction,
joint_slip, joint_slip_fast, displaced_disc, base_on_springs, link_flex,
soft_contact, soft_disc, tilted_base, cable and two.

Example:
  scara-kinetostatic mujoco recording --scene contact_friction
  scara-kinetostatic calibrate recording --out result
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import SEED, cell_option, cell_or_paper, whole
from scara_kinetostatic.errors import OutputError

ARGUMENTS = (
    ('out', 'OUT', Path, 'recording to make: a rosbag2 folder, or a file .mcap; must not exist'),
    ('--scene', 'NAME', str, 'robot and discs (default: plain)', {'default': 'plain'}),
    ('--per-disc', 'N', whole(1), 'points around a disc (default: 12)', {'default': 12}),
    cell_option(),
    SEED,
)


def run(args: argparse.Namespace) -> None:
    """Simulates a scene.

    Raises:
        InputError: the cell, the scene or an option is wrong, OUT or its truth exists, or MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach.
    """
    from scara_kinetostatic.bags.writer import write_streams
    from scara_kinetostatic.files.atomic import all_or_nothing
    from scara_kinetostatic.model.parameters import NANO
    from scara_kinetostatic.simulation.mujoco import preload_plan, scene_named, simulate_streams, truth_of_scene
    from scara_kinetostatic.simulation.truth import dump, truth_named

    cell = cell_or_paper(args.cell)
    scene = replace(scene_named(args.scene), parameters=truth_named('paper', cell).parameters)
    truth = dump(truth_of_scene(scene, cell, args.seed))
    beside = args.out.with_name(args.out.name + '.truth.yaml')
    if args.out.exists():
        raise OutputError(args.out, 'exists already and is never overwritten', 'choose another name')
    with all_or_nothing(beside) as workshop:
        plan = preload_plan(cell, args.per_disc)
        streams = simulate_streams(scene, cell, plan, seed=args.seed)
        (workshop / beside.name).write_text(truth, encoding='utf-8')
        write_streams(args.out, streams, cell)
    duration = NANO * float(streams.joints.stamp[-1] - streams.joints.stamp[0])
    print(f'{args.out}: {len(plan)} touches of the scene {scene.name!r} in {duration:.0f} s of simulated time')
    print(f'{beside}: true parameters and effects')
