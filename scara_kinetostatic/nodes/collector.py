"""Node `collector`: records the two topics of a cell and counts the touches.

Every message goes into the bag as it came. The same messages go through the
touch detection; a touch is counted on `~/touches` only when the bag holds it
durably, and published on `~/touch` with its judgement. Services `~/start` and
`~/stop` begin and end a recording, each in a new folder, which is announced on
`~/recording`; `~/discard_last` discards a touch. A full or vanished disk ends
the recording, not the node; so does a folder that cannot be written to. What
would spoil a recording is said at once: several publishers on a topic, clocks
that differ, touches that are rejected, a disk that will be full.

Messages are logged at the time at which the middleware received them. With
`use_sim_time` they are logged by the clock of the node, and there is no recording before the first message on `/clock`.
Touches are looked for by steady time.
"""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import String, UInt32

from scara_kinetostatic.nodes.cell_node import ERROR, LASTING, OK, WARN, Condition, RefusedError
from scara_kinetostatic.nodes.session import JudgedTouch, RecordingNode, Session
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, CellStreams


class Collector(RecordingNode):
    """Records on request.

    Raises:
        InputError: a parameter or the cell is not valid.
    """

    rest = 0.005  # messages of 1 kHz are taken several at a time

    def __init__(self) -> None:
        super().__init__('collector')
        self._cell = self.cell_or_example()
        self._autostart = self.value('autostart')
        self._lost_before, self._failure = 0, ''
        self._touches = self.create_publisher(UInt32, '~/touches', LATCHED)
        self._touch = self.create_publisher(DiagnosticArray, '~/touch', LATCHED_TOUCHES)
        self._recording = self.create_publisher(String, '~/recording', LATCHED)
        self._streams = CellStreams(self, self._cell, self._take_transforms, judges=True)
        self._streams.subscribe(self._record)
        self.serve('start', self._start)
        self.serve('stop', self._stop)
        self.serve('discard_last', self._discard_last)
        self.every(0.1, self._poll)
        self.publish_status('recording', self._examine)
        if not self._autostart:
            self.get_logger().info(f'not recording yet; call {self.resolve_service_name("~/start")}')
        elif not self.now():
            self.get_logger().warning('use_sim_time is set: recording begins with the first message on /clock')
        else:
            with self._guarded():
                self._begin()

    def close(self) -> None:
        """Ends the recording, so that the bag is complete."""
        if self._session is not None:
            self.get_logger().info(self._end())

    def _start(self) -> str:
        if self._session is not None:
            raise RefusedError(f'recording already, to {self._session.folder}; call ~/stop first')
        if not self.now():
            raise RefusedError('parameter use_sim_time is set, but there is no message on /clock; publish it')
        with self._guarded():
            self._begin()
        return self._with_warnings(f'recording to {self._running().folder}')

    def _stop(self) -> str:
        answer = self._end()
        if self._failure or any(monitor.problem for monitor in self._streams.monitors.values()):
            raise RefusedError(answer)
        return answer

    def _discard_last(self) -> str:
        session, touch = self._running(), None
        with self._guarded():
            touch = session.discard_last(self.now())
        self._running()
        if touch is None:
            raise RefusedError('there is no accepted touch to discard')
        self._publish(session, [touch])
        return f'touch {touch.number} ({touch.object}) discarded; {session.touches} touches left'

    def _lost(self, reason: str) -> None:
        self._failure = reason
        self.get_logger().error(f'recording failed: {reason}')

    def _running(self) -> Session:
        """The recording.

        Raises:
            RefusedError: there is none.
        """
        if self._session is None:
            raise RefusedError(self._failure or 'nothing is being recorded; call ~/start first')
        return self._session

    def _publish(self, session: Session, judged: Sequence[JudgedTouch] = ()) -> None:
        """Publishes touches of a recording, and how many it has; logs them."""
        name, frame = self.get_fully_qualified_name(), self._cell.sensor.frame.value
        for touch in judged:
            self._touch.publish(touch.message(name, str(session.folder), frame))
            self.say(WARN if touch.reason else OK, touch.line)
        self._touches.publish(UInt32(data=session.touches))

    def _begin(self) -> None:
        self._autostart = False
        parent = self.place('output', self.value('output')).absolute()
        self._session = Session(parent, self._cell, self.now(), self._streams)
        self._streams.look_at_publishers()
        self._lost_before, self._failure = self._messages_lost(), ''
        self._publish(self._session)
        self._recording.publish(String(data=str(self._session.folder)))
        self.get_logger().info(f'recording to {self._session.folder}')

    def _end(self) -> str:
        """Completes the bag; returns its contents in one line."""
        session = self._running()
        with self._guarded():
            self._publish(session, session.close())
            self._session = None
        if self._failure:
            return f'{session.folder}: {self._failure}'
        lost = self._messages_lost() - self._lost_before
        loss = f'; {lost} messages were lost on the way' if lost else ''
        counted = f'{session.touches} touches ({session.rejected} more rejected) in {session.folder}{loss}'
        return self._with_warnings('; '.join(filter(None, (counted, session.rejections(), session.clock_warning))))

    def _with_warnings(self, answer: str) -> str:
        """The answer of a service, with what spoils the data."""
        monitors = self._streams.monitors.values()
        spoilt = [each.mixture() or (each.problem and f'{each.topic}: {each.problem}') for each in monitors]
        spoilt += [self._streams.frame.complaint(), self._example_cell()]
        return '; '.join(filter(None, (answer, *spoilt)))

    def _example_cell(self) -> str:
        """That a robot other than the simulated one is taken for the example cell; empty if it is not."""
        problem = 'the parameter cell is empty: the robot is taken for the example cell of figure 3'
        return f'{problem}; name its cell description' if self._streams.is_taken_for_the_example else ''

    def _messages_lost(self) -> int:
        return sum(monitor.lost for monitor in self._streams.monitors.values())

    def _take_transforms(self, message: bytes, anew: bool) -> None:
        """Records fixed transforms; touches before them are told as they were judged."""
        session = self._session
        if session is None:
            return
        with self._guarded():
            self._publish(session, session.take_transforms(message, self.now(), anew))
        if anew and session.touches + session.rejected:
            last, how = session.touches + session.rejected - 1, self._streams.frame.description()
            text = f'/tf_static came after touch {last}: {how}; a calibration turns the forces before as well'
            self.get_logger().warning(text)

    def _poll(self) -> None:
        if self._autostart and self.now():
            with self._guarded():
                self._begin()
        if (session := self._session) is None:
            return
        with self._guarded():
            if news := session.poll():
                self._publish(session, news)

    def _examine(self) -> Condition:
        """The status; persistent problems are logged, too."""
        session = self._session
        complaints, values = self._streams.examine(expected=session is not None)
        complaints.append(self._example_cell())
        rejections = ''
        with self._guarded():
            if session is not None:
                values |= session.details()
                complaints += [session.clock_warning, session.disk_warning()]
                rejections = session.rejections()
        if self._failure:
            return Condition(ERROR, f'recording failed: {self._failure}', values)
        waiting = 'waiting for /clock' if self._autostart else ''
        if problems := list(filter(None, [*complaints, waiting, rejections])):
            self.get_logger().warning('; '.join(problems), **LASTING)
            return Condition(WARN, '; '.join(problems), values)
        return Condition(OK, 'idle' if session is None else f'recording to {session.folder}', values)
