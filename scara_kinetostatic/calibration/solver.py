"""The solver of the adjustment: Gauss–Newton steps, damped as Levenberg and Marquardt do where a step fails.

A fit may make the changes of a `Subspace`; what is known of them beforehand is its `ActivePrior`.

One step is linearisation (`evaluate`), descent (`least_squares.damped_step`), trial (`moved`) and acceptance
(a lower cost, or a short step). In scaled parameters a start 20 mm and 3° off takes five or six steps.

The estimation runs it in stages: coarse, with the observations as measured and Cauchy's loss; robust, with adjusted
observations and the same loss, so that outliers have little weight; final, with the sum of squares over the used
touches.
"""

from __future__ import annotations

from enum import Enum
from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import Point, Stage, last_step, moved
from scara_kinetostatic.calibration.observations import JointPrior, Observations, Prior
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel

_SHORT = 3e-3
"""Standard deviations, of all predictions together, by which an undamped step moves no parameter by anything that
counts; with 1e-3, 3600 touches with dead bands took 9 steps in place of 3.
"""


class Subspace(NamedTuple):
    """Which changes of the model the fit may make: all its values together are origin + basis y.

    Attributes:
        origin: (12 + k,), in the order of `ExtendedModel.names`.
        basis: (12 + k, m); its columns carry the scale of each change.
    """

    origin: Floats
    basis: Floats

    @classmethod
    def of_free(cls, model: ExtendedModel, free: Indices, scales: Floats) -> Subspace:
        """All changes of the values at some positions, (m,); the others stay as in a model."""
        basis = np.zeros((len(scales), len(free)))
        basis[free, np.arange(len(free))] = scales[free]
        return cls(model.as_array(), basis)

    def without(self, directions: Floats) -> Subspace:
        """The subspace without orthonormal directions, (m, d), of y: along those the model stays at the origin."""
        m, d = directions.shape
        complement = np.linalg.qr(np.concatenate([directions, np.eye(m)], axis=1))[0][:, d:m]
        return self._replace(basis=self.basis @ complement)

    def project(self, model: ExtendedModel, scales: Floats) -> ExtendedModel:
        """The nearest model that the subspace holds, the values in units of scales, (12 + k,)."""
        off = (model.as_array() - self.origin) / scales
        y = np.linalg.lstsq(self.basis / scales[:, None], off, rcond=None)[0]
        return model.with_array(self.origin + self.basis @ y)

    def with_errors(self, count: int) -> Floats:
        """The basis beside that of as many declared errors, which are always free, (12 + k + count, m + count)."""
        if not count:
            return self.basis
        values, changes = self.basis.shape
        basis = np.zeros((values + count, changes + count))
        basis[:values, :changes], basis[values:, changes:] = self.basis, np.eye(count)
        return basis


class ActivePrior(NamedTuple):
    """The rows of the prior that a subspace does not leave constant.

    Attributes:
        prior: of the cell.
        active: which of its rows, (p + m,).
        rows: derivatives of the residuals by all values of the model and the errors, (p, 12 + k + m).
    """

    prior: Prior | JointPrior
    active: Mask
    rows: Floats

    @classmethod
    def of(cls, observations: Observations, subspace: Subspace) -> ActivePrior | None:
        """The prior of touches; None where everything counts as exactly known."""
        prior = observations.prior
        if prior is None:
            return None
        rows = prior.rows(len(subspace.origin))
        active = np.abs(rows @ subspace.with_errors(prior.errors)).max(axis=1, initial=0.0) > 0
        return cls(prior, np.asarray(active), rows[active])

    def residual(self, point: Point) -> Floats:
        """Residuals at a point, (p,), in standard uncertainties."""
        return self.prior.residual(point.model.as_array(), point.errors)[self.active]

    def system(self, point: Point) -> Floats:
        """The rows [J, -r] at a point."""
        return np.concatenate([self.rows, -self.residual(point)[:, None]], axis=1)

    def cost(self, point: Point) -> float:
        """Sum of the squared residuals."""
        return float((self.residual(point) ** 2).sum())


class Termination(Enum):
    """How a run ended; what that means for the user, and what to do about it, empty where nothing is."""

    CONVERGED = 'converged', 'the estimate is at the optimum', ''
    STALLED = (
        'stalled',
        'no step lowers the error any more, short of the optimum',
        'look at the rejected touches and at the cell file',
    )
    ITERATION_LIMIT = 'iteration limit', 'the estimate has not converged', 'check disc places, sensor frame and sign'

    meaning: str
    remedy: str

    def __new__(cls, value: str, meaning: str, remedy: str) -> Termination:
        """A member with its value."""
        item = object.__new__(cls)
        item._value_, item.meaning, item.remedy = value, meaning, remedy
        return item


class Fit(NamedTuple):
    """Where a run ended, and how.

    Attributes:
        point: where it ended.
        system: the compressed system at the last point evaluated, in y and the declared errors.
        iterations: steps tried.
        termination: how it ended.
        prior_cost: squared residuals of what is known beforehand, together.
    """

    point: Point
    system: least_squares.Compressed
    iterations: int
    termination: Termination
    prior_cost: float = 0.0


class _Loss(NamedTuple):
    """What a run minimises over the used touches, None for all, and what is known beforehand.

    The scale of Cauchy's loss follows the residuals of the point it was last linearised at.
    """

    robust: bool
    used: Mask | None
    prior: ActivePrior | None

    def system(self, point: Point, basis: Floats) -> tuple[least_squares.Compressed, float]:
        """The linear least-squares problem at a point, and the scale of the loss there."""
        scale, weights = 1.0, None if self.used is None else self.used.astype(float)
        if self.robust:
            scale = least_squares.typical_scale(self._of_used(point))
            robust = least_squares.robust_weights(point.distance, scale)
            weights = robust if weights is None else robust * weights
        w = point.whitened
        prior = None if self.prior is None else self.prior.system(point)
        return least_squares.compress(w.jacobian, w.residual, weights, basis, prior), scale

    def cost(self, point: Point, scale: float) -> float:
        """The loss at a point."""
        distance = self._of_used(point)
        touches = least_squares.robust_cost(distance, scale) if self.robust else float(distance.sum())
        return touches + (0.0 if self.prior is None else self.prior.cost(point))

    def _of_used(self, point: Point) -> Floats:
        return point.distance if self.used is None else point.distance[self.used]


def _shift(system: least_squares.Compressed, y: Floats) -> float:
    """By how many standard deviations a step y moves the predictions, all touches together."""
    moved = system.values * (system.right.T @ y)
    return sqrt(moved @ moved)


def _is_below(cost: float, other: float) -> bool:
    """Whether a cost is below another by more than rounding, noise and linearisation errors, 1e-5 of it."""
    return other - cost >= 1e-5 * cost


def _is_negligible(shift: float, cost: float) -> bool:
    """Whether a step is so short that the point behind it need not be evaluated: it moves the predictions by less than
    1e-3 of the residual (Bates and Watts, Technometrics 23 (1981) 179) and less than `_SHORT`.
    """
    return shift < min(1e-3 * sqrt(cost), _SHORT)


def minimise(
    observations: Observations,
    start: Point,
    subspace: Subspace,
    noise: Noise,
    stage: Stage,
    used: Mask | None = None,
    max_iterations: int = 60,
) -> Fit:
    """Find the model of least cost in a subspace.

    Args:
        observations: the touches, with the declared errors to start from.
        start: the point to start from, whitened with `noise`.
        subspace: the changes allowed.
        noise: σ_q and σ_f.
        stage: which run this is.
        used: touches that count, (n,); the others are adjusted without weight in the fit. None for all.
        max_iterations: steps at most.

    Returns:
        The fit; how it ended is in `termination`, nothing is raised.
    """
    loss = _Loss(stage.robust, None if used is None or used.all() else used, ActivePrior.of(observations, subspace))
    basis = subspace.with_errors(len(observations.errors))
    # effects may be far from linear; at an optimum where they have a kink, steps do not become short
    effects, point = start.model.effects, start
    per_touch, is_smooth = 0.0 if effects else stage.per_touch, all(effect.is_smooth for effect in effects)
    tolerance = max(stage.tolerance, per_touch * sqrt(len(observations.joints)))
    system, scale = loss.system(point, basis)
    now, damping, least = loss.cost(point, scale), stage.damping, list[float]()
    termination = Termination.ITERATION_LIMIT
    for iteration in range(1, max_iterations + 1):
        y = least_squares.damped_step(system, damping)
        change, shift = basis @ y, _shift(system, y)
        # shorter than 1e-14 in scaled parameters, a step is rounding error
        last = shift < tolerance or float(np.abs(y).max(initial=0.0)) < 1e-14
        if (last and not stage.adjusts) or (damping == stage.damping and _is_negligible(shift, now)):
            point, termination = last_step(point, change), Termination.CONVERGED
            break
        # after 12 steps every joint stays on its flank: at the edge of a dead band it could else alternate
        trial = moved(observations, point, change, noise, stage, iteration > 12)
        cost = loss.cost(trial, scale)
        # a step is taken that raises the cost by no more than rounding, or is too short to do more
        if isfinite(cost) and (last or _is_negligible(shift, now) or cost <= now * (1 + 1e-9)):
            point, damping = trial, max(stage.damping, damping / 10.0 if damping > 1e-6 else 0.0)
            system, scale = loss.system(point, basis)
            now = loss.cost(point, scale)
            if last:
                termination = Termination.CONVERGED
                break
        else:
            largest = float(system.values.max(initial=0.0)) ** 2
            damping = max(10.0 * damping, 1e-10 * largest)
            if damping > 1e12 * largest:  # no step is long enough to change the cost
                termination = Termination.STALLED
                break
        least.append(min([now, *least[-1:]]))
        vain = [steps for steps in (8, 20) if len(least) > steps and not _is_below(least[-1], least[-1 - steps])]
        # after 8 vain steps an optimum is reached if the cost is the least, and the undamped step leads no farther than
        # a tenth of a standard deviation, as the residuals have it; after 20 the run ends without one
        if vain and not _is_below(least[-1], now):
            left = _shift(system, least_squares.damped_step(system, 0.0))
            if not is_smooth or left < 0.1 * sqrt(max(now / (2 * len(point.distance)), 1.0)):
                termination = Termination.CONVERGED
                break
        if 20 in vain:
            termination = Termination.STALLED
            break
    prior_cost = 0.0 if loss.prior is None else loss.prior.cost(point)
    return Fit(point, system, iteration, termination, prior_cost)
