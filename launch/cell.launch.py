"""Starts a whole cell: simulated robot, collector, calibrator, visualizer and, on request, compensator, contour
tracker and monitor.

An argument that is not given leaves a parameter as the file `params` has it or, if it is not there, config/nodes.yaml
of the package or the node itself.

For a real robot set `simulate:=false`, which leaves out the first, and `cell:=/path/to/cell.yaml`: its joint angles and
forces make no sense with the example cell. Then calibrate by
`ros2 service call /calibrator/calibrate std_srvs/srv/Trigger`. A node that ends ends those of its cell, and so the
launch unless it has other cells; not so a display. With `respawn:=true` one that has crashed is started again.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, List  # noqa: UP035 - launch knows lists by this name only

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction
from launch.events.process import ShutdownProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.urdf import arm_urdf
from scara_kinetostatic.model.cell import PAPER_CELL, Cell

PACKAGE = 'scara_kinetostatic'
CONFIG = PathJoinSubstitution([FindPackageShare(PACKAGE), 'config'])
FINAL = (0, 2)
"""Exit statuses of a node that is not started again: it was told to end; a parameter or a file is not valid."""
RESPAWN_DELAY = 2.0
"""From the end of a node to its next start, s."""


def generate_launch_description() -> LaunchDescription:
    """The arguments, and the nodes that they ask for."""
    return LaunchDescription([*_arguments(), OpaqueFunction(function=lambda context: CellNodes(context).actions())])


def _arguments() -> list[DeclareLaunchArgument]:
    def argument(name: str, default: str, description: str, *choices: str) -> DeclareLaunchArgument:
        more = {'choices': [*choices] if default else ['', *choices]} if choices else {}
        return DeclareLaunchArgument(name, default_value=default, description=description, **more)

    switch = ('true', 'false')
    levels = ('debug', 'info', 'warn', 'error', 'fatal')
    return [
        argument('cell', '', 'cell description; empty: the example cell, for the simulator only'),
        argument('params', '', 'parameters of the nodes, a YAML file; it precedes config/nodes.yaml of the package'),
        argument('preload', '', 'calibration.yaml of an earlier result, for all nodes; empty: none'),
        argument('namespace', '', 'of all nodes, such as left; also begins the names of their frames'),
        argument('use_sim_time', '', 'take the time from /clock', *switch),
        argument('log_level', 'info', 'of the log of all nodes', *levels),
        argument('respawn', 'false', 'start a node again that has crashed; else the cell ends', *switch),
        argument('simulate', 'true', 'start the simulator', *switch),
        argument('record', 'true', 'start the collector', *switch),
        argument('calibrate', 'true', 'start the calibrator', *switch),
        argument('show', 'true', 'start the visualizer', *switch),
        argument('compensate', 'false', 'start the compensator', *switch),
        argument('track', 'false', 'start the contour tracker', *switch),
        argument('watch', 'false', 'start the monitor', *switch),
        argument('run', 'false', 'start the touch runner, which moves the robot at ~/start', *switch),
        argument('frames', 'true', 'start robot_state_publisher, where it is installed', *switch),
        argument('rviz', 'false', 'start RViz with the configuration of the package', *switch),
        argument('plan', '', 'simulator: plan of touches or slides'),
        argument('effects', '', 'simulator: effects of the robot, a YAML list'),
        argument('time_factor', '', 'simulator: simulated seconds per second'),
        argument('seed', '', 'simulator: seed of the noise'),
        argument('autostart', '', 'collector: record at once', *switch),
        argument('recordings', '', 'collector and touch runner: folder for the recordings'),
        argument('recording', '', 'calibrator: recording to calibrate from; empty: what the collector announces'),
        argument('output', '', 'calibrator: folder for the results; empty: beside the recording'),
        argument(
            'calibration', '', 'of the others: calibration.json; empty: the one beside preload, else wait for one'
        ),
        argument('enclaves', '/scara_kinetostatic', 'SROS 2: the enclave of each node is <this>/<its name>'),
    ]


class CellNodes:
    """The nodes of one cell, by the arguments in a context."""

    def __init__(self, context: LaunchContext) -> None:
        self._context = context
        self._respawn = self._on('respawn')
        self._started: list[Node] = []
        self._ending = False

    def actions(self) -> list[Any]:
        """What to start.

        Raises:
            RuntimeError: the arguments contradict each other; the launch ends with this line.
        """
        self._check()
        actions: list[Any] = list(self._nodes())
        if not self._on('show'):
            return actions
        if not (self._on('simulate') or self._text('cell')):
            return [*actions, LogInfo(msg='no cell given: the visualizer is not started')]
        actions.append(self._node('visualizer', self._framed, on_exit=None))
        if self._cell.plane.tip:
            actions.append(LogInfo(msg='the robot of robot.plane has frames of its own: none are published'))
        elif self._on('frames') and _is_installed('robot_state_publisher'):
            actions.append(self._robot_state_publisher())
        elif self._on('frames'):
            actions.append(LogInfo(msg='robot_state_publisher is not installed: markers are shown, frames are not'))
        return [*actions, *self._rviz()]

    def _check(self) -> None:
        if not (self._on('simulate') or self._text('cell')) and self._on('record'):
            raise RuntimeError('simulate:=false needs the cell description of the robot: cell:=/path/to/cell.yaml')
        if self._on('run') and not self._text('cell'):
            raise RuntimeError('run:=true needs the cell description, with the limits of the joints: cell:=/path')
        parts = ('simulate', 'record', 'calibrate', 'show', 'compensate', 'track', 'watch', 'run')
        if not any(map(self._on, parts)):
            raise RuntimeError(f'nothing to start: {", ".join(parts[:-1])} and {parts[-1]} are all false')
        self._cell = _cell_description(self._text('cell'))
        if self._on('rviz') and not _is_installed('rviz2'):
            raise RuntimeError('rviz:=true, but rviz2 is not installed: apt install ros-jazzy-rviz2')

    def _nodes(self) -> Iterable[Node]:
        if self._on('simulate'):
            given = self._given(plan=str, effects=List[str], time_factor=float, seed=int)  # noqa: UP006
            commanded = {'commanded': True} if self._on('run') else {}
            yield self._node('contact_simulator', given | commanded | self._framed)
        if self._on('record'):
            places = self._given(recordings=str).values()
            yield self._node('collector', self._given(autostart=bool) | dict(zip(['output'], places, strict=False)))
        if self._on('calibrate'):
            named = self._given(output=str, recording=str)
            yield self._node('calibrator', named, *filter(None, [self._text('preload')]))
        calibration = self._calibration()
        for switch, name in (('compensate', 'compensator'), ('track', 'contour_tracker')):
            if self._on(switch):
                yield self._node(name, calibration | self._framed)
        if self._on('watch'):
            yield self._node('monitor', calibration)
        if self._on('run'):
            places = self._given(recordings=str).values()
            output = dict(zip(['output'], places, strict=False))
            yield self._node('touch_runner', calibration | output | self._framed)

    def _calibration(self) -> dict[str, Any]:
        """For the nodes that use one: the file given, else the one that was written with the preloaded parameters.

        Raises:
            RuntimeError: there is none beside them.
        """
        if self._text('calibration') or not self._text('preload'):
            return self._given(calibration=str)
        beside = Path(self._text('preload')).with_name('calibration.json')
        if not beside.is_file() and any(map(self._on, ('compensate', 'track', 'watch'))):
            raise RuntimeError(f'{beside}: there is no such file beside the one of preload; give calibration:=')
        return {'calibration': str(beside)}

    def _node(self, name: str, values: dict[str, Any], *files: str, **more: Any) -> Node:
        given = self._given(cell=str, use_sim_time=bool) | values
        enclave = ['--enclave', f'{self._text("enclaves")}/{name}']
        return self._any_node(
            PACKAGE,
            name,
            parameters=[
                PathJoinSubstitution([CONFIG, 'nodes.yaml']),
                *filter(None, [self._text('params')]),
                *files,
                *filter(None, [given]),
            ],
            ros_arguments=['--log-level', self._text('log_level'), *enclave],
            respawn=self._respawn,
            respawn_delay=RESPAWN_DELAY,
            **{'on_exit': self._note_end, **more},
        )

    def _robot_state_publisher(self) -> Node:
        """Publishes the frames of the nominal arm."""
        cell = self._cell
        urdf = arm_urdf('scara', cell, cell.nominal)
        values = {'robot_description': ParameterValue(urdf, value_type=str), 'frame_prefix': self._prefix}
        name = 'robot_state_publisher'
        return self._any_node(
            name,
            name,
            parameters=[values | {'use_sim_time': self._on('use_sim_time')}],
            remappings=[
                ('joint_states', cell.sensor.joint_states),
                ('robot_description', 'robot_state_publisher/robot_description'),  # the visualizer publishes it
            ],
        )

    def _rviz(self) -> Iterable[Node]:
        if self._on('rviz'):
            frame = self._prefix + self._cell.plane.frame
            configuration = ['-d', PathJoinSubstitution([CONFIG, 'cell.rviz']), '-f', frame]
            yield self._any_node(
                'rviz2', 'rviz2', arguments=configuration, parameters=[{'use_sim_time': self._on('use_sim_time')}]
            )

    def _any_node(self, package: str, name: str, **more: Any) -> Node:
        namespace = self._text('namespace')
        node = Node(package=package, executable=name, name=name, namespace=namespace, output='screen', **more)
        self._started.append(node)
        return node

    def _note_end(self, event: Any, context: LaunchContext) -> list[Any] | None:
        """Ends all nodes of this cell when one has ended that is not started again; other cells go on."""
        if context.is_shutdown or self._ending or (self._respawn and event.returncode not in FINAL):
            return None
        self._ending = True
        said = f'{event.process_name} has ended with status {event.returncode}: its cell ends'
        of_this_cell = ShutdownProcess(process_matcher=lambda action: action in self._started)
        return [LogInfo(msg=said), EmitEvent(event=of_this_cell)]

    @property
    def _framed(self) -> dict[str, str]:
        return {'frame_prefix': self._prefix} if self._prefix else {}

    @property
    def _prefix(self) -> str:
        """Of the names of frames."""
        namespace = self._text('namespace').strip('/')
        return f'{namespace}/' if namespace else ''

    def _text(self, name: str) -> str:
        return str(LaunchConfiguration(name).perform(self._context)).strip()

    def _on(self, name: str) -> bool:
        return self._text(name) == 'true'

    def _given(self, **kinds: Any) -> dict[str, ParameterValue]:
        """Those of the arguments that are given, as parameters of these types."""
        return {
            name: ParameterValue(LaunchConfiguration(name), value_type=kind)
            for name, kind in kinds.items()
            if self._text(name)
        }


def _cell_description(path: str) -> Cell:
    """The cell description, the example where there is none.

    Raises:
        RuntimeError: it cannot be read, or is not valid; said before a node starts.
    """
    try:
        return load_cell(path) if path else PAPER_CELL
    except ScaraKinetostaticError as error:
        raise RuntimeError(str(error)) from error


def _is_installed(package: str) -> bool:
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True
