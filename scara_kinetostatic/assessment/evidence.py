"""What an assessment is made from."""

from __future__ import annotations

from typing import NamedTuple

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.model.touch import Rejection


class Evidence(NamedTuple):
    """A calibration with all that speaks for or against its use.

    Attributes:
        final: the calibration to use.
        diagnosis: whether the model is complete.
        comparison: errors, fitted and held out.
        found: touches in the recordings, rejected ones included.
        rejected: all that were not used.
    """

    final: Calibration
    diagnosis: Diagnosis
    comparison: Comparison
    found: int
    rejected: tuple[Rejection, ...]
