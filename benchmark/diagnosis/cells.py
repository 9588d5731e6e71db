"""Two cells with 108 touches each, and effects scaled to a given detectability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple
from zlib import crc32

import numpy as np

from benchmark.common import NO_OTHERS
from scara_kinetostatic.calibration.fit_point import FINAL, project
from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.observations import Observations, observe
from scara_kinetostatic.calibration.solver import Subspace, minimise
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Disc, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

NOISE = Noise(joint=1e-5, force=0.3)
TOUCHES = 108
PRELOAD = 0.3
FOUR_DISCS = (
    Disc('disc_1', 0.33, 0.22, 0.06),
    Disc('disc_2', -0.02, 0.40, 0.10),
    Disc('disc_3', -0.36, 0.10, 0.08),
    Disc('disc_4', 0.20, -0.33, 0.05),
)
SIZES = (1.3, 2.0, 5.0)
"""Reduced chi-square of the fit of the base model at which each effect is simulated."""
LARGEST_PLAUSIBLE = 30.0
"""Largest size of an effect, in plausible sizes."""
FIRST_FACTOR = 1e-3
"""First factor of the search for a size, in plausible sizes."""
SIZE_TOLERANCE = 0.03
"""Relative error of a size at which its search ends."""
MOST_STEPS = 25
CEILING_MARGIN = 0.9
"""The search stays below this part of the smallest factor that cannot be simulated."""


class Setup(NamedTuple):
    """A cell with a robot and the touches that it makes."""

    cell: Cell
    truth: Parameters
    plan: Plan


def _setup(discs: tuple[Disc, ...], truth: Parameters, per_disc: int) -> Setup:
    cell = Cell(PAPER_NOMINAL, discs, noise=NOISE, uncertainty=NO_OTHERS)
    return Setup(cell, truth, default_plan(cell, per_disc, preload=PRELOAD).select(np.arange(TOUCHES)))


SETUPS = {'paper': _setup(PAPER_DISCS, PAPER_ACTUAL, 18), 'soft': _setup(FOUR_DISCS, PAPER_MEASURED, 14)}
"""The paper's cell with L̄a of table 2; four other discs with the soft robot of figure 4(d)."""


class SimulatedEffects(NamedTuple):
    """Effects with the values of their parameters, effect by effect."""

    effects: tuple[Effect, ...]
    values: tuple[Floats, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the effects."""
        return tuple(effect.label for effect in self.effects)

    def robot(self, truth: Parameters) -> ExtendedModel:
        """A robot with these effects."""
        return ExtendedModel(truth, self.effects, tuple(tuple(part.tolist()) for part in self.values))

    def scaled(self, factor: float) -> SimulatedEffects:
        """Effects scaled by a factor; a phase or a frequency is not scaled."""
        pairs = zip(self.effects, self.values, strict=True)
        return self._replace(values=tuple(v + (factor - 1) * effect.amplitudes(v) for effect, v in pairs))

    def combined(self, other: SimulatedEffects) -> SimulatedEffects:
        """Both together."""
        return SimulatedEffects((*self.effects, *other.effects), (*self.values, *other.values))

    @property
    def implausible(self) -> bool:
        """Whether an effect is implausibly large."""
        pairs = zip(self.effects, self.values, strict=True)
        return any(
            bool(np.max(np.abs(e.amplitudes(v)) / np.array([p.scale for p in e.parameters])) > LARGEST_PLAUSIBLE)
            for e, v in pairs
        )


def seed_of(*named_text: object) -> int:
    """A number that depends on words only."""
    return crc32(' '.join(map(str, named_text)).encode())


def random_effect(effect: Effect, seed: int) -> SimulatedEffects:
    """An effect in a random way that a robot may have, of plausible size."""
    random = np.random.default_rng([seed, seed_of(effect.label)])
    return SimulatedEffects((effect,), (random_values(effect, random),))


def random_values(effect: Effect, random: np.random.Generator) -> Floats:
    """Values (k,) of plausible size in a random direction: a wave of any phase and frequency, gravity downhill; none of
    what L̄ contains, which is last.
    """
    shown = [p for p in effect.parameters if not p.is_alias]
    scales, signs = (np.array([getattr(p, name) for p in shown]) for name in ('scale', 'sign'))
    if effect.name == 'transmission_error':
        return np.array([scales[0], random.uniform(0, 2 * np.pi), random.uniform(1.0, 110.0)])
    if effect.name == 'joint_slip':  # with a slip torque as measured on a real arm or up to twice as large
        return np.array([scales[0], random.uniform(0.5, 4.0)])
    if effect.name == 'load_friction':  # as measured on real gears, and less
        return np.array([scales[0], random.uniform(0.1, 0.5)])
    if effect.name == 'base_tilt':
        angle, (first, second) = random.uniform(0, 2 * np.pi), random.uniform(0.3, 1.0, 2)
        downhill = np.array([np.cos(angle), np.sin(angle)])
        return scales * np.concatenate([first * downhill, second * downhill])
    unit = random.standard_normal(len(scales) - effect.is_stepwise)
    values = scales[: len(unit)] * unit / np.linalg.norm(unit)
    if effect.is_stepwise:
        return np.array([*values, random.integers(10, 60) + 0.5])
    return np.pad(np.where(signs == 0, values, signs * np.abs(values)), (0, len(effect.parameters) - len(shown)))


def simulate(setup: Setup, simulated: SimulatedEffects, noise: Noise = NOISE, seed: int = 0) -> TouchSet:
    """The touches of a robot with effects.

    Raises:
        UnsupportedDataError: the robot cannot hold a touch.
    """
    return simulate_touches(setup.cell, simulated.robot(setup.truth), setup.plan, noise, seed)


def chi_square_increase(setup: Setup, simulated: SimulatedEffects) -> float:
    """By how much effects raise the reduced chi-square of the base model, fitted to all touches."""
    observations: Observations = observe(simulate(setup, simulated, Noise(0.0, 0.0)), setup.cell)
    start = ExtendedModel(setup.truth)
    subspace, noise = Subspace(start.as_array(), np.diag(scales_of(start))), setup.cell.noise or NOISE
    fit = minimise(observations, project(observations, start, noise), subspace, noise, FINAL)
    return float(fit.point.distance.sum()) / (2 * len(setup.plan) - len(NAMES))


class Sized(NamedTuple):
    """Effects at a size, or why there are none.

    Attributes:
        size: reduced chi-square that they give.
        simulated: the effects; None if that size is implausible or cannot be simulated.
        reason: why there are none; empty if there are.
    """

    size: float
    simulated: SimulatedEffects | None
    reason: str = ''


def at_sizes(setup: Setup, one: SimulatedEffects, sizes: Sequence[float] = SIZES) -> Iterator[Sized]:
    """An effect at each size, the smallest first: the chi-square grows about as the square of the amplitude."""
    search, reason = _Search(setup, one), ''
    for size in sorted(sizes):
        reason = reason or search.find(size)
        yield Sized(size, None if reason else one.scaled(search.factor), reason)


class _Search:
    """The factor by which an effect must be stronger."""

    def __init__(self, setup: Setup, one: SimulatedEffects) -> None:
        self.setup, self.one = setup, one
        self.factor, self.ceiling = FIRST_FACTOR, np.inf
        self.found = chi_square_increase(setup, one.scaled(FIRST_FACTOR))

    def find(self, size: float) -> str:
        """Go to a size; empty if it was reached, else why not."""
        for _ in range(MOST_STEPS):
            if abs(self.found / (size - 1) - 1) < SIZE_TOLERANCE:
                return ''
            wanted = self.factor * float(np.clip(np.sqrt((size - 1) / max(self.found, 1e-300)), 0.1, 30.0))
            if self.one.scaled(wanted).implausible:
                return f'more than {LARGEST_PLAUSIBLE:g} plausible sizes'
            if wanted > CEILING_MARGIN * self.ceiling:
                wanted = float(np.sqrt(self.factor * self.ceiling))
            if wanted > CEILING_MARGIN * self.ceiling:
                return 'the robot cannot hold the touches'
            self._step(wanted)
        return 'no factor was found that gives it'

    def _step(self, wanted: float) -> None:
        try:
            found = chi_square_increase(self.setup, self.one.scaled(wanted))
        except UnsupportedDataError:
            self.ceiling = wanted
        else:
            self.factor, self.found = wanted, found
