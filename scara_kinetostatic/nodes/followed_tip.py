"""What the node `compensator` knows of the arm: the calibration in use, the last samples, the zero of the force."""

from __future__ import annotations

from collections import Counter, deque
from math import hypot, isfinite, pi
from time import monotonic
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import Cell, SensorSign
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.online import MotionSense, OnlineArm, OnlinePosition
from scara_kinetostatic.nodes.conversion import Sample

TARE_TIME = 0.5
"""Over so long a time the zero of the force is averaged, s."""
FEWEST_FORCES = 3
"""Of a zero."""
_MOST = 5000
"""Most samples of that time."""
ELBOWS = ('present', 'left', 'right')


class StaleError(Exception):
    """A stream without a recent message; the text says which."""


class Answer(NamedTuple):
    """Joint angles for a wanted pose.

    Attributes:
        joints: Q, rad, without a turn more than the present ones need.
        move: the largest way of a joint, rad.
        std_normal: standard uncertainty of the tip along the force, m.
        status: as that of `JointAngles`.
    """

    joints: tuple[float, float]
    move: float
    std_normal: float
    status: str


class FollowedTip:
    """Follows the tip of one robot.

    Args:
        cell: whose joints and sensor the messages are of.
        timeout: age beyond which a sample is stale, s.
        force_noise: standard deviation of one force of the stream, N; 0 for that of a touch.

    Attributes:
        assumptions: what is taken of what no message says; empty if nothing is.
    """

    def __init__(self, cell: Cell, timeout: float, force_noise: float) -> None:
        self.cell, self.timeout, self._noise = cell, timeout, force_noise
        self.online: OnlineArm | None = None
        self.statuses: Counter[str] = Counter()
        self.zero: tuple[float, float] | None = None
        self.assumptions = ''
        self._joints: tuple[float, float, float] | None = None
        self._wrench: tuple[float, float, float] | None = None
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=_MOST)
        self._needs_metadata = False
        self._motion = MotionSense()
        self._approach = (0.0, 0.0)

    def use(self, arm: CalibratedArm) -> None:
        """Takes another calibration from the next sample on.

        Raises:
            ParameterError: it cannot be followed.
        """
        noise = arm.noise._replace(force=self._noise) if self._noise else arm.noise
        online = OnlineArm(arm, noise)
        if self.online is not None:
            online.follow_on(self.online)
        predictor = online.predictor
        self._needs_metadata = bool(predictor.effects_of('approach')) or predictor.depends_on_time
        self.assumptions = predictor.assumptions
        self.online = online

    def take_wrench(self, sample: Sample) -> None:
        """A force as the sensor reports it, in the frame of the cell description."""
        sign = -1.0 if self.cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
        now = monotonic()
        self._wrench = sign * sample.first, sign * sample.second, now
        self._forces.append(self._wrench)

    def take_joints(self, sample: Sample) -> OnlinePosition | None:
        """Joint angles, and where the tip is with them; None where there is no calibration.

        Raises:
            StaleError: the last force is too old.
        """
        now = monotonic()
        self._joints = sample.first, sample.second, now
        if self._needs_metadata:
            self._approach = self._motion.note(sample.first, sample.second)
        if self.online is None:
            return None
        if self._wrench is None or now - self._wrench[2] > self.timeout:
            raise StaleError('no recent force')
        fx, fy = self._force(sample.first, sample.second)
        found = self.online.locate(sample.first, sample.second, fx, fy, self._metadata())
        self.statuses[found.status] += 1
        return found

    def _force(self, q1: float, q2: float) -> tuple[float, float]:
        """The true force, base frame, N."""
        assert self.online is not None
        assert self._wrench is not None
        zero = self.zero or (0.0, 0.0)
        return self.online.true_force(q1, q2, self._wrench[0] - zero[0], self._wrench[1] - zero[1])

    def tare(self) -> tuple[float, float]:
        """Takes the mean of the last forces as zero; nothing must be touched.

        Raises:
            StaleError: there are too few.
        """
        since = monotonic() - TARE_TIME
        recent = [(x, y) for x, y, when in self._forces if when > since]
        if len(recent) < FEWEST_FORCES:
            raise StaleError(f'{len(recent)} forces in the last {TARE_TIME:g} s')
        x, y = np.mean(recent, axis=0).tolist()
        self.zero = x, y
        return self.zero

    def forget_forces(self) -> bool:
        """Forgets forces and their zero, as where they are turned otherwise from here on; whether there was a zero."""
        had, self.zero, self._wrench = self.zero is not None, None, None
        self._forces.clear()
        return had

    def answer(self, x: float, y: float, fx: float, fy: float, elbow: str) -> Answer:
        """Joint angles for a wanted place and force.

        Raises:
            InputError: there is no calibration, or the place is out of reach.
            StaleError: there are no recent joint angles.
        """
        if self.online is None:
            raise InputError('the calibration', 'there is none yet', 'set the parameter calibration, or calibrate')
        if self._joints is None or monotonic() - self._joints[2] > self.timeout:
            raise StaleError('no recent joint angles')
        present = np.array(self._joints[:2])
        sides = {'left': 1, 'right': -1, 'present': int(posture(self.online.arm.model.parameters, present[None])[0])}
        side = np.array([sides[elbow]])
        metadata = self._metadata() or TouchMetadata.plain(1)
        found = self.online.predictor.compensate(np.array([[x, y]]), np.array([[fx, fy]]), side, metadata)
        if not np.isfinite(found.joints).all():
            raise InputError('the wanted pose', f'({x:.4g}, {y:.4g}) m is out of reach', 'wish for another')
        angles = found.joints[0] + 2 * pi * np.round((present - found.joints[0]) / (2 * pi))
        q1, q2 = angles.tolist()
        move = float(np.abs(angles - present).max())
        return Answer((q1, q2), move, float(found.std_normal[0]), str(found.status[0]))

    def ages(self) -> dict[str, float]:
        """Age of the last sample of each stream, s; infinite where there is none."""
        now = monotonic()
        streams = {'joint angles': self._joints, 'forces': self._wrench}
        return {name: float('inf') if last is None else now - last[2] for name, last in streams.items()}

    @property
    def force(self) -> float:
        """Size of the last force less the zero, N; NaN where there is none."""
        if self._wrench is None:
            return float('nan')
        zero = self.zero or (0.0, 0.0)
        size = hypot(self._wrench[0] - zero[0], self._wrench[1] - zero[1])
        return size if isfinite(size) else float('nan')

    def _metadata(self) -> TouchMetadata | None:
        """Of the present pose, where the calibration asks for it."""
        if not self._needs_metadata or self.online is None:
            return None
        time = np.array([self.online.arm.used.duration])
        return TouchMetadata.plain(1)._replace(time=time, approach=np.array([self._approach]))
