"""Node `compensator`: where the tip is under load, and the joint angles that bring it to a wanted pose.

Each `JointState` is answered with the tip on `~/pose`, by the last force: deflection, backlash and all effects of the
calibration are in it, and its covariance holds the uncertainty of the calibration, the places in the dead bands and
the noise of one sample. Where `tf2_msgs` is installed, the frame `tip_frame` follows it.

A pose on `~/target_pose` is answered on `~/joint_trajectory` with the joint angles that bring the tip there under the
force that was wanted last on `~/target_wrench` (none before), a trajectory of one point as
`joint_trajectory_controller` takes it. What is out of reach is not answered.

The calibration is that of the parameter `calibration`, and with `follow` each result that the calibrator publishes.
It is exchanged between two samples. `~/tare` takes the present force as zero. What is missing, stale or extrapolated
is said on `/diagnostics`; without a recent force, or without a calibration that may be used, there is no pose.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import islice

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import ParameterError, ScaraKinetostaticError
from scara_kinetostatic.files.urdf import BASE_FRAME
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.conversion import (
    NANOSECONDS,
    PlanarPose,
    Sample,
    UnusableMessageError,
    joint_sample,
    joint_trajectory,
    planar,
    pose_bytes,
    stamp_of,
    wrench_sample,
)
from scara_kinetostatic.nodes.declare import Range
from scara_kinetostatic.nodes.diagnostics import Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.followed_calibration import FollowedCalibration
from scara_kinetostatic.nodes.followed_tip import ELBOWS, Answer, FollowedTip, StaleError
from scara_kinetostatic.nodes.frame_check import FrameCheck
from scara_kinetostatic.nodes.polling import PolledGroup, PollingExecutor, waiting
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.stream_monitor import StreamMonitor

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

NEWEST = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=4,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
"""Samples that a busy machine has let wait are left out; matches every publisher."""
TARGETS_EVERY = 8
"""Polls of the streams to one of the wanted poses and forces."""
TF_PERIOD = 0.02
"""Between two transforms, s."""
SHORTEST = 0.05
"""Duration of a trajectory at least, s: controllers refuse points in the past."""


class Compensator(Node):
    """Follows the tip.

    Raises:
        InputError: a parameter, the cell or the calibration is not valid.
    """

    def __init__(self) -> None:
        super().__init__('compensator')
        self._calibration = FollowedCalibration(self, self._use)
        cell = self._calibration.cell
        self._timeout = declare.number(
            self, 'timeout', 0.1, 'age of a message beyond which it is stale, s', Range(0.001, 60)
        )
        noise = declare.number(
            self, 'force_noise', 0.0, 'standard deviation of one force, N; 0: that of the calibration', Range(0, 100)
        )
        self._elbow = declare.text(self, 'elbow', 'present', f'of the answers: {", ".join(ELBOWS)}')
        if self._elbow not in ELBOWS:
            raise ParameterError('parameter elbow', f'expected {", ".join(ELBOWS)}, got {self._elbow!r}')
        self._speed = declare.number(self, 'speed', 0.2, 'of a joint at most in an answer, rad/s', Range(1e-3, 100))
        prefix = declare.text(self, 'frame_prefix', '', 'before the names of frames, as of robot_state_publisher')
        tip_frame = declare.text(self, 'tip_frame', 'compensated_tip', 'frame of the tip; empty: no transform')
        self._frame, self._tip_frame = prefix + BASE_FRAME, prefix + tip_frame if tip_frame else ''
        self._tip = FollowedTip(cell, self._timeout, noise)
        self._answered, self._answer_problem = 'none', ''
        self._wanted = (0.0, 0.0)
        self._next_transform = self._polls = 0
        self._check = FrameCheck(self, cell.sensor.frame, self._turned)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, '~/pose', 10)
        self._transform = self.create_publisher(TFMessage, '/tf', 10) if TFMessage and self._tip_frame else None
        self._trajectory = self.create_publisher(JointTrajectory, '~/joint_trajectory', 1)
        joint_states, wrench = cell.sensor[:2]
        self._joints_heard = StreamMonitor(self.resolve_topic_name(joint_states), with_joints=True)
        self._wrench_heard = StreamMonitor(self.resolve_topic_name(wrench))
        self._group = PolledGroup()
        self._wrenches = self._polled(WrenchStamped, wrench, NEWEST)
        self.awaited = self._polled(JointState, joint_states, NEWEST)
        self._targets = self._polled(PoseStamped, '~/target_pose', 1)
        self._wanted_forces = self._polled(WrenchStamped, '~/target_wrench', 1)
        self.create_service(Trigger, '~/tare', self._tare)
        DiagnosticsPublisher(self, 'tip', self._report)
        self._calibration.start()

    def close(self) -> None:
        """Nothing to close."""

    def _use(self, arm: CalibratedArm) -> None:
        """Takes a calibration from the next sample on."""
        self._tip.use(arm)
        if self._tip.assumptions:
            self.get_logger().warning(self._tip.assumptions)

    def _turned(self, _: bytes, anew: bool) -> None:
        """Fixed transforms turn the forces otherwise from here on: the zero was that of other components."""
        if anew and self._tip.forget_forces():
            self.get_logger().warning('the forces are turned otherwise from here on: call ~/tare again')

    def _take_wrench(self, message: bytes) -> None:
        try:
            sample = wrench_sample(message, self._check.turn(message))
            self._wrench_heard.accept(sample.stamp_ns, (sample.first, sample.second))
            self._tip.take_wrench(sample)
        except UnusableMessageError as error:
            self._wrench_heard.refuse(str(error))

    def _polled(self, kind: type, topic: str, profile: QoSProfile | int) -> Subscription:
        return self.create_subscription(kind, topic, _ignore, profile, callback_group=self._group, raw=True)

    def poll(self) -> None:
        """Takes what has come: wrenches first, so that a joint state goes with the last force before it.

        One joint state: where more have come, the next wait ends at once.
        """
        for message in waiting(self._wrenches):
            self._take_wrench(message)
        for message in islice(waiting(self.awaited), 1):
            try:
                sample = joint_sample(message, self._tip.cell.joint_names)
                self._joints_heard.accept(sample.stamp_ns, (sample.first, sample.second))
            except UnusableMessageError as error:
                self._joints_heard.refuse(str(error))
            else:
                self._take_joints(sample)
        self._polls += 1
        if self._polls % TARGETS_EVERY:
            return
        for message in waiting(self._wanted_forces):
            self._want(deserialize_message(message, WrenchStamped))
        for message in waiting(self._targets):
            self._answer(deserialize_message(message, PoseStamped))

    def _take_joints(self, sample: Sample) -> None:
        """Publishes where the tip is."""
        try:
            found = self._tip.take_joints(sample)
        except StaleError:  # the diagnostics say so
            return
        if found is not None and found.x == found.x:
            stamp = sample.stamp_ns or int(self.get_clock().now().nanoseconds)
            pose = PlanarPose(found.x, found.y, found.yaw, found.covariance.tolist())
            self._pose.publish(pose_bytes(stamp, self._frame, pose))
            if self._transform is not None and not 0 <= self._next_transform - stamp <= NANOSECONDS:
                self._next_transform = stamp + round(TF_PERIOD * NANOSECONDS)
                self._transform.publish(TFMessage(transforms=[self._as_transform(stamp, pose)]))

    def _as_transform(self, stamp: int, pose: PlanarPose) -> TransformStamped:
        message = TransformStamped(child_frame_id=self._tip_frame)
        message.header.frame_id, message.header.stamp = self._frame, stamp_of(stamp)
        message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
        message.transform.rotation.z, message.transform.rotation.w = pose.half_turn
        return message

    def _want(self, message: WrenchStamped) -> None:
        """The wanted force of the robot on the object, base frame, from now on."""
        try:
            self._check_frame(message.header.frame_id)
            self._wanted = planar(message.wrench.force)
        except UnusableMessageError as error:
            self._leave(f'~/target_wrench: {error}')

    def _answer(self, message: PoseStamped) -> None:
        """Answers a wanted pose."""
        try:
            self._check_frame(message.header.frame_id)
            x, y = planar(message.pose.position)
            answer = self._tip.answer(x, y, *self._wanted, self._elbow)
        except (UnusableMessageError, StaleError, ScaraKinetostaticError) as error:
            self._leave(f'~/target_pose is not answered: {error}')
            return
        duration = max(SHORTEST, answer.move / self._speed)
        self._trajectory.publish(joint_trajectory(self._tip.cell.joint_names, answer.joints, duration))
        self._answered = self._described(x, y, answer)
        sure = answer.status in ('ok', 'unloaded')
        self._answer_problem = '' if sure else f'the last answer is {answer.status}: {self._answered}'

    def _described(self, x: float, y: float, answer: Answer) -> str:
        fx, fy = self._wanted
        where = f'({x:.6f}, {y:.6f}) m under ({fx:.4g}, {fy:.4g}) N'
        return f'{where}: ({answer.joints[0]:.6f}, {answer.joints[1]:.6f}) rad, {answer.status}'

    def _check_frame(self, frame_id: str) -> None:
        """Check that a wanted pose or force is in the base frame.

        Raises:
            UnusableMessageError: it is not.
        """
        if frame_id not in ('', self._frame):
            raise UnusableMessageError(f'expected the frame {self._frame}, got {frame_id!r}')

    def _leave(self, problem: str) -> None:
        self._answer_problem = problem
        self.get_logger().warning(problem)

    def _tare(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            x, y = self._tip.tare()
            response.success, response.message = True, f'zero of the force: ({x:.4g}, {y:.4g}) N'
        except StaleError as error:
            response.message = f'not tared: {error}'
        self.get_logger().info(response.message)
        return response

    def _report(self) -> Condition:
        """The status: what is missing first."""
        values = {'last answer': self._answered, **self._figures()}
        complaints = [self._check.complaint()]
        for monitor in (self._joints_heard, self._wrench_heard):
            monitor.publishers = [found.node_name for found in self.get_publishers_info_by_topic(monitor.topic)]
            rate = monitor.rate()
            values |= monitor.details(rate)
            complaints += [monitor.complaint(rate, expected=True), monitor.mixture()]
        statuses, self._tip.statuses = dict(self._tip.statuses), type(self._tip.statuses)()
        values |= {f'poses: {name}': str(number) for name, number in statuses.items()}
        complaints += [f'no recent {name}' for name, age in self._tip.ages().items() if age > self._timeout]
        complaints += [f'{number} poses {name}' for name, number in statuses.items() if name not in ('ok', 'unloaded')]
        complaints += [self._answer_problem, self._tip.assumptions]
        return self._calibration.condition(complaints, values, 'following the tip')

    def _figures(self) -> dict[str, str]:
        zero = self._tip.zero
        return {
            'force [N]': f'{self._tip.force:.4g}',
            'zero of the force [N]': 'not tared' if zero is None else f'({zero[0]:.4g}, {zero[1]:.4g})',
            'wanted force [N]': f'({self._wanted[0]:.4g}, {self._wanted[1]:.4g})',
        }


def _ignore(_: bytes) -> None:
    """Polled subscriptions have no callback."""


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Compensator, args, PollingExecutor)


if __name__ == '__main__':
    sys.exit(main())
