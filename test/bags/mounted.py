"""A cell whose force sensor is mounted with a turn on the tool, as `/tf_static` says."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
from bags.forms import STORE, Message, force_messages, joint_messages
from numpy.typing import NDArray

from scara_kinetostatic.bags.decoding import TF_MESSAGE, TF_STATIC
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Sensor, SensorFrame
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.streams import Streams

ANGLE = 35.0
"""Of the sensor against link 2, degrees."""
TOOL_CELL = Cell(
    PAPER_NOMINAL, PAPER_CELL.discs, noise=PAPER_CELL.noise, sensor=Sensor('joint_states', 'wrench', SensorFrame.TOOL)
)


def transform_message(parent: str, child: str, angle: float, about_x: tuple[float, float] | None = None) -> bytes:
    """A `TFMessage` with one transform, turned about z, degrees; or about x, by x and w of its quaternion."""
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](0, 0)
    rotation = types['geometry_msgs/msg/Quaternion'](0.0, 0.0, sin(radians(angle) / 2), cos(radians(angle) / 2))
    if about_x:
        rotation = types['geometry_msgs/msg/Quaternion'](about_x[0], 0.0, 0.0, about_x[1])
    transform = types['geometry_msgs/msg/Transform'](types['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.1), rotation)
    stamped = types['geometry_msgs/msg/TransformStamped'](types['std_msgs/msg/Header'](stamp, parent), child, transform)
    return bytes(STORE.serialize_cdr(types[TF_MESSAGE]([stamped]), TF_MESSAGE))


def turned(force: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Forces in axes that are turned by an angle, degrees."""
    c, s = cos(radians(angle)), sin(radians(angle))
    return np.asarray(force @ np.array([[c, -s], [s, c]]))


def mounted_streams(seed: int = 3) -> Streams:
    """Forces as the link sees them."""
    return simulate_streams(TOOL_CELL, PAPER_ACTUAL, default_plan(TOOL_CELL, 6), seed=seed)


def mounted_messages(streams: Streams, frame_id: str = 'sensor') -> list[Message]:
    """Joint states and wrenches as the sensor sends them, in the order of time."""
    forces = replace(streams.wrench, force=turned(streams.wrench.force, ANGLE))
    made = [*joint_messages(streams), *force_messages(replace(streams, wrench=forces), frame_id=frame_id)]
    return sorted(made, key=lambda item: item.log_time)


def transforms(log_time: int) -> list[Message]:
    """Of the sensor on its mount, of the mount on the tool."""
    made = [transform_message('tool0', 'mount', ANGLE - 90), transform_message('mount', 'sensor', 90)]
    return [Message(TF_STATIC, TF_MESSAGE, log_time, payload) for payload in made]
