"""A recording simulated in MuJoCo."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import yaml

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.mujoco.controller import SimulatedMotion, TouchController
from scara_kinetostatic.simulation.mujoco.engine import Scene, load_engine
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.streams import START, SensorModel, recorded
from scara_kinetostatic.simulation.trajectory import CellState, Timing
from scara_kinetostatic.touches.streams import Streams

PRELOAD = 1.0
"""Preload of every other touch of `preload_plan`: it is pressed to twice its force first."""


def preload_plan(cell: Cell, per_disc: int = 12) -> Plan:
    """The simulator's default plan, every other touch with preload."""
    return default_plan(cell, per_disc=per_disc, preload=PRELOAD)


def simulate_streams(
    scene: Scene,
    cell: Cell,
    plan: Plan | None = None,
    *,
    timing: Timing | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of one pass through a plan.

    Args:
        scene: the true robot.
        cell: its description: nominal arm, discs, sensor, noise of a touch.
        plan: the touches; None: `preload_plan`.
        timing: durations of the phases.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force is not reached.
    """
    plan = preload_plan(cell) if plan is None else plan
    motion = TouchController(scene, cell, plan, timing).run()
    return as_streams(motion, scene, cell, sensors or SensorModel(), seed, start)


def as_streams(
    motion: SimulatedMotion, scene: Scene, cell: Cell, sensors: SensorModel, seed: int = 0, start: int = START
) -> Streams:
    """Both streams of a motion; the arguments are those of `simulate_streams`."""
    held = as_sensed(motion, cell)[motion.holds]
    joint_errors, force_errors = sensors.touch_errors(cell, len(held), np.random.default_rng([seed, 0]), held)
    turned = replace(cell, sensor=cell.sensor._replace(frame=SensorFrame.BASE))  # `_state_at` has turned the force

    def at(time: Floats) -> tuple[CellState, Floats, Floats]:
        return _state_at(motion, cell, time), joint_errors, force_errors

    duration = float(motion.time[-1])
    return recorded(f'physics: {scene.name}', turned, scene.parameters, sensors, duration, at, seed, start)


def as_sensed(motion: SimulatedMotion, cell: Cell) -> Floats:
    """Force on the object in the sensor's frame, (k, 2), N; a tool frame is that of the engine's own link 2."""
    if cell.sensor.frame is SensorFrame.BASE:
        return motion.force
    return rotate(motion.force, -motion.link2_angle)


def _state_at(motion: SimulatedMotion, cell: Cell, time: Floats) -> CellState:
    """The motion at times in s, force in the frame of the sensor."""
    tick = np.clip(np.searchsorted(motion.time, time), 0, len(motion.time) - 1)
    magnitude = np.linalg.norm(motion.force, axis=1)
    held = np.maximum(magnitude[motion.holds], 1e-9)
    values = np.column_stack([motion.joints, as_sensed(motion, cell), magnitude / held[motion.touch], motion.progress])
    at = np.column_stack([np.interp(time, motion.time, column) for column in values.T])
    return CellState(at[:, :2], at[:, 2:4], motion.touch[tick], motion.phase[tick], at[:, 5], at[:, 4])


SCHEMA = 'scara_kinetostatic/physics_truth/1'


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
        'schema': SCHEMA,
        'engine': f'MuJoCo {load_engine().__version__}',
        'scene': scene.name,
        'seed': seed,
        'built': scene.parameters.as_dict(),
        'expected': expected_parameters(scene).as_dict(),
        'effects': built_effects(scene, cell),
    }


def truth_text(truth: dict[str, Any]) -> str:
    """The truth as YAML."""
    return yaml.safe_dump(truth, sort_keys=False, default_flow_style=None, width=120)


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
    effects = []

    def add(name: str, target: str | None, **values: float) -> None:
        effects.append({'name': name, 'target': target, 'parameters': {key: float(v) for key, v in values.items()}})

    if scene.contact_friction:
        add('contact_friction', None, coefficient=scene.contact_friction)
    target: str | None
    for number, compliance in enumerate((scene.parameters.p1, scene.parameters.p2)):
        target = f'joint{number + 1}'
        if scene.bearing_friction[number]:
            torque = scene.bearing_friction[number]
            add('joint_hysteresis', target, width=compliance * torque, bearing_torque=torque)
        if scene.winding_friction[number]:
            add('joint_slip', target, compliance=compliance, slip_torque=scene.winding_friction[number])
        if scene.slip_compliance[number]:
            slipping = scene.slip_torque[number]
            add('joint_slip', target, compliance=scene.slip_compliance[number], slip_torque=slipping)
    displaced = scene.displaced_disc(cell)
    if displaced is not None:
        add('object_position', cell.discs[displaced].name, x=scene.displacement[0], y=scene.displacement[1])
    if any(scene.base_compliance):
        along_x, along_y = scene.base_compliance
        add('base_compliance', None, excess=0.5 * (along_x - along_y), coupling=0.0)
    if scene.link_compliance:
        add('link_bending', 'link1', compliance=scene.link_compliance)
    padded = scene.padded_discs(cell)
    if padded:
        target = None if len(padded) == len(cell.discs) else cell.discs[padded[0]].name
        add('contact_compliance', target, stiffness=scene.pad[0], depth=scene.pad[1])
    if any(scene.tilt):
        add('base_tilt', None, tilt_x=scene.tilt[0], tilt_y=scene.tilt[1])
    if scene.cable:
        add('cable', 'joint2', stiffness=scene.cable)
    return effects
