"""The node `compensator` at 1 kHz: how late its poses are, what they cost, whether an exchange gives a wrong one.

    python -m benchmark.live.compensator [--seconds 30] [--rate 1000] [--effect LABEL] [--json FILE]

Joint states and wrenches of a moving arm are published with the time of their publication as the stamp. The delay of
a pose is the time of its reception by the middleware less the stamp. Meanwhile results of two calibrations are
published in turn; each pose must be that of one of them. What else the machine does, and the time that a virtual
machine does not get, are stated: the delays are those of a machine with time to spare. Needs ROS 2.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import tempfile
from pathlib import Path
from time import monotonic, sleep, time_ns
from typing import Any, NamedTuple

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from benchmark.cell_nodes import NodeProcesses
from benchmark.common import parser, print_targets, save
from scara_kinetostatic.bags.decoding import joint_state_messages, wrench_messages
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_DISCS as DISCS
from scara_kinetostatic.model.cell import Cell, Noise, Sensor
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.online import OnlineArm
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.nodes.demo import own_domain
from scara_kinetostatic.nodes.streams import LATCHED, RELIABLE_STREAM
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(PAPER_NOMINAL, DISCS, noise=Noise(1e-5, 0.3), sensor=Sensor('/joint_states', '/wrench'))
LATEST = 2e-3
"""Of 99 % of the poses, s; one that does not come is late."""
PART = 0.99
LARGEST_SHARE = 40.0
"""Of one core, %."""
EXCHANGE_EVERY = 5.0
"""Between two results, s; a calibrator takes longer for one."""
SAME = 1e-3
"""A pose that differs less is that of a calibration, m: the force may be that of the sample before."""
WARM_UP = 2.0
_CHANGE = 0.02
"""Difference of values of the two calibrations, m and rad."""


class Delays(NamedTuple):
    """What was heard: stamp and delay of each pose, s, and its place, m."""

    stamp: list[int]
    delay: list[float]
    place: list[tuple[float, float]]


class Driver(Node):
    """Publishes the arm and hears the poses."""

    def __init__(self) -> None:
        super().__init__('driver')
        self.joints = self.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
        self.wrench = self.create_publisher(WrenchStamped, '/wrench', RELIABLE_STREAM)
        self.result = self.create_publisher(String, '/calibrator/result', LATCHED)
        self._poses = self.create_subscription(
            PoseWithCovarianceStamped, '/compensator/pose', lambda _: None, RELIABLE_STREAM, raw=True
        )
        self._messages: list[tuple[bytes, dict[str, int]]] = []

    @property
    def ready(self) -> bool:
        """Whether the node is there."""
        there = (self.joints, self.wrench, self.result)
        return all(p.get_subscription_count() for p in there) and self.count_publishers('/compensator/pose') > 0

    def take(self) -> None:
        """Keeps the poses that have come: few at a time, as the next one is received late meanwhile."""
        with self._poses.handle:
            while (taken := self._poses.handle.take_message(PoseWithCovarianceStamped, True)) is not None:
                self._messages.append(taken)

    def heard(self) -> Delays:
        """What has been taken."""
        found = Delays([], [], [])
        for data, received in self._messages:
            message = deserialize_message(data, PoseWithCovarianceStamped)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            place = message.pose.pose.position
            found.stamp.append(stamp)
            found.delay.append(1e-9 * (received['received_timestamp'] - stamp))
            found.place.append((place.x, place.y))
        return found


def arms(label: str) -> list[CalibratedArm]:
    """Two calibrations that differ so much that a mixture of them would be seen."""
    c = calibrate(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL)), CELL)
    arm = c.arm
    if label:
        effect = find(CELL, label)
        model = ExtendedModel(arm.model.parameters, (effect,), (effect.typical,))
        size = len(model.names)
        values = {'model': model, 'covariance': 1e-12 * np.eye(size), 'undetermined': np.zeros((size, 0))}
        arm = CalibratedArm(**(vars(arm) | values))
    p = arm.model.parameters
    other = arm.model.replace(x0=p.x0 + _CHANGE, theta1=p.theta1 + _CHANGE, l1=p.l1 - _CHANGE, l2=p.l2 - 2 * _CHANGE)
    return [arm, CalibratedArm(**(vars(arm) | {'model': other}))]


def motion(count: int, rate: float) -> tuple[Floats, Floats]:
    """Joint angles and forces of a moving arm in contact, with noise, (n, 2) each."""
    time = np.arange(count) / rate
    random = np.random.default_rng(0)
    joints = np.stack([0.4 + 0.3 * np.sin(0.7 * time), 1.1 + 0.4 * np.cos(0.9 * time)], axis=-1)
    force = np.stack([20 * np.cos(0.5 * time), 20 * np.sin(0.5 * time)], axis=-1)
    return joints, force + random.normal(0, 0.3, force.shape)


def run(seconds: float, rate: float, label: str, folder: Path) -> dict[str, Any]:
    """The figures by name."""
    pair = arms(label)
    texts = [json.dumps(arm_document(arm)) for arm in pair]
    calibration = folder / 'calibration.json'
    calibration.write_text(texts[0])
    joints, force = motion(int(seconds * rate), rate)
    before = _machine()
    with own_domain() as domain, NodeProcesses(domain, folder / 'logs') as nodes:
        process = nodes.start('compensator', {'calibration': calibration, 'take_unfit': True})
        rclpy.init(domain_id=domain)
        driver = Driver()
        while not driver.ready:
            nodes.check()
            sleep(0.1)
        sleep(1.0)
        used, stamps = _drive(driver, joints, force, rate, texts, process)
        sleep(0.5)
        driver.take()
        rclpy.try_shutdown()
    busy, stolen, total = (after - ago for after, ago in zip(_machine(), before, strict=True))
    found = {'CPU [% of one core]': round(used, 1)}
    found |= {'machine busy [%]': round(100 * busy / total), 'time stolen [%]': round(100 * stolen / total)}
    return _figures(driver.heard(), pair, joints, force, stamps, rate) | found


def _drive(
    driver: Driver, joints: Floats, force: Floats, rate: float, texts: list[str], process: int
) -> tuple[float, list[int]]:
    """Publishes everything; the share of a core that the node needs, %, and the stamps."""
    gc.disable()  # a search for garbage here would end in a burst of samples
    start, stamps, exchanged, number = monotonic(), [], 0.0, 0
    began, used = start, _cpu(process)
    for k in range(len(joints)):
        while monotonic() < start + k / rate:
            sleep(1e-4)
        driver.take()
        now = time_ns()
        stamp = np.array([now])
        (wrench,) = wrench_messages(stamp, force[k : k + 1], 'base')
        (state,) = joint_state_messages(stamp, joints[k : k + 1], CELL.joint_names)
        driver.wrench.publish(wrench)
        driver.joints.publish(state)
        stamps.append(now)
        if k / rate < WARM_UP:
            began, used = monotonic(), _cpu(process)
        elif k / rate - exchanged > EXCHANGE_EVERY:
            exchanged, number = k / rate, number + 1
            driver.result.publish(String(data=texts[number % 2]))
    return 100 * (_cpu(process) - used) / (monotonic() - began), stamps


def _figures(
    heard: Delays, pair: list[CalibratedArm], joints: Floats, force: Floats, stamps: list[int], rate: float
) -> dict[str, Any]:
    place = {stamp: k for k, stamp in enumerate(stamps)}
    numbers = [place[stamp] for stamp in heard.stamp]
    late = np.array(heard.delay)[np.array(numbers) > WARM_UP * rate]
    followers, pairs = [OnlineArm(arm) for arm in pair], list(zip(joints.tolist(), force.tolist(), strict=True))
    expected = np.array([[f.locate(*q, *w)[:2] for q, w in pairs] for f in followers])
    off = np.abs(expected[:, numbers] - np.array(heard.place)).max(axis=2)
    nearest = off.min(axis=0)[np.array(numbers) > 20]
    return {
        'published': len(stamps),
        'poses': len(heard.stamp),
        'delay [s]': {f'{q:g} %': round(float(np.percentile(late, q)), 5) for q in (50, 90, 99, 99.9, 100)},
        'within': float(np.sum(late <= LATEST)) / (len(stamps) - 1 - int(WARM_UP * rate)),
        'of neither calibration': int((nearest > SAME).sum()),
        'farthest off [m]': float(nearest.max()),
        'exchanges seen': int(np.abs(np.diff(off.argmin(axis=0))).sum()),
    }


def _machine() -> tuple[int, int, int]:
    """Time of all processors: at work, taken by other virtual machines, and all of it; jiffies."""
    times = [int(field) for field in Path('/proc/stat').read_text().split()[1:9]]
    return sum(times) - times[3] - times[4] - times[7], times[7], sum(times)


def _cpu(process: int) -> float:
    """Time that a process has used, s."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main() -> int:
    """Runs, prints, saves; 0 where all targets are met."""
    options_of = parser(__doc__)
    options_of.add_argument('--seconds', type=float, default=30.0)
    options_of.add_argument('--rate', type=float, default=1000.0)
    options_of.add_argument('--effect', default='', metavar='LABEL')
    options = options_of.parse_args()
    with tempfile.TemporaryDirectory(prefix='compensator_') as folder:
        found = run(options.seconds, options.rate, options.effect, Path(folder))
    print(json.dumps(found, indent=2))
    save(options.json, found)
    share, wrong = found['CPU [% of one core]'], found['of neither calibration']
    met = print_targets(
        [
            (
                f'{100 * PART:g} % of the poses within {1e3 * LATEST:g} ms: {100 * found["within"]:.2f} %',
                found['within'] >= PART,
            ),
            (f'at most {LARGEST_SHARE:g} % of a core: {share:.0f} %', share <= LARGEST_SHARE),
            (f'no wrong pose at an exchange: {wrong}', not wrong),
        ]
    )
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())
