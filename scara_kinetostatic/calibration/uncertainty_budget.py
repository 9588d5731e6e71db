"""Uncertainty budget (GUM, JCGM 100, 5.1.2 and annex H): what each source contributes to every parameter and the tip.

The covariance of a calibration is the sum of what its independent sources contribute (`Calibration.contributions`):
noise (type A) and all that was declared (type B). A parameter's contribution is the root of the diagonal element, so
that the squares add up to std². That of the tip is aᵀ Σ_s a with a the change of the tip at the worst place, in its
worst direction: the squares add up to (U/2)² there or, where U is the radius of several possible causes, to their
variance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import ASSUMED_PLACES, LARGE_EFFECT, RIVALS, UNDETECTED, VALUE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import TipUncertainty
from scara_kinetostatic.model.arrays import Floats

NOISE = 'noise'
"""Label of the only source of type A."""
_TITLES = {
    NOISE: 'noise of the touches',
    'size': 'size of {}',
    RIVALS: 'choice between possible causes',
    VALUE: 'choice of {}',
    UNDETECTED: 'undetected {}',
    LARGE_EFFECT: 'one large flaw that the touches do not exclude',
    ASSUMED_PLACES: 'places of objects that are not declared',
    'object_position': 'place of {}',
    'object_radius': 'radius of {}',
    'object_rotation': 'rotation of {}',
    'object_offset': 'offset of the sides of {}',
    'plate_position': 'place of plate {}',
    'plate_angle': 'rotation of plate {}',
    'radius': 'error common to all radii',
    'force_gain': 'gain of the force sensor',
    'force_rotation': 'rotation of the force sensor',
    'nominal': 'nominal value of {}',
}


class Item(NamedTuple):
    """One source of the budget. Contributions are standard uncertainties.

    Attributes:
        label: ``noise``, or as `declared_errors.Source` has it.
        declared: its declared standard uncertainty; None for noise and what is not declared.
        unit: of `declared`.
        parameters: contribution to each of the base model, (12,), in their units; NaN where confounded.
        tip: contribution to the tip where its uncertainty is largest, in its worst direction, m; NaN if undetermined.
    """

    label: str
    declared: float | None
    unit: str
    parameters: Floats
    tip: float

    @property
    def kind(self) -> str:
        """Its label without the target."""
        return self.label.partition('[')[0]

    @property
    def target(self) -> str:
        """What it is of, such as a disc; empty where it has none."""
        return self.label.partition('[')[2].removesuffix(']')

    @property
    def title(self) -> str:
        """In words: ``place of disc_1`` for ``object_position[disc_1]``."""
        return title_of(self.label)

    @property
    def evaluation(self) -> str:
        """``A`` or ``B`` (GUM, 2.3.2 and 2.3.3)."""
        return 'A' if self.label == NOISE else 'B'


def title_of(label: str) -> str:
    """A source in words, by its label."""
    kind, _, target = label.removesuffix(']').partition('[')
    words = _TITLES.get(label) or _TITLES.get(kind, label)
    return words.format(target.replace('_', ' ') if kind == UNDETECTED else target)


def uncertainty_budget(c: Calibration, tip: TipUncertainty) -> tuple[Item, ...]:
    """The budget of a calibration: noise first, then the declared sources in the order of the cell description.

    Args:
        c: the calibration.
        tip: its uncertainty of the tip.
    """
    at, undetermined = tip.at, np.isnan(c.std)

    def item(label: str, declared: float | None, unit: str, covariance: Floats) -> Item:
        variances = np.clip(np.diag(covariance)[: len(c.std)], 0.0, None)
        of_tip = np.nan if at is None else np.sqrt(max(float(at.gradient @ covariance @ at.gradient), 0.0))
        return Item(label, declared, unit, np.where(undetermined, np.nan, np.sqrt(variances)), float(of_tip))

    return tuple(item(*part) for part in c.contributions)
