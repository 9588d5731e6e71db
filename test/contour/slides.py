"""Simulated slides along objects that no calibration knows, and a calibrated arm."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.motion import SlideTiming, SlidingMotion
from scara_kinetostatic.simulation.plan import Circle, Slide, default_plan, polygon
from scara_kinetostatic.simulation.streams import SensorModel, recorded, simulate_touches
from scara_kinetostatic.touches.streams import Streams

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3), tip_radius=0.005)
DISC = Circle((0.2, 0.3), 0.06)
AROUND = 2 * np.pi * 0.06
"""Of the disc, m."""
SQUARE = polygon([[0.10, 0.30], [0.20, 0.30], [0.20, 0.40], [0.10, 0.40]], 0.01)
OBJECTS = {'disc': DISC, 'rounded square': SQUARE}


@cache
def arm(seed: int = 0) -> CalibratedArm:
    """A calibration from simulated touches of the paper's discs."""
    return calibrate(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL), seed=seed), CELL).arm


def slides(
    *parts: tuple[float, float],
    outline: Any = DISC,
    force: float = 15,
    friction: float = 0.1,
    speed: float = 0.05,
    cell: Cell = CELL,
    timing: SlideTiming | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
) -> Streams:
    """A recording of slides along parts of an object, in its lengths."""
    planned = tuple(Slide(outline, force, friction, speed, begin=begin, end=end) for begin, end in parts)
    motion = SlidingMotion(cell, PAPER_ACTUAL, planned, timing, seed)
    return recorded('simulation', cell, PAPER_ACTUAL, motion, sensors or SensorModel(), seed)


def traced(*parts: tuple[float, float], **more: Any) -> Contour:
    """The contour of such a recording."""
    return trace_contour(slides(*parts, **more), arm())


def with_force(streams: Streams, force: Any) -> Streams:
    """The same with other forces."""
    return replace(streams, wrench=replace(streams.wrench, force=force))


def with_joints(streams: Streams, position: Any) -> Streams:
    """The same with other joint angles."""
    return replace(streams, joints=replace(streams.joints, position=position))


def since(streams: Streams, begin: int) -> Streams:
    """What comes from a stamp on."""
    joints, wrench = streams.joints, streams.wrench
    first, second = joints.stamp >= begin, wrench.stamp >= begin
    joints = replace(joints, stamp=joints.stamp[first], position=joints.position[first])
    return replace(
        streams, joints=joints, wrench=replace(wrench, stamp=wrench.stamp[second], force=wrench.force[second])
    )


def rested(streams: Streams, rest: float) -> Streams:
    """The same with a rest in its middle, s."""
    middle, pause = streams.joints.stamp[len(streams.joints.stamp) // 2], round(1e9 * rest)

    def held(stamp: Any, values: Any) -> tuple[Any, Any]:
        at, period = int(np.searchsorted(stamp, middle)), int(np.median(np.diff(stamp)))
        between = stamp[at - 1] + period * np.arange(1, pause // period + 1)
        still = np.repeat(values[at - 1 : at], len(between), axis=0)
        stamps = np.concatenate([stamp[:at], between, stamp[at:] + pause])
        return stamps, np.concatenate([values[:at], still, values[at:]])

    stamp, position = held(streams.joints.stamp, streams.joints.position)
    joints = replace(streams.joints, stamp=stamp, position=position)
    stamp, force = held(streams.wrench.stamp, streams.wrench.force)
    return replace(streams, joints=joints, wrench=replace(streams.wrench, stamp=stamp, force=force))
