"""Random poses and the one finite-difference check that all Jacobians go through."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED, Parameters

ROBOTS = (PAPER_ACTUAL, PAPER_MEASURED)
STEPS = np.array([1e-6] * 6 + [1e-9] * 3 + [1e-6] * 3)
"""Step of each parameter: small against its effect's curvature, large against rounding."""


class Poses(NamedTuple):
    tip: np.ndarray
    force: np.ndarray
    posture: np.ndarray
    centers: np.ndarray
    radii: np.ndarray


def random_poses(seed: int, n: int = 300, parameters: Parameters = PAPER_ACTUAL) -> Poses:
    """Loaded touches all over the reachable workspace, away from the stretched and the folded arm."""
    rng = np.random.default_rng(seed)
    reach = rng.uniform(0.1, 0.62, n)
    at, phi = rng.uniform(-np.pi, np.pi, (2, n))
    tip = np.stack([parameters.x0 + reach * np.cos(at), parameters.y0 + reach * np.sin(at)], axis=1)
    normal = np.stack([np.cos(phi), np.sin(phi)], axis=1)
    radii = rng.uniform(0.04, 0.15, n)
    force = rng.uniform(1, 80, n)[:, None] * normal
    return Poses(tip, force, rng.choice([-1, 1], n), tip + radii[:, None] * normal, radii)


def assert_derivative(
    function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, analytic: np.ndarray, steps: np.ndarray
) -> None:
    """Central differences of a function of a vector (k,) against its derivative (n, 2, k).

    Column by column, the error must be below 1e-6 of the column's largest entry, rounding allowed for.
    """
    size = np.abs(function(at)).max()
    for j, step in enumerate(steps):
        change = np.zeros(len(steps))
        change[j] = step
        numeric = (function(at + change) - function(at - change)) / (2 * step)
        scale = np.abs(numeric).max()
        rounding = 4e-13 * size / step
        np.testing.assert_allclose(analytic[..., j], numeric, rtol=0, atol=1e-6 * scale + rounding)
