"""What a result rests on that no touch shows: places of objects that nobody has declared; the nominal arm.

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

from scara_kinetostatic.calibration.declared_errors import ASSUMED_PLACES
from scara_kinetostatic.calibration.result import Calibration, Contribution, of_full_model
from scara_kinetostatic.calibration.tip_uncertainty import (
    COVERAGE_FACTOR,
    Poses,
    WorstPose,
    tip_covariance,
    tip_derivative,
    tip_uncertainty,
)
from scara_kinetostatic.effects.objects import ObjectPosition, PlatePosition
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import SizeMode

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
    if c.known is not None:
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
