"""A measured contour: points of the surface with their normals and uncertainties, and the outlines that they make."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scara_kinetostatic.contour.friction import Friction
from scara_kinetostatic.contour.joining import Outline, Stretch, join_passes
from scara_kinetostatic.model.arrays import Floats, Indices, Mask


@dataclass(frozen=True)
class Contour:
    """The surface along which a tip slid, at n instants in the order of time.

    Attributes:
        source: the recording.
        time: since the first stamp of the recording, (n,), s.
        surface: points of the surface, (n, 2), m, base frame.
        normal: outward unit vectors, (n, 2).
        std_systematic: standard uncertainty along the normal by the calibration and the tip, common to neighbouring
            points, (n,), m; NaN where the calibration does not determine it.
        std_noise: that of a point by the noise of the measurement and by its normal, (n,), m.
        force: F of the tip on the object, base frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        tip: centre of the tip, (n, 2), m.
        passes: number of the pass, (n,).
        by_model: change along the normal by each value of the model, (n, 12 + k).
        by_noise: change along the normal by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 4), m.
        friction: what the forces say of friction.
        off_normal: angle from the inward normal to the force, towards the direction of travel, (n,), rad.
        inner_corner: whether the surface is hollow there and hardly wider than the tip, (n,): the tip touches on both
            sides, and the outline has its radius.
        force_noise: standard deviation of a component of the smoothed force besides the noise of a touch, N.
        tip_radius: m.
        zero: what the sensor reports without force, as it was taken for the last contact, (2,), N.
        lost: time without contact between the first and the last contact, s.
        stuck: time in contact without sliding, s.
        warnings: one sentence each.

    Example:
        >>> import scara_kinetostatic as sk
        >>> arm = sk.CalibratedArm.of_outcome(sk.diagnose('touches.csv', sk.load_cell('cell.yaml')))
        >>> contour = sk.trace_contour('slide.mcap', arm)
        >>> contour.surface.shape == contour.normal.shape == (len(contour), 2)
        True
        >>> bool((contour.std_normal < 2e-5).all())
        True
    """

    source: str
    time: Floats
    surface: Floats
    normal: Floats
    std_systematic: Floats
    std_noise: Floats
    force: Floats
    joints: Floats
    tip: Floats
    passes: Indices
    by_model: Floats
    by_noise: Floats
    friction: Friction
    off_normal: Floats
    inner_corner: Mask
    force_noise: float
    tip_radius: float
    zero: Floats
    lost: float
    stuck: float
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def std_normal(self) -> Floats:
        """Standard uncertainty along the normal, (n,), m; NaN where the calibration does not determine it."""
        return np.hypot(self.std_systematic, self.std_noise)

    def stretch(self, which: Mask | Indices) -> Stretch:
        """The points that a mask or an array of positions picks, as a part of a pass."""
        return Stretch(self.surface[which], self.normal[which], self.std_normal[which], self.std_noise[which])

    @cached_property
    def outlines(self) -> tuple[Outline, ...]:
        """The passes joined, the longest first."""
        return join_passes([self.stretch(self.passes == k) for k in range(int(self.passes.max()) + 1)])
