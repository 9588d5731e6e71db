"""The model extended by physical effects: several laws together, and n touches as the equations take them.

Their parameters stand behind the twelve in L̄ (`Parameters.extra`), law by law.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.law import Law, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.state import State
from scara_kinetostatic.model.statics import view_arm

Floats = NDArray[np.float64]

FORCE_STEP = 1e-4
"""Step of the central difference over the force, as a part of it (of 1 N at least)."""
TURN_STEP = 1e-5
ROBOT_STEP = 1e-6
"""Step of the central difference over a parameter of the robot, in its unit; the shift is linear in it."""
READING_PASSES = 12
READING_STEP = 1e-5
"""Step of the central difference over a force, as a part of it (of 1 N at least)."""
READING_ROUNDING = 1e-15
"""What a true force may miss the reported one by, as a part of the largest one."""
UNREADABLE = 1e-9
"""The same, beyond which there is none."""


class Extension(NamedTuple):
    """The laws that extend the model, with what they need to know of n touches."""

    laws: tuple[Law, ...]
    metadata: TouchMetadata

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Extension:
        """The touches that a mask or an array of positions picks."""
        return Extension(self.laws, self.metadata.select(which))

    def values(self, parameters: Parameters) -> list[Floats]:
        """Each law's part of L̄."""
        return split(self.laws, parameters)

    def shift(self, at: TouchState, robot_only: bool = False) -> tuple[Floats, Floats]:
        """δ and d of all laws together, (n, 2) each."""
        joints, place = np.zeros_like(at.joints), np.zeros_like(at.joints)
        for law, values in zip(self.laws, self.values(at.parameters), strict=True):
            part = law.shift(at, values)
            if part.joints is not None:
                joints = joints + part.joints
            if part.place is not None and not (robot_only and law.on_object):
                place = place + part.place
        return joints, place

    def by_robot(self, at: TouchState) -> dict[str, Shift]:
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

    def derivative(self, at: TouchState) -> list[Shift]:
        """The derivatives of all laws, in the order of their parameters in L̄."""
        pairs = zip(self.laws, self.values(at.parameters), strict=True)
        return [part for law, values in pairs for part in law.derivative(at, values)]

    def sensor_error_derivative(self, parameters: Parameters, force: Floats) -> list[Floats | None]:
        """The derivatives of e for forces (n, 2), in the order of the parameters in L̄; None where there is none."""
        out: list[Floats | None] = []
        for law, values in zip(self.laws, self.values(parameters), strict=True):
            out += law.sensor_error_derivative(force, values) or (None,) * len(law.scales)
        return out

    def read(self, parameters: Parameters, force: Floats) -> Floats:
        """What the sensor reports for true forces in its frame, (n, 2), N."""
        return force + self._sensor_error(parameters, force)

    def true_force(self, parameters: Parameters, reported: Floats) -> Floats:
        """The true forces behind what the sensor reports, (n, 2), N; NaN where there is none. By Newton's method."""
        if not self.has_sensor_error:
            return reported
        force, most = reported, np.abs(reported).max(initial=0.0)
        with np.errstate(all='ignore'):
            for _ in range(READING_PASSES):
                off = self.read(parameters, force) - reported
                if not np.any(np.abs(off) > READING_ROUNDING * most):
                    break
                force = force - np.einsum('nij,nj->ni', self.true_force_derivative(parameters, force), off)
            return np.where(np.abs(off) <= UNREADABLE * most, force, np.nan)

    def true_force_derivative(self, parameters: Parameters, force: Floats) -> Floats:
        """∂F/∂(reported F) at true forces (n, 2), (n, 2, 2): the inverse of what central differences give."""
        step = READING_STEP * np.maximum(np.hypot(force[:, 0], force[:, 1]), 1.0)[:, None]
        columns = [
            (self.read(parameters, force + step * unit) - self.read(parameters, force - step * unit)) / (2 * step)
            for unit in np.eye(2)
        ]
        (a, c), (b, d) = (column.T for column in columns)
        inverse = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        return np.asarray(inverse / (a * d - b * c)[:, None, None])

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the lean of the force, rad; 0 where no law has one."""
        return max((law.off_normal_std for law in self.laws), default=0.0)

    @property
    def has_sensor_error(self) -> bool:
        """Whether any law is one of the sensor."""
        probe = np.ones((1, 2))
        return any(law.sensor_error(probe, np.ones(len(law.scales))) is not None for law in self.laws)

    def _sensor_error(self, parameters: Parameters, force: Floats) -> Floats:
        total = np.zeros_like(force)
        for law, values in zip(self.laws, self.values(parameters), strict=True):
            part = law.sensor_error(force, values)
            total = total if part is None else total + part
        return total


def split(laws: tuple[Law, ...], parameters: Parameters) -> list[Floats]:
    """Each law's part of `parameters.extra`; where that is empty, the start values."""
    extra, parts, first = np.array(parameters.extra or [value for law in laws for value in law.start]), [], 0
    for law in laws:
        parts.append(extra[first : first + len(law.scales)])
        first += len(law.scales)
    return parts


class ContactProblem(NamedTuple):
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
    off_normal: Floats | None = None

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> ContactProblem:
        """The touches that a mask or an array of positions picks."""
        extension = None if self.extension is None else self.extension.select(which)
        off_normal = None if self.off_normal is None else self.off_normal[which]
        return ContactProblem(
            self.joints[which], self.centers[which], self.radii[which], self.gripper, extension, off_normal
        )

    def touch_state(self, parameters: Parameters, state: State) -> TouchState:
        """The touches as effects see them at a state."""
        assert self.extension is not None
        arm = view_arm(parameters, *state[:4], self.gripper)
        f, normal = state.magnitude, np.stack([arm.nx, arm.ny], axis=-1)
        return TouchState(
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
            metadata=self.extension.metadata,
            off_normal=np.zeros_like(f) if self.off_normal is None else self.off_normal,
        )

    def shifted(self, parameters: Parameters, state: State) -> ContactProblem:
        """The same touches for a robot without effects: joints and discs moved by what the effects do."""
        if self.extension is None:
            return self
        joints, place = self.extension.shift(self.touch_state(parameters, state))
        return self._replace(joints=self.joints - joints, centers=self.centers - place, extension=None, off_normal=None)

    def sensitivity(self, parameters: Parameters, state: State) -> tuple[Floats, Floats, Floats, Floats]:
        """How δ and d change with f and with φ: δ_f, d_f, δ_φ, d_φ, (n, 2) each, by central differences."""
        assert self.extension is not None
        parts: list[Floats] = []
        step = FORCE_STEP * np.maximum(np.abs(state.magnitude), 1.0)
        for name, size in (('magnitude', step), ('direction', np.full_like(step, TURN_STEP))):
            value = getattr(state, name)
            up, down = (
                self.extension.shift(self.touch_state(parameters, state._replace(**{name: value + sign * size})))
                for sign in (1, -1)
            )
            parts += [(a - b) / (2 * size[:, None]) for a, b in zip(up, down, strict=True)]
        return parts[0], parts[1], parts[2], parts[3]
