"""The physics engine against the model: what twelve parameters leave, and what the effect that was built explains.

    python -m benchmark.physics [--scene NAME …] [--per-disc 18] [--seed 1]

Each scene is played once; its touches are read at the end of the holds, exact and with the noise of a touch.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.physics.player import Player
from scara_kinetostatic.physics.recorded import as_touches, usual_plan, with_noise
from scara_kinetostatic.physics.scene import SCENES, Scene, scene_named
from scara_kinetostatic.physics.truth import built_effects, expected_parameters

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))


def report(scene: Scene, per_disc: int, seed: int) -> None:
    """Plays a scene and prints what the fits say."""
    plan = usual_plan(CELL, per_disc)
    begin = time.perf_counter()
    played = Player(scene, CELL, plan).play()
    seconds = time.perf_counter() - begin
    exact = as_touches(played, CELL, plan)
    early = played.force[played.holds - 100]  # 0.2 s before the end of the hold
    drift = np.abs(exact.force - early).max()
    print(f'{scene.name}: {len(plan)} touches, {played.time[-1]:.0f} s played in {seconds:.1f} s, ', end='')
    print(f'force changes by at most {drift:.1g} N in the last 0.2 s of a hold')
    show('exact, twelve parameters', scene, exact, CELL)
    noisy = with_noise(exact, CELL, seed=seed)
    show('noise, twelve parameters', scene, noisy, CELL)
    known = {effect.label for effect in catalogue(CELL)}
    labels = [e['name'] + (f'[{e["target"]}]' if e['target'] else '') for e in built_effects(scene, CELL)]
    if labels and set(labels) <= known:
        cell = replace(CELL, effects=tuple(find(CELL, label) for label in labels))
        show('noise, with ' + ' '.join(labels), scene, noisy, cell)


def show(what: str, scene: Scene, touches: TouchSet, cell: Cell) -> None:
    """One line about one fit."""
    try:
        fit: Calibration = calibrate(touches, cell)
    except UnsupportedDataError as error:
        print(f'  {what}: {error}')
        return
    expected = expected_parameters(scene).as_array()[:12]
    error = np.abs(fit.parameters.as_array()[:12] - expected) / fit.std[:12]
    extra = ' '.join(f'{value:.3g}' for value in getattr(fit.parameters, 'extra', ()))
    print(
        f'  {what}: reduced chi-square {fit.reduced_chi_square:.3g}, e_f {fit.force_error:.3g} N, largest residual '
        f'{np.abs(fit.residual).max():.2g} N, used {fit.used.sum()}, largest |z| {np.nanmax(error):.1f}'
        + (f', effect {extra}' if extra else '')
    )


def main() -> int:
    """Runs the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else '')
    parser.add_argument('--scene', nargs='+', default=list(SCENES), metavar='NAME')
    parser.add_argument('--per-disc', type=int, default=18)
    parser.add_argument('--seed', type=int, default=1)
    args = parser.parse_args()
    for name in args.scene:
        report(scene_named(name), args.per_disc, args.seed)
    return 0


if __name__ == '__main__':
    sys.exit(main())
