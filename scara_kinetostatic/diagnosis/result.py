"""The outcome of a diagnosis, frozen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.effects.base import Effect


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
        proved: whether it is in every set of effects that the data allow; else it has rivals.
    """

    effect: Effect
    values: tuple[Value, ...]
    in_every_model: bool


class Ranked(NamedTuple):
    """One effect of the catalogue, judged by itself.

    Attributes:
        effect: the effect.
        role: ``found``, ``rival``, ``rejected`` or ``unidentifiable``.
        p_value: of "it is not there", the search over its frequencies counted; NaN if it cannot show.
        share: part of the residual's sum of squares that it explains.
        gain: twice the logarithm of its odds against no effect, all prices paid.
        held_out: gain of twice the logarithmic predictive density on touches left out one by one.
        new: largest part of it that is new beside the twelve; below `candidates.LEAST_NEW` it cannot show.
        hidden_bend: by how many standard deviations one of the twelve may be off by such an effect that is just
            too small to be found; NaN if it cannot show.
        bent: name of that parameter.
    """

    effect: Effect
    role: str
    p_value: float
    share: float
    gain: float
    held_out: float
    independent_part: float
    undetected_bias: float = np.nan
    biased_parameter: str = ''


@dataclass(frozen=True)
class Diagnosis:
    """Whether the twelve-parameter model is enough, and what is behind it if not.

    Attributes:
        verdict: ``none`` (nothing is missing), ``explained``, ``ambiguous`` or ``unexplained``.
        p_value: of "the twelve-parameter model is enough", all tests taken together.
        found: what the extended model has beyond the twelve: effects found, and rivals, which
            take part together since the data cannot tell which of them it is.
        rivals: effects that the data cannot tell apart, by label.
        extended: the calibration with what was found; None if there is nothing.
        traces: what the residual of the twelve-parameter model depends on, significant ones only.
        remaining: the same of the extended model.
        remaining_p_value: of "the extended model is enough"; that of the twelve if there is none.
        ranking: the whole catalogue, the best first.
        advice: what to do next, in words; empty if nothing.
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

    def effects_by_label(self) -> dict[str, Effect]:
        """All effects in the ranking and in the extended model, by label."""
        ranked = {item.effect.label: item.effect for item in self.ranking}
        return ranked | {item.effect.label: item.effect for item in self.found}

    def role_of(self, item: Ranked) -> str:
        """The role of a candidate; it is a rival only where `rivals` names it."""
        named = any(item.effect.label in group for group in self.rivals)
        return 'rejected' if item.role == 'rival' and not named else item.role
