"""The configurations of RViz and Foxglove: their formats, and that what they name is there."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from scara_kinetostatic.model.cell import PAPER_CELL

CONFIG = Path(__file__).parents[2] / 'config'
NODES = CONFIG.parent / 'docs' / '_ext' / 'node_record.py'
DISPLAYS = {
    'Grid': None,
    'MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'Path': 'nav_msgs/msg/Path',
    'Pose': 'geometry_msgs/msg/PoseStamped',
    'RobotModel': 'std_msgs/msg/String',
    'TF': None,
    'Wrench': 'geometry_msgs/msg/WrenchStamped',
}
"""Displays of `rviz_default_plugins` in Jazzy and the type of their topic."""
OTHERS = {'Interact', 'MoveCamera', 'Measure', 'TF', 'TopDownOrtho'}
"""Tools, transformer and view of the same library."""
PANELS = {'3D', 'Plot', 'DiagnosticSummary', 'CallService'}
GROUPS = {
    'visualizer/markers': {'objects', 'touches', 'forces', 'rejected'},
    'visualizer/arm': {'nominal', 'calibrated'},
}


@pytest.fixture(scope='module')
def published() -> dict[str, str]:
    """Type by topic of all that the nodes publish, services too; names without a leading slash."""
    root = {'cwd': CONFIG.parent, 'env': {'PYTHONPATH': str(CONFIG.parent)}}
    made = subprocess.run([sys.executable, str(NODES)], capture_output=True, text=True, check=True, **root)  # type: ignore[call-overload]
    found = {}
    for node, declared in json.loads(made.stdout).items():
        for one in declared['interfaces']:
            if one['role'] in ('publishes', 'service'):
                found[one['name'].replace('~', node).lstrip('/')] = one['type']
    return found


def classes(part: Any) -> Iterator[str]:
    if isinstance(part, dict):
        yield from [part['Class']] if part.get('Class') else []
        for inner in part.values():
            yield from classes(inner)
    elif isinstance(part, list):
        for inner in part:
            yield from classes(inner)


def test_rviz(published):
    view = yaml.safe_load((CONFIG / 'cell.rviz').read_text())
    assert set(view) == {'Panels', 'Visualization Manager', 'Window Geometry'}
    manager = view['Visualization Manager']
    assert manager['Class'] == '' and manager['Global Options']['Fixed Frame'] == 'base_link'
    known = {'rviz_common/Displays', 'rviz_common/Views', *(f'rviz_default_plugins/{x}' for x in {*DISPLAYS, *OTHERS})}
    assert set(classes(view)) <= known
    for display in manager['Displays']:
        assert display['Enabled'] == display['Value'] and display['Name']
        topic = display.get('Topic') or display.get('Description Topic')
        kind = DISPLAYS[display['Class'].removeprefix('rviz_default_plugins/')]
        assert bool(topic) == bool(kind)
        if topic:
            assert published[topic['Value']] == kind  # relative: in the namespace of RViz
            assert {'Depth', 'Durability Policy', 'History Policy', 'Reliability Policy'} < set(topic)
    groups = {item['Topic']['Value']: set(item['Namespaces']) for item in manager['Displays'] if 'Namespaces' in item}
    assert groups == GROUPS


def panels(tree: Any) -> list[str]:
    if isinstance(tree, str):
        return [tree]
    assert set(tree) == {'direction', 'first', 'second', 'splitPercentage'} and tree['direction'] in ('row', 'column')
    return panels(tree['first']) + panels(tree['second'])


def field(kind: str, path: list[str]) -> str:
    """The type of a field of a message."""
    package, _, name = kind.partition('/msg/')
    message = getattr(__import__(f'{package}.msg', fromlist=[name]), name)
    inner = message.get_fields_and_field_types()[path[0]]
    return field(inner.replace('/', '/msg/'), path[1:]) if path[1:] else str(inner)


def test_foxglove(published):
    view = json.loads((CONFIG / 'foxglove.json').read_text())
    assert set(view) == {'configById', 'globalVariables', 'userNodes', 'playbackConfig', 'layout'}
    shown = panels(view['layout'])
    assert sorted(shown) == sorted(view['configById']) and {name.partition('!')[0] for name in shown} == PANELS
    scene = view['configById']['3D!cell']
    assert scene['followTf'] == 'base_link'
    shown_in_3d = {topic for topic, one in scene['topics'].items() if one['visible']}
    assert shown_in_3d == {*(f'/{topic}' for topic in GROUPS), '/touch_runner/next_touch', '/contour_tracker/path'}
    assert {published[topic.lstrip('/')] for topic in scene['topics']} <= set(DISPLAYS.values())
    plotted = []
    for name in shown:
        for path in view['configById'][name].get('paths', []):
            topic, *fields = re.sub(r'^/', '', path['value']).split('.')
            assert field(published[topic], fields) in ('double', 'uint32')
            plotted.append(topic)
    assert set(plotted) == {PAPER_CELL.sensor.wrench, 'collector/touches'}
    assert published[view['configById']['CallService!calibrate']['serviceName'].lstrip('/')] == 'std_srvs/srv/Trigger'
    assert view['configById']['DiagnosticSummary!diagnostics']['topicToRender'] == '/diagnostics'


def test_foxglove_in_a_namespace(tmp_path):
    """The command on the page puts the namespace before all names but /diagnostics, which all cells share."""
    page = (CONFIG.parent / 'docs/how_to/ros_cell.md').read_text(encoding='utf-8')
    (edit,) = re.findall(r"^sed -E '(.*)' config/foxglove.json > left.json$", page, re.MULTILINE)
    text = subprocess.run(
        ['sed', '-E', edit, str(CONFIG / 'foxglove.json')], capture_output=True, text=True, check=True
    ).stdout
    names = re.findall(r'"(/[^"]*)"', text)
    assert [name for name in names if not name.startswith('/left/')] == ['/diagnostics']
    assert json.loads(text)['configById']['3D!cell']['followTf'] == 'left/base_link'
