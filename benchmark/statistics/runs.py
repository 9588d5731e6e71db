"""Simulated touches, calibrated over and over: with fresh noise, and from nominal values far off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from benchmark.common import CELL, EXACT, NOISE, ROBOTS
from benchmark.statistics.bound import Bound, bound
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

LENGTH_OFF, ANGLE_OFF, FACTOR_OFF = 0.020, np.deg2rad(3.0), 5.0
"""How far nominal values are off: lengths and base ± m, offsets ± rad, compliances and backlashes × or ÷."""
LARGEST_OFFSETS = np.array([LENGTH_OFF, LENGTH_OFF, ANGLE_OFF, LENGTH_OFF, ANGLE_OFF, LENGTH_OFF])
SAME_COST, SAME_VALUE = 1e-6, 1e-3
"""Two optima are one if costs agree to this part and parameters to this many standard deviations."""


class Task(NamedTuple):
    """Runs that are made one after the other.

    Attributes:
        section: ``noise``, ``starts`` or ``outliers``.
        robot: name in `ROBOTS`.
        noise: ``given`` or ``estimated``.
        per_disc: points around each disc; 12 make 72 touches, 18 make 108.
        seeds: of the runs.
    """

    section: str
    robot: str
    noise: str
    per_disc: int
    seeds: range


class Setup(NamedTuple):
    """A robot, its touches as they truly are, and the bound that goes with them."""

    truth: Parameters
    plan: Plan
    exact: TouchSet
    bound: Bound


@dataclass
class NoiseRun:
    """One calibration of touches with fresh noise.

    Attributes:
        error: of the estimate, (12,).
        std: stated with it, (12,); NaN where confounded.
        ideal: error of the estimate that attains the bound, for the same noise, (12,).
        freedoms: degrees of freedom.
        rejected: number of touches, all of them good.
        levels: σ_q and σ_f, given or estimated.
    """

    error: Floats
    std: Floats
    ideal: Floats
    freedoms: int
    rejected: int
    levels: tuple[float, float]


@dataclass
class StartRun:
    """One calibration from nominal values far off, compared with that from the nominal robot.

    Attributes:
        cost: its difference, relative.
        value: largest difference of a parameter, in standard deviations.
        iterations: steps.
        error: that came instead; empty if none did.
    """

    cost: float
    value: float
    iterations: int
    error: str = ''

    @property
    def same(self) -> bool:
        """Whether it is the same optimum."""
        return not self.error and self.cost <= SAME_COST and self.value <= SAME_VALUE


@cache
def setup_of(robot: str, per_disc: int) -> Setup:
    """The paper's cell, three force levels, both postures."""
    truth, plan = ROBOTS[robot], default_plan(CELL, per_disc)
    exact = simulate_touches(CELL, truth, plan, EXACT)
    return Setup(truth, plan, exact, bound(CELL, truth, exact, NOISE))


def described_cell(noise: str) -> Cell:
    """The cell description with its noise, or without."""
    return replace(CELL, noise=NOISE if noise == 'given' else None)


def run_noise(task: Task) -> list[NoiseRun]:
    """Fresh noise each time."""
    setup, cell = setup_of(task.robot, task.per_disc), described_cell(task.noise)
    runs = []
    for seed in task.seeds:
        touches = simulate_touches(CELL, setup.truth, setup.plan, NOISE, seed)
        found = calibrate(touches, cell)
        ideal = setup.bound.ideal(touches.joints - setup.exact.joints, touches.force - setup.exact.force)
        levels = (found.noise.joint_rms, found.noise.force_rms)
        freedoms, rejected = found.degrees_of_freedom, len(found.rejected)
        runs.append(NoiseRun(error_of(found, setup.truth), found.std, ideal, freedoms, rejected, levels))
    return runs


def error_of(found: Calibration, truth: Parameters) -> Floats:
    """Estimate less truth, (12,)."""
    return found.parameters.as_array() - truth.as_array()


def run_starts(task: Task) -> list[StartRun]:
    """The same touches, other nominal values each time."""
    setup, cell = setup_of(task.robot, task.per_disc), described_cell(task.noise)
    touches = simulate_touches(CELL, setup.truth, setup.plan, NOISE, seed=0)
    reference = calibrate(touches, cell)
    runs = []
    for seed in task.seeds:
        try:
            found = calibrate(touches, replace(cell, nominal=distant_nominal(setup.truth, seed)))
        except ScaraKinetostaticError as error:
            runs.append(StartRun(np.inf, np.inf, 0, str(error)))
            continue
        moved = found.parameters.as_array() - reference.parameters.as_array()
        cost = abs(found.chi_square - reference.chi_square) / reference.chi_square
        same_touches = bool((found.used == reference.used).all())
        value = float(np.abs(moved / reference.std).max())
        runs.append(StartRun(cost if same_touches else np.inf, value, found.iterations))
    return runs


def distant_nominal(truth: Parameters, seed: int) -> Parameters:
    """Nominal values as far off as `OFF` and `FACTOR_OFF` say, at random."""
    random = np.random.default_rng([seed, 17])
    values = truth.as_array()
    values[: len(LARGEST_OFFSETS)] += LARGEST_OFFSETS * random.uniform(-1, 1, len(LARGEST_OFFSETS))
    values[len(LARGEST_OFFSETS) : len(NAMES)] *= FACTOR_OFF ** random.uniform(-1, 1, len(NAMES) - len(LARGEST_OFFSETS))
    return Parameters.from_array(values)
