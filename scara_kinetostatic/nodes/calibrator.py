"""Node `calibrator`: estimates the parameters of the model and its effects from recordings, on `~/calibrate`.

The recordings are those that the parameters `recording` and `recordings` name or, if they are empty, those that the
collector has announced on `collector/recording`. The result becomes parameters of the node, a document on `~/result`
and files in the folder `output`, where an earlier result is kept under its date; one that is not fit for use replaces
no earlier one. A calibration runs in a process of its own, so that the node answers meanwhile and `~/cancel` can end
it; there is only one at a time. One that fails does not change the former results.

The parameters `calibrated.<name>`, `calibrated_std.<name>` and `calibration.<name>` exist once there is a result, from
a calibration or from a parameter file of an earlier one, and the node alone changes them. Those of effects exist as
long as the last calibration has found them: `effects.<name>.<target>.<parameter>` and `effects_std…`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.calibration.calibrate import parse_fixed
from scara_kinetostatic.errors import (
    CalibrationFileError,
    ParameterError,
    RecordingError,
    ScaraKinetostaticError,
    UnsupportedDataError,
)
from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA, nominal_arm, read_document
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import DESCRIPTIONS, UNITS, quantity
from scara_kinetostatic.model.touch import LATER, TouchSet
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes.calibration_job import UNFIT, CalibrationProcess, Job
from scara_kinetostatic.nodes.cell_node import CALLS, ERROR, OK, WARN, CellNode, Condition, RefusedError
from scara_kinetostatic.nodes.conversion import pose_stamped, touch_of, touches_in
from scara_kinetostatic.nodes.monitor import was_seen
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES
from scara_kinetostatic.planning.next_touches import PlannedTouches, Planner
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.results import calibration_json, parameter_file
from scara_kinetostatic.results.parameter_file import FACTS, GROUP, StoredResult, Value, load_result
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.touches.left_out import parse_left_out

_EFFECTS = (f'{parameter_file.EFFECTS}.', f'{parameter_file.EFFECTS_STD}.')
"""How the names of effects' parameters begin."""
_TYPES = {
    str: Parameter.Type.STRING,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    list: Parameter.Type.STRING_ARRAY,
}
_RESULT = {
    **{f'calibrated.{name}': (float, f'{DESCRIPTIONS[name]}, {unit}') for name, unit in UNITS.items()},
    **{f'calibrated_std.{name}': (float, f'standard deviation of {name}, {unit}') for name, unit in UNITS.items()},
    **{f'{GROUP}.{name}': (fact.kind, fact.meaning) for name, fact in FACTS.items()},
}
"""Type and description of parameters of a result, but those of effects: values, their standard deviations, facts."""


class Announced:
    """Recordings in the order in which they were announced.

    A collector that was started anew, after a crash say, goes on with the same session in another recording. One that
    was told to stop begins another session when it is told to start, also by another process, the next day say. The
    middleware tells which process: every publisher numbers its messages from 1.
    """

    def __init__(self) -> None:
        self._all: list[str] = []
        self._session: list[str] = []
        self._stopped = ''

    def note(self, path: str, number: int | None) -> bool:
        """Notes an announcement.

        Args:
            path: of the recording.
            number: of the message among those of its publisher; None or 0 where the middleware does not state it.

        Returns:
            Whether the collector was started anew, so that the recording belongs to those before it.
        """
        if not path or self._session[-1:] == [path]:
            return False
        continued = number == 1 and bool(self._session) and self._session[-1] != self._stopped
        self._session = [*(item for item in self._session if continued and item != path), path]
        self._all = [*(item for item in self._all if item != path), path]
        return continued

    def stop(self, path: str) -> None:
        """Notes that the collector was told to stop a recording."""
        self._stopped = path

    def chosen(self, which: str) -> list[str]:
        """The recordings to calibrate together.

        Args:
            which: `session`, `last` or `all`.
        """
        return list({'session': self._session, 'last': self._session[-1:], 'all': self._all}[which])


class ResultParameters:
    """Holds the parameters of the node and guards them.

    In `rclpy` not even its own node may change a parameter declared read-only. So these are ordinary ones with a
    callback that accepts what `publish` sets, and rejects the rest.

    Args:
        node: whose parameters they are. One thread spins it. Values given at its start (`--params-file`) are taken
            over.

    Raises:
        InvalidParameterTypeException: such a value has another type.
        ParameterError: a parameter of the base model is not finite.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._writing = False
        for full in _RESULT:
            self._declare(full)
            given = node.get_parameter_or(full)
            if given.type_ == Parameter.Type.NOT_SET:
                node.undeclare_parameter(full)
            elif full.startswith('calibrated.') and not math.isfinite(given.value):
                raise ParameterError(f'parameter {full}', f'expected a finite number, got {given.value}')
        self._effects = [full for full in node._parameter_overrides if full.startswith(_EFFECTS)]
        for full in self._effects:
            self._declare(full)
        node.add_on_set_parameters_callback(self._guard)

    @property
    def exist(self) -> bool:
        """Whether there is a result."""
        return bool(self._node.has_parameter('calibrated.l1'))

    def facts(self) -> dict[str, Any]:
        """What the present result is made from and worth, by the names of `FACTS`, as far as it says so."""
        present = self._node.get_parameters_by_prefix(GROUP)
        return {name: present[name].value for name in FACTS if name in present}

    def publish(self, result: StoredResult) -> None:
        """Sets all of them at once; those of effects that are no longer found are removed."""
        named: dict[str, Value] = {}
        for start, numbers in (('calibrated', result.values), ('calibrated_std', result.deviations)):
            named |= {f'{start}.{name}': value for name, value in zip(UNITS, numbers, strict=False)}  # s1 and s2 or not
        named |= {f'{GROUP}.{name}': value for name, value in result.facts.items()}
        for item in result.effects:
            for start, number in zip(_EFFECTS, (item.value, item.std), strict=True):
                named[start + '.'.join(item.path)] = number
        self._writing = True
        try:
            for full in {*self._effects, *_RESULT}.difference(named):
                if self._node.has_parameter(full):
                    self._node.undeclare_parameter(full)
            for full in named:
                if not self._node.has_parameter(full):
                    self._declare(full)
            self._effects = [full for full in named if full not in _RESULT]
            parameters = [Parameter(full, _TYPES[type(value)], value) for full, value in named.items()]
            self._node.set_parameters_atomically(parameters)
        finally:
            self._writing = False

    def _declare(self, full: str) -> None:
        kind, description = _RESULT.get(full, (float, 'of an effect'))
        fixed = 'read-only, the result of ~/calibrate'
        descriptor = ParameterDescriptor(description=description, additional_constraints=fixed)
        self._node.declare_parameter(full, _TYPES[kind], descriptor)

    def _guard(self, parameters: list[Parameter]) -> SetParametersResult:
        taken = [p.name for p in parameters if p.name in _RESULT or p.name.startswith(_EFFECTS)]
        if taken and not self._writing:
            reason = f'{taken[0]} is read-only, the result of a calibration; call ~/calibrate'
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


class Guidance:
    """Which touch to make next, for a robot that is guided by hand or taught.

    The calibrator says it, not the collector: to choose takes a third of a second, in which no message of the streams
    may be missed. What is known is the present result, or the nominal arm before the first, and the touches of
    `collector/touch` since. With each touch `~/next_touch` has the tip in contact, its x axis along the outward normal,
    with an empty `frame_id` where no more are needed, and `~/state` the same in words with the reason, the uncertainty
    of the tip predicted with the touches made, and the tolerance. A cell without limits of the joints has no guidance.

    Args:
        node: that does.
        cell: returns the cell description; None where there is none yet, then it is that of the result.

    Attributes:
        text: what is next; empty before anything is known.
    """

    def __init__(self, node: CellNode, cell: Callable[[], Cell | None]) -> None:
        self._node, self._cell, self.text = node, cell, ''
        self._record: CalibrationRecord | None = None
        self._touches: dict[tuple[str, str], Mapping[str, str]] = {}
        self._is_due = True
        self._next = node.create_publisher(PoseStamped, '~/next_touch', LATCHED)
        self._state = node.create_publisher(DiagnosticArray, '~/state', LATCHED)
        node.create_subscription(DiagnosticArray, 'collector/touch', self._note, LATCHED_TOUCHES)
        node.every(0.5, self._plan)

    def use(self, record: CalibrationRecord) -> None:
        """Goes on from a result."""
        self._record, self._is_due = record, True

    def _note(self, message: DiagnosticArray) -> None:
        for key, values in touches_in(message):
            if values.get('accepted') == 'true':
                self._touches[key] = values
            else:
                self._touches.pop(key, None)
        while len(self._touches) > 1000:  # as many as the topic has for one who hears it anew
            del self._touches[next(iter(self._touches))]
        self._is_due = True

    def _plan(self) -> None:
        """Chooses, after all touches that have come."""
        if not self._is_due:
            return
        self._is_due, record = False, self._record
        try:
            cell = self._cell() or (record.arm.cell if record else None)
            if cell is None or cell.limits is None:
                return
            arm = nominal_arm(cell) if record is None else record.arm
            new = [one for key, one in self._touches.items() if record is None or not was_seen(*key, record)]
            made = [*([record.touches] if record else []), *(touch_of(one, arm).replace(order=[LATER]) for one in new)]
            touches = TouchSet.concatenate(made) if made else None
            planner = Planner(nominal_arm(cell), touches=touches) if record is None else record.planner(cell, touches)
            self._say(planner, cell)
        except (ScaraKinetostaticError, LookupError, ValueError) as error:
            self._publish(WARN, f'no touch can be planned: {error}', {})

    def _say(self, planner: Planner, cell: Cell) -> None:
        tolerance, touches, now = cell.tolerance, planner.touches, planner.present
        reached = '' if tolerance is None else f', tolerance {quantity(tolerance, "m")}'
        tip = f'tip ±{quantity(now, "m")} (k = 2){reached}'
        number = np.bincount([] if touches is None else touches.disc, minlength=len(cell.discs)).astype(int).tolist()
        made = ', '.join(f'{disc.name} {count}' for disc, count in zip(cell.discs, number, strict=True))
        values = {'tip_uncertainty_m': now, 'tolerance_m': '' if tolerance is None else tolerance, 'touches': made}
        if tolerance is not None and now <= tolerance:
            self._next.publish(PoseStamped())
            self._publish(OK, f'enough touches: {tip}', values)
            return
        planned = _nearest(planner)
        plan, place = planned.plan, planned.plan.contact(cell)[0].tolist()
        self._next.publish(
            pose_stamped(self._node.now(), cell.plane, (place[0], place[1], float(plan.direction(cell)[0])))
        )
        values |= {'object': cell.discs[int(plan.disc[0])].name, 'angle_deg': float(np.degrees(plan.angle[0]))}
        values |= {'force_N': float(plan.force[0]), 'reason': planned.reasons[0]}
        self._publish(OK, f'next: {planned.sentence(cell)}; {tip}', values)

    def _publish(self, level: bytes, text: str, values: Mapping[str, object]) -> None:
        self.text = text
        self._state.publish(self._node.status('next touch', level, text, values))


def _nearest(planner: Planner) -> PlannedTouches:
    """The best touches, the nearest to the last one first, where a way leads there."""
    touches, arm, together = planner.touches, planner.arm, 6
    if touches is not None and len(touches):
        last = touches.select(np.array([len(touches) - 1]))
        out = forward(arm.model.parameters, last.joints) - arm.cell.centers[last.disc]
        plan = Plan(last.disc, np.arctan2(out[:, 1], out[:, 0]), last.posture, np.ones(len(last)))
        with suppress(UnsupportedDataError):  # a hand gets where no planned way leads
            return planner.accurate(together, planner.approach(plan))
    return planner.accurate(together)


def _check_cell(name: str, path: str) -> None:
    if path:
        load_cell(CellNode.place(name, path))


def _check_name(name: str, value: str) -> None:
    if value and not re.fullmatch(r'[A-Za-z0-9_-][A-Za-z0-9._-]*', value):
        raise ParameterError(f'parameter {name}', f'expected letters, digits, . _ or -, got {value!r}')
    if value == UNFIT:
        problem = f'{UNFIT!r} is the folder of results that are not fit for use'
        raise ParameterError(f'parameter {name}', problem, 'take another')


def _check_left_out(name: str, value: Sequence[str]) -> None:
    parse_left_out(list(filter(str.strip, value)), f'parameter {name}')


def _check_fixed(name: str, value: Sequence[str]) -> None:
    for text in filter(str.strip, value):
        parse_fixed(text, f'parameter {name}:')


class Calibrator(CellNode):
    """Calibrates on request. One thread spins it.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
        ParameterError: a parameter is not valid.
    """

    checks: ClassVar = {'cell': _check_cell, 'name': _check_name, 'leave_out': _check_left_out, 'fixed': _check_fixed}

    def __init__(self) -> None:
        super().__init__('calibrator')
        self._announced = Announced()
        self._results = ResultParameters(self)
        self._process: CalibrationProcess | None = None
        self._part = 0.0
        self._ended = Future()
        self._condition = Condition(OK, 'no calibration yet', {})
        if self._results.exist:
            facts = self._results.facts()
            self._condition = _condition(facts, _loaded(facts, 'a parameter file'))
            self.say(self._condition.level, self._condition.message)
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
        if self.value('restore') and self._process is None:
            with suppress(ScaraKinetostaticError, OSError):  # there is none yet
                stored = load_result(self._stored() / parameter_file.NAME)
                if str(stored.facts.get('created', '')) > str(self._results.facts().get('created', '')):
                    self._load()

    async def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._process is not None:
            response.message = 'a calibration is running already; call again when it is done, or ~/cancel'
            return response
        former, self._part = self._condition, 0.0
        try:
            job = self._job()
            self._ended, self._process = Future(), CalibrationProcess(job)
            self._show(f'starting, {", ".join(job.recordings)}', 0.0)
            self._timer.reset()
            ended = await self._ended
            if 'cancelled' in ended:
                response.message, self._condition = ended['cancelled'], former
                self._tell('cancelled', response.message, self._part)
                self.get_logger().warning(response.message)
            elif 'error' in ended:
                raise RefusedError(ended['error'])
            else:
                reply = ended['reply']
                response.success, response.message = self._take(Path(reply['folder']), reply['note'], job)
        except (ScaraKinetostaticError, OSError) as error:  # OSError: no process can be made
            response.message = str(error)
            self._condition = Condition(ERROR, response.message, {})
            self._tell('failed', response.message, self._part)
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

    def _load(self) -> str:
        """Takes an earlier result, that of the parameter `name`, as the present one."""
        if self._process is not None:
            raise RefusedError('a calibration is running; call again when it is done, or ~/cancel')
        folder = self._stored()
        stored = load_result(folder / parameter_file.NAME)
        if stored.facts.get('assessment') == UNFIT and not self.value('publish_unfit'):
            raise ParameterError(folder, 'the result is unfit for use', 'publish_unfit:=true takes it all the same')
        message = _loaded(stored.facts, str(folder))
        self._publish(stored, folder, self.value('name'), True, message)
        return message

    def _folder(self) -> Path:
        """For the results.

        Raises:
            ParameterError: it is not named, nor is a recording.
        """
        if named := self.value('output'):
            return self.place('output', named) / self.value('name')
        last = self.place('recording', self._recordings()[-1]).absolute()
        return last.with_name(f'{last.name}_calibration') / self.value('name')

    def _stored(self) -> Path:
        """The folder of an earlier result, that of the parameter `name`.

        Raises:
            ParameterError: there is none.
        """
        folder = self._folder()
        if (folder / parameter_file.NAME).is_file():
            return folder
        home = folder.parent if self.value('name') else folder
        names = sorted(path.parent.name for path in home.glob(f'*/{parameter_file.NAME}') if path.parent.name != UNFIT)
        problem = f'there is no result {self.value("name")!r} in {home}'
        raise ParameterError('parameter name', problem, f'there are {", ".join(names)}' if names else 'calibrate first')

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
            name=self.value('name'),
        )

    def _recordings(self) -> list[str]:
        """Those named, else those that a collector has announced."""
        named = [*filter(None, [self.value('recording')]), *self.value('recordings')]
        chosen = named or self._announced.chosen(self.value('announced'))
        if not chosen:
            problem = 'no recording is named, and no collector has announced one'
            raise ParameterError('parameter recording', problem, 'set it')
        return list(chosen)

    def _cell(self) -> Cell | None:
        """That of the parameter `cell`; None where it is empty."""
        return load_cell(self.place('cell', path)) if (path := self.value('cell')) else None

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
        message = '; '.join(filter(None, (_in_one_line(facts), f'written to {folder}', note)))
        if not published:
            message += '; the parameters calibrated.* are left as they were; publish_unfit:=true replaces them'
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
        file = folder / calibration_json.NAME
        document = read_document(file)
        own = {'name': name, 'published': published, 'message': message, 'files': {'folder': str(folder.absolute())}}
        try:
            text = json.dumps(_summary(document) | own, ensure_ascii=False)
        except (LookupError, TypeError) as error:
            raise CalibrationFileError(file, f'is damaged: {error!r}', 'calibrate again') from error
        if published:
            self._results.publish(stored)
            with suppress(CalibrationFileError):  # an old one
                self._guidance.use(CalibrationRecord.of_document(document, file))
        self._condition = _condition(stored.facts, message, published)
        self.say(self._condition.level, message)
        self._result.publish(String(data=text))

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
        f'force error {facts["force_error.nominal"]:.4g} N before, '
        f'{facts["held_out_force_error.extended"]:.4g} N after, on touches not used',
        *(f'confounded: {group}' for group in facts['confounded']),
        f'missing effects: {", ".join([facts["verdict"], *effects])}',
    ]
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
