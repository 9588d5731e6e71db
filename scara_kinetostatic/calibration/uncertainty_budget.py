"""Uncertainty budget (GUM, JCGM 100, 5.1.2 and annex H): what each source contributes to every parameter and the tip.

The covariance of a calibration is the sum of what its independent sources contribute (`Calibration.contributions`):
noise (type A) and all that was declared (type B). A parameter's contribution is the root of the diagonal element, so
that the squares add up to std². That of the tip is aᵀ Σ_s a with a the change of the tip at the worst place, in its
worst direction: the squares add up to (U/2)² there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.contributions import ALTERNATIVES
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import TipUncertainty, tip_uncertainty
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES

NOISE = 'noise'
"""Label of the only source of type A."""
_TITLES = {
    NOISE: 'noise of the touches',
    ALTERNATIVES: 'choice among credible models',
    'object_position': 'place of {}',
    'object_radius': 'radius of {}',
    'plate_position': 'place of plate {}',
    'plate_angle': 'rotation of plate {}',
    'radius': 'error common to all radii',
    'force_gain': 'gain of the force sensor',
    'force_rotation': 'rotation of the force sensor',
    'nominal': 'nominal value of {}',
}


def source_title(label: str) -> str:
    """A source in words: ``place of disc_1`` for ``object_position[disc_1]``."""
    kind, _, rest = label.partition('[')
    return _TITLES.get(kind, label).format(rest.rstrip(']'))


class Item(NamedTuple):
    """One source of the budget. Contributions are standard uncertainties.

    Attributes:
        label: ``noise``, or as `declared_errors.Source` has it.
        declared: its declared standard uncertainty; None for noise and credible models.
        unit: of `declared`.
        parameters: contribution to each of the twelve, (12,), in their units; NaN where confounded.
        tip: contribution to the tip where its uncertainty is largest, in its worst direction, m; NaN if undetermined.
    """

    label: str
    declared: float | None
    unit: str
    parameters: Floats
    tip: float

    @property
    def title(self) -> str:
        """The source in words."""
        return source_title(self.label)

    @property
    def evaluation(self) -> str:
        """``A`` or ``B`` (GUM, 2.3.2 and 2.3.3)."""
        return 'A' if self.label == NOISE else 'B'


def uncertainty_budget(c: Calibration, tip: TipUncertainty | None = None) -> tuple[Item, ...]:
    """The budget of a calibration: noise first, then the declared sources in the order of the cell description.

    Args:
        c: the calibration.
        tip: its uncertainty of the tip, where there is one.
    """
    at = (tip_uncertainty(c) if tip is None else tip).at
    undetermined = np.isnan(c.std)

    def item(label: str, declared: float | None, unit: str, covariance: Floats) -> Item:
        variances = np.clip(np.diag(covariance)[: len(NAMES)], 0.0, None)
        of_tip = np.nan if at is None else np.sqrt(max(float(at.gradient @ covariance @ at.gradient), 0.0))
        return Item(label, declared, unit, np.where(undetermined, np.nan, np.sqrt(variances)), float(of_tip))

    return tuple(item(*part) for part in c.contributions)
