"""Least-squares fit of a law to some rows of a motion, and its prediction of the others.

The law is always evaluated along the whole displacement; only the residuals of the rows in the fit count. Slip and gap
give the sum of squares several local minima: many starting points are evaluated and the best few are optimised.
Standard deviations are those of the delete-one-cycle jackknife, since residuals within a cycle are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.laws import Law, Parameter, Refinement, Values, refined
from scara_kinetostatic.studies.hysteresis.motion import Motion, Rows

_FOLLOWED = 3
"""Number of starting points that are optimised."""
_STEP = 1e-4
"""Step of the scaled parameters for the finite differences of the Jacobian."""
_EVALUATIONS = 100
"""Largest number of evaluations of one optimisation."""


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


def fit_refined(base: Fit, refinement: Refinement, motion: Motion, rows: Rows) -> Fit:
    """Adds a refinement to a fitted law and fits all parameters, starting from those of the fitted law."""
    law = refined(base.law, refinement)
    extra = Law('', '', refinement.parameters, law.force)
    return _best(law, motion, rows, [{**base.values, **more} for more in extra.starts(motion)])


def _best(law: Law, motion: Motion, rows: Rows, starts: Sequence[Values]) -> Fit:
    def square(start: Values) -> float:
        left = (motion.force - law.force(start, motion))[rows]
        return float(left @ left)

    followed = [_descend(law, motion, rows, start) for start in sorted(starts, key=square)[:_FOLLOWED]]
    return min(followed, key=lambda each: each.rms(rows))


def _descend(law: Law, motion: Motion, rows: Rows, start: Values) -> Fit:
    names = [each.name for each in law.parameters]
    scale = law.scales(motion)

    def residual(scaled: Floats) -> Floats:
        force = law.force(dict(zip(names, (scaled * scale).tolist(), strict=True)), motion)
        return np.asarray((force - motion.force)[rows])

    def jacobian(scaled: Floats) -> Floats:
        here = residual(scaled)
        steps = np.eye(len(scaled)) * _STEP
        return np.stack([(residual(scaled + step) - here) / _STEP for step in steps], axis=1)

    least = np.array([each.least for each in law.parameters]) / scale
    first = np.maximum(np.array([start[name] for name in names]) / scale, least + 1e-9)
    found = least_squares(
        residual, first, jacobian, bounds=(least, np.full(len(least), np.inf)), x_scale='jac', max_nfev=_EVALUATIONS
    )
    values = dict(zip(names, (found.x * scale).tolist(), strict=True))
    return Fit(law, values, motion.force - law.force(values, motion))


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
