"""Bounded least squares for laws with kinks, the same on every machine.

Where the sum of squares has a kink (slip sets in at one sample more), Gauss-Newton steps end; steps along single
parameters lead out of it. Parameters that the data leave open would follow the rounding errors; a small penalty keeps
them at their start. Sums of squares that differ by rounding are equal: the first counts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from scara_kinetostatic.model.arrays import Floats


def minimise(
    residual: Callable[[Floats], Floats],
    jacobian: Callable[[Floats], Floats],
    first: Floats,
    bounds: tuple[Floats, Floats],
    penalty: float | Floats,
    evaluations: int = 60,
) -> Floats:
    """The parameters of the least sum of squares near a starting point.

    Args:
        residual: of the parameters, which are scaled to the order of 1.
        jacobian: its derivatives.
        first: the starting point.
        bounds: least and largest values.
        penalty: of a change of a parameter by 1 from its start, over the norm of the residual there.
        evaluations: largest number in the Gauss-Newton steps.
    """
    inside = np.clip(first, bounds[0] + 1e-9, bounds[1] - 1e-9)
    scale = float(np.linalg.norm(residual(inside))) or 1.0
    weight = np.diag(np.broadcast_to(penalty, inside.shape))
    found = least_squares(
        lambda scaled: np.concatenate([residual(scaled) / scale, weight @ (scaled - inside)]),
        inside,
        lambda scaled: np.concatenate([jacobian(scaled) / scale, weight]),
        bounds=bounds,
        x_scale='jac',
        max_nfev=evaluations,
        ftol=1e-9,
        xtol=1e-9,
        gtol=None,
    )
    return np.asarray(found.x)


def out_of_kinks(
    residual: Callable[[Floats], Floats], scaled: Floats, bounds: tuple[Floats, Floats], gain: float = 1e-9
) -> Floats:
    """Steps along single parameters as long as they gain a share of the sum of squares, the largest first."""
    square, step = float(np.sum(residual(scaled) ** 2)), 1e-2
    for _ in range(20):
        before = square
        for change in step * np.concatenate([np.eye(len(scaled)), -np.eye(len(scaled))]):
            tried = np.clip(scaled + change, *bounds)
            new = float(np.sum(residual(tried) ** 2))
            if new < square * (1 - gain):
                scaled, square = tried, new
        step = step / 4 if square == before else step
    return scaled


def first_least(squares: Sequence[float], rounding: float = 1e-6) -> int:
    """Index of the first of the sums of squares that are the least but for this share of it."""
    return int(np.argmax(np.asarray(squares) <= min(squares) * (1 + rounding)))
