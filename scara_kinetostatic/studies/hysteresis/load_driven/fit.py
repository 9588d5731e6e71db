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
from scipy.optimize import nnls

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.hysteresis.fit import first_least, minimise, out_of_kinks
from scara_kinetostatic.studies.hysteresis.load_driven.laws import Law, Shape
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.model_selection import effective_count

_ROUNDS = 12
"""Largest number of improvements of amplitudes and states in turn."""
_DIGITS = 12
"""Digits after the point that count, of a sum of squares as a share of that of the response."""
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
        begins = sorted({0, len(law.states) // 2, len(law.states) - 1})
        found = [_alternate(grids, begin, direction) for begin in begins]
        square, picked = found[first_least([square for square, _ in found])]
        starts.append((square, LoadFit(law, direction, np.empty(0), shape, np.array(law.states)[picked], square)))
    order = np.argsort(np.round([square for square, _ in starts], _DIGITS), kind='stable')
    followed = [starts[k][1] for k in order[:_REFINED]]
    refined = [_refine(start, records, size) for start in ([warm_start, followed[0]] if warm_start else followed)]
    return refined[first_least([each.square for each in refined])]


def _amplitudes(gram: Floats, direction: float) -> Floats:
    """Least-squares amplitudes a ≥ 0, (k,), from the Gram matrix of (B, y), (k + 1, k + 1)."""
    wide = len(gram) - 1
    scale = np.sqrt(np.maximum(np.diagonal(gram)[:wide], 1e-300))
    root = np.linalg.cholesky(gram[:wide, :wide] / np.outer(scale, scale) + 1e-12 * np.eye(wide))
    return np.asarray(nnls(root.T, np.linalg.solve(root, direction * gram[:wide, wide] / scale))[0] / scale)


def _alternate(grids: Sequence[Floats], begin: int, direction: float) -> tuple[float, list[int]]:
    """Sum of squares, as a share of that of the response, and indices of the states at one shape."""
    picked = [begin] * len(grids)
    whole = sum(float(grid[0, -1, -1]) for grid in grids)
    for _ in range(_ROUNDS):
        total = np.sum([grid[pick] for grid, pick in zip(grids, picked, strict=True)], axis=0)
        vector = np.append(-direction * _amplitudes(total, direction), 1.0)
        squares = [np.round(np.einsum('i,sij,j->s', vector, grid, vector) / whole, _DIGITS) for grid in grids]
        new, square = [int(each.argmin()) for each in squares], float(sum(each.min() for each in squares))
        if new == picked:
            break
        picked = new
    return square, picked


class _Refinement:
    """The nonlinear problem of a refinement: shape and states, with the best amplitudes for them (variable projection).

    Parameters are scaled to the order of 1.

    Attributes:
        start: the fit to start from.
        records: with their moments.
        first: the parameters to start from, scaled, shape first.
        bounds: least and largest values of the parameters.
    """

    def __init__(self, start: LoadFit, records: Sequence[Moments], size: float) -> None:
        self.start, self.records, law = start, records, start.law
        responses = [each.path.response[each.rows] for each in records]
        self._response = np.concatenate([each - each.mean() for each in responses])
        self._ends = np.cumsum([0, *(len(each) for each in responses)])
        self._scales = np.array([size if each.is_load else 1.0 for each in law.shape])
        states = len(records) if law.has_state else 0
        lower = np.array([_LEAST] * len(law.shape) + [-1.0] * states)
        upper = np.array([each.most for each in law.shape] + [1.0] * states)
        self.bounds = lower, upper
        self.first: Floats = np.concatenate([np.array(start.shape) / self._scales, start.states[:states]])

    def fitted(self, scaled: Floats) -> LoadFit:
        """The law with these parameters and the best amplitudes for them."""
        shape, states = self._split(scaled)
        basis = self._basis(shape, states)
        amplitudes = self._amplitudes(basis)
        left = self._response - basis @ amplitudes
        return LoadFit(self.start.law, self.start.direction, amplitudes, shape, states, float(left @ left))

    def residual(self, scaled: Floats) -> Floats:
        """Prediction less response of all samples, without the records' zeros."""
        basis = self._basis(*self._split(scaled))
        left = basis @ self._amplitudes(basis) - self._response
        return np.asarray(left)

    def jacobian(self, scaled: Floats) -> Floats:
        """Derivatives of the residual, of the basis by differences, at right angles to it (Kaufman, BIT 15, 1975)."""
        shape, states = self._split(scaled)
        basis = self._basis(shape, states)
        amplitudes = self._amplitudes(basis)
        here = basis @ amplitudes
        moved = np.zeros((len(here), len(scaled)))
        for place in range(len(shape)):
            stepped = list(shape)
            stepped[place] += _STEP * self._scales[place]
            moved[:, place] = (self._basis(tuple(stepped), states) @ amplitudes - here) / _STEP
        for number in range(len(scaled) - len(shape)):
            rows, step = slice(*self._ends[number : number + 2]), _STEP if states[number] < 0 else -_STEP
            own = self._centred(number, shape, float(states[number]) + step) @ amplitudes
            moved[rows, len(shape) + number] = (own - here[rows]) / step
        along = np.linalg.qr(basis[:, amplitudes > 0])[0]
        moved -= along @ (along.T @ moved)
        return moved

    def _split(self, scaled: Floats) -> tuple[Shape, Floats]:
        """Shape and initial states."""
        count = len(self._scales)
        states = scaled[count:] if self.start.law.has_state else np.zeros(len(self.records))
        return tuple((scaled[:count] * self._scales).tolist()), states

    def _amplitudes(self, basis: Floats) -> Floats:
        columns = np.column_stack([basis, self._response])
        return _amplitudes(columns.T @ columns, 1.0)

    def _basis(self, shape: Shape, states: Floats) -> Floats:
        """The basis s B of all records, each less its mean."""
        return np.concatenate([self._centred(number, shape, state) for number, state in enumerate(states.tolist())])

    def _centred(self, number: int, shape: Shape, state: float) -> Floats:
        each = self.records[number]
        basis = self.start.law.basis(each.path, shape, state)[each.rows]
        return self.start.direction * (basis - basis.mean(axis=0))


def _refine(start: LoadFit, records: Sequence[Moments], size: float) -> LoadFit:
    """Gauss-Newton refinement of all parameters, within their bounds."""
    problem = _Refinement(start, records, size)
    if not len(problem.first):
        return problem.fitted(problem.first)
    shape = len(start.shape)
    penalty = np.where(np.arange(len(problem.first)) < shape, 1e-5 / np.maximum(problem.first, 1e-3), 1e-3)
    found = minimise(problem.residual, problem.jacobian, problem.first, problem.bounds, penalty)
    return problem.fitted(out_of_kinks(problem.residual, found, problem.bounds))


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
