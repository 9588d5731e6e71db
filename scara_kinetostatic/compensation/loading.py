"""The arm under load: torques, place in the dead bands, deflections, for given link angles and force.

**Dead band.** sign(c) in (6) is set-valued at c = 0, and with a force that is known to σ_F only, the sign of a small
torque is not known. Here

    q - q* = p c + g s(c / b) + δ,    s(u) = max(-1, min(u, 1)),

with the band b_i = 3 σ_F ‖J_i‖ + 4 |g_i| f (l1 + l2): the law is (6) wherever the torque exceeds three standard
deviations, and a straight line across the dead band between. So the joint angles are a continuous function of place
and force, the middle of the dead band at c = 0, and they do not jump. The second part of b keeps 1 + (g/b) ∂c/∂q* at
3/4 or more, also where a link is pressed along itself: the equations have one solution, so H̄ and Ḡ are each other's
inverse inside the band, too. The gripper alike: -g_ee s(f / 3 σ_F) n.

What is left out inside the band, the sign, is part of the uncertainty: the variance g²/3 (1 - s²), that of a uniform
distribution over the dead band at its middle, nothing at its edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.noise import Noise

SIGN_KNOWN = 3.0
"""Standard deviations from zero at which the sign of a torque, or the direction of a force, is known."""
STEEPEST = 4.0
"""The band is so many times as wide as what the backlash itself can turn the lever arm."""
_DISC_RADIUS = 0.1
"""Radius of the disc that effects are given as the touched one, m; the tip touches it along the force."""


class Force(NamedTuple):
    """Forces on the object; all (n,).

    Attributes:
        x: F along x, N.
        y: along y, N.
        size: ‖F‖, N.
        nx: direction n along x; 1 where there is no force.
        ny: along y.
        place: s(f / 3 σ_F), place in the dead band of the gripper, 0 to 1.
        std: standard deviation of a component, N.
    """

    x: Floats
    y: Floats
    size: Floats
    nx: Floats
    ny: Floats
    place: Floats
    std: Floats

    @classmethod
    def of(cls, force: Floats, noise: Noise) -> Force:
        """Forces (n, 2), N, that are known as well as those of one touch."""
        x, y = np.ascontiguousarray(force.T)
        size = np.hypot(x, y)
        some = np.where(size > 0, size, 1.0)
        std = np.hypot(noise.force_rms, noise.growth * size)
        return cls(
            x, y, size, np.where(size > 0, x / some, 1.0), y / some, np.minimum(size / (SIGN_KNOWN * std), 1.0), std
        )


class Loading(NamedTuple):
    """The arm at given link angles under a force; all (n,).

    Attributes:
        x1: link 1 along x, m.
        y1: along y.
        x2: link 2 along x, m.
        y2: along y.
        offset_x: S - H(Q*) by the gripper, m.
        offset_y: along y.
        c1: torque of joint 1, Nm.
        c2: of joint 2.
        s1: place of joint 1 in its dead band, -1 to 1.
        s2: of joint 2.
        k1: dq1*-slope of the law, p1 + g1 s'/b1, rad/Nm.
        k2: of joint 2.
    """

    x1: Floats
    y1: Floats
    x2: Floats
    y2: Floats
    offset_x: Floats
    offset_y: Floats
    c1: Floats
    c2: Floats
    s1: Floats
    s2: Floats
    k1: Floats
    k2: Floats

    @property
    def in_band(self) -> Mask:
        """Whether a joint is inside its dead band."""
        return np.asarray((np.abs(self.s1) < 1) | (np.abs(self.s2) < 1))


@dataclass(frozen=True)
class Law:
    """The law of an arm.

    Attributes:
        model: the model, with the effects that are part of H̄ and Ḡ.
        gripper: the form of (7).
        noise: of one touch.
    """

    model: ExtendedModel
    gripper: Gripper
    noise: Noise

    def loading(self, first: Floats, second: Floats, force: Force) -> Loading:
        """The arm with its links at absolute angles `first` and `second`, (n,), rad."""
        p = self.model.parameters
        x1, y1, x2, y2 = p.l1 * np.cos(first), p.l1 * np.sin(first), p.l2 * np.cos(second), p.l2 * np.sin(second)
        along = self.gripper.slope(p) * force.size - p.g_ee * force.place
        offset_x, offset_y, moment = along * force.nx, along * force.ny, np.zeros(1)
        skew = self.gripper.skew(np.arctan2(force.ny, force.nx) - second)
        if skew is not None:  # the force then acts beside the rigid tip, and turns both joints
            normal, tangent = force.size * skew.normal, force.size * skew.tangent
            offset_x = offset_x + normal * force.nx - tangent * force.ny
            offset_y = offset_y + normal * force.ny + tangent * force.nx
            moment = -tangent * force.size
        c2 = x2 * force.y - y2 * force.x + moment
        c1 = x1 * force.y - y1 * force.x + c2
        own = STEEPEST * (p.l1 + p.l2) * force.size
        known = SIGN_KNOWN * force.std
        b1, b2 = known * np.hypot(x1 + x2, y1 + y2) + abs(p.g1) * own, known * p.l2 + abs(p.g2) * own
        u1, u2 = c1 / b1, c2 / b2
        k1, k2 = p.p1 + np.where(np.abs(u1) < 1, p.g1 / b1, 0.0), p.p2 + np.where(np.abs(u2) < 1, p.g2 / b2, 0.0)
        s1, s2 = np.clip(u1, -1.0, 1.0), np.clip(u2, -1.0, 1.0)
        return Loading(x1, y1, x2, y2, offset_x, offset_y, c1, c2, s1, s2, k1, k2)

    def touch_state(self, joints: Floats, at: Loading, force: Force, metadata: TouchMetadata) -> TouchState:
        """The poses as effects take them; `joints` is Q, (n, 2), rad."""
        p = self.model.parameters
        normal = np.array([force.nx, force.ny]).T
        tip = np.array([p.x0 + at.x1 + at.x2 + at.offset_x, p.y0 + at.y1 + at.y2 + at.offset_y]).T
        return TouchState(
            parameters=p,
            joints=joints,
            force=np.array([force.x, force.y]).T,
            magnitude=force.size,
            normal=normal,
            torques=np.array([at.c1, at.c2]).T,
            link1=np.array([at.x1, at.y1]).T / p.l1,
            link2=np.array([at.x2, at.y2]).T / p.l2,
            centers=tip + _DISC_RADIUS * normal,
            radii=np.full(len(normal), _DISC_RADIUS),
            metadata=metadata,
            off_normal=np.zeros(len(normal)),
        )

    def shift(self, at: TouchState, place: Floats) -> tuple[Floats, Floats]:
        """δ, rad, and d, m, by the effects of the robot, (n, 2) each; those by the force fade out with `place`."""
        joints, moved = np.zeros((2, *at.joints.shape))
        for effect, values in zip(self.model.effects, self.model.effect_arrays, strict=True):
            part = faded(effect.shift(at, values), effect.force_dependence, place)
            joints += 0.0 if part.joints is None else part.joints
            moved += 0.0 if part.place is None or effect.on_object else part.place
        return joints, moved


def faded(shift: Shift, dependence: ForceDependence, place: Floats) -> Shift:
    """A shift that depends on the direction of the force, made continuous where there is hardly one.

    Args:
        shift: δ and d.
        dependence: of the effect.
        place: of the gripper in its dead band, (n,), 0 without a force.
    """
    if dependence < ForceDependence.DIRECTION:
        return shift
    weight, joints = place[:, None], shift.joints
    if joints is not None and dependence == ForceDependence.DIRECTION:
        joints = weight * joints
    return Shift(joints, None if shift.place is None else weight * shift.place)
