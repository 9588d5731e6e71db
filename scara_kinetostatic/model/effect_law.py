"""The interface between the model and a physical effect: what an effect reads of a touch, and what it changes.

An effect enters the equations of a touch (`contact`) in one of three places:

- **joints** δ: q - q* = p c + g sign(c) + δ, an error of the encoder, the transmission or the spring;
- **place** d: the equation of the circle becomes H(Q*) + (r + γ) n - S_c + d = 0, a further displacement of the
  tip, or one of the disc, of its radius or of the point of contact;
- **sensor error** e: the sensor reports F + e.

An `EffectLaw`, the base of all effects, gives these three as functions of the state of a touch and of the parameters of
the effect.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import IntEnum
from typing import ClassVar, NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask, pick
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet, torque_phasors


class Parameter(NamedTuple):
    """A parameter of an effect.

    Attributes:
        name: as in the results.
        unit: SI; ``1`` for a pure number.
        scale: largest plausible size; the fit is scaled by it.
        meaning: in a few words.
        start: where the estimation begins.
        typical: a value that matters, for examples and tests; None for a tenth of the scale.
        sign: +1 or -1 where only one sign is physical or can be simulated, else 0.
        is_alias: whether it is exactly a part of L̄: no touch tells it, so a fit without priors holds it; where nobody
            states it, it is 0.
    """

    name: str
    unit: str
    scale: float
    meaning: str
    start: float = 0.0
    typical: float | None = None
    sign: int = 0
    is_alias: bool = False


class TouchMetadata(NamedTuple):
    """What is known of n touches besides Q and F.

    Attributes:
        disc: index of the touched disc, (n,).
        time: middle of the hold, (n,), s.
        approach: each joint's motion in the last movement before the hold, (n, 2), rad.
        posture: +1 or -1, (n,).
        press: the part of `approach` in contact, (n, 2), rad.
        history: the load before each hold, (n, K, 4), as in `TouchSet`, in `frame`; None where nothing is known.
        frame: that of the forces of `history` and `force`.
        force: F of the hold as measured with the history, (n, 2), N; None where that is not known.
        order: place in the order of time, over all recordings, (n,); `LATER` or None for touches after all others.
        surface: number of the touched edge or corner among the surfaces of the cell, (n,); None or -1: not known.
    """

    disc: Indices
    time: Floats
    approach: Floats
    posture: Indices
    press: Floats
    history: Floats | None = None
    frame: SensorFrame = SensorFrame.BASE
    force: Floats | None = None
    order: Indices | None = None
    surface: Indices | None = None

    @classmethod
    def plain(cls, n: int) -> TouchMetadata:
        """Of n touches of which nothing else is known: disc 0, time 0, no motion, posture +1, after all others."""
        still = np.zeros((n, 2))
        return cls(np.zeros(n, dtype=np.intp), np.zeros(n), still, np.ones(n, dtype=np.intp), still)

    @classmethod
    def of(cls, touches: TouchSet, frame: SensorFrame = SensorFrame.BASE) -> TouchMetadata:
        """The metadata of touches, whose forces are in a frame."""
        history = touches.history if touches.history.shape[1] else None
        t = touches
        return cls(t.disc, t.time, t.approach, t.posture, t.press, history, frame, t.force, t.order, t.surface)

    def select(self, which: Mask | Indices | slice) -> TouchMetadata:
        """The touches that a mask, a slice or an array of positions picks."""
        return pick(self, which)


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
        metadata: disc, time, approach, posture, press.
        off_normal: angle from the normal of the disc to the force where it differs from touch to touch, (n,), rad.
        tangents: unit vector along the straight edge that is touched, (n, 2), zero on arcs; None for arcs alone.
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
    tangents: Floats | None = None

    @classmethod
    def of_poses(
        cls,
        parameters: Parameters,
        joints: Floats,
        force: Floats,
        torques: Floats,
        links: tuple[Floats, Floats],
        tip: Floats,
        metadata: TouchMetadata,
    ) -> TouchState:
        """Poses under a force as if each touched a disc of 0.1 m, its normal along the force.

        Args:
            parameters: L̄.
            joints: Q, (n, 2), rad.
            force: F on the object, base frame, (n, 2), N.
            torques: C, (n, 2), Nm.
            links: both links as vectors in the base frame, (n, 2) each, m.
            tip: S, (n, 2), m.
            metadata: of the poses.
        """
        magnitude, radii, still = np.hypot(*force.T), np.full(len(force), 0.1), np.zeros(len(force))
        normal = np.where(magnitude[:, None] > 0, force, (1.0, 0.0)) / np.where(magnitude > 0, magnitude, 1.0)[:, None]
        link1, link2 = links[0] / parameters.l1, links[1] / parameters.l2
        centers = tip + radii[:, None] * normal
        return cls(parameters, joints, force, magnitude, normal, torques, link1, link2, centers, radii, metadata, still)

    @property
    def tangent(self) -> Floats:
        """T = R90 n, (n, 2)."""
        return np.array([-self.normal[:, 1], self.normal[:, 0]]).T

    @property
    def along_edge(self) -> Floats:
        """Place of the rigid tip along the straight edge from its middle, (n,), m; 0 on an arc."""
        if self.tangents is None:
            return np.zeros(len(self.radii))
        p = self.parameters
        off = p.l1 * self.link1 + p.l2 * self.link2 + (p.x0, p.y0) - self.centers
        return np.asarray((off * self.tangents).sum(axis=1))

    def across_edges(self, vectors: Floats) -> Floats:
        """Displacements (n, 2) as they count as `Shift.place`: along a straight edge the object has no place."""
        if self.tangents is None:
            return vectors
        return np.asarray(vectors - (vectors * self.tangents).sum(axis=1)[:, None] * self.tangents)

    def history_torques(self, joint: int) -> Floats:
        """C of joint 0 or 1 at the turning points of the load before the hold, (n, K), Nm; K = 0 where none are known.

        An error of the force that is in all of a touch is in its preload and in its hold alike. So the forces of a
        preload are those measured, turned and stretched as the force of the hold here is from the measured one.
        """
        m = self.metadata
        if m.history is None:
            return np.empty((len(self.joints), 0))
        torques = torque_phasors(self.parameters, m.history, m.frame)[joint]
        if m.force is None:
            return torques.imag
        force = self.force[:, 0] + 1j * self.force[:, 1]
        if m.frame is SensorFrame.TOOL:
            force = force * (self.link2[:, 0] - 1j * self.link2[:, 1])
        known = m.force.any(axis=1)
        ratio = np.where(known, force, 1.0) / np.where(known, m.force[:, 0] + 1j * m.force[:, 1], 1.0)
        # distance from the joint angles of the hold within which a point of the history is of the same touch, rad
        near1, near2 = (np.abs(m.history[:, :, k] - self.joints[:, k, None]) < 0.02 for k in (0, 1))
        return (torques * np.where(near1 & near2, ratio[:, None], 1.0)).imag


class Shift(NamedTuple):
    """What an effect adds to the equations of n touches; None for nothing.

    Attributes:
        joints: δ, (n, 2), rad.
        place: d, base frame, (n, 2), m; of a displacement the part `TouchState.across_edges`: what is along a straight
            edge turns its normal, by d/r.
    """

    joints: Floats | None = None
    place: Floats | None = None


class ForceDependence(IntEnum):
    """What of the force of a touch the shift of an effect depends on, the least first.

    The torques depend on both, the directions of the links, the disc and all metadata on neither.
    """

    NONE = 0
    """On nothing: the shift is the same under any force."""
    DIRECTION = 1
    """On its direction φ, or its off-normal angle, but not on its magnitude f."""
    ALL = 2
    """On its magnitude as well."""


class EffectLaw(ABC):
    """What the model needs of an effect.

    Attributes:
        parameters: what is to be estimated.
        on_object: whether `Shift.place` belongs to the object rather than to the robot: then it is no part of H̄ and Ḡ.
        force_dependence: what of the force of a touch the shift depends on; unless stated, on all of it. Where it is
            less, fits are faster.
        is_smooth: whether the shift has a derivative everywhere, over the state of a touch and over the parameters.
        grid_parameter: the parameter that is searched on a grid, such as a frequency; empty if there is none.
        is_stepwise: whether it changes in steps along `grid_parameter`: a fit holds it at the best trial, and its
            uncertainty is that of the choice among the trials.
        is_undetected: whether it stands for errors too small to be named.
        scaled_by: names of those parameters of L̄, such as ``p1``, that the shift is proportional to.
    """

    parameters: ClassVar[tuple[Parameter, ...]]
    on_object: ClassVar[bool] = False
    force_dependence: ClassVar[ForceDependence] = ForceDependence.ALL
    is_smooth: ClassVar[bool] = True
    grid_parameter: ClassVar[str] = ''
    is_stepwise: ClassVar[bool] = False
    is_undetected: ClassVar[bool] = False
    scaled_by: ClassVar[tuple[str, ...]] = ()

    @property
    @abstractmethod
    def label(self) -> str:
        """Name and target, such as ``encoder_gain[joint1]``."""

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the off-normal angle of the force, if the effect lets it differ from touch to touch,
        rad.
        """
        return 0.0

    def with_off_normal_std(self, std: float) -> EffectLaw:
        """The same effect with another `off_normal_std`; itself where it has none."""
        return self

    @abstractmethod
    def shift(self, at: TouchState, values: Floats) -> Shift:
        """δ and d at n touches for values (k,) of the parameters."""

    @abstractmethod
    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        """The derivatives of `shift`, one per parameter."""

    def amplitudes(self, values: Floats) -> Floats:
        """The values (k,), zero where they are the form of the effect, such as a phase, rather than its size: what its
        derivatives, times these, add up to is the effect to first order.
        """
        return values

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats | None:
        """The error e for true forces (n, 2) in the sensor's frame, N; None unless the effect is one of the sensor.

        `metadata` is that of the touches; None where nothing is known of them.
        """
        return None

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        """The derivatives of `sensor_error`, one per parameter; empty for effects that do not change it."""
        return ()
