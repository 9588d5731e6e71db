"""The result of a calibration, frozen, and how it follows from the end of the estimation.

With it what each source of uncertainty contributes to the covariance (GUM, 5.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.calibration.estimate import Estimation, covariance_of_fit
from scara_kinetostatic.calibration.fit_point import Point, base_force, force_error, force_residual, project
from scara_kinetostatic.calibration.identifiability import (
    Identifiability,
    advise,
    condition_number,
    determined_pairs,
    group_names,
    scales_of,
)
from scara_kinetostatic.calibration.noise import estimated_levels
from scara_kinetostatic.calibration.observations import (
    NO_ERRORS,
    DeclaredErrors,
    JointPrior,
    Observations,
    Prior,
    RandomEffects,
    known_beforehand,
    observe,
)
from scara_kinetostatic.calibration.solver import ActivePrior, Subspace, Termination
from scara_kinetostatic.model.arm import CalibratedArm, SensorErrors, UsedRange
from scara_kinetostatic.model.arrays import EVERY, Floats, Indices, Mask, read_only
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import UNITS, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet


class Estimate(NamedTuple):
    """A parameter and what the calibration says of it.

    Attributes:
        value: its estimate.
        std: its standard uncertainty; 0 where fixed, NaN where confounded.
        unit: SI, of `value`, `std` and `nominal`.
        status: ``estimated``, ``fixed`` or ``confounded``.
        nominal: where the estimation began.
    """

    value: float
    std: float
    unit: str
    status: str
    nominal: float

    @classmethod
    def of_effect(cls, value: float, std: float, unit: str, nominal: float) -> Estimate:
        """The estimate of a parameter of an effect: confounded where it has no standard uncertainty."""
        return cls(value, std, unit, 'confounded' if np.isnan(std) else 'estimated', nominal)


class Alternative(NamedTuple):
    """One of the sets of effects that may be gross, and the values if it is this one.

    Attributes:
        effects: their labels; none where no effect is gross.
        probability: of the set; those of all alternatives add up to 1.
        change: of all values of the model, the declared errors and the random effects from those of the calibration,
            (12 + k + m + r,), in the units of `Calibration.covariance_with_errors`.
        covariance: of these, (12 + k + m + r, 12 + k + m + r).
    """

    effects: tuple[str, ...]
    probability: float
    change: Floats
    covariance: Floats


_OF_TOUCHES = frozenset({'cell', 'touches', 'model', 'noise', 'errors', 'random', 'random_values'})
_OF_COVARIANCE = frozenset(
    {'cell', 'model', 'random', 'known', 'covariance_with_errors', 'chi_square', 'degrees_of_freedom'}
)
_FOLLOWS_FROM = {'projection': _OF_TOUCHES, '_by_fit': _OF_COVARIANCE, 'declared': frozenset({'cell'})}
"""The fields on which what takes long to work out depends."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """The calibrated model with its uncertainty, and the residual of every touch. Its arrays are read-only.

    Parameters are reached by name: ``calibration['l1'].value``, those of effects alike:
    ``calibration.effects['object_position[disc_2]']['x'].std``.

    Attributes:
        cell: the cell it is about.
        fixed: parameters that were held at a given value.
        subspace: the changes of the model that the fit could make: without what is fixed or unidentifiable.
        start: the model where the fit began: nominal values, fixed parameters at theirs, effects at their start values.
        model: the calibrated model.
        covariance_with_errors: of all values of the model, the declared errors and the random effects,
            (12 + k + m + r, 12 + k + m + r); the errors in units of their standard uncertainties.
        errors: estimates of the declared errors of the cell, in units of their standard uncertainties, (m,).
        random: the random effects, at all touches; None for none.
        random_values: estimates of these in units of their sizes, (r,).
        known: what is known beforehand of the values of effects, or by an earlier calibration; None for nothing.
        alternatives: the sets of effects of which it is the mean; empty where it is no mean.
        place_stds: standard deviations of places of effects on their grids, by name, larger than those by `covariance`.
        added: what is in `covariance` besides what follows from the fit.
        near: the touches adjusted to a model close by, where `projection` begins; None to begin as measured.
        touches: all touches that were not left out, used or not.
        used: which took part in the fit, (n,).
        rejected: the others, with the reason.
        noise: of one touch.
        standardized: studentised distance of each touch from the model, (n,).
        prior_cost: sum of squares of the declared errors and of trusted nominal values, in standard uncertainties.
        chi_square: sum of squared distances of the used touches, and `prior_cost`.
        degrees_of_freedom: two per used touch, and one per trusted nominal value, less the number of identifiable
            directions.
        identifiability: what the data determine and what not.
        iterations: solver steps, all stages together.
        termination: how the last stage ended.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> calibration = sk.calibrate(sk.simulate(cell, {'l1': 0.3302}), cell)
        >>> calibration['l1'].nominal, calibration['l1'].status
        (0.33, 'estimated')
        >>> calibration.residual.shape, calibration.covariance.shape
        ((72, 2), (12, 12))
    """

    cell: Cell
    fixed: Mapping[str, float]
    subspace: Subspace
    start: ExtendedModel
    model: ExtendedModel
    covariance_with_errors: Floats
    errors: Floats
    touches: TouchSet
    used: Mask
    rejected: tuple[Rejection, ...]
    noise: Noise
    standardized: Floats
    prior_cost: float
    chi_square: float
    degrees_of_freedom: int
    identifiability: Identifiability
    iterations: int
    termination: Termination
    random: RandomEffects | None = None
    random_values: Floats = field(default_factory=lambda: NO_ERRORS)
    known: Prior | JointPrior | None = None
    alternatives: tuple[Alternative, ...] = ()
    place_stds: Mapping[str, float] = field(default_factory=dict)
    added: tuple[Contribution, ...] = ()
    near: Point | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ('covariance_with_errors', 'random_values', 'errors', 'used', 'standardized'):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def changed(self, point: Point | None = None, **changes: Any) -> Calibration:
        """The calibration with other values of some fields.

        What has been worked out is kept where these do not alter it. The projection is `point`, where that is given;
        else a new one of the same touches begins at the one before.
        """
        is_near = 'projection' in vars(self) and not changes.keys() & {'cell', 'touches'}
        other = replace(self, near=self.projection if is_near else None, **changes)
        kept = {name for name, fields in _FOLLOWS_FROM.items() if not changes.keys() & fields}
        vars(other).update((name, known) for name, known in vars(self).items() if name in kept)
        if point is not None:
            vars(other)['projection'] = point
        return other

    def __repr__(self) -> str:
        effects = ' '.join(effect.label for effect in self.model.effects) or 'none'
        return (
            f'<Calibration: {self.used.sum()} of {len(self.touches)} touches used, '
            f'reduced chi-square {self.reduced_chi_square:.3g}, effects: {effects}>'
        )

    def __getitem__(self, name: str) -> Estimate:
        """A parameter of the base model by name.

        Raises:
            KeyError: no such parameter.
        """
        if name not in (names := self.parameters.names):
            raise KeyError(f'no parameter {name!r}; the names are {" ".join(names)}')
        nominal = getattr(self.start.parameters, name)
        return Estimate(getattr(self.parameters, name), self.std_of(name), UNITS[name], self.status[name], nominal)

    @property
    def parameters(self) -> Parameters:
        """L̄."""
        return self.model.parameters

    @cached_property
    def _by_fit(self) -> tuple[Contribution, ...]:
        """What noise and each source contribute to the covariance by the fit.

        With C the covariance of the fit and P the rows of the prior, the estimate moves by -C P_sᵀ e_s with the true
        errors e_s of a source, so that this contributes C P_sᵀ P_s C, and noise the rest.
        """
        prior = known_beforehand(self.declared, self.random, self.known)
        (kept, scale), parts = of_full_model(self), list[Contribution]()
        if prior is not None:
            moved = scale[:, None] * (self.covariance_with_errors[kept] @ prior.rows(len(self.model.names)).T)
            for source, where in prior.by_source():
                part = moved[:, where] @ moved[:, where].T / self.enlargement
                std = source.std if np.isfinite(source.std) and not source.label.startswith('size[') else None
                parts.append(Contribution(source.label, std, source.unit if std else '', part))
        total = scale[:, None] * self.covariance_with_errors[np.ix_(kept, kept)] * scale
        noise = total - np.sum([part.covariance for part in parts], axis=0) if parts else total
        return (Contribution('noise', None, '', noise), *parts)

    @property
    def contributions(self) -> tuple[Contribution, ...]:
        """What each source contributes to `covariance`, type A and type B; they add up to it."""
        return (*self._by_fit, *self.added)

    @cached_property
    def covariance(self) -> Floats:
        """Of all values of `full_model`, (12 + k + u, 12 + k + u), in their units and in the order of its names; zero
        rows where fixed, not meaningful where confounded.
        """
        return read_only(np.sum([part.covariance for part in self.contributions], axis=0))

    @cached_property
    def _stds(self) -> Floats:
        """Standard uncertainties of all values of the model, (12 + k,)."""
        confounded = {name for group in self.identifiability.confounded for name in group}
        stds = np.sqrt(np.clip(np.diag(self.covariance)[: len(self.model.names)], 0.0, None))
        stds = np.fmax(stds, [self.place_stds.get(name, 0.0) for name in self.model.names])
        return read_only(np.where([name in confounded for name in self.model.names], np.nan, stds))

    @property
    def std(self) -> Floats:
        """Standard uncertainties of L̄, (12,): 0 where fixed, NaN where confounded."""
        return self._stds[: self.model.base_count]

    @property
    def effect_std(self) -> Floats:
        """The same of the effects' parameters, (k,)."""
        return self._stds[self.model.base_count :]

    @property
    def noise_source(self) -> str:
        """``given``, or ``estimated`` where any part of the noise is."""
        return 'estimated' if estimated_levels(self.noise, self.cell.noise) else 'given'

    @cached_property
    def force(self) -> Floats:
        """Measured force on the object in the base frame, (n, 2), N."""
        return read_only(base_force(self.observe(), self.model))

    @property
    def base_rank(self) -> int:
        """How many parameters of the base model, or of their combinations, the data determine.

        Each confounded group is one unidentifiable direction; groups of effects' parameters alone do not count.
        """
        free = sum(status != 'fixed' for status in self.status.values())
        return free - sum(bool(set(group) & set(self.parameters.names)) for group in self.identifiability.confounded)

    @property
    def has_undetected(self) -> bool:
        """Whether the fit has random effects for what was not detected."""
        return self.random is not None

    @cached_property
    def full_model(self) -> ExtendedModel:
        """The model with those random effects that move the robot."""
        if self.random is None:
            return self.model
        extended = self.model.with_effects((*self.model.effects, *self.random.effects(self.cell)))
        own = self.random.of_robot
        return extended.with_array([*self.model.as_array(), *(self.random.size * self.random_values)[:own]])

    @cached_property
    def declared(self) -> DeclaredErrors | None:
        """The declared errors of the cell; None where everything counts as exactly known."""
        return DeclaredErrors.of(self.cell)

    def observe(self, which: Any = EVERY) -> Observations:
        """Some of the touches, by a mask or positions, as the fit took them."""
        errors = self.errors if self.random is None else np.concatenate([self.errors, self.random_values])
        if which is EVERY:
            return observe(self.touches, self.cell, errors, self.random, self.known, self.declared)
        random = None if self.random is None else self.random.select(which)
        return observe(self.touches.select(which), self.cell, errors, random, self.known, self.declared)

    @property
    def status(self) -> dict[str, str]:
        """Of each parameter of L̄ by name: ``estimated``, ``fixed`` or ``confounded``."""
        stds = zip(self.parameters.names, self.std, strict=True)
        return {n: 'fixed' if n in self.fixed else 'confounded' if np.isnan(std) else 'estimated' for n, std in stds}

    @property
    def effects(self) -> dict[str, dict[str, Estimate]]:
        """The parameters of the effects by label and name."""
        found: dict[str, dict[str, Estimate]] = {}
        columns = self.model.effect_values, self.effect_stds, self.start.effect_values
        for effect, *rows in zip(self.model.effects, *columns, strict=True):
            for p, value, std, start in zip(effect.parameters, *rows, strict=True):
                estimate = Estimate.of_effect(value, float(std), p.unit, start)
                if f'{effect.label}.{p.name}' in self.fixed or (p.is_alias and not std):
                    estimate = estimate._replace(status='fixed')
                found.setdefault(effect.label, {})[p.name] = estimate
        return found

    @property
    def held_effects(self) -> frozenset[str]:
        """Labels of the effects whose parameters are all held at given values."""
        return frozenset(
            effect.label
            for effect in self.model.effects
            if effect.parameters
            and all(p.is_alias or f'{effect.label}.{p.name}' in self.fixed for p in effect.parameters)
        )

    @property
    def trusted(self) -> int:
        """How many nominal values are trusted (`Cell.uncertainty.nominal`) and free."""
        return sum(name not in self.fixed for name in self.cell.uncertainty.nominal)

    @property
    def std_noise(self) -> Floats:
        """The part of `std` that noise contributes, (12,): standard uncertainty if all that is declared were exact."""
        return np.asarray(np.sqrt(np.clip(np.diag(self.contributions[0].covariance)[: len(self.std)], 0.0, None)))

    @property
    def effect_stds(self) -> list[Floats]:
        """`effect_std` as one array per effect."""
        return self.model.split(self.effect_std)

    @cached_property
    def residual(self) -> Floats:
        """F - A(Q, L̄), (n, 2), N."""
        return read_only(force_residual(self.observe(), self.model))

    @cached_property
    def nominal_residual(self) -> Floats:
        """F - A(Q, L̄n), (n, 2), N."""
        return read_only(force_residual(observe(self.touches, self.cell), self.start))

    @cached_property
    def projection(self) -> Point:
        """All touches, outliers too, adjusted to the model with the noise of the fit; begun at a fit close by."""
        return project(self.observe(), self.model, self.noise, self.near)

    @cached_property
    def undetermined(self) -> Floats:
        """Directions of the values that the fit kept where they were, each by its plausible range, one a column."""
        scales = scales_of(self.model)
        held = self.model.held.union(self.model.aliases, self.fixed)
        free = np.array([name not in held for name in self.model.names])
        basis = (self.subspace.basis / scales[:, None])[free]
        u, singular, _ = np.linalg.svd(basis, full_matrices=True)
        rank = int(np.sum(singular > 1e-9 * singular.max(initial=0.0)))  # in plausible ranges of the parameters
        found = np.zeros((len(self.full_model.names), u.shape[0] - rank))
        found[np.flatnonzero(free)] = scales[free, None] * u[:, rank:]
        return read_only(found)

    @property
    def arm(self) -> CalibratedArm:
        """What is needed of it to use it."""
        touches, magnitude = self.touches.select(self.used), np.hypot(*self.force[self.used].T)
        postures = tuple(sign for sign in (1, -1) if np.any(touches.posture == sign))
        used = UsedRange(float(magnitude.min()), float(magnitude.max()), float(np.ptp(touches.time)), postures)
        sensor = SensorErrors() if self.declared is None else SensorErrors(*self.declared.sensor(self.errors))
        covariance = np.array(self.covariance)
        return CalibratedArm(self.cell, self.full_model, covariance, self.undetermined, self.noise, sensor, used)

    @property
    def force_error(self) -> float:
        """e_f (10) over the used touches, N."""
        return force_error(self.residual[self.used])

    @property
    def is_near(self) -> bool:
        """Whether the force error is at most half of the force."""
        return self.force_error <= 0.5 * float(np.hypot(self.force[:, 0], self.force[:, 1]).mean())

    @property
    def is_result(self) -> bool:
        """Whether the fit converged, to a model that is near."""
        return self.termination is Termination.CONVERGED and self.is_near

    @property
    def reduced_chi_square(self) -> float:
        """Chi-square per degree of freedom; its expectation is 1 if model and noise are right."""
        return self.chi_square / self.degrees_of_freedom

    @property
    def p_value(self) -> float:
        """Probability of a chi-square this large or larger if model and noise are right."""
        return float(chdtrc(self.degrees_of_freedom, self.chi_square))

    @property
    def enlargement(self) -> float:
        """By what the covariance was enlarged because the stated noise does not cover the residuals; 1 if not."""
        return enlargement_of(self.chi_square, self.degrees_of_freedom)

    def std_of(self, name: str) -> float:
        """Standard uncertainty of a parameter of the base model by name, in its unit."""
        return float(self.std[self.parameters.names.index(name)])


def build_result(
    touches: TouchSet,
    cell: Cell,
    start: ExtendedModel,
    fixed: Mapping[str, float],
    found: Estimation,
    left_out: Sequence[Rejection],
) -> Calibration:
    """The result of an estimation.

    Args:
        touches: all touches of the fit.
        cell: the cell.
        start: the model where the fit began.
        fixed: parameters held, by name.
        found: the estimation.
        left_out: touches that the fit left out.
    """
    fit, used, observations = found.fit, found.used, found.observations
    model, everything = fit.point.model, covariance_of_fit(fit, found.subspace)
    prior = ActivePrior.of(observations, found.subspace)
    chi_square = float(fit.point.distance[used].sum()) + fit.prior_cost
    freedoms = 2 * int(used.sum()) - found.subspace.basis.shape[1]
    if prior is not None:
        freedoms += int(prior.active.sum()) - prior.prior.errors
    everything = enlargement_of(chi_square, freedoms) * everything
    covariance = everything[: len(model.names), : len(model.names)]
    changes = fit.point.whitened.derivative[used] @ found.subspace.basis
    if isinstance(observations.known, JointPrior):
        rows = observations.known.rows(len(model.names))[:, : len(model.names)] @ found.subspace.basis
        changes = np.concatenate([changes.reshape(-1, rows.shape[1]), rows])
    mean_force = float(np.hypot(observations.force[:, 0], observations.force[:, 1]).mean())
    held, values = model.held.union(model.aliases, fixed), model.as_array()
    free = np.array([j for j, name in enumerate(model.names) if name not in held], dtype=np.intp)
    groups = group_names(found.unidentifiable, free, model, np.sqrt(np.diag(covariance)))
    identifiability = Identifiability(
        rank=len(free) - found.unidentifiable.shape[1],
        condition=condition_number(changes),
        confounded=groups,
        combinations=determined_pairs(found.unidentifiable, free, values, covariance),
        advice=advise(groups, mean_force),
    )
    return Calibration(
        cell=cell,
        fixed=dict(fixed),
        subspace=found.subspace,
        start=start,
        model=model,
        covariance_with_errors=everything,
        errors=fit.point.errors,
        touches=touches,
        used=used,
        rejected=_rejections(touches, found, left_out),
        noise=found.noise,
        standardized=np.sqrt(found.distance),
        prior_cost=fit.prior_cost,
        chi_square=chi_square,
        degrees_of_freedom=freedoms,
        identifiability=identifiability,
        iterations=found.iterations,
        termination=fit.termination,
        known=observations.known,
        near=fit.point,
    )


def _rejections(touches: TouchSet, found: Estimation, left_out: Sequence[Rejection]) -> tuple[Rejection, ...]:
    """The outliers and the touches left out, in the order of their numbers."""
    bad = np.flatnonzero(~found.used)
    off = force_residual(found.observations.select(bad), found.fit.point.model) if len(bad) else np.zeros((0, 2))
    outliers = outlier_rejections(touches.index[bad], off, found.distance[bad])
    return tuple(sorted((*left_out, *outliers), key=lambda item: item.index))


def outlier_rejections(index: Indices, off: Floats, distance: Floats) -> list[Rejection]:
    """The reasons of outliers, by their numbers (n,), errors of the force (n, 2), N, and squared distances (n,)."""
    what = 'disagrees with the other touches: its force is'
    return [
        Rejection(number, f'{what} {size:.2g} N off, {std:.1f} standard deviations')
        for number, size, std in zip(index.tolist(), np.hypot(*off.T), np.sqrt(distance), strict=True)
    ]


class Contribution(NamedTuple):
    """What one source of uncertainty contributes to the covariance of a fit (GUM, 5.2 and annex H).

    Attributes:
        label: ``noise`` (type A), that of a declared source (type B), such as ``object_position[disc_1]``,
            ``undetected[name]`` of effects, ``rivals``, or ``value[name]`` of a friction or moment.
        declared: its declared standard uncertainty; None for noise.
        unit: of `declared`.
        covariance: its part of the covariance of all values, of the shape of `Calibration.covariance`.
    """

    label: str
    declared: float | None
    unit: str
    covariance: Floats


def enlargement_of(chi_square: float, freedoms: int) -> float:
    """By what a covariance is enlarged: where the stated noise does not cover the residuals, reduced chi-square."""
    return chi_square / freedoms if chdtrc(freedoms, chi_square) < 1e-3 else 1.0


def of_full_model(c: Calibration) -> tuple[Indices, Floats]:
    """Which of the values, errors and random effects of `covariance_with_errors` are those of `full_model`, and their
    units, (12 + k + u,) each.
    """
    values, m = len(c.model.names), len(c.errors)
    own, size = (0, np.zeros(0)) if c.random is None else (c.random.of_robot, c.random.size)
    kept = np.concatenate([np.arange(values), values + m + np.arange(own)])
    return kept, np.concatenate([np.ones(values), size[:own]])
