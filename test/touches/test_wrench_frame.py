"""A wrench is turned by its frame_id; one that contradicts the cell description is said. A plain tree of transforms."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest

from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Plane, Sensor, SensorFrame
from scara_kinetostatic.touches.streams import FixedTransform, WrenchFrame

NO_TURN = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)


def about_z(angle: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, sin(radians(angle) / 2), cos(radians(angle) / 2)


def cell(stated: SensorFrame) -> Cell:
    return replace(PAPER_CELL, sensor=Sensor(frame=stated))


def tree(stated: SensorFrame, *transforms: tuple[str, str, tuple[float, float, float, float]]) -> WrenchFrame:
    frame = WrenchFrame(cell(stated))
    for transform in transforms:
        frame.add(FixedTransform(*transform))
    return frame


@pytest.mark.parametrize('frame_id', ['', 'base', 'base_link', '/left/base_link', 'world'])
def test_what_agrees_is_not_said(frame_id):
    frame = WrenchFrame(PAPER_CELL)
    assert not frame.complaint(frame_id) and frame.turn(frame_id) is None


PREFIXED = ('left_base_link', 'left_tool0', NO_TURN), ('left_tool0', 'left_ft_frame', about_z(90))


@pytest.mark.parametrize('stated', SensorFrame)
def test_a_frame_that_is_not_known_is_said_until_its_name_is_stated(stated):
    """As with `tf_prefix` of a URDF: a name that ends in a usual one is not taken for it."""
    name = {SensorFrame.BASE: 'left_base_link', SensorFrame.TOOL: 'left_tool0'}[stated]
    frame = tree(stated, *PREFIXED)
    for frame_id in ('left_ft_frame', name):
        said = frame.complaint(frame_id)
        assert said.startswith(f"frame_id '{frame_id}' is no known frame (") and f'to {name} if that is it' in said
        assert frame.turn(frame_id) is None
    assert 'to its name, elsewhere where that is not turned against it, or state sensor.rota' in frame.complaint(
        'elsewhere'
    )
    known = WrenchFrame(replace(cell(stated), sensor=Sensor(frame=stated, **{f'{stated.value}_frame': name})))
    for transform in PREFIXED:
        known.add(FixedTransform(*transform))
    assert not known.complaint('left_ft_frame') and not known.complaint(name) and known.turn(name) is None
    np.testing.assert_allclose(known.turn('left_ft_frame') @ [1.0, 0.0, 0.0], [0.0, 1.0], atol=1e-12)
    assert 'elsewhere' in known.complaint('elsewhere')
    prefixed = WrenchFrame(cell(stated), 'left_')
    assert not prefixed.complaint(name) and prefixed.complaint('left_ft_frame')


def test_where_the_mounting_is_stated_any_frame_may_be():
    turned = Sensor(frame=SensorFrame.TOOL, rotation=0.3)
    upright = Plane('base_link', x=(1.0, 0.0, 0.0), y=(0.0, 0.0, 1.0))
    assert not WrenchFrame(replace(PAPER_CELL, sensor=turned)).complaint('tool0_controller')
    there = replace(PAPER_CELL, plane=upright, sensor=Sensor(frame=SensorFrame.TOOL))
    assert not WrenchFrame(there).complaint('tool0_controller')
    assert WrenchFrame(replace(there, sensor=Sensor())).complaint('tool0_controller')


@pytest.mark.parametrize(('stated', 'frame_id'), [
    (SensorFrame.BASE, 'tool0'), (SensorFrame.BASE, 'left/flange'), (SensorFrame.TOOL, 'base_link'),
])  # fmt: skip
def test_the_other_frame_is_said(stated, frame_id):
    said = WrenchFrame(cell(stated)).complaint(frame_id)
    assert repr(frame_id) in said and f'sensor.frame: {stated.value}' in said


def test_a_sensor_that_is_fixed_to_the_tool_is_not_in_the_base():
    mounted = ('tool0', 'mount', about_z(90)), ('mount', 'sensor', about_z(-90))
    base = tree(SensorFrame.BASE, *mounted)
    assert 'is fixed to tool0' in base.complaint('sensor')
    assert base.turn('mount') is None, 'what is contradicted is not turned'
    tool = tree(SensorFrame.TOOL, *mounted)
    assert not tool.complaint('sensor') and tool.turn('sensor') is None
    assert not tool.complaint('mount')
    assert tool.description('mount') == 'forces turned by 90 degrees from mount into tool0'


COS, SIN = cos(radians(30)), sin(radians(30))
ON_ITS_SIDE = (0.0, sin(np.pi / 4), 0.0, cos(np.pi / 4))


@pytest.mark.parametrize(
    ('stated', 'transforms', 'force', 'expected'),
    [
        ('tool', [('left/tool0', 'left/sensor', about_z(90))], (1.0, 2.0, 5.0), (-2.0, 1.0)),
        ('base', [('sensor', 'base_link', about_z(-90))], (1.0, 2.0, 5.0), (-2.0, 1.0)),
        ('tool', [('tool0', 'sensor', UPSIDE_DOWN)], (3.0, 4.0, 5.0), (3.0, -4.0)),
        ('tool', [('tool0', 'sensor', ON_ITS_SIDE)], (3.0, 4.0, 5.0), (5.0, 4.0)),
        (
            'tool', [('tool0', 'mount', about_z(30)), ('mount', 'sensor', UPSIDE_DOWN)],
            (1.0, 2.0, 0.0), (COS + 2 * SIN, SIN - 2 * COS),
        ),
    ],
    ids=['parent', 'tree upside down', 'sensor upside down', 'on its side', 'turns add up'],
)  # fmt: skip
def test_a_force_is_turned_into_the_stated_frame(stated, transforms, force, expected):
    turn = tree(SensorFrame(stated), *transforms).turn('/left/sensor' if 'left' in transforms[0][0] else 'sensor')
    np.testing.assert_allclose(turn @ force, expected, atol=1e-12)


def test_the_frame_of_the_description_counts_before_others_of_the_same_side():
    """`world` is a usual name, but the tree knows `base_link`, in which the objects are given."""
    frame = tree(SensorFrame.BASE, ('world', 'base_link', about_z(90)))
    assert frame.description('world') == 'forces turned by 90 degrees from world into base_link'


@pytest.mark.parametrize('root', ['world', 'base_link'])
def test_the_root_of_two_arms_is_not_the_base_of_one(root):
    """As of dual-arm cells, and of an arm on a vehicle: what is nearer and called like a base is turned against it."""
    arms = (root, 'left_base_link', about_z(30)), ('left_base_link', 'left_ft', about_z(90))
    said = (frame := tree(SensorFrame.BASE, *arms)).complaint('left_ft')
    assert f'is fixed to {root}, but left_base_link, turned against it, is nearer' in said
    assert 'set sensor.base_frame, the name of the base, to left_base_link if that is it' in said
    assert frame.turn('left_ft') is None and frame.complaint('left_base_link') and not frame.complaint(root)
    for name, turned in (('left_base_link', 90), (root, 120)):
        named = WrenchFrame(replace(PAPER_CELL, sensor=Sensor(frame=SensorFrame.BASE, base_frame=name)))
        for transform in arms:
            named.add(FixedTransform(*transform))
        assert not named.complaint('left_ft') and f'by {turned} degrees' in named.description('left_ft')
    along = tree(SensorFrame.BASE, (root, 'left_base_link', NO_TURN), arms[1])
    assert not along.complaint('left_ft') and 'by 90 degrees' in along.description('left_ft')
    assert 'states sensor.frame: tool' in tree(SensorFrame.TOOL, *arms).complaint('left_ft')
    known = tree(SensorFrame.BASE, (root, 'left/base', about_z(180)), ('left/base', 'ft', about_z(90)))
    assert not known.complaint('ft') and 'left/base' not in known.complaint('left/base')


@pytest.mark.parametrize(
    'transforms',
    [
        [('base_link', 'sensor', about_z(30)), ('base_link', 'sensor', NO_TURN)],
        [('base_link', 'sensor', (0.0, 0.0, 0.0, 0.0))],
        [('base_link', 'sensor', (float('nan'),) * 4)],
        [('sensor', 'b', NO_TURN), ('b', 'c', NO_TURN), ('c', 'sensor', NO_TURN)],
    ],
    ids=['replaced by a later one', 'senseless', 'nan', 'circle'],
)
def test_transforms_that_turn_nothing(transforms):
    frame = tree(SensorFrame.BASE, *transforms)
    assert frame.turn('sensor') is None and not frame.description('sensor')


def test_a_stated_turn_counts_where_no_transform_says_it():
    turned = replace(PAPER_CELL, sensor=Sensor(frame=SensorFrame.TOOL, rotation=np.pi / 2))
    frame = WrenchFrame(turned)
    np.testing.assert_allclose(frame.turn('sensor') @ (1.0, 2.0, 9.0), (-2.0, 1.0), atol=1e-15)
    frame.add(FixedTransform('tool0', 'sensor', about_z(180)))
    np.testing.assert_allclose(frame.turn('sensor') @ (1.0, 2.0, 9.0), (-1.0, -2.0), atol=1e-15)
    frame.add(FixedTransform('tool0', 'sensor', NO_TURN))
    assert frame.turn('sensor') is None and not frame.description('sensor')


def test_the_plane_of_an_upright_arm_takes_its_part_of_the_force():
    """The robot's frames are its own: `tool0` is not link 2, and the base is the frame of the plane."""
    plane = Plane('base_link', (0.0, 0.0, 0.1), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    base = WrenchFrame(replace(PAPER_CELL, plane=plane))
    np.testing.assert_array_equal(base.turn('base_link') @ (1.0, 9.0, 2.0), (1.0, 2.0))
    base.add(FixedTransform('base_link', 'mount', about_z(90)))
    np.testing.assert_allclose(base.turn('mount') @ (9.0, -1.0, 2.0), (1.0, 2.0), atol=1e-15)
    axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    tool = WrenchFrame(replace(PAPER_CELL, plane=plane, sensor=Sensor(frame=SensorFrame.TOOL, axes=axes)))
    tool.add(FixedTransform('tool0', 'sensor', about_z(90)))
    np.testing.assert_array_equal(tool.turn('sensor') @ (1.0, 9.0, 2.0), (2.0, 1.0))
    assert 'is a frame of the base' in tool.complaint('base_link') and not tool.complaint('sensor')
