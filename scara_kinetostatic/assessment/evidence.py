"""What an assessment is made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scara_kinetostatic.assessment.conformity import Conformity, conformity
from scara_kinetostatic.assessment.leverage import leverages
from scara_kinetostatic.assessment.mistakes import Mistake, find_mistake
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import TipUncertainty, Workspace, tip_uncertainty, workspace
from scara_kinetostatic.calibration.uncertainty_budget import Improvement, improvements
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.touch import Rejection


@dataclass(frozen=True, eq=False)
class Evidence:
    """A calibration with all that speaks for or against its use.

    Attributes:
        base: the base model.
        final: the calibration to use.
        diagnosis: whether the model is complete.
        comparison: errors, fitted and held out.
        found: touches in the recordings, rejected ones included.
        rejected: all that were not used.
        first_touches: number of the first touch of each recording.
        sequence_known: whether the order in time of the recordings is known.
    """

    base: Calibration
    final: Calibration
    diagnosis: Diagnosis
    comparison: Comparison
    found: int
    rejected: tuple[Rejection, ...]
    first_touches: tuple[int, ...] = (0,)
    sequence_known: bool = True

    @cached_property
    def leverages(self) -> Floats:
        """Of the used touches, (n,)."""
        return leverages(self.final)

    @cached_property
    def workspace(self) -> Workspace:
        """Of the calibrated arm."""
        return workspace(self.final)

    @cached_property
    def tip_uncertainty(self) -> TipUncertainty:
        """Expanded uncertainty of the tip over the workspace."""
        return tip_uncertainty(self.final, self.workspace)

    @cached_property
    def conformity(self) -> Conformity | None:
        """The same against the tolerance; None where there is none, or it is not determined."""
        return conformity(self.final, self.tip_uncertainty)

    @cached_property
    def improvements(self) -> list[Improvement]:
        """What would reduce the uncertainty of the tip, the most effective first."""
        return improvements(self.final, self.workspace)

    @cached_property
    def mistake(self) -> Mistake | None:
        """A mistake in the cell description or in the touches that explains what is odd."""
        return find_mistake(self.final.touches, self.final.cell, self.final)

    @cached_property
    def unusable(self) -> list[tuple[int, int]]:
        """How many touches of each recording are not used, and how many were found in it."""
        edges = [*self.first_touches, max(self.found, self.first_touches[-1])]
        numbers = np.array([item.index for item in self.rejected], dtype=np.intp)
        return list(zip(np.histogram(numbers, edges)[0].tolist(), np.diff(edges).tolist(), strict=True))
