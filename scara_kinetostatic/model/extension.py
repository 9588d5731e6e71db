"""Physical effects beyond the twelve parameters, as the equations of a touch see them.

Whatever an effect does, the equations (`equations`) feel it in one of three places:

- **joints** δ: q - q* = p c + g sign(c) + δ, an error of the encoder, the transmission or the spring;
- **place** d: the equation of the circle becomes H(Q*) + (r + γ) n - S_c + d = 0: the tip gives way further, or
  the disc does, is elsewhere, has another radius, or is not touched along the force;
- **reading** e: the sensor reports F + e.

So an effect is a `Law`: these three as functions of the situation of a touch and of the effect's own
parameters. Its parameters stand behind the twelve in L̄ (`Parameters.extra`), law by law.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.state import State
from scara_kinetostatic.model.statics import view_arm
from scara_kinetostatic.model.touch import TouchSet

Floats = NDArray[np.float64]

FORCE_STEP = 1e-4
"""Step of the central difference over the force, as a part of it (of 1 N at least)."""
TURN_STEP = 1e-5
ROBOT_STEP = 1e-6
"""Step of the central difference over a parameter of the robot, in its unit; the shift is linear in it."""
READING_PASSES = 8


class Tags(NamedTuple):
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
    def plain(cls, n: int) -> Tags:
        """Of n touches about which nothing is known."""
        still = np.zeros((n, 2))
        return cls(np.zeros(n, dtype=np.intp), np.zeros(n), still, np.ones(n, dtype=np.intp), still)

    @classmethod
    def of(cls, touches: TouchSet) -> Tags:
        """Those of touches."""
        return cls(touches.disc, touches.time, touches.approach, touches.posture, touches.press)

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Tags:
        """The touches that a mask or an array of positions picks."""
        return Tags(self.disc[which], self.time[which], self.approach[which], self.posture[which], self.press[which])


class Situation(NamedTuple):
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
    tags: Tags
    lean: Floats

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
    def spread(self) -> float:
        """Standard deviation of the lean of the force, which differs from touch to touch, rad; 0 for most effects."""

    @property
    def on_object(self) -> bool:
        """Whether `place` belongs to the object rather than to the robot: then H̄ and Ḡ do not see it."""

    @property
    def scaled_by(self) -> tuple[str, ...]:
        """Names of the parameters of the robot, such as ``p1``, that the shift is proportional to."""

    def shift(self, at: Situation, values: Floats) -> Shift:
        """δ and d at n touches for values (k,) of the effect's parameters."""

    def derivative(self, at: Situation, values: Floats) -> tuple[Shift, ...]:
        """The derivatives of δ and d, one per parameter."""

    def strength(self, values: Floats) -> Floats:
        """The values, zero where they say how the effect is rather than how strong."""

    def reading(self, force: Floats, values: Floats) -> Floats | None:
        """The error e for true forces (n, 2) in the sensor's frame, N; None if it is not an effect of the sensor."""

    def reading_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        """The derivatives of e, one per parameter; none if it is not an effect of the sensor."""


class Extension(NamedTuple):
    """The laws that extend the model, with what they need to know of n touches."""

    laws: tuple[Law, ...]
    tags: Tags

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Extension:
        """The touches that a mask or an array of positions picks."""
        return Extension(self.laws, self.tags.select(which))

    def values(self, parameters: Parameters) -> list[Floats]:
        """Each law's part of L̄."""
        return split(self.laws, parameters)

    def shift(self, at: Situation, robot_only: bool = False) -> tuple[Floats, Floats]:
        """δ and d of all laws together, (n, 2) each."""
        joints, place = np.zeros_like(at.joints), np.zeros_like(at.joints)
        for law, values in zip(self.laws, self.values(at.parameters), strict=True):
            part = law.shift(at, values)
            if part.joints is not None:
                joints = joints + part.joints
            if part.place is not None and not (robot_only and law.on_object):
                place = place + part.place
        return joints, place

    def by_robot(self, at: Situation) -> dict[str, Shift]:
        """The derivatives of δ and d by the parameters of the robot that scale them, by central differences."""
        found = {}
        for name in dict.fromkeys(name for law in self.laws for name in law.scaled_by):
            value = getattr(at.parameters, name)
            up, down = (
                self.shift(at._replace(parameters=at.parameters.replace(**{name: value + sign * ROBOT_STEP})))
                for sign in (1, -1)
            )
            found[name] = Shift(*((a - b) / (2 * ROBOT_STEP) for a, b in zip(up, down, strict=True)))
        return found

    def derivative(self, at: Situation) -> list[Shift]:
        """The derivatives of all laws, in the order of their parameters in L̄."""
        pairs = zip(self.laws, self.values(at.parameters), strict=True)
        return [part for law, values in pairs for part in law.derivative(at, values)]

    def reading_derivative(self, parameters: Parameters, force: Floats) -> list[Floats | None]:
        """The derivatives of e for forces (n, 2), in the order of the parameters in L̄; None where there is none."""
        out: list[Floats | None] = []
        for law, values in zip(self.laws, self.values(parameters), strict=True):
            out += law.reading_derivative(force, values) or (None,) * len(law.scales)
        return out

    def read(self, parameters: Parameters, force: Floats) -> Floats:
        """What the sensor reports for true forces in its frame, (n, 2), N."""
        return force + self._reading(parameters, force)

    def unread(self, parameters: Parameters, reported: Floats) -> Floats:
        """The true forces behind what the sensor reports, (n, 2), N."""
        force = reported
        for _ in range(READING_PASSES if self.reads else 0):
            force = reported - self._reading(parameters, force)
        return force

    @property
    def spread(self) -> float:
        """Standard deviation of the lean of the force, rad; 0 where no law has one."""
        return max((law.spread for law in self.laws), default=0.0)

    @property
    def reads(self) -> bool:
        """Whether any law is one of the sensor."""
        probe = np.ones((1, 2))
        return any(law.reading(probe, np.ones(len(law.scales))) is not None for law in self.laws)

    def _reading(self, parameters: Parameters, force: Floats) -> Floats:
        total = np.zeros_like(force)
        for law, values in zip(self.laws, self.values(parameters), strict=True):
            part = law.reading(force, values)
            total = total if part is None else total + part
        return total


def split(laws: tuple[Law, ...], parameters: Parameters) -> list[Floats]:
    """Each law's part of `parameters.extra`; where that is empty, the start values."""
    extra, parts, first = np.array(parameters.extra or [value for law in laws for value in law.start]), [], 0
    for law in laws:
        parts.append(extra[first : first + len(law.scales)])
        first += len(law.scales)
    return parts


class Setting(NamedTuple):
    """Where n touches take place: what the equations need beside L̄ and the state.

    Attributes:
        joints: Q, (n, 2), rad.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        gripper: the form of (7).
        extension: effects beyond the twelve parameters; None without.
        lean: of the force in each touch, (n,), rad; None for none.
    """

    joints: Floats
    centers: Floats
    radii: Floats
    gripper: Gripper
    extension: Extension | None = None
    lean: Floats | None = None

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Setting:
        """The touches that a mask or an array of positions picks."""
        extension = None if self.extension is None else self.extension.select(which)
        lean = None if self.lean is None else self.lean[which]
        return Setting(self.joints[which], self.centers[which], self.radii[which], self.gripper, extension, lean)

    def situation(self, parameters: Parameters, state: State) -> Situation:
        """The touches as effects see them at a state."""
        assert self.extension is not None
        arm = view_arm(parameters, *state[:4], self.gripper)
        f, normal = state.magnitude, np.stack([arm.nx, arm.ny], axis=-1)
        return Situation(
            parameters=parameters,
            joints=self.joints,
            force=f[:, None] * normal,
            magnitude=f,
            normal=normal,
            torques=np.stack([f * arm.lever1, f * arm.lever2], axis=-1),
            link1=np.stack([arm.ux, arm.uy], axis=-1),
            link2=np.stack([arm.vx, arm.vy], axis=-1),
            centers=self.centers,
            radii=self.radii,
            tags=self.extension.tags,
            lean=np.zeros_like(f) if self.lean is None else self.lean,
        )

    def shifted(self, parameters: Parameters, state: State) -> Setting:
        """The same touches for a robot without effects: joints and discs moved by what the effects do."""
        if self.extension is None:
            return self
        joints, place = self.extension.shift(self.situation(parameters, state))
        return self._replace(joints=self.joints - joints, centers=self.centers - place, extension=None, lean=None)

    def sensitivity(self, parameters: Parameters, state: State) -> tuple[Floats, Floats, Floats, Floats]:
        """How δ and d change with f and with φ: δ_f, d_f, δ_φ, d_φ, (n, 2) each, by central differences."""
        assert self.extension is not None
        parts: list[Floats] = []
        step = FORCE_STEP * np.maximum(np.abs(state.magnitude), 1.0)
        for name, size in (('magnitude', step), ('direction', np.full_like(step, TURN_STEP))):
            value = getattr(state, name)
            up, down = (
                self.extension.shift(self.situation(parameters, state._replace(**{name: value + sign * size})))
                for sign in (1, -1)
            )
            parts += [(a - b) / (2 * size[:, None]) for a, b in zip(up, down, strict=True)]
        return parts[0], parts[1], parts[2], parts[3]
