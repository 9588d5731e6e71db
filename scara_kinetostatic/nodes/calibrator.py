"""Node `calibrator`: estimates the parameters of the model and its effects from recordings, on `~/calibrate`.

The recordings are those that the parameters `recording` and `recordings` name or, if they are empty, those that the
collector has announced on `collector/recording`. The result becomes parameters of the node, a document on `~/result`
and files in the folder `output`, where an earlier result is kept under its date; one that is not fit for use replaces
no earlier one. A calibration runs in a process of its own, so that the node answers meanwhile and `~/cancel` can end
it; there is only one at a time. One that fails does not change the former results.
"""

from __future__ import annotations

import json
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.calibration.fixed import parse_fixed
from scara_kinetostatic.errors import ParameterError, RecordingError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.announced import CHOICES, SESSION, Announced
from scara_kinetostatic.nodes.calibration_job import UNFIT, Job, Reply
from scara_kinetostatic.nodes.calibration_process import CalibrationProcess, Progress
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.outcome_text import summary, warnings_in_line
from scara_kinetostatic.nodes.result_parameters import ResultParameters
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.stream_subscription import LATCHED
from scara_kinetostatic.report.parameter_file import EffectParameter
from scara_kinetostatic.touches.left_out import parse_left_out

POLL = 0.05
"""Between two looks at the process that calibrates, s."""
LEVELS = {Grade.FIT.value: OK, Grade.CAUTION.value: WARN, Grade.UNFIT.value: ERROR}
"""The level of a result."""
_NAME = re.compile(r'[A-Za-z0-9_-][A-Za-z0-9._-]*')


class Calibrator(Node):
    """Calibrates on request. One thread spins it.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
        ParameterError: a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__('calibrator')
        self._declare()
        self._results = ResultParameters(self)
        self.add_on_set_parameters_callback(_check_parameters)
        self._announced = Announced()
        self._process: CalibrationProcess | None = None
        self._ended = Future()
        self._condition = self._loaded()
        self.create_subscription(String, 'collector/recording', self._note_recording, LATCHED)
        self._result = self.create_publisher(String, '~/result', LATCHED)
        self._progress = self.create_publisher(String, '~/progress', LATCHED)
        self.create_service(Trigger, '~/calibrate', self._calibrate, callback_group=ReentrantCallbackGroup())
        self.create_service(Trigger, '~/cancel', self._cancel, callback_group=ReentrantCallbackGroup())
        self._timer = self.create_timer(POLL, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()
        DiagnosticsPublisher(self, 'calibration', self._report)
        self.get_logger().info(f'ready; call {self.resolve_service_name("~/calibrate")}')

    def _declare(self) -> None:
        cell = 'cell description (YAML file); empty: the one in the recordings'
        _check('cell', declare.text(self, 'cell', '', cell, read_only=False))
        declare.text(self, 'recording', '', 'recording to calibrate from', read_only=False)
        more = 'recordings to calibrate from together; if recording is empty, too: those announced by the collector'
        declare.texts(self, 'recordings', more, read_only=False)
        which = '; '.join(f'{choice}: {meaning}' for choice, meaning in CHOICES.items())
        announced = f'which of the recordings announced by the collector ({which})'
        _check('announced', declare.text(self, 'announced', SESSION, announced, read_only=False))
        left_out = (
            'what to leave out: touches such as 5 or 10-14, those of one recording as touches_1:5, or a recording'
        )
        _check('leave_out', declare.texts(self, 'leave_out', left_out, read_only=False))
        output = 'folder for the results; empty: beside the last recording, with _calibration after its name'
        declare.text(self, 'output', '', output, read_only=False)
        name = 'name under which the result is kept: a folder in that of the results; empty: that folder itself'
        _check('name', declare.text(self, 'name', '', name, read_only=False))
        unfit = 'whether a result that is not fit for use replaces an earlier one in parameters and files'
        declare.switch(self, 'publish_unfit', False, unfit, read_only=False)
        fixed = 'parameters to hold, such as l1=0.3302, g_ee (at its nominal value) or object_radius[disc_2].radius=0'
        _check('fixed', declare.texts(self, 'fixed', fixed, read_only=False))

    def close(self) -> None:
        """Ends a calibration that is running; results are written all or nothing."""
        if self._process is not None:
            self._process.close()
            self._end('the node is being shut down')

    def _note_recording(self, message: String, info: dict[str, Any]) -> None:
        if self._announced.note(message.data, info.get('publication_sequence_number')):
            together = ', '.join(self._announced.chosen(SESSION))
            self.get_logger().info(f'the collector was started anew; recordings of this session: {together}')

    async def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is not None:
            response.message = 'a calibration is running already; call again when it is done, or ~/cancel'
            return response
        former = self._condition
        try:
            ended = await self._run(self._job())
            if isinstance(ended, Reply):
                response.success, response.message = self._publish(ended)
            elif ended.startswith('cancelled'):
                response.message, self._condition = ended, former
                self._tell('cancelled', ended)
                self.get_logger().warning(ended)
            else:
                self._fail(response, ended)
        except ScaraKinetostaticError as error:
            self._fail(response, str(error))
        except Exception as error:  # The node stays up, whatever happens in a calibration.
            self._fail(response, f'internal error: {type(error).__name__}: {error}')
            self.get_logger().debug(traceback.format_exc())
        return response

    async def _run(self, job: Job) -> Reply | str:
        """The reply to a job, or why there is none."""
        self._ended = Future()
        self._process = CalibrationProcess(job)
        self._show(Progress(f'starting, {", ".join(job.recordings)}', 0.0))
        self._timer.reset()
        return await self._ended

    async def _cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is None:
            response.message = 'no calibration is running'
            return response
        self._process.cancel()
        ended = await self._ended
        response.success = not isinstance(ended, Reply)
        response.message = str(ended) if response.success else 'too late: the calibration was done'
        return response

    def _poll(self) -> None:
        """Looks what the running calibration does."""
        news = None if self._process is None else self._process.poll()
        if isinstance(news, Progress):
            self._show(news)
        elif news is not None:
            self._end(news)

    def _end(self, ended: Reply | str) -> None:
        self._timer.cancel()
        self._process = None
        self._ended.set_result(ended)

    def _show(self, progress: Progress) -> None:
        self._condition = Condition(OK, f'calibrating: {progress.step}', {'progress': f'{100 * progress.part:.0f} %'})
        self._tell('running', progress.step, progress.part)

    def _tell(self, state: str, message: str, part: float = 1.0) -> None:
        """Publishes on `~/progress`."""
        self._progress.publish(String(data=json.dumps({'state': state, 'message': message, 'part': part})))

    def _publish(self, reply: Reply) -> tuple[bool, str]:
        """Publishes a result.

        Returns:
            Whether it may be used, and the result in one line.
        """
        take = reply.grade != UNFIT or bool(self.get_parameter('publish_unfit').value)
        if take:
            effects = [EffectParameter(tuple(path), *rest) for path, *rest in reply.effects]
            self._results.publish(reply.values, reply.deviations, effects, reply.facts)
        where = f'files not written: {reply.unwritten}' if reply.unwritten else f'written to {reply.folder}'
        kept = '' if take else 'the parameters calibrated.* are left as they were; publish_unfit:=true replaces them'
        message = '; '.join(filter(None, (reply.line, warnings_in_line(reply.warnings), where, reply.note, kept)))
        level = LEVELS[reply.grade]
        if reply.verdict == 'unexplained' or reply.warnings or reply.unwritten:
            level = max(level, WARN)
        self._condition = Condition(level, message, reply.details | {'published': str(take).lower()})
        self._log(level, message)
        for warning in reply.warnings:
            self.get_logger().warning(warning)
        files = {'folder': None if reply.unwritten else str(Path(reply.folder).absolute())}
        own = {'name': str(self.get_parameter('name').value), 'published': take, 'message': message, 'files': files}
        self._result.publish(String(data=json.dumps(summary(reply.document) | own, ensure_ascii=False)))
        self._tell('done', message)
        return reply.grade != UNFIT, message

    def _log(self, level: bytes, message: str) -> None:
        logger = self.get_logger()
        if level == ERROR:
            logger.error(message)
        elif level == WARN:
            logger.warning(message)
        else:
            logger.info(message)

    def _fail(self, response: Trigger.Response, message: str) -> None:
        """Answers that there is no result."""
        response.message = message
        self._condition = Condition(ERROR, message, {})
        self._tell('failed', message)
        self.get_logger().error(message)

    def _loaded(self) -> Condition:
        """The status at the start: whether there is a result of an earlier calibration, from a parameter file."""
        if not self._results.exist:
            return Condition(OK, 'no calibration yet', {})
        grade = self._results.fact('assessment')
        if grade not in LEVELS:
            return Condition(WARN, 'result loaded from a parameter file that does not say how it was assessed', {})
        message = f'result loaded from a parameter file, {grade}, {self._origin()}'
        level = LEVELS[str(grade)]
        self._log(level, message)
        return Condition(max(level, WARN) if self._results.fact('verdict') == 'unexplained' else level, message, {})

    def _origin(self) -> str:
        """When and from what the present result was calculated."""
        sources = self._results.fact('recordings')
        return f'of {self._results.fact("created")}, from {", ".join(sources if isinstance(sources, list) else [])}'

    def _report(self) -> Condition:
        """The status, with what the present parameters are."""
        if not self._results.exist:
            return self._condition._replace(values=self._condition.values | {'present result': 'none'})
        present = f'{self._results.fact("assessment") or "not assessed"}, {self._origin()}'
        return self._condition._replace(values=self._condition.values | {'present result': present})

    def _job(self) -> Job:
        """What the parameters tell to do.

        Raises:
            InputError: no recording is named, or one is not there.
        """
        recordings, joined = self._recordings()
        paths = [declare.place('recording', recording) for recording in recordings]
        for path in paths:
            if not path.exists():
                raise RecordingError(path, 'there is no such recording', 'check the path')
        cell = str(self.get_parameter('cell').value)
        return Job(
            recordings=list(map(str, paths)),
            joined=joined,
            cell=str(declare.place('cell', cell)) if cell else '',
            fixed=self._texts('fixed'),
            left_out=self._texts('leave_out'),
            output=str(self._output(paths[-1])),
            publish_unfit=bool(self.get_parameter('publish_unfit').value),
        )

    def _recordings(self) -> tuple[list[str], bool]:
        """The recordings, and whether they were put together without being named."""
        named = [*filter(None, [str(self.get_parameter('recording').value)]), *self._texts('recordings')]
        chosen = named or self._announced.chosen(str(self.get_parameter('announced').value))
        if not chosen:
            raise ParameterError(
                'parameter recording', 'no recording is named, and no collector has announced one', 'set it'
            )
        return chosen, not named and len(chosen) > 1

    def _texts(self, name: str) -> list[str]:
        return [str(text) for text in self.get_parameter(name).value or [] if str(text).strip()]

    def _output(self, recording: Path) -> Path:
        named = str(self.get_parameter('output').value)
        beside = recording.absolute().with_name(f'{recording.absolute().name}_calibration')
        return (declare.place('output', named) if named else beside) / str(self.get_parameter('name').value)


def _check(name: str, value: Any) -> None:
    """Check the value of a parameter.

    Raises:
        InputError: it makes no sense.
    """
    where = f'parameter {name}'
    listed = [str(item) for item in value or [] if str(item).strip()] if isinstance(value, (list, tuple)) else []
    if name == 'cell' and value:
        load_cell(declare.place(name, str(value)))
    elif name == 'announced' and value not in CHOICES:
        raise ParameterError(where, f'expected {", ".join(CHOICES)}, got {value!r}')
    elif name == 'name' and value and not _NAME.fullmatch(str(value)):
        raise ParameterError(where, f'expected letters, digits, . _ or -, got {value!r}')
    elif name == 'leave_out':
        parse_left_out(listed, where)
    elif name == 'fixed':
        for text in listed:
            parse_fixed(text, f'{where}:')


def _check_parameters(parameters: list[Parameter]) -> SetParametersResult:
    """Refuses values that cannot be used."""
    try:
        for parameter in parameters:
            _check(parameter.name, parameter.value)
    except ScaraKinetostaticError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Calibrator, args)


if __name__ == '__main__':
    sys.exit(main())
