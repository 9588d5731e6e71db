"""The cell: the robot's nominal model, the discs, the sensor, the noise of one touch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.kinematics import GripperSign as GripperSign
from scara_kinetostatic.model.kinematics import rotate, wrap
from scara_kinetostatic.model.outline import (
    Outline,
    Surfaces,
    boundary,
    crosses,
    inside,
    known_surfaces,
    outline_problem,
    surfaces_of,
)
from scara_kinetostatic.model.parameters import MICRO, MILLI, PAPER_NOMINAL, UNITS, Parameters

Level: TypeAlias = float | tuple[float, float]
"""A standard deviation of both axes, or one of each."""
Limits: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
"""The lower and the upper limit of both joints, rad."""


class Noise(NamedTuple):
    """Repeatability of one touch, one standard deviation.

    The variance of a component of the force is σ_axis² + (force_relative ‖F‖)².

    Attributes:
        joint: of the joint angles, rad; a pair for joint 1 and joint 2.
        force: of a component of the force, N; a pair for x and y of the sensor's frame.
        force_relative: what is added in proportion to the force; None for not known: taken as 0, and estimated where
            the touches ask for it.

    Example:
        >>> import scara_kinetostatic as sk
        >>> sk.Noise(joint=1e-5, force=0.3).force_levels
        (0.3, 0.3)
        >>> sk.Noise(joint=(1e-5, 2e-5), force=0.3, force_relative=0.01).is_plain
        False
    """

    joint: Level
    force: Level
    force_relative: float | None = None

    @property
    def joint_levels(self) -> tuple[float, float]:
        """Of joint 1 and joint 2, rad."""
        return _pair(self.joint)

    @property
    def force_levels(self) -> tuple[float, float]:
        """Of x and y in the sensor's frame without the part that grows, N."""
        return _pair(self.force)

    @property
    def joint_rms(self) -> float:
        """Root mean square over the joints, rad."""
        return _rms(self.joint)

    @property
    def force_rms(self) -> float:
        """Root mean square over the axes of the force without the part that grows, N."""
        return _rms(self.force)

    @property
    def growth(self) -> float:
        """`force_relative`, 0 where it is not known."""
        return self.force_relative or 0.0

    @property
    def is_plain(self) -> bool:
        """Whether both joints, and all components of every force, are alike."""
        return not self.growth and len({*self.joint_levels}) == 1 and len({*self.force_levels}) == 1

    @property
    def levels(self) -> tuple[float, ...]:
        """Of both joints, of both axes of the force, and of the part that grows, (5,)."""
        return (*self.joint_levels, *self.force_levels, self.growth)

    def as_dict(self) -> dict[str, float | list[float]]:
        """As in a file: one number where both axes are alike, the part that grows where it is known."""
        levels = {'joint': _level(self.joint), 'force': _level(self.force)}
        found = {key: list(level) if isinstance(level, tuple) else level for key, level in levels.items()}
        return found if self.force_relative is None else found | {'force_relative': self.force_relative}

    def force_at(self, magnitude: float) -> float:
        """Standard deviation of a component of a force of some magnitude, rms over the axes, N."""
        return float(np.hypot(self.force_rms, self.growth * magnitude)) if self.growth else self.force_rms

    def check(self) -> None:
        """Whether it can be that of a measurement.

        Raises:
            ParameterError: a level is not above 0, or the part that grows is negative.
        """
        shaped = all(np.shape(level) in ((), (2,)) for level in (self.joint, self.force))
        if not shaped or not all(np.isfinite(level) and level > 0 for level in self.levels[:4]):
            problem = f'expected two levels above 0, or pairs of them, got {(self.joint, self.force)}'
            raise ParameterError('noise', problem, 'or leave it out')
        if not (np.isfinite(self.growth) and self.growth >= 0):
            problem = f'expected 0 or more, got {self.force_relative}'
            raise ParameterError('noise.force_relative', problem, 'or leave it out to have it estimated')


class ForceCovariance(NamedTuple):
    """Covariance of the forces of n touches along and across each of them: the entries 11, 21, 22, N².

    (n,) each; one number where the covariance is the same for all forces.
    """

    along: Floats | float
    crossed: Floats | float
    across: Floats | float


def force_covariance(noise: Noise, force: Floats) -> ForceCovariance:
    """Covariance of forces in components along and across them: R diag(σ_x², σ_y²) Rᵀ + (g ‖F‖)² I.

    Args:
        noise: of a touch.
        force: F in the sensor's frame, (n, 2), N.
    """
    by_x, by_y = (level**2 for level in noise.force_levels)
    if by_x == by_y and not noise.growth:
        return ForceCovariance(by_x, 0.0, by_x)
    x, y = force[:, 0], force[:, 1]
    square_y = y * y
    square = x * x + square_y
    grown, more = noise.growth**2 * square, (by_y - by_x) / square
    turned = more * square_y
    return ForceCovariance(by_x + turned + grown, more * x * y, by_y - turned + grown)


def _level(level: Level) -> Level:
    """One number where both axes are alike."""
    first, second = _pair(level)
    return float(first) if first == second else (float(first), float(second))


def _pair(level: Level) -> tuple[float, float]:
    return (level, level) if isinstance(level, (int, float)) else level


def _rms(level: Level) -> float:
    first, second = _pair(level)
    return float(np.sqrt((first**2 + second**2) / 2)) if first != second else first


BASE_FRAME = 'base_link'
"""Frame in which the objects are given, where no plane is stated."""


class Plane(NamedTuple):
    """Where the plane of the arm lies in the frame of the robot, in which poses are published and heard.

    A place (x, y) of the model is origin + x e_x + y e_y there, and the angles count about e_x × e_y. Without a stated
    plane both frames are the same.

    Attributes:
        frame: name of the robot's frame.
        origin: of the plane in it, m.
        x: its x axis there, a unit vector.
        y: its y axis there, a unit vector.
        tip: link of the robot that carries the tip; empty where it is not stated.
    """

    frame: str = BASE_FRAME
    origin: tuple[float, ...] = (0.0, 0.0, 0.0)
    x: tuple[float, ...] = (1.0, 0.0, 0.0)
    y: tuple[float, ...] = (0.0, 1.0, 0.0)
    tip: str = ''

    @property
    def is_stated(self) -> bool:
        """Whether it is another one than the usual."""
        return self != Plane()

    @property
    def axes(self) -> Floats:
        """The rotation of the plane in the robot's frame: its axes x, y and normal as columns, (3, 3)."""
        return np.stack([self.x, self.y, np.cross(self.x, self.y)], axis=1)

    def in_robot(self, places: Floats) -> Floats:
        """Places in the plane, (…, 2), or with a height above it, (…, 3), in the robot's frame, (…, 3), m."""
        return np.asarray(self.origin + places @ self.axes.T[: places.shape[-1]])

    def in_plane(self, places: Floats) -> Floats:
        """The inverse: x, y and height of places in the robot's frame, (…, 3), m."""
        return np.asarray((places - np.array(self.origin)) @ self.axes)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """X, y, z and w of its rotation."""
        return _quaternion(self)


@lru_cache(maxsize=16)
def _quaternion(plane: Plane) -> tuple[float, float, float, float]:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(plane.axes).as_quat().tolist()
    return x, y, z, w


def axes_problem(x: tuple[float, ...], y: tuple[float, ...]) -> str:
    """Why two vectors are not the axes of a plane; empty where they are."""
    lengths, product = np.linalg.norm([x, y], axis=1), float(np.dot(x, y))
    if not np.allclose(lengths, 1.0, rtol=0, atol=1e-6):
        return f'expected x and y of length 1, got {lengths[0]:.6g} and {lengths[1]:.6g}'
    return '' if abs(product) < 1e-6 else f'expected x and y at right angles, got a product of {product:.3g}'


class SensorFrame(str, Enum):
    """Frame in which the wrench is reported: the base, or the one carried by link 2."""

    BASE = 'base'
    TOOL = 'tool'

    def to_base(self, force: Floats, joints: Floats, p: Parameters) -> Floats:
        """Forces in this frame, (n, 2), as seen from the base, with the arm at Q, (n, 2), rad."""
        return force if self is SensorFrame.BASE else rotate(force, joints.sum(axis=1) + p.theta1 + p.theta2)

    def from_base(self, force: Floats, joints: Floats, p: Parameters) -> Floats:
        """The inverse of `to_base`."""
        return force if self is SensorFrame.BASE else rotate(force, -(joints.sum(axis=1) + p.theta1 + p.theta2))


class SensorSign(str, Enum):
    """Whose force the sensor reports: the robot's on the object, or the reaction on the robot."""

    ON_OBJECT = 'on_object'
    ON_ROBOT = 'on_robot'

    @property
    def factor(self) -> float:
        """Of a reading, by which it is the force on the object: 1 or -1."""
        return -1.0 if self is SensorSign.ON_ROBOT else 1.0


class Disc(NamedTuple):
    """A calibration object.

    Attributes:
        name: unique in the cell.
        x: centre in the base frame, m.
        y: centre in the base frame, m.
        radius: from the disc's centre to the tip's centre in contact, m.
        center_std: standard uncertainty of each coordinate of the centre, m; on the plate, where there is one.
        radius_std: standard uncertainty of the radius, m.
        plate: name of the plate that carries it; empty if none.
    """

    name: str
    x: float
    y: float
    radius: float
    center_std: float = 0.0
    radius_std: float = 0.0
    plate: str = ''

    @property
    def is_closed(self) -> bool:
        """Whether it has an inside, as an `Outline` may not have."""
        return True

    @property
    def angle_std(self) -> float:
        """Standard uncertainty of its rotation, rad: none, unlike that of an `Outline`."""
        return 0.0

    def shape(self) -> Floats:
        """Its circle as a closed line, (k, 2), m."""
        angles = np.linspace(0, 2 * np.pi, 97)
        return np.array([self.x, self.y]) + self.radius * np.array([np.cos(angles), np.sin(angles)]).T


class Plate(NamedTuple):
    """What carries several discs: its place and rotation are uncertain, theirs with it.

    The centres of its discs are given in the base frame, as all are; a wrong rotation turns them about the origin.

    Attributes:
        name: unique in the cell.
        x: origin in the base frame, m.
        y: origin in the base frame, m.
        center_std: standard uncertainty of each coordinate of its place, m.
        angle_std: standard uncertainty of its rotation, rad.
    """

    name: str
    x: float
    y: float
    center_std: float = 0.0
    angle_std: float = 0.0


@dataclass(frozen=True)
class Uncertainty:
    """Standard uncertainties (GUM) of what is common to all touches; 0 for exactly known.

    Attributes:
        radius: of an error common to all radii, such as the radius of the tip, m.
        force_gain: of the gain of the force sensor, relative.
        force_rotation: of the angle at which the force sensor is mounted, rad.
        nominal: of nominal values, by the name of the parameter; a parameter that is not there may have any value.
        effects: sizes of the effects that are too small to be detected.

    Raises:
        ParameterError: an uncertainty is negative or not finite, a nominal value's is not above 0 or has no such name.
    """

    radius: float = 0.0
    force_gain: float = 0.0
    force_rotation: float = 0.0
    nominal: Mapping[str, float] = field(default_factory=dict)
    effects: EffectSizes = field(default_factory=lambda: EffectSizes())

    def __post_init__(self) -> None:
        object.__setattr__(self, 'nominal', dict(self.nominal))
        for name in ('radius', 'force_gain', 'force_rotation'):
            _check_uncertainty(f'uncertainty.{name}', getattr(self, name))
        for name, std in self.nominal.items():
            if name not in UNITS:
                problem, remedy = 'no such parameter', f'the names are {" ".join(UNITS)}'
                raise ParameterError(f'uncertainty.nominal: {name!r}', problem, remedy)
            if not (np.isfinite(std) and std > 0):
                raise ParameterError(f'uncertainty.nominal.{name}', f'expected a number above 0, got {std}')


OBJECT_POSITION = 'object_position'
"""Name of the error of an object's place, declared or not."""


class SizeMode(str, Enum):
    """Where the sizes of undetected effects come from."""

    ESTIMATED = 'estimated'
    """From the touches, about those of the class of the arm."""
    TYPICAL = 'typical'
    """Those of the class of the arm (`effects.base.Effect.size`)."""
    NONE = 'none'
    """There are none but those that are stated."""


class ArmClass(str, Enum):
    """What kind of arm it is."""

    INDUSTRIAL = 'industrial'
    DESKTOP = 'desktop'
    PRINTED = 'printed'


class EffectSizes(NamedTuple):
    """How large effects may be that are not detected.

    Attributes:
        sizes: where they come from.
        arm: its class.
        stated: standard deviations that are known, by label or name of the effect, in the unit of its parameters.
    """

    sizes: SizeMode = SizeMode.ESTIMATED
    arm: ArmClass = ArmClass.INDUSTRIAL
    stated: Mapping[str, float] = {}


class Region(NamedTuple):
    """Where the uncertainty of the tip has to hold, base frame, m; by default wherever the arm reaches."""

    x_min: float = -np.inf
    x_max: float = np.inf
    y_min: float = -np.inf
    y_max: float = np.inf

    @property
    def title(self) -> str:
        """What it is called: the workspace where nothing bounds it."""
        return 'region' if np.isfinite(self).any() else 'workspace'

    def holds(self, places: Floats) -> Mask:
        """Whether places, (…, 2), m, are inside, (…)."""
        low, high = (self.x_min, self.y_min), (self.x_max, self.y_max)
        return np.asarray(((places >= low) & (places <= high)).all(axis=-1))


HELD_WITHIN = MILLI
"""A joint that is to be held and is farther from its position has moved, rad or m."""


class Lift(NamedTuple):
    """A joint that raises the tip over everything.

    Attributes:
        joint: its name.
        up: its position while the tip travels, m.
        down: while it touches, m.
    """

    joint: str
    up: float
    down: float


class TouchMotion(NamedTuple):
    """How the touches are made.

    Attributes:
        force: smallest and largest force of a hold, N.
        max_force: never to be exceeded, N.
        speed: of the tip in free travel, m/s.
        contact_speed: towards a contact, and back, m/s.
        clearance: distance kept from objects while the nominal model is all there is, m.
        hold: duration of a hold, s.
        search: how far a contact is sought beyond the expected surface, m.
    """

    force: tuple[float, float] = (20.0, 60.0)
    max_force: float = 90.0
    speed: float = 0.2
    contact_speed: float = 0.006
    clearance: float = 0.012
    hold: float = 0.4
    search: float = 0.01


class Sensor(NamedTuple):
    """The two topics and how the wrench is to be read.

    Attributes:
        joint_states: name of the topic; without a leading slash it is in the namespace of the node.
        wrench: the same of the other one.
        frame: in which the wrench is reported.
        sign: whose force is reported.
        time_offset: added to the stamps of the wrench, s; where stated, the clocks are not compared.
        rotation: of the sensor's x axis against link 2 or the base, rad.
        axes: directions of link 2 and across it in the frame of the sensor, of unit length, where its z axis is not
            across the plane; None where it is.
        tool_weight: mass of a tool that the sensor carries and does not know, kg; None where it is to be found.
        zero_service: name of a Trigger service that sets the force to zero; empty: there is none.
        base_frame: name of the base's frame in ROS; empty: a usual one, or that of `robot.plane`.
        tool_frame: name of the frame that is carried by link 2, its x axis along it; empty: a usual one.
    """

    joint_states: str = '/joint_states'
    wrench: str = '/wrench'
    frame: SensorFrame = SensorFrame.BASE
    sign: SensorSign = SensorSign.ON_OBJECT
    time_offset: float | None = None
    rotation: float = 0.0
    axes: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    tool_weight: float | None = None
    zero_service: str = ''
    base_frame: str = ''
    tool_frame: str = ''

    @property
    def topics(self) -> tuple[str, str]:
        """Both names as seen from the root namespace."""
        return '/' + self.joint_states.lstrip('/'), '/' + self.wrench.lstrip('/')


class Identification(NamedTuple):
    """What was calibrated, by whom and where: what ISO/IEC 17025 (7.8) asks of a certificate.

    Texts, empty where not given.

    Attributes:
        robot: manufacturer and type.
        serial_number: of the robot.
        cell: name of the cell.
        sensor: manufacturer and type of the force sensor.
        sensor_serial_number: its serial number.
        operator: who made the touches.
        laboratory: who answers for the result, with address.
        location: where the touches were made.
        customer: for whom.
        certificate: number of the certificate.
        conditions: of the surroundings, such as the temperature.
        traceability: to which standards discs and sensor are traceable.
        remarks: anything else.
    """

    robot: str = ''
    serial_number: str = ''
    cell: str = ''
    sensor: str = ''
    sensor_serial_number: str = ''
    operator: str = ''
    laboratory: str = ''
    location: str = ''
    customer: str = ''
    certificate: str = ''
    conditions: str = ''
    traceability: str = ''
    remarks: str = ''

    def given(self) -> dict[str, str]:
        """Those that are given, by name."""
        return {name: text for name, text in self._asdict().items() if text}


@dataclass(frozen=True)
class Cell:
    """What is known about the cell before the calibration (`cell.yaml`).

    Attributes:
        nominal: L̄n, with gravity in the plane of the arm.
        discs: the calibration objects, at least one: discs and outlines.
        joint_names: names of q1 and q2 in `JointState`.
        coupling: the part of joint 1's reading that is contained in that of joint 2: the elbow's motor is in the base.
        direction: sign of each reading, -1 where the joint turns clockwise.
        plane: where the plane of the arm lies in the robot's frame.
        sensor: topics, frame and sign of the sensor.
        noise: None where it is to be estimated from the residuals.
        gripper_sign: sign of (7).
        identification: of robot, cell, sensor and people, for the report.
        plates: what carries several discs.
        uncertainty: of what is common to all touches; that of each disc and plate is theirs.
        tolerance: largest expanded uncertainty (95 %) of the tip that the use allows, m; None where none is stated.
        tip_radius: of the tip, m; contained in the radii of the discs. None where it is not stated.
        region: where the uncertainty of the tip has to hold.
        limits: lower and upper one of each joint's angle Q, rad, (2, 2); None where they are not stated.
        lift: the joint that raises the tip; None where there is none.
        hold: other joints of the controller, by name, and the position that they keep.
        obstacles: corners of what the tip must not meet beside the discs, m, base frame.
        touch: how the touches are made.

    Raises:
        ParameterError: a noise level is not above 0, an uncertainty negative, a disc on a plate that is not there.

    Example:
        >>> import scara_kinetostatic as sk
        >>> disc = sk.Disc('pin', x=0.3, y=0.2, radius=0.05)
        >>> cell = sk.Cell(nominal=sk.Parameters(l1=0.25, l2=0.2), discs=(disc,))
        >>> cell.centers
        array([[0.3, 0.2]])
    """

    nominal: Parameters
    discs: tuple[Disc | Outline, ...]
    joint_names: tuple[str, str] = ('joint1', 'joint2')
    sensor: Sensor = field(default_factory=Sensor)
    noise: Noise | None = None
    gripper_sign: GripperSign = GripperSign.PHYSICAL
    identification: Identification = field(default_factory=Identification)
    plates: tuple[Plate, ...] = ()
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    tolerance: float | None = None
    tip_radius: float | None = None
    region: Region = field(default_factory=Region)
    limits: Limits | None = None
    lift: Lift | None = None
    hold: Mapping[str, float] = field(default_factory=dict)
    obstacles: tuple[tuple[tuple[float, float], ...], ...] = ()
    touch: TouchMotion = field(default_factory=TouchMotion)
    coupling: float = 0.0
    direction: tuple[int, int] = (1, 1)
    plane: Plane = Plane()  # noqa: RUF009 - immutable

    def __post_init__(self) -> None:
        plates = {plate.name for plate in self.plates}
        for item in (*self.plates, *self.discs):
            for name in ('center_std', 'radius_std', 'angle_std'):
                _check_uncertainty(f'{item.name}: {name}', getattr(item, name, 0.0))
            if not isinstance(item, Plate) and item.plate and item.plate not in plates:
                raise ParameterError(f'{item.name}: plate', f'no plate {item.plate!r} in the cell', 'add it to plates')
        held = [name for name in self.uncertainty.nominal if name not in self.nominal.names]
        if held:
            reason = 'without gravity there is no such parameter'
            raise ParameterError(f'uncertainty.nominal.{held[0]}', reason, 'give `gravity` or leave it out')
        for name in ('tolerance', 'tip_radius'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ParameterError(name, f'expected a number above 0, got {value}', 'or leave it out')
        for outline in (disc for disc in self.discs if isinstance(disc, Outline)):
            if self.tip_radius is None:
                missing = f'its radius is needed for the outline of {outline.name!r}'
                raise ParameterError('tip', missing, 'add tip: {radius: 0.005}, m')
            if (problem := outline_problem(outline, self.tip_radius)) is not None:
                raise ParameterError(outline.name, *problem)
        if self.noise is not None:
            self.noise.check()
            levels = _level(self.noise.joint), _level(self.noise.force)
            object.__setattr__(self, 'noise', Noise(*levels, self.noise.force_relative))

    def in_turn(self, joints: Floats) -> Floats:
        """The same joint angles, (…, 2), rad: those beyond the limits in the turn about the middle of these."""
        if self.limits is None:
            return joints
        low, high = np.array(self.limits).T
        middle = (low + high) / 2
        return np.where((joints >= low) & (joints <= high), joints, middle + wrap(joints - middle))

    def beyond_limits(self, joints: Floats, margin: float = 0.0) -> Mask:
        """Whether each joint angle, (…, 2), rad, is beyond its limits less a margin in every turn, or no number."""
        low, high = np.array(self.limits or [(-np.inf, np.inf)] * 2).T
        joints = self.in_turn(joints)
        return ~((joints >= low + margin) & (joints <= high - margin))

    def can_take(self, joints: Floats, margin: float = 0.0) -> Mask:
        """Whether the arm may be in poses (…, 2), rad, (…): within the limits, where the cell states some."""
        return np.asarray(~self.beyond_limits(joints, margin).any(axis=-1))

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centres of the discs, and reference points of outlines, shape (m, 2), m."""
        return np.array([[disc.x, disc.y] for disc in self.discs])

    @property
    def radii(self) -> NDArray[np.float64]:
        """Radii of the discs, shape (m,), m; of an outline that of a circle around all places of the tip on it."""
        tip = self.tip_radius or 0.0
        return np.array([disc.radius + (tip if isinstance(disc, Outline) else 0.0) for disc in self.discs])

    @property
    def has_outlines(self) -> bool:
        """Whether any object is not a disc."""
        return any(isinstance(disc, Outline) for disc in self.discs)

    @property
    def surfaces(self) -> Surfaces:
        """The edges and arcs on which the tip's centre is in contact: of each disc its circle."""
        return known_surfaces(self.discs, self.tip_radius)

    @property
    def undeclared_places(self) -> tuple[str, ...]:
        """Names of the objects of whose place no uncertainty is stated: theirs, their plate's, or as an effect's."""
        stated, plates = self.uncertainty.effects.stated, {p.name for p in self.plates if p.center_std}
        known = {d.name for d in self.discs if d.center_std or d.plate in plates}
        known |= {d.name for d in self.discs if {OBJECT_POSITION, f'{OBJECT_POSITION}[{d.name}]'} & stated.keys()}
        return tuple(disc.name for disc in self.discs if disc.name not in known)

    @property
    def surface_std(self) -> float:
        """Standard uncertainty of where the surface of a disc is, at most, m."""
        placed = max(disc.center_std + disc.radius_std for disc in self.discs)
        return placed + max((plate.center_std for plate in self.plates), default=0.0)

    def angles(self, readings: Floats) -> Floats:
        """Q of the model from what the robot reports as its joints, (…, 2), rad.

        Everything outside, messages, recordings, tables and exported files, has readings; inside are angles. The angle
        is the reading, that of joint 2 less `coupling` times that of joint 1, times `direction`.
        """
        return self.in_sense(_coupled(readings, -self.coupling))

    def readings(self, angles: Floats) -> Floats:
        """What the robot reports, and is commanded to, at Q of the model, (…, 2), rad; of differences alike."""
        return _coupled(self.in_sense(angles), self.coupling)

    def in_sense(self, values: Floats) -> Floats:
        """Values of both joints, (…, 2), such as torques, in the sense of readings from that of angles, or back."""
        return values if self.direction == (1, 1) else values * np.array(self.direction)

    @property
    def force_axes(self) -> Floats:
        """By which wrenches (fx, fy, fz), as they come, give the force in the plane, (2, 3): f = A w."""
        if self.sensor.axes is not None:
            return np.array(self.sensor.axes)
        in_plane = self.plane.axes.T if self.sensor.frame is SensorFrame.BASE else np.eye(3)
        cosine, sine = np.cos(self.sensor.rotation), np.sin(self.sensor.rotation)
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0]]) @ in_plane

    def tool_pull(self, joints: Floats) -> Floats:
        """What the weight that is stated for the tool adds to readings in its frame at Q, (…, 2), rad: (…, 2), N."""
        mass = self.sensor.tool_weight or 0.0
        mass *= 1.0 if self.sensor.sign is SensorSign.ON_ROBOT else -1.0
        angle = joints.sum(axis=-1) + self.nominal.theta1 + self.nominal.theta2
        return rotate(np.broadcast_to(mass * np.array(self.nominal.gravity), joints.shape), -angle)

    @property
    def other_joints(self) -> tuple[str, ...]:
        """Names of the controller's joints beside the two: the lift, then those to be held."""
        return (*((self.lift.joint,) if self.lift else ()), *self.hold)

    @property
    def positions(self) -> dict[str, float]:
        """Where they are in a touch, by name, rad or m."""
        return {**({self.lift.joint: self.lift.down} if self.lift else {}), **self.hold}

    def moved(self, others: Floats) -> Mask:
        """Which of the other joints are not where they are to be held, for positions (…, h), rad or m; NaN: unknown."""
        held = np.array([self.hold.get(name, np.nan) for name in self.other_joints])
        return np.asarray(np.abs(others - held) > HELD_WITHIN)

    def moved_joint(self, others: Floats) -> str:
        """The first of them in words, for positions (h,); empty where none has moved."""
        for name, at, moved in zip(self.other_joints, others, self.moved(others), strict=True):
            if moved:
                return f'{name} is at {at:.4g}, expected {self.hold[name]:.4g} (robot.hold)'
        return ''


@np.errstate(invalid='ignore')  # readings may be infinite
def _coupled(joints: Floats, part: float) -> Floats:
    """A part of joint 1 added to joint 2, (…, 2); joints as they are without one."""
    return np.stack([joints[..., 0], joints[..., 1] + part * joints[..., 0]], axis=-1) if part else joints


def turned_limits(limits: Limits | None, direction: tuple[int, int]) -> Limits | None:
    """Limits of the readings as those of the angles, or back: turned round where a joint turns clockwise."""
    if limits is None:
        return None
    one, other = (pair if sign > 0 else (-pair[1], -pair[0]) for pair, sign in zip(limits, direction, strict=True))
    return one, other


def different_parts(one: Cell, other: Cell) -> list[str]:
    """Sections of the cell file in which two descriptions differ, discs by name."""
    robots = [(cell.nominal, cell.joint_names, cell.coupling, cell.direction, cell.plane) for cell in (one, other)]
    parts = [] if robots[0] == robots[1] else ['robot']
    discs, others = ({disc.name: disc for disc in cell.discs} for cell in (one, other))
    parts += sorted(name for name in discs.keys() | others.keys() if discs.get(name) != others.get(name))
    sensors = [(cell.sensor.topics, cell.sensor[2:-3]) for cell in (one, other)]  # relative or in the root namespace
    parts += ['sensor'] if sensors[0] != sensors[1] else []
    for name in ('noise', 'gripper_sign', 'plates', 'uncertainty', 'tolerance', 'region'):
        if getattr(one, name) != getattr(other, name):
            parts.append('model' if name == 'gripper_sign' else name)
    # the people may be others
    things = ('robot', 'serial_number', 'cell', 'sensor', 'sensor_serial_number')
    pairs = ((getattr(one.identification, name), getattr(other.identification, name)) for name in things)
    return parts + ['identification'] * any(a and b and a != b for a, b in pairs)


def _check_uncertainty(where: str, std: float) -> None:
    if not (np.isfinite(std) and std >= 0):
        raise ParameterError(where, f'expected a standard uncertainty of 0 or more, got {std}')


def _gap(one: Disc | Outline, other: Disc | Outline, tip_radius: float | None) -> float:
    """Distance of two objects between the places of the tip on them, m; below 0 where they overlap, -inf if open ones
    cross.
    """
    if isinstance(one, Disc):
        one, other = other, one
    if isinstance(one, Disc):
        return float(np.hypot(one.x - other.x, one.y - other.y) - one.radius - other.radius)
    if isinstance(other, Disc):
        places, center = boundary(surfaces_of([one], tip_radius)), np.array([[other.x, other.y]])
        to_center = float(np.hypot(*(places - center).T).min())
        return -to_center if one.is_closed and inside(places, center)[0] else to_center - other.radius
    items = one, other
    places, others = lines = [boundary(surfaces_of([item], tip_radius)) for item in items]
    away = np.sqrt(((places[:, None] - others) ** 2).sum(axis=-1))
    depths = [away.min(axis=1 - k)[inside(lines[1 - k], lines[k])] for k in (0, 1) if items[1 - k].is_closed]
    if any(depth.size for depth in depths):
        return -float(np.concatenate(depths).max())
    return -np.inf if crosses(np.array(one.corners), np.array(other.corners)) else float(away.min())


PAPER_DISCS = (Disc('disc_1', -0.25, 0.30, 0.15), Disc('disc_2', 0.20, 0.40, 0.05), Disc('disc_3', 0.05, 0.25, 0.08))
"""The three discs of figure 3."""
MEASURED_DISCS = tuple(disc._replace(center_std=3 * MICRO, radius_std=2 * MICRO) for disc in PAPER_DISCS)
"""The same, as known as by a coordinate measuring machine."""
PAPER_CELL = Cell(
    PAPER_NOMINAL, MEASURED_DISCS, noise=Noise(joint=1e-5, force=0.3), sensor=Sensor('joint_states', 'wrench')
)
"""The cell of the paper, with measured discs and typical noise; its topics are in the namespace of the nodes."""


def layout_problems(cell: Cell, centers: Floats, radii: Floats) -> list[str]:
    """Why discs cannot be touched, or not without touching another one, one clause each; empty where they can.

    Args:
        cell: for the names and the nominal arm.
        centers: of the m discs, base frame, (m, 2), m.
        radii: of them, to the centre of the tip, (m,), m.
    """
    base = np.array([cell.nominal.x0, cell.nominal.y0])
    farthest, nearest = cell.nominal.l1 + cell.nominal.l2, abs(cell.nominal.l1 - cell.nominal.l2)
    names, found = [disc.name for disc in cell.discs], list[str]()
    for disc, name, radius, away in zip(cell.discs, names, radii, np.linalg.norm(centers - base, axis=1), strict=True):
        first, last, covers = away - radius, away + radius, away <= radius
        if isinstance(disc, Outline):
            line = boundary(surfaces_of([disc], cell.tip_radius))
            distances = np.hypot(*(line - base).T)
            first, last, covers = distances.min(), distances.max(), disc.is_closed and inside(line, base[None])[0]
        if covers:
            found.append(f'object {name!r} covers the base of the robot')
        elif first > farthest or last < nearest:
            span = f'{first:.4g} to {last:.4g} m from the base'
            found.append(f'object {name!r} is out of reach, {span}; the tip reaches {nearest:.4g} to {farthest:.4g} m')
    for i in range(1, len(radii)):
        gaps = np.linalg.norm(centers[:i] - centers[i], axis=1) - radii[:i] - radii[i]
        if cell.has_outlines:
            gaps = np.where(gaps < 0, [_gap(cell.discs[j], cell.discs[i], cell.tip_radius) for j in range(i)], gaps)
        for j in (j for j in np.argsort(gaps) if gaps[j] < 0):
            how = f'overlap by {-gaps[j]:.4g} m' if np.isfinite(gaps[j]) else 'cross'
            found.append(f'discs {names[j]!r} and {names[i]!r} {how}')
    return found
