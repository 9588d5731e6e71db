"""The launch file, with stand-ins for `launch`, which is not on PyPI."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

LAUNCH = Path(__file__).parents[2] / 'launch'
MODULES = (
    *('launch', 'launch.actions', 'launch.conditions', 'launch.events.process', 'launch.substitutions'),
    *('launch_ros.actions', 'launch_ros.parameter_descriptions', 'launch_ros.substitutions'),
    'ament_index_python.packages',
)
CELL = str(LAUNCH.parent / 'config' / 'cell.yaml')
ALL = ['contact_simulator', 'collector', 'calibrator', 'visualizer']


class StandIn:
    """Keeps what it was made with."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self.args, self.given = args, given

    def perform(self, context: dict[str, str]) -> str:
        return context[self.args[0]]


class Module(ModuleType):
    """Has every class that is imported from it."""

    def __getattr__(self, name: str) -> type:
        vars(self)[name] = made = type(name, (StandIn,), {})
        return made


class Launched:
    """The launch file, and what is installed beside it."""

    def __init__(self, file: dict[str, Any], installed: set[str]) -> None:
        self.file, self.installed = file, installed
        (entities,) = file['generate_launch_description']().args
        self.defaults = {item.args[0]: item.given['default_value'] for item in entities if item.args}

    def actions(self, **arguments: str) -> list[Any]:
        assert arguments.keys() <= self.defaults.keys()
        return list(self.file['CellNodes'](self.defaults | arguments).actions())

    def nodes(self, **arguments: str) -> dict[str, dict[str, Any]]:
        """What each node is started with, by its name."""
        return {item.given['name']: item.given for item in self.actions(**arguments) if 'name' in item.given}


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Launched:
    installed: set[str] = set()

    class NotFoundError(KeyError):
        pass

    def prefix(package: str) -> str:
        if package not in installed:
            raise NotFoundError(package)
        return '/opt'

    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, Module(name))
    vars(sys.modules['ament_index_python.packages']).update(
        PackageNotFoundError=NotFoundError, get_package_prefix=prefix
    )
    return Launched(runpy.run_path(str(LAUNCH / 'cell.launch.py')), installed)


def parameters(node: dict[str, Any]) -> dict[str, Any]:
    return dict(node['parameters'][-1])


@pytest.mark.parametrize(('arguments', 'expected'), [
    ({}, ALL),
    ({'simulate': 'false', 'cell': CELL}, ALL[1:]),
    ({'calibrate': 'false'}, ['contact_simulator', 'collector', 'visualizer']),
    ({'calibrate': 'false', 'show': 'false', 'simulate': 'false', 'cell': CELL}, ['collector']),
    ({'simulate': 'false', 'record': 'false', 'recording': 'bag'}, ['calibrator']),
    ({'simulate': 'false', 'record': 'false', 'cell': CELL}, ['calibrator', 'visualizer']),
    ({'show': 'false', 'compensate': 'true', 'calibration': 'calibration.json'}, [*ALL[:3], 'compensator']),
    ({'show': 'false', 'track': 'true'}, [*ALL[:3], 'contour_tracker']),
    ({'show': 'false', 'watch': 'true', 'calibration': 'calibration.json'}, [*ALL[:3], 'monitor']),
    ({'show': 'false', 'run': 'true', 'cell': CELL}, [*ALL[:3], 'touch_runner']),
])  # fmt: skip
def test_all_is_started_but_what_is_left_out(launched, arguments, expected):
    nodes = launched.nodes(**arguments)
    assert list(nodes) == [node['executable'] for node in nodes.values()] == expected
    assert {node['package'] for node in nodes.values()} == {'scara_kinetostatic'}


@pytest.mark.parametrize(('arguments', 'problem'), [
    ({'simulate': 'false'}, 'simulate:=false needs the cell description'),
    ({'simulate': 'false', 'cell': ' '}, 'simulate:=false needs the cell description'),
    (dict.fromkeys(('simulate', 'record', 'calibrate', 'show'), 'false'), 'nothing to start'),
    ({'rviz': 'true'}, 'rviz2 is not installed'),
    ({'run': 'true'}, 'run:=true needs the cell description'),
    ({'cell': '/no/cell.yaml'}, '^/no/cell.yaml: there is no such file; check the path$'),
])  # fmt: skip
def test_arguments_that_contradict_each_other_are_refused(launched, arguments, problem):
    with pytest.raises(RuntimeError, match=problem) as error:
        launched.actions(**arguments)
    assert '\n' not in str(error.value)


def test_a_namespace_is_that_of_every_node_and_of_the_frames(launched):
    launched.installed |= {'robot_state_publisher', 'rviz2'}
    nodes = launched.nodes(namespace='/left', rviz='true', compensate='true', run='true', cell=CELL)
    assert list(nodes) == [*ALL[:3], 'compensator', 'touch_runner', ALL[3], 'robot_state_publisher', 'rviz2']
    assert {node['namespace'] for node in nodes.values()} == {'/left'}
    for name in ('contact_simulator', 'visualizer', 'compensator', 'touch_runner', 'robot_state_publisher'):
        assert parameters(nodes[name])['frame_prefix'] == 'left/'
    assert nodes['rviz2']['arguments'][-2:] == ['-f', 'left/base_link']


def test_the_frames_are_those_of_the_nominal_arm(launched):
    (said,) = (item.given['msg'] for item in launched.actions() if 'msg' in item.given)
    assert said == 'robot_state_publisher is not installed: markers are shown, frames are not'
    launched.installed.add('robot_state_publisher')
    node = launched.nodes()['robot_state_publisher']
    urdf = parameters(node)['robot_description'].args[0]
    assert '<link name="tool0">' in urdf and 'calibrated_' not in urdf
    assert ('joint_states', 'joint_states') in node['remappings']
    assert 'robot_state_publisher' not in launched.nodes(frames='false')


def test_time_log_level_and_an_earlier_result(launched):
    nodes = launched.nodes(use_sim_time='true', log_level='debug', preload='calibration.yaml', output='out')
    for name, node in nodes.items():
        assert parameters(node)['use_sim_time'].args[0].args == ('use_sim_time',)
        assert node['ros_arguments'] == ['--log-level', 'debug', '--enclave', f'/scara_kinetostatic/{name}']
    assert nodes['calibrator']['parameters'][1] == 'calibration.yaml'
    assert len(nodes['collector']['parameters']) == 2
    assert 'output' in parameters(nodes['calibrator']) and 'recording' not in parameters(nodes['calibrator'])


def test_arguments_that_are_not_given_leave_the_parameter_file(launched):
    switches = {'compensate': 'true', 'track': 'true', 'watch': 'true'}
    for name, node in launched.nodes(params='own.yaml', **switches).items():
        assert node['parameters'][1:] == ['own.yaml'], name
    given = launched.nodes(params='own.yaml', autostart='false', seed='3', recordings='bags', respawn='true')
    assert parameters(given['collector']).keys() == {'autostart', 'output'}
    assert parameters(given['contact_simulator']).keys() == {'seed'}


def test_an_earlier_result_is_that_of_all_nodes(launched, tmp_path):
    switches = {'compensate': 'true', 'track': 'true', 'watch': 'true'}
    preload = tmp_path / 'calibration.yaml'
    with pytest.raises(RuntimeError, match=r'calibration\.json: there is no such file beside'):
        launched.nodes(preload=str(preload), **switches)
    (tmp_path / 'calibration.json').touch()
    nodes = launched.nodes(preload=str(preload), **switches)
    for name in ('compensator', 'contour_tracker', 'monitor'):
        assert parameters(nodes[name]) == {'calibration': str(tmp_path / 'calibration.json')}


@pytest.mark.parametrize(('respawn', 'status', 'ends'), [
    ('false', 1, True), ('false', 2, True), ('true', 1, False), ('true', -9, False), ('true', 2, True),
    ('true', 0, True),
])  # fmt: skip
def test_the_end_of_a_node(launched, respawn, status, ends):
    """It ends the nodes of its cell, once, unless the node is started again."""
    started = [item for item in launched.actions(respawn=respawn) if 'name' in item.given]
    nodes = {item.given['name']: item.given for item in started}
    node = nodes['collector']
    assert nodes['visualizer']['on_exit'] is None, 'the end of a display ends nothing else'
    assert node['respawn'] == (respawn == 'true') and node['respawn_delay'] > 0
    event = SimpleNamespace(returncode=status, process_name='collector-2')
    assert node['on_exit'](event, SimpleNamespace(is_shutdown=True)) is None
    actions = node['on_exit'](event, SimpleNamespace(is_shutdown=False))
    assert (actions is not None) == ends
    if ends:
        said, emitted = actions
        assert said.given['msg'] == f'collector-2 has ended with status {status}: its cell ends'
        matches = emitted.given['event'].given['process_matcher']
        assert all(map(matches, started))
        assert not any(map(matches, launched.actions()))  # another cell
        assert node['on_exit'](event, SimpleNamespace(is_shutdown=False)) is None


def test_two_cells_share_nothing(launched):
    file = runpy.run_path(str(LAUNCH / 'two_cells.launch.py'))
    (entities,) = file['generate_launch_description']().args
    groups = [item for item in entities if item.given.get('scoped')]
    cells = [dict(item.given['launch_arguments']) for group in groups for item in group.args[0]]
    assert [cell['namespace'] for cell in cells] == ['left', 'right']
    assert [cell['seed'] for cell in cells] == ['0', '1']
    assert [cell['enclaves'] for cell in cells] == ['/scara_kinetostatic/left', '/scara_kinetostatic/right']
    assert [cell['recordings'].args[0][-1] for cell in cells] == ['left', 'right']
    assert all(cell.keys() <= launched.defaults.keys() for cell in cells)


def test_the_runner_on_ros2_control(launched):
    """By messages or by goals; all that it is given are parameters of the node, of their types."""
    file = runpy.run_path(str(LAUNCH / 'ros2_control.launch.py'))
    (entities,) = file['generate_launch_description']().args
    arguments = {item.args[0]: item.given for item in entities if item.args}
    by_topic, by_action = (item.given for item in entities if 'executable' in item.given)
    assert type(by_topic['condition']).__name__ == 'UnlessCondition'
    assert type(by_action['condition']).__name__ == 'IfCondition'
    for node in (by_topic, by_action):
        assert (node['executable'], node['condition'].args[0].args) == ('touch_runner', ('use_action',))
        ((heard, (controller, topic)),) = node['remappings']
        assert (heard, controller.args, topic) == ('joint_trajectory', ('controller',), '/joint_trajectory')
        assert node['namespace'].args == ('namespace',)
    given = {name: value.given['value_type'] for name, value in parameters(by_action).items()}
    assert given.keys() - parameters(by_topic).keys() == {'action'}
    assert parameters(by_action)['action'].args[0][1] == '/follow_joint_trajectory'
    assert (given.pop('use_sim_time'), given.pop('cell')) == (bool, str)
    source = (LAUNCH.parent / 'scara_kinetostatic' / 'nodes' / 'parameters.yaml').read_text()
    declared = {name: stated['default'] for name, stated in yaml.safe_load(source)['touch_runner'].items()}
    assert given == {name: type(declared[name]) for name in given}
    for name in ('patience', 'max_touches'):
        assert arguments[name]['default_value'] == str(declared[name])
    assert arguments.keys() == {*parameters(by_topic), 'controller', 'use_action', 'namespace'}
    assert [name for name, item in arguments.items() if 'default_value' not in item] == ['cell']
