"""The simulated controller slides the tip along an object: a force controller that knows the rigid arm.

It commands places along the path of the tip's centre, off it along the normal by a depth that an integral controller
sets such that the sensed force along the normal stays as planned. Friction is that of the engine; why the contact is
softer than that of touches is said at `Engine`. It starts and stops with constant acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.simulation.motion import (
    CellState,
    Motion,
    SlidePhase,
    SlideTiming,
    TipPath,
    minimum_jerk,
    slow_errors,
)
from scara_kinetostatic.simulation.mujoco.engine import TICK, Engine, Hardware, Scene
from scara_kinetostatic.simulation.plan import Circle, Slide

COMPLIANCE = 2.5e-5
"""Compliance of the arm that the controller assumes, m/N."""
FILTER = 0.004
"""Time constant of the controller's filter of the force, s."""
_FASTEST = 8e-3
"""Fastest motion along the normal, m/s."""
DAMPING_TIME = 2e-5
"""Damping of the contact over its stiffness, s."""
IMPEDANCE = 0.7
"""Of the contact at any depth: with 0.9 and this damping the tip bounces where it has no backlash."""


class EngineSlide(Motion):
    """What the engine made of a slide, tick by tick.

    Attributes:
        joints: motor angles, (k, 2), rad.
        force: of the tip on the object, base frame, (k, 2), N.
        phase: which of the phases of a slide, (k,).
    """

    count = 1

    def __init__(self, ticks: Sequence[tuple[Floats, Floats, int]], slide: Slide, timing: SlideTiming) -> None:
        self.joints, self.force, self.phase = (np.array(column) for column in zip(*ticks, strict=True))
        self._time, self._slide, self._timing = TICK * np.arange(1, len(ticks) + 1), slide, timing
        self.duration = float(self._time[-1])

    def state_at(self, time: ArrayLike) -> CellState:
        """The state between two ticks, linear."""
        time = np.asarray(time, dtype=float)
        now = np.column_stack([np.interp(time, self._time, row) for row in (*self.joints.T, *self.force.T)])
        phase = self.phase[np.clip(np.searchsorted(self._time, time), 0, len(self._time) - 1)]
        relative_force = np.minimum(np.hypot(*now[:, 2:].T) / self._slide.force, 1.0)
        none = np.zeros(len(time), dtype=np.intp)
        return CellState(now[:, :2], now[:, 2:], none, phase, np.ones(len(time)), relative_force)

    def errors_at(self, time: Floats, state: CellState, seed: int) -> Floats:
        """As those of `SlidingMotion`."""
        return slow_errors(time, self._timing.variation_time, seed)


class SlideController:
    """Slides along one object.

    Args:
        scene: the robot, with its contact friction.
        cell: its tip has the radius of the scene's, 5 mm.
        slide: the object, and how to slide along it; its friction is not used.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: the arm does not reach the object.
    """

    def __init__(self, scene: Scene, cell: Cell, slide: Slide) -> None:
        self.scene, self.cell, self.slide, self.timing = scene, cell, slide, SlideTiming()
        self._track = TipPath(slide.outline, cell.tip_radius or 0.0)
        self._travelled = slide.begin * self._track.length
        self._depth, self._lift, self._force = -self.timing.clearance, 0.0, 0.0
        item: Disc | Outline | Circle = slide.outline
        if isinstance(item, Circle):
            item = Disc('disc', *item.center, item.radius + (cell.tip_radius or 0.0))
        self.engine = Engine(scene, replace(cell, discs=(item,)), self._command(), smooth=True)
        self._soften_contacts()
        self._ticks: list[tuple[Floats, Floats, int]] = []

    def _soften_contacts(self) -> None:
        """The object is as hard as steel, not as the engine makes it, and the damping is small: see `Engine`."""
        model = self.engine.model
        objects, ball = model.geom_contype > 0, model.geom('ball').bodyid[0]
        stiffness = Hardware.sliding_stiffness * model.body_invweight0[ball, 0] * (1.0 - IMPEDANCE)
        model.geom_solref[objects] = (-stiffness, -DAMPING_TIME * stiffness)
        model.geom_solimp[objects, :2] = IMPEDANCE

    def run(self) -> EngineSlide:
        """Approaches, slides, retracts.

        Raises:
            UnsupportedDataError: there is no contact.
        """
        self._rest(2 * self.timing.pause)
        while self._force < 1.0:
            self._press(_FASTEST, SlidePhase.PRESS)
        self._hold_force(0.4, 0.0)
        length = (self.slide.end - self.slide.begin) * self._track.length
        span = abs(length) / self.slide.speed + self.timing.start
        self._hold_force(span, np.sign(length) * self.slide.speed)
        self._hold_force(0.1, 0.0, SlidePhase.PRESS)
        begin = self._depth
        for part in minimum_jerk(np.linspace(0.0, 1.0, round(self.timing.approach / TICK))):
            self._depth = begin - part * (begin + self.timing.clearance)
            self._tick(SlidePhase.RETRACT)
        self._rest(2 * self.timing.pause)
        return EngineSlide(self._ticks, self.slide, self.timing)

    def _hold_force(self, duration: float, speed: float, phase: int = SlidePhase.SLIDE) -> None:
        """Moves along the object at a speed while the force along the normal is held."""
        count = round(duration / TICK)
        for number in range(count):
            part = min(1.0, number * TICK / self.timing.start, (count - number) * TICK / self.timing.start)
            self._travelled += part * speed * TICK
            # the force approaches its target with a time constant of 0.15 s
            inwards = (self.slide.force - self._force) * COMPLIANCE / 0.15
            self._press(float(np.clip(inwards, -_FASTEST, _FASTEST)), phase)

    def _press(self, speed: float, phase: int) -> None:
        self._depth += speed * TICK
        if self._depth > 0.02:
            raise UnsupportedDataError('the simulated arm does not feel the object', 'check where it stands')
        self._tick(phase)

    def _rest(self, duration: float) -> None:
        for _ in range(round(duration / TICK)):
            self._tick(SlidePhase.PAUSE)

    def _surface(self) -> tuple[Floats, Floats]:
        center, normal = self._track.at(np.array([self._travelled]))
        return center[0], normal[0]

    def _command(self) -> Floats:
        """Motor angles of the rigid arm, (2,), rad."""
        center, normal = self._surface()
        aim = center - self._depth * normal
        joints = inverse(self.scene.parameters, aim[None], self.slide.posture)[0]
        if not np.isfinite(joints).all():
            raise UnsupportedDataError('the arm does not reach the object', 'place it elsewhere')
        return np.asarray(joints)

    def _tick(self, phase: int) -> None:
        self.engine.command(self._command(), 0.0)
        self.engine.advance()
        force = self.engine.force()
        self._force += TICK / (TICK + FILTER) * (float(-force @ self._surface()[1]) - self._force)
        self._ticks.append((self.engine.joints.copy(), force, phase))
