"""Least-squares fit of a law to records, and its prediction of further samples.

Minimises Σ over records and samples of (y - z - s B a)² over the common amplitudes a ≥ 0 and shape parameters θ and
each record's zero z and initial state h. The zero is removed by centring. On a grid of θ and h the rest is linear: the
moments of (B, y) are computed once for each grid point and record, and a and the states are improved in turn. From the
best grid points all parameters are refined.

It ends in bounded Gauss-Newton steps, the same on every machine. Where the sum of squares has a kink (slip sets in at
one sample more) these end; steps along single parameters lead out of it. Parameters that the data leave open would
follow the rounding errors; a small penalty keeps them at their start. Sums of squares that differ by rounding are
equal: the first counts.

Prediction: a and θ are kept, z and h are found from the samples known. Where these leave h open, the prediction is the
mean over its posterior for a flat prior, p(h) ∝ S(h)^(-m/2), S the sum of squares and m the effective number of
independent means of half a second: a vibration is no evidence on the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from scara_kinetostatic.model.arrays import TINY, Floats, Mask, effective_count
from scara_kinetostatic.studies.loops.laws import RecordLaw, Shape, Values, reported
from scara_kinetostatic.studies.loops.record import MOTION, RecordPath, block_means

_ALIKE = 1e-9
"""Relative difference below which sums of squares and parameters are the same."""
_DIGITS = 12
"""Decimals of a share of the sum of squares that count: the others differ from machine to machine."""
_STEP = 1e-4
"""Step of the scaled parameters for finite differences."""


class FittedLaw(NamedTuple):
    """A fitted law.

    Attributes:
        law: the law.
        values: of all common parameters by name, SI.
        states: initial state of friction of each record in the fit, (r,).
        square: sum of squared residuals.
        zero: z of the first record.
    """

    law: RecordLaw
    values: dict[str, float]
    states: Floats
    square: float
    zero: float = 0.0

    @property
    def reported(self) -> dict[str, float]:
        """The parameters as reported, SI."""
        return reported(self.values, self.zero)


class PredictedRecord(NamedTuple):
    """A law along a record.

    Attributes:
        residual: measured less predicted, (n,).
        state: mean initial state of friction; NaN of a law without memory.
        zero: z.
    """

    residual: Floats
    state: float = 0.0
    zero: float = 0.0


def _first_least(squares: Sequence[float]) -> int:
    """Index of the first of the sums of squares that are the least but for rounding."""
    return int(np.argmax(np.asarray(squares) <= min(squares) * (1 + 1e-6)))


class FitSamples:
    """Samples of one record in a fit.

    Args:
        law: the law.
        path: the record.
        rows: samples in the fit, (n,).
        size: largest driver of all records, the same for all of one fit.
    """

    def __init__(self, law: RecordLaw, path: RecordPath, rows: Mask, size: float) -> None:
        self.law, self.path, self.rows, self.size = law, path, rows, size

    @cached_property
    def grid(self) -> Floats:
        """BᵀB, Bᵀy, yᵀy after centring, on the grid: (shapes, states, k + 1, k + 1)."""
        grid, states = [], _states(self.law, self.path)
        for shape in _shapes(self.law, self.size):
            for state in states:
                basis = self.law.basis(self.path, {**shape, 'state': state})
                columns = np.column_stack([basis, self.path.driven])[self.rows]
                columns -= columns.mean(axis=0)
                grid.append(columns.T @ columns)
        wide = len(self.law.amplitudes) + 1
        return np.reshape(grid, (-1, len(states), wide, wide))

    def centred(self, values: Values, state: float) -> Floats:
        """The basis s B of the samples, less its mean."""
        basis = self.law.basis(self.path, {**values, 'state': state})[self.rows]
        return np.asarray(basis - basis.mean(axis=0))


def _shapes(law: RecordLaw, size: float) -> list[Values]:
    """Every combination of starting values of the shape parameters for drivers up to `size`."""
    several = product(*([value * _scale(each, size) for value in each.starts] for each in law.shape))
    return [dict(zip((each.name for each in law.shape), shape, strict=True)) for shape in several]


def _scale(parameter: Shape, size: float) -> float:
    return 1.0 if parameter.is_ratio else size


def _states(law: RecordLaw, path: RecordPath) -> list[float]:
    """Initial states of friction from which a fit starts; the first loops wipe them out."""
    return np.linspace(-1.0, 1.0, 21 if path.rest.any() else 5).tolist() if law.has_state else [0.0]


def fit_law(records: Sequence[FitSamples], warm_start: FittedLaw | None = None, near: bool = False) -> FittedLaw:
    """Fits a law to records.

    Args:
        records: of the same law and `size`.
        warm_start: a fit to the same records or more samples of them, a further starting point.
        near: whether it is the only one.
    """
    starts = [warm_start] if warm_start else []
    if not near:
        # slip and gap give a motion several local minima
        followed = 1 if starts else 5 if records[0].path.driven_by == MOTION else 2
        starts += _starts(records)[:followed]
    return _Problem(records).fitted(starts)


def _starts(records: Sequence[FitSamples]) -> list[FittedLaw]:
    """The best states of every shape of the grid, the best shape first."""
    law, starts = records[0].law, []
    states = [_states(law, each.path) for each in records]
    begins = sorted({tuple(round(part * (len(each) - 1)) for each in states) for part in (0.0, 0.5, 1.0)})
    for number, shape in enumerate(_shapes(law, records[0].size)):
        grids = [each.grid[number] for each in records]
        found = [_alternate(grids, begin) for begin in begins]
        square, picked = found[_first_least([square for square, _ in found])]
        begin_at = np.array([each[pick] for each, pick in zip(states, picked, strict=True)])
        starts.append(FittedLaw(law, dict(shape), begin_at, square))
    return sorted(starts, key=lambda start: round(start.square, _DIGITS))


def _amplitudes(gram: Floats) -> Floats:
    """Least-squares amplitudes a ≥ 0, (k,), from the Gram matrix of (B, y), (k + 1, k + 1)."""
    wide = len(gram) - 1
    scale = np.sqrt(np.maximum(np.diagonal(gram)[:wide], TINY))
    root = np.linalg.cholesky(gram[:wide, :wide] / np.outer(scale, scale) + 1e-12 * np.eye(wide))
    return np.asarray(nnls(root.T, np.linalg.solve(root, gram[:wide, wide] / scale))[0] / scale)


def _alternate(grids: Sequence[Floats], begin: Sequence[int]) -> tuple[float, list[int]]:
    """Sum of squares, as a share of that of the response, and indices of the states at one shape."""
    picked = list(begin)
    whole = sum(float(grid[0, -1, -1]) for grid in grids)
    for _ in range(12):
        total = np.sum([grid[pick] for grid, pick in zip(grids, picked, strict=True)], axis=0)
        vector = np.append(-_amplitudes(total), 1.0)
        squares = [np.round(np.einsum('i,sij,j->s', vector, grid, vector) / whole, _DIGITS) for grid in grids]
        new, square = [int(each.argmin()) for each in squares], float(sum(each.min() for each in squares))
        if new == picked:
            break
        picked = new
    return square, picked


class _Problem:
    """Shape and states of records, with the best amplitudes for them (variable projection).

    Parameters are scaled to the order of 1, shape first.
    """

    def __init__(self, records: Sequence[FitSamples]) -> None:
        self.law, self.records = records[0].law, records
        # many loops of a load smooth them out
        self.has_kinks = any(each.path.rest.any() or each.path.driven_by == MOTION for each in records)
        driven = [each.path.driven[each.rows] for each in records]
        self._driven = np.concatenate([each - each.mean() for each in driven])
        self._ends = np.cumsum([0, *(len(each) for each in driven)])
        self._scales = np.array([_scale(each, records[0].size) for each in self.law.shape])
        states = len(records) if self.law.has_state else 0
        lower = np.array([each.least for each in self.law.shape] + [-1.0] * states)
        upper = np.array([each.most for each in self.law.shape] + [1.0] * states)
        self.bounds = lower, upper

    def fitted(self, starts: Sequence[FittedLaw]) -> FittedLaw:
        """The law with the parameters of the least sum of squares near any of some starting points."""
        found = []
        for start in starts:
            values = np.array([start.values[each.name] for each in self.law.shape]) / self._scales
            found.append(self._refined(np.concatenate([values, start.states if self.law.has_state else []])))
        best = found[_first_least([self._square(each) for each in found])]
        shape, states, basis, amplitudes = self._at(self._out_of_kinks(best) if self.has_kinks else best)
        left = self._driven - basis @ amplitudes
        values = dict(zip(self.law.amplitudes, amplitudes.tolist(), strict=True)) | shape
        fit, first = FittedLaw(self.law, values, states, float(left @ left)), self.records[0]
        off = first.path.driven - evaluate(fit, first.path, float(states[0]))
        return fit._replace(zero=float(off[first.rows].mean()))

    def _square(self, scaled: Floats) -> float:
        return float(np.sum(self.residual(scaled) ** 2))

    def _refined(self, first: Floats) -> Floats:
        """The parameters of the least sum of squares near a starting point; a small penalty keeps those left open."""
        if not len(first):
            return first
        lower, upper = self.bounds
        start = np.clip(first, lower + _ALIKE, upper - _ALIKE)
        scale = float(np.linalg.norm(self.residual(start))) or 1.0
        is_shape = np.arange(len(first)) < len(self._scales)
        penalty = np.diag(np.where(is_shape, 1e-5 / np.maximum(np.abs(first), 1e-3), 1e-3))
        found = least_squares(
            lambda scaled: np.concatenate([self.residual(scaled) / scale, penalty @ (scaled - start)]),
            start,
            lambda scaled: np.concatenate([self.jacobian(scaled) / scale, penalty]),
            bounds=self.bounds,
            x_scale='jac',
            max_nfev=60,
            ftol=_ALIKE,
            xtol=_ALIKE,
            gtol=None,
        )
        return np.asarray(found.x)

    def _out_of_kinks(self, scaled: Floats) -> Floats:
        """Steps along single parameters, ever smaller, as long as they gain a share of 1e-9 of the sum of squares."""
        square, step = self._square(scaled), 1e-2
        for _ in range(20 if len(scaled) else 0):
            before = square
            for change in step * np.concatenate([np.eye(len(scaled)), -np.eye(len(scaled))]):
                tried = np.clip(scaled + change, *self.bounds)
                new = self._square(tried)
                if new < square * (1 - _ALIKE):
                    scaled, square = tried, new
            step = step / 4 if square == before else step
        return scaled

    def residual(self, scaled: Floats) -> Floats:
        """Prediction less what is driven of all samples, without the records' zeros."""
        _, _, basis, amplitudes = self._at(scaled)
        return np.asarray(basis @ amplitudes - self._driven)

    def jacobian(self, scaled: Floats) -> Floats:
        """Derivatives of the residual, of the basis by differences, at right angles to it (Kaufman, BIT 15, 1975)."""
        shape, states, basis, amplitudes = self._at(scaled)
        here = basis @ amplitudes
        moved = np.zeros((len(here), len(scaled)))
        for place, name in enumerate(shape):
            stepped = {**shape, name: shape[name] + _STEP * self._scales[place]}
            moved[:, place] = (self._basis(stepped, states) @ amplitudes - here) / _STEP
        for number in range(len(scaled) - len(shape)):
            rows, step = slice(*self._ends[number : number + 2]), _STEP if states[number] < 0 else -_STEP
            own = self.records[number].centred(shape, float(states[number]) + step) @ amplitudes
            moved[rows, len(shape) + number] = (own - here[rows]) / step
        directions = np.linalg.qr(basis[:, amplitudes > 0])[0]
        return moved - directions @ (directions.T @ moved)

    def _at(self, scaled: Floats) -> tuple[dict[str, float], Floats, Floats, Floats]:
        """Shape, initial states, the basis there, and the best amplitudes."""
        count = len(self._scales)
        states = scaled[count:] if self.law.has_state else np.zeros(len(self.records))
        values = (scaled[:count] * self._scales).tolist()
        shape = dict(zip((each.name for each in self.law.shape), values, strict=True))
        basis = self._basis(shape, states)
        columns = np.column_stack([basis, self._driven])
        return shape, states, basis, _amplitudes(columns.T @ columns)

    def _basis(self, shape: Values, states: Floats) -> Floats:
        """The basis s B of all records, each less its mean."""
        pairs = zip(self.records, states.tolist(), strict=True)
        return np.concatenate([each.centred(shape, state) for each, state in pairs])


def evaluate(fitted: FittedLaw, path: RecordPath, state: float) -> Floats:
    """What is driven by a law, without its zero, (n,)."""
    amplitudes = np.array([fitted.values[name] for name in fitted.law.amplitudes])
    return np.asarray(fitted.law.basis(path, {**fitted.values, 'state': state}) @ amplitudes)


def predict(fitted: FittedLaw, path: RecordPath, known: Mask, states: int = 41) -> PredictedRecord:
    """The law along a record, its zero and state from the samples known.

    Law (6), which has no memory, takes its zero from the samples at rest alone, if there are some.

    Args:
        fitted: the law with its parameters.
        path: the record.
        known: samples that may be used, (n,).
        states: number of initial states over which the mean is taken; twice more closely where they are too coarse.
    """
    if not fitted.law.has_state:
        off = path.driven - evaluate(fitted, path, 0.0)
        zero = float(off[path.rest if path.rest.any() else known].mean())
        return PredictedRecord(off - zero, np.nan, zero)
    grid = np.linspace(-1.0, 1.0, states)
    for _ in range(3):
        off = path.driven - np.stack([evaluate(fitted, path, state) for state in grid.tolist()])
        zeros = off[:, known].mean(axis=1)
        off -= zeros[:, None]
        squares = np.maximum((off[:, known] ** 2).sum(axis=1), TINY)
        best = off[int(squares.argmin())][known]
        count = effective_count(block_means(best, path.long_block(len(best))), 0.0)
        weights = (squares / squares.min()) ** (-count / 2)
        weights /= weights.sum()
        found = PredictedRecord(weights @ off, float(weights @ grid), float(weights @ zeros))
        step = grid[1] - grid[0]
        if np.sqrt(weights @ (grid - found.state) ** 2) > step:
            break
        grid = np.clip(found.state + step * np.linspace(-2.0, 2.0, states), -1.0, 1.0)
    return found
