"""Estimate and covariance averaged over the sets of effects, by their probabilities, and over the places of an effect
on its grid.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.calibration.observations import ASSUMED_PLACES, LARGE_EFFECT, RIVALS, VALUE
from scara_kinetostatic.calibration.outliers import studentised
from scara_kinetostatic.calibration.result import Alternative, Calibration, Contribution, of_full_model
from scara_kinetostatic.calibration.uncertainty_budget import by_assumed_places
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.arrays import Floats


def with_assumed_places(c: Calibration) -> Calibration:
    """A calibration with places of undeclared objects as uncertain as is assumed of them."""
    more = by_assumed_places(c)
    return c if more is None else _with_contribution(c, ASSUMED_PLACES, more)


def averaged(c: Calibration, alternatives: Sequence[Alternative], undetected: Floats) -> Calibration:
    """A fit at the mean of the sets of effects that may be gross, by their probabilities, with their scatter in its
    covariance (law of total variance). Where the model is not defined at the mean the fit stays where it is.

    Args:
        c: the fit.
        alternatives: the values by each set.
        undetected: what of their covariance is of effects that are not seen.
    """
    if not alternatives:
        return c
    weight = np.array([item.probability for item in alternatives])
    mean = weight @ np.array([item.change for item in alternatives])
    of_model, errors, random = np.split(mean, np.cumsum([len(c.model.names), len(c.errors)]))
    moved = c.changed(
        model=c.model.with_array(c.model.as_array() + of_model),
        errors=c.errors + errors,
        random_values=c.random_values + random,
    )
    # the sum of squares stays that of the fit: what a mean does not explain is no noise that enlarges a covariance
    if np.isfinite(moved.projection.distance[c.used]).all():
        distance = studentised(moved.projection.whitened, c.covariance_with_errors / c.enlargement, c.used)
        c = moved.changed(standardized=np.sqrt(distance))
    else:
        mean = np.zeros(len(mean))
    alternatives = tuple(
        item._replace(change=item.change - mean, covariance=c.enlargement * item.covariance) for item in alternatives
    )
    off = np.array([item.change for item in alternatives])
    every = np.tensordot(weight, [item.covariance for item in alternatives], 1) + off.T @ (weight[:, None] * off)
    kept, sizes = of_full_model(c)
    every, undetected = (
        sizes[:, None] * part[np.ix_(kept, kept)] * sizes for part in (every, c.enlargement * undetected)
    )
    scale = np.sqrt(np.diag(every + c.covariance))
    undetected = _positive(undetected, scale)
    more = _positive(every - c.covariance - undetected, scale)
    c = c.changed(alternatives=alternatives if len(alternatives) > 1 else ())
    c = _with_contribution(c, LARGE_EFFECT, undetected)
    return _with_contribution(c, RIVALS, more) if c.alternatives else c


def with_places(c: Calibration, effect: Effect, change: Floats, weight: Floats) -> Calibration:
    """A fit with the scatter of its values with other places of an effect on its grid in its covariance, in place of
    the variance that the linearisation gives this place.

    Args:
        c: the fit.
        effect: the effect.
        change: of all values to each of the places, (t, 12 + k).
        weight: of each, (t,).
    """
    name = f'{effect.label}.{effect.grid_parameter}'
    at, own, off = c.model.names.index(name), c.covariance, change.copy()
    known = own - np.outer(own[at], own[at]) / own[at, at] if own[at, at] > 0 else own
    first = at - effect.grid_parameter_index
    comparable = effect.amplitudes(np.ones(len(effect.parameters))) != 0  # a phase is not, of another frequency
    comparable[effect.grid_parameter_index] = True
    off[:, first : first + len(comparable)] *= comparable
    more = known - own
    more[: off.shape[1], : off.shape[1]] += off.T @ (weight[:, None] * off)
    scale = np.sqrt(np.clip(np.diag(own + known), 0.0, None))
    scale[: off.shape[1]] = np.sqrt(scale[: off.shape[1]] ** 2 + weight @ off**2)
    return _with_contribution(c, f'{VALUE}[{name}]', _positive(more, scale))


def _positive(more: Floats, scale: Floats) -> Floats:
    """The positive part of a symmetric matrix in units of `scale`: what it adds to a covariance."""
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(more / np.outer(unit, unit))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(root @ root.T)


def _with_contribution(c: Calibration, label: str, more: Floats) -> Calibration:
    """A calibration with more covariance of all values of `full_model`."""
    return c.changed(added=(*c.added, Contribution(label, None, '', more)))
