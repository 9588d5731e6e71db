"""Least-squares fit of a law to some rows of a motion, and its prediction of the others.

The law is always evaluated along the whole displacement; only the residuals of the rows in the fit count. Slip and gap
give the sum of squares several local minima: many starting points are evaluated and the best few are optimised.
Standard deviations are those of the delete-one-cycle jackknife, since residuals within a cycle are correlated.

Bounded least squares for laws with kinks, the same on every machine.

Where the sum of squares has a kink (slip sets in at one sample more), Gauss-Newton steps end; steps along single
parameters lead out of it. Parameters that the data leave open would follow the rounding errors; a small penalty keeps
them at their start. Sums of squares that differ by rounding are equal: the first counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.laws import Law, Parameter, Values
from scara_kinetostatic.studies.hysteresis.motion import Motion, Rows


def minimise(
    residual: Callable[[Floats], Floats],
    jacobian: Callable[[Floats], Floats],
    first: Floats,
    bounds: tuple[Floats, Floats],
    penalty: float | Floats,
    evaluations: int = 60,
) -> Floats:
    """The parameters of the least sum of squares near a starting point.

    Args:
        residual: of the parameters, which are scaled to the order of 1.
        jacobian: its derivatives.
        first: the starting point.
        bounds: least and largest values.
        penalty: of a change of a parameter by 1 from its start, over the norm of the residual there.
        evaluations: largest number in the Gauss-Newton steps.
    """
    inside = np.clip(first, bounds[0] + 1e-9, bounds[1] - 1e-9)
    scale = float(np.linalg.norm(residual(inside))) or 1.0
    weight = np.diag(np.broadcast_to(penalty, inside.shape))
    found = least_squares(
        lambda scaled: np.concatenate([residual(scaled) / scale, weight @ (scaled - inside)]),
        inside,
        lambda scaled: np.concatenate([jacobian(scaled) / scale, weight]),
        bounds=bounds,
        x_scale='jac',
        max_nfev=evaluations,
        ftol=1e-9,
        xtol=1e-9,
        gtol=None,
    )
    return np.asarray(found.x)


def out_of_kinks(
    residual: Callable[[Floats], Floats], scaled: Floats, bounds: tuple[Floats, Floats], gain: float = 1e-9
) -> Floats:
    """Steps along single parameters as long as they gain a share of the sum of squares, the largest first."""
    square, step = float(np.sum(residual(scaled) ** 2)), 1e-2
    for _ in range(20):
        before = square
        for change in step * np.concatenate([np.eye(len(scaled)), -np.eye(len(scaled))]):
            tried = np.clip(scaled + change, *bounds)
            new = float(np.sum(residual(tried) ** 2))
            if new < square * (1 - gain):
                scaled, square = tried, new
        step = step / 4 if square == before else step
    return scaled


def first_least(squares: Sequence[float], rounding: float = 1e-6) -> int:
    """Index of the first of the sums of squares that are the least but for this share of it."""
    return int(np.argmax(np.asarray(squares) <= min(squares) * (1 + rounding)))


_FOLLOWED = 5
"""Number of starting points that are optimised."""
_STEP = 1e-4
"""Step of the scaled parameters for the finite differences of the Jacobian."""


class Fit(NamedTuple):
    """A fitted law: its parameters in SI, and the measured less the predicted force at every sample, (n,), N."""

    law: Law
    values: Values
    residual: Floats

    def rms(self, rows: Rows) -> float:
        """Rms residual over rows, N."""
        return rms(self.residual[rows])


def fit(law: Law, motion: Motion, rows: Rows) -> Fit:
    """Fits a law from scratch.

    Args:
        law: the law.
        motion: the record.
        rows: those in the fit, (n,).
    """
    return _best(law, motion, rows, law.starts(motion))


def _best(law: Law, motion: Motion, rows: Rows, starts: Sequence[Values]) -> Fit:
    problem = _Problem(law, motion, rows)
    raw: dict[float, Values] = {}
    scaled: dict[float, Values] = {}
    for start in starts:
        raw.setdefault(round(problem.square(start), 9), start)
        values = _scaled_to_force(law, motion, rows, start)
        scaled.setdefault(round(problem.square(values), 9), values)
    followed = [
        problem.minimise(several[square]) for several in (raw, scaled) for square in sorted(several)[:_FOLLOWED]
    ]
    best = followed[first_least([float(np.sum(problem.residual(each) ** 2)) for each in followed])]
    return problem.fitted(out_of_kinks(problem.residual, best, problem.bounds))


class _Problem:
    """The least-squares problem, scaled to the order of 1."""

    def __init__(self, law: Law, motion: Motion, rows: Rows) -> None:
        self.law, self.motion, self.rows = law, motion, rows
        self.scale = law.scales(motion)
        least = np.array([each.least for each in law.parameters]) / self.scale
        self.bounds = least, np.full(len(least), np.inf)
        self._extent = float(np.linalg.norm(motion.force[rows]))

    def values(self, scaled: Floats) -> dict[str, float]:
        return dict(zip((each.name for each in self.law.parameters), (scaled * self.scale).tolist(), strict=True))

    def residual(self, scaled: Floats) -> Floats:
        force = self.law.force(self.values(scaled), self.motion)
        return np.asarray((force - self.motion.force)[self.rows] / self._extent)

    def square(self, values: Values) -> float:
        return float(np.sum(((self.law.force(values, self.motion) - self.motion.force)[self.rows] / self._extent) ** 2))

    def jacobian(self, scaled: Floats) -> Floats:
        here = self.residual(scaled)
        steps = np.eye(len(scaled)) * _STEP
        return np.stack([(self.residual(scaled + step) - here) / _STEP for step in steps], axis=1)

    def minimise(self, start: Values) -> Floats:
        first = np.array([start[each.name] for each in self.law.parameters]) / self.scale
        return minimise(self.residual, self.jacobian, first, self.bounds, penalty=1e-6, evaluations=60)

    def fitted(self, scaled: Floats) -> Fit:
        values = self.values(scaled)
        return Fit(self.law, values, self.motion.force - self.law.force(values, self.motion))


def _scaled_to_force(law: Law, motion: Motion, rows: Rows, start: Values) -> Values:
    """A start with its forces scaled, and shifted where the law has a zero of the force, to fit best."""
    force, measured = law.force(start, motion)[rows], motion.force[rows]
    has_zero = 'force_zero' in start
    design = np.stack([force, np.full(len(force), motion.force_range if has_zero else 0.0)], axis=1)
    (factor, shift), *_ = np.linalg.lstsq(design, measured, rcond=1e-9)
    if not factor > 0:
        return start
    powers = {'N': 1, 'm/N': -1, 'N/m': 1, 'Ns/m': 1}
    values = {each.name: start[each.name] * float(factor) ** powers.get(each.unit, 0) for each in law.parameters}
    if has_zero:
        values['force_zero'] += float(shift) * motion.force_range
    return values


def _descend(law: Law, motion: Motion, rows: Rows, start: Values) -> Fit:
    problem = _Problem(law, motion, rows)
    return problem.fitted(out_of_kinks(problem.residual, problem.minimise(start), problem.bounds))


def refit(fitted: Fit, motion: Motion, rows: Rows, only: Sequence[str] | None = None) -> Fit:
    """Fits the same law to other rows or another motion, starting from its present parameters.

    Args:
        fitted: the fitted law.
        motion: the record.
        rows: those in the fit.
        only: names of the parameters to fit; the others are kept.
    """
    law = fitted.law
    if only is None:
        return _descend(law, motion, rows, fitted.values)
    kept = {name: value for name, value in fitted.values.items() if name not in only}
    free: tuple[Parameter, ...] = tuple(each for each in law.parameters if each.name in only)
    part = Law(law.name, law.title, free, lambda values, along: law.force({**kept, **values}, along))
    found = _descend(part, motion, rows, fitted.values)
    return Fit(law, {**kept, **found.values}, found.residual)


def predict(fitted: Fit, motion: Motion) -> Fit:
    """The law with its parameters, evaluated along another motion."""
    return fitted._replace(residual=motion.force - fitted.law.force(fitted.values, motion))


def with_std(fitted: Fit, motion: Motion) -> dict[str, Estimate]:
    """Parameters with their standard deviations by the delete-one-cycle jackknife."""
    cycles = np.unique(motion.cycle)
    without = [refit(fitted, motion, motion.cycle != cycle).values for cycle in cycles]
    part = (len(cycles) - 1) / len(cycles)
    found = {}
    for name, value in fitted.values.items():
        several = np.array([values[name] for values in without])
        found[name] = Estimate(value, float(np.sqrt(part * ((several - several.mean()) ** 2).sum())))
    return found
