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


def _refine(start: LoadFit, records: Sequence[Moments], size: float, evaluations: int) -> LoadFit:
    """Gauss-Newton refinement; parameters scaled to the order of 1."""
    law, direction, amplitudes, shape, states, _ = start
    wide, many = len(law.amplitudes), len(law.shape)
    extent = max(float(np.ptp(each.path.response[each.rows])) for each in records)
    sizes = np.abs(law.basis(records[0].path, shape, 1.0)).max(axis=0)
    unit = np.concatenate([extent / np.maximum(sizes, 1e-300), [size if each.is_load else 1.0 for each in law.shape]])
    ends = np.cumsum([0, *(int(each.rows.sum()) for each in records)])

    def split(scaled: Floats) -> tuple[Floats, Shape, Floats]:
        common = scaled[: wide + many] * unit
        own = scaled[wide + many :] if law.has_state else states
        return common[:wide], tuple(common[wide:].tolist()), own

    def centred(each: Moments, amplitudes: Floats, shape: Shape, state: float) -> tuple[Floats, Floats]:
        basis = law.basis(each.path, shape, state)[each.rows]
        basis = direction * (basis - basis.mean(axis=0))
        return basis, basis @ amplitudes

    def residual(scaled: Floats) -> Floats:
        amplitudes, shape, own = split(scaled)
        parts = []
        for each, state in zip(records, own.tolist(), strict=True):
            response = each.path.response[each.rows]
            parts.append(centred(each, amplitudes, shape, state)[1] - (response - response.mean()))
        return np.concatenate(parts) / extent

    def jacobian(scaled: Floats) -> Floats:
        amplitudes, shape, own = split(scaled)
        out = np.zeros((ends[-1], len(scaled)))
        for number, (each, state) in enumerate(zip(records, own.tolist(), strict=True)):
            rows = slice(ends[number], ends[number + 1])
            basis, here = centred(each, amplitudes, shape, state)
            out[rows, :wide] = basis * unit[:wide]
            for place in range(many):
                step = _STEP * unit[wide + place]
                moved = (*shape[:place], shape[place] + step, *shape[place + 1 :])
                out[rows, wide + place] = (centred(each, amplitudes, moved, state)[1] - here) / _STEP
            if law.has_state:
                step = _STEP if state < 0 else -_STEP
                out[rows, wide + many + number] = (centred(each, amplitudes, shape, state + step)[1] - here) / step
        return out / extent

    most = [each.most for each in law.shape]
    own = states.tolist() if law.has_state else []
    lower = np.array([0.0] * wide + [_LEAST] * many + [-1.0] * len(own))
    upper = np.array([np.inf] * wide + most + [1.0] * len(own))
    first = np.concatenate([amplitudes / unit[:wide], np.array(shape) / unit[wide:], own])
    inside = np.clip(first, lower + 1e-9, np.where(np.isfinite(upper), upper - 1e-9, np.inf))
    found = least_squares(
        residual,
        inside,
        jacobian,
        bounds=(lower, upper),
        x_scale=np.maximum(np.abs(inside), 0.05),
        max_nfev=evaluations,
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
    )
    amplitudes, shape, states_found = split(found.x)
    return LoadFit(law, direction, amplitudes, shape, np.array(states_found), 2 * float(found.cost) * extent**2)


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
