"""The fits of one diagnosis, and the solver steps that they take: counted, and bounded.

Most touches need a few hundred steps. Where several large effects act at once, many sets of effects are fitted, and
many of these fits do not converge. Beyond a number of steps what could still be fitted is left out, and the diagnosis
then says so: its names are no more than suspicions. The bound is of steps, not of time: the same touches have the same
diagnosis on every machine. A step takes the longer the more effects the model has; the unit is one with two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import TouchSet

MOST_STEPS = 850
"""Of a fit and its diagnosis, before the alternatives of what it found are left out."""
WITH_OTHER_NOISE = 130
"""Of them, for a diagnosis with other noise, at least; a third of them at most."""
SEARCH = 0.7
"""Part of them that the search for effects may take; the rest is for rivals and alternatives."""
_STEPS_OF_REFUSAL = 20
"""Counted for a fit that is refused."""
_STEP, _STEP_PER_EFFECT = 0.5, 0.25
"""Counted for a step, and for each effect beside: in proportion to the time that they take."""
_FEWEST = 60
"""That a fit may take in any case: most need fewer."""


class Effort:
    """The fits of one diagnosis.

    Attributes:
        most: solver steps before optional fits are left out.
        steps: solver steps so far, in those of a model with two effects.
        has_left_out: whether something was left out.
    """

    def __init__(self, most: float = MOST_STEPS) -> None:
        self.most = most
        self.steps = 0.0
        self.has_left_out = False

    def allows(self, part: float = 1.0) -> bool:
        """Whether something more may be fitted; where not, it counts as left out.

        Args:
            part: of all steps that may have been taken before.
        """
        allowed = self.steps < part * self.most
        self.has_left_out |= not allowed
        return allowed

    def fit(
        self,
        touches: TouchSet,
        cell: Cell,
        effects: Sequence[EffectLaw] = (),
        *,
        start: ExtendedModel | None = None,
        fixed: Mapping[str, float] | None = None,
        warm_start: WarmStart | None = None,
    ) -> Calibration:
        """`calibrate` with its steps counted; a fit with a warm start may take what is left of them, or `_FEWEST`.

        Raises:
            UnsupportedDataError: as `calibrate`.
        """
        step = _cost_of_step(len(effects))
        if warm_start is not None:
            left = max(int((self.most - self.steps) / step), _FEWEST)
            warm_start = warm_start._replace(most=min(warm_start.most, left))
        try:
            found = calibrate(touches, cell, effects, start=start, fixed=fixed, warm_start=warm_start)
        except UnsupportedDataError:
            self.steps += _STEPS_OF_REFUSAL
            raise
        self.steps += steps_of(found)
        self.has_left_out |= self.steps > self.most and found.termination is Termination.ITERATION_LIMIT
        return found


def steps_of(fit: Calibration) -> float:
    """The steps of a fit, in those of a model with two effects."""
    return fit.iterations * _cost_of_step(len(fit.model.effects))


def _cost_of_step(effects: int) -> float:
    return _STEP + _STEP_PER_EFFECT * effects
