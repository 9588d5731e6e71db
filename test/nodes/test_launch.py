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
    *('launch', 'launch.actions', 'launch.events.process', 'launch.substitutions'),
    *('launch_ros.actions', 'launch_ros.parameter_descriptions', 'launch_ros.substitutions'),
    'ament_index_python.packages',
)
CELL = str(LAUNCH.parent / 'config' / 'cell.yaml')
ALL = ['contact_simulator', 'collector', 'calibrator', 'visualizer']


class StandIn:
    """Keeps what it was made with."""

    def __init__(self, *args: Any, **given: Any) -> None:
        self.args, self.given = args, given


class Module(ModuleType):
    """Has every class that is imported from it."""

    def __getattr__(self, name: str) -> type:
        vars(self)[name] = made = type(name, (StandIn,), {})
        return made


class Launched:
    """A launch file, and what is installed beside it."""

    def __init__(self, installed: set[str], name: str = 'cell') -> None:
        self.installed = installed
        file = runpy.run_path(str(LAUNCH / f'{name}.launch.py'))
        (entities,) = file['generate_launch_description']().args
        *arguments, self.start = entities
        self.arguments = {item.args[0]: item.given for item in arguments}

    def actions(self, **arguments: str) -> list[Any]:
        defaults = {name: given['default_value'] for name, given in self.arguments.items() if 'default_value' in given}
        context = SimpleNamespace(launch_configurations=defaults | arguments)
        return list(self.start.given['function'](context))

    def nodes(self, **arguments: str) -> dict[str, dict[str, Any]]:
        """What each node is started with, by its name, with its namespace where there are several."""
        started = [item.given for item in self.actions(**arguments) if 'name' in item.given]
        names = [given['name'] for given in started]
        if len({*names}) < len(names):
            names = [f'{given["namespace"]}/{given["name"]}' for given in started]
        return dict(zip(names, started, strict=True))

    def says(self, **arguments: str) -> list[str]:
        return [item.given['msg'] for item in self.actions(**arguments) if 'msg' in item.given]


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
    return Launched(installed)


def parameters(node: dict[str, Any]) -> dict[str, Any]:
    return {name: text_of(value) for name, value in node['parameters'][-1].items()}


def text_of(value: Any) -> Any:
    """What a parameter is given."""
    (given,) = value.args if isinstance(value, StandIn) else [value]
    return given.given['text'] if isinstance(given, StandIn) else given


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
    ({'params': CELL}, '^params:=.*/cell.yaml: has no section of a node; write NODE'),
    ({'simulate': 'false', 'namespace': 'left'}, '^left: simulate:=false needs the cell description'),
    ({'params': '/no/file.yaml'}, '^params:=/no/file.yaml: there is no such file; check the path$'),
    ({'preload': '/no/file.yaml'}, '^preload:=/no/file.yaml: there is no such file; check the path$'),
    ({'run': 'true', 'cell': CELL, 'use_action': 'true'}, 'use_action:=true needs the name of the controller'),
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
    assert launched.says() == ['robot_state_publisher is not installed: markers are shown, frames are not']
    launched.installed.add('robot_state_publisher')
    node = launched.nodes()['robot_state_publisher']
    urdf = parameters(node)['robot_description']
    assert '<link name="tool0">' in urdf and 'calibrated_' not in urdf
    assert ('joint_states', 'joint_states') in node['remappings']
    assert 'robot_state_publisher' not in launched.nodes(frames='false')


@pytest.mark.parametrize(('simulate', 'frames', 'published'), [
    ('true', '', True), ('true', 'false', False), ('false', '', False), ('false', 'true', True),
])  # fmt: skip
def test_beside_a_driver_its_description_and_frames_are_its_own(launched, simulate, frames, published):
    launched.installed.add('robot_state_publisher')
    nodes = launched.nodes(simulate=simulate, frames=frames, cell=CELL)
    assert ('robot_state_publisher' in nodes) == published
    assert parameters(nodes['visualizer']).get('publish_urdf', False) == published
    source = (LAUNCH.parent / 'scara_kinetostatic' / 'nodes' / 'parameters.yaml').read_text()
    assert yaml.safe_load(source)['visualizer']['publish_urdf']['default'] is False


def test_time_log_level_and_an_earlier_result(launched, tmp_path):
    preload = tmp_path / 'calibration.yaml'
    preload.touch()
    nodes = launched.nodes(use_sim_time='true', log_level='debug', preload=str(preload), output='out')
    for name, node in nodes.items():
        assert parameters(node)['use_sim_time'] == 'true'
        assert node['ros_arguments'] == ['--log-level', 'debug', '--enclave', f'/scara_kinetostatic/{name}']
    assert nodes['calibrator']['parameters'][1] == str(preload)
    assert len(nodes['collector']['parameters']) == 2
    assert 'output' in parameters(nodes['calibrator']) and 'recording' not in parameters(nodes['calibrator'])


def test_arguments_that_are_not_given_leave_the_parameter_file(launched, tmp_path):
    switches = {'compensate': 'true', 'track': 'true', 'watch': 'true'}
    own = tmp_path / 'own.yaml'
    own.write_text('/**: {ros__parameters: {period: 1.0}}')
    for name, node in launched.nodes(params=str(own), **switches).items():
        assert str(own) in node['parameters'][1:], name
        assert {*node['parameters'][-1]} <= {'publish_urdf'} or node['parameters'][-1] == str(own), name
    given = launched.nodes(params=str(own), autostart='false', seed='3', recordings='bags', respawn='true')
    assert parameters(given['collector']) == {'autostart': 'false', 'output': 'bags'}
    assert parameters(given['contact_simulator']) == {'seed': '3'}


def test_what_is_given_in_vain_is_said(launched, tmp_path):
    """A section goes to the nodes whose name it has; one that is none of theirs, or a misspelt argument, is said."""
    own = tmp_path / 'own.yaml'
    own.write_text('collector: {ros__parameters: {output: a}}\n/left/calibrator: {ros__parameters: {output: b}}')
    nodes = launched.nodes(params=str(own))
    assert [name for name, node in nodes.items() if str(own) in node['parameters']] == ['collector']
    there = ' '.join(f'/{name}' for name in ALL)
    assert launched.says(params=str(own), autostrat='false')[:2] == [
        'WARNING: autostrat: no such argument; did you mean autostart?',
        f'WARNING: {own}: nothing started has the name /left/calibrator; there is {there}',
    ]
    assert str(own) in launched.nodes(params=str(own), namespace='left')['calibrator']['parameters']


def test_an_earlier_result_is_that_of_all_nodes(launched, tmp_path):
    switches = {'compensate': 'true', 'track': 'true', 'watch': 'true'}
    preload = tmp_path / 'calibration.yaml'
    preload.touch()
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


def test_two_cells_share_nothing(launched, tmp_path):
    two = Launched(launched.installed, 'two_cells')
    nodes = two.nodes(output='res', compensate='true', left_calibration='l.json', right_calibration='r.json')
    for k, (name, other) in enumerate((('left', 'right'), ('right', 'left'))):
        own = {node.removeprefix(f'{name}/'): given for node, given in nodes.items() if not node.startswith(other)}
        assert [*own] == [*ALL[:3], 'compensator', ALL[3]]
        assert parameters(own['collector'])['output'] == f'recordings/{name}'
        assert parameters(own['calibrator'])['output'] == f'res/{name}'
        assert parameters(own['compensator'])['calibration'] == f'{name[0]}.json'
        assert parameters(own['contact_simulator'])['seed'] == str(k)
        assert own['collector']['ros_arguments'][-1] == f'/scara_kinetostatic/{name}/collector'


@pytest.mark.parametrize(('argument', 'problem'), [
    ('calibration', 'calibration belongs to one cell: give left_calibration:=… and right_calibration:=…'),
    ('cell', 'cell belongs to one cell: give left_cell'), ('namespace', 'the cells are in left and right'),
])  # fmt: skip
def test_what_belongs_to_one_cell_is_not_given_to_both(launched, argument, problem):
    with pytest.raises(RuntimeError, match=problem):
        Launched(launched.installed, 'two_cells').actions(**{argument: 'x'})


def test_every_launch_file_has_the_same_arguments(launched):
    """Of one meaning, one default and one set of choices, but for what each launch file is for."""
    control, two = (Launched(launched.installed, name).arguments for name in ('ros2_control', 'two_cells'))
    own = {name for name in two if name.startswith(('left_', 'right_'))}
    assert control.keys() == launched.arguments.keys()
    assert {name.partition('_')[2] for name in own} | two.keys() - own | {'namespace'} == control.keys()
    differing = {name for name, given in control.items() if given != launched.arguments[name]}
    assert differing == {'cell', 'simulate', 'record', 'calibrate', 'show', 'run', 'controller'}
    assert [name for name, given in control.items() if 'default_value' not in given] == ['cell']
    assert {name for name in two.keys() - own if two[name] != launched.arguments[name]} == {'recordings'}


def test_the_runner_on_ros2_control(launched):
    """By messages or by goals; all that it is given are parameters of the node, of their types."""
    control = Launched(launched.installed, 'ros2_control')
    given = {'cell': CELL, 'output': 'out', 'patience': '20.0', 'max_touches': '30', 'calibration': 'c.json'}
    (by_topic,) = control.nodes(**given).values()
    assert by_topic['executable'] == 'touch_runner'
    assert by_topic['remappings'] == [('joint_trajectory', '/joint_trajectory_controller/joint_trajectory')]
    assert parameters(by_topic) == given
    assert parameters(control.nodes(cell=CELL, recordings='bags')['touch_runner'])['output'] == 'bags'
    source = (LAUNCH.parent / 'scara_kinetostatic' / 'nodes' / 'parameters.yaml').read_text()
    declared = {name: stated['default'] for name, stated in yaml.safe_load(source)['touch_runner'].items()}
    for name, value in by_topic['parameters'][-1].items():
        assert value.given['value_type'] is type(declared[name])
    (by_action,) = control.nodes(use_action='true', controller='/arm', **given).values()
    assert parameters(by_action) == given | {'action': '/arm/follow_joint_trajectory'}
