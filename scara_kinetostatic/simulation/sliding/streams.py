"""The recording of slides: joint angles and forces as the sensors report them.

The repeatability of a touch (`cell.noise`) is here an error of the same size that changes slowly along the slide
(`SlideTiming.variation_time`); its force part grows and falls with the force, as in a touch. White noise, zero, frame,
sign, resolution and stamps are those of `SensorModel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.phases import HOLD
from scara_kinetostatic.simulation.sensors import SensorModel, sensor_angle
from scara_kinetostatic.simulation.sliding.motion import SlideState, SlidingMotion, SlowNoise
from scara_kinetostatic.simulation.sliding.slide import Slide, SlideTiming
from scara_kinetostatic.simulation.streams import START
from scara_kinetostatic.simulation.trajectory import CellState
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream


class Motion(Protocol):
    """A motion that the sensors report: that of `SlidingMotion`, or of an engine."""

    @property
    def duration(self) -> float:
        """S."""

    @property
    def slides(self) -> tuple[Slide, ...]:
        """One after the other."""

    @property
    def model(self) -> ExtendedModel:
        """The robot."""

    @property
    def timing(self) -> SlideTiming:
        """How fast the errors of the sensors change."""

    def state_at(self, time: Floats) -> SlideState:
        """The state at times in s, (k,)."""


def simulate_slides(
    cell: Cell,
    truth: ExtendedModel | Parameters,
    slides: Sequence[Slide],
    *,
    timing: SlideTiming | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of one pass through several slides.

    Args:
        cell: sensor, noise of a touch, radius of the tip.
        truth: the simulated robot: its parameters, or the model with its effects.
        slides: one after the other.
        timing: how long their parts last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        UnsupportedDataError: there is no slide, or the simulated robot does not reach one.
        ParameterError: an outline is too narrow for the tip.
    """
    motion = SlidingMotion(cell, truth, tuple(slides), timing, seed)
    return sensed(motion, cell, sensors or SensorModel(), seed, start)


def sensed(motion: Motion, cell: Cell, sensors: SensorModel, seed: int, start: int = START) -> Streams:
    """What the sensors report of a motion; the arguments are those of `simulate_slides`."""
    random = np.random.default_rng([seed, 1])
    errors = SlowNoise(np.random.default_rng([seed, 0]), 4, motion.timing.variation_time)
    joint_stamps = sensors.stamps(motion.duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(motion.duration, sensors.wrench_rate, sensors.offset, random)
    state, joint_errors, _ = _disturbed(motion, cell, sensors, errors, 1e-9 * joint_stamps.astype(np.float64))
    position = sensors.read_joints(state, joint_errors, random)
    state, _, force_errors = _disturbed(motion, cell, sensors, errors, 1e-9 * wrench_stamps.astype(np.float64))
    force = sensors.read_force(cell, motion.model, state, force_errors, random)
    return Streams(
        source='simulation',
        joints=JointStream(joint_stamps + start, position),
        wrench=WrenchStream(wrench_stamps + start, force),
    )


def _disturbed(
    motion: Motion, cell: Cell, sensors: SensorModel, errors: SlowNoise, time: Floats
) -> tuple[CellState, Floats, Floats]:
    """The state at times, each instant as a touch of its own, and its errors."""
    state, unit = motion.state_at(time), errors.at(time)
    angle = sensor_angle(cell, as_model(motion.model).parameters, state.joints)
    joint_errors, force_errors = sensors.scaled_errors(cell, unit[:, :2], unit[:, 2:], state.force, angle)
    return _as_holds(motion, state), joint_errors, force_errors


def _as_holds(motion: Motion, state: SlideState) -> CellState:
    """The states as those of holds, numbered on; the force over that of the slide."""
    count = len(state.joints)
    planned = np.array([slide.force for slide in motion.slides])[state.slide]
    relative_force = np.minimum(np.hypot(*state.force.T) / planned, 1.0)
    return CellState(state.joints, state.force, np.arange(count), np.full(count, HOLD), np.ones(count), relative_force)
