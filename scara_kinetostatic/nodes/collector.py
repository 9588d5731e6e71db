"""Node `collector`: records the two topics of a cell and counts the touches.

Every message goes into the bag as it came. The same messages go through the
touch detection; a touch is counted on `~/touches` only when the bag holds it
durably, and published on `~/touch` with its judgement. Services `~/start` and
`~/stop` begin and end a recording, each in a new folder, which is announced on
`~/recording`, its end by `~/stop` on `~/stopped`; `~/discard_last` discards a touch. A full or vanished disk ends
the recording, not the node; so does a folder that cannot be written to. What
would spoil a recording is said at once: several publishers on a topic, clocks
that differ, touches that are rejected, a disk that will be full.

Messages are logged at the time at which the middleware received them. With
`use_sim_time` they are logged by the clock of the node, and there is no recording before the first message on `/clock`.
Touches are looked for by steady time.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.bags.writer import OfferedQos
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.complaints import PersistentComplaints
from scara_kinetostatic.nodes.conversion import Sample, UnusableMessageError, joint_sample, wrench_sample
from scara_kinetostatic.nodes.declare import cell_or_example
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.frame_check import FrameCheck
from scara_kinetostatic.nodes.publishers import full_name, recorded_qos
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.session import Session, Stream
from scara_kinetostatic.nodes.stream_monitor import StreamMonitor
from scara_kinetostatic.nodes.stream_subscription import LATCHED, StreamSubscription
from scara_kinetostatic.nodes.touch_topics import TouchTopics

POLL = 0.1
"""Period of the search for finished touches, s."""
SIMULATOR = 'contact_simulator'
"""Node whose robot is that of the example cell where no cell is given."""
EXAMPLE = 'the parameter cell is empty: the robot is taken for the example cell of figure 3; name its cell description'
REST = 0.005
"""Between two callbacks, s: messages of 1 kHz are taken ten at a time."""


class Collector(Node):
    """Records on request.

    Raises:
        InputError: a parameter or the cell is not valid.
    """

    def __init__(self) -> None:
        super().__init__('collector')
        self._cell = cell_or_example(self)
        output = 'folder in which each recording gets a folder of its own'
        declare.text(self, 'output', 'recordings', output, read_only=False)
        self._autostart = declare.switch(self, 'autostart', False, 'start recording at once')
        self._session: Session | None = None
        self._by_ros_time = self.get_clock().ros_time_is_active
        self._lost_before = 0
        self._failure = ''
        self._complaints = PersistentComplaints(self.get_logger().warning)
        self._touches = TouchTopics(self, self._cell.sensor.frame)
        self._recording = self.create_publisher(String, '~/recording', LATCHED)
        self._stopped = self.create_publisher(String, '~/stopped', LATCHED)
        self._frame = FrameCheck(self, self._cell.sensor.frame, self._take_transforms)
        self._monitors: dict[Stream, StreamMonitor] = {}
        self._subscriptions_of: dict[Stream, StreamSubscription] = {}
        for stream, kind, topic in zip(Stream, (JointState, WrenchStamped), self._cell.sensor[:2], strict=True):
            self._subscribe(stream, kind, topic)
        self.create_service(Trigger, '~/start', self._start)
        self.create_service(Trigger, '~/stop', self._stop)
        self.create_service(Trigger, '~/discard_last', self._discard_last)
        self.create_timer(POLL, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))
        DiagnosticsPublisher(self, 'recording', self._report)
        if not self._autostart:
            self.get_logger().info(f'not recording yet; call {self.resolve_service_name("~/start")}')
        elif not self._now():
            self.get_logger().warning('use_sim_time is set: recording begins with the first message on /clock')
        else:
            self._begin_by_itself()

    def _subscribe(self, stream: Stream, kind: type, topic: str) -> None:
        name = self.resolve_topic_name(topic)
        self._monitors[stream] = monitor = StreamMonitor(name, with_joints=stream is Stream.JOINTS)
        receive = partial(self._receive, stream)
        self._subscriptions_of[stream] = StreamSubscription(self, kind, topic, receive, monitor.lose)

    def close(self) -> None:
        """Ends the recording, so that the bag is complete."""
        if self._session is not None:
            self.get_logger().info(self._end())

    def _start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._session is not None:
            response.message = f'recording already, to {self._session.folder}; call ~/stop first'
            return response
        if not self._now():
            response.message = 'parameter use_sim_time is set, but there is no message on /clock; publish it'
            self.get_logger().warning(f'not recording: {response.message}')
            return response
        try:
            response.message = self._with_warnings(self._begin())
            response.success = True
            self.get_logger().info(response.message)
        except ScaraKinetostaticError as error:
            self._fail(error)
            response.message = str(error)
        return response

    def _stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._session is None:
            response.message = self._failure or 'nothing is being recorded; call ~/start first'
            return response
        self._stopped.publish(String(data=str(self._session.folder)))
        response.message = self._end()
        response.success = not self._failure
        self.get_logger().info(response.message)
        return response

    def _discard_last(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._session is None:
            response.message = self._failure or 'nothing is being recorded; call ~/start first'
            return response
        try:
            touch = self._session.discard_last(self._now())
        except ScaraKinetostaticError as error:
            self._fail(error)
            response.message = str(error)
            return response
        if touch is None:
            response.message = 'there is no accepted touch to discard'
            return response
        self._touches.publish(self._session, [touch])
        left = f'{self._session.touches} touches left'
        response.message = f'touch {touch.number} ({touch.object}) discarded; {left}'
        response.success = True
        return response

    def _begin_by_itself(self) -> None:
        self._autostart = False
        try:
            self.get_logger().info(self._begin())
        except ScaraKinetostaticError as error:
            self._fail(error)

    def _begin(self) -> str:
        parent = declare.place('output', str(self.get_parameter('output').value)).absolute()
        joint_states, wrench = (monitor.topic for monitor in self._monitors.values())
        self._session = Session(parent, self._cell, self._now(), (joint_states, wrench))
        for message in self._frame.messages:
            self._session.take_transforms(message, self._now())
        self._look_at_publishers()
        self._lost_before = self._lost()
        self._autostart = False
        self._failure = ''
        self._touches.publish(self._session)
        self._recording.publish(String(data=str(self._session.folder)))
        return f'recording to {self._session.folder}'

    def _end(self) -> str:
        """Completes the bag; returns its contents in one line."""
        session, self._session = self._session, None
        assert session is not None
        try:
            self._touches.publish(session, session.close())
        except ScaraKinetostaticError as error:
            self._fail(error)
            return f'{session.folder}: {error}'
        lost = self._lost() - self._lost_before
        loss = f'; {lost} messages were lost on the way' if lost else ''
        counted = f'{session.touches} touches ({session.rejected} more rejected) in {session.folder}{loss}'
        return self._with_warnings('; '.join(filter(None, (counted, session.rejections(), session.clock_warning))))

    def _with_warnings(self, answer: str) -> str:
        """The answer of a service, with what spoils the data."""
        mixtures = (monitor.mixture() for monitor in self._monitors.values())
        return '; '.join(filter(None, (answer, *mixtures, self._frame.complaint(), self._example_cell())))

    def _example_cell(self) -> str:
        """That a robot other than the simulated one is taken for the example cell; empty if it is not."""
        named = bool(self.get_parameter('cell').value)
        robots = {name.rpartition('/')[2] for monitor in self._monitors.values() for name in monitor.publishers}
        return '' if named or robots <= {SIMULATOR} else EXAMPLE

    def _look_at_publishers(self) -> None:
        """Notes who publishes the topics, and by which quality of service."""
        offered: list[OfferedQos | None] = []
        for stream, subscription in self._subscriptions_of.items():
            publishers = subscription.publishers()
            self._monitors[stream].publishers = [full_name(item) for item in publishers]
            offered.append(recorded_qos(publishers[0].qos_profile) if publishers else None)
        if self._session is not None:
            try:
                self._session.offer(*offered)
            except ScaraKinetostaticError as error:
                self._fail(error)

    def _lost(self) -> int:
        return sum(monitor.lost for monitor in self._monitors.values())

    def _fail(self, error: Exception) -> None:
        """Ends the recording; the node goes on."""
        if self._session is not None:
            self._session.abandon()
        self._session = None
        self._failure = ' '.join(str(error).split())
        self.get_logger().error(f'recording failed: {self._failure}')

    def _receive(self, stream: Stream, message: bytes, received: int) -> None:
        """Takes a message in: all go into the bag, the usable ones to the touch detection, too."""
        try:
            sample = self._convert(stream, message)
            self._monitors[stream].accept(sample.stamp_ns, (sample.first, sample.second))
        except UnusableMessageError as error:
            sample = None
            self._monitors[stream].refuse(str(error))
        if self._session is not None:
            try:
                self._session.take(stream, message, self._log_time(received), sample)
            except ScaraKinetostaticError as error:
                self._fail(error)

    def _convert(self, stream: Stream, message: bytes) -> Sample:
        if stream is Stream.JOINTS:
            return joint_sample(message, self._cell.joint_names)
        return wrench_sample(message, self._frame.turn(message))

    def _take_transforms(self, message: bytes, anew: bool) -> None:
        """Records fixed transforms; touches before them are told as they were judged."""
        session = self._session
        if session is None:
            return
        try:
            self._touches.publish(session, session.take_transforms(message, self._now(), anew))
        except ScaraKinetostaticError as error:
            self._fail(error)
            return
        if anew and session.touches + session.rejected:
            after = f'after touch {session.touches + session.rejected - 1}: {self._frame.description()}'
            self.get_logger().warning(f'/tf_static came {after}; a calibration turns the forces before as well')

    def _now(self) -> int:
        """Time of the node's clock, ns; 0 before the first message on `/clock`."""
        return int(self.get_clock().now().nanoseconds)

    def _log_time(self, received: int) -> int:
        """When a message was received, ns, by the clock of the node."""
        return self._now() if self._by_ros_time or not received else received

    def _poll(self) -> None:
        self._by_ros_time = self.get_clock().ros_time_is_active
        if self._autostart and self._now():
            self._begin_by_itself()
        if self._session is None:
            return
        try:
            news = self._session.poll()
        except ScaraKinetostaticError as error:
            self._fail(error)
            return
        if news:
            self._touches.publish(self._session, news)

    def _report(self) -> Condition:
        """The status; losses and persistent problems are logged, too."""
        losses = [loss for monitor in self._monitors.values() if (loss := monitor.loss())]
        for loss in losses:
            self.get_logger().warning(loss)
        self._look_at_publishers()
        if news := self._frame.news():
            self.get_logger().info(news)
        return self._examine(losses)

    def _examine(self, losses: Sequence[str] = ()) -> Condition:
        values: dict[str, str] = {}
        complaints = [self._frame.complaint()]
        for monitor in self._monitors.values():
            rate = monitor.rate()
            values |= monitor.details(rate)
            complaints += [monitor.complaint(rate, expected=self._session is not None), monitor.mixture()]
        values['wrench frame'] = self._frame.description()
        complaints.append(self._example_cell())
        if self._session is not None:
            values |= self._session.details()
            complaints += [self._session.clock_warning, self._session.room.complaint()]
        if self._failure:
            return Condition(ERROR, f'recording failed: {self._failure}', values)
        if self._autostart:
            complaints.append('waiting for /clock')
        complaints = self._complaints.note(complaints)
        rejections = self._session.rejections() if self._session is not None else ''
        if losses or complaints or rejections:
            return Condition(WARN, '; '.join(filter(None, (*losses, *complaints, rejections))), values)
        return Condition(OK, 'idle' if self._session is None else f'recording to {self._session.folder}', values)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Collector, args, rest=REST)


if __name__ == '__main__':
    sys.exit(main())
