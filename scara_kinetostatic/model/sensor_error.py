"""Errors of the force sensor: what it reports for a true force, and the true force behind what it reports.

The effects of an extended model let the sensor report F + e(F), in its own frame. The equations of a touch hold for the
true force F, the adjustment varies the reported one.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel


def has_sensor_error(model: ExtendedModel) -> bool:
    """Whether any effect of a model is an error of the sensor."""
    probe = np.ones((1, 2))
    pairs = zip(model.effects, model.effect_arrays, strict=True)
    return any(effect.sensor_error(probe, values, None) is not None for effect, values in pairs)


def reported_force(model: ExtendedModel, force: Floats, metadata: TouchMetadata | None = None) -> Floats:
    """F + e(F) for true forces (n, 2) in the sensor's frame, N; `metadata` is that of the touches."""
    parts = (
        effect.sensor_error(force, values, metadata)
        for effect, values in zip(model.effects, model.effect_arrays, strict=True)
    )
    return sum((part for part in parts if part is not None), force)


def true_force(model: ExtendedModel, reported: Floats, metadata: TouchMetadata | None = None) -> Floats:
    """The true forces behind reported ones, (n, 2), N, in the sensor's frame; NaN where there is none.

    By Newton's method, whose derivative stays for as long as the error falls fast.
    """
    if not has_sensor_error(model):
        return reported
    force, most = reported, np.abs(reported).max(initial=0.0)
    inverse, before = None, np.inf
    with np.errstate(all='ignore'):
        # Newton steps at most
        for _ in range(12):
            off = reported_force(model, force, metadata) - reported
            error = np.fmax.reduce(np.abs(off), axis=None)  # of those touches whose force is a number
            # error of the force that a true force gives, as a part of the largest one, at which the iteration ends
            if not error > 1e-15 * most:
                break
            # the derivative is worked out anew where a step leaves more than this part of the error
            if inverse is None or error > 0.1 * before:
                inverse = _true_by_reported(model, force, metadata)
            force, before = force - _times(inverse, off), error
        # error, as a part of the largest force, beyond which there is no true force
        return np.where(np.abs(off) <= 1e-9 * most, force, np.nan)


def true_force_derivative(
    model: ExtendedModel, reported: Floats, true: Floats, metadata: TouchMetadata | None = None
) -> Floats:
    """∂F/∂(reported F) at reported forces (n, 2) and the true ones behind them, (n, 2), N.

    Both are in components along and across the force itself, (n, 2, 2).
    """
    matrix = _true_by_reported(model, true, metadata)
    x, y = (reported / np.hypot(reported[:, 0], reported[:, 1])[:, None]).T
    columns = [_times(matrix, np.array([x, y]).T), _times(matrix, np.array([-y, x]).T)]
    return np.stack([along_and_across(column, true) for column in columns], axis=-1)


def sensor_error_columns(
    model: ExtendedModel, reported: Floats, true: Floats, by_reported: Floats, metadata: TouchMetadata | None = None
) -> Floats:
    """The derivatives of h by the parameters of the effects through the sensor error, (n, 2, k).

    The true force behind a reported one changes by -∂F/∂(reported F) ∂e.

    Args:
        model: with k parameters of effects.
        reported: forces, (n, 2), N.
        true: those behind them, (n, 2), N.
        by_reported: ∂h by the reported force, along and across it, (n, 2, 2).
        metadata: of the touches.
    """
    columns = np.zeros((len(model.effect_scales), 2, len(true)))
    first = 0
    for effect, values in zip(model.effects, model.effect_arrays, strict=True):
        for k, error in enumerate(effect.sensor_error_derivative(true, values, metadata), first):
            columns[k] = -_times(by_reported, along_and_across(error, reported)).T
        first += len(values)
    return columns.transpose(2, 1, 0)


def along_and_across(vectors: Floats, force: Floats) -> Floats:
    """Components of vectors (n, 2) along and across forces (n, 2)."""
    x, y = (force / np.hypot(force[:, 0], force[:, 1])[:, None]).T
    return np.array([vectors[:, 0] * x + vectors[:, 1] * y, vectors[:, 1] * x - vectors[:, 0] * y]).T


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Matrices (n, 2, 2) times vectors (n, 2), touch by touch."""
    x, y = vectors.T
    return np.array([matrices[:, 0, 0] * x + matrices[:, 0, 1] * y, matrices[:, 1, 0] * x + matrices[:, 1, 1] * y]).T


def _true_by_reported(model: ExtendedModel, force: Floats, metadata: TouchMetadata | None) -> Floats:
    """∂F/∂(reported F) at true forces (n, 2), (n, 2, 2): the inverse of what central differences give."""
    # step of the central difference over a force, as a part of it (of 1 N at least)
    step = 1e-5 * np.maximum(np.hypot(force[:, 0], force[:, 1]), 1.0)[:, None]
    columns = [
        (reported_force(model, force + step * unit, metadata) - reported_force(model, force - step * unit, metadata))
        / (2 * step)
        for unit in np.eye(2)
    ]
    (a, c), (b, d) = (column.T for column in columns)
    return (np.array([[d, -b], [-c, a]]) / (a * d - b * c)).transpose(2, 0, 1)
