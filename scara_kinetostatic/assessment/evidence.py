"""What an assessment is made from: conformity with the tolerance, leverage and rejection of touches, mistakes.

The tolerance is the largest expanded uncertainty U = 2 u that the use allows. U is itself estimated where the noise is:
with the part u_A of noise from ν degrees of freedom and the rest u_B, the one-sided limits of 95 % of U are

    U± = 2 √(u_A² ν / χ²_ν(0.05 or 0.95) + u_B²),

and U - U-, U+ - U the guard bands. As ISO 14253-1 has it, conformity is shown where U+ is at most the tolerance, the
contrary where U- is beyond it; between, neither is shown. Where the noise is stated, and covers the residuals, both
guard bands are zero.

The block of a used touch on the diagonal of the hat matrix is H_k = J_k Σ J_kᵀ, (2, 2), with J_k its whitened Jacobian
and Σ the covariance of the fit, everything estimated along with the parameters included. Of an error of the touch in
the direction of an eigenvector with eigenvalue λ, the residual shows the part 1 - λ, the parameters absorb the rest.
With λ = 1 the touch is fitted whatever it measured: nothing checks it, and without it a parameter has no value.

Rejected touches are scattered by chance, or concentrated in one object, recording or span of time.
Given that K of N touches are rejected, and that each is as likely as any other, k or more of the n touches of a group
are among them with the hypergeometric probability P(X ≥ k). Over the groups of one kind, and over the kinds, the
probabilities are corrected by Bonferroni's inequality.

A span of time has no given place. It begins with a rejected touch; the m touches that follow hold k - 1 or more of the
other K - 1 rejected ones, of the other N - 1 touches, with the hypergeometric probability as well (a scan statistic
that begins at an event; J. Glaz, J. Naus, S. Wallenstein, Scan Statistics, 2001). It is corrected over all pairs of a
first and a last rejected touch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from scara_kinetostatic.assessment.mistakes import Check, Mistake
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.held_out import HeldOut
from scara_kinetostatic.calibration.joint_covariance import UndetectedErrors
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, TipUncertainty, tip_uncertainty
from scara_kinetostatic.calibration.uncertainty_budget import (
    Assumed,
    Item,
    assumed_places,
    title_of,
    uncertainty_budget,
)
from scara_kinetostatic.diagnosis.comparison import Comparison, compare, objects_left_out
from scara_kinetostatic.diagnosis.odds import UNNAMED
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.diagnosis.search import FOUND
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import leverage, orthonormal
from scara_kinetostatic.model.arm import UsedRange
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.threads import one_thread

_CONFIDENCE = 0.95
"""Of each guard band, one-sided: the usual one (ISO 14253-1)."""


_GRAVITY = 9.81
"""m/s²."""


class Decision(str, Enum):
    """What is decided about a tolerance."""

    CONFORMS = 'conforms'
    UNDECIDED = 'cannot be decided'
    DOES_NOT_CONFORM = 'does not conform'


class Conformity(NamedTuple):
    """The worst expanded uncertainty of the tip against a tolerance.

    Attributes:
        decision: about the whole workspace.
        low: the lower limit of U where it is largest, m.
        high: its upper limit, m.
        share: part of the workspace where U is at most the tolerance, 0 to 1.
        touched: the decision where the joint angles are between those of the touches; None where no place is.
    """

    decision: Decision
    low: float
    high: float
    share: float
    touched: Decision | None


def conformity(c: Calibration, tip: TipUncertainty) -> Conformity | None:
    """Compare with the tolerance of the cell.

    Args:
        c: the calibration.
        tip: its uncertainty of the tip.

    Returns:
        The comparison; None where the cell states no tolerance, or the uncertainty is not determined.
    """
    tolerance = c.cell.tolerance
    if tolerance is None or tip.at is None or not np.isfinite(tip.worst):
        return None
    u = tip.worst / COVERAGE_FACTOR
    noise = min(float(tip.at.gradient @ c.contributions[0].covariance @ tip.at.gradient), u**2)
    freedoms = c.degrees_of_freedom if c.noise_source == 'estimated' or c.enlargement > 1 else np.inf
    low, high = (_limit(u, noise, freedoms, part) for part in (_CONFIDENCE, 1 - _CONFIDENCE))
    values = np.concatenate([each.expanded.ravel() for each in tip.maps])
    values = values[np.isfinite(values)]
    parts = low / u / COVERAGE_FACTOR, high / u / COVERAGE_FACTOR
    between, decision = tip.worst_touched, _decide(low, high, tolerance)
    if tip.undetermined > 0 and decision is Decision.CONFORMS:
        decision = Decision.UNDECIDED
    share = float(np.mean(values <= tolerance)) * (1 - tip.undetermined)
    touched = _decide(parts[0] * between, parts[1] * between, tolerance) if np.isfinite(between) else None
    return Conformity(decision, low, high, share, touched)


def _limit(u: float, noise: float, freedoms: float, part: float) -> float:
    """A limit of U: the noise part has the size that would be exceeded with a probability of `part`."""
    factor = 1.0 if np.isinf(freedoms) else freedoms / float(special.chdtri(freedoms, 1 - part))
    return COVERAGE_FACTOR * float(np.sqrt(max(u**2 - noise, 0.0) + noise * factor))


def _decide(low: float, high: float, tolerance: float) -> Decision:
    if high <= tolerance:
        return Decision.CONFORMS
    return Decision.DOES_NOT_CONFORM if low > tolerance else Decision.UNDECIDED


def leverages(calibration: Calibration) -> Floats:
    """The largest eigenvalue of each used touch's block of the hat matrix, 0 to 1, (n,).

    What the cell description declares is estimated along, with rows of its own: they count in Σ, but are no touches.
    """
    c = calibration
    observations = c.observe(c.used)
    point = project(observations, c.model, c.noise)
    n, basis = len(point.distance), c.subspace.with_errors(len(observations.errors))
    rows = point.whitened.jacobian.reshape(2 * n, -1) @ basis
    prior = ActivePrior.of(observations, c.subspace)
    if prior is not None:
        rows = np.concatenate([rows, prior.rows @ basis])
    return read_only(np.clip(leverage(orthonormal(rows)[: 2 * n].reshape(n, 2, -1)), 0.0, 1.0))


class Group(NamedTuple):
    """Touches that have something in common.

    Attributes:
        kind: ``object``, ``recording`` or ``span``.
        label: index of the object or recording; of a span 0.
        members: which touches belong to it, (n,).
        rejected: how many of them are rejected.
        p_value: probability by chance of as many, corrected for the search.
    """

    kind: str
    label: int
    members: Mask
    rejected: int
    p_value: float


def concentrations(rejected: Mask, labels: dict[str, Indices]) -> list[Group]:
    """The groups of touches with the probability that so many of them are rejected by chance, the least first.

    Args:
        rejected: which touches are rejected, in the order of time, (n,).
        labels: the kinds of groups: an index of each touch by the name of the kind, (n,) each.
    """
    if rejected.sum() < 2:
        return []
    found = [_span(rejected)]
    for kind, label in labels.items():
        values = np.unique(label)
        for value in values.tolist() if len(values) > 1 else ():
            members = label == value
            number = int((members & rejected).sum())
            p_value = hypergeometric_tail(number, len(rejected), int(members.sum()), int(rejected.sum()))
            found.append(Group(kind, value, members, number, len(values) * float(p_value)))
    kinds = len(labels) + 1
    corrected = [group._replace(p_value=min(1.0, kinds * min(1.0, group.p_value))) for group in found]
    return sorted(corrected, key=lambda group: group.p_value)


def _span(rejected: Mask, most: int = 200) -> Group:
    """The least probable span; it holds at most so many rejected touches."""
    places = np.flatnonzero(rejected)
    first, last = np.triu_indices(len(places), 1)
    near = last - first <= most
    first, last = first[near], last[near]
    width, number = places[last] - places[first], last - first
    p_values = hypergeometric_tail(number, len(rejected) - 1, width, len(places) - 1)
    best = int(np.argmin(p_values))
    members = np.zeros_like(rejected)
    members[places[first[best]] : places[last[best]] + 1] = True
    return Group('span', 0, members, int(number[best]) + 1, len(first) * float(p_values[best]))


def hypergeometric_tail(least: ArrayLike, total: int, drawn: ArrayLike, marked: int) -> Floats:
    """P(X ≥ least) of the number X of marked ones among those drawn from all without replacement, or slightly more.

    Beyond the mean the terms of the sum fall faster than a geometric series with the ratio of the first two, whose sum
    is returned; where they do not fall, 1.

    Args:
        least: k, at most n and K.
        total: N.
        drawn: n.
        marked: K.
    """
    k, n = np.asarray(least, dtype=float), np.asarray(drawn, dtype=float)
    rest = np.maximum(total - marked - n + k, 0.0)
    first = np.exp(_log_choose(marked, k) + _log_choose(total - marked, n - k) - _log_choose(total, n))
    ratio = (marked - k) * (n - k) / ((k + 1) * (rest + 1))
    tail = np.where(ratio < 1, first / np.maximum(1 - ratio, 1e-300), 1.0)
    return np.asarray(np.where(k <= 0, 1.0, np.minimum(tail, 1.0)))


def _log_choose(total: ArrayLike, drawn: ArrayLike) -> Floats:
    """Logarithm of a binomial coefficient."""
    total, drawn = np.asarray(total, dtype=float), np.asarray(drawn, dtype=float)
    return np.asarray(special.gammaln(total + 1) - special.gammaln(drawn + 1) - special.gammaln(total - drawn + 1))


class Discrimination(NamedTuple):
    """What decides between the sets of effects that may be gross.

    Attributes:
        odds: the sets, as labels, with their probabilities.
        touches: those that decide most, in words.
        now: probability of the likeliest set.
        expected: the same after these touches, on average.
        many: a large number of touches.
        limit: the same after so many, evenly distributed.
        remedies: what would decide where touches do not, in the imperative.
    """

    odds: tuple[tuple[tuple[str, ...], float], ...]
    touches: tuple[str, ...]
    now: float
    expected: float
    many: int
    limit: float
    remedies: tuple[str, ...]

    @property
    def is_decisive(self) -> bool:
        """Whether touches are worth making: these take away half of the doubt, or a few percent, and many decide."""
        return self.limit >= FOUND and self.expected >= worth_doing(self.now)

    @property
    def forecast(self) -> str:
        """``12 touches: 97 → 99.9 %``."""
        return f'{len(self.touches)} touches: {percent(self.now)} → {percent(self.expected)} %'

    @property
    def causes(self) -> str:
        """The sets with their probabilities: ``place of disc_2 (93 %) or place of disc_1 (7 %)``."""
        names = {UNNAMED: 'something else'}
        return likely(
            (' and '.join(names.get(label) or title_of(label) for label in labels) or 'no gross error', probability)
            for labels, probability in self.odds
            if probability >= NAMED
        )

    @property
    def limits(self) -> str:
        """That touches do not decide, and where they end."""
        return f'touches hardly decide: {self.forecast}, {self.many} end at {percent(self.limit)} %'

    @property
    def remedy(self) -> str:
        """What decides where touches do not, in the imperative."""
        return '; or '.join(self.remedies) or 'change the cell: no single measurement of it decides either'

    @property
    def action(self) -> str:
        """What to do."""
        if self.is_decisive:
            return f'to tell the causes apart, make the touches of `next --goal decide`: {self.forecast}'
        return f'to tell the causes apart, {self.remedy}; {self.limits}'


_WORTH = 0.03
"""Gain in the probability of the likeliest set for which something is worth doing."""


def worth_doing(now: float) -> float:
    """The probability of the likeliest set afterwards from which on something is worth doing: it takes away half of the
    doubt, or `_WORTH`.
    """
    return min(now + _WORTH, (1 + now) / 2)


NAMED = 0.005
"""Probability from which on a set is named."""


def percent(probability: float) -> str:
    """A probability in percent, not rounded to certainty."""
    if probability < NAMED:
        return 'below 1'
    return f'{100 * probability:.0f}' if probability < 0.985 else f'{min(100 * probability, 99.9):.1f}'


def likely(alternatives: Iterable[tuple[str, float]]) -> str:
    """Alternatives with their probabilities: ``place of disc_2 (93 %) or place of disc_1 (7 %)``."""
    return ' or '.join(f'{what} ({percent(probability)} %)' for what, probability in alternatives)


class Earlier(NamedTuple):
    """The calibration that was the prior of another one.

    Attributes:
        path: of its file.
        sha256: of that.
        freed: names of the values of the model that may have changed since.
        p_value: of the touches agreeing with it.
        grade: of it.
        used: what its touches cover.
        detectable: the smallest slip of the zero of a joint that the touches would have shown, rad, by parameter
            (`SLIP_SHOWN`); infinite where none, and without those that are freed.
        contradiction: what the touches say against it, one clause; empty where they agree.
        causes: what may have changed, as in `verification.json`.
        recordings: SHA-256 of the recordings that it, and those before it, were calculated from.
        undetected: by how much undetected effects of objects and sensor had moved its estimates.
        differing: recordings that contain another cell description, one sentence each.
    """

    path: str
    sha256: str
    freed: tuple[str, ...]
    p_value: float
    grade: str
    used: UsedRange
    detectable: Mapping[str, float]
    contradiction: str = ''
    causes: Mapping[str, Any] = MappingProxyType({})
    recordings: tuple[str, ...] = ()
    undetected: UndetectedErrors = UndetectedErrors()
    differing: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Evidence:
    """A calibration with all that speaks for or against its use; what follows is worked out once, when first read.

    Attributes:
        calibration: the base model with its uncertainty.
        held_out: force error of that model on touches not used in the fit.
        diagnosis: whether the model is complete, and what is missing.
        extended_held_out: as `held_out`, of the model extended by what was found; the same where nothing was.
        found: touches in the recordings, rejected ones included.
        rejected: all that were not used, by index: by the detection and by the fit.
        first_touches: number of the first touch of each recording.
        sequence_known: whether the order in time of the recordings is known.
        check: what the touches said of the cell before the fit; None where they were not asked.
        discriminate: works out what decides between sets of effects; None where nobody can.
        earlier: the calibration that was the prior; None for none.
    """

    calibration: Calibration
    held_out: HeldOut
    diagnosis: Diagnosis
    extended_held_out: HeldOut
    found: int
    rejected: tuple[Rejection, ...]
    first_touches: tuple[int, ...] = (0,)
    sequence_known: bool = True
    check: Check | None = None
    discriminate: Callable[[Evidence], Discrimination | None] | None = None
    earlier: Earlier | None = None

    @cached_property
    @one_thread
    def discrimination(self) -> Discrimination | None:
        """What decides between the sets of effects that may be gross; None where there are no two."""
        return None if self.discriminate is None else self.discriminate(self)

    @property
    def final(self) -> Calibration:
        """The calibration to use: extended by what was found, where something was."""
        return self.diagnosis.extended or self.calibration

    @cached_property
    @one_thread
    def comparison(self) -> Comparison:
        """The base model and the final one on the same touches: force error, error of the tip, bias of parameters."""
        held_out = self.held_out.force_error, self.extended_held_out.force_error
        return compare(self.calibration, self.final, *held_out)

    @cached_property
    @one_thread
    def leverages(self) -> Floats:
        """Of the used touches, (n,)."""
        return leverages(self.final)

    @cached_property
    @one_thread
    def tip_uncertainty(self) -> TipUncertainty:
        """Expanded uncertainty of the tip over the workspace."""
        return tip_uncertainty(self.final)

    @cached_property
    @one_thread
    def assumed(self) -> Assumed | None:
        """What was assumed of the places of objects; None where they are declared, and in an update."""
        return None if self.earlier else assumed_places(self.final)

    @cached_property
    @one_thread
    def object_left_out(self) -> float:
        """Error of the tip at objects left out of the fit, over what is stated; NaN where that is not determined."""
        found = objects_left_out(self.final)
        return found.error / found.stated

    @cached_property
    @one_thread
    def budget(self) -> tuple[Item, ...]:
        """What each source of uncertainty contributes to the final model's parameters and to the tip."""
        return uncertainty_budget(self.final, self.tip_uncertainty)

    @cached_property
    def conformity(self) -> Conformity | None:
        """The tip's uncertainty against the tolerance; None where there is none, or it is not determined."""
        return conformity(self.final, self.tip_uncertainty)

    @cached_property
    @one_thread
    def upright(self) -> dict[str, Calibration]:
        """The base model's fit with gravity along an axis that may be the vertical one, where there is one."""
        found = dict[str, Calibration]()
        for axis, gravity in (('y', (0.0, -_GRAVITY)), ('x', (-_GRAVITY, 0.0))):
            cell = replace(self.final.cell, nominal=self.final.cell.nominal.replace(gravity=gravity))
            with suppress(ParameterError, UnsupportedDataError):
                if (fitted := calibrate(self.final.touches, cell)).is_result:
                    found[axis] = fitted
        return found

    @property
    def conforms(self) -> bool:
        """Whether the tolerance is kept."""
        return self.conformity is not None and self.conformity.decision is Decision.CONFORMS

    @cached_property
    def mistake(self) -> Mistake | None:
        """A mistake in the cell description or in the touches that explains what is odd."""
        return None if self.check is None else self.check.mistake(self.final)
