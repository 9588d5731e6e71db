"""A frame_id that contradicts the cell description is said."""

from __future__ import annotations

from math import cos, radians, sin
from types import SimpleNamespace

import pytest
from rclpy.serialization import serialize_message

from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.conversion import Sample
from scara_kinetostatic.nodes.frame_check import FrameCheck
from scara_kinetostatic.nodes.wrench_frame import WrenchFrame

NO_TURN = (0.0, 0.0, 0.0, 1.0)


def about_z(angle: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, sin(radians(angle) / 2), cos(radians(angle) / 2)


@pytest.mark.parametrize('frame_id', ['', 'base', 'base_link', '/left/base_link', 'world', 'sensor'])
def test_what_agrees_or_is_unknown_is_not_said(frame_id: str) -> None:
    assert not WrenchFrame(SensorFrame.BASE).complaint(frame_id)


@pytest.mark.parametrize(('stated', 'frame_id'), [
    (SensorFrame.BASE, 'tool0'), (SensorFrame.BASE, 'left/flange'), (SensorFrame.TOOL, 'base_link'),
])  # fmt: skip
def test_the_other_frame_is_said(stated: SensorFrame, frame_id: str) -> None:
    said = WrenchFrame(stated).complaint(frame_id)
    assert repr(frame_id) in said and f'sensor.frame: {stated.value}' in said


def test_a_sensor_that_is_fixed_to_the_tool_is_not_in_the_base() -> None:
    frame = WrenchFrame(SensorFrame.BASE)
    frame.add_fixed('tool0', 'mount', about_z(90))
    frame.add_fixed('mount', 'sensor', about_z(-90))
    assert 'is fixed to tool0' in frame.complaint('sensor')
    tool = WrenchFrame(SensorFrame.TOOL)
    tool.add_fixed('tool0', 'mount', about_z(90))
    tool.add_fixed('mount', 'sensor', about_z(-90))
    assert not tool.complaint('sensor')
    assert 'turned by 90 degrees against tool0' in tool.complaint('mount')


def test_a_turn_is_said_from_either_end() -> None:
    frame = WrenchFrame(SensorFrame.BASE)
    frame.add_fixed('sensor', 'base_link', about_z(30))  # the tree may stand upside down
    assert 'turned by 30 degrees against base_link' in frame.complaint('sensor')


@pytest.mark.parametrize('wrong', [(0.0, 0.0, 0.0, 0.0), (float('nan'),) * 4])
def test_a_senseless_rotation_is_none(wrong: tuple[float, ...]) -> None:
    frame = WrenchFrame(SensorFrame.BASE)
    frame.add_fixed('base_link', 'sensor', wrong)
    frame.add_fixed('sensor', 'base_link', NO_TURN)  # a circle ends
    assert not frame.complaint('sensor')


def test_the_check_takes_messages() -> None:
    class Logger:
        def info(self, text: str) -> None:
            assert 'tf2_msgs' in text

    node = SimpleNamespace(get_logger=Logger, create_subscription=lambda *_: None)
    check = FrameCheck(node, SensorFrame.BASE)  # type: ignore[arg-type]
    assert not check.complaint()
    check.last = bytes(serialize_message(conversion.wrench(Sample(0, 1.0, 2.0), 'sensor')))
    assert not check.complaint()
    x, y, z, w = about_z(45)
    rotation = SimpleNamespace(x=x, y=y, z=z, w=w)
    header, transform = SimpleNamespace(frame_id='base_link'), SimpleNamespace(rotation=rotation)
    check.note(
        SimpleNamespace(transforms=[SimpleNamespace(header=header, child_frame_id='sensor', transform=transform)])
    )
    assert 'turned by 45 degrees' in check.complaint()
