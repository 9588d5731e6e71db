"""Node `calibrator`: estimates the parameters of the model and its effects from recordings, on `~/calibrate`.

The recordings are those that the parameters `recording` and `recordings` name or, if they are empty, the one that the
collector has announced last on `collector/recording`. The result becomes parameters of the node, a document on
`~/result` and files in the folder `output`, where an earlier result is kept under its date; one that is not fit for use
replaces no earlier one. A calibration runs in a process of its own, so that the node answers meanwhile and `~/cancel`
can end it; there is only one at a time. One that fails does not change the former results.

The parameters `calibrated.<name>` and `calibrated_std.<name>` exist once there is a result, from a calibration or from
a parameter file of an earlier one, and the node alone changes them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.errors import ParameterError, RecordingError, ScaraKinetostaticError
from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA, read_document
from scara_kinetostatic.model.parameters import DESCRIPTIONS, UNITS
from scara_kinetostatic.nodes.calibration_job import UNFIT, CalibrationProcess, Job
from scara_kinetostatic.nodes.cell_node import CALLS, ERROR, OK, WARN, CellNode, Condition, RefusedError
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.report.page import Document
from scara_kinetostatic.results.document import FACTS, GROUP, JSON, YAML, StoredResult, load_result

_RESULT = {
    **{f'calibrated.{name}': f'{DESCRIPTIONS[name]}, {unit}' for name, unit in UNITS.items()},
    **{f'calibrated_std.{name}': f'standard deviation of {name}, {unit}' for name, unit in UNITS.items()},
}
"""Description of the parameters of a result."""


class Calibrator(CellNode):
    """Calibrates on request. One thread spins it.

    Raises:
        ParameterError: a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__('calibrator')
        self._announced = ''
        self._facts = self._given_facts()
        self._writing = False
        self._process: CalibrationProcess | None = None
        self._ended = Future()
        self._condition = Condition(OK, 'no calibration yet', {})
        if self._has_result:
            self._condition = _condition(self._facts, f'{self._present()}: loaded from a parameter file')
            self.say(self._condition.level, self._condition.message)
        self.create_subscription(String, 'collector/recording', self._note_recording, LATCHED)
        self._result = self.create_publisher(String, '~/result', LATCHED)
        self._progress, self._part = self.create_publisher(String, '~/progress', LATCHED), 0.0
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, '~/calibrate', self._calibrate, qos_profile=CALLS, callback_group=group)
        self.create_service(Trigger, '~/cancel', self._cancel, qos_profile=CALLS, callback_group=group)
        self._timer = self.every(0.05, self._poll)
        self._timer.cancel()
        self.publish_status('calibration', self._report)
        self.get_logger().info(f'ready; call {self.resolve_service_name("~/calibrate")}')

    def _given_facts(self) -> dict[str, Any]:
        """What the result in a parameter file is made from and worth, by the names of `FACTS`, as far as it says so.

        Raises:
            InvalidParameterTypeException: a parameter has another type.
            ParameterError: so has a fact, or a parameter of the base model is not finite.
        """
        given = self._parameter_overrides
        self._writing = True
        for full in _RESULT.keys() & given.keys():
            self._declare_result(full)
            if full.startswith('calibrated.') and not math.isfinite(given[full].value):
                raise ParameterError(f'parameter {full}', f'expected a finite number, got {given[full].value}')
        found = {name: given[f'{GROUP}.{name}'].value for name in FACTS if f'{GROUP}.{name}' in given}
        for name, value in found.items():
            fact = FACTS[name]
            if not isinstance(value, fact.kind) or (
                isinstance(value, list) and not all(isinstance(v, str) for v in value)
            ):
                raise ParameterError(f'parameter {GROUP}.{name}', f'expected {fact.meaning}, got {value!r:.40}')
        return found

    @property
    def _has_result(self) -> bool:
        return bool(self.has_parameter('calibrated.l1'))

    def _publish_parameters(self, result: StoredResult) -> None:
        """Sets all of them at once; those that the result has not, as of gravity, are removed."""
        named: dict[str, float] = {}
        for start, numbers in (('calibrated', result.values), ('calibrated_std', result.deviations)):
            named |= {f'{start}.{name}': value for name, value in zip(UNITS, numbers, strict=False)}  # s1 and s2 or not
        self._facts, self._writing = dict(result.facts), True
        try:
            for full in _RESULT:
                if full in named and not self.has_parameter(full):
                    self._declare_result(full)
                elif full not in named and self.has_parameter(full):
                    self.undeclare_parameter(full)
            self.set_parameters_atomically([Parameter(full, value=value) for full, value in named.items()])
        finally:
            self._writing = False

    def _declare_result(self, full: str) -> None:
        fixed = 'read-only, the result of ~/calibrate'
        descriptor = ParameterDescriptor(description=_RESULT[full], additional_constraints=fixed)
        self.declare_parameter(full, Parameter.Type.DOUBLE, descriptor)

    def _check(self, name: str, value: Any) -> None:
        """In `rclpy` not even its own node may change a parameter declared read-only: the result is guarded here."""
        if name in _RESULT and not self._writing:
            raise ParameterError(f'parameter {name}', 'is read-only, the result of a calibration', 'call ~/calibrate')
        super()._check(name, value)

    def close(self) -> None:
        """Ends a calibration that is running; results are written all or nothing."""
        if self._process is not None:
            self._process.close()
            self._end({'error': 'the node is being shut down'})

    def _note_recording(self, message: String) -> None:
        self._announced = message.data

    async def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is not None:
            response.message = 'a calibration is running already; call again when it is done, or ~/cancel'
            return response
        former = self._condition
        try:
            job = self._job()
            self._ended, self._process = Future(), CalibrationProcess(job)
            self._condition = Condition(OK, f'calibrating from {", ".join(job.recordings)}', {})
            self._tell('running', 'starting', 0.0)
            self._timer.reset()
            ended = await self._ended
            if 'cancelled' in ended:
                response.message, self._condition = ended['cancelled'], former
                self._tell('cancelled', response.message)
                self.get_logger().warning(response.message)
            elif 'error' in ended:
                raise RefusedError(ended['error'])
            else:
                reply = ended['reply']
                response.success, response.message = self._take(Path(reply['folder']), reply['note'], job)
        except (ScaraKinetostaticError, OSError) as error:  # OSError: no process can be made
            response.message = str(error)
            self._condition = Condition(ERROR, response.message, {})
            self._tell('failed', response.message)
            self.get_logger().error(response.message)
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

    def _folder(self) -> Path:
        """For the results: that of `output`, else beside the last recording."""
        if named := self.value('output'):
            return self.place('output', named)
        last = self.place('recording', self._recordings()[-1]).absolute()
        return last.with_name(f'{last.name}_calibration')

    def _job(self) -> Job:
        """What the parameters tell to do.

        Raises:
            InputError: no recording is named, or one is not there.
        """
        paths = [self.place('recording', recording) for recording in self._recordings()]
        for path in paths:
            if not path.exists():
                raise RecordingError(path, 'there is no such recording', 'check the path')
        return Job(
            recordings=[str(path.absolute()) for path in paths],
            cell=str(self.place('cell', self.value('cell'))) if self.value('cell') else '',
            fixed=self.value('fixed'),
            left_out=self.value('leave_out'),
            output=str(self._folder()),
            publish_unfit=self.value('publish_unfit'),
        )

    def _recordings(self) -> list[str]:
        """Those named, else the one that a collector has announced last.

        Raises:
            ParameterError: there is none.
        """
        named = [*filter(None, [self.value('recording')]), *self.value('recordings')]
        if not (named or self._announced):
            problem = 'no recording is named, and no collector has announced one'
            raise ParameterError('parameter recording', problem, 'set it')
        return named or [self._announced]

    def _poll(self) -> None:
        """Looks what the running calibration does."""
        if (process := self._process) is None:
            return
        before, ended = process.news, process.poll()
        if ended is not None:
            self._end(ended)
        elif process.news is not before and 'progress' in process.news:
            self._tell('running', **process.news['progress'])

    def _tell(self, state: str, message: str, part: float | None = None) -> None:
        """Publishes on `~/progress`; without a part of the work that is done, the one before."""
        self._part = self._part if part is None else part
        self._progress.publish(String(data=json.dumps({'state': state, 'message': message, 'part': self._part})))

    def _end(self, ended: dict[str, Any]) -> None:
        self._timer.cancel()
        self._process = None
        self._ended.set_result(ended)

    def _take(self, folder: Path, note: str, job: Job) -> tuple[bool, str]:
        """Publishes the result of a job, by the rules with which it was begun.

        Returns:
            Whether it may be used, and the result in one line.

        Raises:
            CalibrationFileError: `calibration.json` cannot be read.
        """
        stored = load_result(folder / YAML)
        facts: Mapping[str, Any] = stored.facts
        is_fit = facts['assessment'] != UNFIT
        published = is_fit or job.publish_unfit
        message = '; '.join(filter(None, (_in_one_line(facts), f'written to {folder}', note)))
        if not published:
            message += '; the parameters calibrated.* are left as they were; publish_unfit:=true replaces them'
        own = {'published': published, 'message': message, 'files': {'folder': str(folder.absolute())}}
        text = json.dumps(_summary(read_document(folder / JSON)) | own, ensure_ascii=False)
        if published:
            self._publish_parameters(stored)
        self._condition = _condition(facts, message, published)
        self.say(self._condition.level, message)
        self._result.publish(String(data=text))
        for warning in facts['warnings']:
            self.get_logger().warning(warning)
        self._tell('done', message, 1.0)
        return is_fit, message

    def _present(self) -> str:
        """The grade of the present result, when and from what it was calculated, as far as it says so."""
        facts = self._facts
        parts = [f'of {facts["created"]}'] if facts.get('created') else []
        parts += [f'from {", ".join(facts["recordings"])}'] if facts.get('recordings') else []
        return f'{facts.get("assessment") or "not assessed"}, {", ".join(parts) or "of unknown origin"}'

    def _report(self) -> Condition:
        """The status, with what the present parameters are."""
        present = self._present() if self._has_result else 'none'
        return self._condition._replace(values=self._condition.values | {'present result': present})


def _in_one_line(facts: Mapping[str, Any]) -> str:
    """In one line: grade, what to do, touches, errors before and after, verdict, effects or causes, warnings."""
    effects = [
        *facts['effects'],
        *(f'possible: {effect}' for effect in facts['possible_effects']),
        *facts['possible_causes'],
    ]
    parts = [
        ': '.join([facts['assessment'], *facts['reasons'][:1]]),
        *facts['actions'][:1],
        f'{facts["touches.used"]} of {facts["touches.found"]} touches used',
        f'force error {facts["force_error.nominal"]:.4g} N before, '
        f'{facts["held_out_force_error.extended"]:.4g} N after, on touches not used',
        *(f'confounded: {group}' for group in facts['confounded']),
        f'missing effects: {", ".join([facts["verdict"], *effects])}',
    ]
    if warnings := facts['warnings']:
        more = [f'{len(warnings) - 3} more'] if len(warnings) > 3 else []
        parts.append(f'warnings: {"; ".join([*warnings[:3], *more])}')
    return '; '.join(parts)


def _condition(facts: Mapping[str, Any], message: str, published: bool = True) -> Condition:
    """The status with a result: by its grade, at least WARN where it is unexplained, or there are warnings."""
    level = {'fit': OK, UNFIT: ERROR}.get(str(facts.get('assessment')), WARN)
    if facts.get('verdict') == 'unexplained' or facts.get('warnings'):
        level = max(level, WARN)
    figures = {name: '; '.join(fact) if isinstance(fact, list) else str(fact) for name, fact in facts.items()}
    return Condition(level, message, figures | {'published': str(published).lower()})


def _summary(document: Document) -> Document:
    """What `~/result` carries of `calibration.json`: all but covariances, touches, candidates."""
    kept = {key: value for key, value in document.items() if not key.startswith('covariance')}
    for part, details in (('touches', 'fitted'), ('diagnosis', 'candidates')):
        kept[part] = {key: value for key, value in kept[part].items() if key != details}
    return kept | {'schema': RESULT_SCHEMA}
