"""Node `calibrator`: estimates the parameters of the model and its effects from recordings, on `~/calibrate`.

The recordings are those that the parameters `recording` and `recordings` name or, if they are empty, those that the
collector has announced on `collector/recording`. The result becomes parameters of the node, a document on `~/result`
and files in the folder `output`, where an earlier result is kept under its date; one that is not fit for use replaces
no earlier one. A calibration runs in a process of its own, so that the node answers meanwhile and `~/cancel` can end
it; there is only one at a time. One that fails does not change the former results.
"""

from __future__ import annotations

import json
import traceback
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import ParameterError, ScaraKinetostaticError
from scara_kinetostatic.nodes.calibration_job import (
    CANCELLED,
    UNFIT,
    CalibrationProcess,
    Job,
    Progress,
    Reply,
    stored_document,
    summary,
    warnings_in_line,
)
from scara_kinetostatic.nodes.calibrator_parameters import Announced, CalibratorSettings, ResultParameters
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN, CellNode, Condition, RefusedError
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.results import parameter_file
from scara_kinetostatic.results.parameter_file import EffectParameter, load_result

_LEVELS = {'fit': OK, 'caution': WARN, UNFIT: ERROR}
"""The level of a result by its grade."""


class Calibrator(CellNode):
    """Calibrates on request. One thread spins it.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
        ParameterError: a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__('calibrator')
        self._announced = Announced()
        self._settings = CalibratorSettings(self, self._announced)
        self._results = ResultParameters(self)
        self._process: CalibrationProcess | None = None
        self._part = 0.0
        self._ended = Future()
        self._condition = self._loaded('a parameter file')
        self.create_subscription(String, 'collector/recording', self._note_recording, LATCHED)
        self.create_subscription(String, 'collector/stopped', lambda said: self._announced.stop(said.data), LATCHED)
        self._result = self.create_publisher(String, '~/result', LATCHED)
        self._progress = self.create_publisher(String, '~/progress', LATCHED)
        self.create_service(Trigger, '~/calibrate', self._calibrate, callback_group=ReentrantCallbackGroup())
        self.create_service(Trigger, '~/cancel', self._cancel, callback_group=ReentrantCallbackGroup())
        self.serve('load', self._load)
        self._timer = self.every(0.05, self._poll)
        self._timer.cancel()
        self.publish_status('calibration', self._report)
        self.get_logger().info(f'ready; call {self.resolve_service_name("~/calibrate")}')

    def close(self) -> None:
        """Ends a calibration that is running; results are written all or nothing."""
        if self._process is not None:
            self._process.close()
            self._end('the node is being shut down')

    def _note_recording(self, message: String, info: dict[str, Any]) -> None:
        if self._announced.note(message.data, info.get('publication_sequence_number')):
            together = ', '.join(self._announced.chosen('session'))
            self.get_logger().info(f'the collector was started anew; recordings of this session: {together}')

    async def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is not None:
            response.message = 'a calibration is running already; call again when it is done, or ~/cancel'
            return response
        former, self._part = self._condition, 0.0
        try:
            job = self._settings.job()
            ended = await self._run(job)
            if isinstance(ended, Reply):
                response.success, response.message = self._publish(ended, job)
            elif ended == CANCELLED:
                response.message, self._condition = ended, former
                self._tell('cancelled', ended, self._part)
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

    def _load(self) -> str:
        """Takes an earlier result, that of the parameter `name`, as the present one."""
        if self._process is not None:
            raise RefusedError('a calibration is running; call again when it is done, or ~/cancel')
        folder = self._settings.stored
        stored = load_result(folder / parameter_file.NAME)
        if stored.facts.get('assessment') == UNFIT and not self._settings.publishes_unfit:
            raise ParameterError(folder, 'the result is unfit for use', 'publish_unfit:=true takes it all the same')
        self._results.publish(*stored)
        self._condition = self._loaded(str(folder))
        message = self._condition.message
        if document := stored_document(folder):
            self._publish_document(document, folder, self._settings.name, True, message)
            return message
        return f'{message}; ~/result is as it was: no calibration.json there'

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
        self._part = progress.part
        self._condition = Condition(OK, f'calibrating: {progress.step}', {'progress': f'{100 * progress.part:.0f} %'})
        self._tell('running', progress.step, progress.part)

    def _tell(self, state: str, message: str, part: float) -> None:
        """Publishes on `~/progress`."""
        self._progress.publish(String(data=json.dumps({'state': state, 'message': message, 'part': part})))

    def _publish(self, reply: Reply, job: Job) -> tuple[bool, str]:
        """Publishes a result; name and rules are those with which it was begun.

        Returns:
            Whether it may be used, and the result in one line.
        """
        take = reply.grade != UNFIT or job.publish_unfit
        if take:
            effects = [EffectParameter(tuple(path), *rest) for path, *rest in reply.effects]
            self._results.publish(reply.values, reply.deviations, effects, reply.facts)
        where = f'files not written: {reply.unwritten}' if reply.unwritten else f'written to {reply.folder}'
        kept = '' if take else 'the parameters calibrated.* are left as they were; publish_unfit:=true replaces them'
        message = '; '.join(filter(None, (reply.line, warnings_in_line(reply.warnings), where, reply.note, kept)))
        level = _LEVELS[reply.grade]
        if reply.verdict == 'unexplained' or reply.warnings or reply.unwritten:
            level = max(level, WARN)
        figures = {
            name: '; '.join(fact) if isinstance(fact, list) else str(fact)
            for name, fact in reply.facts.items()
            if name != 'model'
        }
        self._condition = Condition(level, message, figures | {'published': str(take).lower()})
        self.say(level, message)
        for warning in reply.warnings:
            self.get_logger().warning(warning)
        folder = None if reply.unwritten else Path(reply.folder)
        self._publish_document(reply.document, folder, job.name, take, message)
        self._tell('done', message, 1.0)
        return reply.grade != UNFIT, message

    def _publish_document(
        self, document: dict[str, Any], folder: Path | None, name: str, published: bool, message: str
    ) -> None:
        """Publishes on `~/result`."""
        own = {
            'name': name,
            'published': published,
            'message': message,
            'files': {'folder': None if folder is None else str(folder.absolute())},
        }
        self._result.publish(String(data=json.dumps(summary(document) | own, ensure_ascii=False)))

    def _fail(self, response: Trigger.Response, message: str) -> None:
        """Answers that there is no result."""
        response.message = message
        self._condition = Condition(ERROR, message, {})
        self._tell('failed', message, self._part)
        self.get_logger().error(message)

    def _loaded(self, where: str) -> Condition:
        """The status with a result of an earlier calibration, or with none.

        Args:
            where: the result comes from.
        """
        if not self._results.exist:
            return Condition(OK, 'no calibration yet', {})
        grade = self._results.fact('assessment')
        if grade not in _LEVELS:
            return Condition(WARN, f'result loaded from {where}, which does not say how it was assessed', {})
        level = _LEVELS[str(grade)]
        if self._results.fact('verdict') == 'unexplained':
            level = max(level, WARN)
        message = f'{grade}: result loaded from {where}, {self._origin()}'
        self.say(level, message)
        return Condition(level, message, {})

    def _origin(self) -> str:
        """When and from what the present result was calculated, as far as it says so."""
        created, sources = self._results.fact('created'), self._results.fact('recordings')
        parts = [f'of {created}'] if created else []
        parts += [f'from {", ".join(sources)}'] if isinstance(sources, list) else []
        return ', '.join(parts) or 'of unknown origin'

    def _report(self) -> Condition:
        """The status, with what the present parameters are."""
        if not self._results.exist:
            return self._condition._replace(values=self._condition.values | {'present result': 'none'})
        present = f'{self._results.fact("assessment") or "not assessed"}, {self._origin()}'
        return self._condition._replace(values=self._condition.values | {'present result': present})
