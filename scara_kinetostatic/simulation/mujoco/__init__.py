"""A cell in the physics engine MuJoCo: bodies, springs, friction and contact, independent of this package's model.

`engine` describes the robot, builds it of bodies by the template `scene.xml.j2` and integrates it. Here a controller
makes the touches of a plan, the sensors report them, and the truth is stated. MuJoCo comes with the extra `physics` and
is imported when the engine starts.

The controller travels, approaches, presses up to a force, holds and retracts. It uses the nominal arm and the declared
discs alone: it commands a point on the normal of the disc, moves it inwards until the sensed force reaches the planned
one, and then keeps the motor angles. A touch with preload is pressed harder first and then eased down, so that the
joints reach the force from the other side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import inverse, rotate, wrap
from scara_kinetostatic.model.parameters import MILLI, Parameters
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.simulation.motion import HOME, CellState, Motion, Phase, Timing, minimum_jerk
from scara_kinetostatic.simulation.mujoco.engine import LIFT, SCENES, TICK, Engine, Scene, load_engine, scene_named
from scara_kinetostatic.simulation.plan import PER_DISC, ROUNDING, Plan, default_plan
from scara_kinetostatic.simulation.streams import SensorModel, recorded
from scara_kinetostatic.touches.streams import Streams

__all__ = ['SCENES', 'Scene', 'TouchController', 'preload_plan', 'scene_named', 'simulate_streams', 'truth_of_scene']

Tick: TypeAlias = tuple[Floats, Floats, Floats, float, int, int, float]
"""The values of a `SimulatedMotion` at one tick."""


class ControlLaw:
    """The simulated controller.

    Attributes:
        largest_depth: largest commanded depth in a disc; if the force is not reached there the touch is given up,
            m.
        depths: depths from the free pose to the largest for which the motor angles are computed.
        slow_distance: distance from the expected contact, m, within which the tip moves
        slow_speed: at this speed, m/s, to limit the impact.
        firm_force: after the approach the tip moves up to this force, N,
        creep_speed: at this speed, m/s.
        slowest_press: slowest commanded motion while it presses, m/s.
        compliance_limits: limits of the compliance that the controller estimates, m/N.
        longest_press: longest time for a press, s.
        lift_time: duration of lifting or lowering the tip by the third axis, s.
        contact_force: sensed force that ends the approach, N.
        rest: after the first contact, s.
        filter: time constant of the filter of the force, s.
        tolerance: relative error of the force at which a press ends.
    """

    largest_depth: float = 0.02
    depths: int = 60
    slow_distance: float = 7e-3
    slow_speed: float = 0.01
    firm_force: float = 2.0
    creep_speed: float = 4 * MILLI
    slowest_press: float = 2e-4
    compliance_limits: tuple[float, float] = (5e-6, 3e-4)
    contact_force: float = 0.5
    rest: float = 0.04
    filter: float = 4 * MILLI
    tolerance: float = 0.005
    longest_press: float = 5.0
    lift_time: float = 0.1


class Pace(NamedTuple):
    """Durations and speeds.

    Attributes:
        timing: durations of the phases but the press.
        press: fastest commanded motion while it presses, m/s.
        control_time: time constant with which the force approaches its target, s.
        peak: rest under the largest force of a touch with preload, s.
    """

    timing: Timing
    press: float
    control_time: float
    peak: float


USUAL = Pace(Timing(), press=0.015, control_time=0.05, peak=0.0)
SLOW = Pace(
    Timing(travel=1.5, approach=1.8, release=0.5, retract=0.5, speed=1.0), press=0.005, control_time=0.15, peak=0.1
)
"""So that the approach has the speed of its last millimetres throughout."""


class SimulatedMotion(Motion):
    """The motion, tick by tick.

    Attributes:
        joints: motor angles, (k, 2), rad.
        force: of the tip on the discs, base frame, (k, 2), N.
        links: angles of the links, without offsets, (k, 2), rad.
        link2_angle: direction of link 2, (k,), rad.
        touch: number of the touch in the plan, (k,).
        phase: which `Phase`, (k,).
        progress: completed part of a travel, 0 to 1, (k,).
        time: (k,), s.
        holds: the last tick of each hold, (m,).
    """

    def __init__(self, ticks: Sequence[Tick]) -> None:
        columns = (np.array(column) for column in zip(*ticks, strict=True))
        self.joints, self.force, self.links, self.link2_angle, self.touch, self.phase, self.progress = columns
        self.time, self.holds = np.asarray(TICK * np.arange(1, len(ticks) + 1), dtype=float), self.last(Phase.HOLD)
        self.duration, self.count = float(self.time[-1]), len(self.holds)

    def last(self, phase: Phase) -> Indices:
        """The last tick of a phase of each touch, (m,)."""
        return np.flatnonzero((self.phase[:-1] == phase) & (self.phase[1:] != phase))

    def state_at(self, time: ArrayLike) -> CellState:
        """The state between two ticks, linear."""
        time, size = np.asarray(time, dtype=float), np.linalg.norm(self.force, axis=1)
        relative_force = size / np.maximum(size[self.holds], ROUNDING)[self.touch]
        values = np.column_stack([self.joints, self.force, self.progress, relative_force])
        now = np.column_stack([np.interp(time, self.time, column) for column in values.T])
        tick = np.clip(np.searchsorted(self.time, time), 0, len(self.time) - 1)
        return CellState(now[:, :2], now[:, 2:4], self.touch[tick], self.phase[tick], *now[:, 4:].T)


class TouchController:
    """One pass through a plan.

    Args:
        scene: the robot.
        cell: nominal arm and declared discs.
        plan: the touches.
        timing: durations of the phases; that of the press follows from the force. None: as is right for the scene.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: the plan is empty or out of reach.
    """

    def __init__(self, scene: Scene, cell: Cell, plan: Plan, timing: Timing | None = None) -> None:
        self._pace = SLOW if scene.quasi_static else USUAL
        self.plan, self.timing = plan, timing or self._pace.timing
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._depths = np.linspace(-self.timing.clearance, ControlLaw.largest_depth, ControlLaw.depths)
        self._paths = self._motor_paths(cell)
        self._home = self._paths[[0, -1], 0] + HOME
        self.engine = Engine(scene, cell, self._home[0])
        self._command, self._depth, self._lift = self._home[0], 0.0, LIFT
        self._touch, self._phase = 0, Phase.TRAVEL
        self._force, self._first, self._compliance = 0.0, (0.0, 0.0), ControlLaw.compliance_limits[0]
        self._ticks: list[Tick] = []

    def run(self) -> SimulatedMotion:
        """Makes all touches.

        Raises:
            UnsupportedDataError: a force is not reached.
        """
        for touch in range(len(self.plan)):
            self._touch = touch
            self._travel(self._paths[touch, 0])
            self._phase = Phase.PAUSE
            self._raise(0.0)
            self._rest(Phase.PAUSE, self.timing.pause)
            self._approach_and_press()
            self._rest(Phase.HOLD, self.timing.hold)
            self._retract()
        self._travel(self._home[1])
        return SimulatedMotion(self._ticks)

    def _motor_paths(self, cell: Cell) -> Floats:
        """Motor angles for the depths of each touch by the nominal arm, (m, ControlLaw.depths, 2), rad."""
        aims = self.plan.contact(cell)[:, None] - self._depths[:, None] * self.plan.normal(cell)[:, None]
        poses = inverse(cell.nominal, aims, self.plan.posture[:, None])
        lost = np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2)))
        if len(lost):
            problem = f'the nominal arm cannot press touch {lost[0]} of the plan'
            raise UnsupportedDataError(problem, 'leave it out, or move the disc')
        return poses[:, :1] + wrap(poses - poses[:, :1])

    def _tick(self, progress: float = 0.0) -> None:
        self.engine.command(self._command, self._lift)
        self.engine.advance()
        force, e = self.engine.force(), self.engine
        self._force += TICK / (TICK + ControlLaw.filter) * (float(np.hypot(*force)) - self._force)
        self._ticks.append((e.joints, force, e.links, e.link2_angle, self._touch, self._phase, progress))

    def _at(self, depth: float) -> Floats:
        path = self._paths[self._touch]
        return np.array([np.interp(depth, self._depths, path[:, joint]) for joint in (0, 1)])

    def _travel(self, goal: Floats) -> None:
        self._phase, distance = Phase.TRAVEL, float(np.abs(goal - self._command).max())
        for part, command in _ramp(self._command, goal, max(self.timing.travel, distance / self.timing.speed)):
            self._command = command
            self._tick(part)

    def _raise(self, lift: float) -> None:
        for _, height in _ramp(self._lift, lift, ControlLaw.lift_time):
            self._lift = height
            self._tick()

    def _rest(self, phase: Phase, duration: float) -> None:
        self._phase = phase
        for _ in range(round(duration / TICK)):
            self._tick()

    def _approach_and_press(self) -> None:
        """From the free pose to the force of the hold."""
        speed, passed = self.timing.clearance / self.timing.approach, 0.0
        self._phase, self._depth = Phase.APPROACH, -self.timing.clearance
        while self._force < ControlLaw.contact_force:
            passed += TICK
            is_near, fast = self._depth > -ControlLaw.slow_distance, speed * min(1.0, passed / ControlLaw.lift_time)
            self._advance(ControlLaw.slow_speed if is_near else fast)
        self._rest(Phase.PRESS, ControlLaw.rest)
        while self._force < ControlLaw.firm_force:
            self._advance(ControlLaw.creep_speed)
        self._first, self._compliance = (self._depth, self._force), ControlLaw.compliance_limits[0]
        level, beyond = float(self.plan.force[self._touch]), float(self.plan.preload[self._touch])
        self._press((1.0 + beyond) * level)
        if beyond:
            self._rest(Phase.PRESS, self._pace.peak)
            self._phase = Phase.EASE
            self._press(level)

    def _advance(self, speed: float) -> None:
        self._depth += speed * TICK
        if self._depth > ControlLaw.largest_depth:
            problem = f'no such force {quantity(ControlLaw.largest_depth, "m")} inside the disc'
            remedy = 'check the discs, or simulate a stiffer robot'
            raise UnsupportedDataError(f'touch {self._touch} of the plan: {problem}', remedy)
        self._command = self._at(self._depth)
        self._tick()

    def _press(self, level: float) -> None:
        """Moves the commanded point, in one sense only, until the force reaches a level."""
        sense, (depth, force) = np.sign(level - self._force), self._first
        for _ in range(round(ControlLaw.longest_press / TICK)):
            missing = sense * (level - self._force)
            if missing < ControlLaw.tolerance * level:
                return
            if sense > 0 and self._force > force + ControlLaw.firm_force:
                compliance = (self._depth - depth) / (self._force - force)
                self._compliance = float(np.clip(compliance, *ControlLaw.compliance_limits))
            speed = missing * self._compliance / self._pace.control_time
            self._advance(sense * float(np.clip(speed, ControlLaw.slowest_press, self._pace.press)))
        problem = f'the force stays at {self._force:.1f} N instead of {level:.1f} N'
        remedy = 'simulate a robot with less friction, or a stiffer one'
        raise UnsupportedDataError(f'touch {self._touch} of the plan: {problem}', remedy)

    def _retract(self) -> None:
        """Retracts and lifts the tip."""
        for _, depth in _ramp(self._depth, -self.timing.clearance, self.timing.release + self.timing.retract):
            self._phase = Phase.RELEASE if self._ticks[-1][1].any() else Phase.RETRACT
            self._command = self._at(depth)
            self._tick()
        self._phase = Phase.RETRACT
        self._raise(LIFT)


def _ramp(start: Any, goal: Any, duration: float) -> Iterator[tuple[float, Any]]:
    """Part of a movement by the minimum-jerk law, and where it is, at each of its ticks."""
    for part in minimum_jerk(np.linspace(0.0, 1.0, max(2, round(duration / TICK)) + 1)[1:]):
        yield float(part), start + part * (goal - start)


def preload_plan(cell: Cell, per_disc: int = PER_DISC) -> Plan:
    """The simulator's default plan, every other touch pressed to twice its force first."""
    return default_plan(cell, per_disc=per_disc, preload=1.0)


def simulate_streams(
    scene: Scene, cell: Cell, plan: Plan, sensors: SensorModel | None = None, seed: int = 0
) -> Streams:
    """Both streams of one pass through a plan.

    Args:
        scene: the true robot.
        cell: its description: nominal arm, discs, sensor, noise of a touch.
        plan: the touches.
        sensors: noise, bias and rates.
        seed: of all random numbers.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force is not reached.
    """
    return as_streams(TouchController(scene, cell, plan).run(), scene, cell, sensors or SensorModel(), seed)


def as_streams(motion: SimulatedMotion, scene: Scene, cell: Cell, sensors: SensorModel, seed: int = 0) -> Streams:
    """Both streams of a motion; the arguments are those of `simulate_streams`."""
    turned, seen = replace(cell, sensor=cell.sensor._replace(frame=SensorFrame.BASE)), copy(motion)
    seen.force = as_sensed(motion, cell)
    return recorded(f'physics: {scene.name}', turned, scene.parameters, seen, sensors, seed)


def as_sensed(motion: SimulatedMotion, cell: Cell) -> Floats:
    """Force on the object in the sensor's frame, (k, 2), N; a tool frame is that of the engine's own link 2."""
    if cell.sensor.frame is SensorFrame.BASE:
        return motion.force
    return rotate(motion.force, -motion.link2_angle)


def truth_of_scene(scene: Scene, cell: Cell, seed: int = 0) -> dict[str, Any]:
    """Engine, scene, true parameters, the parameters that touches can identify, effects.

    Args:
        scene: the true robot.
        cell: names the discs.
        seed: of the noise.

    Raises:
        InputError: MuJoCo is not installed.
    """
    return {
        'schema': 'scara_kinetostatic/physics_truth/1',
        'engine': f'MuJoCo {load_engine().__version__}',
        'scene': scene.name,
        'seed': seed,
        'built': scene.parameters.as_dict(),
        'expected': expected_parameters(scene).as_dict(),
        'effects': built_effects(scene, cell),
    }


def expected_parameters(scene: Scene) -> Parameters:
    """The parameters L̄ that touches identify.

    The mean compliance of the base in x and y is confounded with p_ee. A spring with friction beside it slips as a
    whole: it is compliance of the slip, not of the joint.
    """
    p = scene.parameters
    springs = zip((p.p1, p.p2), scene.winding_friction, strict=True)
    p1, p2 = (0.0 if friction else spring for spring, friction in springs)
    return p.replace(p_ee=p.p_ee + 0.5 * sum(scene.base_compliance), p1=p1, p2=p2)


def built_effects(scene: Scene, cell: Cell) -> list[dict[str, Any]]:
    """The effects of the scene: name, target and values, SI units."""
    s, p, moved, padded = scene, scene.parameters, scene.displaced_disc(cell), scene.padded_discs(cell)
    at = '' if moved is None else cell.discs[moved].name
    coated = None if len(padded) in (0, len(cell.discs)) else cell.discs[padded[0]].name
    rows: list[tuple[Any, str, str | None, dict[str, float]]] = [
        (s.contact_friction, 'contact_friction', None, {'coefficient': s.contact_friction})
    ]
    for k, spring in enumerate((p.p1, p.p2)):
        joint, bearing, winding = f'joint{k + 1}', s.bearing_friction[k], s.winding_friction[k]
        slip, slipping = s.slip_compliance[k], s.slip_torque[k]
        rows += [
            (bearing, 'joint_hysteresis', joint, {'width': spring * bearing, 'bearing_torque': bearing}),
            (winding, 'joint_slip', joint, {'compliance': spring, 'slip_torque': winding}),
            (slip, 'joint_slip', joint, {'compliance': slip, 'slip_torque': slipping}),
        ]
    (x, y), (tilt_x, tilt_y), (along_x, along_y), (stiffness, depth) = s.displacement, s.tilt, s.base_compliance, s.pad
    rows += [
        (at, 'object_position', at, {'x': x, 'y': y}),
        (any(s.base_compliance), 'base_compliance', None, {'excess': 0.5 * (along_x - along_y), 'coupling': 0.0}),
        (s.link_compliance, 'link_bending', 'link1', {'compliance': s.link_compliance}),
        (padded, 'contact_compliance', coated, {'stiffness': stiffness, 'depth': depth}),
        (any(s.tilt), 'base_tilt', None, {'tilt_x': tilt_x, 'tilt_y': tilt_y}),
        (s.cable, 'cable', 'joint2', {'stiffness': s.cable}),
    ]
    return [
        {'name': name, 'target': target, 'parameters': {key: float(value) for key, value in values.items()}}
        for is_built, name, target, values in rows
        if is_built
    ]
