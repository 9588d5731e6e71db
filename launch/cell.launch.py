"""Starts a whole cell: simulated robot, collector, calibrator.

For a real robot set `simulate:=false`, which leaves out the first, and `cell:=/path/to/cell.yaml`: its joint angles and
forces make no sense with the example cell. Then calibrate by
`ros2 service call /calibrator/calibrate std_srvs/srv/Trigger`.
"""

from __future__ import annotations

from typing import List  # noqa: UP035 - launch knows lists by this name only

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'scara_kinetostatic'
SHARE = FindPackageShare(PACKAGE)


def generate_launch_description() -> LaunchDescription:
    """The arguments and the three nodes."""
    return LaunchDescription([*_arguments(), OpaqueFunction(function=_check_cell), *_nodes()])


def _check_cell(context: LaunchContext) -> None:
    """Check that a real robot has a cell description.

    Raises:
        RuntimeError: it has none; the launch ends with this line.
    """
    simulate, cell = (LaunchConfiguration(name).perform(context) for name in ('simulate', 'cell'))
    if simulate == 'false' and not cell.strip():
        raise RuntimeError('simulate:=false needs the cell description of the robot: cell:=/path/to/cell.yaml')


def _arguments() -> list[DeclareLaunchArgument]:
    def argument(name: str, default: object, description: str, **more: object) -> DeclareLaunchArgument:
        return DeclareLaunchArgument(name, default_value=default, description=description, **more)

    switch = {'choices': ['true', 'false']}
    return [
        argument('cell', '', 'cell description; empty: the example cell, for the simulator only'),
        argument('params', PathJoinSubstitution([SHARE, 'config', 'nodes.yaml']), 'parameters of the nodes'),
        argument('simulate', 'true', 'start the simulator, too', **switch),
        argument('plan', '', 'simulator: plan of touches; empty: the default plan over all discs'),
        argument('effects', "['']", 'simulator: effects of the robot, a YAML list'),
        argument('time_factor', '1.0', 'simulator: simulated seconds per second'),
        argument('seed', '0', 'simulator: seed of the noise'),
        argument('autostart', 'true', 'collector: record at once', **switch),
        argument('recordings', 'recordings', 'collector: folder for the recordings'),
        argument('output', '', 'calibrator: folder for the results; empty: beside the recording'),
        argument('enclaves', '/scara_kinetostatic', 'SROS 2: the enclave of each node is <this>/<its name>'),
    ]


def _nodes() -> list[Node]:
    def node(name: str, values: dict[str, object], **more: object) -> Node:
        parameters = [LaunchConfiguration('params'), {'cell': _value('cell', str), **values}]
        more['ros_arguments'] = ['--enclave', [LaunchConfiguration('enclaves'), f'/{name}']]
        return Node(package=PACKAGE, executable=name, name=name, output='screen', parameters=parameters, **more)

    simulator = {
        'plan': _value('plan', str),
        'effects': _value('effects', List[str]),  # noqa: UP006
        'time_factor': _value('time_factor', float),
        'seed': _value('seed', int),
    }
    collector = {'autostart': _value('autostart', bool), 'output': _value('recordings', str)}
    return [
        node('contact_simulator', simulator, condition=IfCondition(LaunchConfiguration('simulate'))),
        node('collector', collector),
        node('calibrator', {'output': _value('output', str)}),
    ]


def _value(argument: str, kind: object) -> ParameterValue:
    """The argument as a parameter of that type."""
    return ParameterValue(LaunchConfiguration(argument), value_type=kind)
