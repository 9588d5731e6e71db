"""Node `calibrator`: estimates the parameters of the model and its effects from recordings, on `~/calibrate`.

The recordings are those that the parameters `recording` and `recordings` name or, if they are empty, those that the
collector has announced on `collector/recording`. The result becomes parameters of the node, a document on `~/result`
and files in the folder `output`, where an earlier result is kept under its date; one that is not fit for use replaces
no earlier one. A calibration runs in a process of its own, so that the node answers meanwhile and `~/cancel` can end
it; there is only one at a time. One that fails does not change the former results.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import CalibrationFileError, ParameterError, ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA, read_document
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.calibration_job import UNFIT, CalibrationProcess, Job
from scara_kinetostatic.nodes.calibrator_parameters import Announced, CalibratorSettings, ResultParameters
from scara_kinetostatic.nodes.cell_node import CALLS, ERROR, OK, WARN, CellNode, Condition, RefusedError
from scara_kinetostatic.nodes.guidance import Guidance
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.results import calibration_json, parameter_file
from scara_kinetostatic.results.parameter_file import StoredResult, load_result


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
        self._condition = Condition(OK, 'no calibration yet', {})
        if self._results.exist:
            facts = self._results.facts()
            self._condition = _condition(facts, _loaded(facts, 'a parameter file'))
            self.say(self._condition.level, self._condition.message)
        taken = 'take the result that is in the folder of the results at the start, as after a crash'
        self._restore = declare.parameter(self, 'restore', False, taken)
        self.create_subscription(String, 'collector/recording', self._note_recording, LATCHED)
        self.create_subscription(String, 'collector/stopped', lambda said: self._announced.stop(said.data), LATCHED)
        self._result = self.create_publisher(String, '~/result', LATCHED)
        self._progress = self.create_publisher(String, '~/progress', LATCHED)
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, '~/calibrate', self._calibrate, qos_profile=CALLS, callback_group=group)
        self.create_service(Trigger, '~/cancel', self._cancel, qos_profile=CALLS, callback_group=group)
        self.serve('load', self._load)
        self._guidance = Guidance(self, self._cell)
        self._timer = self.every(0.05, self._poll)
        self._timer.cancel()
        self.publish_status('calibration', self._report)
        self._restore_result()
        self.get_logger().info(f'ready; call {self.resolve_service_name("~/calibrate")}')

    def close(self) -> None:
        """Ends a calibration that is running; results are written all or nothing."""
        if self._process is not None:
            self._process.close()
            self._end({'error': 'the node is being shut down'})

    def _note_recording(self, message: String, info: dict[str, Any]) -> None:
        if self._announced.note(message.data, info.get('publication_sequence_number')):
            together = ', '.join(self._announced.chosen('session'))
            self.get_logger().info(f'the collector was started anew; recordings of this session: {together}')
        self._restore_result()

    def _restore_result(self) -> None:
        """Takes the result in the folder of the results where it is newer than the present one."""
        if self._restore and self._process is None:
            with suppress(ScaraKinetostaticError, OSError):  # there is none yet
                stored = load_result(self._settings.stored / parameter_file.NAME)
                if str(stored.facts.get('created', '')) > str(self._results.facts().get('created', '')):
                    self._load()

    async def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is not None:
            response.message = 'a calibration is running already; call again when it is done, or ~/cancel'
            return response
        former, self._part = self._condition, 0.0
        try:
            job = self._settings.job()
            self._ended, self._process = Future(), CalibrationProcess(job)
            self._show(f'starting, {", ".join(job.recordings)}', 0.0)
            self._timer.reset()
            ended = await self._ended
            if 'cancelled' in ended:
                response.message, self._condition = ended['cancelled'], former
                self._tell('cancelled', response.message, self._part)
                self.get_logger().warning(response.message)
            elif 'error' in ended:
                self._fail(response, ended['error'])
            else:
                response.success, response.message = self._take(
                    Path(ended['reply']['folder']), ended['reply']['note'], job
                )
        except (ScaraKinetostaticError, OSError) as error:  # OSError: no process can be made
            self._fail(response, str(error))
        return response

    async def _cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is None:
            response.message = 'no calibration is running'
            return response
        self._process.cancel()
        ended = await self._ended
        response.success = 'reply' not in ended
        response.message = 'too late: the calibration was done' if 'reply' in ended else ' '.join(ended.values())
        return response

    def _load(self) -> str:
        """Takes an earlier result, that of the parameter `name`, as the present one."""
        if self._process is not None:
            raise RefusedError('a calibration is running; call again when it is done, or ~/cancel')
        folder = self._settings.stored
        stored = load_result(folder / parameter_file.NAME)
        if stored.facts.get('assessment') == UNFIT and not self._settings['publish_unfit']:
            raise ParameterError(folder, 'the result is unfit for use', 'publish_unfit:=true takes it all the same')
        message = _loaded(stored.facts, str(folder))
        self._publish(stored, folder, self._settings['name'], True, message)
        return message

    def _cell(self) -> Cell | None:
        """That of the parameter `cell`; None where it is empty."""
        return load_cell(declare.place('cell', self._settings['cell'])) if self._settings['cell'] else None

    def _poll(self) -> None:
        """Looks what the running calibration does."""
        news = None if self._process is None else self._process.poll()
        if news is not None and 'progress' in news:
            self._show(**news['progress'])
        elif news is not None:
            self._end(news)

    def _end(self, ended: dict[str, Any]) -> None:
        self._timer.cancel()
        self._process = None
        self._ended.set_result(ended)

    def _show(self, step: str, part: float) -> None:
        self._part = part
        self._condition = Condition(OK, f'calibrating: {step}', {'progress': f'{100 * part:.0f} %'})
        self._tell('running', step, part)

    def _tell(self, state: str, message: str, part: float) -> None:
        """Publishes on `~/progress`."""
        self._progress.publish(String(data=json.dumps({'state': state, 'message': message, 'part': part})))

    def _take(self, folder: Path, note: str, job: Job) -> tuple[bool, str]:
        """Takes the result of a job; name and rules are those with which it was begun.

        Returns:
            Whether it may be used, and the result in one line.
        """
        stored = load_result(folder / parameter_file.NAME)
        facts: Mapping[str, Any] = stored.facts
        is_fit = facts['assessment'] != UNFIT
        published = is_fit or job.publish_unfit
        kept = (
            '' if published else 'the parameters calibrated.* are left as they were; publish_unfit:=true replaces them'
        )
        message = '; '.join(filter(None, (_in_one_line(facts), f'written to {folder}', note, kept)))
        self._publish(stored, folder, job.name, published, message)
        for warning in facts['warnings']:
            self.get_logger().warning(warning)
        self._tell('done', message, 1.0)
        return is_fit, message

    def _publish(self, stored: StoredResult, folder: Path, name: str, published: bool, message: str) -> None:
        """Publishes a result in files: as parameters, on `~/result`, as the status and in the log.

        Raises:
            CalibrationFileError: `calibration.json` cannot be read, or is damaged.
        """
        document = read_document(folder / calibration_json.NAME)
        own = {'name': name, 'published': published, 'message': message, 'files': {'folder': str(folder.absolute())}}
        try:
            text = json.dumps(_summary(document) | own, ensure_ascii=False)
        except (LookupError, TypeError) as error:
            raise CalibrationFileError(
                folder / calibration_json.NAME, f'is damaged: {error!r}', 'calibrate again'
            ) from error
        if published:
            self._results.publish(stored)
            with suppress(CalibrationFileError):  # an old one
                self._guidance.use(CalibrationRecord.of_document(document, folder / calibration_json.NAME))
        self._condition = _condition(stored.facts, message, published)
        self.say(self._condition.level, message)
        self._result.publish(String(data=text))

    def _fail(self, response: Trigger.Response, message: str) -> None:
        """Answers that there is no result."""
        response.message = message
        self._condition = Condition(ERROR, message, {})
        self._tell('failed', message, self._part)
        self.get_logger().error(message)

    def _report(self) -> Condition:
        """The status, with what the present parameters are."""
        facts = self._results.facts()
        present = f'{facts.get("assessment") or "not assessed"}, {_origin(facts)}' if self._results.exist else 'none'
        values = {'present result': present, 'next touch': self._guidance.text or 'none: a cell with limits is needed'}
        return self._condition._replace(values=self._condition.values | values)


def _in_one_line(facts: Mapping[str, Any]) -> str:
    """In one line: grade, what to do, touches, errors before and after, verdict, effects with rivals, warnings."""
    effects = [
        *facts['effects'],
        *(f'possible: {effect}' for effect in facts['possible_effects']),
        *(f'one of ({group})' for group in facts['rivals']),
    ]
    parts = [
        ': '.join([facts['assessment'], *facts['reasons'][:1]]),
        *facts['actions'][:1],
        f'{facts["touches.used"]} of {facts["touches.found"]} touches used',
        f'force error {facts["force_error.nominal"]:.4g} N before, {facts["force_error.calibrated"]:.4g} N after',
        f'reduced chi-square {facts["reduced_chi_square.calibrated"]:.3g}',
        *(f'confounded: {group}' for group in facts['confounded']),
        f'missing effects: {", ".join([facts["verdict"], *effects])}',
    ]
    if effects:
        held_out = facts['held_out_force_error.calibrated'], facts['held_out_force_error.extended']
        parts.append(
            f'with them {facts["force_error.extended"]:.4g} N, '
            f'reduced chi-square {facts["reduced_chi_square.extended"]:.3g}, '
            f'on touches not used {held_out[0]:.4g} N before, {held_out[1]:.4g} N after'
        )
    if warnings := facts['warnings']:
        more = [f'{len(warnings) - 3} more'] if len(warnings) > 3 else []
        parts.append(f'warnings: {"; ".join([*warnings[:3], *more])}')
    return '; '.join(parts)


def _loaded(facts: Mapping[str, Any], where: str) -> str:
    return f'{facts.get("assessment") or "not assessed"}: result loaded from {where}, {_origin(facts)}'


def _origin(facts: Mapping[str, Any]) -> str:
    """When and from what a result was calculated, as far as it says so."""
    parts = [f'of {facts["created"]}'] if facts.get('created') else []
    parts += [f'from {", ".join(facts["recordings"])}'] if facts.get('recordings') else []
    return ', '.join(parts) or 'of unknown origin'


def _condition(facts: Mapping[str, Any], message: str, published: bool = True) -> Condition:
    """The status with a result: by its grade, at least WARN where it is unexplained, or there are warnings."""
    level = {'fit': OK, UNFIT: ERROR}.get(str(facts.get('assessment')), WARN)
    if facts.get('verdict') == 'unexplained' or facts.get('warnings'):
        level = max(level, WARN)
    figures = {
        name: '; '.join(fact) if isinstance(fact, list) else str(fact)
        for name, fact in facts.items()
        if name != 'model'
    }
    return Condition(level, message, figures | {'published': str(published).lower()})


def _summary(document: Document) -> Document:
    """What `~/result` carries of `calibration.json`: all but the single touches and the details of the diagnosis."""
    shared = (
        'created', 'recordings', 'warnings', 'cell', 'parameters', 'model', 'noise', 'force_error',
        'held_out_force_error', 'reduced_chi_square', 'tip_error', 'tip_uncertainty', 'assessment',
    )  # fmt: skip
    parts = {
        'touches': ('found', 'used', 'rejected'),
        'identifiability': ('rank', 'confounded', 'advice'),
        'diagnosis': ('verdict', 'p_value', 'effects', 'possible', 'rivals', 'rival_effects', 'advice'),
    }
    some = {part: {key: document[part][key] for key in keys} for part, keys in parts.items()}
    return {'schema': RESULT_SCHEMA, **{key: document[key] for key in shared}, **some}
