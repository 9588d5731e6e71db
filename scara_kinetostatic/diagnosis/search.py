"""Search for missing effects: weigh all sets of effects at the latest fit, fit the likeliest one, weigh again, until it
stays.

Which sets there are, up to three effects, and how likely each is in the linear problem at a fit, says
`odds.posterior_odds`: every effect of the catalogue has a small part there by the size that the errors of this robot
have as a whole. So a set is likely only where it explains what errors of that size do not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.noise import USUAL_NOISE
from scara_kinetostatic.calibration.outliers import find_good
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.candidates import Candidate, start_from
from scara_kinetostatic.diagnosis.lack_of_fit import fit_again, growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    FRICTION_SIGNIFICANCE,
    SIGNIFICANCE,
    STRICT_SIGNIFICANCE,
    fitted_effects,
)
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, fit_mixed
from scara_kinetostatic.diagnosis.odds import NUMBER, UNNAMED
from scara_kinetostatic.diagnosis.result import EffectSet
from scara_kinetostatic.diagnosis.weighing import LEAST, Weighed, is_placed, weigh
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G2, P_EE

FOUND = 0.95
"""Inclusion from which on an effect is found."""
POSSIBLE = 0.05
"""Probability of "no effect" below which the touches show that something is missing; part of the likeliest set's
probability from which on another one is its rival.
"""
_MOST_NAMED = 5
"""Effects of several likely sets that are fitted together at most."""
_BELOW_ZERO = 4.0
"""Standard deviations below zero at which a compliance or backlash is of no robot."""
_NO_FIT = np.linalg.LinAlgError, UnsupportedDataError, ParameterError
"""What a fit of named effects raises where there is none."""


class Search(NamedTuple):
    """The result of a search.

    Attributes:
        weighed: the sets of effects at the fit with the likeliest one.
        base: the fit without effects of the catalogue that it belongs to.
        without: the sets at the fits by which nothing may be missing, the likeliest first; empty where something is.
        angles: label of random off-normal angles, which `base` then has; empty for none.
        angles_odds: log odds of these beforehand.
        angles_probability: of these.
    """

    weighed: Weighed
    base: Calibration
    without: tuple[Weighed, ...] = ()
    angles: str = ''
    angles_odds: float = 0.0
    angles_probability: float = 1.0

    @property
    def fit(self) -> Calibration:
        """The calibration of the mixed model."""
        return self.weighed.model.fit

    @property
    def named(self) -> list[Effect]:
        """The effects of the fit that are named."""
        return [effect for effect, _ in fitted_effects(self.fit)][len(self.base.model.effects) :]

    @property
    def deviance(self) -> float:
        """-2 log likelihood with all sets, and prior of off-normal angles."""
        return self.weighed.deviance - 2 * self.angles_odds

    @property
    def probabilities(self) -> tuple[EffectSet, ...]:
        """Of all sets of effects of at least `LEAST`, the likeliest first; they add up to 1."""
        odds, angles = self.weighed.odds.probabilities, (self.angles,) if self.angles else ()
        sure = self.angles_probability
        sets = [EffectSet((*angles, *sorted(labels)), sure * p) for labels, p in odds.items() if p >= LEAST]
        sets += [EffectSet((), 1 - sure)] if 1 - sure >= LEAST else []
        total = sum(item.probability for item in sets)
        found = [item._replace(probability=item.probability / total) for item in sets]
        return tuple(sorted(found, key=lambda item: -item.probability))

    @property
    def inclusion(self) -> dict[str, float]:
        """The probability of each effect to be gross, by label, of at least `LEAST`."""
        found = {label: min(p, 1.0) for label, p in self.weighed.odds.inclusion.items() if p >= LEAST}
        return ({self.angles: self.angles_probability} if self.angles else {}) | found

    @property
    def none(self) -> float:
        """The probability that no effect is gross."""
        return 1 - self.angles_probability if self.angles else self.weighed.odds.none

    @property
    def sure(self) -> tuple[str, ...]:
        """Labels of the effects with an inclusion of `FOUND`; none where what is missing is rather outside the
        catalogue.
        """
        included = self.inclusion
        if included.get(UNNAMED, 0.0) >= 0.5:
            return ()
        return tuple(label for label, p in included.items() if p >= FOUND and label != UNNAMED)

    @property
    def found(self) -> tuple[str, ...]:
        """Those that are in the fit as well: the odds are to hold where it is."""
        named = {self.angles, *(effect.label for effect in self.named)}
        return tuple(label for label in self.sure if label in named)

    @property
    def is_explained(self) -> bool:
        """Whether the effects found may be all that is missing."""
        alone = sum(item.probability for item in self.probabilities if set(item.effects) <= set(self.found))
        return bool(self.found) and alone >= POSSIBLE

    @property
    def rivals(self) -> tuple[tuple[str, ...], ...]:
        """Groups of labels that replace each other, where the effects found do not explain the touches alone."""
        if self.is_explained:
            return ()
        sets = [(set(item.effects) - {*self.found, UNNAMED}, item.probability) for item in self.probabilities]
        likely = [labels for labels, p in sets if labels and p >= POSSIBLE * sets[0][1]] or [set[str]()]
        best, every = likely[0], dict.fromkeys(label for labels in likely for label in sorted(labels))
        groups = []
        for label in sorted(best):
            instead = {x for labels in likely if label not in labels for x in labels - best}
            groups.append((label, *(x for x in every if x in instead)))
        return tuple(dict.fromkeys(groups))

    @property
    def wanted(self) -> list[str]:
        """Labels of the effects to fit together: of those found or, where these do not explain the touches, of all
        possible causes.
        """
        named = [effect.label for effect in self.named]
        wanted = [label for label in (*self.sure, *chain(*self.rivals)) if label != self.angles]
        if not self.is_explained:
            wanted = [*wanted, *named]
        # a wave without an amplitude has no phase: rivals like it stay among what is not named, where they are linear
        has_phase = {
            item.effect.label
            for item in self.weighed.candidates.candidates
            if np.sum(item.effect.amplitudes(np.ones(len(item.effect.parameters))) == 0)
            > bool(item.effect.grid_parameter)
        }
        return [x for x in dict.fromkeys(wanted) if x in named or x not in has_phase][:_MOST_NAMED]


def identify(c: Calibration, known: Sequence[Effect], weighed: Weighed) -> Search:
    """The mixed model of a calibration with the likeliest set of effects.

    Args:
        c: the base model; effects that it has stay.
        known: the catalogue.
        weighed: the sets at the mixed model without names.
    """
    names, excluded, tried = frozenset[tuple[str, float]](), frozenset[str](), {frozenset[tuple[str, float]]()}
    visited, settled = list[Weighed](), list[Weighed]()
    for _ in range(6):  # most searches end after one or two rounds
        members = weighed.likeliest(excluded)
        wanted = _names(members)
        if wanted == names or not members:
            settled.append(weighed)
            if UNNAMED in excluded or all(member.effect.is_physical for member in members):
                break
            excluded |= {UNNAMED}  # where a curve is fitted, a set without may be likelier all the same
            continue
        if wanted in tried:  # each of several sets is the likeliest at the fit with another
            break
        tried.add(wanted)
        for base, some in _ways(c, weighed, members, names):
            with suppress(*_NO_FIT):
                model = fit_mixed(base, known, start_from(weighed.problem, some))
                if _predicts(model.fit, base):
                    break
        else:
            fewer = weighed.likeliest_of(members) if len(members) > 1 else members
            has_curve = not all(member.effect.is_physical for member in fewer)
            excluded |= {UNNAMED} if has_curve else {member.effect.label for member in fewer}
            continue
        wrong = {effect.label for effect, values in fitted_effects(model.fit) if not effect.is_plausible(values)}
        excluded |= wrong
        if not wrong:
            weighed, names = weigh(model, known), _names(some)
            visited.append(weighed)
    return Search(min(settled or visited or [weighed], key=lambda one: one.deviance), c)


def _ways(
    c: Calibration, weighed: Weighed, members: list[Candidate], names: frozenset[tuple[str, float]]
) -> Iterator[tuple[Calibration, list[Candidate]]]:
    """Touches and effects to fit, in turn until there is a fit: a set; its likeliest effect alone, as a set may be
    likely far from the truth and have no fit; that without outliers, with which it may have gone off.
    """
    yield c, members
    if len(members) > 1:
        members = weighed.likeliest_of(members)
        if _names(members) != names:
            yield c, members
    if not c.model.effects:
        good = find_good(c.changed(model=start_from(weighed.problem, members)).projection.distance)
        if (good != c.used).any():
            yield c.changed(used=good), members


def _predicts(fit: Calibration, base: Calibration) -> bool:
    """Whether a fit with effects predicts the forces as the base model does: the joint angles of a steep curve have no
    contact or another one, and so has a wrong arm. A curve must predict touches that it was not fitted to.
    """
    if fit.force_error > base.force_error + base.noise.force_rms:
        return False
    if all(effect.is_physical for effect, _ in fitted_effects(fit)):
        return True
    before = held_out_force_error(base.changed(used=fit.used)).force_error
    return held_out_force_error(fit).force_error <= before


def _names(members: Sequence[Candidate]) -> frozenset[tuple[str, float]]:
    """Effects and, where they begin or end in a step, when."""
    return frozenset((item.effect.label, item.trial.place if item.effect.is_stepwise else 0.0) for item in members)


def likeliest(c: Calibration, known: Sequence[Effect]) -> Search:
    """The likeliest of several ways to begin, with the fit of what is found or, where that does not explain the
    touches, of all possible causes; the fit without names where this shows that nothing is missing.

    It begins at the fit without names, and at its first linearisation where that is likelier; with all touches where
    some were rejected, which an effect may explain; with the usual noise, where what is missing was taken for it; with
    off-normal angles.

    Args:
        c: the base model.
        known: the catalogue.
    """
    off_normal, plain = off_normal_p_value(c) < FRICTION_SIGNIFICANCE, _plain(c, known)
    is_none = plain.odds.none >= 0.5 and not plain.likeliest(frozenset()) and plain.model.first is None
    if is_none and c.used.all() and not off_normal and is_explained(plain.model.fit, SIGNIFICANCE):
        return Search(plain, c, (plain,))
    found = [identify(c, known, plain)]
    if plain.model.first is not None:
        found += [item for item in [identify(c, known, weigh(plain.model.first, known))] if item.named]
    if not c.used.all() and not found[0].fit.used.all():
        every = c.changed(used=np.ones(len(c.touches), dtype=bool))
        with suppress(np.linalg.LinAlgError, UnsupportedDataError):  # with the outliers there is none
            found.append(identify(every, known, _plain(every, known, keeps_touches=True)))
    is_noise = not any(item.named for item in found) or advice.implausible_noise(c) is not None
    if c.cell.noise is None and is_noise and c.noise.joint_rms > USUAL_NOISE.joint_rms:
        usual = fit_again(c, cell=replace(c.cell, noise=USUAL_NOISE))
        if usual is not None and len(usual.touches) == len(c.touches):
            usual = usual.changed(cell=c.cell)
            with suppress(np.linalg.LinAlgError, UnsupportedDataError):
                found.append(identify(usual, known, _plain(usual, known)))
    best = _likeliest(found)
    # effects may hide off-normal angles in the base model
    off_normal = off_normal or any(off_normal_p_value(item.fit) < FRICTION_SIGNIFICANCE for item in found)
    turned = None
    if off_normal and not _is_radial(best):
        others = (effect for effect in c.model.effects if not effect.off_normal_std)
        model = c.model.with_effects((OffNormalForce(), *others))
        turned = fit_again(c.changed(model=model, used=np.ones(len(c.touches), dtype=bool)))
    if turned is not None:
        some = _beside_angles(known, turned)
        with_angles = _of_angles(identify(turned, some, _plain(turned, some)), len(known))
        sure = float(special.expit((best.deviance - with_angles.deviance) / 2))
        if sure >= FOUND:
            best = _likeliest([*found, with_angles._replace(angles_probability=sure)])
    named = naming(best, known, best.wanted) if best.angles or best.named else best
    if named.angles or named.weighed.odds.none < POSSIBLE:
        return named
    placed = [effect.label for effect in best.named if is_placed(effect)]
    if len(placed) == len(best.named):  # a small wave is placed by a fit
        return named._replace(without=(best.weighed, plain))
    if is_explained(plain.model.fit, STRICT_SIGNIFICANCE):
        return named._replace(without=(plain,))
    # the fit that all began at explains nothing: one begun where this has come to may
    small = naming(best, known, placed)
    return named._replace(without=(small.weighed,) if len(small.named) == len(placed) else ())


def _plain(c: Calibration, known: Sequence[Effect], *, keeps_touches: bool = False) -> Weighed:
    """The sets of effects at the mixed model without names."""
    return weigh(fit_mixed(c, known, keeps_touches=keeps_touches, freedoms=HEAVY_TAILS), known)


def _likeliest(found: Sequence[Search]) -> Search:
    """That of the least deviance, whose robot has no compliance or backlash below zero where one has none."""
    ranked = sorted(found, key=lambda item: item.deviance)
    for item in ranked:
        values, std = item.fit.parameters.as_array()[P_EE : G2 + 1], item.fit.std[P_EE : G2 + 1]
        if not (values < -_BELOW_ZERO * std).any():
            return item
    return ranked[0]


def naming(found: Search, known: Sequence[Effect], labels: Sequence[str]) -> Search:
    """A search with the fit of some effects, all others small; as it is where there is none.

    Args:
        found: the search.
        known: the catalogue.
        labels: of the effects to name.
    """
    if set(labels) == {effect.label for effect in found.named}:
        return found
    model, base = found.fit.model, found.base.changed(used=found.fit.used)
    known = _beside_angles(known, base)
    pairs = {effect.label: (effect, values) for effect, values in zip(model.effects, model.effect_values, strict=True)}
    for label in labels:  # rivals together would start at large values of opposite sign: at zero
        if label not in pairs:
            item = found.weighed.single(label)
            pairs[label] = item.effect, tuple(item.trial.values(np.zeros(len(item.trial.columns))))
    effects, values = zip(*(pairs[label] for label in labels), strict=True) if labels else ((), ())
    with suppress(*_NO_FIT):
        named = fit_mixed(base, known, ExtendedModel(model.parameters, effects, values))
        if _predicts(named.fit, base):
            return found._replace(weighed=weigh(named, known))
    return found


def _is_radial(found: Search) -> bool:
    """Whether a model fits without a fitted curve and without off-normal angles beyond noise."""
    physical = all(effect.is_physical for effect, _ in fitted_effects(found.fit))
    fits = found.fit.noise_source != 'given' or found.fit.p_value >= STRICT_SIGNIFICANCE
    return physical and fits and off_normal_p_value(found.fit) > FRICTION_SIGNIFICANCE


def is_explained(fit: Calibration, level: float) -> bool:
    """Whether a fit explains its residual at a level of significance, with plausible noise where this is estimated."""
    return chi_square_p_value(fit) >= level and advice.implausible_noise(fit) is None


def chi_square_p_value(fit: Calibration) -> float:
    """P-value of the residual of a fit beside stated noise; 1 where the noise is estimated."""
    return fit.p_value if fit.noise_source == 'given' else 1.0


def _beside_angles(known: Sequence[Effect], base: Calibration) -> list[Effect]:
    """The catalogue without friction, where a base model has random off-normal angles."""
    turned = {effect.name for effect, _ in fitted_effects(base) if effect.off_normal_std}
    return [effect for effect in known if effect.name not in turned]


def _of_angles(found: Search, count: int) -> Search:
    """A search beside random off-normal angles, by their odds beside a catalogue of so many effects: none where they
    are not significant.

    The test is made at the parameters of the model with them: those without may be far off. Where noise that grows with
    the force is significant beside the angles, these must be more significant by the same factor.
    """
    model = found.fit.model
    (friction,) = (effect for effect in model.effects if effect.off_normal_std)
    others = tuple(effect for effect in model.effects if not effect.off_normal_std)
    without = found.fit.changed(model=model.with_effects(others))
    off_normal, growing = off_normal_p_value(without, beside_growing=True), growing_p_value(found.fit)
    is_significant = off_normal < FRICTION_SIGNIFICANCE * (growing if growing < FRICTION_SIGNIFICANCE else 1.0)
    # one effect of the catalogue, its size as uncertain as the touches leave it
    odds = np.log(NUMBER[1] / NUMBER[0] / max(count, 1)) - 0.5 * np.log(len(found.base.touches))
    return found._replace(angles=friction.label, angles_odds=float(odds) if is_significant else -np.inf)
