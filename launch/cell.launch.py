"""Starts a whole cell: simulated robot, collector, calibrator, visualizer and, on request, compensator, contour
tracker, monitor and touch runner. `ARGUMENTS` and `CellNodes` serve the other launch files as well.

An argument that is not given leaves a parameter as the file `params` has it or, if it is not there, config/nodes.yaml
of the package or the node itself.

For a real robot set `simulate:=false`, which leaves out the first and the robot's description and frames, which its
driver publishes, and `cell:=/path/to/cell.yaml`: its joint angles and forces make no sense with the example cell. Then
calibrate by `ros2 service call /calibrator/calibrate std_srvs/srv/Trigger`. A node that ends ends those of its cell,
and so the launch unless it has other cells; not so a display. With `respawn:=true` one that has crashed is started
again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, List  # noqa: UP035 - launch knows lists by this name only

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction
from launch.events.process import ShutdownProcess
from launch.substitutions import PathJoinSubstitution, TextSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.urdf import arm_urdf
from scara_kinetostatic.files.yaml_file import node_sections
from scara_kinetostatic.model.cell import PAPER_CELL, Cell

PACKAGE = 'scara_kinetostatic'
CONFIG = PathJoinSubstitution([FindPackageShare(PACKAGE), 'config'])
FINAL = (0, 2)
"""Exit statuses of a node that is not started again: it was told to end; a parameter or a file is not valid."""
RESPAWN_DELAY = 2.0
"""From the end of a node to its next start, s."""


SWITCH = 'true', 'false'
ARGUMENTS: dict[str, tuple[str, str, Sequence[str]]] = {
    'cell': ('', 'cell description; empty: the example cell, for the simulator only', ()),
    'params': ('', 'parameters of the nodes, a YAML file; it precedes config/nodes.yaml of the package', ()),
    'preload': ('', 'calibration.yaml of an earlier result, for all nodes; empty: none', ()),
    'namespace': ('', 'of all nodes, such as left; also begins the names of their frames', ()),
    'use_sim_time': ('', 'take the time from /clock', SWITCH),
    'log_level': ('info', 'of the log of all nodes', ('debug', 'info', 'warn', 'error', 'fatal')),
    'respawn': ('false', 'start a node again that has crashed; else the cell ends', SWITCH),
    'simulate': ('true', 'start the simulator', SWITCH),
    'record': ('true', 'start the collector', SWITCH),
    'calibrate': ('true', 'start the calibrator', SWITCH),
    'show': ('true', 'start the visualizer', SWITCH),
    'compensate': ('false', 'start the compensator', SWITCH),
    'track': ('false', 'start the contour tracker', SWITCH),
    'watch': ('false', 'start the monitor', SWITCH),
    'run': ('false', 'start the touch runner, which moves the robot at ~/start', SWITCH),
    'frames': ('', 'publish description and frames of the nominal arm; empty: with the simulator alone', SWITCH),
    'rviz': ('false', 'start RViz with the configuration of the package', SWITCH),
    'plan': ('', 'simulator: plan of touches or slides', ()),
    'effects': ('', 'simulator: effects of the robot, a YAML list', ()),
    'time_factor': ('', 'simulator: simulated seconds per second', ()),
    'seed': ('', 'simulator: seed of the noise', ()),
    'autostart': ('', 'collector: record at once', SWITCH),
    'recordings': ('', 'collector and touch runner: folder for the recordings', ()),
    'recording': ('', 'calibrator: recording to calibrate from; empty: what the collector announces', ()),
    'output': ('', 'folder for the results; empty: beside the recording', ()),
    'calibration': ('', 'of the others: calibration.json; empty: the one beside preload, else wait for one', ()),
    'controller': ('', 'touch runner: the joint_trajectory_controller; empty: the topic joint_trajectory', ()),
    'use_action': ('false', 'touch runner: send the controller goals, as few as safety needs', SWITCH),
    'patience': ('', 'touch runner: how long a touch waits for what may pass by itself, s', ()),
    'max_touches': ('', 'touch runner: accepted touches after which the run ends', ()),
    'enclaves': ('/scara_kinetostatic', 'SROS 2: the enclave of each node is <this>/<its name>', ()),
}
"""Default, meaning and choices of each; without a default in what a launch file demands."""


def generate_launch_description() -> LaunchDescription:
    """The arguments, and the nodes that they ask for."""
    return cell_description()


def cell_description(**defaults: str | None) -> LaunchDescription:
    """One cell.

    Args:
        defaults: of arguments where they are not those of `ARGUMENTS`; None: it has to be given.
    """

    def start(context: LaunchContext) -> list[Any]:
        return actions_of(context, CellNodes(values_in(context)))

    return LaunchDescription([*declared(ARGUMENTS, **defaults), OpaqueFunction(function=start)])


def declared(names: Iterable[str], prefix: str = '', **defaults: str | None) -> list[DeclareLaunchArgument]:
    """Arguments, with a prefix to their names; `defaults` as in `cell_description`."""
    made = []
    for name in names:
        stated, meaning, choices = ARGUMENTS[name]
        default = defaults.get(name, stated)
        more = {} if default is None else {'default_value': default}
        if choices:
            more['choices'] = [*choices] if default else ['', *choices]
        made.append(DeclareLaunchArgument(prefix + name, description=meaning, **more))
    return made


def values_in(context: LaunchContext) -> dict[str, str]:
    """The values of the arguments."""
    given = context.launch_configurations
    return {name: given.get(name, stated[0]).strip() for name, stated in ARGUMENTS.items()}


def actions_of(context: LaunchContext, *cells: CellNodes, names: Iterable[str] = ARGUMENTS) -> list[Any]:
    """What to start, and what is given in vain; `names` are those of the arguments."""
    actions = []
    for cell in cells:
        try:
            actions += cell.actions()
        except RuntimeError as error:
            raise RuntimeError(f'{cell.name}: {error}' if cell.name else str(error)) from error
    found = {name: get_close_matches(name, names, 1) for name in {*context.launch_configurations} - {*names}}
    vain = [f'{name}: no such argument; did you mean {close[0]}?' for name, close in found.items() if close]
    nodes = [name for cell in cells for name in cell.nodes]
    for file in filter(None, {cell.params for cell in cells}):
        lost = [each for each, pattern in node_sections(file).items() if not any(map(pattern.match, nodes))]
        vain += [f'{file}: nothing started has the name {each}; there is {" ".join(nodes)}' for each in lost]
    return [*(LogInfo(msg=f'WARNING: {said}') for said in vain), *actions]


class CellNodes:
    """The nodes of one cell, by the values of the arguments.

    Attributes:
        name: the namespace, without slashes; may be empty.
        params: the parameter file; empty for none.
        nodes: full names of the nodes of this package that are started.
    """

    def __init__(self, values: Mapping[str, str]) -> None:
        self._values, self.params, self.name = values, values['params'], values['namespace'].strip('/')
        self.nodes: list[str] = []
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
        has_frames = self._text('frames') != 'false' and (self._on('simulate') or self._on('frames'))
        urdf = {'publish_urdf': True} if has_frames else {}
        actions.append(self._node('visualizer', urdf | self._framed, on_exit=None))
        if has_frames and self._cell.plane.tip:
            actions.append(LogInfo(msg='the robot of robot.plane has frames of its own: none are published'))
        elif has_frames and _is_installed('robot_state_publisher'):
            actions.append(self._robot_state_publisher())
        elif has_frames:
            actions.append(LogInfo(msg='robot_state_publisher is not installed: markers are shown, frames are not'))
        return [*actions, *self._rviz()]

    def _check(self) -> None:
        if not (self._on('simulate') or self._text('cell')) and self._on('record'):
            raise RuntimeError('simulate:=false needs the cell description of the robot: cell:=/path/to/cell.yaml')
        if self._on('run') and not self._text('cell'):
            raise RuntimeError('run:=true needs the cell description, with the limits of the joints: cell:=/path')
        if self._on('use_action') and not self._text('controller'):
            raise RuntimeError(
                'use_action:=true needs the name of the controller: controller:=/joint_trajectory_controller'
            )
        parts = ('simulate', 'record', 'calibrate', 'show', 'compensate', 'track', 'watch', 'run')
        if not any(map(self._on, parts)):
            raise RuntimeError(f'nothing to start: {", ".join(parts[:-1])} and {parts[-1]} are all false')
        for name in ('params', 'preload'):
            if self._text(name) and not Path(self._text(name)).is_file():
                raise RuntimeError(f'{name}:={self._text(name)}: there is no such file; check the path')
        if self.params and not node_sections(self.params):
            raise RuntimeError(f'params:={self.params}: has no section of a node; write NODE: {{ros__parameters: …}}')
        self._cell = _cell_description(self._text('cell'))
        if self._on('rviz') and not _is_installed('rviz2'):
            raise RuntimeError('rviz:=true, but rviz2 is not installed: apt install ros-jazzy-rviz2')

    def _nodes(self) -> Iterable[Node]:
        if self._on('simulate'):
            given = self._given(plan=str, effects=List[str], time_factor=float, seed=int)  # noqa: UP006
            commanded = {'commanded': True} if self._on('run') else {}
            yield self._node('contact_simulator', given | commanded | self._framed)
        if self._on('record'):
            yield self._node('collector', self._given(autostart=bool) | self._folder('recordings'))
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
            places = {**self._given(output=str), **self._folder('recordings')}
            given = places | self._given(patience=float, max_touches=int)
            if self._on('use_action'):
                given['action'] = f'{self._text("controller")}/follow_joint_trajectory'
            yield self._node('touch_runner', calibration | given | self._framed)

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
        self.nodes.append(f'/{self._prefix}{name}')
        sections = node_sections(self.params) if self.params else {}
        params = [self.params] if any(pattern.match(self.nodes[-1]) for pattern in sections.values()) else []
        enclave = ['--enclave', f'{self._text("enclaves")}/{name}']
        return self._any_node(
            PACKAGE,
            name,
            parameters=[PathJoinSubstitution([CONFIG, 'nodes.yaml']), *params, *files, *filter(None, [given])],
            ros_arguments=['--log-level', self._text('log_level'), *enclave],
            remappings=self._moved,
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
    def _moved(self) -> list[tuple[str, str]]:
        """Where trajectories go to."""
        controller = self._text('controller')
        return [('joint_trajectory', f'{controller}/joint_trajectory')] if controller else []

    @property
    def _framed(self) -> dict[str, str]:
        return {'frame_prefix': self._prefix} if self._prefix else {}

    @property
    def _prefix(self) -> str:
        """Of the names of frames."""
        return f'{self.name}/' if self.name else ''

    def _text(self, name: str) -> str:
        return self._values[name]

    def _on(self, name: str) -> bool:
        return self._text(name) == 'true'

    def _folder(self, name: str) -> dict[str, ParameterValue]:
        """An argument as the parameter `output`, where it is given."""
        return dict.fromkeys(['output'], *self._given(**{name: str}).values()) if self._text(name) else {}

    def _given(self, **kinds: Any) -> dict[str, ParameterValue]:
        """Those of the arguments that are given, as parameters of these types."""
        return {
            name: ParameterValue(TextSubstitution(text=self._text(name)), value_type=kind)
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
