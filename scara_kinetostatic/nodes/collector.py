"""Node `collector`: records the two topics of a cell and counts the touches.

Every message goes into the bag as it came. The same messages go through the
touch detection; a touch is counted on `~/touches` only when the bag holds it
durably. Services `~/start` and `~/stop` begin and end a recording, each in a
new folder, which is announced on `~/recording`. A full or vanished disk ends
the recording, not the node; so does a folder that cannot be written to.

Messages are logged by the clock of the node. With `use_sim_time` there is no
recording before the first message on `/clock`. Touches are looked for by steady time.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String, UInt32
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import ParameterError, ScaraKinetostaticError
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.conversion import Sample, UnusableMessageError, joint_sample, wrench_sample
from scara_kinetostatic.nodes.declare import cell_or_example
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.session import Session, Stream
from scara_kinetostatic.nodes.stream_monitor import StreamMonitor
from scara_kinetostatic.nodes.stream_subscription import LATCHED, StreamSubscription

POLL = 0.1
"""Period of the search for finished touches, s."""
REST = 0.005
"""Between two callbacks, s: messages of 1 kHz are taken ten at a time."""
PERSISTENT = 3
"""Consecutive reports of the same problem after which it is logged, too."""


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
        sensor = self._cell.sensor
        self._monitors = {
            Stream.JOINTS: StreamMonitor(sensor.joint_states),
            Stream.WRENCH: StreamMonitor(sensor.wrench),
        }
        self._session: Session | None = None
        self._lost_before = 0
        self._failure = ''
        self._complaint, self._complained = '', 0
        self._touches = self.create_publisher(UInt32, '~/touches', LATCHED)
        self._recording = self.create_publisher(String, '~/recording', LATCHED)
        for stream, kind in ((Stream.JOINTS, JointState), (Stream.WRENCH, WrenchStamped)):
            monitor = self._monitors[stream]
            StreamSubscription(self, kind, monitor.topic, partial(self._receive, stream), monitor.lose)
        self.create_service(Trigger, '~/start', self._start)
        self.create_service(Trigger, '~/stop', self._stop)
        self.create_timer(POLL, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))
        DiagnosticsPublisher(self, 'recording', self._report)
        if not self._autostart:
            self.get_logger().info(f'not recording yet; call {self.resolve_service_name("~/start")}')
        elif not self._now():
            self.get_logger().warning('use_sim_time is set: recording begins with the first message on /clock')
        else:
            self._begin_by_itself()

    def close(self) -> None:
        """Ends the recording, so that the bag is complete."""
        if self._session is not None:
            self.get_logger().info(self._end())

    def _start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._session is not None:
            response.message = f'recording already, to {self._session.folder}; call ~/stop first'
            return response
        try:
            response.message = self._begin()
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
        response.message = self._end()
        response.success = not self._failure
        self.get_logger().info(response.message)
        return response

    def _begin_by_itself(self) -> None:
        self._autostart = False
        try:
            self.get_logger().info(self._begin())
        except ScaraKinetostaticError as error:
            self._fail(error)

    def _begin(self) -> str:
        now = self._now()
        if not now:
            raise ParameterError('parameter use_sim_time', 'set, but there is no message on /clock', 'publish /clock')
        parent = declare.place('output', str(self.get_parameter('output').value)).absolute()
        self._session = Session(parent, self._cell, now)
        self._lost_before = self._lost()
        self._autostart = False
        self._failure = ''
        self._touches.publish(UInt32(data=0))
        self._recording.publish(String(data=str(self._session.folder)))
        return f'recording to {self._session.folder}'

    def _end(self) -> str:
        """Completes the bag; returns its contents in one line."""
        session, self._session = self._session, None
        assert session is not None
        try:
            self._log(session.close())
        except ScaraKinetostaticError as error:
            self._fail(error)
            return f'{session.folder}: {error}'
        self._touches.publish(UInt32(data=session.touches))
        lost = self._lost() - self._lost_before
        loss = f'; {lost} messages were lost on the way' if lost else ''
        return f'{session.touches} touches ({session.rejected} more rejected) in {session.folder}{loss}'

    def _lost(self) -> int:
        return sum(monitor.lost for monitor in self._monitors.values())

    def _fail(self, error: Exception) -> None:
        """Ends the recording; the node goes on."""
        if self._session is not None:
            self._session.abandon()
        self._session = None
        self._failure = ' '.join(str(error).split())
        self.get_logger().error(f'recording failed: {self._failure}')

    def _receive(self, stream: Stream, message: bytes) -> None:
        """Takes a message in: all go into the bag, the usable ones to the touch detection, too."""
        try:
            sample = self._convert(stream, message)
            self._monitors[stream].accept(sample.stamp_ns)
        except UnusableMessageError as error:
            sample = None
            self._monitors[stream].refuse(str(error))
        if self._session is not None:
            try:
                self._session.take(stream, message, self._now(), sample)
            except ScaraKinetostaticError as error:
                self._fail(error)

    def _convert(self, stream: Stream, message: bytes) -> Sample:
        if stream is Stream.JOINTS:
            return joint_sample(message, self._cell.joint_names)
        return wrench_sample(message)

    def _now(self) -> int:
        """Time of the node's clock, ns; 0 before the first message on `/clock`."""
        return int(self.get_clock().now().nanoseconds)

    def _poll(self) -> None:
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
            self._log(news)
            self._touches.publish(UInt32(data=self._session.touches))

    def _log(self, lines: list[str]) -> None:
        for line in lines:
            self.get_logger().info(line)

    def _report(self) -> Condition:
        """The status; losses and persistent problems are logged, too."""
        losses = [loss for monitor in self._monitors.values() if (loss := monitor.loss())]
        for loss in losses:
            self.get_logger().warning(loss)
        condition = self._examine(losses)
        complaint = condition.message if condition.level == WARN else ''
        self._complained = self._complained + 1 if complaint == self._complaint else 1
        self._complaint = complaint
        if complaint and self._complained == PERSISTENT:
            self.get_logger().warning(complaint)
        return condition

    def _examine(self, losses: Sequence[str] = ()) -> Condition:
        values: dict[str, str] = {}
        complaints = list(losses)
        for monitor in self._monitors.values():
            rate = monitor.rate()
            values |= monitor.details(rate)
            complaints.append(monitor.complaint(rate, expected=self._session is not None))
        if self._session is not None:
            values |= self._session.details()
        if self._failure:
            return Condition(ERROR, f'recording failed: {self._failure}', values)
        if self._autostart:
            complaints.append('waiting for /clock')
        if any(complaints):
            return Condition(WARN, '; '.join(filter(None, complaints)), values)
        return Condition(OK, 'idle' if self._session is None else f'recording to {self._session.folder}', values)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Collector, args, rest=REST)


if __name__ == '__main__':
    sys.exit(main())
