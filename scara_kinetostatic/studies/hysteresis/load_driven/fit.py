"""Least squares of a law to several records, and its prediction of further samples.

Minimises Σ over records and samples of (y - z - s B a)² over the common amplitudes a ≥ 0 and shape parameters θ and
each record's zero z and initial state h. The zero is removed by centring. On a grid of θ and h the rest is linear: the
moments of (B, y) are computed once for each grid point and record, and a and the states are improved in turn. From the
best grid point all parameters are refined by Gauss-Newton steps within their bounds.

Prediction: a and θ are kept, z and h are found from the samples known. Where these leave h open, the prediction is the
mean over its posterior for a flat prior, p(h) ∝ S(h)^(-m/2), S the sum of squares and m the effective number of
independent means of half a second: a vibration is no evidence on the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.hysteresis.load_driven.laws import Law, Shape
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.model_selection import effective_count

_ROUNDS = 12
"""Largest number of improvements of amplitudes and states in turn."""
_EVALUATIONS = 25
"""Largest number of evaluations of a refinement,"""
_EVALUATIONS_WARM = 10
"""and where one of its starting points is a fit to nearly the same records."""
_TOLERANCE = 1e-6
"""Relative change of the sum of squares, and of the parameters, at which a refinement ends."""
_REFINED = 2
"""Number of grid points that are refined."""
_STEP = 1e-4
"""Relative step of a shape parameter, and step of a state, for the finite differences."""
_STATES, _ZOOMS = 41, 3
"""Number of initial states in a prediction, and of times that the grid is refined where it is too coarse."""
_LEAST = 1e-3
"""Lower bound of shape parameters, in their scale."""


class LoadFit(NamedTuple):
    """A fitted law.

    Attributes:
        law: the law.
        direction: s.
        amplitudes: a, (k,), SI.
        shape: θ, SI.
        states: initial state of each record in the fit, (r,); 0 for a law without.
        square: sum of squared residuals.
    """

    law: Law
    direction: float
    amplitudes: Floats
    shape: Shape
    states: Floats
    square: float

    @property
    def values(self) -> dict[str, float]:
        """All common parameters by name."""
        return dict(zip(self.law.names, (*self.amplitudes.tolist(), *self.shape), strict=True))


class Prediction(NamedTuple):
    """A law along a record.

    Attributes:
        state: mean initial state of friction.
        zero: response at no load, m or rad.
        residual: measured less predicted response, (n,).
    """

    state: float
    zero: float
    residual: Floats


class Moments(NamedTuple):
    """What a fit needs of one record: BᵀB, Bᵀy, yᵀy after centring, on the grid: (shapes, states, k + 1, k + 1)."""

    grid: Floats
    path: LoadPath
    rows: Mask


def shapes(law: Law, size: float) -> list[Shape]:
    """Every combination of starting values of the shape parameters for loads up to `size`."""
    return list(
        product(*([value * (size if each.is_load else 1.0) for value in each.starting_values] for each in law.shape))
    )


def moments(law: Law, path: LoadPath, rows: Mask, size: float) -> Moments:
    """Moments of a record on the grid.

    Args:
        law: the law.
        path: the record.
        rows: samples in the fit, (n,).
        size: largest load of all records, the same in every call for one fit.
    """
    grid = []
    for shape in shapes(law, size):
        for state in law.states:
            columns = np.column_stack([law.basis(path, shape, state), path.response])[rows]
            columns -= columns.mean(axis=0)
            grid.append(columns.T @ columns)
    wide = len(law.amplitudes) + 1
    return Moments(np.reshape(grid, (-1, len(law.states), wide, wide)), path, rows)


def fit(
    law: Law, records: Sequence[Moments], size: float, direction: float, warm_start: LoadFit | None = None
) -> LoadFit:
    """Fits a law to records.

    Args:
        law: the law.
        records: moments of each record, with the same `size`.
        size: see `moments`.
        direction: s.
        warm_start: a fit to the same records or more samples of them, a further starting point.
    """
    starts = []
    for number, shape in enumerate(shapes(law, size)):
        grids = [each.grid[number] for each in records]
        middle = len(law.states) // 2
        for begin in {0, middle, len(law.states) - 1}:
            square, amplitudes, picked = _alternate(grids, begin, direction)
            states = np.array([law.states[pick] for pick in picked])
            starts.append(LoadFit(law, direction, amplitudes, shape, states, square))
    starts.sort(key=lambda start: start.square)
    followed = starts[:_REFINED] if warm_start is None else [warm_start, starts[0]]
    evaluations = _EVALUATIONS if warm_start is None else _EVALUATIONS_WARM
    found = [_refine(start, records, size, evaluations) for start in followed]
    return min(found, key=lambda each: each.square)


def _alternate(grids: Sequence[Floats], begin: int, direction: float) -> tuple[float, Floats, list[int]]:
    """Sum of squares, amplitudes and indices of the states at one shape."""
    picked, wide = [begin] * len(grids), grids[0].shape[-1] - 1
    amplitudes, square = np.zeros(wide), np.inf
    for _ in range(_ROUNDS):
        total = np.sum([grid[pick] for grid, pick in zip(grids, picked, strict=True)], axis=0)
        scale = np.sqrt(np.maximum(np.diagonal(total)[:wide], 1e-300))
        normal = total[:wide, :wide] / np.outer(scale, scale) + 1e-9 * np.eye(wide)
        root = np.linalg.cholesky(normal)
        amplitudes = nnls(root.T, np.linalg.solve(root, direction * total[:wide, wide] / scale))[0] / scale
        vector = np.append(-direction * amplitudes, 1.0)
        squares = [np.einsum('i,sij,j->s', vector, grid, vector) for grid in grids]
        new, square = [int(each.argmin()) for each in squares], float(sum(each.min() for each in squares))
        if new == picked:
            break
        picked = new
    return square, amplitudes, picked


class _Refinement:
    """The nonlinear problem of a refinement; parameters and residuals are scaled to the order of 1.

    Attributes:
        start: the fit to start from.
        records: with their moments.
        unit: of the common parameters, amplitudes first, (k + t,).
        extent: of the response.
    """

    def __init__(self, start: LoadFit, records: Sequence[Moments], size: float) -> None:
        self.start, self.records, law = start, records, start.law
        self.extent = max(float(np.ptp(each.path.response[each.rows])) for each in records)
        sizes = np.abs(law.basis(records[0].path, start.shape, 1.0)).max(axis=0)
        scales = [size if each.is_load else 1.0 for each in law.shape]
        self.unit = np.concatenate([self.extent / np.maximum(sizes, 1e-300), scales])
        self._wide = len(law.amplitudes)
        self._ends = np.cumsum([0, *(int(each.rows.sum()) for each in records)])

    @property
    def first(self) -> Floats:
        """The parameters to start from, scaled."""
        common = np.concatenate([self.start.amplitudes, self.start.shape]) / self.unit
        return np.concatenate([common, self.start.states if self.start.law.has_state else []])

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest values of the parameters."""
        most, states = [each.most for each in self.start.law.shape], len(self.first) - len(self.unit)
        lower = np.array([0.0] * self._wide + [_LEAST] * len(most) + [-1.0] * states)
        return lower, np.array([np.inf] * self._wide + most + [1.0] * states)

    def split(self, scaled: Floats) -> tuple[Floats, Shape, Floats]:
        """Amplitudes, shape and initial states."""
        common = scaled[: len(self.unit)] * self.unit
        states = scaled[len(self.unit) :] if self.start.law.has_state else self.start.states
        return common[: self._wide], tuple(common[self._wide :].tolist()), states

    def residual(self, scaled: Floats) -> Floats:
        """Prediction less response of all samples, without the records' zeros."""
        amplitudes, shape, own = self.split(scaled)
        parts = []
        for each, state in zip(self.records, own.tolist(), strict=True):
            response = each.path.response[each.rows]
            parts.append(self._centred(each, shape, state) @ amplitudes - (response - response.mean()))
        return np.concatenate(parts) / self.extent

    def jacobian(self, scaled: Floats) -> Floats:
        """Derivatives of the residual; those by shape and state by differences."""
        amplitudes, shape, own = self.split(scaled)
        out = np.zeros((self._ends[-1], len(scaled)))
        for number, (each, state) in enumerate(zip(self.records, own.tolist(), strict=True)):
            rows = slice(self._ends[number], self._ends[number + 1])
            basis = self._centred(each, shape, state)
            here = basis @ amplitudes
            out[rows, : self._wide] = basis * self.unit[: self._wide]
            for place, value in enumerate(shape):
                moved = (*shape[:place], value + _STEP * self.unit[self._wide + place], *shape[place + 1 :])
                out[rows, self._wide + place] = (self._centred(each, moved, state) @ amplitudes - here) / _STEP
            if self.start.law.has_state:
                step = _STEP if state < 0 else -_STEP
                moved_state = self._centred(each, shape, state + step) @ amplitudes
                out[rows, len(self.unit) + number] = (moved_state - here) / step
        return out / self.extent

    def _centred(self, each: Moments, shape: Shape, state: float) -> Floats:
        """The basis s B of a record less its mean."""
        basis = self.start.law.basis(each.path, shape, state)[each.rows]
        return self.start.direction * (basis - basis.mean(axis=0))


def _refine(start: LoadFit, records: Sequence[Moments], size: float, evaluations: int) -> LoadFit:
    """Gauss-Newton refinement of all parameters, within their bounds."""
    problem = _Refinement(start, records, size)
    lower, upper = problem.bounds
    inside = np.clip(problem.first, lower + 1e-9, np.where(np.isfinite(upper), upper - 1e-9, np.inf))
    found = least_squares(
        problem.residual,
        inside,
        problem.jacobian,
        bounds=(lower, upper),
        x_scale=np.maximum(np.abs(inside), 0.05),
        max_nfev=evaluations,
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
    )
    amplitudes, shape, states = problem.split(found.x)
    square = 2 * float(found.cost) * problem.extent**2
    return LoadFit(start.law, start.direction, amplitudes, shape, np.array(states), square)


def predict(fitted: LoadFit, path: LoadPath, known: Mask) -> Prediction:
    """The law along a record, its zero and state from the samples known.

    Law (6), which has no memory, takes its zero from the samples at rest alone.

    Args:
        fitted: the law with its parameters.
        path: the record.
        known: samples that may be used, (n,).
    """
    law = fitted.law
    if not law.has_state:
        model = fitted.direction * law.basis(path, fitted.shape, 0.0) @ fitted.amplitudes
        zero = float((path.response - model)[path.rest].mean())
        return Prediction(0.0, zero, path.response - model - zero)
    states = np.linspace(-1.0, 1.0, _STATES)
    for _ in range(_ZOOMS):
        found = _posterior(fitted, path, known, states)
        step = states[1] - states[0]
        if found.std > step:
            break
        states = np.clip(found.prediction.state + step * np.linspace(-2.0, 2.0, _STATES), -1.0, 1.0)
    return found.prediction


class _Posterior(NamedTuple):
    prediction: Prediction
    std: float


def _posterior(fitted: LoadFit, path: LoadPath, known: Mask, states: Floats) -> _Posterior:
    """Mean prediction over some states, and the standard deviation of the state."""
    law = fitted.law
    models = np.stack([law.basis(path, fitted.shape, float(state)) @ fitted.amplitudes for state in states])
    off = path.response - fitted.direction * models
    zeros = off[:, known].mean(axis=1)
    off -= zeros[:, None]
    squares = np.maximum((off[:, known] ** 2).sum(axis=1), 1e-300)
    count = effective_count(path.long_means(off[int(squares.argmin())][known]), 0.0)
    weights = (squares / squares.min()) ** (-count / 2)
    weights /= weights.sum()
    state = float(weights @ states)
    prediction = Prediction(state, float(weights @ zeros), weights @ off)
    return _Posterior(prediction, float(np.sqrt(weights @ (states - state) ** 2)))
