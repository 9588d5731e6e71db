"""Touches adjusted to a given L̄: how far each is from what the model allows."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.blocks import in_blocks, pick
from scara_kinetostatic.calibration.fit_point import COARSE, Point, evaluate
from scara_kinetostatic.calibration.gauss_helmert import Adjusted, adjust, as_radial, first_guess
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import ExtendedModel

_ROUNDS = 5
"""Rounds that suffice for forces along the normal; with an off-normal angle in each touch some touches need more."""
_MOST_ROUNDS = 20
_CONVERGED = 1e-3


def turn_radial(observations: Observations, point: Point) -> Adjusted:
    """The observations as measured but for the direction of the force, which is made radial.

    From here the adjustment proper can start: measured directions are not good enough to linearise at.
    """

    def part(where: slice) -> Adjusted:
        return as_radial(observations.select(where), point.model, pick(point.adjusted.state, where))

    with np.errstate(all='ignore'):
        return in_blocks(len(observations.joints), part)


def project(observations: Observations, model: ExtendedModel, noise: Noise) -> Point:
    """Adjust the observations alone, L̄ held: the nearest point of the model to each touch.

    Args:
        observations: any touches, good or bad.
        model: the model.
        noise: σ_q and σ_f, the measure of distance.
    """
    with np.errstate(all='ignore'):
        point = evaluate(observations, model, first_guess(observations, model), noise, COARSE)
        adjusted, arm = turn_radial(observations, point), None
        before = np.full(len(observations.joints), np.inf)
        for number in range(_MOST_ROUNDS):
            point = evaluate(observations, model, adjusted, noise, arm=arm)
            if number >= _ROUNDS and not np.any(np.abs(point.distance - before) > _CONVERGED * (1 + point.distance)):
                return point
            before = point.distance
            still = np.zeros(point.whitened.derivative.shape[2] + len(observations.errors))
            adjusted, arm = adjust(observations, model, point.adjusted, point.linear, point.whitened, still, noise)
        return evaluate(observations, model, adjusted, noise, arm=arm)
