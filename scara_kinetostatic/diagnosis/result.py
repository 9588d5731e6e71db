"""The result of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.effects.base import Effect


class Dependence(NamedTuple):
    """The test of what a residual could depend on.

    Attributes:
        name: of the quantity on which the residual would depend.
        p_value: of "it does not".
        share: part of the residual's sum of squares that it explains.
    """

    name: str
    p_value: float
    share: float


class Value(NamedTuple):
    """A parameter of an effect: estimate, standard deviation (NaN where the data do not determine it), unit."""

    name: str
    value: float
    std: float
    unit: str
    meaning: str = ''


class Found(NamedTuple):
    """An effect in the extended model.

    Attributes:
        effect: the effect.
        values: its parameters; of a rival, what they are if it is this one.
        in_every_model: whether its inclusion is 95 % or more, or it is a fitted curve; else it has rivals.
        is_possible: whether it is a suspicion only, as the model with it is still incomplete.
    """

    effect: Effect
    values: tuple[Value, ...]
    in_every_model: bool
    is_possible: bool = False

    @property
    def is_found(self) -> bool:
        """Whether it is stated as found: inclusion of 95 % or more, and what is left is noise; or a fitted curve."""
        return self.in_every_model and not self.is_possible


class Ranked(NamedTuple):
    """One effect of the catalogue by itself.

    Attributes:
        effect: the effect.
        role: ``found``, ``possible``, ``rival``, ``rejected`` or ``unidentifiable``.
        p_value: of "it is not there", corrected for the search over its frequencies; NaN if it is not identifiable.
        share: part of the residual's sum of squares that it explains.
        gain: twice the log of its Bayes factor against none; about by what the deviance decreases beyond its penalty.
        independent_part: largest part of it that is independent of the base model; below
            `linear_problem.INDEPENDENT_PART` it is not identifiable.
    """

    effect: Effect
    role: str
    p_value: float
    share: float
    gain: float
    independent_part: float

    @classmethod
    def unidentifiable(cls, effect: Effect, independent_part: float) -> Ranked:
        """An effect that these touches cannot determine."""
        return cls(effect, 'unidentifiable', np.nan, 0.0, 0.0, independent_part)


class EffectSet(NamedTuple):
    """A set of effects that may be gross, with its probability.

    Attributes:
        effects: their labels, ``unnamed`` for what is outside the catalogue; none where no effect is gross.
        probability: of the set.
    """

    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Diagnosis:
    """Whether the base model is complete, and what it lacks if not.

    Attributes:
        verdict: ``none`` (nothing is missing), ``explained``, ``ambiguous`` or ``unexplained``.
        p_value: of "no effect is gross": the inverse of its Bayes factor or, where the noise is stated and less, of the
            chi-square of the mixed model.
        found: the effects of the extended model: those found, and rivals, which are fitted together.
        rivals: effects that the data cannot distinguish, by label.
        probabilities: of all sets of effects that may be gross, the likeliest first; they add up to 1.
        inclusion: the probability of each effect to be gross, by label.
        has_small_errors: whether nothing is missing but small errors of usual kinds, which the base model lacks.
        extended: the calibration with these effects; None if there are none.
        dependences: what the residual of the base model depends on, significant ones only.
        remaining: the same of the extended model.
        remaining_p_value: of "the extended model is complete"; that of the base model if there is none.
        ranking: the whole catalogue, the best first.
        advice: what to do next; empty if nothing.
        refitted: the base model with the noise that the touches ask for, or without the trusted nominal values that
            they contradict, which is to be used; None where it is as it was.
        contradicted: trusted nominal values that the touches contradict; the result is without them.
    """

    verdict: str
    p_value: float
    found: tuple[Found, ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    extended: Calibration | None = None
    dependences: tuple[Dependence, ...] = ()
    remaining: tuple[Dependence, ...] = ()
    remaining_p_value: float = 1.0
    ranking: tuple[Ranked, ...] = ()
    advice: str = ''
    refitted: Calibration | None = None
    contradicted: tuple[Contradiction, ...] = ()
    probabilities: tuple[EffectSet, ...] = ()
    inclusion: Mapping[str, float] = field(default_factory=dict)
    has_small_errors: bool = False

    @property
    def is_undecided(self) -> bool:
        """Whether touches may tell what is missing: possible causes, or rather something than nothing."""
        none = sum(item.probability for item in self.probabilities if not item.effects)
        return self.verdict == 'ambiguous' or (self.verdict == 'none' and bool(self.probabilities) and none < 0.5)

    def effects_by_label(self) -> dict[str, Effect]:
        """All effects in the ranking and in the extended model, by label."""
        ranked = {item.effect.label: item.effect for item in self.ranking}
        return ranked | {item.effect.label: item.effect for item in self.found}

    def role_of(self, item: Ranked) -> str:
        """The role of a candidate; it is a rival only where `rivals` names it."""
        named = any(item.effect.label in group for group in self.rivals)
        return 'rejected' if item.role == 'rival' and not named else item.role


class Contradiction(NamedTuple):
    """The test of one trusted nominal value.

    Attributes:
        name: of the parameter.
        off: the trusted value less that of the touches, in its unit.
        std: its declared standard uncertainty.
        deviation: |t|.
        p_value: of "it is right", Bonferroni-corrected over all that are trusted.
    """

    name: str
    off: float
    std: float
    deviation: float
    p_value: float
