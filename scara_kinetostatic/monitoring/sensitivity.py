"""What touches would have shown: for each parameter the smallest change that contradicts a calibration.

A change d of one parameter gives the chi-square of all touches the noncentrality λ = d² Λ_jj (`linear.Evidence`). It is
seen with the probability `POWER` where λ lifts the noncentral chi-square beyond the quantile of the test.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chndtrinc

from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.monitoring.linear import Evidence, State
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.significance import quantile

POWER = 0.95
"""Probability with which a change of the size that is stated is seen."""
_NOTHING = 1e-9
"""Information on a parameter, in the largest of all, below which the touches say nothing of it."""


class Detectable(NamedTuple):
    """The smallest change of one parameter that touches show.

    Attributes:
        name: of the parameter.
        unit: SI.
        change: its size; infinite where the touches say nothing of the parameter.
        tip: rms displacement of the predicted tip by it, at the touches of the calibration, m.
    """

    name: str
    unit: str
    change: float
    tip: float

    @property
    def text(self) -> str:
        """Parameter, change and displacement of the tip."""
        if not np.isfinite(self.change):
            return f'{self.name} of any size'
        return f'{self.name} by {quantity(self.change, self.unit)} (tip: {quantity(self.tip, "m")} rms)'


def detectable_changes(
    record: CalibrationRecord, state: State, evidence: Evidence, freedoms: int, level: float
) -> list[Detectable]:
    """For each parameter that the calibration estimated, those first whose undetected change moves the tip most.

    Args:
        record: the calibration.
        state: what may be off.
        evidence: of the touches.
        freedoms: of their chi-square.
        level: p-value below which they contradict the calibration.
    """
    noncentrality = float(chndtrinc(quantile(1 - level, freedoms, record.noise_freedoms), freedoms, 1 - POWER))
    diagonal = np.diag(evidence.matrix)
    found = []
    for place, name in enumerate(NAMES):
        if name in record.fixed:
            continue
        seen = diagonal[place] > _NOTHING * diagonal.max(initial=1e-12)
        change = float(state.scale[place] * np.sqrt(noncentrality / diagonal[place])) if seen else np.inf
        found.append(Detectable(name, UNITS[name], change, _moved(record, place, change)))
    return sorted(found, key=lambda item: -item.tip)


def _moved(record: CalibrationRecord, place: int, change: float) -> float:
    """Rms displacement of the predicted tip by a change of one value, m."""
    if not np.isfinite(change):
        return np.inf
    model = record.arm.model
    values = model.as_array().copy()
    values[place] += change
    metadata = TouchMetadata.of(record.touches, record.arm.cell.sensor.frame)
    arms = record.arm, replace(record.arm, model=model.with_array(values))
    tips = [Predictor(arm).locate(record.touches.joints, record.forces, metadata).position for arm in arms]
    return rms(np.linalg.norm(tips[1] - tips[0], axis=1))
