"""The collector turns forces by `/tf_static` as a calibration of its recording does.

`tf2_msgs` is not on PyPI: another type stands for it on the wire, which carries the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from bags.mounted import TOOL_CELL, mounted_messages, mounted_streams, transform_message, transforms
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import eventually, trigger
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes import streams as module
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.conversion import Sample
from scara_kinetostatic.nodes.demo_client import DemoClient
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES, RELIABLE_STREAM, FrameCheck
from scara_kinetostatic.touches.detection import find_touches

FIRST, AT_ONCE = 50, 400
"""Messages that are published before the collector has taken them in: at first, before any touch, and later."""


def make_check(said: list[str], changed: Callable[[bytes, bool], None]) -> FrameCheck:
    logger = SimpleNamespace(info=said.append, warning=said.append)
    node: Any = SimpleNamespace(get_logger=lambda: logger, create_subscription=lambda *_, **__: None)
    return FrameCheck(node, SensorFrame.BASE, changed)


def wrench(frame_id: str) -> bytes:
    return bytes(serialize_message(conversion.wrench(Sample(0, 1.0, 2.0), frame_id)))


def test_what_is_new_is_passed_on_once() -> None:
    passed: list[bool] = []
    said: list[str] = []
    check = make_check(said, lambda _, anew: passed.append(anew))
    assert check.turn(wrench('sensor')) is None and not check.complaint()
    check.note(transform_message('base_link', 'elsewhere', 45))
    check.note(transform_message('base_link', 'sensor', 45))
    check.note(transform_message('base_link', 'sensor', 45))
    assert passed == [False, True]
    assert check.turn(wrench('sensor')) is not None
    assert check.turn(wrench('base_link')) is None
    assert len(check.messages) == 2
    check.turn(wrench('sensor'))
    assert 'turned by 45 degrees from sensor into base_link' in check.description()


def test_bytes_that_are_no_transforms_are_said() -> None:
    said: list[str] = []
    check = make_check(said, lambda *_: None)
    check.note(b'\0\1\0\0\1\0\0\0')
    assert '/tf_static' in said[-1]


@pytest.mark.parametrize('late', [False, True], ids=['before', 'while recording'])
def test_live_touches_are_those_of_the_recording(
    late: bool, spin: Callable[..., Node], client: DemoClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, 'TFMessage', String)
    (tmp_path / 'cell.yaml').write_text(dump_cell(TOOL_CELL))
    settings = {'autostart': 'true', 'cell': tmp_path / 'cell.yaml', 'output': tmp_path / 'bags'}
    arguments = [text for name, value in settings.items() for text in ('-p', f'{name}:={value}')]
    node = spin(Collector, '--ros-args', *arguments)
    tree = node.create_publisher(String, '/tf_static', LATCHED_TOUCHES)
    kinds = {'/joint_states': JointState, '/wrench': WrenchStamped}
    publishers = {name: node.create_publisher(kind, name, RELIABLE_STREAM) for name, kind in kinds.items()}
    assert eventually(lambda: all(item.get_subscription_count() for item in (tree, *publishers.values())))
    messages = mounted_messages(mounted_streams())
    if not late:
        publish_tree(tree, node)
    steps = [0, FIRST, *range(AT_ONCE, len(messages), AT_ONCE), len(messages)]
    for first, sent in pairwise(steps):
        for item in messages[first:sent]:
            publishers[item.topic].publish(item.payload)
        assert eventually(lambda sent=sent: sum(monitor.count for monitor in node._streams.monitors.values()) == sent)
        if late and first == 0:  # before the first touch
            publish_tree(tree, node)
    session = node._session
    assert trigger(client, '/collector/stop').success
    streams = read_streams(session.folder, TOOL_CELL)
    assert streams.turned and node._streams.frame.description() == streams.turned
    offline = find_touches(streams, TOOL_CELL)
    assert len(offline.touches) == 72
    assert (session.touches, session.rejected) == (72, 0)


def publish_tree(tree: Any, node: Node) -> None:
    for item in transforms(0):
        tree.publish(item.payload)
    assert eventually(lambda: len(node._streams.frame.messages) == 2)
