"""What a physical effect is to the equations of a touch: a law, and the words in which it speaks.

Whatever an effect does, the equations (`equations`) feel it in one of three places:

- **joints** δ: q - q* = p c + g sign(c) + δ, an error of the encoder, the transmission or the spring;
- **place** d: the equation of the circle becomes H(Q*) + (r + γ) n - S_c + d = 0: the tip gives way further, or
  the disc does, is elsewhere, has another radius, or is not touched along the force;
- **reading** e: the sensor reports F + e.

So an effect is a `Law`: these three as functions of the situation of a touch and of the effect's own parameters.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet

Floats = NDArray[np.float64]


class TouchMetadata(NamedTuple):
    """What else is known of n touches.

    Attributes:
        disc: index of the touched disc, (n,).
        time: middle of the hold, (n,), s.
        approach: each joint's motion in the last movement before the hold, (n, 2), rad.
        posture: +1 or -1, (n,).
        press: the part of `approach` in contact, (n, 2), rad.
    """

    disc: NDArray[np.intp]
    time: Floats
    approach: Floats
    posture: NDArray[np.intp]
    press: Floats

    @classmethod
    def plain(cls, n: int) -> TouchMetadata:
        """Of n touches about which nothing is known."""
        still = np.zeros((n, 2))
        return cls(np.zeros(n, dtype=np.intp), np.zeros(n), still, np.ones(n, dtype=np.intp), still)

    @classmethod
    def of(cls, touches: TouchSet) -> TouchMetadata:
        """Those of touches."""
        return cls(touches.disc, touches.time, touches.approach, touches.posture, touches.press)

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> TouchMetadata:
        """The touches that a mask or an array of positions picks."""
        return TouchMetadata(
            self.disc[which], self.time[which], self.approach[which], self.posture[which], self.press[which]
        )


class TouchState(NamedTuple):
    """All that an effect may depend on, at n touches.

    Attributes:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        magnitude: f, (n,), N; negative in the continuation to a tip that pulls.
        normal: n, the direction of the force, (n, 2).
        torques: C, (n, 2), Nm.
        link1: direction of link 1 in the base frame, a unit vector, (n, 2).
        link2: the same of link 2.
        centers: centre of the touched disc, (n, 2), m.
        radii: its radius, (n,), m.
        tags: disc, time, approach, posture.
        lean: angle from the normal of the disc to the force where it differs from touch to touch, (n,), rad.
    """

    parameters: Parameters
    joints: Floats
    force: Floats
    magnitude: Floats
    normal: Floats
    torques: Floats
    link1: Floats
    link2: Floats
    centers: Floats
    radii: Floats
    metadata: TouchMetadata
    off_normal: Floats

    @property
    def tangent(self) -> Floats:
        """T = R90 n, (n, 2)."""
        return np.stack([-self.normal[:, 1], self.normal[:, 0]], axis=-1)


class Shift(NamedTuple):
    """What an effect does at n touches; None for nothing.

    Attributes:
        joints: δ, (n, 2), rad.
        place: d, base frame, (n, 2), m.
    """

    joints: Floats | None = None
    place: Floats | None = None


class Law(Protocol):
    """What the model asks of an effect."""

    @property
    def scales(self) -> tuple[float, ...]:
        """Plausible size of each parameter, in its unit."""

    @property
    def start(self) -> tuple[float, ...]:
        """Where the estimation of each parameter begins."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Each parameter's name with the effect's, such as ``encoder_gain[joint1].gain``."""

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the lean of the force, which differs from touch to touch, rad; 0 for most effects."""

    @property
    def on_object(self) -> bool:
        """Whether `place` belongs to the object rather than to the robot: then H̄ and Ḡ do not see it."""

    @property
    def scaled_by(self) -> tuple[str, ...]:
        """Names of the parameters of the robot, such as ``p1``, that the shift is proportional to."""

    def shift(self, at: TouchState, values: Floats) -> Shift:
        """δ and d at n touches for values (k,) of the effect's parameters."""

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        """The derivatives of δ and d, one per parameter."""

    def amplitudes(self, values: Floats) -> Floats:
        """The values, zero where they say how the effect is rather than how strong."""

    def sensor_error(self, force: Floats, values: Floats) -> Floats | None:
        """The error e for true forces (n, 2) in the sensor's frame, N; None if it is not an effect of the sensor."""

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        """The derivatives of e, one per parameter; none if it is not an effect of the sensor."""
