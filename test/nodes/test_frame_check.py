"""The collector turns forces by `/tf_static` as a calibration of its recording does.

`tf2_msgs` is not on PyPI: another type stands for it on the wire, which carries the same bytes.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bags.mounted import TOOL_CELL, mounted_messages, transform_message, transforms
from rclpy.serialization import serialize_message

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import RefusedError
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.streams import FrameCheck, Stream
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import DISCARDED, find_touches


def make_check(said: list[str], changed: Callable[[bytes, bool], None]) -> FrameCheck:
    logger = SimpleNamespace(info=said.append, warning=said.append)
    node: Any = SimpleNamespace(
        get_logger=lambda: logger,
        create_subscription=lambda *_, **__: None,
        get_parameter_or=lambda _, default: default,
    )
    return FrameCheck(node, PAPER_CELL, changed)


def wrench(frame_id: str) -> bytes:
    return bytes(serialize_message(conversion.wrench((0, 1.0, 2.0), frame_id)))


def test_what_is_new_is_passed_on_once():
    passed: list[bool] = []
    said: list[str] = []
    check = make_check(said, lambda _, anew: passed.append(anew))
    assert check.turn(wrench('sensor')) is None and 'is no known frame' in check.complaint()
    check.note(transform_message('base_link', 'elsewhere', 45))
    check.note(transform_message('base_link', 'sensor', 45))
    check.note(transform_message('base_link', 'sensor', 45))
    assert passed == [False, True]
    assert check.turn(wrench('sensor')) is not None and not check.complaint()
    assert check.turn(wrench('base_link')) is None
    assert len(check.messages) == 2
    check.turn(wrench('sensor'))
    assert 'turned by 45 degrees from sensor into base_link' in check.description()


def test_bytes_that_are_no_transforms_are_said():
    said: list[str] = []
    check = make_check(said, lambda *_: None)
    check.note(b'\0\1\0\0\1\0\0\0')
    assert '/tf_static' in said[-1]


@pytest.fixture
def collector(bench: Callable[..., Any], cell_in: Callable[..., Path], tmp_path: Path) -> Collector:
    """One that records the mounted cell; it is not spun."""
    return bench(Collector, autostart=True, cell=cell_in(TOOL_CELL), output=tmp_path / 'bags').node


@pytest.mark.parametrize('late', [False, True], ids=['before', 'while recording'])
def test_live_touches_are_those_of_the_recording(late, collector):
    session, tree = collector._session, collector._streams
    with pytest.raises(RefusedError, match='no accepted touch'):
        collector._discard_last()
    played = simulate_streams(TOOL_CELL, PAPER_ACTUAL, default_plan(TOOL_CELL).select(np.arange(12)), seed=3)
    for number, item in enumerate(mounted_messages(played)):
        if number == 50 * late:  # before the first touch
            for transform in transforms(0):
                tree.frame.note(transform.payload)
        stream = Stream.JOINTS if item.topic == '/joint_states' else Stream.WRENCH
        collector._record(stream, item.payload, item.log_time, tree.samples(stream, item.payload))
        if number % 2000 == 0:
            collector._poll()
    number = int(re.fullmatch(r'touch (\d+) \(.+\) discarded; \d+ touches left', collector._discard_last())[1])
    assert collector._stop() == f'11 touches (1 more rejected) in {session.folder}'
    streams = read_streams(session.folder, TOOL_CELL)
    assert streams.turned and tree.frame.description() == streams.turned
    found = find_touches(streams, TOOL_CELL)
    assert len(found.touches) == 11 and [(one.index, one.reason) for one in found.rejected] == [(number, DISCARDED)]
