"""Node `compensator`: where the tip is under load, and the joint angles that bring it to a wanted pose.

Each `JointState` is answered with the tip on `~/pose`, by the last force: deflection, backlash and all effects of the
calibration are in it, and its covariance holds the uncertainty of the calibration, the places in the dead bands and
the noise of one sample.

A wanted pose is answered on `~/joint_trajectory` with the joint angles that bring the tip there under the wanted force,
a trajectory of one point as `joint_trajectory_controller` takes it, with the positions of the controller's other
joints: the lift stays, `robot.hold` has those to be held. Beside each answer its status is on `~/answer`; what is
refused is answered there alone: a place out of reach, inside an object or an obstacle, beyond the limits of the joints,
in another frame. The way to the pose is not checked.

`~/compensate` takes pose and force in one message, `sensor_msgs/MultiDOFJointState`: of the standard interfaces no
service has both and joint angles (those of `std_srvs` and `nav_msgs` do not, `moveit_msgs` is no dependency), and this
is the one message that has both. The answer has its stamp.

The calibration is that of the parameter `calibration`, then each newer one that the calibrator publishes.
It is exchanged between two samples. `~/tare` takes the present force as zero, but not while the tip presses against an
object of the cell. What is missing, stale, extrapolated or not tared is said on `/diagnostics`; without a recent force
or a calibration that may be used there is no pose.
"""

from __future__ import annotations

from collections import Counter, deque
from math import hypot, isfinite, nan, pi
from time import monotonic, sleep
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from rclpy.executors import Executor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState, MultiDOFJointState
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import InputError, ScaraKinetostaticError, UnsupportedDataError, one_line
from scara_kinetostatic.model.arm import CalibratedArm, JointAngles
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.online import MotionSense, OnlineArm, check_free
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN, CellNode, Condition, FollowedArm
from scara_kinetostatic.nodes.conversion import UnusableMessageError, force_text, planar
from scara_kinetostatic.nodes.streams import NEWEST, QUEUE, RELIABLE_STREAM, CellStreams, Stream, waiting
from scara_kinetostatic.planning.motion import Space

_SURE = ('ok', 'unloaded')


class Compensator(CellNode):
    """Follows the tip.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    rest = 0.0003

    def __init__(self) -> None:
        super().__init__('compensator')
        self._calibration = FollowedArm(self, self._use)
        self._cell = cell = self._calibration.cell
        self._plane, self._timeout = self.plane_of(cell), self.value('timeout')
        self._online: OnlineArm | None = None
        self._statuses: Counter[str] = Counter()  # of the poses since the last report
        self._zero: tuple[float, float] | None = None
        self._joints: tuple[float, float, float] | None = None  # the last, and when it came
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=RELIABLE_STREAM.depth)
        self._others = {cell.lift.joint: cell.lift.down} if cell.lift else {}
        self._motion, self._approach, self._needs_metadata = MotionSense(), (0.0, 0.0), False
        self._answered, self._answer_problem = 'none', ''
        self._streams = CellStreams(self, cell, self._turned)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, '~/pose', QUEUE)
        self._trajectory = self.create_publisher(JointTrajectory, '~/joint_trajectory', 1)
        self._status = self.create_publisher(DiagnosticArray, '~/answer', QUEUE)
        joints, force = cell.sensor[:2]
        self._joint_states = self.create_subscription(JointState, joints, self._take_joints, NEWEST, raw=True)
        self._wrenches = self.create_subscription(WrenchStamped, force, self._take_wrench, NEWEST, raw=True)
        self._requests = self.create_subscription(MultiDOFJointState, '~/compensate', self._answer, QUEUE, raw=True)
        self.serve_tare(self._tare)
        self.publish_status('tip', self._report)
        self._calibration.start()

    def _use(self, arm: CalibratedArm) -> None:
        """Takes a calibration from the next sample on.

        Raises:
            ParameterError: it cannot be followed.
        """
        stated = self.value('force_noise')
        online = OnlineArm(arm, arm.noise._replace(force=stated) if stated else arm.noise)
        if self._online is not None:
            online.follow_on(self._online)
        self._online, predictor = online, online.predictor
        self._needs_metadata = bool(predictor.effects_of('approach')) or predictor.depends_on_time
        if predictor.assumptions:
            self.get_logger().warning(predictor.assumptions)

    def _turned(self, _: bytes, anew: bool) -> None:
        """Fixed transforms turn the forces otherwise from here on: the zero was that of other components."""
        if anew:
            if self._zero is not None:
                self.get_logger().warning('the forces are turned otherwise from here on: call ~/tare again')
            self._zero = None
            self._forces.clear()

    def spin(self, executor: Executor) -> None:
        """Looks for joint states again and again while they come, and for requests.

        A round of the executor, for all else, takes as long as a sample.
        """
        stands = self._joints is None or monotonic() - self._joints[2] > 0.5
        executor.spin_once(timeout_sec=0.2 if stands else 0)
        for _ in range(1 if stands else 40):
            for message, _ in waiting(self._joint_states):
                self._take_joints(message)
            sleep(self.rest)
        for message, _ in waiting(self._requests):
            self._answer(message)

    def _take_wrench(self, message: bytes) -> None:
        for sample in self._streams.samples(Stream.WRENCH, message):
            sign, x, y = self._cell.sensor.sign.factor, sample.first, sample.second
            if self._cell.sensor.tool_weight and self._joints is not None:
                x, y = ((x, y) - self._cell.tool_pull(np.array(self._joints[:2]))).tolist()
            self._forces.append((sign * x, sign * y, monotonic()))

    def _take_joints(self, message: bytes) -> None:
        """Publishes where the tip is, by the last force that has come; the diagnostics say why there is no pose."""
        for wrench, _ in waiting(self._wrenches):
            self._take_wrench(wrench)
        if not (samples := self._streams.samples(Stream.JOINTS, message)):
            return
        sample = samples[-1]
        q1, q2, now = sample.first, sample.second, monotonic()
        self._joints = q1, q2, now
        others = zip(self._cell.other_joints, sample.others, strict=False)
        self._others |= {name: at for name, at in others if isfinite(at)}
        if self._needs_metadata:
            self._approach = self._motion.note(q1, q2)
        if self._online is None or not self._forces or now - self._forces[-1][2] > self._timeout:
            return
        (zero_x, zero_y), (fx, fy, _) = self._zero or (0.0, 0.0), self._forces[-1]
        force = self._online.true_force(q1, q2, fx - zero_x, fy - zero_y)
        found = self._online.locate(q1, q2, *force, self._metadata())
        self._statuses[found.status] += 1
        if isfinite(found.x):
            stamp, place = sample.stamp_ns or self.now(), (found.x, found.y, found.yaw)
            self._pose.publish(conversion.pose_bytes(stamp, self._plane, place, found.covariance))

    def _metadata(self) -> TouchMetadata | None:
        """Of the present pose, where the calibration asks for it."""
        if not self._needs_metadata or self._online is None:
            return None
        time = np.array([self._online.arm.used.duration])
        return TouchMetadata.plain(1)._replace(time=time, approach=np.array([self._approach]))

    def _tare(self) -> tuple[float, float]:
        """Takes the mean of the last forces as zero; nothing must be touched.

        Raises:
            UnsupportedDataError: there are too few, or the tip presses against an object that is known.
        """
        since = monotonic() - 0.5
        recent = [(x, y) for x, y, when in self._forces if when > since]
        if len(recent) < 3:
            raise UnsupportedDataError(f'{len(recent)} forces in the last 0.5 s')
        mean = np.mean(recent, axis=0)
        if self._online is not None and self._joints is not None:
            check_free(self._online.arm, np.array([self._joints[:2]]), mean[None] - (self._zero or (0.0, 0.0)))
        self._zero = float(mean[0]), float(mean[1])
        return self._zero

    def _of_request(self, request: MultiDOFJointState) -> tuple[tuple[float, float], tuple[float, float]]:
        """Place and force of a request.

        Raises:
            UnusableMessageError: it has not one of each, they are not finite, or in another frame.
        """
        if request.header.frame_id not in ('', self._plane.frame):
            raise UnusableMessageError(f'expected the frame {self._plane.frame}, got {request.header.frame_id!r}')
        if (len(request.transforms), len(request.wrench)) != (1, 1):
            found = f'{len(request.transforms)} transforms and {len(request.wrench)} wrenches'
            raise UnusableMessageError(f'expected one transform and one wrench, got {found}')
        place = planar(request.transforms[0].translation, self._plane, is_place=True)
        return place, planar(request.wrench[0].force, self._plane, is_place=False)

    def _angles_for(self, place: tuple[float, float], force: tuple[float, float]) -> tuple[Floats, JointAngles]:
        """How the tip comes to a wanted place, m, under a force, N.

        Returns:
            Angles of the two joints, (2,), rad, without a turn more than the present ones need; and what was found.

        Raises:
            InputError: there is no calibration, or the tip must not or cannot be there.
            UnsupportedDataError: there are no recent joint angles.
        """
        if self._online is None:
            raise InputError('the calibration', 'there is none yet', 'set the parameter calibration, or calibrate')
        if self._joints is None or monotonic() - self._joints[2] > self._timeout:
            raise UnsupportedDataError('no recent joint angles')
        cell, parameters, present = self._cell, self._online.arm.model.parameters, np.array(self._joints[:2])
        sides = {'left': 1, 'right': -1, 'present': int(posture(parameters, present[None])[0])}
        wanted = f'({place[0]:.4g}, {place[1]:.4g}) m'
        # 0.1 mm deep in an object is on its surface still: as much as a force of some newtons displaces the tip
        if inside := Space(cell, parameters, -1e-4 - 3 * cell.surface_std).object_at(np.array(place)):
            raise InputError('the wanted pose', f'{wanted} is inside {inside}', 'wish for another')
        side, metadata = np.array([sides[self.value('elbow')]]), self._metadata() or TouchMetadata.plain(1)
        found = self._online.predictor.compensate(np.array([place]), np.array([force]), side, metadata)
        if not np.isfinite(found.joints).all():
            raise InputError('the wanted pose', f'{wanted} is out of reach', 'wish for another')
        angles = cell.in_turn(found.joints[0] + 2 * pi * np.round((present - found.joints[0]) / (2 * pi)))
        if (beyond := cell.beyond_limits(angles)).any():
            problem = f'{wanted} is beyond the limits of {cell.joint_names[int(beyond.argmax())]} (robot.limits)'
            raise InputError('the wanted pose', problem, 'wish for another, or the other elbow')
        return angles, found

    def _answer(self, message: bytes) -> None:
        """Answers a request; of one that is refused only its status is published."""
        request = deserialize_message(message, MultiDOFJointState)
        values: dict[str, object] = {'elbow': self.value('elbow')}
        try:
            place, force = self._of_request(request)
            values |= {'x_m': place[0], 'y_m': place[1], 'fx_N': force[0], 'fy_N': force[1]}
            angles, found = self._angles_for(place, force)
        except (UnusableMessageError, ScaraKinetostaticError) as error:
            self._answer_problem = one_line(f'~/compensate is not answered: {error}')
            self.get_logger().warning(self._answer_problem)
            self._publish_answer(request, ERROR, self._answer_problem, values | {'status': 'refused'})
            return
        cell, status = self._cell, str(found.status[0])
        move = np.abs(angles - self._joints[:2]).max() if self._joints else 0.0
        joints, torques = cell.readings(angles).tolist(), cell.in_sense(found.torques[0]).tolist()
        values |= zip(('q1_rad', 'q2_rad', 'c1_Nm', 'c2_Nm'), joints + torques, strict=True)
        values |= {'std_normal_m': float(found.std_normal[0]), 'status': status}
        others = self._others | dict(cell.hold)
        positions = joints + [others[name] for name in cell.other_joints]
        duration = max(0.05, move / self.value('speed'))  # controllers refuse points in the past
        names = *cell.joint_names, *cell.other_joints
        self._trajectory.publish(conversion.joint_trajectory(names, [duration], [positions]))
        where = f'({place[0]:.6f}, {place[1]:.6f}) m under ({force[0]:.4g}, {force[1]:.4g}) N'
        self._answered = f'{where}: ({joints[0]:.6f}, {joints[1]:.6f}) rad, {status}'
        is_sure = status in _SURE
        self._answer_problem = '' if is_sure else f'the last answer is {status}: {self._answered}'
        self._publish_answer(request, OK if is_sure else WARN, self._answered, values)

    def _publish_answer(self, request: Any, level: bytes, message: str, values: dict[str, object]) -> None:
        """Publishes the status of an answer, with the header of the request."""
        array = self.status('answer', level, message, values)
        array.header = request.header
        self._status.publish(array)

    def _report(self) -> Condition:
        """The status: what is missing first."""
        complaints, heard = self._streams.examine()
        now, statuses = monotonic(), self._statuses
        self._statuses = Counter()
        zero, wrench = self._zero or (0.0, 0.0), self._forces[-1] if self._forces else None
        for name, last in (('joint angles', self._joints), ('forces', wrench)):
            if last is None or now - last[2] > self._timeout:
                complaints.append(f'no recent {name}')
        complaints += [f'{number} poses {name}' for name, number in statuses.items() if name not in _SURE]
        complaints += [] if self._zero else ['the force is not tared: call ~/tare while nothing is touched']
        assumptions = '' if self._online is None else self._online.predictor.assumptions
        fx, fy, _ = wrench or (nan, nan, nan)
        values = {
            'last answer': self._answered,
            'force [N]': f'{hypot(fx - zero[0], fy - zero[1]):.4g}',
            'zero of the force [N]': force_text(zero) if self._zero else 'not tared',
            **{f'poses: {name}': str(number) for name, number in statuses.items()},
        }
        found = [*complaints, assumptions, self._answer_problem]
        return self._calibration.condition(found, values | heard, 'following the tip')
