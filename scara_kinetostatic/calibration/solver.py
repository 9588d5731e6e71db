"""The accept/reject loop of the adjustment: Gauss–Newton, damped where a step fails.

In scaled parameters a start 20 mm and 3° off takes five or six steps. Each stage is
one run of the loop: coarse, with observations as measured and Cauchy's loss; robust, with adjusted
observations and the same loss, to find its way among wrong touches; final, the sum
of squares over those that are used.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration import steps
from scara_kinetostatic.calibration.blocks import in_blocks, pick
from scara_kinetostatic.calibration.gauss_helmert import (
    Adjusted,
    Observations,
    adjust,
    as_measured,
    linearise,
)
from scara_kinetostatic.calibration.whitening import Linearisation, Whitened, squared_distance, whiten
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.statics import Arm

MAX_ITERATIONS = 60
STEP_TOLERANCE = 1e-14
"""A step shorter than this in scaled parameters is rounding error."""
RELATIVE_OFFSET = 1e-4
"""A step that moves the predictions by a smaller part of the residual than this is the last one, taken to first order
(Bates and Watts, Technometrics 23 (1981) 179)."""
LARGEST_OFFSET = 1e-3
"""The same in standard deviations, however large the residual."""
SAME_COST = 1.01
"""The cost has come to rest if the last step lowered it by less; it never does where touches are exact."""
STALL_TOLERANCE = 1e-9
MAX_DAMPING = 1e12
FREEZE_AFTER = 12
"""Steps of a run after which every joint stays on its flank: at the edge of a dead band it may else go to and fro."""


class Termination(Enum):
    """How the loop ended."""

    CONVERGED = 'converged'
    STALLED = 'stalled'
    ITERATION_LIMIT = 'iteration limit'

    @property
    def advice(self) -> str:
        """What it means for the user."""
        return {
            Termination.CONVERGED: 'the estimate is at the optimum',
            Termination.STALLED: 'no step lowers the error any more, short of the optimum; '
            'look at the rejected touches and at the cell file',
            Termination.ITERATION_LIMIT: 'the estimate had not settled; check disc places, sensor frame and sign',
        }[self]


class Stage(NamedTuple):
    """One run of the loop.

    Attributes:
        adjusts: whether observations are adjusted or taken as measured.
        robust: Cauchy's loss instead of the sum of squares.
        tolerance: a step that moves all predictions together by fewer standard
            deviations than this ends the run.
        per_touch: the same for the root mean square over the touches; the larger bound counts. What a
            stage leaves to the next one need not be exact, unless there are effects, which may be far from linear.
        damping: least damping. A direction of L̄ whose full plausible range the data
            hardly show (singular value below 1) is left alone before it is judged.
    """

    adjusts: bool
    robust: bool
    tolerance: float
    per_touch: float
    damping: float


COARSE = Stage(adjusts=False, robust=True, tolerance=0.3, per_touch=0.3, damping=1.0)
ROBUST = Stage(adjusts=True, robust=True, tolerance=1e-2, per_touch=0.1, damping=1.0)
FINAL = Stage(adjusts=True, robust=False, tolerance=1e-6, per_touch=0.0, damping=0.0)


class Subspace(NamedTuple):
    """Which changes of L̄ the fit may make: L̄ = origin + basis y.

    Attributes:
        origin: (12,).
        basis: (12, k); its columns carry the scale of each change.
    """

    origin: Floats
    basis: Floats

    def project(self, model: ExtendedModel) -> ExtendedModel:
        """The nearest model that the subspace holds, in scaled terms."""
        y = np.linalg.lstsq(self.basis, model.as_array() - self.origin, rcond=None)[0]
        return model.with_array(self.origin + self.basis @ y)


class Point(NamedTuple):
    """The adjustment evaluated at one model."""

    model: ExtendedModel
    adjusted: Adjusted
    linear: Linearisation
    whitened: Whitened
    distance: Floats

    @property
    def parameters(self) -> Parameters:
        """L̄."""
        return self.model.parameters


class Fit(NamedTuple):
    """Where the loop ended, and how.

    Attributes:
        point: the last accepted point.
        system: the compressed system there, in y.
        iterations: steps tried.
        history: robust or plain cost after each step.
        termination: how it ended.
    """

    point: Point
    system: steps.Compressed
    iterations: int
    history: tuple[float, ...]
    termination: Termination


def evaluate(
    observations: Observations, model: ExtendedModel, adjusted: Adjusted, noise: Noise, stage: Stage = FINAL
) -> Point:
    """Linearise and whiten at one model."""

    def part(where: slice) -> tuple[Linearisation, Whitened, Floats]:
        return _evaluate(observations.select(where), model, pick(adjusted, where), noise, stage)

    return Point(model, adjusted, *in_blocks(len(observations.joints), part))


def _evaluate(
    observations: Observations,
    model: ExtendedModel,
    adjusted: Adjusted,
    noise: Noise,
    stage: Stage,
    arm: Arm | None = None,
) -> tuple[Linearisation, Whitened, Floats]:
    linear = linearise(observations, model, adjusted, arm)
    extra = 0.0 if stage.adjusts else _direction_variance(observations, noise)
    whitened = whiten(linear, noise, extra)
    return linear, whitened, squared_distance(whitened)


def _direction_variance(observations: Observations, noise: Noise) -> Floats:
    """What the measured direction of the force adds to V11 in the coarse stage, (n,), m²."""
    off_normal_std = noise.force**2 / (observations.force**2).sum(axis=-1)
    return (observations.radii * off_normal_std) ** 2


def minimise(
    observations: Observations,
    start: ExtendedModel,
    adjusted: Adjusted,
    subspace: Subspace,
    noise: Noise,
    stage: Stage,
    used: Mask | None = None,
    max_iterations: int = MAX_ITERATIONS,
) -> Fit:
    """Find the L̄ of least cost in a subspace.

    Args:
        observations: the touches.
        start: the model to start from.
        adjusted: adjusted observations to start from (`first_guess`, or those of an earlier run).
        subspace: the changes allowed.
        noise: σ_q and σ_f.
        stage: which run this is.
        used: touches that count, (n,); the others are adjusted along, without a say. None for all.
        max_iterations: steps at most.

    Returns:
        The fit; how it ended is in `termination`, nothing is raised.
    """
    point = evaluate(observations, start, adjusted, noise, stage)
    used = None if used is None or used.all() else used
    system, scale = _system(point, subspace, stage, used)
    per_touch = 0.0 if start.effects else stage.per_touch
    tolerance = max(stage.tolerance, per_touch * np.sqrt(len(point.distance)))
    damping, iterations, termination = stage.damping, 0, Termination.ITERATION_LIMIT
    history: list[float] = []
    while iterations < max_iterations:
        iterations += 1
        step = steps.damped_step(system, damping)
        change, shift = subspace.basis @ step, steps.predicted_shift(system, step)
        cost = _cost(point, scale, stage, used)
        converged = shift < tolerance or float(np.abs(step).max(initial=0.0)) < STEP_TOLERANCE
        if (converged and not stage.adjusts) or (damping == stage.damping and shift < _negligible(history)):
            point, termination = _last_step(point, change), Termination.CONVERGED
            history.append(_cost(point, scale, stage, used))
            break
        trial = _move(observations, point, change, noise, stage, iterations > FREEZE_AFTER)
        trial_cost = _cost(trial, scale, stage, used)
        if np.isfinite(trial_cost) and (converged or shift < 1e-3 or trial_cost <= cost * (1 + STALL_TOLERANCE)):
            point, damping = trial, max(stage.damping, damping / 10 if damping > 1e-6 else 0.0)
            history.append(trial_cost)
            system, scale = _system(point, subspace, stage, used)
            if converged:
                termination = Termination.CONVERGED
                break
        else:
            largest = float(system.values.max(initial=0.0)) ** 2
            damping = max(10 * damping, 1e-10 * largest)
            if damping > MAX_DAMPING * largest:
                termination = Termination.STALLED
                break
    return Fit(point, system, iterations, tuple(history), termination)


def _negligible(history: Sequence[float]) -> float:
    """Standard deviations below which a step need not be looked at again; 0 while the cost still falls."""
    if len(history) < 2 or history[-2] > SAME_COST * history[-1]:
        return 0.0
    return min(RELATIVE_OFFSET * float(np.sqrt(history[-1])), LARGEST_OFFSET)


def _last_step(point: Point, change: Floats) -> Point:
    """The point after a step so short that it is taken to first order, without looking again."""
    model = point.model.with_array(point.model.as_array() + change)
    w = point.whitened
    whitened = w._replace(residual=w.residual + w.derivative @ change)
    return point._replace(model=model, whitened=whitened, distance=squared_distance(whitened))


def _move(observations: Observations, point: Point, change: Floats, noise: Noise, stage: Stage, frozen: bool) -> Point:
    model = point.model.with_array(point.model.as_array() + change)

    def part(where: slice) -> tuple[Adjusted, Linearisation, Whitened, Floats]:
        o, (_, adjusted, linear, whitened, _) = observations.select(where), part_of(point, where)
        if stage.adjusts:
            adjusted, arm = adjust(o, model, adjusted, linear, whitened, change, noise, frozen)
        else:
            adjusted, arm = as_measured(o, model, adjusted.state)
        return adjusted, *_evaluate(o, model, adjusted, noise, stage, arm)

    with np.errstate(all='ignore'):
        return Point(model, *in_blocks(len(observations.joints), part))


def part_of(point: Point, where: slice) -> Point:
    """Consecutive touches of a point."""
    if len(point.distance) <= where.stop - where.start:
        return point
    return Point(
        point.model,
        pick(point.adjusted, where),
        pick(point.linear, where),
        pick(point.whitened, where),
        pick(point.distance, where),
    )


def _system(point: Point, subspace: Subspace, stage: Stage, used: Mask | None) -> tuple[steps.Compressed, float]:
    scale, weights = 1.0, None if used is None else used.astype(float)
    if stage.robust:
        scale = steps.typical_scale(_of_used(point, used))
        weights = steps.robust_weights(point.distance, scale) * (1.0 if weights is None else weights)
    w = point.whitened
    return steps.compress(w.derivative, w.residual, weights, subspace.basis), scale


def _cost(point: Point, scale: float, stage: Stage, used: Mask | None) -> float:
    distance = _of_used(point, used)
    return steps.robust_cost(distance, scale) if stage.robust else float(distance.sum())


def _of_used(point: Point, used: Mask | None) -> Floats:
    return point.distance if used is None else point.distance[used]
