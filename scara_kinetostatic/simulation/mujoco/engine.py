"""The engine: integrates a scene; its encoders and contact forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.mujoco.mjcf import (
    LIFT,
    PAD_FULL,
    SLIDING_IMPEDANCE,
    SLIDING_STIFFNESS,
    SLIDING_TIME,
    TIMESTEP,
    build,
)
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.sliding.outline import Outline

if TYPE_CHECKING:
    import mujoco


STEPS = 4
"""Steps of the integration between two commands."""
TICK = STEPS * TIMESTEP
"""Time between two commands, s."""
FRICTION_HARDNESS = 1e3
"""How much harder the friction inside a transmission is than MuJoCo's hardest: at rest it yields to a load f at the
speed f R/b, with R = A (1 - d)/d, d and b its impedance and damping and A the inverse inertia that the engine ascribes
to the joint, which is reduced by this. With ten times as much the solver does not converge."""


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
        self.model.dof_invweight0[self.model.dof_frictionloss > 0] /= FRICTION_HARDNESS
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
            stiffness = SLIDING_STIFFNESS * inverse_mass * (1.0 - SLIDING_IMPEDANCE)
            object_geoms = self.model.geom_bodyid == self.model.body('object').id
            self.model.geom_solref[object_geoms] = (-stiffness, -SLIDING_TIME * stiffness)
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
