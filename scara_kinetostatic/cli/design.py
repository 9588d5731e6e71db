"""The touches for an accuracy.

Predicts the uncertainty of a calibration before any touch is made: the standard
deviation of every parameter, and of the tip over the workspace. Recommends the
smallest set of touches that reaches an accuracy and checks itself: every disc is
touched, no touch counts on itself alone, and any one may fail. The set is written
as a plan for `simulate --plan` and for the simulated cell. What the cell
description declares as uncertain counts. Says, too, which uncertainty a calibration
is expected to state, with errors too small to be detected, and what limits it.

Example:
  scara-kinetostatic design --cell cell.yaml --accuracy 1e-5 --out design
  scara-kinetostatic simulate --cell cell.yaml --plan design/plan.yaml --out recording
"""

from __future__ import annotations

import argparse

from scara_kinetostatic.cli.shared_arguments import (
    JSON,
    cell_option,
    cell_or_paper,
    out_option,
    print_report,
    progress,
    real,
    whole,
)

_positive = real(0, above=True)


_ACCURACY = 'largest standard deviation of the tip, m (default: half the tolerance of the cell, or 1e-5)'
_LEVELS = {'nargs': '+', 'default': [10.0, 25.0, 40.0]}
ARGUMENTS = (
    cell_option(),
    ('--accuracy', 'S', real(0, 5e-3, above=True), _ACCURACY),
    out_option(files='plan.yaml, design.json, design.html'),
    JSON,
    'robot',
    ('--expected', 'WHAT', str, '"nominal", "paper", "measured" or a YAML file', {'default': 'nominal'}),
    ('--noise-joint', 'S', _positive, 'joint noise of one touch, rad'),
    ('--noise-force', 'S', _positive, 'force noise of one touch, N'),
    ('--load', 'F', _positive, 'on the loaded tip, N (default: top level)'),
    ('--under-load', '', bool, 'the accuracy is required of the loaded tip'),
    'candidate touches',
    ('--levels', 'F', _positive, 'force levels, N (default: 10 25 40)', _LEVELS),
    ('--postures', '', ('both', 'left', 'right'), 'of the elbow (default: both)', {'default': 'both'}),
    ('--per-disc', 'N', whole(3), 'points around a disc (default: 36)', {'default': 36}),
)


def run(args: argparse.Namespace) -> None:
    """Finds the set.

    Raises:
        InputError: the cell, the expected robot or an option is wrong, or DIR cannot be written.
        UnsupportedDataError: the accuracy is out of reach.
    """
    from scara_kinetostatic.planning.optimal_design import Requirements, optimal_design
    from scara_kinetostatic.planning.prediction import RobotModel
    from scara_kinetostatic.planning.report import design_document, design_report, plan_text
    from scara_kinetostatic.simulation.streams import TYPICAL_NOISE
    from scara_kinetostatic.simulation.truth import truth_named

    cell = cell_or_paper(args.cell)
    given = {'joint': args.noise_joint, 'force': args.noise_force}
    noise = (cell.noise or TYPICAL_NOISE)._replace(**{name: level for name, level in given.items() if level})
    assumed = () if cell.noise else tuple(name for name, level in given.items() if not level)
    expected = cell.nominal if args.expected == 'nominal' else truth_named(args.expected, cell).parameters
    requirements = Requirements(
        accuracy=args.accuracy,
        levels=tuple(dict.fromkeys(args.levels)),
        postures={'both': (1, -1), 'left': (1,), 'right': (-1,)}[args.postures],
        per_disc=args.per_disc,
        load=args.load or max(args.levels),
        under_load=args.under_load,
    )
    with progress() as show_progress:
        design = optimal_design(RobotModel(cell, expected, noise, assumed), requirements, show_progress)
    plan = {'plan.yaml': plan_text(design)}
    print_report(args, 'design', design_report(design), design_document(design), plan)
