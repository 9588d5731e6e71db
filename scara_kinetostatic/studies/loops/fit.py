"""Least-squares fit of a law to records, and its prediction of further samples.

Driven by its motion: the law is evaluated along the whole displacement, and the residuals of the rows in the fit count.
Slip and gap give the sum of squares several local minima: many starting points are evaluated, their forces scaled to
fit, and the best few are optimised.

Driven by its load: minimises Σ over records and samples of (y - z - s B a)² over the common amplitudes a ≥ 0 and shape
parameters θ and each record's zero z and initial state h. The zero is removed by centring. On a grid of θ and h the
rest is linear: the moments of (B, y) are computed once for each grid point and record, and a and the states are
improved in turn. From the best grid point all parameters are refined.

Both end in bounded Gauss-Newton steps, the same on every machine. Where the sum of squares has a kink (slip sets in at
one sample more) these end; steps along single parameters lead out of it. Parameters that the data leave open would
follow the rounding errors; a small penalty keeps them at their start. Sums of squares that differ by rounding are
equal: the first counts.

Prediction under a load: a and θ are kept, z and h are found from the samples known. Where these leave h open, the
prediction is the mean over its posterior for a flat prior, p(h) ∝ S(h)^(-m/2), S the sum of squares and m the effective
number of independent means of half a second: a vibration is no evidence on the state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.loops.laws import Law, Parameter, Values
from scara_kinetostatic.studies.loops.load_path import LoadPath, block_means
from scara_kinetostatic.studies.loops.motion import Motion

_STEP = 1e-4
"""Step of the scaled parameters for finite differences."""


class Fit(NamedTuple):
    """A fitted law.

    Attributes:
        law: the law.
        values: of all common parameters by name, SI.
        states: initial state of friction of each record in the fit, (r,); empty where the motion drives.
        square: sum of squared residuals.
    """

    law: Law
    values: dict[str, float]
    states: Floats
    square: float


class Prediction(NamedTuple):
    """A law along a record.

    Attributes:
        residual: measured less predicted, (n,).
        state: mean initial state of friction.
        zero: response at no load, m or rad.
    """

    residual: Floats
    state: float = 0.0
    zero: float = 0.0


def minimise(
    residual: Callable[[Floats], Floats],
    jacobian: Callable[[Floats], Floats],
    first: Floats,
    bounds: tuple[Floats, Floats],
    penalty: float | Floats,
) -> Floats:
    """The parameters of the least sum of squares near a starting point.

    Args:
        residual: of the parameters, which are scaled to the order of 1.
        jacobian: its derivatives.
        first: the starting point.
        bounds: least and largest values.
        penalty: of a change of a parameter by 1 from its start, over the norm of the residual there.
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
        max_nfev=60,
        ftol=1e-9,
        xtol=1e-9,
        gtol=None,
    )
    return np.asarray(found.x)


def out_of_kinks(residual: Callable[[Floats], Floats], scaled: Floats, bounds: tuple[Floats, Floats]) -> Floats:
    """Steps along single parameters as long as they gain a share of 1e-9 of the sum of squares, the largest first."""
    square, step = float(np.sum(residual(scaled) ** 2)), 1e-2
    for _ in range(20):
        before = square
        for change in step * np.concatenate([np.eye(len(scaled)), -np.eye(len(scaled))]):
            tried = np.clip(scaled + change, *bounds)
            new = float(np.sum(residual(tried) ** 2))
            if new < square * (1 - 1e-9):
                scaled, square = tried, new
        step = step / 4 if square == before else step
    return scaled


def _first_least(squares: Sequence[float]) -> int:
    """Index of the first of the sums of squares that are the least but for rounding."""
    return int(np.argmax(np.asarray(squares) <= min(squares) * (1 + 1e-6)))


def _best(problem: _MotionProblem | _LoadProblem, firsts: Sequence[Floats]) -> Floats:
    """The parameters of the least sum of squares near any of some starting points."""
    if not len(firsts[0]):
        return firsts[0]
    found = [
        minimise(problem.residual, problem.jacobian, first, problem.bounds, problem.penalty(first)) for first in firsts
    ]
    best = found[_first_least([float(np.sum(problem.residual(each) ** 2)) for each in found])]
    return out_of_kinks(problem.residual, best, problem.bounds) if problem.has_kinks else best


def fit_motion(law: Law, motion: Motion, rows: Mask, start: Values | None = None, followed: int = 5) -> Fit:
    """Fits a law to a record driven by its motion.

    Args:
        law: the law.
        motion: the record.
        rows: those in the fit, (n,).
        start: parameters to start from; None for many starts.
        followed: how many of these are optimised.
    """
    problem = _MotionProblem(law, motion, rows)
    best = _best(problem, [problem.scaled(start)] if start else problem.starts()[:followed])
    square = float(np.sum((problem.residual(best) * problem.extent) ** 2))
    return Fit(law, problem.values(best), np.empty(0), square)


class _MotionProblem:
    """The least-squares problem, scaled to the order of 1."""

    has_kinks = True

    def __init__(self, law: Law, motion: Motion, rows: Mask) -> None:
        self.law, self.motion, self.rows = law, motion, rows
        self.scale = np.array([self._size(each) * max(0.01, min(map(abs, each.starts))) for each in law.parameters])
        least = np.array([each.least for each in law.parameters]) / self.scale
        self.bounds = least, np.full(len(least), np.inf)
        self.extent = float(np.linalg.norm(motion.driven[rows]))

    def _size(self, parameter: Parameter) -> float:
        """Range of the data in the unit of a parameter."""
        length, force = self.motion.travel, self.motion.driven_range / 2
        speed = float(np.abs(self.motion.speed).max())
        return {'m': length, 'N': force, 'm/N': length / force, 'N·s/m': force / speed}[parameter.unit]

    def values(self, scaled: Floats) -> dict[str, float]:
        return dict(zip((each.name for each in self.law.parameters), (scaled * self.scale).tolist(), strict=True))

    def scaled(self, values: Values) -> Floats:
        return np.array([values[each.name] for each in self.law.parameters]) / self.scale

    def residual(self, scaled: Floats) -> Floats:
        force = self.law.function(self.motion, self.values(scaled))
        return np.asarray((force - self.motion.driven)[self.rows] / self.extent)

    def jacobian(self, scaled: Floats) -> Floats:
        here = self.residual(scaled)
        steps = np.eye(len(scaled)) * _STEP
        return np.stack([(self.residual(scaled + step) - here) / _STEP for step in steps], axis=1)

    def penalty(self, first: Floats) -> Floats:
        return np.full(len(first), 1e-6)

    def starts(self) -> list[Floats]:
        """Every combination of starting values, the best first."""
        several = product(*([self._size(each) * part for part in each.starts] for each in self.law.parameters))
        starts: dict[float, Floats] = {}
        for values in several:
            start = self._scaled_to_force(dict(zip((each.name for each in self.law.parameters), values, strict=True)))
            starts.setdefault(round(float(np.sum(self.residual(start) ** 2)), 9), start)
        return [starts[square] for square in sorted(starts)]

    def _scaled_to_force(self, start: Values) -> Floats:
        """A start with its forces scaled, and shifted where the law has a zero of the force, to fit best."""
        force, measured = self.law.function(self.motion, start)[self.rows], self.motion.driven[self.rows]
        has_zero = 'force_zero' in start
        design = np.stack([force, np.full(len(force), self.motion.driven_range if has_zero else 0.0)], axis=1)
        (factor, shift), *_ = np.linalg.lstsq(design, measured, rcond=1e-9)
        if not factor > 0:
            return self.scaled(start)
        powers = {'N': 1, 'm/N': -1, 'N·s/m': 1}
        values = {each.name: start[each.name] * factor ** powers.get(each.unit, 0) for each in self.law.parameters}
        if has_zero:
            values['force_zero'] += shift * self.motion.driven_range
        return self.scaled(values)


class Moments:
    """Samples of one record in a fit.

    Args:
        law: the law.
        path: the record.
        rows: samples in the fit, (n,).
        size: largest load of all records, the same for all of one fit.
    """

    def __init__(self, law: Law, path: LoadPath, rows: Mask, size: float) -> None:
        self.law, self.path, self.rows, self.size = law, path, rows, size

    @cached_property
    def grid(self) -> Floats:
        """BᵀB, Bᵀy, yᵀy after centring, on the grid: (shapes, states, k + 1, k + 1)."""
        grid, states = [], _states(self.law, self.path)
        for shape in _shapes(self.law, self.size):
            for state in states:
                basis = self.law.function(self.path, {**shape, 'state': state})
                columns = np.column_stack([basis, self.path.response])[self.rows]
                columns -= columns.mean(axis=0)
                grid.append(columns.T @ columns)
        wide = len(self.law.amplitudes) + 1
        return np.reshape(grid, (-1, len(states), wide, wide))


def _shapes(law: Law, size: float) -> list[Values]:
    """Every combination of starting values of the shape parameters for loads up to `size`."""
    several = product(*([value * _scale(each, size) for value in each.starts] for each in law.shape))
    return [dict(zip((each.name for each in law.shape), shape, strict=True)) for shape in several]


def _scale(parameter: Parameter, size: float) -> float:
    return size if parameter.unit == 'N' else 1.0


def _states(law: Law, path: LoadPath) -> list[float]:
    """Initial states of friction from which a fit starts; the first loops wipe them out."""
    return np.linspace(-1.0, 1.0, 21 if path.rest.any() else 5).tolist() if law.has_state else [0.0]


def fit_load(records: Sequence[Moments], warm_start: Fit | None = None, near: bool = False) -> Fit:
    """Fits a law to records driven by their load.

    Args:
        records: of the same law and `size`.
        warm_start: a fit to the same records or more samples of them, a further starting point.
        near: whether it is the only one.
    """
    law, size = records[0].law, records[0].size
    problem = _LoadProblem(law, records, size)
    if warm_start is not None and near:
        return problem.fitted(_best(problem, [problem.scaled(warm_start)]))
    states, starts = [_states(law, each.path) for each in records], []
    begins = sorted({tuple(round(part * (len(each) - 1)) for each in states) for part in (0.0, 0.5, 1.0)})
    for number, shape in enumerate(_shapes(law, size)):
        grids = [each.grid[number] for each in records]
        found = [_alternate(grids, begin) for begin in begins]
        square, picked = found[_first_least([square for square, _ in found])]
        begin_at = np.array([each[pick] for each, pick in zip(states, picked, strict=True)])
        starts.append(Fit(law, dict(shape), begin_at, square))
    starts.sort(key=lambda start: round(start.square, 12))
    followed = [warm_start, starts[0]] if warm_start else starts[:2]
    return problem.fitted(_best(problem, [problem.scaled(start) for start in followed]))


def _amplitudes(gram: Floats) -> Floats:
    """Least-squares amplitudes a ≥ 0, (k,), from the Gram matrix of (B, y), (k + 1, k + 1)."""
    wide = len(gram) - 1
    scale = np.sqrt(np.maximum(np.diagonal(gram)[:wide], 1e-300))
    root = np.linalg.cholesky(gram[:wide, :wide] / np.outer(scale, scale) + 1e-12 * np.eye(wide))
    return np.asarray(nnls(root.T, np.linalg.solve(root, gram[:wide, wide] / scale))[0] / scale)


def _alternate(grids: Sequence[Floats], begin: Sequence[int]) -> tuple[float, list[int]]:
    """Sum of squares, as a share of that of the response, and indices of the states at one shape."""
    picked = list(begin)
    whole = sum(float(grid[0, -1, -1]) for grid in grids)
    for _ in range(12):
        total = np.sum([grid[pick] for grid, pick in zip(grids, picked, strict=True)], axis=0)
        vector = np.append(-_amplitudes(total), 1.0)
        squares = [np.round(np.einsum('i,sij,j->s', vector, grid, vector) / whole, 12) for grid in grids]
        new, square = [int(each.argmin()) for each in squares], float(sum(each.min() for each in squares))
        if new == picked:
            break
        picked = new
    return square, picked


class _LoadProblem:
    """Shape and states of records driven by their load, with the best amplitudes for them (variable projection).

    Parameters are scaled to the order of 1, shape first.
    """

    def __init__(self, law: Law, records: Sequence[Moments], size: float) -> None:
        self.law, self.records = law, records
        self.has_kinks = any(each.path.rest.any() for each in records)  # many loops smooth them out
        responses = [each.path.response[each.rows] for each in records]
        self._response = np.concatenate([each - each.mean() for each in responses])
        self._ends = np.cumsum([0, *(len(each) for each in responses)])
        self._scales = np.array([_scale(each, size) for each in law.shape])
        states = len(records) if law.has_state else 0
        lower = np.array([1e-3] * len(law.shape) + [-1.0] * states)
        upper = np.array([each.most for each in law.shape] + [1.0] * states)
        self.bounds = lower, upper

    def scaled(self, start: Fit) -> Floats:
        values = np.array([start.values[each.name] for each in self.law.shape])
        return np.concatenate([values / self._scales, start.states if self.law.has_state else []])

    def penalty(self, first: Floats) -> Floats:
        is_shape = np.arange(len(first)) < len(self._scales)
        return np.where(is_shape, 1e-5 / np.maximum(first, 1e-3), 1e-3)

    def fitted(self, scaled: Floats) -> Fit:
        """The law with these parameters and the best amplitudes for them."""
        shape, states = self._split(scaled)
        basis = self._basis(shape, states)
        amplitudes = self._amplitudes(basis)
        left = self._response - basis @ amplitudes
        names = (each.name for each in self.law.amplitudes)
        values = dict(zip(names, amplitudes.tolist(), strict=True)) | shape
        return Fit(self.law, values, states, float(left @ left))

    def residual(self, scaled: Floats) -> Floats:
        """Prediction less response of all samples, without the records' zeros."""
        basis = self._basis(*self._split(scaled))
        return np.asarray(basis @ self._amplitudes(basis) - self._response)

    def jacobian(self, scaled: Floats) -> Floats:
        """Derivatives of the residual, of the basis by differences, at right angles to it (Kaufman, BIT 15, 1975)."""
        shape, states = self._split(scaled)
        basis = self._basis(shape, states)
        amplitudes = self._amplitudes(basis)
        here = basis @ amplitudes
        moved = np.zeros((len(here), len(scaled)))
        for place, name in enumerate(shape):
            stepped = {**shape, name: shape[name] + _STEP * self._scales[place]}
            moved[:, place] = (self._basis(stepped, states) @ amplitudes - here) / _STEP
        for number in range(len(scaled) - len(shape)):
            rows, step = slice(*self._ends[number : number + 2]), _STEP if states[number] < 0 else -_STEP
            own = self._centred(number, shape, float(states[number]) + step) @ amplitudes
            moved[rows, len(shape) + number] = (own - here[rows]) / step
        along = np.linalg.qr(basis[:, amplitudes > 0])[0]
        moved -= along @ (along.T @ moved)
        return moved

    def _split(self, scaled: Floats) -> tuple[dict[str, float], Floats]:
        """Shape and initial states."""
        count = len(self._scales)
        states = scaled[count:] if self.law.has_state else np.zeros(len(self.records))
        values = (scaled[:count] * self._scales).tolist()
        return dict(zip((each.name for each in self.law.shape), values, strict=True)), states

    def _amplitudes(self, basis: Floats) -> Floats:
        columns = np.column_stack([basis, self._response])
        return _amplitudes(columns.T @ columns)

    def _basis(self, shape: Values, states: Floats) -> Floats:
        """The basis s B of all records, each less its mean."""
        return np.concatenate([self._centred(number, shape, state) for number, state in enumerate(states.tolist())])

    def _centred(self, number: int, shape: Values, state: float) -> Floats:
        each = self.records[number]
        basis = self.law.function(each.path, {**shape, 'state': state})[each.rows]
        return np.asarray(basis - basis.mean(axis=0))


def response_to(fitted: Fit, path: LoadPath, state: float) -> Floats:
    """The response by a law, without its zero, (n,), m or rad."""
    amplitudes = np.array([fitted.values[each.name] for each in fitted.law.amplitudes])
    return np.asarray(fitted.law.function(path, {**fitted.values, 'state': state}) @ amplitudes)


def predict(fitted: Fit, path: LoadPath, known: Mask, states: int = 41) -> Prediction:
    """The law along a record driven by its load, its zero and state from the samples known.

    Law (6), which has no memory, takes its zero from the samples at rest alone, if there are some.

    Args:
        fitted: the law with its parameters.
        path: the record.
        known: samples that may be used, (n,).
        states: number of initial states over which the mean is taken; twice more closely where they are too coarse.
    """
    if not fitted.law.has_state:
        off = path.response - response_to(fitted, path, 0.0)
        zero = float(off[path.rest if path.rest.any() else known].mean())
        return Prediction(off - zero, 0.0, zero)
    grid = np.linspace(-1.0, 1.0, states)
    for _ in range(3):
        found, std = _posterior(fitted, path, known, grid)
        step = grid[1] - grid[0]
        if std > step:
            break
        grid = np.clip(found.state + step * np.linspace(-2.0, 2.0, states), -1.0, 1.0)
    return found


def _posterior(fitted: Fit, path: LoadPath, known: Mask, states: Floats) -> tuple[Prediction, float]:
    """Mean prediction over some states, and the standard deviation of the state."""
    off = path.response - np.stack([response_to(fitted, path, state) for state in states.tolist()])
    zeros = off[:, known].mean(axis=1)
    off -= zeros[:, None]
    squares = np.maximum((off[:, known] ** 2).sum(axis=1), 1e-300)
    best = off[int(squares.argmin())][known]
    count = effective_count(block_means(best, path.long_block(len(best))), 0.0)
    weights = (squares / squares.min()) ** (-count / 2)
    weights /= weights.sum()
    state = float(weights @ states)
    prediction = Prediction(weights @ off, state, float(weights @ zeros))
    return prediction, float(np.sqrt(weights @ (states - state) ** 2))


def effective_count(residual: Floats, mean: float | None = None) -> float:
    """Effective number of independent samples of a residual: n / (1 + 2 Σρ), summed up to the first ρ below 0.

    Args:
        residual: (n,).
        mean: the expected one, where it is known; else that of the samples.
    """
    centred = residual - (residual.mean() if mean is None else mean)
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not correlation[0] > 0:
        return float(count)
    rho = correlation / correlation[0]
    end = int(np.argmax(rho < 0)) or count
    return max(count / (1 + 2 * float(rho[1:end].sum())), 2.0)
