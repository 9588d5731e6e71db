"""One linear mixed model for estimate, effects and uncertainty.

At a fit the whitened misclosures of the touches are, to first order,

    y + J Δ + N e + Σ_g τ_g X_g u_g = ε,    u_g ~ N(0, I),    e ~ N(0, I),    ε ~ N(0, V),

with J the derivatives by what the touches determine of L̄, N those by the declared errors, and X_g the columns of one
effect of the catalogue, in units of its typical size (`Effect.size`). Every effect of the catalogue is in it, as
`RandomEffects` held where they are; those that are named are effects of the model, linearised anew. None is free.

**Sizes.** The τ are found by restricted likelihood (REML; Patterson and Thompson, Biometrika 58 (1971) 545), by Fisher
scoring in log τ. A robot is good or bad as a whole, so they have a common size τ_0 beforehand: τ_g / τ_0 is half-t with
scale 1, and τ_0 half-Cauchy (Gelman, Bayesian Analysis 1 (2006) 515). While flaws are looked for, and where they are
named, τ_g / τ_0 is half-Cauchy, too: its tails leave one large flaw among small errors as large as it is, and these
small. What is left is more alike: three degrees of freedom. The density in log τ counts: what the touches say nothing
of has the common size, not none. The root mean square of τ is taken, as squares add up in a variance: exp(log τ + v)
with the variance v of log τ by Laplace's approximation, at most √3 τ as by the prior. What gross effects change is in
the final estimate and its covariance by their probabilities (`model_averaging`), of those too that no touch shows.
Sizes that the cell description declares are held. Where the fit has estimated the noise, its levels are estimated
along with the sizes, each by its sum of squares over its redundancy (`gaussian.variance_components.estimate_levels`).

**Estimate.** Values, errors and effects are those of the penalised least-squares problem (BLUP; Henderson 1950), their
covariance is the inverse of its normal matrix, and the model is linearised there anew until it settles.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.estimate import fewest_touches
from scara_kinetostatic.calibration.fit_point import Point, select
from scara_kinetostatic.calibration.gauss_helmert import whitened_square
from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.noise import USUAL_NOISE, raised
from scara_kinetostatic.calibration.observations import JointPrior, Prior, RandomEffects, Source
from scara_kinetostatic.calibration.outliers import FALSE_REJECTIONS, find_good, studentised
from scara_kinetostatic.calibration.result import Calibration, enlargement_of, outlier_rejections
from scara_kinetostatic.calibration.solver import ActivePrior, Subspace, Termination
from scara_kinetostatic.diagnosis.linear_problem import fitted_effects
from scara_kinetostatic.diagnosis.odds import NEEDED
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import columns_of
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import Projected
from scara_kinetostatic.gaussian.variance_components import (
    at_levels,
    estimate_levels,
    estimate_sizes,
    inverse_roots,
    penalised,
    posterior,
    size_prior,
    weights_of,
)
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Noise, SizeMode
from scara_kinetostatic.model.extended_model import ExtendedModel, true_force
from scara_kinetostatic.model.touch import Rejection

HEAVY_TAILS, LIGHT_TAILS = 1.0, 3.0
"""Degrees of freedom of the sizes' prior: of flaws, named or looked for; of what is left, whose mean square exists."""
_LARGEST_RATIO = 3**0.5
"""Root mean square of τ_g / τ_0 with light tails, where the touches say nothing of it."""
_OF_EXPECTED = 0.5
"""Part of the variance of log τ that counts for touches to be made: the sizes of a robot with typical ones scatter, and
the logarithms that touches show of them lie below. Source: `benchmark.design`, where calibrations of simulated robots
state 1.02 times what is so predicted (median); in an earlier trial all of it gave 0.75 to 0.9, nothing 1.15 to 1.3.
"""
_LEAST_PART = 0.03
"""Of the noise level of the base model, or the usual one: all of it may be model error, but touches do scatter."""
_CLEARLY = 2 * np.log(NEEDED)
"""By which the deviance of the first linearisation is to be less than that of the last, for a search to begin there."""
_LOST = 1000.0
"""Mean squared distance of the touches from which no step has led back: of 440 fits that settle the largest is 192."""
_MOST_STEPS = 8
"""Linearisations at most."""
_SETTLED = 0.05
"""Standard deviations by which a further linearisation may move a value."""


class MixedModel(NamedTuple):
    """The fit of the mixed model.

    Attributes:
        fit: the calibration with its named effects, the random effects and the covariance of all.
        level: by what the sizes of the random effects are to be multiplied to be the robot's, or those declared, (r,).
        typical: the same to be the typical sizes, or those declared, (r,).
        is_free: whether the sizes of these were estimated, (r,).
        deviance: -2 log restricted likelihood and priors of the sizes, with what rejected touches cost.
        rejected: that cost.
        solved: of the last linearisation.
        first: the first linearisation, without names, where that is likelier: small effects together may imitate a
            gross one, which the touches show there. What it promises need not hold. None else.
    """

    fit: Calibration
    level: Floats
    typical: Floats
    is_free: Mask
    deviance: float
    rejected: float
    solved: _Solved
    first: MixedModel | None = None


class _Sizes(NamedTuple):
    """The columns with a prior: those of declared errors, of named effects, and of random effects, c in all.

    Attributes:
        scale: the size of each that τ = 1 stands for, (c,).
        group: number of the group of each that is to be estimated; -1 of others, for which τ is 1, (c,).
        freedoms: of the prior of the size of each group and of τ_0, (g + 1,).
    """

    scale: Floats
    group: Indices
    freedoms: Floats


def fit_mixed(
    c: Calibration,
    known: Sequence[Effect],
    named: ExtendedModel | None = None,
    *,
    keeps_touches: bool = False,
    freedoms: float = LIGHT_TAILS,
    begin: MixedModel | None = None,
    expected: bool = False,
) -> MixedModel:
    """The mixed model of the touches of a calibration.

    Args:
        c: the base model; effects that it has stay as they are.
        known: the catalogue.
        named: the effects to name, with values to begin with, and L̄; None for none.
        keeps_touches: whether outliers stay, as what is missing may explain them.
        freedoms: of the prior of the sizes.
        begin: a fit of the same effects to begin at, with its undetected effects and their sizes; None to begin
            without these, from typical sizes.
        expected: whether the touches are exact ones of a design: the sizes are then typical, and as uncertain as such
            touches leave them.

    Raises:
        UnsupportedDataError: it diverges.
    """
    own, named = c.model, named or ExtendedModel(c.parameters)
    values = (*own.effect_values, *named.effect_values)
    model = ExtendedModel(named.parameters, (*own.effects, *named.effects), values)
    steps = list[_Step]()
    with np.errstate(all='ignore'), suppress(np.linalg.LinAlgError, ParameterError):
        latest, sizes, logs = _begin(c, known, model, freedoms, begin)
        lost = max(10.0 * float(latest.projection.distance[latest.used].mean()), _LOST)
        for number in range(_MOST_STEPS):
            # model error may have been taken for noise: of two explanations that with the usual noise is tried first
            noise = c.noise if number or begin else min(c.noise, USUAL_NOISE, key=lambda one: one.joint_rms)
            levels = np.array([(noise.joint_rms / c.noise.joint_rms) ** 2, 1.0]) if c.noise.joint_rms else np.ones(2)
            if not latest.projection.distance[latest.used].mean() < lost:
                raise np.linalg.LinAlgError('the linearisations lead away from the touches')
            solved = _solve(latest, c, sizes, logs, levels, expected)
            logs, shift = solved.logs, _shift(latest, solved)
            for part in (1.0, 0.5, 0.25, 0.125):  # a part of the way where the model is not defined at its end
                moved = _moved(latest, solved, c.noise, part)
                if np.isfinite(moved.projection.distance[latest.used]).all():
                    break
            steps.append(_Step(moved, solved, part == 1.0, shift))
            pairs = zip(moved.noise.levels, latest.noise.levels, strict=True)
            settled = shift < _SETTLED and all(abs(after - before) <= 0.05 * before for after, before in pairs)
            good = c.used if keeps_touches else _good(latest, solved, moved, late=number >= 3)
            if settled and (good == moved.used).all():
                break
            latest = moved.changed(used=good)
            if number == 0 and shift > 1.0 and latest.random is not None:  # the columns are those of where it began
                latest = latest.changed(random=_with_random_effects(latest, latest.model, known)[0].random)
        first, last = steps[0], steps[-1]
        if last.is_valid and last.shift < 1.0:
            is_plain = begin is None and not named.effects
            likelier = is_plain and first.is_valid and first.deviance < last.deviance - _CLEARLY
            return _result(last, c)._replace(first=_result(first, c) if likelier else None)
    with np.errstate(all='ignore'), suppress(np.linalg.LinAlgError):
        if steps and steps[0].is_valid:  # where it does not settle
            return _result(steps[0], c)
    raise UnsupportedDataError('the fit diverges', 'check the places of the discs, and units, signs and frames')


class _Step(NamedTuple):
    """A linearisation solved.

    Attributes:
        moved: the calibration at its solution.
        solved: that.
        is_whole: whether it is there, not a part of the way.
        shift: largest change of a value of the model, in standard deviations.
    """

    moved: Calibration
    solved: _Solved
    is_whole: bool
    shift: float

    @property
    def is_valid(self) -> bool:
        """Whether the model is defined at the solution."""
        distance = self.moved.projection.distance[self.moved.used]
        return self.is_whole and bool(np.isfinite([self.solved.deviance, *distance]).all())

    @property
    def rejected(self) -> float:
        """-2 log likelihood of the touches that are not used."""
        used = self.moved.used
        return float((~used).sum()) * -2 * float(np.log(FALSE_REJECTIONS / len(used)))

    @property
    def deviance(self) -> float:
        """As in `MixedModel`."""
        return self.solved.deviance + self.rejected


def _begin(
    c: Calibration, known: Sequence[Effect], model: ExtendedModel, freedoms: float, begin: MixedModel | None
) -> tuple[Calibration, _Sizes, Floats]:
    """The calibration at which the first linearisation is made, the columns with a prior, and log τ to begin with."""
    latest, is_free = _with_random_effects(c, model, known)
    sizes = _sizes_of(latest, len(c.model.effects), is_free, freedoms)
    logs = _first_logs(latest, sizes)
    if begin is not None and begin.fit.random is not None:
        size, own = begin.fit.random.size / _random_sizes(latest), _of_random(latest, sizes.group)
        # far from these the likelihood has other maxima: the columns are those of the first linearisation
        logs[own[own >= 0]], logs[-1] = np.log(size[own >= 0]), begin.solved.logs[-1]
        values = size * begin.fit.random_values
        latest = latest.changed(errors=begin.fit.errors, random_values=values, noise=begin.fit.noise)
    return latest, sizes, logs


def _with_random_effects(c: Calibration, model: ExtendedModel, known: Sequence[Effect]) -> tuple[Calibration, Mask]:
    """A calibration with another model and with all random effects of typical or declared size and value zero; of which
    the size is to be estimated, (r,).
    """
    declared, point = c.cell.uncertainty.effects, c.projection
    problem = c.observe().contact_problem(point.adjusted.joints, point.adjusted.off_normal)
    at = problem.touch_state(c.parameters, point.adjusted.state)
    force = true_force(c.model, point.adjusted.force, at.metadata)
    sources = c.declared
    labels = set() if sources is None else {source.label for source in sources.sources}
    named = {e.label for e in model.effects if e.parameters}
    without_size = {e.label.partition('[')[0] for e in model.effects if not e.parameters}  # random angles
    found = []
    for effect in known:
        stated = declared.stated.get(effect.label, declared.stated.get(effect.name))
        absent = stated == 0.0 or (stated is None and declared.sizes is SizeMode.NONE)
        is_declared = (effect.declared_as or effect.label) in labels
        if absent or is_declared or effect.name in without_size or effect.label in named:
            continue
        columns = columns_of(effect, at)
        forms = max(len({column.values for column in columns}), 1)
        for column in columns:
            size = effect.size(column.parameter, declared.arm) / forms**0.5
            if stated:  # of the first parameter; others in proportion
                size *= stated / effect.size(0, declared.arm)
            found.append((column, size, not stated and declared.sizes is SizeMode.ESTIMATED))
    found.sort(key=lambda item: (not item[0].moves_robot, item[0].effect.force_dependence))
    size, is_free = np.array([item[1] for item in found]), np.array([item[2] for item in found], dtype=bool)
    sizes = {name: std for name, std in declared.stated.items() if std}
    random = RandomEffects.at([item[0] for item in found], size, at, force, sizes) if found else None
    values, subspace = np.zeros(len(found)), _subspace(c, model)
    return c.changed(model=model, random=random, random_values=values, subspace=subspace, known=None), is_free


def _subspace(c: Calibration, model: ExtendedModel) -> Subspace:
    """What the fit may change: what the touches determine of L̄, and all values of effects that are not held."""
    scales, count = scales_of(model), model.base_count
    base = np.pad(c.subspace.basis, ((0, len(scales) - len(c.subspace.basis)), (0, 0)))
    free = [k for k, name in enumerate(model.names) if k >= count and name not in model.held and name not in c.fixed]
    return Subspace(model.as_array(), np.concatenate([base, np.diag(scales)[:, free]], axis=1))


def _sizes_of(c: Calibration, kept: int, is_free: Mask, freedoms: float) -> _Sizes:
    """The columns with a prior at a linearisation, and their groups: one for each label, and for each named effect."""
    arm = c.cell.uncertainty.effects.arm
    scale, groups = [1.0] * len(c.errors), [''] * len(c.errors)
    for number, (effect, values) in enumerate(fitted_effects(c)):
        acts = effect.amplitudes(np.ones(len(values))) != 0
        for k, parameter in enumerate(effect.parameters):
            if (name := f'{effect.label}.{parameter.name}') not in c.fixed and name not in c.model.held:
                scale.append(effect.size(k, arm) if acts[k] else parameter.scale)
                groups.append(f'named {effect.label}' if acts[k] and number >= kept else '')
    labels = [] if c.random is None else [column.effect.label for column in c.random.columns]
    groups += [label if free else '' for label, free in zip(labels, is_free.tolist(), strict=True)]
    names = [name for name in dict.fromkeys(groups) if name]
    group = np.array([names.index(name) if name else -1 for name in groups], dtype=np.intp)
    of_each = [HEAVY_TAILS if name.startswith('named ') else freedoms for name in names]
    return _Sizes(np.concatenate([scale, _random_sizes(c)]), group, np.array([*of_each, HEAVY_TAILS]))


def _random_sizes(c: Calibration) -> Floats:
    """Sizes of the random effects of a calibration, (r,)."""
    return np.zeros(0) if c.random is None else c.random.size


def _first_logs(c: Calibration, sizes: _Sizes) -> Floats:
    """Log τ to begin with: typical sizes, and of named effects their own."""
    named = slice(len(c.errors), len(c.errors) + len(_effect_places(c)))
    squares = np.square(amplitudes(c)[_effect_places(c)] / sizes.scale[named])
    squares = np.bincount(np.maximum(sizes.group[named], 0), squares, len(sizes.freedoms))
    return np.where(squares > 0, 0.5 * np.log(np.maximum(squares, 1e-4)), 0.0)


class _Solved(NamedTuple):
    """The mixed model at one linearisation.

    Attributes:
        logs: log τ of each group and log τ_0, (g + 1,), at their maximum.
        levels: variances of the noise of joints and force, in those of the linearisation.
        inner: the problem in the metric of the noise.
        group: of each column, -1 but of random effects whose size is estimated, (c,).
        tau: sizes of the columns in their units: the root mean square, (c,).
        lift: from the changes of L̄ in the basis of the fit without effects and the values of the columns to all values
            of the model, declared errors and random values, the last in units of `tau`, (12 + k + m + r, b + c).
        change: these by the penalised estimate, (12 + k + m + r,).
        covariance: of these.
        chi_square: that of the residual and of all that is known beforehand.
        deviance: as in `MixedModel`, of the used touches.
    """

    logs: Floats
    levels: Floats
    inner: Projected
    group: Indices
    tau: Floats
    lift: Floats
    change: Floats
    covariance: Floats
    chi_square: float
    deviance: float

    @property
    def rank(self) -> int:
        """How much of L̄ the touches determine, b."""
        return self.inner.base.shape[1]


def _columns(c: Calibration, point: Point, base: Calibration) -> tuple[Floats, Floats, Floats]:
    """Whitened J, (2n, b), the columns with a prior, each by its unit, (2n, c), the residual without them, (2n,)."""
    w = point.whitened
    rows, b = w.residual.size, base.subspace.basis.shape[1]
    fitted = (w.derivative @ c.subspace.basis[:, :b]).reshape(rows, -1)
    by_errors = np.zeros((rows, 0)) if w.by_errors is None else w.by_errors.reshape(rows, -1)
    by_effects = w.derivative.reshape(rows, -1)
    known = by_errors @ np.concatenate([c.errors, c.random_values]) + by_effects @ amplitudes(c)
    declared, random = np.split(by_errors, [len(c.errors)], axis=1)
    columns = [declared, by_effects[:, _effect_places(c)], random / _random_sizes(c)]
    return fitted, np.concatenate(columns, axis=1), w.residual.ravel() - known


def _solve(c: Calibration, base: Calibration, sizes: _Sizes, start: Floats, levels: Floats, expected: bool) -> _Solved:
    """Sizes, noise levels and the penalised estimate at a linearisation; sizes and levels to begin with are given."""
    point = select(c.projection, c.used)
    fitted, columns, residual = _columns(c, point, base)
    columns, trusted = columns * sizes.scale, trusted_rows(c, base.subspace.basis[: c.model.base_count])
    is_estimated = c.cell.noise is None
    of_joints = whitened_square(point.linear.by_joints * c.noise.joint_rms, point.whitened.root)
    levels = levels if is_estimated else np.ones(2)
    logs, inverse = start, inverse_roots(of_joints, levels)
    inner = at_levels(inverse, fitted, columns, residual, trusted)
    for _ in range(6):
        logs, variance = estimate_sizes(inner, sizes.group, logs, sizes.freedoms, held=expected)
        weights, before = weights_of(sizes.group, logs), levels
        if not is_estimated:
            break
        levels = estimate_levels(inner, inverse, of_joints, levels, weights)
        inverse = inverse_roots(of_joints, levels)
        inner = at_levels(inverse, fitted, columns, residual, trusted)
        if np.abs(np.log(levels / before)).max() < 0.05:
            break
    deviance = penalised(inner, weights)[0] + size_prior(logs, sizes.freedoms)[0]
    l11, _, l22 = c.projection.whitened.root  # of rejected touches, too: of as many densities
    deviance += 2 * np.log(np.abs(np.diag(inner.triangle))).sum()
    deviance += 2 * np.log(l11 * l22).sum() - 2 * np.log(np.linalg.det(inverse)).sum()
    more = np.minimum(variance, np.log(_LARGEST_RATIO))
    weights = weights_of(sizes.group, logs + (_OF_EXPECTED if expected else 1.0) * more)
    y, u, covariance = posterior(inner, weights)
    group, tau = sizes.group.copy(), sizes.scale * weights
    group[: len(group) - len(c.random_values)] = -1
    lift = _lift(c, tau, len(y))
    return _Solved(
        logs,
        levels,
        inner,
        group,
        tau,
        lift,
        change=lift @ np.concatenate([y, u]),
        covariance=lift @ covariance @ lift.T,
        chi_square=float(inner.square + weights * inner.projected @ u),
        deviance=deviance,
    )


def trusted_rows(c: Calibration, base: Floats) -> tuple[Floats, Floats]:
    """Rows of the trusted nominal values by L̄ in a basis (12, b), (p, b), and their residuals, (p,)."""
    prior = ActivePrior.of(c.observe(), c.subspace) if c.trusted else None
    if prior is None or isinstance(prior.prior, JointPrior):
        return np.zeros((0, base.shape[1])), np.zeros(0)
    kept = prior.active[: len(prior.prior.trusted)] & (prior.prior.trusted < len(base))
    at, std = prior.prior.trusted[kept], prior.prior.std[kept]
    return base[at] / std[:, None], (c.model.as_array()[at] - prior.prior.mean[kept]) / std


def amplitudes(c: Calibration) -> Floats:
    """The free values of effects of which these vanish with zero, all other values of the model as zero, (12 + k,)."""
    amplitudes = np.concatenate([np.zeros(c.model.base_count), *(e.amplitudes(v) for e, v in c.model.pairs)])
    return np.asarray(amplitudes * c.subspace.basis.any(axis=1))


def _effect_places(c: Calibration) -> Indices:
    """Positions of the free values of effects among all values."""
    count = c.model.base_count
    return count + np.flatnonzero(c.subspace.basis[count:].any(axis=1))


def _shift(c: Calibration, solved: _Solved) -> float:
    """Largest change of a value of the model by a solution, in standard deviations."""
    off, size = amplitudes(c), len(c.model.names)
    std = np.sqrt(np.diag(solved.covariance)[:size])
    return float(np.max((np.abs(solved.change[:size] - off) / std)[std > 0], initial=0.0))


def _lift(c: Calibration, tau: Floats, b: int) -> Floats:
    """`_Solved.lift`."""
    size, m, r, places = len(c.model.names), len(c.errors), len(c.random_values), _effect_places(c)
    lift = np.zeros((size + m + r, b + len(tau)))
    lift[:size, :b] = c.subspace.basis[:, :b]
    lift[places, b + m + np.arange(len(places))] = tau[m : m + len(places)]
    lift[size + np.arange(m), b + np.arange(m)] = 1.0
    lift[size + m + np.arange(r), b + m + len(places) + np.arange(r)] = 1.0
    return lift


def _moved(c: Calibration, solved: _Solved, before: Noise, part: float) -> Calibration:
    """The calibration a part of the way to the solution of its linearisation, with the noise that this has found."""
    changes, errors, random = np.split(solved.change, np.cumsum([len(c.model.names), len(c.errors)]))
    values = c.model.as_array() - amplitudes(c) + changes
    random, noise = random * _of_random(c, solved.tau) / _random_sizes(c), c.noise
    if c.cell.noise is None:
        least = [_LEAST_PART * min(one, other) for one, other in zip(before.levels, USUAL_NOISE.levels, strict=True)]
        by_joints, by_force = np.sqrt(solved.levels).tolist()
        growth = None if noise.force_relative is None else noise.force_relative * by_force
        joint, force = max(noise.joint_rms * by_joints, least[0]), max(noise.force_rms * by_force, least[2])
        noise = noise._replace(joint=joint, force=force, force_relative=growth)
        noise = raised(noise, c.cell, c.touches.joints)
    latest = c.model.as_array(), c.errors, c.random_values
    values, errors, random = (
        old + part * (new - old) if part < 1 else new for old, new in zip(latest, (values, errors, random), strict=True)
    )
    return c.changed(model=c.model.with_array(values), errors=errors, random_values=random, noise=noise)


def _good(c: Calibration, solved: _Solved, moved: Calibration, late: bool) -> Mask:
    """Which touches are no outliers at the solution of a linearisation; their leverage is that in the linearisation."""
    good = find_good(_distances(c, solved, moved.projection.whitened.residual))
    good = good & c.used if late else good
    return good if good.sum() >= 2 * fewest_touches(solved.rank) else c.used


def _distances(c: Calibration, solved: _Solved, residual: Floats) -> Floats:
    """Squared studentised distances of all touches with whitened residuals (n, 2), (n,)."""
    unit = np.ones(len(solved.covariance))
    unit[len(unit) - len(c.random_values) :] = _of_random(c, solved.tau) / _random_sizes(c)
    return studentised(
        c.projection.whitened._replace(residual=residual), unit[:, None] * solved.covariance * unit, c.used
    )


def _of_random(c: Calibration, columns: np.ndarray) -> np.ndarray:
    """What of columns with a prior is of random effects."""
    return columns[len(columns) - len(c.random_values) :]


def _resized(c: Calibration, size: Floats) -> Calibration:
    """The same calibration with the random effects in units of other sizes."""
    if c.random is None:
        return c
    factor, m, point = size / c.random.size, len(c.errors), c.projection
    values = c.random_values / factor
    every = np.concatenate([np.ones(m), factor])
    assert point.whitened.by_errors is not None and point.linear.by_errors is not None
    point = point._replace(
        linear=point.linear._replace(by_errors=point.linear.by_errors * every),
        whitened=point.whitened._replace(by_errors=point.whitened.by_errors * every),
        errors=np.concatenate([c.errors, values]),
    )
    return c.changed(point, random=c.random.resized(factor), random_values=values)


def _result(step: _Step, base: Calibration) -> MixedModel:
    """The calibration with its covariance and what contributes to it."""
    moved, solved = step.moved, step.solved
    c = _resized(moved, _of_random(moved, solved.tau))
    point, freedoms = c.projection, len(solved.inner.residual) - solved.rank
    c = c.changed(known=_known(c, solved))
    everything = enlargement_of(solved.chi_square, freedoms) * solved.covariance
    distance = _distances(c, solved, point.whitened.residual)
    c = c.changed(
        covariance_with_errors=everything,
        chi_square=solved.chi_square,
        degrees_of_freedom=freedoms,
        prior_cost=float(
            (c.errors**2).sum() + (trusted_rows(c, base.subspace.basis[: c.model.base_count])[1] ** 2).sum()
        ),
        standardized=np.sqrt(distance),
        rejected=_rejections(c, base, distance, None if c.used.all() else c.residual),
        start=ExtendedModel(
            base.start.parameters, c.model.effects, ExtendedModel.at_start(c.parameters, c.model.effects).effect_values
        ),
        termination=Termination.CONVERGED,
    )
    level = np.zeros(0)
    if c.random is not None:
        stated = np.isfinite([c.random.stated_size(column) for column in c.random.columns])
        common = np.exp(solved.logs[-1]) if c.cell.uncertainty.effects.sizes is SizeMode.ESTIMATED else 1.0
        level = np.where(stated, 1.0, _random_sizes(moved) * common / c.random.size)
    typical, is_free = _random_sizes(moved) / _random_sizes(c), _of_random(moved, solved.group) >= 0
    return MixedModel(c, level, typical, is_free, step.deviance, step.rejected, solved)


def _known(c: Calibration, solved: _Solved) -> Prior | None:
    """The prior of the values of the effects."""
    places = _effect_places(c)
    if not len(places):
        return None
    names = c.model.names
    units = [p.unit for effect in c.model.effects for p in effect.parameters]
    std = solved.tau[len(c.errors) :][: len(places)]
    sources = tuple(
        Source(f'size[{names[k].rpartition(".")[0]}]', float(s), units[k - c.model.base_count])
        for k, s in zip(places.tolist(), std.tolist(), strict=True)
    )
    mean = c.model.as_array() - amplitudes(c)
    return Prior(sources, places, mean[places], std, 0)


def _rejections(c: Calibration, base: Calibration, distance: Floats, residual: Floats | None) -> tuple[Rejection, ...]:
    """The outliers of the model with residuals (n, 2), N, None where there is none; the touches left out before."""
    places = set(c.touches.index.tolist())
    left_out = [item for item in base.rejected if item.index not in places]
    off = np.zeros((0, 2)) if residual is None else residual[~c.used]
    outliers = outlier_rejections(c.touches.index[~c.used], off, distance[~c.used])
    return tuple(sorted((*left_out, *outliers), key=lambda item: item.index))
