"""What the nodes of a cell share: parameters, services of one sentence, the status on `/diagnostics`, a calibration.

The status is published once a second. Its name begins with the full name of the node, `/left/collector: recording`: two
cells in two namespaces do not collide, and `rqt_robot_monitor` groups by namespace. Its `hardware_id` is the cell: the
namespace, `scara_kinetostatic` without one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import sleep
from typing import Any, Generic, NamedTuple, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.timer import Timer
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import InputError, ParameterError, ScaraKinetostaticError, one_line
from scara_kinetostatic.files.calibration_file import load_calibration, parse_document, read_arm
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.yaml_file import parse_yaml, read_text
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Plane
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_identification
from scara_kinetostatic.nodes.conversion import diagnostic, force_text
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, QUEUE
from scara_kinetostatic.report.page import Document

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
CALLS = QoSProfile(depth=LATCHED_TOUCHES.depth)
"""Of services: so many calls at once wait for their answer; with the default of 10 the others are lost unanswered."""
LASTING: dict[str, Any] = {'throttle_duration_sec': 30.0}
"""How often the log has what is examined once a second."""
_FILE = Path(__file__).with_name('parameters.yaml')
PARAMETERS: dict[str, dict[str, dict[str, Any]]] = parse_yaml(read_text(_FILE, ParameterError), _FILE, ParameterError)
"""Of each node, by name: what that file states."""


class Condition(NamedTuple):
    """The status of a node.

    Attributes:
        level: `OK`, `WARN` or `ERROR`.
        message: one line.
        values: details by name.
    """

    level: bytes
    message: str
    values: dict[str, str]


class RefusedError(ScaraKinetostaticError):
    """A service cannot do what it is asked for now; the text says why."""


class CellNode(Node):
    """A node that declares its parameters, those of `parameters.yaml`, and says how it is.

    Attributes:
        rest: between two callbacks, s. A round of the executor costs several times as much as a message; a node that
            takes all waiting messages of a topic at once needs less time if several are waiting.
        stated: what `parameters.yaml` says of each of its parameters, by name.
        exit_status: set by a node that has done what it had to, and ends; also by `close`.
    """

    rest = 0.0
    exit_status: int | None = None

    def __init__(self, name: str = '') -> None:
        super().__init__(name)
        self.stated = PARAMETERS[name]
        for each, stated in self.stated.items():
            if 'default' in stated:
                self.declare(each, stated['default'])
        self.add_on_set_parameters_callback(self._refuse_parameters)
        self._last_time = 0
        self.every(5.0, self._look_at_clock)

    def declare(self, name: str, default: Any) -> Any:
        """Declares a parameter of the type of its default, and gives its value.

        Args:
            name: of the parameter, stated in `parameters.yaml`.
            default: text, switch, number with a decimal point, whole number or list of texts.

        Raises:
            ParameterError: the node was started with a value that is not valid.
        """
        stated = self.stated[name]
        is_fixed, range = not stated.get('changes'), stated.get('range')
        descriptor = ParameterDescriptor(description=stated['meaning'], read_only=is_fixed)
        if range and isinstance(default, float):
            low, high = map(float, range)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif range:
            low, high = map(int, range)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        given = [''] if default == [] else default  # an empty list has no type in ROS
        try:
            self.declare_parameter(name, given, descriptor)
        except ParameterException as error:
            raise ParameterError(f'parameter {name}', str(error)) from error
        self._check(name, self.value(name))
        return self.value(name)

    def _check(self, name: str, value: Any) -> None:
        """Check the value of a parameter.

        Raises:
            ParameterError: it is none of the choices.
        """
        choices = self.stated.get(name, {}).get('choices')
        if choices and value not in choices:
            expected = ', '.join(filter(None, choices))
            raise ParameterError(f'parameter {name}', f'expected {expected}, got {value!r}')

    def _refuse_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuses values that make no sense."""
        try:
            for each in parameters:
                self._check(each.name, each.value)
        except ScaraKinetostaticError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def value(self, name: str) -> Any:
        """The value of a parameter now; of a list, the texts that are not empty."""
        value = self.get_parameter(name).value
        return list(filter(str.strip, value)) if isinstance(value, (list, tuple)) else value

    @staticmethod
    def place(name: str, path: str) -> Path:
        """The file or folder that a parameter names; `~` is the home of the user.

        Raises:
            ParameterError: the home of an unknown user, say.
        """
        if not path.isprintable():
            raise ParameterError(f'parameter {name}', f'{path!r} holds control characters', 'give a plain path')
        try:
            return Path(path).expanduser()
        except RuntimeError as error:
            raise ParameterError(f'parameter {name}', f'{path!r}: {error}', 'write the path out') from error

    def cell_or_example(self, example: Cell = PAPER_CELL) -> Cell:
        """The cell in the file that the parameter `cell` names; the example cell if it is empty.

        Raises:
            CellError: the file cannot be read, or its content is not valid.
        """
        if path := self.value('cell'):
            return load_cell(self.place('cell', path))
        self.get_logger().warning('no cell given, taking the example cell of figure 3; set the parameter cell')
        return example

    def plane_of(self, cell: Cell) -> Plane:
        """The plane of the arm, with the parameter `frame_prefix` before the name of its frame."""
        return cell.plane._replace(frame=self.value('frame_prefix') + cell.plane.frame)

    def spin(self, executor: Executor) -> None:
        """One round of the executor; 0.2 s are the longest time from a signal to its effect."""
        executor.spin_once(timeout_sec=0.2)
        sleep(self.rest)

    def close(self) -> None:
        """Closes files and ends processes; called once, after the last callback has begun."""

    def every(self, period: float, do: Callable[[], None]) -> Timer:
        """Does something every `period` seconds of wall time, whatever simulated time does."""
        return self.create_timer(period, do, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def serve(self, name: str, do: Callable[[], str | None], done: str = '') -> None:
        """Answers a Trigger service.

        Args:
            name: of the service; without a slash it is below that of the node.
            do: returns the answer; an error of this package or of the file system says why there is no success.
                Both are logged.
            done: the answer where it returns none.
        """

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.success, response.message = True, do() or done
                self.get_logger().info(response.message)
            except (ScaraKinetostaticError, OSError) as error:
                response.success, response.message = False, one_line(str(error))
                self.get_logger().warning(response.message)
            return response

        self.create_service(Trigger, name if '/' in name else f'~/{name}', answer, qos_profile=CALLS)

    def serve_tare(self, tare: Callable[[], Sequence[float]]) -> None:
        """Answers `~/tare`: the present force becomes zero.

        Args:
            tare: takes it as zero and returns it, (x, y), N; an error says why it cannot.
        """
        self.serve('tare', lambda: f'zero of the force: {force_text(tare())} N')

    def _look_at_clock(self) -> None:
        """Says that simulated time, on which all waits, does not pass."""
        before, self._last_time = self._last_time, self.now()
        if before == self._last_time and self.get_clock().ros_time_is_active:
            what = 'stands still' if before else 'is silent'
            remedy = 'start what publishes it, or leave use_sim_time out'
            self.get_logger().warning(f'use_sim_time is true, and /clock {what}: {remedy}', **LASTING)

    def say(self, level: bytes, message: str) -> None:
        """Logs a message at the level of a status."""
        logger = self.get_logger()
        if level == ERROR:  # a line of code logs at one level only
            logger.error(message)
        elif level == WARN:
            logger.warning(message)
        else:
            logger.info(message)

    def now(self) -> int:
        """Time of the node's clock, ns; 0 before the first message on `/clock` where it is simulated."""
        return int(self.get_clock().now().nanoseconds)

    def log_time(self, received: int) -> int:
        """The log time of a message, ns: when it was received, where that is known and time is not simulated."""
        return self.now() if not received or self.get_clock().ros_time_is_active else received

    def status(self, title: str, level: bytes, text: str, values: Mapping[str, object]) -> DiagnosticArray:
        """One status of the node, stamped now.

        Args:
            title: after the node's name.
            level: `OK`, `WARN` or `ERROR`.
            text: one line.
            values: details by name.
        """
        hardware = self.get_namespace().strip('/') or 'scara_kinetostatic'
        array = diagnostic(f'{self.get_fully_qualified_name()}: {title}', level, text, values, hardware)
        array.header.stamp = self.get_clock().now().to_msg()
        return array

    def publish_status(self, title: str, examine: Callable[[], Condition]) -> None:
        """Publishes the status of the node once a second.

        Args:
            title: of the status, after the node's name.
            examine: returns the status.
        """
        publisher = self.create_publisher(DiagnosticArray, '/diagnostics', QUEUE)
        self.every(1.0, lambda: publisher.publish(self.status(title, *examine())))


Calibration = TypeVar('Calibration', CalibratedArm, CalibrationRecord)


class FollowedCalibration(Generic[Calibration]):
    """The calibration of the parameter `calibration`, then each later one that the calibrator publishes.

    Args:
        node: that uses the calibration.
        load: from the file that the parameter names to the calibration.
        read: from a message on `calibrator/result` to the calibration.
        take: called with each calibration to use from now on; what it raises is said, and the former one stays.

    Attributes:
        given: that of the parameter; None where it is empty.
        present: the calibration in use; None before the first.
        origin: of the calibration in use.
        refused: why the last one was not taken; empty where it was.

    Raises:
        InputError: the calibration that the parameter names is not valid.
    """

    def __init__(
        self,
        node: CellNode,
        load: Callable[[Path], Calibration],
        read: Callable[[Document], Calibration],
        take: Callable[[Calibration], None],
    ) -> None:
        self._logger = node.get_logger()
        self._read: Callable[[Document], Calibration] = read
        self._take: Callable[[Calibration], None] = take
        self.present: Calibration | None = None
        self.origin, self.refused = 'none', ''
        self._path = node.value('calibration')
        self.given: Calibration | None = load(node.place('calibration', self._path)) if self._path else None
        node.create_subscription(String, 'calibrator/result', self._take_result, LATCHED)

    def start(self) -> None:
        """Takes the calibration that the node is started with, where there is one."""
        if self.given is None:
            self._logger.info('no calibration yet; waiting for the calibrator')
        else:
            self._use(self.given, self._path)

    def _take_result(self, message: String) -> None:
        """A result of the calibrator; not one that is older than that in use."""
        try:
            document = parse_document(message.data, 'calibrator/result')
            if isinstance(document, dict) and not document.get('published', True):
                return  # the calibrator keeps the former one, too
            found, present = self._read(document), self.present
            if present is not None and found.created and found.created < present.created:
                self._logger.info(f'calibrator/result: of {found.created}, older than the one in use; not taken')
                return
            self._use(found, 'calibrator/result')
        except ScaraKinetostaticError as error:
            self._refuse(str(error))

    def _use(self, found: Calibration, origin: str) -> None:
        """Takes a calibration; one that may not be used is said."""
        try:
            self._check(found)
            self._take(found)
        except ScaraKinetostaticError as error:
            self._refuse(str(error))
            return
        self.present, self.refused = found, ''
        self.origin = f'{origin}, of {found.created or "unknown date"}'
        self._logger.info(f'calibration in use: {self.origin}')

    def _check(self, found: Calibration) -> None:
        """Check that a calibration may be used here.

        Raises:
            InputError: it may not.
        """

    def _refuse(self, problem: str) -> None:
        self.refused = problem
        self._logger.error(f'calibration not taken: {problem}')


class FollowedArm(FollowedCalibration[CalibratedArm]):
    """The same with the parameters `take_unfit` and `cell`: takes arms of this cell alone.

    Attributes:
        cell: of the calibration that the node is started with, or of the parameter `cell`.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    def __init__(self, node: CellNode, take: Callable[[CalibratedArm], None]) -> None:
        super().__init__(node, load_calibration, lambda document: read_arm(document, 'calibrator/result'), take)
        self._take_unfit = node.value('take_unfit')
        self.cell: Cell = node.cell_or_example() if self.given is None else self.given.cell

    def condition(self, found: Iterable[str], values: Mapping[str, str], good: str) -> Condition:
        """The status of the node: an error without a calibration, or where one was refused.

        Args:
            found: what is wrong else; empty texts are nothing.
            values: details by name.
            good: what is said where nothing is wrong.
        """
        problem = f'calibration not taken: {self.refused}' if self.refused else ''
        values = {'calibration': self.origin, **values}
        if self.present is None:
            return Condition(ERROR, _listed(problem or 'no calibration yet', *found), values)
        grade = self.present.grade or 'not assessed'
        graded = '' if grade in ('fit', 'unfit') else f'the calibration is {grade}'  # of unfit it is a reservation
        if message := _listed(problem, *found, graded, *self.present.reservations):
            return Condition(ERROR if problem else WARN, message, values)
        return Condition(OK, f'{good}: {self.origin}', values)

    def _check(self, arm: CalibratedArm) -> None:
        """Check that a calibration may be used here.

        Raises:
            InputError: it is unfit for use, or of another robot or sensor.
        """
        if arm.grade == 'unfit' and not self._take_unfit:
            problem = 'is unfit for use'
            raise ParameterError('the calibration', problem, 'take_unfit:=true takes it all the same')
        own, other = self.cell, arm.cell
        robots = [(c.joint_names, c.coupling, c.direction, c.plane, c.sensor[2:-3]) for c in (own, other)]
        if robots[0] != robots[1]:
            joints = f'{" ".join(other.joint_names)} (coupling {other.coupling:g}, direction {list(other.direction)})'
            problem = f'is of another robot: joints {joints}, sensor {other.sensor.frame.value}'
            raise InputError('the calibration', problem, 'give that of this cell')
        check_same_identification(own, other, 'the cell in use', 'the calibration')


def _listed(*texts: str) -> str:
    """Each once; empty texts are nothing."""
    return '; '.join(dict.fromkeys(filter(None, texts)))
