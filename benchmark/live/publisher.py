"""Publishes a simulated cell at a fixed rate, serialised beforehand, so that the collector alone is measured.

    python -m benchmark.live.publisher --seconds 60 --rate 1000

Publishes `/joint_states` and `/wrench` in the ROS domain of the environment, reliably. Prints `ready`, waits for
a line on stdin, publishes, prints the number of messages of each topic and the largest delay, s.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from time import monotonic, sleep, time_ns

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from scara_kinetostatic.bags.decoding import joint_state_messages, wrench_messages
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes.streams import RELIABLE_STREAM
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams
from scara_kinetostatic.touches.streams import Streams

PERIOD = 0.001
"""Between two looks at the clock, s."""
SECOND = 1_000_000_000


class CellPublisher(Node):
    """Publishes messages when they are due."""

    def __init__(self) -> None:
        super().__init__('publisher')
        self.joints = self.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
        self.wrench = self.create_publisher(WrenchStamped, '/wrench', RELIABLE_STREAM)

    def wait_for_subscriber(self) -> None:
        """Until both topics have a subscriber."""
        while not (self.joints.get_subscription_count() and self.wrench.get_subscription_count()):
            sleep(0.05)
        sleep(0.5)

    def publish(self, streams: Streams, start: float, until: float) -> tuple[int, float]:
        """Publishes one pass.

        Args:
            streams: stamped from 0, ns.
            start: when it begins, s of the monotonic clock.
            until: when it ends at the latest.

        Returns:
            How many pairs of messages were published, and the largest delay, s.
        """
        count, largest_delay = 0, 0.0
        for due, joint_state, wrench in _serialized(streams):
            while (now := monotonic()) < start + due:
                sleep(PERIOD)
            if start + due > until:
                break
            largest_delay = max(largest_delay, now - start - due)
            _publish(self.joints, joint_state)
            _publish(self.wrench, wrench)
            count += 1
        return count, largest_delay


def _publish(publisher: Publisher, message: bytes) -> None:
    publisher.publish(message)


def _serialized(streams: Streams) -> Iterator[tuple[float, bytes, bytes]]:
    """When each pair is due, s, and its bytes."""
    now = time_ns()
    joints, wrench = streams.joints, streams.wrench
    count = min(len(joints.stamp), len(wrench.stamp))
    positions = joint_state_messages(joints.stamp[:count] + now, joints.position[:count], PAPER_CELL.joint_names)
    forces = wrench_messages(wrench.stamp[:count] + now, wrench.force[:count], 'base')
    yield from zip((joints.stamp[:count] / SECOND).tolist(), positions, forces, strict=True)


def main() -> int:
    """Play."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--rate', type=float, default=1000.0)
    options = parser.parse_args()
    rclpy.init()
    publisher = CellPublisher()
    sensors = SensorModel(joint_rate=options.rate, wrench_rate=options.rate)
    streams = simulate_streams(PAPER_CELL, PAPER_ACTUAL, default_plan(PAPER_CELL), sensors=sensors, start=0)
    publisher.wait_for_subscriber()
    print('ready', flush=True)
    sys.stdin.readline()
    start = monotonic()
    until, count, largest_delay = start + options.seconds, 0, 0.0
    while monotonic() < until:
        published, late = publisher.publish(streams, monotonic(), until)
        count, largest_delay = count + published, max(largest_delay, late)
    print(count, f'{largest_delay:.4f}', flush=True)
    sys.stdin.readline()  # reliable: messages in transit need their publisher
    rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
