"""Contact friction of a slide: the angle from the normal of the surface to the force, in the direction of travel.

With Coulomb friction the tip pushes the object along its travel with μ N, so that the angle is atan μ whatever the
direction. A force sensor that is turned by ρ, counter-clockwise, adds ρ where travel is clockwise about the object, -ρ
else: travel in both directions separates the two, travel in one direction does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices


class Friction(NamedTuple):
    """What the forces of a slide say of friction.

    Attributes:
        coefficient: μ; NaN where nothing is known.
        std: its standard uncertainty.
        rotation: apparent rotation of the force sensor, rad; NaN where travel is in one direction only.
        rotation_std: its standard uncertainty, rad.
        both_directions: whether there is travel in both directions about the object.
    """

    coefficient: float
    std: float
    rotation: float
    rotation_std: float
    both_directions: bool


def off_normal_angle(force: Floats, normal: Floats, along: Floats) -> Floats:
    """Angle from the inward normal to the force, positive towards the direction of travel, (n,), rad."""
    return np.asarray(np.arctan2((force * along).sum(axis=1), -(force * normal).sum(axis=1)))


def estimate_friction(
    force: Floats, normal: Floats, along: Floats, passes: Indices, angle_std: float, sensor_std: float
) -> Friction:
    """The coefficient of friction and, if possible, the rotation of the force sensor.

    Args:
        force: F on the object, (n, 2), N.
        normal: outward, (n, 2).
        along: direction of travel, (n, 2).
        passes: number of the pass, (n,).
        angle_std: standard deviation of the angle of the force in one pass, by its noise, rad.
        sensor_std: declared standard uncertainty of the rotation of the sensor, rad.
    """
    angle = off_normal_angle(force, normal, along)
    sense = np.sign(normal[:, 0] * along[:, 1] - normal[:, 1] * along[:, 0])
    means: dict[int, list[float]] = {1: [], -1: []}
    for number in np.unique(passes):
        here = passes == number
        means[1 if sense[here].sum() > 0 else -1].append(float(np.median(angle[here])))
    stds = {way: angle_std / np.sqrt(len(found)) for way, found in means.items() if found}
    if len(stds) == 2:
        ahead, back = (float(np.mean(means[way])) for way in (1, -1))
        std = 0.5 * float(np.hypot(stds[1], stds[-1]))
        turn = 0.5 * (ahead + back)
        return Friction(float(np.tan(turn)), std / np.cos(turn) ** 2, 0.5 * (back - ahead), std, True)
    ((way, std),) = stds.items()
    turn = float(np.mean(means[way]))
    return Friction(float(np.tan(turn)), float(np.hypot(std, sensor_std)) / np.cos(turn) ** 2, np.nan, np.nan, False)
