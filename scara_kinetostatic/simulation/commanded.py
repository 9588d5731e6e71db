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
from math import cos, exp, hypot, isfinite, sin
from typing import NamedTuple, Protocol

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, EffectSizes, Lift, Region, SensorSign, SizeMode, Uncertainty
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import as_model
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.outline import Outline, Surfaces, inside
from scara_kinetostatic.model.touch import remembered, torques_of
from scara_kinetostatic.simulation.plan import check_numbers
from scara_kinetostatic.simulation.streams import TYPICAL_NOISE, Robot, SensorModel, reported_force
from scara_kinetostatic.touches.load_history import SMALLEST_REVERSAL

FULL = 10.0
"""Force from which on the error of a touch has its full size, N."""
RAISED = 0.9
"""Part of its way from which on the lift is over all objects."""
COMMANDED_SENSORS = SensorModel(joint_rate=250.0, wrench_rate=250.0, jitter=0.0, offset=0.0)
"""As usual, but both at 250 Hz."""


DEMO_CELL = replace(
    PAPER_CELL,
    limits=((-2.6, 2.6), (-2.6, 2.6)),
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


class Circle(NamedTuple):
    """The surface of an object next to the tip, as an arc.

    Attributes:
        name: of the object.
        number: of the disc; the number of discs for an obstacle.
        gap: distance of the rigid tip's centre from touching it, m; negative where it is within.
        x: of the arc's centre, m.
        y: likewise.
        radius: of the arc along which the tip's centre moves, m.
        tangent: unit vector along a straight edge of an object; None of an arc.
        surface: number among the surfaces of the cell; -1 of a disc or an obstacle.
    """

    name: str
    number: int
    gap: float
    x: float
    y: float
    radius: float
    tangent: tuple[float, float] | None = None
    surface: int = -1


_FLAT = 10.0
"""Radius of the arc in whose place an edge stands, m: over 1 mm it is straight to 0.1 µm."""
_SHARP = 1e-4
"""Least radius of a corner, m."""
_NEAR = 3e-3
"""Gap above which there is no contact, m: effects and uncertainties of objects are smaller."""


_DEEP, _CRASH = 0.01, 1e5
"""Depth beyond which a tip without an equilibrium has crashed into an object, m; force by depth then, N/m."""


def _circle_of_outline(name: str, number: int, outline: Floats, tip: Floats, tip_radius: float) -> Circle:
    """The edge or corner of an outline next to the tip, (2,), m."""
    along = np.roll(outline, -1, axis=0) - outline
    part = np.clip(((tip - outline) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    feet = outline + part[:, None] * along
    distances = np.hypot(*(tip - feet).T)
    k = int(distances.argmin())
    foot, distance = feet[k], max(float(distances[k]), 1e-12)
    side = -1.0 if inside(outline, tip[None])[0] else 1.0
    is_edge = 0.0 < part[k] < 1.0 or side < 0
    inner, outward = _FLAT if is_edge else 0.0, side * (tip - foot) / distance
    center = foot - inner * outward
    radius = inner + (tip_radius if is_edge else max(tip_radius, _SHARP))
    return Circle(name, number, side * distance - tip_radius, float(center[0]), float(center[1]), radius)


def _circle_of_object(number: int, name: str, is_closed: bool, first: int, surfaces: Surfaces, tip: Floats) -> Circle:
    """The edge or corner of an object next to the tip, (2,), m; `first` is the number of its first surface."""
    distances = surfaces.distances(tip[None])[0]
    k = int(distances.argmin())
    (x, y), radius, tangent = (part[k] for part in surfaces[1:4])
    along, gap = float((tip - (x, y)) @ tangent), surfaces.gaps(tip[None])[0, k]
    if not is_closed and tangent.any() and abs(along) > surfaces.halves[k]:  # past the end of an open outline
        gap = distances[k]
    edge = (float(tangent[0]), float(tangent[1])) if tangent.any() else None
    return Circle(name, number, float(gap), float(x), float(y), float(radius), edge, first + k)


class _Movement:
    """The last movement of one joint, as `last_movement` has it, and its part in contact; followed sample by sample."""

    def __init__(self, angle: float) -> None:
        self._begin = self._far = self._contact = angle
        self._touching = False

    def follow(self, angle: float, touching: bool) -> None:
        """Takes the next angle, rad."""
        sense = 1.0 if self._far >= self._begin else -1.0
        if sense * (angle - self._far) > 0:
            self._far = angle
        elif sense * (self._far - angle) > SMALLEST_REVERSAL:
            self._begin, self._far = self._far, angle
            self._contact = self._begin
        if touching and not self._touching:
            self._contact = angle
        self._touching = touching

    @property
    def approach(self) -> float:
        """From the last reversal on, rad."""
        return self._far - self._begin

    @property
    def press(self) -> float:
        """From the last reversal on, or from the begin of the contact where that is later, rad."""
        return self._far - self._contact


class ModelBody:
    """The robot by its model: A(Q, L̄) with the effects and with what the joints remember.

    Args:
        cell: with the discs and obstacles as they truly are.
        truth: the simulated robot.
    """

    tick = 0.004

    def __init__(self, cell: Cell, truth: Robot) -> None:
        self.cell, self.model = cell, as_model(truth)
        self._discs, self._objects = [], []
        for k, disc in enumerate(cell.discs):
            own = cell.surfaces.object == k
            if isinstance(disc, Outline):
                surfaces = cell.surfaces.select(own)
                self._objects.append((k, disc.name, disc.is_closed, int(np.argmax(own)), surfaces))
            else:
                self._discs.append((k, disc.name, disc.x, disc.y, disc.radius))
        self._outlines = [np.array(outline, dtype=float) for outline in cell.obstacles]
        self.begin((0.0, 0.0), 0.0)

    def begin(self, joints: tuple[float, float], lift: float) -> None:
        """Stands at motor angles, relaxed."""
        self.force, self.touched, self.contacts = (0.0, 0.0), '', 0
        self.joints, self._raised, self._time = joints, lift > RAISED, 0.0
        self._movements = [_Movement(angle) for angle in joints]
        self._history: list[tuple[float, float, float, float]] = []
        self._metadata = TouchMetadata.plain(1)

    def nearest(self, joints: tuple[float, float]) -> Circle | None:
        """What the rigid tip is next to, or deepest within, at motor angles."""
        p = self.model.parameters
        first = joints[0] + p.theta1
        second = first + joints[1] + p.theta2
        x, y = p.x0 + p.l1 * cos(first) + p.l2 * cos(second), p.y0 + p.l1 * sin(first) + p.l2 * sin(second)
        found = [Circle(name, k, hypot(x - u, y - v) - r, u, v, r) for k, name, u, v, r in self._discs]
        tip, size = np.array([x, y]), self.cell.tip_radius or 0.0
        found += [
            _circle_of_outline(f'obstacle {k + 1}', len(self.cell.discs), outline, tip, size)
            for k, outline in enumerate(self._outlines)
        ]
        found += [_circle_of_object(*item, tip) for item in self._objects]
        return min(found, key=lambda circle: circle.gap, default=None)

    def advance(self, time: float, joints: tuple[float, float], lift: float) -> None:
        """The equilibrium at motor angles, next to that of the step before."""
        raised = lift > RAISED
        if raised == self._raised and max(abs(a - b) for a, b in zip(joints, self.joints, strict=True)) < 1e-9:
            return
        self.joints, self._raised, self._time = joints, raised, time
        for movement, angle in zip(self._movements, joints, strict=True):
            movement.follow(angle, bool(self.touched))
        circle = None if raised else self.nearest(joints)
        before = self.touched
        if circle is None or circle.gap > _NEAR:
            self.force, self.touched = (0.0, 0.0), ''
        else:
            self._press(circle)
        self.contacts += bool(self.touched) and not before
        if self.model.effects and (self.touched or before):
            self._remember()

    def _press(self, circle: Circle) -> None:
        """The force of the contact with an arc; where no equilibrium is found it stays, deep inside it is a crash."""
        q = np.array([self.joints])
        if self.model.effects:
            history = np.array([self._history]) if self._history else None
            approach = np.array([[movement.approach for movement in self._movements]])
            press = np.array([[movement.press for movement in self._movements]])
            self._metadata = TouchMetadata(
                np.array([circle.number]), np.array([self._time]), approach, posture(self.model.parameters, q), press,
                history, order=np.array([self.contacts]), surface=np.array([circle.surface]),
            )  # fmt: skip
        warm_start = np.array([self.force]) if self.touched else None
        center = np.array([[circle.x, circle.y]])
        tangents = np.array([circle.tangent or (0.0, 0.0)]) if self._objects else None
        found = contact(
            self.model, q, center, np.array([circle.radius]), self.cell.gripper, warm_start=warm_start,
            metadata=self._metadata, tangents=tangents,
        )  # fmt: skip
        if found.solved[0]:
            self.force = float(found.force[0, 0]), float(found.force[0, 1])
        elif circle.gap < -_DEEP:
            out = center[0] - forward(self.model.parameters, q)[0]
            if circle.tangent is not None:  # into the object, at right angles to the edge
                out = np.array([-circle.tangent[1], circle.tangent[0]])
            x, y = -_CRASH * circle.gap * out / np.hypot(*out)
            self.force = float(x), float(y)
        self.touched = circle.name if any(self.force) else ''

    def _remember(self) -> None:
        """The turning points of the load, which joints with memory keep."""
        self._history.append((*self.joints, *self.force))
        torques = torques_of(self.model.parameters, np.array(self._history))
        self._history = [self._history[k] for k in remembered([(a, b) for a, b in torques.tolist()])]

    def sensed(self, share: float) -> Floats:
        """As `reported_force`."""
        state = np.array([self.joints]), np.array([self.force]), np.zeros((1, 2)), np.array([share])
        return np.asarray(reported_force(self.cell, self.model, *state, self._metadata)[0])


_ROOM = 0.03
"""Kept free around the tip at the start, m."""


def free_pose(cell: Cell) -> tuple[float, float]:
    """Joint angles, a tenth of their range within the limits, at which the nominal tip is near the objects and touches
    none, rad.

    Raises:
        UnsupportedDataError: there are none.
    """
    body, middle = ModelBody(cell, cell.nominal), cell.centers.mean(axis=0)
    limits = np.array(cell.limits or [(-2.6, 2.6)] * 2)
    center = limits.mean(axis=1, keepdims=True)
    limits = np.clip(limits, center - np.pi, center + np.pi)  # the turn in which touches are planned
    q1, q2 = np.meshgrid(*(np.linspace(low, high, 60)[6:-6] for low, high in limits))
    poses = np.column_stack([q1.ravel(), q2.ravel()])
    for pose in poses[np.argsort(np.hypot(*(forward(cell.nominal, poses) - middle).T))].tolist():
        circle = body.nearest((pose[0], pose[1]))
        if circle is None or circle.gap > _ROOM:
            return pose[0], pose[1]
    raise UnsupportedDataError('the simulated robot has no room to stand in', 'give a start')


class Fault(str, Enum):
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
    """The sensor reads 30 N more."""
    SILENT_JOINTS = 'silent_joints'
    """No joint states."""
    SILENT_WRENCH = 'silent_wrench'
    """No wrenches."""
    LATE = 'late'
    """All readings come 0.3 s late."""


_Rows = Sequence[Sequence[float]]
"""Of joints, one value each."""
_CREEP = 0.05
"""Speed at which a joint creeps off, rad/s or m/s."""


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
        lift, s = cell.lift, self.settings
        self.names = (*cell.joint_names, *([lift.joint] if lift else []), *cell.hold)
        start = s.start or free_pose(cell)
        self._position = [*start, *([lift.up] if lift else []), *cell.hold.values()]
        self._setpoint = list(self._position)
        self._speeds = [s.speed, s.speed, *([s.lift_speed] if lift else []), *(s.speed for _ in cell.hold)]
        self._limits = [*(cell.limits or [(-np.inf, np.inf)] * 2)]
        self._limits += [(min(lift.up, lift.down), max(lift.up, lift.down))] if lift else []
        self._limits += [(-np.inf, np.inf) for _ in cell.hold]
        self._motion: tuple[list[float], list[list[float]], list[list[float]] | None] | None = None
        self.scaling, self.active, self._elapsed, self._rate = 1.0, True, 0.0, [0.0] * len(self.names)
        self._overload = self._most = s.overload or 2.0 * cell.touch.max_force
        self.time, self.peak_force, self.stopped, self.fault = 0.0, 0.0, '', Fault.NONE
        self._noise = sensors.touch_noise or cell.noise or TYPICAL_NOISE
        # of joints and force, in standard deviations
        self._error, self._next = self._random.standard_normal((2, 4)).tolist()
        self._touching = False
        self._delayed: deque[Reading] = deque()
        body.begin((start[0], start[1]), self._raised)

    @property
    def _raised(self) -> float:
        lift = self.cell.lift
        return (self._position[2] - lift.down) / (lift.up - lift.down) if lift else 0.0

    @property
    def left(self) -> float:
        """Time that is left of the motion, s."""
        return max(0.0, self._motion[0][-1] - self._elapsed) if self._motion else 0.0

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
        if not points:
            self._motion, self._setpoint, self._rate = None, list(self._position), [0.0] * len(self.names)
            return
        rates: list[list[float]] | None = None
        if velocities is not None and len(velocities[0]):
            if any(velocities[-1]):
                raise ParameterError('trajectory refused', 'the velocity of its last point is not zero')
            rates = [self._rate, *self._ordered(names, velocities)]
        self._elapsed = 0.0
        self._motion = [0.0, *times], [list(self._setpoint), *points], rates

    def _ordered(self, names: Sequence[str], rows: _Rows) -> list[list[float]]:
        """Readings or rates of the joints, as the arm has them, in the order of its names."""
        order = [list(names).index(name) for name in self.names]
        found = [[float(row[k]) for k in order] for row in rows]
        return [[*self.cell.angles(np.array(row[:2])).tolist(), *row[2:]] for row in found]

    def _checked(self, names: Sequence[str], times: Sequence[float], positions: _Rows) -> list[list[float]]:
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
        if any(not before < after for before, after in zip([-1e-9, *times], times, strict=False)):
            raise ParameterError(where, 'expected time_from_start to grow from point to point')
        points = self._ordered(names, positions)
        for row in points:
            for name, value, (low, high) in zip(self.names, row, self._limits, strict=True):
                if not low - 1e-9 <= value <= high + 1e-9:
                    raise ParameterError(where, f'{name} at {value:.4g} is beyond its limits {low:g} to {high:g}')
        return points

    def reset(self) -> None:
        """Lets drives that have stopped move again, out of the overload."""
        self.stopped, self._most = '', max(self._overload, 1.1 * hypot(*self.body.force))

    def step(self, time: float) -> Reading:
        """Goes on to a time, s, and reads the sensors there; not back."""
        count = int(np.ceil((time - self.time) / self.body.tick - 1e-6))
        for part in range(count):
            self._advance((time - self.time) / (count - part))
        reading = self._read()
        if self.fault is not Fault.LATE:
            self._delayed.clear()
            return reading
        self._delayed.append(reading)
        while len(self._delayed) > 1 and self._delayed[1].time <= self.time - 0.3:
            self._delayed.popleft()
        return self._delayed[0]

    def _advance(self, duration: float) -> None:
        self.time += duration
        self._elapsed += self.scaling * duration
        wanted, follow = self._wanted(), 1.0 - exp(-duration / self.settings.lag) if self.settings.lag else 1.0
        stands = self.stopped or self.fault is Fault.DOES_NOT_FOLLOW
        creeping = {Fault.MOVED: 0, Fault.HELD_MOVES: len(self.names) - 1}.get(self.fault, -1)
        stuck = 2 if self.fault is Fault.LIFT_STUCK and self.cell.lift else -1
        for k, (goal, speed) in enumerate(zip(wanted, self._speeds, strict=True)):
            if k == creeping:
                self._position[k] += _CREEP * duration
            if stands or k in (creeping, stuck):
                continue
            most = speed * duration
            self._setpoint[k] += min(max(goal - self._setpoint[k], -most), most)
            self._position[k] += follow * (self._setpoint[k] - self._position[k])
        self.body.advance(self.time, (self._position[0], self._position[1]), self._raised)
        force, touching = hypot(*self.body.force), bool(self.body.touched)
        self.peak_force = max(self.peak_force, force)
        self._most = self._overload if force < self._overload else self._most
        if force > self._most and not self.stopped:
            self.stopped = f'{force:.0f} N on {self.body.touched}, more than {self._overload:g} N'
            self._motion, self._setpoint, self._rate = None, list(self._position), [0.0] * len(self.names)
        if self._touching and not touching:
            self._next = self._random.standard_normal(4).tolist()
        self._touching = touching
        if not touching:  # within some tenths of a second of free motion the error is that of the next touch
            part = 1.0 - exp(-duration / 0.1)
            self._error = [a + part * (b - a) for a, b in zip(self._error, self._next, strict=True)]

    def _wanted(self) -> list[float]:
        """Where the motion has the joints now."""
        if self._motion is None or not self.active:
            self._motion, self._rate = None, [0.0] * len(self.names)
            return self._setpoint
        times, points, rates = self._motion
        while len(times) > 1 and self._elapsed >= times[1]:
            for every in (times, points, rates or []):
                del every[:1]
        if len(times) == 1:
            self._rate = [0.0] * len(self.names)
            return points[0]
        span = times[1] - times[0]
        part = (self._elapsed - times[0]) / span
        mean = [(b - a) / span for a, b in zip(points[0], points[1], strict=True)]
        if rates is None:
            self._rate = mean
            return [a + part * span * v for a, v in zip(points[0], mean, strict=True)]
        ends = list(zip(points[0], mean, rates[0], rates[1], strict=True))
        self._rate = [
            6 * part * (1 - part) * v + (1 - part) * (1 - 3 * part) * u + part * (3 * part - 2) * w
            for _, v, u, w in ends
        ]
        cubic = part * part * (3 - 2 * part), part * (1 - part) ** 2, part * part * (part - 1)
        return [a + span * (cubic[0] * v + cubic[1] * u + cubic[2] * w) for a, v, u, w in ends]

    def _read(self) -> Reading:
        s, body, noise = self.sensors, self.body, self._random.standard_normal(4).tolist()
        joints: tuple[float, ...] | None = None
        if self.fault is not Fault.SILENT_JOINTS:
            levels = self._noise.joint_levels
            angles = [body.joints[k] + (levels[k] * self._error[k] + s.joint_noise * noise[k]) for k in (0, 1)]
            read = [*self.cell.readings(np.array(angles)).tolist(), *self._position[2:]]
            joints = tuple(round(each / s.resolution) * s.resolution if s.resolution else each for each in read)
        wrench: tuple[float, float] | None = None
        if self.fault is not Fault.SILENT_WRENCH:
            x, y = self._sensed()
            wrench = x + s.bias[0] + s.force_noise * noise[2], y + s.bias[1] + s.force_noise * noise[3]
        return Reading(self.time, joints, wrench, body.force, body.touched)

    def zero(self) -> None:
        """Takes the present force as zero, as the driver of a force sensor does when asked."""
        x, y = self._sensed()
        self.sensors = replace(self.sensors, bias=(-x, -y))

    def _sensed(self) -> tuple[float, float]:
        """The force with the error of the touch, in the frame of the sensor and with its sign, N."""
        force, x, y = hypot(*self.body.force), 0.0, 0.0
        if self.body.touched:
            share, grown = min(force / FULL, 1.0), self._noise.growth * force
            levels = [hypot(level * share, grown) for level in self._noise.force_levels]
            x, y = (self.body.sensed(share) + np.array(levels) * self._error[2:4]).tolist()
        x += 30.0 * (self.fault is Fault.FREE_FORCE)
        sign = -1.0 if self.cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
        return sign * x, sign * y
