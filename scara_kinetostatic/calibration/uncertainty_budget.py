"""Uncertainty budget (GUM, JCGM 100, 5.1.2 and annex H): what each source contributes to every parameter and the tip.

The covariance of a calibration is the sum of what its independent sources contribute (`Calibration.contributions`):
noise (type A) and all that was declared (type B). A parameter's contribution is the root of the diagonal element, so
that the squares add up to std². That of the tip is aᵀ Σ_s a with a the change of the tip at the worst place, in its
worst direction: the squares add up to (U/2)² there or, where U is the radius of several possible causes, to their
variance.

**Assumed** is what a result rests on that no touch shows: places of objects that nobody has declared; the nominal arm.

A displacement common to all objects is one of the base: no touch tells it from x0 and y0, so that these are as
uncertain as was declared or, where nothing was, as was assumed (`ObjectPosition.size`).

With C the covariance of all values, P the prior covariance of some of them, C_g the columns of these, and f the factors
by which their prior standard deviations are to be larger, the precision of the prior falls from P⁻¹ to P⁻¹/f². By
Woodbury's identity

    C' = C + C_g (P / (1 - 1/f²) - C_gg)⁻¹ C_gᵀ.

What the touches determine stays; where they show nothing, C_gg = P, the standard deviation grows by f.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.observations import (
    ASSUMED_PLACES,
    EARLIER,
    LARGE_EFFECT,
    RIVALS,
    UNDETECTED,
    VALUE,
    Prior,
)
from scara_kinetostatic.calibration.result import Calibration, Contribution, of_full_model
from scara_kinetostatic.calibration.tip_uncertainty import (
    COVERAGE_FACTOR,
    Poses,
    TipUncertainty,
    WorstPose,
    tip_covariance,
    tip_derivative,
    tip_uncertainty,
)
from scara_kinetostatic.effects.objects import ObjectPosition, PlatePosition
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import SizeMode

NOISE = 'noise'
"""Label of the only source of type A."""
_TITLES = {
    NOISE: 'noise of the touches',
    'size': 'size of {}',
    RIVALS: 'choice between possible causes',
    VALUE: 'choice of {}',
    UNDETECTED: 'undetected {}',
    EARLIER: 'earlier calibration',
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
        label: ``noise``, or as `observations.Source` has it.
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


TIMES = 3.0
"""By how much larger than assumed the errors are in what is said beside it: a convention, half an order of magnitude.
"""
_PLACES = ObjectPosition.name, PlatePosition.name


class Assumed(NamedTuple):
    """What was assumed of the places of objects that are not declared.

    Attributes:
        objects: standard uncertainty of each coordinate, m; 0 where they count as exact.
        if_three_times: the largest expanded uncertainty of the tip if it were three times as large, m.
    """

    objects: float
    if_three_times: float


def assumed_places(c: Calibration) -> Assumed | None:
    """What was assumed of undeclared places; None where all are declared."""
    if not c.cell.undeclared_places:
        return None
    size = _assumed_size(c)
    more = _more(c, TIMES * size) - _more(c, size)  # which it has (`by_assumed_places`)
    larger = c.changed(added=(*c.added, Contribution(ASSUMED_PLACES, None, '', more)))
    return Assumed(size, tip_uncertainty(larger).worst)


def by_assumed_places(c: Calibration) -> Floats | None:
    """What errors of undeclared places of the size that is assumed add to the covariance of `full_model` of a fit: what
    no touch shows of them is as large as the errors that touches show only by the prior. None where all are declared.
    """
    return _more(c, _assumed_size(c)) if c.cell.undeclared_places else None


def _assumed_size(c: Calibration) -> float:
    """Of each coordinate, m; 0 where they count as exact."""
    effects = c.cell.uncertainty.effects
    return 0.0 if effects.sizes is SizeMode.NONE else ObjectPosition().size(arm=effects.arm)


def _more(c: Calibration, size: float) -> Floats:
    """What is added to the covariance of `full_model` where errors of undeclared places have a size, m, beforehand;
    those that have been found to be as large stay.
    """
    at, prior, sizes = _undeclared(c)
    smaller = sizes < size
    at, prior, sizes = at[smaller], prior[smaller], sizes[smaller]
    (kept, scale), everything = of_full_model(c), c.covariance_with_errors / c.enlargement
    left, own = scale[:, None] * everything[np.ix_(kept, at)] / prior, everything[np.ix_(at, at)]
    values, vectors = np.linalg.eigh(own / np.outer(prior, prior))
    own = vectors * np.minimum(values, 1.0) @ vectors.T  # the scatter of rivals may exceed the prior
    weight = np.diag(1 / (1 - (sizes / size) ** 2)) - own
    return np.asarray(c.enlargement * left @ np.linalg.solve(weight, left.T))


def _undeclared(c: Calibration) -> tuple[Indices, Floats, Floats]:
    """Errors of undeclared places, named or not: where they are in `covariance_with_errors`, their prior standard
    deviations in its units, and in m, (g,) each.
    """
    found = list[tuple[int, float, float]]()
    if isinstance(c.known, Prior):
        named = zip(c.known.trusted.tolist(), c.known.std.tolist(), strict=True)
        labels = tuple(f'{name}[' for name in _PLACES)
        found += [(k, std, std) for k, std in named if c.model.names[k].startswith(labels)]
    if c.random is not None:
        first, columns = len(c.model.names) + len(c.errors), enumerate(c.random.columns)
        some = [k for k, e in columns if e.effect.name in _PLACES and np.isnan(c.random.stated_size(e))]
        found += [(first + k, 1.0, float(c.random.size[k])) for k in some]
    at, prior, size = np.array(found).reshape(-1, 3).T
    return at.astype(np.intp), prior, size


def nominal_uncertainty(c: Calibration, at: WorstPose) -> float:
    """How far off the tip of the nominal arm may be, m: the most at the touches, and where the calibrated one is known
    least.

    By declared nominal values it is the expanded uncertainty (k = 2) that these alone give; by others it is how far the
    calibration has moved the tip.
    """
    touches, names, declared = c.touches.select(c.used), c.parameters.names, c.cell.uncertainty.nominal
    joints, force = np.vstack([touches.joints, at.joints]), np.vstack([c.force[c.used], at.force])
    derivative = tip_derivative(c, Poses(joints, np.append(touches.posture, at.posture), force))[..., : len(names)]
    std = np.array([declared.get(name, 0.0) for name in names])
    moved = derivative @ np.where(std > 0, 0.0, c.parameters.as_array() - c.cell.nominal.as_array())
    variance = np.linalg.eigvalsh(tip_covariance(derivative, np.diag(std**2)))[:, -1]
    return float(np.sqrt(COVERAGE_FACTOR**2 * variance + (moved**2).sum(axis=-1)).max())
