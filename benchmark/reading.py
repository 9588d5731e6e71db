"""Reading a long recording: this package against `rosbags` and `mcap`, which make an object of every message.

    python -m benchmark.reading [--seconds 3600] [--rate 500] [--json FILE] [--plot FILE]

One MCAP recording is written, by default an hour of both topics at 500 Hz, 3.6 million messages, and read from the page
cache by each in a process of its own, on one core: stamps, both joint angles, both components of the force.
`rosbags` deserialises with its own generated code; `mcap` decodes with `mcap-ros2-support`. Both return one message
at a time; that loop and the conversion into arrays are timed. This package also sorts and checks the stamps.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.common import CELL, in_processes, machine, parser, peak_memory, reset_peak_memory, save, svg_figure

START = 1_700_000_000_000_000_000
PORTION = 20_000
"""Messages of each topic that are encoded at a time."""
RUNS, SLOW = 3, 30.0
"""Runs of a reader, and the time, s, beyond which one run is enough."""


def write(path: Path, seconds: float, rate: float) -> int:
    """Writes the recording; returns the number of messages."""
    from scara_kinetostatic.bags.decoding import joint_state_messages, wrench_messages
    from scara_kinetostatic.bags.writer import McapWriter, channels

    _, joint_states, wrench_topic = topics = channels(CELL)
    file, random = McapWriter(path, topics), np.random.default_rng(0)
    count = round(seconds * rate)
    for first in range(0, count, PORTION):
        places = np.arange(first, min(first + PORTION, count))
        stamp = START + np.round(places / rate * 1e9).astype(np.int64)
        later = stamp + 700_000
        joints = joint_state_messages(stamp, random.standard_normal((len(places), 2)), CELL.joint_names)
        wrenches = wrench_messages(later, 10 * random.standard_normal((len(places), 2)), 'tool0')
        rows = zip(stamp.tolist(), joints, later.tolist(), wrenches, strict=True)
        for joint_time, joint, wrench_time, wrench in rows:
            file.write(joint_states, joint, joint_time)
            file.write(wrench_topic, wrench, wrench_time)
    file.finish()
    return 2 * count


def by_package(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """`read_streams`."""
    from scara_kinetostatic.bags.reader import read_streams

    streams = read_streams(path, CELL)
    return (
        np.column_stack([streams.joints.stamp, streams.joints.position]),
        np.column_stack([streams.wrench.stamp, streams.wrench.force]),
    )


def by_rosbags(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """`AnyReader.messages` and `deserialize`."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        messages = (
            (connection.topic, reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        )
        return _gathered(messages)


def by_mcap(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """`iter_decoded_messages` with the decoder of `mcap-ros2-support`."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open('rb') as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        return _gathered((channel.topic, message) for _, channel, _, message in decoded)


def _gathered(messages: Any) -> tuple[np.ndarray, np.ndarray]:
    joints: list[tuple[float, ...]] = []
    wrenches: list[tuple[float, ...]] = []
    for topic, message in messages:
        stamp = message.header.stamp
        nanoseconds = stamp.sec * 1_000_000_000 + (stamp.nanosec if hasattr(stamp, 'nanosec') else stamp.nsec)
        if topic == CELL.sensor.joint_states:
            joints.append((nanoseconds, message.position[0], message.position[1]))
        else:
            wrenches.append((nanoseconds, message.wrench.force.x, message.wrench.force.y))
    return np.array(joints, dtype=float), np.array(wrenches, dtype=float)


READERS: dict[str, Callable[[Path], tuple[np.ndarray, np.ndarray]]] = {
    'package': by_package,
    'rosbags': by_rosbags,
    'mcap': by_mcap,
}


def measure(job: tuple[str, Path]) -> dict[str, Any]:
    """Times one reader; runs in a process of its own."""
    name, path = job
    reset_peak_memory()
    seconds, elapsed, results = [], [], None
    while len(seconds) < RUNS and (not seconds or seconds[0] < SLOW):
        begin, wall = time.process_time(), time.perf_counter()
        results = READERS[name](path)
        seconds.append(time.process_time() - begin)
        elapsed.append(time.perf_counter() - wall)
    assert results is not None
    return {
        'reader': name,
        'messages': sum(map(len, results)),
        'processor_seconds': seconds,
        'seconds': elapsed,
        'peak': peak_memory(),
        'digests': [hashlib.sha256(np.ascontiguousarray(part).tobytes()).hexdigest() for part in results],
    }


def compare(seconds: float, rate: float) -> list[dict[str, Any]]:
    """Writes the recording and times each reader."""
    records: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix='reading_') as folder:
        path = Path(folder) / 'long.mcap'
        count = write(path, seconds, rate)
        print(f'{count} messages, {path.stat().st_size / 2**20:.0f} MiB', flush=True)
        for record in in_processes(measure, [(name, path) for name in READERS], fresh=True):
            records.append(record)
            median = float(np.median(record['processor_seconds']))
            print(
                f'{record["reader"]:<8} {median:8.2f} s ({len(record["seconds"])} runs), '
                f'{1e6 * median / record["messages"]:.2f} µs a message, peak {record["peak"] / 2**20:.0f} MiB',
                flush=True,
            )
    return records


def summarise(records: list[dict[str, Any]]) -> dict[str, Any]:
    """How many times faster, and whether all arrays are the same."""
    ours, *others = records
    own = np.median(ours['processor_seconds'])
    return {
        'faster': {item['reader']: round(float(np.median(item['processor_seconds']) / own), 1) for item in others},
        'same arrays, to the last bit': all(item['digests'] == ours['digests'] for item in others),
    }


def draw(records: list[dict[str, Any]], path: Path) -> None:
    """Time and memory of each reader."""
    names = [item['reader'] for item in records]
    panels = (
        ('processor time, s', [np.median(item['processor_seconds']) for item in records]),
        ('peak memory, MiB', [item['peak'] / 2**20 for item in records]),
    )
    with svg_figure(path, 6.4, 1.9) as figure:
        for axes, (label, values) in zip(figure.subplots(1, 2), panels, strict=True):
            axes.bar_label(axes.barh(names, values, color=['#0b6e99', '#999999', '#999999']), fmt='%.3g', padding=3)
            axes.set(xlabel=label, xlim=(0, 1.2 * max(values)))
            axes.invert_yaxis()


def main() -> int:
    """Runs the benchmark."""
    options_of = parser(__doc__, plot=True)
    options_of.add_argument('--seconds', type=float, default=3600.0)
    options_of.add_argument('--rate', type=float, default=500.0)
    options = options_of.parse_args()
    before = machine()
    records = compare(options.seconds, options.rate)
    figures = {'before': before, 'after': machine(), 'summary': summarise(records)}
    print(json.dumps(figures, indent=2))
    save(options.json, {**figures, 'records': records})
    if options.plot:
        draw(records, options.plot)
    return 0


if __name__ == '__main__':
    sys.exit(main())
