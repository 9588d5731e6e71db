"""Cells with declared uncertainties, and touches of worlds drawn from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmark.common import NO_OTHERS
from benchmark.diagnosis.cells import SETUPS, Setup, seed_of
from scara_kinetostatic.model.cell import Cell, Plate, Uncertainty
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World

SENSOR = replace(NO_OTHERS, force_gain=0.005, force_rotation=1e-3)


def _discs(cell: Cell, center: float, radius: float) -> Cell:
    discs = tuple(disc._replace(center_std=center, radius_std=radius) for disc in cell.discs)
    return replace(cell, discs=discs)


def _measured(cell: Cell, center: float, radius: float) -> Cell:
    return replace(_discs(cell, center, radius), uncertainty=SENSOR)


def _plate(cell: Cell) -> Cell:
    discs = tuple(disc._replace(center_std=3e-6, plate='plate') for disc in cell.discs)
    return replace(cell, discs=discs, plates=(Plate('plate', 0.0, 0.3, 1e-3, 2e-3),))


def _everything(cell: Cell) -> Cell:
    """Discs on two plates and beside them, a tip of uncertain radius, sensor and data sheet."""
    first, *others = _discs(cell, 1.5e-5, 5e-6).discs
    discs = (first, *(disc._replace(center_std=3e-6, plate='plate') for disc in others))
    common = Uncertainty(5e-6, 0.005, 1e-3, {'l1': 2e-4, 'p1': 1e-6, 'theta1': 1e-3}, NO_OTHERS.effects)
    return replace(cell, discs=discs, plates=(Plate('plate', 0.1, 0.3, 5e-5, 2e-4),), uncertainty=common)


KINDS: dict[str, Callable[[Cell], Cell]] = {
    'exact': lambda cell: cell,
    'small': lambda cell: _measured(cell, 1.5e-5, 5e-6),
    'large': lambda cell: _measured(cell, 5e-5, 2e-5),
    'plate': _plate,
    'everything': _everything,
}
"""What is declared: nothing; discs to 15 µm and 5 µm, or 50 µm and 20 µm, gain 0.5 % and rotation 1 mrad; three discs
known to 3 µm on a plate that was put down to 1 mm and 2 mrad; a mixture with a common radius and trusted values."""


def declared_setup(name: str, kind: str) -> Setup:
    """A cell of the benchmark of the diagnosis with declared uncertainties."""
    setup = SETUPS[name]
    return setup._replace(cell=KINDS[kind](setup.cell))


def drawn(setup: Setup, seed: int, *named: object, displaced: float = 0.0) -> tuple[World, Parameters, TouchSet]:
    """A world, its robot and the touches that the robot makes in it.

    Args:
        setup: cell, robot, plan.
        seed: of errors and noise.
        named: what else the draw depends on.
        displaced: so many declared standard uncertainties an object is off its place, in a random direction; which
            one goes round with the seed.
    """
    random = np.random.default_rng([seed, seed_of(*named)])
    world = World.draw(setup.cell, random)
    if displaced:
        angle, which = random.uniform(0, 2 * np.pi), seed % len(setup.cell.discs)
        errors = world.errors.copy()
        errors[2 * which : 2 * which + 2] = displaced * np.cos(angle), displaced * np.sin(angle)
        world = World.of(setup.cell, errors, world.nominal_errors)
    robot = world.robot(setup.truth)
    noise_seed = int(random.integers(2**31))
    touches = simulate_touches(world.cell, robot, setup.plan, setup.cell.noise, noise_seed)
    return world, robot, world.reported(touches)
