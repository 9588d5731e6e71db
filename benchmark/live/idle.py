"""The collector while the robot idles: what hours without a contact cost, and the answer to the first contact after.

    python -m benchmark.live.idle [--hours 24] [--rate 1000] [--folder DIR] [--json FILE]

Messages of two topics, as they come over the wire, go as fast as they can through what the node does with each:
decoding, writing into the recording, touch detection; every 0.1 s of their time it looks for touches. Then the robot
touches a disc once. Everything is recorded, about 0.9 GB per hour at 2 x 1 kHz, and removed in the end. Needs ROS 2.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from benchmark.common import parser, print_and_save
from benchmark.live.__main__ import memory_now
from scara_kinetostatic.bags.cdr import joint_state_messages, wrench_messages
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes.collector import POLL
from scara_kinetostatic.nodes.conversion import JointReader, wrench_sample
from scara_kinetostatic.nodes.session import Session
from scara_kinetostatic.nodes.streams import Stream
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import START, SensorModel, simulate_streams
from scara_kinetostatic.touches.streams import Streams

SECOND = 1_000_000_000
MIB = 1 << 20
PORTION = 10
"""Seconds of messages that are made at a time."""
NOISE = (1e-5, 0.05)
"""Standard deviations of joint angles and force of a sample, rad and N."""
REPORTS = 24
"""So many times the memory is noted."""


class Feed:
    """What the node does with each message; and the time that its looks for touches take.

    Attributes:
        slowest: CPU time of the slowest look for touches, s.
        found: touches found.
    """

    def __init__(self, session: Session, start: int) -> None:
        self._session = session
        self._looked = start
        self.slowest = 0.0
        self.found = 0

    def take(self, streams: Streams) -> None:
        """Takes both streams in, in the order of their stamps."""
        reader = JointReader(PAPER_CELL.joint_names)
        for stamp, stream, message in _messages(streams):
            sample = reader.sample(message, stamp) if stream is Stream.JOINTS else wrench_sample(message)
            self._session.take(stream, message, stamp, sample)
            if stamp > self._looked + POLL * SECOND:
                self._looked = stamp
                self._look()

    def _look(self) -> None:
        begun = process_time()
        self.found += len(self._session.poll())
        self.slowest = max(self.slowest, process_time() - begun)


def _messages(streams: Streams) -> Iterator[tuple[int, Stream, bytes]]:
    joints, wrench = streams.joints, streams.wrench
    made = joint_state_messages(joints.stamp, joints.position, PAPER_CELL.joint_names)
    forces = wrench_messages(wrench.stamp, wrench.force, 'base_link')
    for row, (at, joint_state) in enumerate(zip(joints.stamp.tolist(), made, strict=True)):
        yield at, Stream.JOINTS, joint_state
        if row < len(forces):
            yield at, Stream.WRENCH, forces[row]


def _idle(random: np.random.Generator, rate: float, begin: int) -> Streams:
    """One portion in which nothing moves."""
    first = _touch(rate, begin)
    stamp = begin + (np.arange(round(PORTION * rate)) * SECOND / rate).astype(np.int64)
    noise = [random.normal(0.0, size, (len(stamp), 2)) for size in NOISE]
    joints = type(first.joints)(stamp, first.joints.position[0] + noise[0])
    return Streams('idle', joints, type(first.wrench)(stamp, first.wrench.force[0] + noise[1]))


def _touch(rate: float, begin: int) -> Streams:
    """The first touches of the example cell."""
    if not _TOUCH:
        sensors = SensorModel(joint_rate=rate, wrench_rate=rate)
        _TOUCH.append(simulate_streams(PAPER_CELL, PAPER_ACTUAL, default_plan(PAPER_CELL), sensors=sensors))
    joints, wrench = _TOUCH[0].joints, _TOUCH[0].wrench
    count = min(len(joints.stamp), round(PORTION * rate))
    return Streams(
        'touch',
        type(joints)(joints.stamp[:count] - START + begin, joints.position[:count]),
        type(wrench)(wrench.stamp[:count] - START + begin, wrench.force[:count]),
    )


_TOUCH: list[Streams] = []


def run(hours: float, rate: float, folder: Path) -> dict[str, Any]:
    """Idles, then touches.

    Args:
        hours: without a contact.
        rate: messages per second on each topic.
        folder: for the recording.

    Returns:
        The figures by name.
    """
    session = Session(folder, PAPER_CELL, START)
    feed, random = Feed(session, START), np.random.default_rng(0)
    portions = max(1, round(hours * 3600 / PORTION))
    memory: list[float] = []
    used = process_time()
    for number in range(portions):
        feed.take(_idle(random, rate, START + number * PORTION * SECOND))
        if number == 6 or (number + 1) % max(1, portions // REPORTS) == 0:
            memory.append(round(memory_now() / MIB, 1))
            print(f'{(number + 1) * PORTION / 3600:.2f} h  {memory[-1]} MiB', file=sys.stderr, flush=True)
    used, idle_look, idle_found = process_time() - used, feed.slowest, feed.found
    feed.slowest = 0.0
    feed.take(_touch(rate, START + portions * PORTION * SECOND))
    files = sorted(path.stat().st_size for path in session.folder.glob('*.mcap'))
    answered, after = feed.slowest, round(memory_now() / MIB, 1)
    session.close()
    return {
        'hours': hours,
        'messages': 2 * round(portions * PORTION * rate),
        'CPU per hour of the feed [s]': round(used / hours, 1),
        'memory [MiB]': memory,
        'growth of the memory [MiB]': round(max([*memory, after]) - memory[0], 1),
        'memory after the first touches [MiB]': after,
        'touches while idle': idle_found,
        'touches after': feed.found - idle_found,
        'slowest look for touches, idle [s]': round(idle_look, 4),
        'slowest look for touches, first contact [s]': round(answered, 4),
        'files': len(files),
        'largest file [MiB]': round(files[-1] / MIB, 1),
        'recording [MiB]': round(sum(path.stat().st_size for path in session.folder.iterdir()) / MIB, 1),
    }


def main() -> int:
    """Run, print, save."""
    options_of = parser(__doc__)
    options_of.add_argument('--hours', type=float, default=24.0)
    options_of.add_argument('--rate', type=float, default=1000.0)
    options_of.add_argument('--folder', type=Path, metavar='DIR', help='where to record (default: a temporary folder)')
    options = options_of.parse_args()
    if options.folder:
        options.folder.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix='idle_', dir=options.folder))
    try:
        figures = run(options.hours, options.rate, folder)
    finally:
        shutil.rmtree(folder)
    print_and_save(options.json, figures)
    met = figures['growth of the memory [MiB]'] < 20 and figures['slowest look for touches, first contact [s]'] < 0.2
    return 0 if met else 1


if __name__ == '__main__':
    sys.exit(main())
