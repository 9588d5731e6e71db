"""All that a calibration of recordings gives, frozen."""

from __future__ import annotations

from dataclasses import dataclass

from scara_kinetostatic.calibration.held_out import HeldOut
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.touch import Rejection


@dataclass(frozen=True)
class Outcome:
    """All that a calibration of recordings gives.

    Attributes:
        calibration: the twelve parameters alone, with their uncertainty.
        held_out: force error of that model on touches not used in the fit.
        diagnosis: whether the model is enough, and what is missing.
        extended_held_out: as `held_out`, of the model extended by what was found; the same where nothing was.
        found: touches in the recordings, rejected ones included.
        rejected: all that were not used, by index: by the detection and by the fit.
        sources: the recordings.
        warnings: what is odd about them, one sentence each.
    """

    calibration: Calibration
    held_out: HeldOut
    diagnosis: Diagnosis
    extended_held_out: HeldOut
    found: int
    rejected: tuple[Rejection, ...]
    sources: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def final(self) -> Calibration:
        """The calibration to use: extended by what was found, where something was."""
        return self.diagnosis.extended or self.calibration
