"""Messages to numbers and back; nothing else in the package takes a ROS message apart.

The two messages that come at 1 kHz are read from their bytes (CDR, little endian, as every common middleware sends
them) without a message object, which takes ten times as long.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from math import cos, isnan, nan, sin
from pathlib import Path
from time import time_ns
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs import msg as geometry
from nav_msgs.msg import Path as PathMessage
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from scara_kinetostatic.bags.decoding import Fields, aligned, joint_fields, unlike_lengths, wrench_fields
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import read_document
from scara_kinetostatic.files.tables import COLUMNS
from scara_kinetostatic.files.urdf import Colour
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Plane
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.parameters import MILLI
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.report.page import Document
from scara_kinetostatic.results.document import JSON
from scara_kinetostatic.touches.clock import SECOND, JointParts, Samples

TOUCH_NUMBERS = 'q1_rad', 'q2_rad', 'fx_N', 'fy_N', 'approach1', 'approach2', 'press1', 'press2'
"""Of a touch on the collector's `~/touch`: joint angles, force, movement before the hold and in contact."""
_LARGEST = 1e5
"""Of a number in a message: rad, N or m."""
_PLAIN = b'\0\1'
"""How a message in plain CDR, little endian, begins."""


class Sample(NamedTuple):
    """Two numbers with the stamp of their header: q1, q2 in rad, or fx, fy in N; and positions of other joints, NaN
    where none is known. `age_ns`: how long before the message that completed it that of this stamp was received, ns.
    """

    stamp_ns: int
    first: float
    second: float
    others: tuple[float, ...] = ()
    age_ns: int = 0


class UnusableMessageError(Exception):
    """A message that does not hold what is needed; the text says what it lacks."""


def stamp_of(nanoseconds: int) -> Time:
    """The time as a message."""
    return Time(sec=nanoseconds // SECOND, nanosec=nanoseconds % SECOND)


def nanoseconds_of(stamp: Time | Duration) -> int:
    """A time or a duration, ns."""
    return int(stamp.sec * SECOND + stamp.nanosec)


def diagnostic(name: str, level: bytes, text: str, values: Mapping[str, object], hardware: str = '') -> DiagnosticArray:
    """One status, without a stamp.

    Args:
        name: of the status.
        level: `OK`, `WARN` or `ERROR`.
        text: one line.
        values: details by name.
        hardware: its `hardware_id`.
    """
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    status = DiagnosticStatus(level=level, name=name, message=text, hardware_id=hardware, values=pairs)
    return DiagnosticArray(status=[status])


def force_text(force: Sequence[float]) -> str:
    """Both components, N, in words."""
    return f'({force[0]:.4g}, {force[1]:.4g})'


def joint_state(sample: Sequence[float], names: Sequence[str]) -> JointState:
    """A message with a stamp, ns, and the position of each joint."""
    return JointState(header=Header(stamp=stamp_of(int(sample[0]))), name=list(names), position=list(sample[1:]))


def wrench(sample: Sequence[float], frame_id: str) -> geometry.WrenchStamped:
    """A message with a stamp, ns, and a force, (2,) or (3,); all else is 0."""
    header = Header(frame_id=frame_id, stamp=stamp_of(int(sample[0])))
    return geometry.WrenchStamped(
        header=header, wrench=geometry.Wrench(force=geometry.Vector3(**_axes([float(f) for f in sample[1:]])))
    )


def trajectory_points(message: JointTrajectory) -> tuple[list[float], list[Sequence[float]], list[Sequence[float]]]:
    """Times from its start, s, positions and velocities of the points of a trajectory."""
    times = [nanoseconds_of(point.time_from_start) / SECOND for point in message.points]
    return times, [point.positions for point in message.points], [point.velocities for point in message.points]


def _in_robot(plane: Plane, pose: Sequence[float]) -> tuple[list[float], tuple[float, float, float, float]]:
    """The place, m, and the quaternion in the frame of the robot, of x, y, m, and yaw, rad, in the plane."""
    (x, y, z, w), s, c = plane.quaternion, sin(pose[2] / 2), cos(pose[2] / 2)
    place: list[float] = plane.in_robot(np.array(pose[:2])).tolist()
    return place, (x * c + y * s, y * c - x * s, z * c + w * s, w * c - z * s)


def pose_bytes(stamp_ns: int, plane: Plane, pose: Sequence[float], covariance: Floats) -> bytes:
    """A `PoseWithCovarianceStamped` in the robot's frame as it goes over the wire; off the plane it is exact.

    Args:
        stamp_ns: of the pose, ns.
        plane: in which it is.
        pose: x, y, m, and yaw, rad.
        covariance: of these, (3, 3).
    """
    name = plane.frame.encode()
    seconds, nanoseconds = divmod(stamp_ns, SECOND)
    head = _PLAIN + b'\0\0' + struct.pack('<iII', seconds, nanoseconds, len(name) + 1) + name + b'\0'
    matrix = np.zeros((6, 6))
    matrix[[[0], [1], [-1]], [0, 1, -1]] = covariance
    if plane.is_stated:
        turn = np.kron(np.eye(2), plane.axes)
        matrix = turn @ matrix @ turn.T
    place, quaternion = _in_robot(plane, pose)
    numbers = *place, *quaternion, *matrix.ravel().tolist()
    return head.ljust(aligned(len(head), 8), b'\0') + struct.pack('<43d', *numbers)


def planar(vector: Any, plane: Plane, *, is_place: bool) -> tuple[float, float]:
    """X and y in the plane of a place, m, or a vector such as a force in the robot's frame.

    Raises:
        UnusableMessageError: they are not finite, or the place is not in the stated plane.
    """
    given = np.array([vector.x, vector.y, vector.z], dtype=float)
    x, y, z = (plane.in_plane(given) if is_place else given @ plane.axes).tolist()
    found = _finite(Sample(0, x, y))
    if is_place and plane.is_stated and not abs(z) <= 0.01:
        raise UnusableMessageError(f'the place is {abs(z) / MILLI:.0f} mm off the plane of the arm (robot.plane)')
    return found.first, found.second


def joint_trajectory(
    names: Sequence[str],
    times: Sequence[float],
    positions: Sequence[Sequence[float]],
    velocities: Sequence[Sequence[float]] | None = None,
) -> JointTrajectory:
    """A trajectory that begins at once.

    Args:
        names: of the joints.
        times: until each point is reached, s.
        positions: of each point, rad or m.
        velocities: at each point, rad/s or m/s; None or empty rows for none.
    """
    points = []
    for time, row, rates in zip(times, positions, velocities or [[]] * len(times), strict=True):
        seconds, nanoseconds = divmod(round(time * SECOND), SECOND)
        when = Duration(sec=seconds, nanosec=nanoseconds)
        points.append(JointTrajectoryPoint(positions=list(row), velocities=list(rates), time_from_start=when))
    return JointTrajectory(joint_names=list(names), points=points)


def follow_joint_trajectory() -> Any:
    """The type of the action, in `control_msgs`."""
    return import_module('control_msgs.action').FollowJointTrajectory


def pose_stamped(stamp_ns: int, plane: Plane, place: tuple[float, float, float]) -> geometry.PoseStamped:
    """A pose in the plane, x, y, m, and the angle of its x axis, rad, in the robot's frame."""
    return geometry.PoseStamped(header=_header(stamp_ns, plane), pose=_pose(*_in_robot(plane, place)))


def _header(stamp_ns: int, plane: Plane) -> Header:
    return Header(stamp=stamp_of(stamp_ns), frame_id=plane.frame)


def _pose(place: Sequence[float], quaternion: Sequence[float]) -> geometry.Pose:
    return geometry.Pose(position=geometry.Point(**_axes(place)), orientation=geometry.Quaternion(**_axes(quaternion)))


def _axes(numbers: Sequence[float]) -> dict[str, float]:
    return dict(zip('xyzw', numbers, strict=False))


def path(stamp_ns: int, plane: Plane, places: Sequence[tuple[float, float, float]]) -> PathMessage:
    """A path in the plane, in the robot's frame.

    Args:
        stamp_ns: of the latest place, ns; that of all poses.
        plane: of the places.
        places: x, y, m, and the angle of the direction of the path, rad.
    """
    poses = [pose_stamped(stamp_ns, plane, place) for place in places]
    return PathMessage(header=_header(stamp_ns, plane), poses=poses)


class JointReader:
    """Takes the joint states of one topic apart, and brings those that come in parts to common times.

    Args:
        names: of q1 and q2.
        others: names of other joints.

    Attributes:
        parts: which does that.
        joints: those of q1 and q2 that the last message has; where it has none, its own.
    """

    def __init__(self, names: Sequence[str], others: Sequence[str] = ()) -> None:
        self._names, self._waiting, self._given = (*names, *others), list[tuple[int, int, list[float]]](), 0
        self.parts, self.joints = JointParts(self._names), frozenset[str]()

    def samples(self, serialized: bytes, received: int = 0, more: bool = False) -> list[Sample]:
        """Both joint angles, found by name, and the positions of other joints: what a message completes.

        Args:
            serialized: a `JointState` as it came over the wire.
            received: when it came, ns; 0: now.
            more: whether the next message is there already: parts are then taken together.

        Raises:
            UnusableMessageError: it has no position of such a joint, none that is a finite number, or does not fit
                those of the other joint.
        """
        fields, positions = _fields(joint_fields, serialized)
        found = dict(zip(fields.names, positions, strict=False))
        self.joints = frozenset(fields.names).intersection(self._names[:2]) or frozenset(fields.names)
        values = [found.get(name, nan) for name in self._names]
        if found.keys().isdisjoint(self._names) or unlike_lengths(fields):
            raise UnusableMessageError(
                f'expected positions of {" and ".join(self._names[:2])}, got {fields.numbers} positions of '
                f'{" ".join(fields.names) or "no joints"}'
            )
        q1, q2 = (found.get(name, 0.0) for name in self._names[:2])
        stamp = _finite(Sample(_stamp(serialized), q1, q2)).stamp_ns
        row = stamp, received or time_ns(), values
        if len(self._waiting) == self._given and not any(map(isnan, values)):  # whole, as nearly all: no arrays
            self._waiting, self._given = [row], 1
            return [Sample(stamp, q1, q2, tuple(values[2:]))]
        self._waiting.append(row)
        if more:
            return []
        samples, problems = self.parts.add(Samples(*map(np.array, zip(*self._waiting, strict=True))))
        rows = [*zip(*(each.tolist() for each in samples), strict=True)][self._given :]
        self._waiting, self._given = [], 0
        if problems and not rows:
            raise UnusableMessageError('; '.join(problems))
        return [Sample(at, q1, q2, tuple(others), row[1] - came) for at, came, (q1, q2, *others) in rows]


def wrench_sample(serialized: bytes, turn: Sequence[Sequence[float]] | None = None) -> Sample:
    """The force in the plane, as the sensor gives it.

    Args:
        serialized: a `WrenchStamped` as it came over the wire.
        turn: two rows of three, by which the force is turned into the frame of the cell description; None: it is not.

    Raises:
        UnusableMessageError: the force is not finite.
    """
    x, y, z = _fields(wrench_fields, serialized)[1][:3]
    if turn is not None:
        x, y = (row[0] * x + row[1] * y + row[2] * z for row in turn)
    return _finite(Sample(_stamp(serialized), x, y))


def frame_of(serialized: bytes) -> str:
    """The `frame_id` of a `WrenchStamped` as it came over the wire; empty where it cannot be read."""
    try:
        return wrench_fields(serialized).frame_id
    except ValueError:
        return ''


def _fields(layout: Callable[[bytes], Fields], serialized: bytes) -> tuple[Fields, tuple[float, ...]]:
    """Where the numbers of a message are, and the numbers.

    Raises:
        UnusableMessageError: the message is cut off, or not in plain CDR.
    """
    if serialized[:2] != _PLAIN:
        raise UnusableMessageError('expected a message in CDR, little endian')
    try:
        fields = layout(serialized)
    except ValueError as error:
        raise UnusableMessageError('the message is cut off') from error
    return fields, struct.unpack_from(f'<{fields.numbers}d', serialized, fields.begin)


def _stamp(serialized: bytes) -> int:
    """Of the header, ns."""
    seconds, nanoseconds = struct.unpack_from('<iI', serialized, 4)
    return int(seconds * SECOND + nanoseconds)


def _finite(sample: Sample) -> Sample:
    if not all(abs(number) <= _LARGEST for number in sample[1:3]):
        raise UnusableMessageError(f'expected plausible numbers, got {sample.first:g} and {sample.second:g}')
    return sample


def stored_document(said: Document) -> Document:
    """The `calibration.json` of a result on `calibrator/result`.

    Raises:
        InputError: it cannot be read, as where the calibrator is on another machine, or is of another result.
    """
    try:
        path, created = Path(said['files']['folder']) / JSON, said['created']
    except (LookupError, TypeError) as error:
        raise InputError('calibrator/result', 'is no result of a calibration') from error
    document: Document = read_document(path)
    if document.get('created') != created:
        raise InputError(path, f'is of another result, {document.get("created")}', 'calibrate again')
    return document


def touches_in(message: DiagnosticArray) -> Iterator[tuple[tuple[str, str], dict[str, str]]]:
    """Of each touch on the collector's `~/touch` recording and number, and its values by name."""
    for status in message.status:
        values = {item.key: item.value for item in status.values}
        yield (values.get('recording', ''), values.get('touch', '')), values


def numbers_of(values: Mapping[str, str]) -> list[float]:
    """Joint angles, rad, and force, N, of a touch.

    Raises:
        KeyError, ValueError: a value is missing or no number.
    """
    return [float(values[name]) for name in TOUCH_NUMBERS[:4]]


def touch_of(values: Mapping[str, str], arm: CalibratedArm) -> TouchSet:
    """A touch from the values of the collector's `~/touch`, in the cell of an arm.

    Raises:
        KeyError, ValueError: a value is missing or no number.
        InputError: the object or the frame is not that of the calibration.
    """
    cell = arm.cell
    objects = [disc.name for disc in cell.discs]
    if values['object'] not in objects:
        problem = f'the calibration knows no object {values["object"]!r}'
        raise InputError('collector/touch', problem, 'calibrate with this cell description')
    if values['frame'] != cell.sensor.frame.value:
        raise InputError('collector/touch', f'the frame of the force is {values["frame"]}, not that of the calibration')
    numbers = numbers_of(values)
    for name, number in zip(TOUCH_NUMBERS, numbers, strict=False):
        if not abs(number) <= COLUMNS[name].largest:
            raise ValueError(f'{name} = {number:g} is not plausible')
    moved = [float(values.get(name) or 0.0) for name in TOUCH_NUMBERS[4:]]
    joints, force, approach, press = np.array([*numbers, *moved]).reshape(4, 1, 2)
    return TouchSet(
        joints,
        force,
        np.array([objects.index(values['object'])]),
        posture(arm.model.parameters, joints),
        time=np.array([arm.used.duration]),
        approach=approach,
        press=press,
    )


def marker(
    group: str, kind: int, points: ArrayLike, plane: Plane, colour: Colour, scale: tuple[float, float, float]
) -> Marker:
    """A marker in the plane, in the robot's frame.

    Args:
        group: its namespace; groups are shown and hidden together.
        kind: as of `Marker`.
        points: one point, (2,), or those of a line or an arrow, (n, 2), m.
        plane: of the points.
        colour: red, green, blue, opacity.
        scale: as RViz takes it for this kind, m.
    """
    places = np.asarray(points, dtype=float)
    is_line = places.ndim == 2
    made = Marker(ns=group, type=kind, scale=geometry.Vector3(**_axes(scale)))
    made.color = ColorRGBA(**dict(zip('rgba', colour, strict=True)))
    made.pose = _pose(plane.in_robot(np.zeros(2) if is_line else places).tolist(), plane.quaternion)
    made.points = [geometry.Point(**_axes(point)) for point in places.tolist()] if is_line else []
    return made


def marker_array(markers: Sequence[Marker], plane: Plane) -> MarkerArray:
    """All of them, numbered; those of earlier messages on the topic vanish.

    Stamps are 0, for the latest transform: what is shown does not depend on clocks.
    """
    array = MarkerArray(markers=[Marker(action=Marker.DELETEALL), *markers])
    for number, each in enumerate(array.markers):
        each.id, each.header.frame_id = number, plane.frame
    return array
