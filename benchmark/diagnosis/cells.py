"""Two cells with 108 touches each, and how large an effect must be for its trace to reach a given size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.fit_point import FINAL
from scara_kinetostatic.calibration.gauss_helmert import Observations
from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.solver import Subspace, minimise
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Disc, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

Floats = NDArray[np.float64]

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
"""Reduced chi-square of the fit of the twelve parameters that an effect is to bring about."""
ABSURD = 30.0
"""An effect of more than so many plausible sizes is none."""
FIRST = 1e-3
"""Where the search for a size begins, in plausible sizes."""
NEAR = 0.03
"""Relative error of a trace at which its search ends."""
STEPS = 25
CLOSE = 0.9
"""So near to a strength that cannot be played, as a part of it, the search does not go."""


class Setup(NamedTuple):
    """A cell with a robot and the touches that it makes."""

    cell: Cell
    truth: Parameters
    plan: Plan


def _setup(discs: tuple[Disc, ...], truth: Parameters, per_disc: int) -> Setup:
    cell = Cell(PAPER_NOMINAL, discs, noise=NOISE)
    return Setup(cell, truth, default_plan(cell, per_disc, preload=PRELOAD).select(np.arange(TOUCHES)))


SETUPS = {
    'paper': _setup(PAPER_DISCS, PAPER_ACTUAL, 18),
    'soft': _setup(FOUR_DISCS, PAPER_MEASURED, 14),
}
"""The paper's cell with L̄a of table 2; four other discs with the soft robot of figure 4(d)."""


class Played(NamedTuple):
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

    def scaled(self, factor: float) -> Played:
        """Effects stronger by a factor; what is no strength (a phase, a frequency) stays."""
        pairs = zip(self.effects, self.values, strict=True)
        return self._replace(values=tuple(v + (factor - 1) * effect.amplitudes(v) for effect, v in pairs))

    def beside(self, other: Played) -> Played:
        """Both together."""
        return Played((*self.effects, *other.effects), (*self.values, *other.values))

    @property
    def absurd(self) -> bool:
        """Whether an effect is larger than any robot would have it."""
        pairs = zip(self.effects, self.values, strict=True)
        return any(bool(np.max(np.abs(e.amplitudes(v)) / np.array(e.scales)) > ABSURD) for e, v in pairs)


def seed_of(*words: object) -> int:
    """A number that depends on words only."""
    return crc32(' '.join(map(str, words)).encode())


def direction(effect: Effect, seed: int) -> Played:
    """An effect in a random way that a robot may have, of plausible size."""
    random = np.random.default_rng([seed, seed_of(effect.label)])
    return Played((effect,), (effect.random_values(random),))


def play(setup: Setup, played: Played, noise: Noise = NOISE, seed: int = 0) -> TouchSet:
    """The touches of a robot with effects.

    Raises:
        UnsupportedDataError: the robot cannot hold a touch.
    """
    return simulate_touches(setup.cell, played.robot(setup.truth), setup.plan, noise, seed)


def trace(setup: Setup, played: Played) -> float:
    """By how much effects raise the reduced chi-square of the twelve parameters, fitted to all touches."""
    observations: Observations = observe(play(setup, played, Noise(0.0, 0.0)), setup.cell)
    start = ExtendedModel(setup.truth)
    subspace = Subspace(start.as_array(), np.diag(scales_of(start)))
    fit = minimise(observations, start, project(observations, start, NOISE).adjusted, subspace, NOISE, FINAL)
    return float(fit.point.distance.sum()) / (2 * len(setup.plan) - len(NAMES))


class Sized(NamedTuple):
    """Effects at a size, or why there are none.

    Attributes:
        size: reduced chi-square that they bring about.
        played: the effects; None if that size is absurd or cannot be played.
        why: it is not there; empty if it is.
    """

    size: float
    played: Played | None
    why: str = ''


def at_sizes(setup: Setup, one: Played, sizes: Sequence[float] = SIZES) -> Iterator[Sized]:
    """An effect at each size, the smallest first: the trace grows about as the square of its strength."""
    search, why = _Search(setup, one), ''
    for size in sorted(sizes):
        why = why or search.find(size)
        yield Sized(size, None if why else one.scaled(search.factor), why)


class _Search:
    """The factor by which an effect must be stronger."""

    def __init__(self, setup: Setup, one: Played) -> None:
        self.setup, self.one = setup, one
        self.factor, self.ceiling = FIRST, np.inf
        self.found = trace(setup, one.scaled(FIRST))

    def find(self, size: float) -> str:
        """Go to a size; empty if it was reached, else why not."""
        for _ in range(STEPS):
            if abs(self.found / (size - 1) - 1) < NEAR:
                return ''
            wanted = self.factor * float(np.clip(np.sqrt((size - 1) / max(self.found, 1e-300)), 0.1, 30.0))
            if self.one.scaled(wanted).absurd:
                return f'more than {ABSURD:g} plausible sizes'
            if wanted > CLOSE * self.ceiling:
                wanted = float(np.sqrt(self.factor * self.ceiling))
            if wanted > CLOSE * self.ceiling:
                return 'the robot cannot hold the touches'
            self._step(wanted)
        return 'no strength was found that brings it about'

    def _step(self, wanted: float) -> None:
        try:
            found = trace(self.setup, self.one.scaled(wanted))
        except UnsupportedDataError:
            self.ceiling = wanted
        else:
            self.factor, self.found = wanted, found
