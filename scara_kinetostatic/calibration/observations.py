"""What n touches measured and where: the data of the adjustment."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.contact import ContactProblem
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.gripper import Gripper

NO_ERRORS = np.zeros(0)
NO_ERRORS.setflags(write=False)


class Observations(NamedTuple):
    """What n touches measured and where: the data of the adjustment.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object in the sensor's frame, (n, 2), N.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        frame: the sensor's frame.
        gripper: the form of (7).
        metadata: what effects need to know besides; None where there are no effects.
        declared: the errors of the cell description within their uncertainties; None where all is exactly known.
        errors: their values, (m,), for which force, centres and radii here are corrected.
        reported: force as the sensor reported it, (n, 2), N; None without declared errors.
    """

    joints: Floats
    force: Floats
    centers: Floats
    radii: Floats
    frame: SensorFrame
    gripper: Gripper
    metadata: TouchMetadata | None = None
    declared: DeclaredErrors | None = None
    errors: Floats = NO_ERRORS
    reported: Floats | None = None

    def with_errors(self, errors: Floats) -> Observations:
        """The same touches in a cell with these declared errors, (m,)."""
        if self.declared is None:
            return self
        assert self.metadata is not None
        assert self.reported is not None
        disc = self.metadata.disc
        return self._replace(
            force=self.declared.true_force(self.reported, errors),
            centers=self.declared.centers(errors)[disc],
            radii=self.declared.radii(errors)[disc],
            errors=errors,
        )

    def as_stated(self) -> Observations:
        """The same touches where all that the cell description says counts as exactly known."""
        return self._replace(declared=None, errors=NO_ERRORS, reported=None)

    def select(self, which: Any) -> Observations:
        """The touches that a mask, a slice or an array of positions picks."""
        metadata = None if self.metadata is None else self.metadata.select(which)
        return self._replace(
            joints=self.joints[which],
            force=self.force[which],
            centers=self.centers[which],
            radii=self.radii[which],
            metadata=metadata,
            reported=None if self.reported is None else self.reported[which],
        )

    def contact_problem(self, joints: Floats, off_normal: Floats | None = None) -> ContactProblem:
        """The touches at joint angles (n, 2), rad, and off-normal angles (n,), rad, as the equations take them."""
        return ContactProblem(joints, self.centers, self.radii, self.gripper, self.metadata, off_normal)
