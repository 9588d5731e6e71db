"""The gripper's law (7): isotropic, or with any compliance matrix in the frame of link 2.

    S - S* = -(Rᵀ)(p_ee I + E) R F - g_ee F/‖F‖        (physical; the paper prints + for -)

with R turning the base frame into that of link 2 and E the excess over the isotropic compliance,
P = p_ee I + E = [p11 p12; p21 p22]. With n the direction of the force, t = R90 n and χ its angle from link 2, the
general part moves the tip by s f (κ_n n + κ_t t), κ_n = nᵀE n, κ_t = tᵀE n, s = -1 or, printed, +1. The
force then acts beside the rigid tip, so both its lever arms change by -s f κ_t.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import Parameters


class GripperSign(str, Enum):
    """Sign of the gripper law (7): as physics has it, or as the paper printed it."""

    PHYSICAL = 'physical'
    PAPER = 'paper'


class Skew(NamedTuple):
    """The general part of the law at n touches, per newton; (n,) each.

    Attributes:
        normal: s κ_n, m/N.
        tangent: s κ_t, m/N.
        normal_turn: s dκ_n/dχ, m/N.
        tangent_turn: s dκ_t/dχ, m/N.
    """

    normal: Floats
    tangent: Floats
    normal_turn: Floats
    tangent_turn: Floats


@dataclass(frozen=True)
class Gripper:
    """Which form of (7) holds.

    Attributes:
        sign: as physics has it, or as the paper printed it.
        excess: E = P - p_ee I in the frame of link 2 (x along it), by rows, m/N.

    Raises:
        ParameterError: the excess is not a finite 2×2 matrix.
    """

    sign: GripperSign = GripperSign.PHYSICAL
    excess: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))

    def __post_init__(self) -> None:
        matrix = np.asarray(self.excess, dtype=float)
        if matrix.shape != (2, 2) or not np.isfinite(matrix).all():
            raise ParameterError('gripper compliance', f'expected a finite 2×2 matrix, got {self.excess!r}')

    @property
    def isotropic(self) -> bool:
        """Whether the excess is zero."""
        return not any(map(any, self.excess))

    @property
    def factor(self) -> float:
        """The sign s of the elastic part: -1, or +1 as printed."""
        return 1.0 if self.sign is GripperSign.PAPER else -1.0

    def slope(self, parameters: Parameters) -> float:
        """Stretch along n per newton of the isotropic part, dγ/df, m/N."""
        return self.factor * parameters.p_ee

    def stretch(self, parameters: Parameters, magnitude: Floats) -> Floats:
        """γ = s p_ee f - g_ee, the isotropic part of S - S* along n, (n,), m.

        For f < 0, the continuation to a tip that pulls at the disc, it stays the same straight line.
        """
        return self.slope(parameters) * magnitude - parameters.g_ee

    def skew(self, angle: Floats) -> Skew | None:
        """The general part for forces at angles χ from link 2, (n,), rad; None where there is none."""
        if self.isotropic:
            return None
        (e11, e12), (e21, e22) = self.excess
        c, s = np.cos(angle), np.sin(angle)
        turning = -e11 * c * s - e12 * s * s + e21 * c * c + e22 * c * s
        other = -e11 * c * s + e12 * c * c - e21 * s * s + e22 * c * s
        normal = e11 * c * c + (e12 + e21) * c * s + e22 * s * s
        across = e11 * s * s - (e12 + e21) * c * s + e22 * c * c
        k = self.factor
        return Skew(k * normal, k * turning, k * (turning + other), k * (across - normal))

    def deflection(self, parameters: Parameters, force: Floats, link2: Floats) -> Floats:
        """S - S* under forces in the base frame; zero, the middle of the dead band, where there is none.

        Args:
            parameters: L̄.
            force: F on the object, (n, 2), N.
            link2: angle of link 2 in the base frame, (n,), rad.

        Returns:
            (n, 2), m.
        """
        magnitude = np.hypot(force[..., 0], force[..., 1])
        loaded = magnitude > 0
        unit = force / np.where(loaded, magnitude, 1.0)[..., None]
        out = unit * self.stretch(parameters, magnitude)[..., None]
        skew = self.skew(np.arctan2(force[..., 1], force[..., 0]) - link2)
        if skew is not None:
            across = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
            out = out + (magnitude * skew.normal)[..., None] * unit + (magnitude * skew.tangent)[..., None] * across
        return np.asarray(out)


def as_gripper(gripper: Gripper | GripperSign) -> Gripper:
    """A bare sign is the isotropic gripper with that sign."""
    return gripper if isinstance(gripper, Gripper) else Gripper(gripper)
