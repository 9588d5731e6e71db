"""Scenes, robots in the engine with their effects; the engine, which integrates them; the body of a commanded cell."""

from __future__ import annotations

import math
from cmath import rect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from scara_kinetostatic.errors import CellError, InputError, ParameterError
from scara_kinetostatic.files.atomic import render
from scara_kinetostatic.files.robot_cell import GRAVITY
from scara_kinetostatic.files.yaml_file import parse_yaml, read_text
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc, SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.outline import Outline, surfaces_of
from scara_kinetostatic.model.parameters import MILLI, PAPER_ACTUAL, Parameters
from scara_kinetostatic.simulation.plan import check_numbers

if TYPE_CHECKING:
    import mujoco

Pair = tuple[float, float]


@dataclass(frozen=True)
class Scene:
    """A robot and its discs as they truly are. All but the first two are 0 where there is no such effect.

    Attributes:
        name: of the scene.
        parameters: L̄ of the arm: lengths, offsets, springs, backlashes.
        contact_friction: Coulomb's coefficient μ between tip and discs.
        bearing_friction: Coulomb friction that opposes the turning of each link, behind its transmission, Nm.
        winding_friction: Coulomb friction inside each transmission, beside its spring, Nm.
        slip_compliance: of a second spring of each transmission, between motor and spring, rad/Nm.
        slip_torque: Coulomb friction beside that second spring, Nm.
        displaced: number of the displaced disc.
        displacement: by how much, m.
        base_compliance: of the springs under the base, along x and y, m/N.
        link_compliance: rotation of the end of link 1, clamped at the other end, per moment, rad/Nm.
        padded: numbers of the discs with a soft coat; a cell with fewer discs counts round, here and above.
        pad: its stiffness, force by depth, N/m, where it is pressed by a depth, m; it is softer where it is
            pressed less.
        tilt: of the base, about its x and y axes, rad.
        masses: of the two links, kg; on a tilted base they load the joints, upright their static moments do.
        cable: stiffness of a cable that pulls link 2 towards the straight arm, Nm/rad.
        quasi_static: whether a light arm moves slowly, so that inertia hardly loads the joints.

    Raises:
        ParameterError: a robot that cannot be built.
    """

    name: str = 'plain'
    parameters: Parameters = field(default_factory=lambda: PAPER_ACTUAL)
    contact_friction: float = 0.0
    bearing_friction: Pair = (0.0, 0.0)
    winding_friction: Pair = (0.0, 0.0)
    slip_compliance: Pair = (0.0, 0.0)
    slip_torque: Pair = (0.0, 0.0)
    displaced: int = 0
    displacement: Pair = (0.0, 0.0)
    base_compliance: Pair = (0.0, 0.0)
    link_compliance: float = 0.0
    padded: tuple[int, ...] = ()
    pad: Pair = (0.0, 0.0)
    tilt: Pair = (0.0, 0.0)
    masses: Pair = (6.0, 4.0)
    cable: float = 0.0
    quasi_static: bool = False

    def __post_init__(self) -> None:
        where = f'scene {self.name!r}'
        self.parameters.check_physical(where)
        for name in ('p_ee', 'p1', 'p2'):
            if getattr(self.parameters, name) == 0:
                raise ParameterError(f'{where}: {name}', 'expected a compliance above 0', 'a spring needs a stiffness')
        names = [item.name for item in fields(self)]
        check_numbers(where, self, zero=names, signed=('displacement', 'tilt'))
        if any(bool(w) != bool(r) for w, r in zip(self.slip_compliance, self.slip_torque, strict=True)):
            raise ParameterError(f'{where}: slip_torque', 'expected one above 0 for each slip_compliance above 0')
        if self.parameters.has_gravity and (self.quasi_static or self.link_compliance or 0.0 in self.masses):
            problem = 'an arm that stands upright has heavy links that do not bend'
            raise ParameterError(where, problem, 'take another scene, or leave out gravity')
        if self.padded and min(self.pad) <= 0:
            raise ParameterError(f'{where}: pad', f'expected a stiffness and a depth above 0, got {self.pad}')

    @classmethod
    def of(cls, name: str, given: Mapping[str, Any]) -> Scene:
        """A scene by those of its fields that are not 0, pairs as lists."""
        stated: dict[str, Any] = {key: tuple(one) if isinstance(one, list) else one for key, one in given.items()}
        return cls(name, **stated)

    def displaced_disc(self, cell: Cell) -> int | None:
        """Number of the displaced disc; None if there is none."""
        return self.displaced % len(cell.discs) if any(self.displacement) else None

    def padded_discs(self, cell: Cell) -> tuple[int, ...]:
        """Numbers of the discs with a coat."""
        return tuple(sorted({number % len(cell.discs) for number in self.padded}))

    @property
    def centers(self) -> tuple[Pair, Pair]:
        """Centres of mass of the links, each in its frame, m: in the middle; upright those of the static moments."""
        p, (m1, m2), quill = self.parameters, self.masses, Hardware.small_mass
        if not p.has_gravity:
            return (0.5 * p.l1, 0.0), (0.5 * p.l2, 0.0)
        c1 = (rect(p.s1, p.phi1) - (Hardware.elbow_mass + m2 + quill) * p.l1) / m1
        c2 = (rect(p.s2, p.phi2) - quill * p.l2) / m2
        return (c1.real, c1.imag), (c2.real, c2.imag)


_FILE = Path(__file__).with_name('scenes.yaml')
_GIVEN: dict[str, dict[str, Any]] = parse_yaml(read_text(_FILE, ParameterError), _FILE, ParameterError)
SCENES = {name: Scene.of(name, given) for name, given in _GIVEN.items()}
"""The scenes by name."""


def scene_named(name: str) -> Scene:
    """A scene by its name.

    Raises:
        ParameterError: there is none of that name.
    """
    if name not in SCENES:
        raise ParameterError('scene', f'there is no {name!r}', f'the names are {" ".join(SCENES)}')
    return SCENES[name]


TIMESTEP = MILLI / 2
"""Of the integration, s."""
LIFT = 0.02
"""How far the third axis lifts the tip above its place between the discs, m."""


class Hardware:
    """Size, stiffness and mass of what the robot consists of; the template has those that it alone uses.

    Attributes:
        disc_height: half the height of a disc, m.
        slab: thickness of the slab behind an edge, m.
        largest_tip: radius of the ball at the tip, m, unless a disc is small.
        pad_full: impedance of a coat on a disc from the depth on for which its stiffness is stated.
        sliding_stiffness: of the contact with an object along which the tip slides, N/m: about that of a steel ball
            of this size on steel.
        small_mass: mass of the third axis, of the gripper, of the tip, and of the base's upper part by 100, kg.
        elbow_mass: of joint 2 and the end of link 1, kg.
        friction_hardness: how much harder the friction inside a transmission is than MuJoCo's hardest: at rest it
            yields to a load f at the speed f R/b, with R = A (1 - d)/d, d and b its impedance and damping and A the
            inverse inertia that the engine ascribes to the joint, which is reduced by this. With ten times as much
            the solver does not converge.
    """

    disc_height: float = 8e-3
    slab: float = 5e-3
    largest_tip: float = 5e-3
    pad_full: float = 0.7
    sliding_stiffness: float = 1e7
    small_mass: float = 0.3
    elbow_mass: float = 2.1
    friction_hardness: float = 1e3


def build(scene: Scene, cell: Cell) -> str:
    """The scene as MJCF, from the template `scene.xml.j2`.

    Args:
        scene: the robot.
        cell: the discs.
    """
    a, b = scene.tilt
    # the discs are smaller by the ball at the tip than the radii in the cell
    tip = min(Hardware.largest_tip, 0.5 * float(cell.radii.min()))
    tip = float(cell.tip_radius or 0.0) if cell.has_outlines else tip
    moved = (scene.displaced_disc(cell), *scene.displacement)
    condim = 3 if scene.contact_friction else 1
    return render(
        Path(__file__).with_name('scene.xml.j2'),
        row=_row,
        sqrt=math.sqrt,
        settings=Hardware,
        timestep=TIMESTEP,
        scene=scene,
        p=scene.parameters,
        # downwards in the frame of a base turned by `tilt` about its x and then its y axis
        gravity=(*scene.parameters.gravity, 0.0)
        if scene.parameters.has_gravity
        else (GRAVITY * np.cos(a) * np.sin(b), -GRAVITY * np.sin(a), -GRAVITY * np.cos(a) * np.cos(b)),
        tip_radius=tip,
        discs=[
            {
                'x': disc.x * isinstance(disc, Disc) + moved[1] * (k == moved[0]),
                'y': disc.y * isinstance(disc, Disc) + moved[2] * (k == moved[0]),
                'radius': disc.radius - tip,
                'pieces': {} if isinstance(disc, Disc) else _pieces(disc, k in scene.padded_discs(cell)),
            }
            for k, disc in enumerate(cell.discs)
        ],
        padded=scene.padded_discs(cell),
        sliding=Markup(f'friction="{scene.contact_friction} 0.0 0.0" condim="{condim}" priority="1"'),
    )


def _row(values: Iterable[float]) -> str:
    return ' '.join(str(float(value)) for value in values)


def _pieces(outline: Outline, padded: bool) -> dict[int, Markup]:
    """The geoms of an object of the cell: a slab behind each edge, a cylinder in each rounded corner.

    Raises:
        ParameterError: it has an inner corner, or is to have a coat: the engine has no such body.
    """
    s = surfaces_of([outline], 0.0)
    if padded or (s.radii < 0).any():
        problem = f'{outline.name} has a coat or an inner corner'
        raise ParameterError('mujoco', problem, 'give convex outlines without one')
    found = dict[int, Markup]()
    for number, (center, radius, normal, half) in enumerate(zip(s.centers, s.radii, s.normals, s.halves, strict=True)):
        if s.is_edge[number]:
            size, place = (
                (half, Hardware.slab / 2, Hardware.disc_height),
                center + (radius - Hardware.slab / 2) * normal,
            )
            shape, turn = f'type="box" size="{_row(size)}"', np.arctan2(*s.tangents[number, ::-1])
        else:
            shape, place, turn = f'type="cylinder" size="{_row((radius, Hardware.disc_height))}"', center, 0.0
        if radius > 0:  # a corner that is not sharp
            found[number] = Markup(f'{shape} pos="{_row(place)} 0.0" euler="0.0 0.0 {turn}"')
    return found


STEPS = 4
"""Steps of the integration between two commands."""
TICK = STEPS * TIMESTEP
"""Time between two commands, s."""


def load_engine() -> Any:
    """The module `mujoco`.

    Raises:
        InputError: it is too old.
    """
    import mujoco

    if not hasattr(mujoco.mjtIntegrator, 'mjINT_DISCRETE'):
        raise InputError('mujoco', f'expected version 3.13 or later, got {mujoco.__version__}', 'pip install -U mujoco')
    return mujoco


class Engine:
    """A scene in MuJoCo.

    Args:
        scene: the robot.
        cell: the discs.
        joints: motor angles at the start, (2,), rad.
        lift: of the third axis at the start, m.
        smooth: whether the targets move step by step, not at once; in a quasi-static scene they do.

    Raises:
        InputError: MuJoCo is not installed.
    """

    def __init__(self, scene: Scene, cell: Cell, joints: Floats, *, lift: float = LIFT, smooth: bool = False) -> None:
        self._mujoco = load_engine()
        self.model: mujoco.MjModel = self._mujoco.MjModel.from_xml_string(build(scene, cell))
        self.data: mujoco.MjData = self._mujoco.MjData(self.model)
        self._smooth = smooth or scene.quasi_static
        self._ball = self.model.geom('ball').id
        self._soften_contacts(scene, cell)
        self._motors = np.array([self.model.joint(name).qposadr[0] for name in ('motor1', 'motor2')])
        names = [self.model.joint(number).name for number in range(self.model.njnt)]
        parts = ('motor', 'slip', 'spring', 'backlash')
        self._turning = [
            [self.model.joint(name).qposadr[0] for name in names if name in {f'{part}{n}' for part in parts}]
            for n in (1, 2)
        ]
        self.model.dof_invweight0[self.model.dof_frictionloss > 0] /= Hardware.friction_hardness
        self._frame = self.model.body('quill').id
        self.data.qpos[self._motors] = joints
        self.data.qpos[self.model.joint('lift').qposadr[0]] = lift
        self.command(joints, lift)
        self.data.ctrl[:] = self._target
        self._mujoco.mj_forward(self.model, self.data)

    def _soften_contacts(self, scene: Scene, cell: Cell) -> None:
        """The contacts with discs that have a coat, from its depth on, and those of a commanded robot with friction.

        MuJoCo's contact at rest holds f R = k r, with R = A (1 - d)/d, k = -solref d/d_max², d the impedance at
        the depth r and A the inverse mass that the engine ascribes to the contact. When it slides, the damping b of
        the contact adds some μ b v to f R, v the sliding speed, since the friction cone and the normal force are one
        convex problem. Where f R is less than that, r is negative and there is no contact: the tip falls back and is
        thrown off again, some hundred times per second. So the discs of a commanded robot with friction, unless one has
        a coat, are as hard as steel, not as hard as the engine makes them, with the engine's own damping: with less of
        it a tip that friction holds creeps.
        """
        inverse_mass = self.model.body_invweight0[self.model.geom('ball').bodyid[0], 0]
        if self._smooth and scene.contact_friction and not scene.padded:  # R / A = (1 - d)/d, k = 1/(2 timesteps)²
            softness = 1.0 / ((2.0 * TIMESTEP) ** 2 * Hardware.sliding_stiffness * inverse_mass)
            self.model.geom_solimp[self.model.geom_contype > 0, :2] = 1.0 / (1.0 + softness)
        for number in scene.padded_discs(cell):
            damping = 2.0 * np.sqrt(scene.pad[0] * inverse_mass) * Hardware.pad_full
            stiffness = scene.pad[0] * inverse_mass * (1.0 - Hardware.pad_full)
            self.model.geom_solref[self.model.geom(f'disc{number}').id] = (-stiffness, -damping)

    def command(self, joints: Floats, lift: float) -> None:
        """New targets of the motors, (2,), rad, and of the third axis, m."""
        self._target = np.append(joints, lift)

    def advance(self) -> None:
        """One tick of time."""
        moves = np.linspace(self.data.ctrl, self._target, STEPS + 1)[1:] if self._smooth else (self._target,)
        for target in moves:
            self.data.ctrl[:] = target
            self._mujoco.mj_step(self.model, self.data, STEPS // len(moves))

    @property
    def joints(self) -> Floats:
        """Angles of the motors, which the encoders measure, (2,), rad."""
        return self.data.qpos[self._motors]

    @property
    def links(self) -> Floats:
        """Angles of the links behind their transmissions, without offsets, (2,), rad; no encoder measures them."""
        return np.array([self.data.qpos[places].sum() for places in self._turning])

    @property
    def tip(self) -> Floats:
        """Centre of the ball at the tip, base frame, (2,), m; no sensor measures it."""
        return np.array(self.data.geom_xpos[self._ball][:2])

    @property
    def link2_angle(self) -> float:
        """Direction of link 2 in the base frame, rad."""
        matrix = self.data.xmat[self._frame]
        return float(np.arctan2(matrix[3], matrix[0]))

    def force(self) -> Floats:
        """Force of the tip on the discs, base frame, (2,), N."""
        total, wrench = np.zeros(3), np.zeros(6)
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            self._mujoco.mj_contactForce(self.model, self.data, number, wrench)
            on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
            total += on_second if contact.geom[0] == self._ball else -on_second
        return total[:2]


class EngineBody:
    """A `simulation.commanded.Body`.

    Args:
        scene: the robot and its discs as they truly are.
        cell: with the discs.

    Attributes:
        joints: angles of the motors, rad.
        force: of the tip on what it touches, base frame, N.
        touched: name of the disc, empty in free motion.

    Raises:
        InputError: MuJoCo is not installed, or the cell has obstacles.
    """

    tick = TICK

    def __init__(self, scene: Scene, cell: Cell) -> None:
        if cell.obstacles:
            raise CellError('obstacles', 'the physics engine has discs only', 'leave them out')
        self._scene, self._cell = scene, cell
        self.begin((0.0, 0.0), 1.0)

    def begin(self, joints: tuple[float, float], lift: float) -> None:
        """Stands at motor angles, rad, with the lift at a part of its way up."""
        self._engine = Engine(self._scene, self._cell, np.array(joints), lift=LIFT * lift, smooth=True)
        self.joints, self.force, self.touched = joints, (0.0, 0.0), ''

    def advance(self, time: float, joints: tuple[float, float], lift: float) -> None:
        """On to a time, s, in whole ticks; the motors are then commanded to be at `joints`, rad."""
        engine = self._engine
        engine.command(np.array(joints), LIFT * lift)
        while engine.data.time < time - 0.5 * TICK:
            engine.advance()
        (q1, q2), (x, y) = engine.joints.tolist(), engine.force().tolist()
        self.joints, self.force, self.touched = (q1, q2), (x, y), ''
        if x or y:
            near = int(self._cell.surfaces.distances(engine.tip[None])[0].argmin())
            self.touched = self._cell.discs[int(self._cell.surfaces.object[near])].name

    def sensed(self, share: float) -> Floats:
        """The force in the frame of the sensor; a tool frame is that of the engine's own link 2."""
        turn = self._engine.link2_angle if self._cell.sensor.frame is SensorFrame.TOOL else 0.0
        return rotate(np.array(self.force), -turn)
