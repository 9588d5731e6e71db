"""The engine: integrates a scene; its encoders and contact forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as Xml

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.outline import Arc, Edge, Outline

TIMESTEP = 5e-4
"""Of the integration, s."""
LARGEST_TIP = 5e-3
"""Radius of the ball at the tip, m, unless a disc is small."""
LIFT = 0.02
"""How far the third axis lifts the tip above its place between the discs, m."""
PIECES = 8
"""Hinges of a link that bends."""
HARD = {'solref': f'{2 * TIMESTEP} 1', 'solimp': '0.9999 0.9999 0.001 0.5 2'}
"""Contacts and stops as hard as the engine makes them."""
HARD_STOP = {'solreflimit': HARD['solref'], 'solimplimit': HARD['solimp']}
HARD_FRICTION = {'solreffriction': HARD['solref'], 'solimpfriction': HARD['solimp']}
PAD_ONSET, PAD_FULL = 0.3, 0.7
"""Impedance of a coat on a disc at no pressure, and from the depth on for which its stiffness is stated."""
BACKLASH_INERTIA, BACKLASH_DAMPING = 0.5, 1.0
"""Of the hinge with backlash, kg m² and Nm s/rad."""
LIGHT_ARM, LIGHT_TIP = 0.1, 0.3
"""Inertia of a quasi-static scene's arm, and of its parts behind the third axis, over that of the others: as light as
the contacts stay closed with this time step."""
_TIP_PARTS = ('quill', 'gripper', 'tip')


@dataclass(frozen=True)
class EngineSettings:
    """Size, stiffness and mass of what the robot consists of.

    Attributes:
        disc_height: half the height of a disc, m.
        object_height: third semi-axis of an ellipsoid, m.
        slab: thickness of the slab behind an edge, m.
        sliding_stiffness: of the contact with an object along which the tip slides, N/m: about that of a steel ball
            of this size on steel.
        sliding_time: damping of that contact over its stiffness, s.
        sliding_impedance: impedance of that contact at any depth: with 0.9 and this damping the tip bounces where
            it has no backlash.
        link_inertia: inertia for which each transmission is critically damped, kg m².
        rotor: inertia of a rotor, reduced to the output of its gear, kg m².
        motor_gain: stiffness of a motor's position servo, Nm/rad.
        lift_servo: stiffness of the third axis' servo, N/m, and the mass that its damping is laid out for, kg.
        small_mass: mass of the third axis, of the gripper, of the tip, and of the base's upper part by 100, kg.
        tip_damping: of the ball on its pin, N s/m.
        light_backlash_damping: of the hinge with backlash in such a scene, Nm s/rad: its stops are reached without
            an impact.
        friction_hardness: how much harder the friction inside a transmission is than MuJoCo's hardest: at rest it
            yields to a load f at the speed f R/b, with R = A (1 - d)/d, d and b its impedance and damping and A the
            inverse inertia that the engine ascribes to the joint, which is reduced by this. With ten times as much
            the solver does not converge.
    """

    disc_height: float = 8e-3
    object_height: float = 0.2
    slab: float = 5e-3
    sliding_stiffness: float = 1e7
    sliding_time: float = 2e-5
    sliding_impedance: float = 0.7
    link_inertia: tuple[float, float] = (0.9, 0.2)
    rotor: float = 4.0
    motor_gain: float = 4e6
    lift_servo: tuple[float, float] = (1e5, 1.0)
    small_mass: float = 0.3
    tip_damping: float = 50.0
    light_backlash_damping: float = 20.0
    friction_hardness: float = 1e3


SETTINGS = EngineSettings()


def _tip_radius(cell: Cell) -> float:
    """Radius of the ball at the tip, m: the discs are smaller by it than the radii in the cell."""
    return min(LARGEST_TIP, 0.5 * float(cell.radii.min()))


def build(scene: Scene, cell: Cell, outline: Outline | None = None) -> str:
    """The scene as MJCF.

    Args:
        scene: the robot.
        cell: the discs.
        outline: of one object that stands there instead of the discs.
    """
    root = Xml.Element('mujoco', model=scene.name)
    _put(root, 'compiler', angle='radian', autolimits='true', inertiafromgeom='false')
    _put(root, 'option', timestep=TIMESTEP, integrator='discrete', cone='elliptic', impratio=1000.0,
         tolerance=1e-14, gravity=_gravity(scene))  # fmt: skip
    world = _put(root, 'worldbody')
    if outline is not None:
        _object(world, scene, outline)
    for number in range(len(cell.discs) if outline is None else 0):
        _disc(world, scene, cell, number)
    base = _base(world, scene)
    elbow = _link1(_transmission(base, scene, 1), scene)
    _tip(_transmission(elbow, scene, 2), scene, cell)
    _connections(root, scene)
    if scene.quasi_static:
        _lighten(world)
    _servos(root)
    return Xml.tostring(root, encoding='unicode')


def _put(parent: Xml.Element, tag: str, **attributes: object) -> Xml.Element:
    return Xml.SubElement(parent, tag, {name.rstrip('_'): _text(value) for name, value in attributes.items()})


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ' '.join(_text(item) for item in value)
    return repr(float(value)) if isinstance(value, float) else str(value)


def _body(parent: Xml.Element, name: str, mass: float, *, inertia: float = 0.01, x: float = 0.0) -> Xml.Element:
    """A body whose frame is at `x` along its parent's, with its mass there."""
    body = _put(parent, 'body', name=name, pos=(x, 0.0, 0.0))
    _put(body, 'inertial', pos=(0.0, 0.0, 0.0), mass=mass, diaginertia=(inertia, inertia, inertia))
    return body


def _gravity(scene: Scene) -> tuple[float, float, float]:
    """9.81 m/s² downwards in the frame of a base turned by `tilt` about its x and then its y axis."""
    a, b = scene.tilt
    return (9.81 * np.cos(a) * np.sin(b), -9.81 * np.sin(a), -9.81 * np.cos(a) * np.cos(b))


def _disc(world: Xml.Element, scene: Scene, cell: Cell, number: int) -> None:
    disc = cell.discs[number]
    dx, dy = scene.displacement if number == scene.displaced_disc(cell) else (0.0, 0.0)
    body = _put(world, 'body', name=f'disc{number}', pos=(disc.x + dx, disc.y + dy, 0.0))
    surface: dict[str, object] = dict(HARD)
    if number in scene.padded_discs(cell):
        surface = {
            'solref': (-1.0, -1.0),
            'solimp': (PAD_ONSET, PAD_FULL, scene.pad[1], 0.5, 2.0),
        }  # scaled in `engine`
    friction = (scene.contact_friction, 0.0, 0.0)
    size = (disc.radius - _tip_radius(cell), SETTINGS.disc_height)
    condim = 3 if scene.contact_friction else 1
    _put(body, 'geom', name=f'disc{number}', type='cylinder', size=size, friction=friction, condim=condim, priority=1,
         **surface)  # fmt: skip


def _object(world: Xml.Element, scene: Scene, outline: Outline) -> None:
    """An object of any outline: a slab behind each edge, a cylinder in each rounded corner, an ellipsoid.

    Where the tip touches it, an ellipsoid with a high third axis is as good as a cylinder. The contact is scaled in
    `engine`.
    """
    body = _put(world, 'body', name='object')
    surface: dict[str, object] = {'friction': (scene.contact_friction, 0.0, 0.0), 'solref': (-1.0, -1.0)}
    surface |= {'solimp': (SETTINGS.sliding_impedance, SETTINGS.sliding_impedance, 0.001, 0.5, 2.0)}
    surface |= {'condim': 3 if scene.contact_friction else 1, 'priority': 1}
    for number, piece in enumerate(outline.pieces):
        name = f'object{number}'
        if isinstance(piece, Arc):
            (x, y), (a, b) = piece.center, piece.semi_axes
            turn = (0.0, 0.0, piece.rotation)
            if a == b > 0:
                _put(
                    body, 'geom', name=name, type='cylinder', size=(a, SETTINGS.disc_height), pos=(x, y, 0.0), **surface
                )
            elif a > 0:
                size = (a, b, SETTINGS.object_height)
                _put(body, 'geom', name=name, type='ellipsoid', size=size, pos=(x, y, 0.0), euler=turn, **surface)
        elif isinstance(piece, Edge):
            begin, end = np.array(piece.begin), np.array(piece.end)
            along = (end - begin) / np.hypot(*(end - begin))
            x, y = (begin + end) / 2 + SETTINGS.slab / 2 * np.array([-along[1], along[0]])
            size = (float(np.hypot(*(end - begin))) / 2, SETTINGS.slab / 2, SETTINGS.disc_height)
            turn = (0.0, 0.0, float(np.arctan2(along[1], along[0])))
            _put(body, 'geom', name=name, type='box', size=size, pos=(float(x), float(y), 0.0), euler=turn, **surface)


def _base(world: Xml.Element, scene: Scene) -> Xml.Element:
    base = _put(world, 'body', name='base', pos=(scene.parameters.x0, scene.parameters.y0, 0.0))
    mass = 100.0 * SETTINGS.small_mass
    _put(base, 'inertial', pos=(0.0, 0.0, 0.0), mass=mass, diaginertia=(1.0, 1.0, 1.0))
    for axis, compliance, direction in zip('xy', scene.base_compliance, ((1, 0, 0), (0, 1, 0)), strict=True):
        if compliance:
            _spring(base, f'base_{axis}', 'slide', direction, 1.0 / compliance, mass)
    return base


def _spring(
    body: Xml.Element,
    name: str,
    kind: str,
    axis: tuple[int, int, int],
    stiffness: float,
    inertia: float,
    **more: object,
) -> None:
    """A joint with a spring, critically damped for an inertia."""
    damping = 2.0 * np.sqrt(stiffness * inertia)
    _put(body, 'joint', name=name, type=kind, axis=axis, stiffness=float(stiffness), damping=float(damping), **more)


def _transmission(parent: Xml.Element, scene: Scene, number: int) -> Xml.Element:
    """Rotor, springs and backlash of a joint, and the frame of the link behind, at the joint's axis."""
    values, name, z = scene.parameters.as_dict(), str(number), (0, 0, 1)
    rotor = _body(parent, f'rotor{name}', 1.0)
    _put(rotor, 'joint', name=f'motor{name}', type='hinge', axis=z, armature=SETTINGS.rotor)
    link = _body(rotor, f'link{name}', 1.0)
    _slip(link, scene, number)
    friction = scene.winding_friction[number - 1]
    rubbing: dict[str, object] = {'frictionloss': friction, **HARD_FRICTION} if friction else {}
    stiffness = 1.0 / values[f'p{name}']
    _spring(
        link,
        f'spring{name}',
        'hinge',
        z,
        stiffness,
        SETTINGS.link_inertia[number - 1],
        armature=BACKLASH_INERTIA,
        **rubbing,
    )
    backlash = values[f'g{name}']
    if backlash:
        _put(link, 'joint', name=f'backlash{name}', type='hinge', axis=z, range=(-backlash, backlash),
             armature=BACKLASH_INERTIA, damping=BACKLASH_DAMPING, **HARD_STOP)  # fmt: skip
    frame = _body(link, f'beam{name}', scene.masses[number - 1])
    frame.set('euler', _text((0.0, 0.0, values[f'theta{name}'])))
    length, inertial = values[f'l{name}'], frame.find('inertial')
    assert inertial is not None
    inertial.set('pos', _text((0.5 * length, 0.0, 0.0)))
    return frame


def _slip(link: Xml.Element, scene: Scene, number: int) -> None:
    """The second spring of a transmission, with Coulomb friction beside it, if there is one."""
    compliance, torque = scene.slip_compliance[number - 1], scene.slip_torque[number - 1]
    if compliance:
        _spring(link, f'slip{number}', 'hinge', (0, 0, 1), 1.0 / compliance, SETTINGS.link_inertia[number - 1],
                armature=BACKLASH_INERTIA, frictionloss=torque, **HARD_FRICTION)  # fmt: skip


def _link1(beam: Xml.Element, scene: Scene) -> Xml.Element:
    """Link 1 up to the elbow: in one piece, or bending in hinges at the middles of its pieces."""
    length = scene.parameters.l1
    if not scene.link_compliance:
        return _body(beam, 'elbow', 0.1, x=length)
    step, stiffness = length / PIECES, PIECES / scene.link_compliance
    for number in range(PIECES):
        beam = _body(beam, f'piece{number}', 0.1, x=step if number else 0.5 * step)
        _spring(beam, f'bend{number}', 'hinge', (0, 0, 1), stiffness, 0.05, armature=0.05)
    return _body(beam, 'elbow', 0.1, x=0.5 * step)


def _tip(beam: Xml.Element, scene: Scene, cell: Cell) -> None:
    """Third axis, gripper on two springs, and the ball, with backlash if there is any."""
    x, y, z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    body = _body(beam, 'quill', SETTINGS.small_mass, x=scene.parameters.l2)
    _put(body, 'joint', name='lift', type='slide', axis=z)
    body = _body(body, 'gripper', SETTINGS.small_mass)
    for name, axis in (('grip_x', x), ('grip_y', y)):
        _spring(body, name, 'slide', axis, 1.0 / scene.parameters.p_ee, 2.0 * SETTINGS.small_mass)
    _put(body, 'site', name='pin')
    if scene.parameters.g_ee:
        body = _body(body, 'tip', SETTINGS.small_mass)
        for name, axis in (('loose_x', x), ('loose_y', y)):
            _put(body, 'joint', name=name, type='slide', axis=axis, damping=SETTINGS.tip_damping)
    _put(body, 'site', name='ball')
    _put(body, 'geom', name='ball', type='sphere', size=_tip_radius(cell), condim=1)


def _connections(root: Xml.Element, scene: Scene) -> None:
    """Couplings of several joints: the pin in the ball's hole, friction of a bearing, a cable."""
    tendons = _put(root, 'tendon')
    if scene.parameters.g_ee:
        pin = _put(tendons, 'spatial', name='pin', range=(0.0, scene.parameters.g_ee), **HARD_STOP)
        _put(pin, 'site', site='pin')
        _put(pin, 'site', site='ball')
    for number, friction in enumerate(scene.bearing_friction, start=1):
        if friction:
            _turning(_put(tendons, 'fixed', name=f'bearing{number}', frictionloss=friction, **HARD_FRICTION), scene,
                     number)  # fmt: skip
    if scene.cable:
        _turning(_put(tendons, 'fixed', name='cable', stiffness=scene.cable, springlength=0.0), scene, 2)


def _turning(tendon: Xml.Element, scene: Scene, number: int) -> None:
    """Makes a tendon follow the turning of a link against what carries its motor."""
    names = {
        'motor': True,
        'slip': scene.slip_compliance[number - 1],
        'spring': True,
        'backlash': getattr(scene.parameters, f'g{number}'),
    }
    for name in (name for name, present in names.items() if present):
        _put(tendon, 'joint', joint=f'{name}{number}', coef=1.0)


def _lighten(world: Xml.Element) -> None:
    """Makes arm and tip lighter, their springs still critically damped."""
    for body in world.iter('body'):
        factor = LIGHT_TIP if body.get('name') in _TIP_PARTS else LIGHT_ARM
        for inertial in body.findall('inertial'):
            _scale(inertial, 'mass', factor)
            _scale(inertial, 'diaginertia', factor)
        for joint in body.findall('joint'):
            name = str(joint.get('name'))
            if name.startswith('backlash'):
                joint.set('damping', _text(SETTINGS.light_backlash_damping))
            elif 'stiffness' in joint.attrib:
                _scale(joint, 'damping', float(np.sqrt(factor)))
            if not name.startswith('motor'):
                _scale(joint, 'armature', factor)


def _scale(element: Xml.Element, attribute: str, factor: float) -> None:
    if attribute in element.attrib:
        element.set(attribute, _text(tuple(factor * float(value) for value in element.attrib[attribute].split())))


def _servos(root: Xml.Element) -> None:
    servos = _put(root, 'actuator')
    for name, gain, inertia in (
        ('motor1', SETTINGS.motor_gain, SETTINGS.rotor),
        ('motor2', SETTINGS.motor_gain, SETTINGS.rotor),
        ('lift', *SETTINGS.lift_servo),
    ):
        damping = 2.0 * np.sqrt(gain * inertia)
        _put(servos, 'position', name=name, joint=name, kp=gain, kv=float(damping))


if TYPE_CHECKING:
    import mujoco


STEPS = 4
"""Steps of the integration between two commands."""
TICK = STEPS * TIMESTEP
"""Time between two commands, s."""


def load_engine() -> Any:
    """The module `mujoco`.

    Raises:
        InputError: it is not installed, or too old.
    """
    remedy = "pip install 'scara_kinetostatic[physics]'"
    try:
        import mujoco
    except ImportError as error:
        missing = isinstance(error, ModuleNotFoundError)
        problem = 'the physics engine is not installed' if missing else f'the physics engine cannot be loaded: {error}'
        raise InputError('mujoco', problem, remedy) from error
    if not hasattr(mujoco.mjtIntegrator, 'mjINT_DISCRETE'):
        raise InputError('mujoco', f'expected version 3.13 or later, got {mujoco.__version__}', remedy)
    return mujoco


class Engine:
    """A scene in MuJoCo.

    Args:
        scene: the robot.
        cell: the discs.
        joints: motor angles at the start, (2,), rad.
        outline: of one object that stands there instead of the discs.

    Raises:
        InputError: MuJoCo is not installed.
    """

    def __init__(self, scene: Scene, cell: Cell, joints: Floats, outline: Outline | None = None) -> None:
        self._mujoco = load_engine()
        self.model: mujoco.MjModel = self._mujoco.MjModel.from_xml_string(build(scene, cell, outline))
        self.data: mujoco.MjData = self._mujoco.MjData(self.model)
        self._soften_contacts(scene, cell, outline)
        self._smooth = scene.quasi_static or outline is not None
        self._motors = np.array([self.model.joint(name).qposadr[0] for name in ('motor1', 'motor2')])
        names = [self.model.joint(number).name for number in range(self.model.njnt)]
        parts = ('motor', 'slip', 'spring', 'backlash')
        self._turning = [
            [self.model.joint(name).qposadr[0] for name in names if name in {f'{part}{n}' for part in parts}]
            for n in (1, 2)
        ]
        self.model.dof_invweight0[self.model.dof_frictionloss > 0] /= SETTINGS.friction_hardness
        self._frame = self.model.body('quill').id
        self._ball = self.model.geom('ball').id
        self.data.qpos[self._motors] = joints
        self.data.qpos[self.model.joint('lift').qposadr[0]] = LIFT
        self.command(joints, LIFT)
        self.data.ctrl[:] = self._target
        self._mujoco.mj_forward(self.model, self.data)

    def _soften_contacts(self, scene: Scene, cell: Cell, outline: Outline | None) -> None:
        """The contacts with discs that have a coat, from its depth on, and with the object along which the tip slides.

        MuJoCo's contact at rest holds f R = k r, with R = A (1 - d)/d, k = -solref d/d_max², d the impedance at
        the depth r and A the inverse mass that the engine ascribes to the contact. When it slides, the damping b of
        the contact adds some μ b v to f R, v the sliding speed, since the friction cone and the normal force are one
        convex problem. Where f R is less than that, r is negative and there is no contact: the tip falls back and is
        thrown off again, some hundred times per second. So an object is as hard as steel, not as hard as the engine
        makes it, and the damping is small; with the impedance stated, the integrator's own damping is enough.
        """
        inverse_mass = self.model.body_invweight0[self.model.geom('ball').bodyid[0], 0]
        if outline is not None:
            stiffness = SETTINGS.sliding_stiffness * inverse_mass * (1.0 - SETTINGS.sliding_impedance)
            object_geoms = self.model.geom_bodyid == self.model.body('object').id
            self.model.geom_solref[object_geoms] = (-stiffness, -SETTINGS.sliding_time * stiffness)
            return
        for number in scene.padded_discs(cell):
            damping = 2.0 * np.sqrt(scene.pad[0] * inverse_mass) * PAD_FULL
            stiffness = scene.pad[0] * inverse_mass * (1.0 - PAD_FULL)
            self.model.geom_solref[self.model.geom(f'disc{number}').id] = (-stiffness, -damping)

    def command(self, joints: Floats, lift: float) -> None:
        """New targets of the motors, (2,), rad, and of the third axis, m."""
        self._target = np.append(joints, lift)

    def advance(self) -> None:
        """One tick of time; in a quasi-static scene the targets move step by step, not at once."""
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

    @property
    def speed(self) -> float:
        """Largest speed of any joint, m/s or rad/s."""
        return float(np.abs(self.data.qvel).max())

    def force(self) -> Floats:
        """Force of the tip on the discs, base frame, (2,), N."""
        total, wrench = np.zeros(3), np.zeros(6)
        for number in range(self.data.ncon):
            contact = self.data.contact[number]
            self._mujoco.mj_contactForce(self.model, self.data, number, wrench)
            on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
            total += on_second if contact.geom[0] == self._ball else -on_second
        return total[:2]
