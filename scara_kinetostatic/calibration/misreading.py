"""What an error of the force sensor does to the conditions of a touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.extension import Extension
from scara_kinetostatic.model.parameters import Parameters

Floats = NDArray[np.float64]

READING_STEP = 1e-5
"""Step of the central difference over a force, as a part of it."""


def misread(extension: Extension, parameters: Parameters, reported: Floats, by_reported: Floats) -> Floats:
    """What misread forces do to h by the parameters of the effects, (n, 2, k).

    The true force behind a reported one moves by -∂F/∂(reported F) ∂e.

    Args:
        extension: the effects.
        parameters: L̄.
        reported: forces, (n, 2), N.
        by_reported: ∂h by the reported force, along and across it, (n, 2, 2).
    """
    columns, force = [], extension.unread(parameters, reported)
    for error in extension.reading_derivative(parameters, force):
        error = np.zeros_like(force) if error is None else error
        columns.append(-np.einsum('nij,nj->ni', by_reported, along_and_across(error, reported)))
    return np.stack(columns, axis=-1)


def unreading(extension: Extension, parameters: Parameters, reported: Floats) -> Floats:
    """∂F/∂(reported F), (n, 2, 2), each in components along and across itself.

    It is the inverse of ∂(reported F)/∂F, which is worked out by central differences.
    """
    force = extension.unread(parameters, reported)
    size = np.hypot(force[:, 0], force[:, 1])[:, None]
    along = force / size
    columns = []
    for direction in (along, np.stack([-along[:, 1], along[:, 0]], axis=-1)):
        step = READING_STEP * size * direction
        up, down = (extension.read(parameters, force + sign * step) for sign in (1, -1))
        columns.append(along_and_across((up - down) / (2 * READING_STEP * size), reported))
    (a, c), (b, d) = (column.T for column in columns)
    inverse = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return np.asarray(inverse / (a * d - b * c)[:, None, None])


def along_and_across(vectors: Floats, force: Floats) -> Floats:
    """Components of vectors (n, 2) along and across forces (n, 2)."""
    x, y = np.moveaxis(force / np.hypot(force[:, 0], force[:, 1])[:, None], -1, 0)
    return np.stack([vectors[:, 0] * x + vectors[:, 1] * y, vectors[:, 1] * x - vectors[:, 0] * y], axis=-1)
