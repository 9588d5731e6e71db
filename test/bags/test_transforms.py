"""Forces are turned by the fixed transforms of a recording, once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags.forms import CELL, Message, write_mcap
from bags.mounted import ANGLE, TOOL_CELL, mounted_messages, mounted_streams, transform_message, transforms

from scara_kinetostatic.bags.cdr import decode_transforms
from scara_kinetostatic.bags.messages import TF_MESSAGE, TF_STATIC
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.touches.streams import Streams


@pytest.fixture(scope='module')
def streams() -> Streams:
    return mounted_streams()


def test_a_sensor_turned_on_the_tool_calibrates_right(tmp_path: Path, streams: Streams) -> None:
    messages = mounted_messages(streams)
    write_mcap(tmp_path / 'bag.mcap', [*messages, *transforms(messages[-1].log_time)])  # the transforms last
    outcome = calibrate_recordings([tmp_path / 'bag.mcap'], TOOL_CELL)
    assert outcome.verdict == 'none' and not outcome.warnings
    assert outcome.recordings[0].turned == f'forces turned by {ANGLE:.3g} degrees from sensor into tool0'
    final, truth = outcome.final, PAPER_ACTUAL.as_dict()
    z = [(final[name].value - truth[name]) / final[name].std for name in NAMES]
    assert max(map(abs, z)) < 4


def test_the_forces_are_those_in_the_frame_of_the_cell(tmp_path: Path, streams: Streams) -> None:
    messages = mounted_messages(streams)
    write_mcap(tmp_path / 'bag.mcap', [*transforms(messages[0].log_time), *messages])
    read = read_streams(tmp_path / 'bag.mcap', TOOL_CELL)
    np.testing.assert_allclose(read.wrench.force, streams.wrench.force, atol=1e-12)
    write_mcap(tmp_path / 'plain.mcap', messages)
    plain = read_streams(tmp_path / 'plain.mcap', TOOL_CELL)
    assert plain.turned == '' and not np.allclose(plain.wrench.force, streams.wrench.force)


def test_wrenches_of_another_frame_are_not_turned(tmp_path: Path, streams: Streams) -> None:
    """Two drivers on one topic, one of them in the frame of the tool."""
    sensor, tool = mounted_messages(streams), mounted_messages(streams, 'tool0_')
    mixed = [one if place % 2 else other for place, (one, other) in enumerate(zip(sensor, tool, strict=True))]
    write_mcap(tmp_path / 'bag.mcap', [*transforms(mixed[0].log_time), *mixed])
    read = read_streams(tmp_path / 'bag.mcap', TOOL_CELL).wrench.force
    right = np.isclose(read, streams.wrench.force, atol=1e-12).all(axis=1)
    assert 0.3 < right.mean() < 0.7


def test_a_frame_id_that_contradicts_is_said_and_not_turned(tmp_path: Path, streams: Streams) -> None:
    messages = mounted_messages(streams)
    write_mcap(tmp_path / 'bag.mcap', [*transforms(messages[0].log_time), *messages])
    base = replace(TOOL_CELL, sensor=TOOL_CELL.sensor._replace(frame=SensorFrame.BASE))
    read = read_streams(tmp_path / 'bag.mcap', base)
    assert read.turned == ''
    assert any("frame_id 'sensor' is fixed to tool0" in text for text in read.warnings)


def test_the_writer_keeps_transforms(tmp_path: Path, streams: Streams) -> None:
    items = mounted_messages(streams)[:200]
    with BagWriter(tmp_path / 'bag', TOOL_CELL, log_time=items[0].log_time) as bag:
        for item in items:
            (bag.write_joint_state if item.topic == '/joint_states' else bag.write_wrench)(item.payload, item.log_time)
        bag.write_discard('{"touch": 0, "stamp": 1}', items[-1].log_time)
        for item in transforms(items[-1].log_time):
            bag.write_transforms(item.payload, item.log_time)
    assert read_streams(tmp_path / 'bag', TOOL_CELL).turned


def test_a_message_that_is_none_is_named() -> None:
    (found,) = decode_transforms(transform_message('a', 'b', 0.0))
    assert found == ('a', 'b', (0.0, 0.0, 0.0, 1.0))
    with pytest.raises(ValueError, match=TF_STATIC):
        decode_transforms(b'\0\1\0\0\1\0\0\0')


def test_a_damaged_message_is_no_crash(tmp_path: Path, streams: Streams) -> None:
    from scara_kinetostatic.errors import RecordingError

    messages = mounted_messages(streams)[:100]
    damaged = Message(TF_STATIC, TF_MESSAGE, messages[0].log_time, b'\0\1\0\0\1\0\0\0')
    write_mcap(tmp_path / 'bag.mcap', [damaged, *messages])
    with pytest.raises(RecordingError, match=TF_STATIC):
        read_streams(tmp_path / 'bag.mcap', CELL)
