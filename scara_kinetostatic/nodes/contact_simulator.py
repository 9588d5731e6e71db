"""Node `contact_simulator`: simulates the robot, the discs and the force sensor of a cell.

The streams of a whole plan, of touches or of slides along objects, are computed beforehand and published by a timer.
Header stamps are in simulated time, which begins at the wall time of the start
and runs `time_factor` times as fast; what a recording holds does not depend on
that factor. Publishes the topics named in the cell description and, latched,
`~/finished` (`std_msgs/Bool`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from time import monotonic

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from scara_kinetostatic.files.urdf import BASE_FRAME, TOOL_FRAME
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes import conversion, declare
from scara_kinetostatic.nodes.declare import Range
from scara_kinetostatic.nodes.playback import Playback
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.simulator_settings import declare_simulator
from scara_kinetostatic.nodes.stream_subscription import LATCHED, RELIABLE_STREAM
from scara_kinetostatic.simulation.slides import simulate_slides
from scara_kinetostatic.simulation.streams import simulate_streams

TICK = 0.01
"""Between two batches of messages, s."""
LONGEST_TICK = 0.05
"""Longest advance of the simulation in one tick: a slow machine slows it down instead of sending bursts, s."""
DISCOVERY = 0.5
"""From the first subscriber to the start, s: the subscriber has then discovered both publishers."""
PAUSE = 1.0
"""Between two passes through the plan, simulated s."""


class ContactSimulator(Node):
    """Publishes a plan of touches or slides, once or repeatedly.

    Raises:
        InputError: a parameter, the cell or the plan is not valid.
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """

    def __init__(self) -> None:
        super().__init__('contact_simulator')
        self._settings = declare_simulator(self)
        faster = 'simulated seconds per second of wall time'
        declare.number(self, 'time_factor', 1.0, faster, Range(0.01, 1000.0), read_only=False)
        declare.switch(self, 'loop', False, 'start again after the last touch', read_only=False)
        sensor = self._settings.cell.sensor
        self._joints = self.create_publisher(JointState, sensor.joint_states, RELIABLE_STREAM)
        self._wrench = self.create_publisher(WrenchStamped, sensor.wrench, RELIABLE_STREAM)
        self._finished = self.create_publisher(Bool, '~/finished', LATCHED)
        self._finished.publish(Bool(data=False))
        prefix = declare.text(self, 'frame_prefix', '', 'before the frame_id of the wrench')
        self._frame_id = prefix + (TOOL_FRAME if sensor.frame is SensorFrame.TOOL else BASE_FRAME)
        self._passes = 0
        self._playback = self._simulate()
        self._elapsed = 0.0
        self._ready_since: float | None = None
        self._last_tick: float | None = None
        self._timer = self.create_timer(TICK, self._tick)
        kind = 'slides' if isinstance(self._settings.plan, tuple) else 'touches'
        self.get_logger().info(f'{len(self._settings.plan)} {kind} planned')

    def close(self) -> None:
        """Nothing to close."""

    def _simulate(self, start: int = 0) -> Playback:
        """The next pass through the plan, with noise of its own; joints with memory keep what the last one left."""
        settings, seed = self._settings, self._settings.seed + self._passes
        if isinstance(settings.plan, tuple):
            streams = simulate_slides(
                settings.cell, settings.truth, settings.plan, sensors=settings.sensors, seed=seed, start=0
            )
        else:
            streams = simulate_streams(
                settings.cell,
                settings.truth,
                settings.plan,
                sensors=settings.sensors,
                seed=seed,
                start=0,
                repeated=self._passes > 0,
            )
        self._passes += 1
        return Playback(streams, start)

    def _tick(self) -> None:
        if self._last_tick is None:
            self._start_if_ready()
            return
        now = monotonic()
        factor = self.get_parameter('time_factor').value
        self._elapsed += min(now - self._last_tick, LONGEST_TICK) * factor
        self._last_tick = now
        for is_wrench, sample in self._playback.advance(self._elapsed):
            if is_wrench:
                self._wrench.publish(conversion.wrench(sample, self._frame_id))
            else:
                self._joints.publish(conversion.joint_state(sample, self._settings.cell.joint_names))
        if self._playback.finished:
            self._end_pass()

    def _start_if_ready(self) -> None:
        needed = self._settings.wait_for_subscribers
        if min(self._joints.get_subscription_count(), self._wrench.get_subscription_count()) < needed:
            self._ready_since = None
            return
        now = monotonic()
        self._ready_since = self._ready_since or now
        if now - self._ready_since >= DISCOVERY:
            self._playback.start = self.get_clock().now().nanoseconds
            self._last_tick = now
            self.get_logger().info('the simulation starts')

    def _end_pass(self) -> None:
        if self.get_parameter('loop').value:
            self._playback = self._simulate(self._playback.end + round(1e9 * PAUSE))
            self._elapsed = -PAUSE
            return
        self._timer.cancel()
        self._finished.publish(Bool(data=True))
        self.get_logger().info('the plan is finished')


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(ContactSimulator, args)


if __name__ == '__main__':
    sys.exit(main())
