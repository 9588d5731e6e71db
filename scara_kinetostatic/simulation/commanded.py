"""A cell that obeys commanded motions: drives, contact, sensors. No ROS, and no clock but that of its caller.

`Plant` has the drives and the sensors; what the robot meets is a `Body`: `ModelBody`, which is A(Q, L̄) (9) (11) with
the effects of the robot, or the physics engine (`simulation.mujoco.engine.EngineBody`). All is quasi-static: at every
moment the motors stand at Q, and arm and force are in the equilibrium that follows from the one before.

**Drives.** A motion is taken as `joint_trajectory_controller` of ros2_control with `interpolate_from_desired_state`
takes it: it replaces the former one, begins where the setpoint is, and is linear between its points, or, where they
have velocities, of the third degree; `scaling` is that of its time. The setpoint moves at most at the speed limit, the
joint follows it with a lag of the first order. A motion that names other joints, is not of finite numbers, runs
backwards in time, does not end at rest or leaves the limits is refused. A force above `overload` stops the drives until
`reset`; while it is not `active` no motion is taken.

**Sensors.** Joint angles and force have the noise of a touch and that of a sample, as in `simulation.streams`: the
error of a touch is drawn anew when the tip has left the object, that of the force grows with it up to `FULL`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import exp, hypot, isfinite
from typing import NamedTuple, Protocol

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, EffectSizes, Lift, Region, SizeMode, Uncertainty
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import TouchMetadata, as_model
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.outline import Outline, surfaces_of
from scara_kinetostatic.model.parameters import MICRO, MILLI
from scara_kinetostatic.model.play_operator import remembered
from scara_kinetostatic.model.touch import torques_of
from scara_kinetostatic.simulation.motion import Robot
from scara_kinetostatic.simulation.plan import ROUNDING, check_numbers
from scara_kinetostatic.simulation.streams import SensorModel, reported_force
from scara_kinetostatic.touches.load_history import last_movement

FULL = 10.0
"""Force from which on the error of a touch has its full size, N."""
RAISED = 0.9
"""Part of its way from which on the lift is over all objects."""
_USUAL_LIMITS = ((-2.6, 2.6),) * 2
"""Of the joints where a cell has none, rad."""
_RATE = 250.0
"""Samples per second."""
COMMANDED_SENSORS = SensorModel(joint_rate=_RATE, wrench_rate=_RATE, jitter=0.0, offset=0.0)
"""As usual, but both at one rate."""


DEMO_CELL = replace(
    PAPER_CELL,
    limits=_USUAL_LIMITS,
    lift=Lift('joint3', up=0.02, down=0.0),
    tolerance=3e-5,
    region=Region(-0.35, 0.35, 0.2, 0.55),
    uncertainty=Uncertainty(effects=EffectSizes(SizeMode.NONE)),
)
"""The cell of figure 3 with what a robot needs that touches by itself; this one has no undetected errors."""


class Body(Protocol):
    """What the robot is made of and what it meets.

    Attributes:
        tick: longest step of time, s.
        joints: motor angles, which the encoders measure, rad.
        force: of the tip on what it touches, base frame, N.
        touched: name of it, empty in free motion.
    """

    tick: float
    joints: tuple[float, float]
    force: tuple[float, float]
    touched: str

    def begin(self, joints: tuple[float, float], lift: float) -> None:
        """Stands at motor angles, rad, with the lift at a part of its way up, in free motion."""

    def advance(self, time: float, joints: tuple[float, float], lift: float) -> None:
        """On to a time, s, at which the drives have the motors at `joints`, rad, the lift at a part of its way up."""

    def sensed(self, share: float) -> Floats:
        """The force in the frame of the sensor, without its sign, bias and noise, (2,), N.

        Args:
            share: of its full size that an error of the touch has under this force, 0 to 1.
        """


_NEAR = 3 * MILLI
"""Gap above which there is no contact, m: effects and uncertainties of objects are smaller."""
_DEEP, _CRASH = 0.01, 1e5
"""Depth beyond which a tip without an equilibrium has crashed into an object, m; force by depth then, N/m."""


def _around(corners: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Corners in the order of an outline, counter-clockwise."""
    x, y = np.array(corners).T
    return corners if x @ np.roll(y, -1) > y @ np.roll(x, -1) else corners[::-1]


class ModelBody:
    """The robot by its model: A(Q, L̄) with the effects and with what the joints remember.

    Args:
        cell: with the discs and obstacles as they truly are.
        truth: the simulated robot.
    """

    tick = 4 * MILLI

    def __init__(self, cell: Cell, truth: Robot) -> None:
        self.cell, self.model = cell, as_model(truth)
        obstacles = (Outline(f'obstacle {k + 1}', _around(corners)) for k, corners in enumerate(cell.obstacles))
        self._objects = (*cell.discs, *obstacles)
        self._surfaces = surfaces_of(self._objects, cell.tip_radius or 1e-4)
        self._discs, self._outlines = [], []
        for number, item in enumerate(self._objects):
            own = np.flatnonzero(self._surfaces.object == number)
            if isinstance(item, Outline):
                self._outlines.append((own, item.is_open))
            else:
                self._discs.append((int(own[0]), item.x, item.y, item.radius))
        self.begin((0.0, 0.0), 0.0)

    def begin(self, joints: tuple[float, float], lift: float) -> None:
        """Stands at motor angles, relaxed."""
        self.force, self.touched, self.contacts = (0.0, 0.0), '', 0
        self.joints, self._raised, self._time = joints, lift > RAISED, 0.0
        self._path, self._begin = [joints], 0
        self._history: list[tuple[float, float, float, float]] = []
        self._metadata = TouchMetadata.plain(1)

    def nearest(self, joints: tuple[float, float]) -> tuple[int, float]:
        """The surface of the object next to the rigid tip, or in which it is deepest, at motor angles, and its gap, m.

        The gap is the distance of the tip's centre from touching it; infinite where there is no object.
        """
        (x, y), s = forward(self.model.parameters, np.array(joints)).tolist(), self._surfaces
        found = [(k, hypot(x - u, y - v) - r) for k, u, v, r in self._discs]
        if self._outlines:
            tip = np.array([[x, y]])
            away, gaps = s.distances(tip)[0], s.gaps(tip)[0]
            for own, is_open in self._outlines:
                k = int(own[np.argmin(away[own])])
                past = is_open and abs((tip[0] - s.centers[k]) @ s.tangents[k]) > s.halves[k]  # its end
                found.append((k, float(away[k] if past else gaps[k])))
        return min(found, key=lambda item: item[1], default=(0, np.inf))

    def advance(self, time: float, joints: tuple[float, float], lift: float) -> None:
        """The equilibrium at motor angles, next to that of the step before."""
        raised = lift > RAISED
        if raised == self._raised and max(abs(a - b) for a, b in zip(joints, self.joints, strict=True)) < ROUNDING:
            return
        self.joints, self._raised, self._time = joints, raised, time
        self._path.append(joints)
        before, (surface, gap) = self.touched, (0, np.inf) if raised else self.nearest(joints)
        if gap > _NEAR:
            self.force, self.touched = (0.0, 0.0), ''
            del self._path[:-500]  # of the free motion the last two seconds count
        else:
            self._press(surface, gap)
        if self.touched and not before:
            self.contacts, self._begin = self.contacts + 1, len(self._path) - 1
        if before and not self.touched:
            self._path = [joints]
        if self.model.effects and (self.touched or before):
            self._remember()

    def _press(self, k: int, gap: float) -> None:
        """The force of the contact with a surface; without an equilibrium it stays, deep inside it is a crash."""
        q, s = np.array([self.joints]), self._surfaces.select(np.array([k]))
        if self.model.effects:
            history = np.array([self._history]) if self._history else None
            begins = 0, self._begin if self.touched else -1
            approach, press = (last_movement(self._path[begin:], self.joints)[None] for begin in begins)
            self._metadata = TouchMetadata(
                s.object, np.array([self._time]), approach, posture(self.model.parameters, q), press,
                history, order=np.array([self.contacts]), surface=np.array([k]),
            )  # fmt: skip
        found = contact(
            self.model, q, s.centers, s.radii, self.cell.gripper_sign,
            warm_start=np.array([self.force]) if self.touched else None,
            metadata=self._metadata, tangents=s.tangents if self._outlines else None,
        )  # fmt: skip
        x, y = self.force
        if found.solved[0]:
            x, y = found.force[0].tolist()
        elif gap < -_DEEP:
            inwards = s.centers[0] - forward(self.model.parameters, q)[0]
            inwards = -s.normals[0] if s.is_edge[0] else inwards / np.hypot(*inwards)
            x, y = (-_CRASH * gap * inwards).tolist()
        self.force = x, y
        self.touched = self._objects[int(s.object[0])].name if any(self.force) else ''

    def _remember(self) -> None:
        """The turning points of the load, which joints with memory keep."""
        self._history.append((*self.joints, *self.force))
        torques = torques_of(self.model.parameters, np.array(self._history))
        self._history = [self._history[k] for k in remembered([(a, b) for a, b in torques.tolist()])]

    def sensed(self, share: float) -> Floats:
        """As `reported_force`."""
        state = np.array([self.joints]), np.array([self.force]), np.zeros((1, 2)), np.array([share])
        return np.asarray(reported_force(self.cell, self.model, *state, self._metadata)[0])


def free_pose(cell: Cell) -> tuple[float, float]:
    """Joint angles, a tenth of their range within the limits, at which the nominal tip is near the objects and touches
    none, rad.

    Raises:
        UnsupportedDataError: there are none.
    """
    body, middle = ModelBody(cell, cell.nominal), cell.centers.mean(axis=0)
    limits = np.array(cell.limits or _USUAL_LIMITS)
    center = limits.mean(axis=1, keepdims=True)
    limits = np.clip(limits, center - np.pi, center + np.pi)  # the turn in which touches are planned
    q1, q2 = np.meshgrid(*(np.linspace(low, high, 60)[6:-6] for low, high in limits))
    poses = np.column_stack([q1.ravel(), q2.ravel()])
    for pose in poses[np.argsort(np.hypot(*(forward(cell.nominal, poses) - middle).T))].tolist():
        if body.nearest((pose[0], pose[1]))[1] > 0.03:
            return pose[0], pose[1]
    raise UnsupportedDataError('the simulated robot has no room to stand in', 'give a start')


_FREE_FORCE = 30.0
"""N."""


class Malfunction(str, Enum):
    """What can go wrong in the cell."""

    NONE = ''
    DOES_NOT_FOLLOW = 'does_not_follow'
    """The drives stand, whatever is commanded."""
    MOVED = 'moved'
    """Joint 1 creeps off by itself."""
    LIFT_STUCK = 'lift_stuck'
    """The lift stands."""
    HELD_MOVES = 'held_moves'
    """A held joint creeps off."""
    FREE_FORCE = 'free_force'
    """The sensor reads `_FREE_FORCE` more."""
    SILENT_JOINTS = 'silent_joints'
    """No joint states."""
    SILENT_WRENCH = 'silent_wrench'
    """No wrenches."""
    LATE = 'late'
    """All readings come 0.3 s late."""


_Rows = Sequence[Sequence[float]]
"""Of joints, one value each."""


@dataclass(frozen=True)
class PlantSettings:
    """The drives.

    Attributes:
        lag: time constant with which a joint follows its setpoint, s; 0 for none.
        speed: limit of the setpoints, rad/s.
        lift_speed: that of the lift, m/s.
        overload: force at which the drives stop, N; 0 for twice the largest one that the cell allows.
        start: joint angles at the start, rad; empty: near the objects, with room around.

    Raises:
        ParameterError: a negative number, or no speed.
    """

    lag: float = 0.02
    speed: float = 3.0
    lift_speed: float = 0.5
    overload: float = 0.0
    start: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_numbers('drives', self, zero=('lag', 'overload'), signed=('start',))


class Reading(NamedTuple):
    """The cell at one moment.

    Attributes:
        time: since the start, s.
        joints: positions as the encoders report them, in the order of `Plant.names`; None where they are silent.
        force: (x, y) as the sensor reports it, in its frame, with its sign and bias, N; None where it is silent.
        true_force: of the tip on what it touches, base frame, N.
        touched: name of it, empty in free motion.
    """

    time: float
    joints: tuple[float, ...] | None
    force: tuple[float, float] | None
    true_force: tuple[float, float]
    touched: str


class Plant:
    """Drives and sensors of a cell.

    Args:
        cell: as described to its user: joints, limits, lift, held joints, sensor, noise of a touch.
        body: the robot, and what it meets.
        settings: of the drives.
        sensors: noise, bias and resolution.
        seed: of all random numbers.

    Attributes:
        names: of the joints: both of the arm, then the lift and the held ones.
        time: since the start, s.
        fault: what is wrong; may be set at any time.
        scaling: of the time of a motion, from 0 on; may be set at any time.
        active: whether the controller is active, which else drops its motion; may be set at any time.
        stopped: why the drives have stopped; empty where they have not.
        peak_force: largest force so far, N.

    Raises:
        UnsupportedDataError: there is no pose with room around.
    """

    def __init__(
        self,
        cell: Cell,
        body: Body,
        *,
        settings: PlantSettings | None = None,
        sensors: SensorModel = COMMANDED_SENSORS,
        seed: int = 0,
    ) -> None:
        self.cell, self.body, self.settings, self.sensors = cell, body, settings or PlantSettings(), sensors
        self._random = np.random.default_rng([seed, 2])
        lift, s, anywhere = cell.lift, self.settings, (-np.inf, np.inf)
        start = s.start or free_pose(cell)
        # of each joint its name, where it stands, its largest speed and its limits
        joints = list(zip(cell.joint_names, start, [s.speed] * 2, cell.limits or [anywhere] * 2, strict=True))
        if lift:
            joints.append((lift.joint, lift.up, s.lift_speed, (min(lift.up, lift.down), max(lift.up, lift.down))))
        joints += [(name, angle, s.speed, anywhere) for name, angle in cell.hold.items()]
        self.names, position, speeds, self._limits = zip(*joints, strict=True)
        self._position, self._speeds = np.array(position), np.array(speeds)
        self.scaling, self.active, self._elapsed = 1.0, True, 0.0
        self._stop()
        self._overload = self._most = s.overload or 2.0 * cell.touch.max_force
        self.time, self.peak_force, self.stopped, self.fault = 0.0, 0.0, '', Malfunction.NONE
        # of joints and force, in standard deviations
        self._error, self._next = self._random.standard_normal((2, 2, 2))
        self._touching = False
        self._delayed: deque[Reading] = deque()
        body.begin((start[0], start[1]), self._raised)

    def _stop(self) -> None:
        """The setpoint is where the joints are, without a motion."""
        self._motion: tuple[Floats, Floats, Floats | None] | None = None
        self._setpoint, self._rate = self._position.copy(), np.zeros(len(self.names))

    @property
    def _raised(self) -> float:
        lift = self.cell.lift
        return float((self._position[2] - lift.down) / (lift.up - lift.down)) if lift else 0.0

    def command(
        self, names: Sequence[str], times: Sequence[float], positions: _Rows, velocities: _Rows | None = None
    ) -> None:
        """Takes a motion in place of the former one.

        Args:
            names: of all joints, in any order.
            times: of its points from now on, increasing, (k,), s; none: the joints stop.
            positions: the points, (k, number of joints), rad or m.
            velocities: the rates there, likewise; None or empty rows: straight between the points.

        Raises:
            ParameterError: it is refused; the former one goes on.
        """
        points = self._checked(names, times, positions)
        if not len(points):
            self._stop()
            return
        rates: Floats | None = None
        if velocities is not None and len(velocities[0]):
            if any(len(row) != len(names) for row in velocities):
                raise ParameterError('trajectory refused', f'expected {len(names)} velocities at each point')
            if any(velocities[-1]):
                raise ParameterError('trajectory refused', 'the velocity of its last point is not zero')
            rates = np.vstack([self._rate, self._ordered(names, velocities)])
        self._elapsed = 0.0
        self._motion = np.array([0.0, *times]), np.vstack([self._setpoint, points]), rates

    def _ordered(self, names: Sequence[str], rows: _Rows) -> Floats:
        """Readings or rates of the joints, as the arm has them, in the order of its names."""
        found = np.array(rows, dtype=float).reshape(-1, len(names))[:, [list(names).index(name) for name in self.names]]
        return np.hstack([self.cell.angles(found[:, :2]), found[:, 2:]])

    def _checked(self, names: Sequence[str], times: Sequence[float], positions: _Rows) -> Floats:
        """The points in the order of `names`."""
        where = 'trajectory refused'
        if self.stopped:
            raise ParameterError(where, f'the drives have stopped: {self.stopped}', 'reset them')
        if not self.active:
            raise ParameterError(where, "can't accept new action goals, the controller is not running", 'activate it')
        if sorted(names) != sorted(self.names):
            problem = f'expected the joints {" ".join(self.names)}, got {" ".join(names) or "none"}'
            raise ParameterError(where, problem, 'name each once')
        if len(times) != len(positions) or any(len(row) != len(names) for row in positions):
            raise ParameterError(where, f'expected {len(names)} positions in each point')
        if not all(isfinite(value) for row in positions for value in row):
            raise ParameterError(where, 'a position is not a finite number')
        if any(not before < after for before, after in zip([-ROUNDING, *times], times, strict=False)):
            raise ParameterError(where, 'expected time_from_start to grow from point to point')
        points = self._ordered(names, positions)
        for row in points:
            for name, value, (low, high) in zip(self.names, row, self._limits, strict=True):
                if not low - ROUNDING <= value <= high + ROUNDING:
                    raise ParameterError(where, f'{name} at {value:.4g} is beyond its limits {low:g} to {high:g}')
        return points

    def reset(self) -> None:
        """Lets drives that have stopped move again, out of the overload."""
        self.stopped, self._most = '', max(self._overload, 1.1 * hypot(*self.body.force))

    def step(self, time: float) -> Reading:
        """Goes on to a time, s, and reads the sensors there; not back."""
        count = int(np.ceil((time - self.time) / self.body.tick - MICRO))
        for part in range(count):
            self._advance((time - self.time) / (count - part))
        reading = self._read()
        if self.fault is not Malfunction.LATE:
            self._delayed.clear()
            return reading
        self._delayed.append(reading)
        while len(self._delayed) > 1 and self._delayed[1].time <= self.time - 0.3:
            self._delayed.popleft()
        return self._delayed[0]

    def _advance(self, duration: float) -> None:
        self.time += duration
        self._elapsed += self.scaling * duration
        self._move(duration)
        q1, q2 = self._position[:2].tolist()
        self.body.advance(self.time, (q1, q2), self._raised)
        force, touching = hypot(*self.body.force), bool(self.body.touched)
        self.peak_force = max(self.peak_force, force)
        self._most = self._overload if force < self._overload else self._most
        if force > self._most and not self.stopped:
            self.stopped = f'{force:.0f} N on {self.body.touched}, more than {self._overload:g} N'
            self._stop()
        if self._touching and not touching:
            self._next = self._random.standard_normal((2, 2))
        self._touching = touching
        if not touching:  # within some tenths of a second of free motion the error is that of the next touch
            self._error = self._error + (1.0 - exp(-duration / 0.1)) * (self._next - self._error)

    def _move(self, duration: float) -> None:
        """The drives go on, each joint towards its setpoint, the setpoint towards the motion."""
        follow = 1.0 - exp(-duration / self.settings.lag) if self.settings.lag else 1.0
        moves, most = np.full(len(self.names), not self.stopped), self._speeds * duration
        joints: dict[Malfunction, int | slice] = {
            Malfunction.DOES_NOT_FOLLOW: slice(None),
            Malfunction.MOVED: 0,
            Malfunction.HELD_MOVES: -1,
        }
        if self.cell.lift:
            joints[Malfunction.LIFT_STUCK] = 2
        if self.fault in joints:
            moves[joints[self.fault]] = False
        if self.fault in (Malfunction.MOVED, Malfunction.HELD_MOVES):
            self._position[joints[self.fault]] += 0.05 * duration  # rad/s or m/s
        self._setpoint += moves * np.clip(self._wanted() - self._setpoint, -most, most)
        self._position += moves * follow * (self._setpoint - self._position)

    def _wanted(self) -> Floats:
        """Where the motion has the joints now."""
        self._rate = np.zeros(len(self.names))
        if self._motion is None or not self.active:
            self._motion = None
            return self._setpoint
        times, points, rates = self._motion
        k = int(np.searchsorted(times, self._elapsed, side='right'))
        if k == len(times):
            return np.asarray(points[-1])
        span, step = times[k] - times[k - 1], points[k] - points[k - 1]
        part = (self._elapsed - times[k - 1]) / span
        u, w = (step, step) if rates is None else (span * rates[k - 1], span * rates[k])
        self._rate = (6 * part * (1 - part) * step + (1 - part) * (1 - 3 * part) * u + part * (3 * part - 2) * w) / span
        cubic = part * part * (3 - 2 * part), part * (1 - part) ** 2, part * part * (part - 1)
        return np.asarray(points[k - 1] + cubic[0] * step + cubic[1] * u + cubic[2] * w)

    def _read(self) -> Reading:
        s, body, white = self.sensors, self.body, self._random.standard_normal((2, 2))
        joints: tuple[float, ...] | None = None
        wrench: tuple[float, float] | None = None
        error, force = self._sensed()
        if self.fault is not Malfunction.SILENT_JOINTS:
            angles = self.cell.readings(body.joints + error + s.joint_noise * white[0])
            joints = tuple(s.stepped(np.append(angles, self._position[2:])).tolist())
        if self.fault is not Malfunction.SILENT_WRENCH:
            x, y = s.forces(self.cell.sensor.sign, force, white[1]).tolist()
            wrench = x, y
        return Reading(self.time, joints, wrench, body.force, body.touched)

    def zero(self) -> None:
        """Takes the present force as zero, as the driver of a force sensor does when asked."""
        x, y = (-self.cell.sensor.sign.factor * self._sensed()[1]).tolist()
        self.sensors = replace(self.sensors, bias=(x, y))

    def _sensed(self) -> tuple[Floats, Floats]:
        """Error of the joint angles, rad, and the force with that of the touch in the sensor's frame, N, (2,) each."""
        true = np.array([self.body.force])
        share = min(hypot(*self.body.force) / FULL, 1.0)
        errors = self.sensors.touch_errors(self.cell, self._error[:, None], true, share=np.array([share]))
        force = self.body.sensed(share) + errors[1][0] if self.body.touched else np.zeros(2)
        force[0] += _FREE_FORCE * (self.fault is Malfunction.FREE_FORCE)
        return errors[0][0], force
