"""What an error of the force sensor does to the conditions of a touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.extension import Extension
from scara_kinetostatic.model.parameters import Parameters

Floats = NDArray[np.float64]


def sensor_error_columns(extension: Extension, parameters: Parameters, reported: Floats, by_reported: Floats) -> Floats:
    """What misread forces do to h by the parameters of the effects, (n, 2, k).

    The true force behind a reported one moves by -∂F/∂(reported F) ∂e.

    Args:
        extension: the effects.
        parameters: L̄.
        reported: forces, (n, 2), N.
        by_reported: ∂h by the reported force, along and across it, (n, 2, 2).
    """
    columns, force = [], extension.true_force(parameters, reported)
    for error in extension.sensor_error_derivative(parameters, force):
        error = np.zeros_like(force) if error is None else error
        columns.append(-np.einsum('nij,nj->ni', by_reported, along_and_across(error, reported)))
    return np.stack(columns, axis=-1)


def true_force_derivative(extension: Extension, parameters: Parameters, reported: Floats) -> Floats:
    """∂F/∂(reported F), (n, 2, 2), each in components along and across itself."""
    force = extension.true_force(parameters, reported)
    matrix = extension.true_force_derivative(parameters, force)
    unit = reported / np.hypot(reported[:, 0], reported[:, 1])[:, None]
    columns = [matrix @ unit[:, :, None], matrix @ np.stack([-unit[:, 1], unit[:, 0]], axis=-1)[:, :, None]]
    return np.stack([along_and_across(column[:, :, 0], force) for column in columns], axis=-1)


def along_and_across(vectors: Floats, force: Floats) -> Floats:
    """Components of vectors (n, 2) along and across forces (n, 2)."""
    x, y = np.moveaxis(force / np.hypot(force[:, 0], force[:, 1])[:, None], -1, 0)
    return np.stack([vectors[:, 0] * x + vectors[:, 1] * y, vectors[:, 1] * x - vectors[:, 0] * y], axis=-1)
