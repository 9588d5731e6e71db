"""The same slide seen with less of the model: what the calibration and the compensation of the deflection are worth.

The joint angles, the normals and the radius of the tip are the same; what differs is the place of the tip's centre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.tip import tip_places
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import forward


class Surfaces(NamedTuple):
    """The surface by models that take more and more into account, (n, 2) each, m.

    Attributes:
        rigid_nominal: H of the nominal parameters.
        rigid_calibrated: H of the calibrated parameters, without deflection.
        deformable_calibrated: H̄ of the calibrated parameters.
    """

    rigid_nominal: Floats
    rigid_calibrated: Floats
    deformable_calibrated: Floats


def surfaces_of(contour: Contour, arm: CalibratedArm) -> Surfaces:
    """The surface of a contour by each model.

    Args:
        contour: joint angles, forces and normals.
        arm: the arm; its model with the effects that were found.
    """
    removed = contour.tip_radius * contour.normal
    return Surfaces(
        forward(arm.cell.nominal, contour.joints) - removed,
        forward(arm.model.parameters, contour.joints) - removed,
        tip_places(arm, contour.joints, contour.force, contour.force_noise).center - removed,
    )


def shifts_along_normal(contour: Contour, surfaces: Surfaces) -> tuple[Floats, ...]:
    """How far each surface is from that of the contour along its normal, (n,) each, m; positive outside."""
    return tuple(np.einsum('ni,ni->n', surface - contour.surface, contour.normal) for surface in surfaces)
