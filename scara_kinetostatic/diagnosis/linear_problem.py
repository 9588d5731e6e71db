"""The residual of a fit as a linear problem, in which every effect is tested without another fit.

At a fit, the whitened misclosures of the used touches are linear in what is added to the model,

    y + J Δ + X θ = ε,   ε ~ (0, s² I),

with J the derivatives by L̄ and X those by the parameters of effects. Where the fit already has effects, y is
what it would be without them, to first order. So all effects, those already fitted included, are compared alike;
fitting them only improves the point of linearisation and the noise.

Where the cell description declares uncertainties, y is what it would be without such errors, and all rows are
multiplied by M (`gaussian.linear_model.Marginal`): an effect has to exceed what was declared.

The numbers below decide in a diagnosis: levels of significance, odds, and what counts as identifiable. What they
achieve, false alarms and correct names on simulated cells, is measured by `benchmark/diagnosis`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.fit_point import Point, select, unfitted
from scara_kinetostatic.calibration.gauss_helmert import UnitChanges, noise_left, unit_changes, whiten_by
from scara_kinetostatic.calibration.identifiability import NOISE_SHARE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.effects.base import Effect, Grid, Trial
from scara_kinetostatic.gaussian.linear_model import Additions, Marginal, independent_part, orthonormal
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ForceDependence, TouchState, true_force
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.touch_equations import extended_equations, shift_column

SIGNIFICANCE = 0.01
"""Probability of a false alarm that is accepted where an effect explains the touches clearly better than none does."""
STRICT_SIGNIFICANCE = 1e-3
"""The same where no model selection confirms the test: a model error that no effect explains, noise stated too large or
growing with the force, a fitted curve in place of a physical effect.
"""
FRICTION_SIGNIFICANCE = 2e-3
"""P-value of "the force is radial but for its noise" below which contact friction is named, and above which a model
needs none. Noise that grows with the force looks alike.
"""
CREDIBLE = 10.0
"""Difference of the deviance beyond which one of two fits is ruled out: odds of e⁵. Very strong evidence on the scale
of Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773.
"""
INDEPENDENT_PART = 0.012
"""Part of a unit column that must be independent of the fitted parameters for an effect to be identifiable; less is
made by the noise of the measured force.
"""
INDEPENDENT_PART_CAUTIOUS = 0.03
"""The same where all forces are alike, and of the families of functions that test for a lack of fit."""
FORCE_LEVELS = 3.0
"""Standard deviations of the noise by which forces must scatter to be of several levels."""
_MOST = 1000
"""Touches among which effects are looked for at most; tests of the residual and the fit use all. More find effects of a
typical size in 13 of 19 kinds, not 12, and take twice as long."""


class TrialColumns(NamedTuple):
    """Columns of t trials of an effect, m each, for n touches.

    Attributes:
        unit: of each trial, (t, m, n, 2), or of all, (1, m, n, 2).
        factors: by which those of all are multiplied in each, (t, m, n) or (t, 1, n).
    """

    unit: Floats
    factors: Floats | None = None

    def products(self, right: Floats) -> Floats:
        """Inner products with columns (2n, k), (t, m, k)."""
        t, m, n, _ = self.unit.shape
        if self.factors is None:
            return (self.unit.reshape(t * m, 2 * n) @ right).reshape(t, m, right.shape[1])
        right = right.reshape(n, 2, -1)
        each = (factor @ np.einsum('nc,nck->nk', unit, right) for factor, unit in self._pairs())
        return np.stack([*each], axis=1)

    def gram(self) -> Floats:
        """Inner products of the columns of each trial, (t, m, m)."""
        if self.factors is None:
            t, m, n, _ = self.unit.shape
            rows = self.unit.reshape(t, m, 2 * n)
            return rows @ rows.transpose(0, 2, 1)
        pairs = [*self._pairs()]
        each = [[(one * other) @ (a * b).sum(axis=-1) for other, b in pairs] for one, a in pairs]
        return np.array(each).transpose(2, 0, 1)

    def of_trial(self, k: int) -> Floats:
        """Columns of one of the trials, (2n, m)."""
        some = self.unit[k] if self.factors is None else self.unit[0] * self.factors[k, :, :, None]
        return some.reshape(len(some), 2 * self.unit.shape[2]).T

    def _pairs(self) -> Iterator[tuple[Floats, Floats]]:
        """Factor, (t, n), and unit, (n, 2), of each column."""
        assert self.factors is not None
        (unit,), (t, _, n) = self.unit, self.factors.shape
        return zip(np.broadcast_to(self.factors, (t, len(unit), n)).swapaxes(0, 1), unit, strict=True)


class LinearProblem(NamedTuple):
    """The linear problem of n touches.

    Attributes:
        calibration: the fit.
        point: of the linearisation.
        by_unit: what the effects change there.
        touch_state: what effects depend on, for each touch.
        force: true forces in the sensor's frame, (n, 2), N.
        larger_by_noise: the same touches, each force larger by one standard deviation of the noise left in it.
        marginal: M, by which whitened rows are multiplied for what declared errors add to their covariance.
        base: orthonormal basis of J, (2n, r).
        left: y projected off J, (2n,).
        seen: of columns that are not multiplied by M, what `base` and `left` see when they are, and their rows of
            I - M², (2n, r + 1 + q).
        one_level: whether all forces are the same but for their noise, so that their differences are noise.
        response: derivative of L̄ by y, (12, 2n).
        without_effects: change of L̄ where the effects of the fit are left out, to first order, (12,).
        jacobian: the whitened derivatives by what the touches determine of L̄, (2n, r), not multiplied by M.
        identifiable: that, (12, r).
    """

    calibration: Calibration
    point: Point
    by_unit: UnitChanges
    touch_state: TouchState
    force: Floats
    larger_by_noise: TouchState
    marginal: Marginal
    base: Floats
    left: Floats
    seen: Floats
    one_level: bool
    response: Floats
    without_effects: Floats
    jacobian: Floats
    identifiable: Floats

    @property
    def noise_given(self) -> bool:
        """Whether s is known to be 1."""
        return self.calibration.noise_source == 'given'

    @property
    def freedoms(self) -> int:
        """Degrees of freedom: rows less the rank of J."""
        return len(self.left) - self.base.shape[1]

    def independent_part(self, trial: Trial) -> Floats:
        """Orthonormal basis of what a trial adds to the base model, (2n, r)."""
        return independent_part(self.base, self.columns(trial), self.least_independent_part)

    @property
    def least_independent_part(self) -> float:
        """Part of a unit column that must be independent of the base model."""
        return INDEPENDENT_PART_CAUTIOUS if self.one_level else INDEPENDENT_PART

    def of_trials(self, trials: Sequence[Trial]) -> TrialColumns:
        """X of the trials of one effect, whitened but not multiplied by M."""
        if isinstance(trials, Grid):
            return TrialColumns(self.changes(trials.unit).T.reshape(1, -1, *self.force.shape), trials.factors)
        return TrialColumns(self.changes(*trials).T.reshape(len(trials), -1, *self.force.shape))

    def columns(self, *trials: Trial) -> Floats:
        """X of trials side by side, whitened, (2n, m); m may be 0, as random off-normal angles have no column."""
        return self.marginal.apply(self.changes(*trials))

    def beside_base(self, columns: TrialColumns) -> tuple[Floats, Floats, Floats]:
        """Inner products of columns multiplied by M, (t, m, m), of what is left of them beside J, (t, m, m), and of
        that with y, (t, m). By differences: to 1e-6 of them where M takes at most 1e10 of a square.
        """
        rank = self.base.shape[1]
        along, left, rest = np.split(columns.products(self.seen), [rank, rank + 1], axis=2)
        gram = columns.gram() - rest @ rest.transpose(0, 2, 1)
        return gram, gram - along @ along.transpose(0, 2, 1), left[..., 0]

    def additions(self, single: Sequence[tuple[Effect, Trial]]) -> tuple[list[Floats], Additions]:
        """What effects of one trial change, as of `changes`, (2n, m) each, and what they add to the base model, beside
        the noise in F̂.
        """
        grown = self.force * (self.larger_by_noise.magnitude / self.touch_state.magnitude)[:, None]
        depends = [e.force_dependence is ForceDependence.ALL or bool(trial.sensor_errors) for e, trial in single]
        noisy = (item[0].trials(self.larger_by_noise, grown)[0] for item, x in zip(single, depends, strict=True) if x)
        widths = np.array([len(trial.columns) for _, trial in single], dtype=np.intp)
        of_noisy = np.repeat(np.array(depends, dtype=bool), widths)
        changes = self.changes(*(trial for _, trial in single), *noisy).T.reshape(-1, *self.force.shape)
        columns, noise = changes[: len(of_noisy)], np.zeros((len(of_noisy), *self.force.shape))
        noise[of_noisy] = changes[len(of_noisy) :] - columns[of_noisy]
        explained, rank, part = np.zeros(len(single)), np.zeros(len(single), dtype=np.intp), np.zeros(len(single))
        for width in np.unique(widths[widths > 0]):
            at = np.flatnonzero(widths == width)
            own = (np.cumsum(widths) - widths)[at, None] + np.arange(width)
            square, gram, left = self.beside_base(TrialColumns(columns[own]))
            made = self.beside_base(TrialColumns(noise[own]))[0] if of_noisy[own].any() else None
            explained[at], rank[at], part[at] = Additions.of(
                gram, left, square, self.least_independent_part, made, NOISE_SHARE
            )
        each = np.split(columns.reshape(len(columns), self.force.size).T, np.cumsum(widths), axis=1)[:-1]
        return each, Additions(explained.tolist(), rank.tolist(), part.tolist())

    def changes(self, *trials: Trial) -> Floats:
        """Changes of the whitened misclosures by the columns of trials side by side, (2n, m), not multiplied by M."""
        shifts = [shift for trial in trials for shift in trial.columns]
        errors = [error for trial in trials for error in trial.sensor_errors or (None,) * len(trial.columns)]
        changes = np.zeros((len(shifts), *self.force.shape))
        for by_unit, parts in zip(self.by_unit, (*zip(*shifts, strict=True), errors), strict=False):
            acting = [k for k, part in enumerate(parts) if part is not None]
            if acting:
                x, y = np.moveaxis(np.array([parts[k] for k in acting]), -1, 0)
                for row, (by_x, by_y) in enumerate(by_unit.transpose(1, 2, 0)):
                    changes[acting, :, row] += x * by_x + y * by_y
        return changes.reshape(-1, self.force.size).T


def pose_problem(calibration: Calibration, level: Floats | None = None) -> LinearProblem:
    """The linear problem of a calibration with or without effects.

    Args:
        calibration: the fit; effects whose parameters are all held are a part of the base model.
        level: its random effects count with sizes larger by this, (r,); None for their own.
    """
    c = calibration
    some = _some(c.used)
    observations, point = c.observe(some), select(c.projection, some)
    count, state, root = c.model.base_count, point.adjusted.state, point.whitened.root
    identifiable = c.subspace.basis[:count, ~c.subspace.basis[count:].any(axis=0)]
    contact_problem = observations.contact_problem(point.adjusted.joints, point.adjusted.off_normal)
    equations = extended_equations(c.model, contact_problem, state)
    touch_state = contact_problem.touch_state(c.parameters, state)
    by_base = point.whitened.derivative[:, :, :count].copy()
    # the effects are to be taken out, and what of L̄ scales them with them
    for name, shift in c.model.shift_by_robot(touch_state).items():
        by_base[:, :, NAMES.index(name)] -= whiten_by(shift_column(shift, equations), root)
    jacobian = (by_base @ identifiable).reshape(2 * len(point.distance), -1)
    marginal, unprojected = unfitted(point, level)
    whitened = marginal.apply(jacobian)
    base, response = orthonormal(whitened), -identifiable @ np.linalg.pinv(whitened)
    amplitudes = [
        0.0 * part if effect.label in c.held_effects else effect.amplitudes(part)
        for effect, part in zip(c.model.effects, c.model.effect_arrays, strict=True)
    ]
    effects = point.whitened.derivative[:, :, count:].reshape(len(base), -1)
    y = unprojected - marginal.apply(effects @ np.concatenate([np.empty(0), *amplitudes]))
    by_unit = unit_changes(equations, point.linear.by_force, point.adjusted.force)
    left = y - base @ (base.T @ y)
    by_base_and_left = marginal.apply(np.column_stack([base, left]))
    return LinearProblem(
        calibration=c,
        point=point,
        by_unit=UnitChanges(*(whiten_by(part, root) for part in by_unit)),
        touch_state=touch_state,
        force=true_force(c.model, point.adjusted.force, observations.metadata),
        larger_by_noise=_with_larger_force(touch_state, noise_left(point.linear, root, c.noise, 0)),
        marginal=marginal,
        base=base,
        left=left,
        seen=np.concatenate([by_base_and_left, marginal.basis * marginal.part], axis=1),
        one_level=bool(np.std(state.magnitude) < FORCE_LEVELS * c.noise.force_at(float(state.magnitude.mean()))),
        response=response,
        without_effects=response @ y,
        jacobian=jacobian,
        identifiable=identifiable,
    )


def _with_larger_force(touch_state: TouchState, more: Floats) -> TouchState:
    """The touches with each force larger by `more`, (n,), N."""
    larger = 1 + more / touch_state.magnitude
    return touch_state._replace(
        magnitude=touch_state.magnitude * larger,
        force=touch_state.force * larger[:, None],
        torques=touch_state.torques * larger[:, None],
    )


def _some(which: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`_MOST` of the used touches, if there are more: the first in a random order of all, so that fits that use others
    are compared by nearly the same ones.
    """
    if which.sum() <= _MOST:
        return which
    order, drawn = np.random.default_rng(0).permutation(len(which)), np.zeros_like(which)
    drawn[order[which[order]][:_MOST]] = True
    return drawn


def fitted_effects(calibration: Calibration) -> list[tuple[Effect, Floats]]:
    """The effects of a calibration and the values of their parameters, (k,) each."""
    model = calibration.model
    return list(zip(cast('tuple[Effect, ...]', model.effects), model.effect_arrays, strict=True))
