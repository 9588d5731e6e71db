"""Node `touch_runner`: moves the robot, touches, judges, calibrates and goes on until it is enough.

The robot is moved by `joint_trajectory`, or with the parameter `action` by a FollowJointTrajectory server: positions of
the cell's joints, then of the lift and the held joints; each replaces the one before. A way through free space is one
command, with velocities. Towards a contact and in it each message leads to one place, 0.1 s away at most, so that the
robot stands soon after the node has died; the server gets as few goals as that allows. `~/start` begins or goes on,
`~/pause` stands still when the touch under way has ended, `~/stop` retracts and holds. What is done, what comes next
and why is on `~/state`, the place of the next contact on `~/next_touch`, its x axis along the outward normal.

The recording is that of the collector: a touch that was counted is on the disk. At the end it is calibrated in a
process of its own, into the folder `calibration` in `output`. With `exit_when_done` the node ends then, with status 0
where the tolerance is reached, or more touches do not help and the result may be used, 1 where it gave up or the result
is unfit, 3 where it was stopped.

What may pass by itself, as a controller that is not active or a sensor that is silent, is waited for in each touch, for
`patience` at most. Before the run the sensor is set to zero by `sensor.zero_service`, where the cell names one.

With `use_sim_time`, which cannot be changed while it runs, all times are those of `/clock`; where that stands for 1 s,
steady time goes on, so that silent sensors are noticed, and a stop acts.

The controller is commanded as `joint_trajectory_controller` of ros2_control has it: every command replaces the one
before, which then ends as aborted; a goal that is not for an active controller, or not of its joints, is rejected.
Where it answers for its parameters, it is said which ones are to be set.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from math import isnan
from multiprocessing import get_context, parent_process
from pathlib import Path
from threading import Thread
from time import monotonic_ns
from typing import Any

from action_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future as RclpyFuture
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import CellError, ScaraKinetostaticError
from scara_kinetostatic.model.parameters import MILLI, NANO
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm
from scara_kinetostatic.nodes.calibration_job import UNFIT, CalibrationProcess, Job
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN, Condition, RefusedError
from scara_kinetostatic.nodes.conversion import Sample, follow_joint_trajectory, joint_trajectory, pose_stamped
from scara_kinetostatic.nodes.executables import ENDING
from scara_kinetostatic.nodes.session import RecordingNode, Session
from scara_kinetostatic.nodes.streams import LATCHED, QUEUE, CellStreams, Stream, publishers_of
from scara_kinetostatic.planning.next_touches import Planner, known_or_infinite
from scara_kinetostatic.results.document import YAML, load_result
from scara_kinetostatic.running.campaign import FIRST
from scara_kinetostatic.running.robot import Command
from scara_kinetostatic.running.runner import Runner, Status
from scara_kinetostatic.simulation.commanded import DEMO_CELL
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.detection import Detection, no_touches

_PARAMETERS = (
    *('interpolate_from_desired_state', 'open_loop_control'),  # the former name of it
    *('interpolation_method', 'constraints.goal_time', 'joints', 'allow_partial_joints_goal'),
)
"""Of `joint_trajectory_controller`, which matter to the runner."""


class Controller:
    """Commands the robot, and hears how that ends.

    Args:
        node: that commands.
        joints: that commands name.
        action: of the server; empty for messages on `joint_trajectory`.
        failed: called where a command failed, with the reason, one sentence, and whether it may pass by itself.

    Attributes:
        is_action: whether it is commanded by goals.

    Raises:
        ImportError: of `control_msgs`.
    """

    def __init__(self, node: Node, joints: Sequence[str], action: str, failed: Callable[[str, bool], None]) -> None:
        self._node, self._failed = node, failed
        self._publisher = node.create_publisher(JointTrajectory, 'joint_trajectory', QUEUE)
        self._client: ActionClient | None = None
        self._name = self._publisher.topic_name
        if action:
            self._kind = follow_joint_trajectory()
            self._client, self._name = ActionClient(node, self._kind, action), node.resolve_service_name(action)
        self.is_action, self._number, self._joints, self._is_asked = bool(action), 0, joints, False
        self._found = dict[str, Any]()
        own = f'{self._name}'.rpartition('/')[0]
        self._parameters = node.create_client(GetParameters, f'{own}/get_parameters')
        self._topic = f'{own}/joint_trajectory' if action else self._name
        self._foreign, self._goals = '', f'{own}/follow_joint_trajectory'
        if not action:
            status, quality = f'{self._goals}/_action/status', qos_profile_action_status_default
            node.create_subscription(GoalStatusArray, status, self._hear, quality)

    def absence(self) -> str:
        """That nobody moves the robot; empty where somebody does."""
        if self._client is None:
            heard = self._publisher.get_subscription_count() > 0
            return '' if heard else f'nobody hears {self._name}: start the controller, or remap the topic'
        is_served = self._client.server_is_ready()
        return '' if is_served else f'nobody serves the action {self._name}: start the controller, or set action'

    def problem(self) -> str:
        """That somebody else commands as well; empty where nobody does."""
        found = publishers_of(self._node, self._topic)
        others = [name for name in found if name != self._node.get_fully_qualified_name()]
        if others or len(found) > 1:
            return f'another node publishes {self._topic}, {", ".join(others) or "of the same name"}: end it'
        return self._foreign if self._node.count_publishers(f'{self._goals}/_action/status') else ''

    def ask(self) -> None:
        """Asks for its parameters, once whenever it comes; one by one, as it answers nothing where it lacks one."""
        if self._is_asked == self._parameters.service_is_ready():
            return
        self._is_asked = not self._is_asked
        for name in _PARAMETERS if self._is_asked else ():
            answer = self._parameters.call_async(GetParameters.Request(names=[name]))
            answer.add_done_callback(partial(self._take_parameter, name))

    def _take_parameter(self, name: str, future: RclpyFuture) -> None:
        values = [] if future.exception() is not None else future.result().values
        self._found[name] = parameter_value_to_python(values[0]) if values else None

    def advice(self) -> str:
        """What to set in it, one sentence; empty where all is well, or its parameters are not known."""
        found, wrong = self._found, list[str]()
        begins = [name for name in _PARAMETERS[:2] if found.get(name) is not None]
        if begins and not any(map(found.get, begins)):
            wrong.append(f'{begins[0]}: true: else each command begins at the measured joints, and lags in contact')
        if found.get('interpolation_method') == 'none':
            wrong.append('interpolation_method: splines: else it steps at the end of each point')
        if found.get('constraints.goal_time'):
            wrong.append('constraints.goal_time: 0.0: else it aborts what comes late')
        others = [joint for joint in found.get('joints') or () if joint not in self._joints]
        if others and not found.get('allow_partial_joints_goal'):
            wrong.append(f'allow_partial_joints_goal: true: else name {", ".join(others)} in robot.hold')
        return f'{self._topic.rpartition("/")[0]}: set {"; ".join(wrong)}' if wrong else ''

    def send(self, command: Command) -> None:
        """Sends a command, which replaces the former."""
        trajectory = joint_trajectory(command.names, *(part.tolist() for part in command[1:]))
        if self._client is None:
            self._publisher.publish(trajectory)
            return
        self._number += 1
        goal = self._kind.Goal(trajectory=trajectory)
        answer = self._client.send_goal_async(goal)
        answer.add_done_callback(partial(self._take_answer, self._number))

    def _hear(self, message: GoalStatusArray) -> None:
        """Of goals of the controller that is commanded by messages: each is somebody else's."""
        under_way = {GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING}
        is_commanded = any(goal.status in under_way for goal in message.status_list)
        self._foreign = f'somebody else sends goals to {self._goals}: end that' if is_commanded else ''
        if is_commanded:
            self._failed(self._foreign, False)

    def _take_answer(self, number: int, future: RclpyFuture) -> None:
        if future.exception() is not None:
            self._failed(f'the controller does not answer: {future.exception()}', True)
        elif future.result().accepted:
            future.result().get_result_async().add_done_callback(partial(self._take_result, number))
        elif number == self._number:
            self._failed('the controller rejects a trajectory: it is not active, or its log says why', True)

    def _take_result(self, number: int, future: RclpyFuture) -> None:
        if future.exception() is not None:
            return  # the next goal tells
        status, result = future.result().status, future.result().result
        if number != self._number or status == GoalStatus.STATUS_SUCCEEDED:
            return
        if status == GoalStatus.STATUS_CANCELED:
            self._failed('somebody cancelled a trajectory', False)
            return
        kinds, code = self._kind.Result, result.error_code
        # what it says of a goal that it dropped as it was deactivated; of one in whose place another came it does not
        is_dropped = code == kinds.INVALID_GOAL and 'deactivat' not in result.error_string
        text = f'the controller aborts a trajectory (error code {code}): {result.error_string}'
        passes = not is_dropped and code in (kinds.INVALID_GOAL, kinds.GOAL_TOLERANCE_VIOLATED)
        self._failed(text + is_dropped * ': somebody else commands the robot', passes)


RESULT = 'calibration'
"""Folder of the result, in `output`."""
_CLOCK_STANDS = SECOND
"""So long `/clock` may stand while this node listens, ns."""
_WAIT = 10.0
"""With `autostart`, how long somebody may take to hear `joint_trajectory`, s; and the zero of the sensor."""


def _end_with_parent() -> None:
    """Ends this process when the node has died, even by SIGKILL; signals are the node's to note."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)

    def watch() -> None:
        parent = parent_process()
        assert parent is not None
        parent.join()
        os._exit(0)

    Thread(target=watch, daemon=True).start()


class TouchRunner(RecordingNode):
    """Runs the touches. Another process calibrates: in a thread of this one the samples would have to wait.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
        UnsupportedDataError: nothing can be touched, or the tolerance is out of reach.
    """

    rest = 0.002

    def __init__(self) -> None:
        super().__init__('touch_runner')
        self._cell = self.cell_or_example(DEMO_CELL)
        self._plane = self.plane_of(self._cell)
        self._output, path = self.place('output', self.value('output')).absolute(), self.value('calibration')
        self._planner = self._known(self.place('calibration', path)) if path else None
        if self._cell.limits is None:
            raise CellError('robot.limits', 'the limits of the joints are missing', 'add them to the cell description')
        self._work: ProcessPoolExecutor | None = None
        self._process: CalibrationProcess | None = None
        self._result = ''
        self._ticked, self._is_running, self._waits_until = 0, False, monotonic_ns() + int(_WAIT * SECOND)
        self._simulated = self._looked = self._stood = self._ahead = 0
        self._said: tuple[str, str] = ('', '')
        joints = (*self._cell.joint_names, *self._cell.other_joints)
        self._controller = Controller(self, joints, self.value('action'), self._take_failure)
        self._runner = self._new_runner()
        zero = self._cell.sensor.zero_service
        self._zero_client = self.create_client(Trigger, zero) if zero else None
        self._zero: RclpyFuture | None = None
        self._state = self.create_publisher(DiagnosticArray, '~/state', LATCHED)
        self._next = self.create_publisher(PoseStamped, '~/next_touch', LATCHED)
        self._streams = CellStreams(self, self._cell, self._take_transforms)
        self._streams.subscribe(self._take)
        self._autostart = self.value('autostart')
        self.serve('start', self._start)
        self.serve('pause', self._pause)
        self.serve('stop', self._stop)
        self.every(0.01, self._tick)
        self.every(0.1, self._watch)
        self.every(0.5, self._publish_state)
        self.publish_status('run', self._report)
        self._publish_state()

    def close(self) -> None:
        """Lets the robot stand, completes the recording, ends a calibration."""
        if self._is_running:
            self._runner.fail('the node was ended', may_retract=False)
            self._tick()
            self._end_recording()
            self._publish_state()
            self.exit_status = 3
        if self._process is not None:
            self._process.close()
        if self._work is not None:
            self._work.shutdown(cancel_futures=True)

    def _known(self, path: Path) -> Planner:
        """What a calibration says; its touches do not count."""
        record = CalibrationRecord.load(path)
        check_same_arm(record.arm.cell, self._cell, str(path), 'the cell')
        stated = record.document['tip_uncertainty']
        return Planner(replace(record.arm, cell=self._cell), known_or_infinite(stated['worst'], stated['undetermined']))

    def _check(self, name: str, value: Any) -> None:
        if name == 'use_sim_time' and self._is_running and value != self.get_clock().ros_time_is_active:
            raise RefusedError('the robot is moved by this clock: call ~/stop first')
        super()._check(name, value)

    def _take_failure(self, reason: str, passes: bool) -> None:
        if self._is_running:
            self._runner.fail(reason, may_retract=passes, passes=passes)

    def _new_runner(self) -> Runner:
        most, patience = self.value('max_touches'), self.value('patience')
        runner = Runner(self._cell, most, self._detect, self._submit, self._planner, patience)
        runner.robot.streams = not self._controller.is_action
        return runner

    def _submit(self, do: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Has a calibration made in the other process."""
        if self._work is not None:
            with suppress(BrokenExecutor):  # its process was killed: another one
                return self._work.submit(do, *arguments)
        self._work = ProcessPoolExecutor(1, get_context('spawn'), _end_with_parent)
        return self._work.submit(do, *arguments)

    # Services

    def _start(self) -> str:
        if self._is_running:
            self._runner.start()
            return 'going on'
        if self._process is not None:
            raise RefusedError('the former run is being calibrated; call again when that is done')
        if problem := self._absence():
            raise RefusedError(problem)
        if self._runner.end is not None:
            former, self._runner = self._runner, self._new_runner()
            self._runner.take_over(former)
        if self._zero_client is not None and not self._runner.is_in_contact:
            self._zero = self._zero_client.call_async(Trigger.Request())
            self._waits_until = monotonic_ns() + int(_WAIT * SECOND)
        self._submit(abs, 0)  # the process has started, and imported what it needs, before it is needed
        self._session = Session(self._output, self._cell, self.now(), self._streams)
        self._autostart, self._is_running, self._result = False, True, ''
        self._runner.start()
        self._publish_state()
        return '; '.join(filter(None, (f'running; recording to {self._session.folder}', self._controller.advice())))

    def _pause(self) -> str:
        self._check_running()
        self._runner.pause()
        return 'it stands still when the touch under way has ended; ~/start goes on'

    def _stop(self) -> str:
        self._check_running()
        obstacle = self._runner.obstacle() or self._controller.absence()
        self._runner.stop('stopped by ~/stop')
        if obstacle:
            raise RefusedError(f'the run has ended, but the tip may not be retracted: {obstacle}')
        return 'stopped: the tip is retracted, then the robot holds'

    def _check_running(self) -> None:
        if not self._is_running:
            raise RefusedError('nothing is running; call ~/start first')

    def _absence(self) -> str:
        """What is missing or wrong before a run; empty where nothing is."""
        if self.get_clock().ros_time_is_active and not self.now():
            return 'use_sim_time is true, but nothing comes on /clock: publish it, or set use_sim_time to false'
        zero = self._zero_client
        missing = '' if zero is None or zero.service_is_ready() else f'nobody serves {zero.srv_name}'
        return self._controller.absence() or self._hearing() or (missing and f'{missing} (sensor.zero_service)')

    def _hearing(self) -> str:
        """Why another robot may be moved, or this one by somebody else as well; empty where all is well."""
        if problem := self._controller.problem():
            return problem
        if self._streams.is_taken_for_the_example:
            return 'the parameter cell is empty: name the cell description of this robot'
        return self._streams.frame.complaint()

    def _is_zeroed(self) -> bool:
        """Whether the sensor has been set to zero, where that is to be; a service that fails ends the run."""
        if self._zero is None:
            return True
        if not self._zero.done() and monotonic_ns() < self._waits_until:
            return False
        answer = self._zero.result() if self._zero.done() else None
        if answer is None or not answer.success:
            why = 'does not answer' if answer is None else f'failed: {answer.message}'
            self._runner.fail(f'{self._cell.sensor.zero_service} (sensor.zero_service) {why}', may_retract=False)
        self._zero = None
        return True

    # Samples and commands

    def _time(self) -> int:
        """Of the run, ns: steady, or that of the simulation; steady again where `/clock` stands."""
        steady = monotonic_ns()
        if not self.get_clock().ros_time_is_active:
            return steady
        listened, self._looked = min(steady - self._looked, SECOND // 20), steady
        over = max(0, self._stood - _CLOCK_STANDS)
        if (simulated := self.now()) == self._simulated:
            self._stood += listened
            return simulated + self._ahead + over
        if over:
            self._runner.senses.forget_delays()
        self._simulated, self._stood, self._ahead = simulated, 0, self._ahead + over
        return simulated + self._ahead

    def _take(self, stream: Stream, message: bytes, received: int, samples: list[Sample]) -> None:
        self._record(stream, message, received, samples)
        senses, now = self._runner.senses, NANO * self._time()
        if not samples:
            monitor = self._streams.monitors[stream]
            senses.refuse(monitor.refusal, moved=monitor.has_moved)
        for sample in samples:
            if stream is Stream.JOINTS:
                lift = sample.others[0] if self._cell.lift and not isnan(sample.others[0]) else None
                senses.add_joints(now, NANO * sample.stamp_ns, sample[1:3], lift)
            else:
                senses.add_force(now, NANO * sample.stamp_ns, sample[1:3])
                if not 0 <= self._time() - self._ticked < 2 * MILLI * SECOND:
                    self._tick()

    def _take_transforms(self, message: bytes, anew: bool) -> None:
        if self._session is not None:
            with self._guarded():
                self._session.take_transforms(message, self.now(), anew)

    def _detect(self) -> Detection:
        """The touches that were found and are on the disk."""
        latest = Detection(no_touches())
        with self._guarded():
            if self._session is not None:
                for touch in self._session.poll():
                    self.say(WARN if touch.reason else OK, touch.line)
                latest, self._session.latest = self._session.latest, latest
        return latest

    def _lost(self, reason: str) -> None:
        """The recording cannot go on: nor can the run."""
        self._runner.fail(f'the recording failed: {reason}')

    def _tick(self) -> None:
        if not self._is_running or not self._is_zeroed():
            return
        now = self._ticked = self._time()
        if (command := self._runner.tick(NANO * now)) is not None:
            self._controller.send(command)
            self._runner.note(NANO * self._time())
        status = self._runner.status
        if (status.phase, status.text) != self._said:
            self._said = status.phase, status.text
            self._publish_state()
            self.say(self._level(status), f'{status.phase}: {status.text}')
            self._publish_next()
        if self._runner.is_over:
            self._is_running = False
            self._end_recording()
            self._calibrate()

    def _watch(self) -> None:
        """Who hears and publishes; what the calibration at the end does."""
        if self._is_running and self._runner.end is None:
            if absence := self._controller.absence():
                self._runner.fail(absence, passes=True)
            elif problem := self._hearing():
                self._runner.fail(problem, may_retract=False)
        self._controller.ask()
        if self._autostart:
            self._begin_by_itself()
        ended = None if self._process is None else self._process.poll()
        if ended is not None:
            self._process = None
            reply = ended.get('reply')
            if reply is not None:
                facts = load_result(Path(reply['folder']) / YAML).facts
                self._result = f'result in {reply["folder"]}: verdict {facts["verdict"]}, {facts["assessment"]}'
                if facts['assessment'] == UNFIT:
                    self._runner.revoke('the calibration of the whole recording is unfit for use; see its report')
            else:
                self._result = f'no result: {ended.get("error") or ended.get("cancelled")}'
                self._runner.revoke(self._result)
            self.get_logger().info(self._result)
            self._end()

    def _begin_by_itself(self) -> None:
        """With `autostart`: as soon as somebody hears."""
        if self._absence() and monotonic_ns() < self._waits_until:
            return
        self._autostart = False
        try:
            self.get_logger().info(self._start())
        except ScaraKinetostaticError as error:
            self._runner.fail(str(error), may_retract=False)
            self.get_logger().error(str(error))
            self._end()

    def _end_recording(self) -> None:
        if self._session is not None:
            try:
                self._session.close()
            except (ScaraKinetostaticError, OSError) as error:
                self.get_logger().error(f'the recording could not be completed: {error}')

    def _calibrate(self) -> None:
        """Calibrates the recording, as far as there are touches in it."""
        session, self._session = self._session, None
        if session is None or session.touches < FIRST:
            self._result = 'no result: too few touches'
            self._end()
            return
        job = Job([str(session.folder)], '', [], [], str(self._output / RESULT), publish_unfit=True)
        try:
            self._process = CalibrationProcess(job)
        except OSError as error:
            self._result = f'no result: {error}'
            self._end()

    def _end(self) -> None:
        self._publish_state()
        end = self._runner.end
        if self.value('exit_when_done') and end is not None:
            self.exit_status = end.status

    # What it says

    def _level(self, status: Status) -> bytes:
        return ERROR if status.is_fault else WARN if status.phase in ('paused', 'waiting', 'stopped') else OK

    def facts(self) -> dict[str, str]:
        """What is on `~/state`, by name."""
        session, status = self._session, self._runner.status
        values = {'phase': status.phase, 'text': status.text, **status.values}
        return values | {'recording': '' if session is None else str(session.folder), 'result': self._result}

    def _publish_state(self) -> None:
        status = self._runner.status
        self._state.publish(self.status('run', self._level(status), status.text, self.facts()))

    def _publish_next(self) -> None:
        target = self._runner.target
        if target is not None and self._runner.status.phase == 'travel':
            (x, y), angle = target.plan.contact(self._cell)[0].tolist(), float(target.plan.direction(self._cell)[0])
            self._next.publish(pose_stamped(self.now(), self._plane, (x, y, angle)))

    def _report(self) -> Condition:
        complaints, values = self._streams.examine(expected=self._is_running)
        complaints.append(self._controller.advice())
        status = self._runner.status
        text = '; '.join(filter(None, (status.text, self._result, *dict.fromkeys(complaints))))
        level = max(self._level(status), WARN if any(complaints) else OK)
        return Condition(level, text, values | self.facts())
