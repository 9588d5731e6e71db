"""Touches: what is measured while the tip is held at an object, many of them as arrays; the load before each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import Parameters

LATER = 2**31
"""`TouchSet.order` of a touch that is still to come."""


@dataclass(frozen=True)
class TouchSet:
    """n touches, as read-only arrays. All but the first four have a default.

    Attributes:
        joints: measured joint angles Q, (n, 2), rad.
        force: force of the robot on the object, sensor zero removed and sign
            put right, in the frame the sensor reports in, (n, 2), N.
        disc: index of the touched disc in the cell, (n,).
        posture: elbow posture, +1 where sin(q2 + theta2) > 0, else -1, (n,).
        time: middle of the hold since the start of the recording, (n,), s.
        index: number of the touch in the recording (or of all recordings in
            turn), 0-based, rejected ones counted, (n,).
        approach: motion of each joint in its last movement before the hold, (n, 2), rad: from where
            it last turned round, or from the free pose if it never did, to the hold; its sign is the
            direction of approach; 0 where it did not move beyond noise.
        press: the part of `approach` in contact: from where the contact began, or from
            where the joint turned round after that, (n, 2), rad.
        joint_scatter: standard deviation of the samples in the hold, (n, 2), rad.
        force_scatter: the same of the force, (n, 2), N.
        samples: number of force samples in the hold, (n,).
        history: the load before each hold since the start of the recording, (n, K, 4): q1, q2, rad, and fx, fy, N, in
            the frame of `force`, at the K moments at which it turned, the oldest first. Only those that a memory can
            still hold count, the nested extremes of either joint's torque; more do no harm. Fewer than K are filled up
            in front by the unloaded joints of the hold. K = 0: nothing is known, and the joints are taken as relaxed.
        recording: number of the recording or table, 0-based, (n,).
        order: place in the order of time, over all recordings, (n,); by default `index`, which differs from it only
            where the rows of a table, or the recordings, are not given in the order of time.
        surface: number of the touched edge or corner among the surfaces of the cell, (n,); -1 where it is still to be
            found. Discs have one each and need none.

    Raises:
        ValueError: shapes that do not fit, or values that are not finite.

    Example:
        >>> import scara_kinetostatic as sk
        >>> touches = sk.TouchSet(joints=[[0.8, 2.1]], force=[[-9.8, -0.1]], disc=[0], posture=[1])
        >>> len(touches), touches.force.shape
        (1, (1, 2))
    """

    joints: Floats
    force: Floats
    disc: Indices
    posture: Indices
    time: Floats = None  # type: ignore[assignment]
    index: Indices = None  # type: ignore[assignment]
    approach: Floats = None  # type: ignore[assignment]
    press: Floats = None  # type: ignore[assignment]
    joint_scatter: Floats = None  # type: ignore[assignment]
    force_scatter: Floats = None  # type: ignore[assignment]
    samples: Indices = None  # type: ignore[assignment]
    history: Floats = None  # type: ignore[assignment]
    recording: Indices = None  # type: ignore[assignment]
    order: Indices = None  # type: ignore[assignment]
    surface: Indices = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        n = len(self.joints)
        numbers, pairs = np.arange(n), np.zeros((n, 2))
        defaults = {
            **dict.fromkeys(('joints', 'force', 'approach', 'press', 'joint_scatter', 'force_scatter'), pairs),
            **dict.fromkeys(('disc', 'posture', 'recording'), 0 * numbers),
            'time': numbers.astype(float),
            'index': numbers,
            'samples': np.ones_like(numbers),
            'history': np.empty((n, 0, 4)),
            'order': numbers,
            'surface': np.full_like(numbers, -1),
        }
        for item in fields(self):
            value, default = getattr(self, item.name), defaults[item.name]
            if value is None:
                value = self.index if item.name == 'order' else default
            array, expected = np.array(value, dtype=default.dtype), default.shape
            if item.name == 'history':
                expected = (n, array.shape[1] if array.ndim == 3 else 0, 4)
            if array.shape != expected:
                raise ValueError(f'{item.name}: expected shape {expected}, got {array.shape}')
            if not np.all(np.isfinite(array)):
                raise ValueError(f'{item.name}: expected finite values')
            array.flags.writeable = False
            object.__setattr__(self, item.name, array)

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        return f'<TouchSet: {len(self)} touches of {len(set(self.disc.tolist()))} objects>'

    def select(self, which: Mask | Indices) -> TouchSet:
        """The touches that a mask or an array of positions picks."""
        return TouchSet(**{item.name: getattr(self, item.name)[which] for item in fields(self)})

    def replace(self, **changes: object) -> TouchSet:
        """The same with some arrays changed."""
        return replace(self, **changes)  # type: ignore[arg-type]

    @classmethod
    def concatenate(cls, sets: list[TouchSet]) -> TouchSet:
        """All touches of several sets, in turn; the shorter histories are filled up."""
        longest = max(s.history.shape[1] for s in sets)
        sets = [s.replace(history=padded_history(s.history, s.joints, longest)) for s in sets]
        return cls(**{item.name: np.concatenate([getattr(s, item.name) for s in sets]) for item in fields(cls)})


def order_of_time(time: Floats) -> Indices:
    """Place of each touch in the order of time, (n,), for times (n,); equal times keep their order."""
    return np.argsort(np.argsort(time, kind='stable'), kind='stable')


def padded_history(history: Floats, joints: Floats, length: int) -> Floats:
    """Histories (n, K, 4), K ≤ length, filled up in front by unloaded joints (n, 2), rad: (n, length, 4)."""
    return np.concatenate([_unloaded(joints, length - history.shape[1]), history], axis=1)


def stacked_histories(histories: Sequence[ArrayLike], joints: Floats) -> Floats:
    """Histories of n touches, (k, 4) each, filled up in front by their unloaded joints (n, 2), rad: (n, K, 4)."""
    stacked = _unloaded(joints, max((len(np.asarray(history)) for history in histories), default=0))
    for row, history in zip(stacked, histories, strict=True):
        points = np.reshape(history, (-1, 4))
        row[len(row) - len(points) :] = points
    return stacked


def _unloaded(joints: Floats, length: int) -> Floats:
    """Histories of joints (n, 2), rad, that were never loaded, (n, length, 4)."""
    return np.repeat(np.concatenate([joints, np.zeros_like(joints)], axis=1)[:, None], length, axis=1)


def torque_phasors(
    parameters: Parameters, points: Floats, frame: SensorFrame = SensorFrame.BASE
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Torques of both joints as imaginary parts of complex numbers, (...,) each, Nm.

    A force turned by an angle and stretched by a factor has the torques of the phasors times that complex number.
    C = JᵀF with J at the measured angles Q, in place of Q*: an approximation of relative order p C.

    Args:
        parameters: L̄.
        points: q1, q2, rad, fx, fy, N, as in `TouchSet.history`, (..., 4).
        frame: that of the forces.
    """
    force: NDArray[np.complex128] = points[..., 2] + 1j * points[..., 3]
    elbow = points[..., 1] + parameters.theta2
    if frame is SensorFrame.BASE:  # seen from the frame of link 2
        force = force * np.exp(-1j * (points[..., 0] + parameters.theta1 + elbow))
    second = parameters.l2 * force
    return second + parameters.l1 * force * np.exp(1j * elbow), second


def torques_of(parameters: Parameters, points: Floats, frame: SensorFrame = SensorFrame.BASE) -> Floats:
    """C of points as `torque_phasors` takes them, (..., 2), Nm."""
    return np.stack(torque_phasors(parameters, points, frame), axis=-1).imag


@dataclass(frozen=True)
class Rejection:
    """A touch that is not used, and why.

    Attributes:
        index: number of the touch.
        reason: why, one clause.
        kind: of the reason, for programs: ``no object``, ``gap``, ``frozen``, ``no hold``, ``unsteady``, ``no tare``,
            ``sampling``, ``request``; empty where none is stated.
    """

    index: int
    reason: str
    kind: str = ''
