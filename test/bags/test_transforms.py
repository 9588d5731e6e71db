"""Forces are turned by the fixed transforms of a recording, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bags.forms import CELL, Message, record, write_mcap
from bags.mounted import ANGLE, TOOL_CELL, mounted_messages, mounted_streams, transform_message, transforms

from scara_kinetostatic.bags.decoding import TF_MESSAGE, TF_STATIC, decode_transforms, wrench_fields
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream


@pytest.fixture(scope='module')
def streams() -> Streams:
    return mounted_streams()


def test_forces_are_turned_wherever_the_transforms_are_in_the_file(tmp_path, streams):
    messages = mounted_messages(streams)
    write_mcap(tmp_path / 'bag.mcap', [*messages, *transforms(messages[-1].log_time)])
    read = read_streams(tmp_path / 'bag.mcap', TOOL_CELL)
    np.testing.assert_allclose(read.wrench.force, streams.wrench.force, atol=1e-12)
    assert read.turned == f'forces turned by {ANGLE:.3g} degrees from sensor into tool0' and not read.warnings
    outcome = calibrate_recordings([tmp_path / 'bag.mcap'], TOOL_CELL)
    assert outcome.verdict == 'none' and outcome.recordings[0].turned == read.turned


def test_wrenches_of_another_frame_are_not_turned(tmp_path, streams):
    """Two drivers on one topic, one of them in the frame of the tool; without transforms none is turned."""
    sensor, tool = mounted_messages(streams), mounted_messages(streams, 'tool0_')
    mixed = [one if place % 2 else other for place, (one, other) in enumerate(zip(sensor, tool, strict=True))]
    write_mcap(tmp_path / 'bag.mcap', [*transforms(mixed[0].log_time), *mixed])
    read = read_streams(tmp_path / 'bag.mcap', TOOL_CELL).wrench.force
    right = np.isclose(read, streams.wrench.force, atol=1e-12).all(axis=1)
    assert 0.3 < right.mean() < 0.7
    write_mcap(tmp_path / 'plain.mcap', sensor)
    plain = read_streams(tmp_path / 'plain.mcap', TOOL_CELL)
    assert plain.turned == '' and not np.allclose(plain.wrench.force, streams.wrench.force)


def test_a_frame_id_that_contradicts_is_said_and_not_turned(tmp_path, streams):
    messages = mounted_messages(streams)
    write_mcap(tmp_path / 'bag.mcap', [*transforms(messages[0].log_time), *messages])
    base = replace(TOOL_CELL, sensor=TOOL_CELL.sensor._replace(frame=SensorFrame.BASE))
    read = read_streams(tmp_path / 'bag.mcap', base)
    assert read.turned == ''
    assert any("frame_id 'sensor' is fixed to tool0" in text for text in read.warnings)


def on_axes(messages: list[Message], turn: Any, added: Sequence[float] = (0, 0, 0)) -> list[Message]:
    """The same with the wrenches' forces (fx, fy, fz) turned by a matrix, and a constant one."""
    made = []
    for item in messages:
        if item.topic == '/wrench':
            begin = wrench_fields(item.payload).begin
            force = np.frombuffer(item.payload, '<f8', 3, begin) @ np.transpose(turn) + added
            item = item._replace(payload=item.payload[:begin] + force.tobytes() + item.payload[begin + 24 :])
        made.append(item)
    return made


@pytest.mark.parametrize(
    ('turn', 'said'),
    [
        ([[1, 0, 0], [0, 0, 1], [0, 1, 0]], '/wrench has the force of contact in fx and fz, none in fy'),
        ([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], '/wrench has the force of contact in fy and fz, none in fx'),
        ([[1, 0, 0], [0, 0.03, 1], [0, 1, -0.03]], '/wrench has the force of contact in fx and fz, none in fy'),
    ],
)
def test_a_sensor_that_lies_on_its_side_is_named(tmp_path, streams, turn, said):
    write_mcap(tmp_path / 'bag.mcap', on_axes(mounted_messages(streams), turn))
    with pytest.raises(RecordingError, match=said) as caught:
        find_touches(read_streams(tmp_path / 'bag.mcap', TOOL_CELL), TOOL_CELL)
    assert 'record how it is mounted in tool0 on /tf_static' in str(caught.value)


NAMED_CELL = replace(TOOL_CELL, sensor=TOOL_CELL.sensor._replace(tool_frame='sensor'))


def test_some_force_along_z_is_no_mistake(tmp_path, streams):
    write_mcap(tmp_path / 'bag.mcap', on_axes(mounted_messages(streams), [[1, 0, 0], [0, 1, 0], [0.4, 0.4, 0]]))
    assert read_streams(tmp_path / 'bag.mcap', NAMED_CELL).warnings == ()
    (said,) = read_streams(tmp_path / 'bag.mcap', TOOL_CELL).warnings
    assert "frame_id 'sensor' is no known frame" in said and 'set sensor.tool_frame' in said
    free = [[0.01, 0, 0], [0, 0.01, 0], [0.03, 0.03, 0]]  # nothing is touched
    write_mcap(tmp_path / 'free.mcap', on_axes(mounted_messages(streams), free))
    read = read_streams(tmp_path / 'free.mcap', NAMED_CELL)
    assert read.warnings == ()
    assert find_touches(read, TOOL_CELL).found == 0


def test_a_slow_change_of_fz_long_before_a_few_touches_is_no_mistake(tmp_path, streams):
    """Nearly all of the time nothing is touched: fx and fy are noise, and fz warms up."""
    joints, wrench, rest = streams.joints, streams.wrench, 10_000_000 * np.arange(-20_000, 0)
    few, first = wrench.stamp < wrench.stamp[0] + 6 * 10**9, joints.stamp < joints.stamp[0] + 6 * 10**9
    noise = np.random.default_rng(1).normal(0.0, 0.05, (len(rest), 2))
    still = np.tile(joints.position[0], (len(rest), 1))
    stamps = [np.append(part[0] + rest, part[kept]) for part, kept in ((joints.stamp, first), (wrench.stamp, few))]
    values = np.concatenate([still, joints.position[first]]), np.concatenate([noise, wrench.force[few]])
    waiting = Streams('waiting', JointStream(stamps[0], values[0]), WrenchStream(stamps[1], values[1]))
    messages = mounted_messages(waiting)
    write_mcap(tmp_path / 'bag.mcap', [*on_axes(messages[:6000], np.eye(3), (0, 0, -15)), *messages[6000:]])
    read = read_streams(tmp_path / 'bag.mcap', TOOL_CELL)
    assert read.force_ranges is not None
    assert read.force_ranges[2] > 10 * max(read.force_ranges[:2])
    assert len(find_touches(read, TOOL_CELL).held) == 2


def test_the_writer_keeps_transforms(tmp_path, streams):
    items = mounted_messages(streams)[:200]
    with BagWriter(tmp_path / 'bag', TOOL_CELL, log_time=items[0].log_time) as bag:
        record(bag, items)
        for item in transforms(items[-1].log_time):
            bag.write_transforms(item.payload, item.log_time)
    assert read_streams(tmp_path / 'bag', TOOL_CELL).turned


def test_a_damaged_message_is_named(tmp_path, streams):
    (found,) = decode_transforms(transform_message('a', 'b', 0.0))
    assert found == ('a', 'b', (0.0, 0.0, 0.0, 1.0))
    messages = mounted_messages(streams)[:100]
    damaged = Message(TF_STATIC, TF_MESSAGE, messages[0].log_time, b'\0\1\0\0\1\0\0\0')
    write_mcap(tmp_path / 'bag.mcap', [damaged, *messages])
    with pytest.raises(RecordingError, match=TF_STATIC):
        read_streams(tmp_path / 'bag.mcap', CELL)
