"""The parameters of the node `calibrator`: what to calibrate, and the present result.

The parameters `calibrated.<name>`, `calibrated_std.<name>` and `calibration.<name>` exist once there is a result, from
a calibration or from a parameter file of an earlier one, and the node alone changes them. Those of effects exist as
long as the last calibration has found them: `effects.<name>.<target>.<parameter>` and `effects_std…`.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from scara_kinetostatic.calibration.calibrate import parse_fixed
from scara_kinetostatic.errors import ParameterError, RecordingError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.parameters import DESCRIPTIONS, UNITS
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.calibration_job import UNFIT, Job
from scara_kinetostatic.results import parameter_file
from scara_kinetostatic.results.parameter_file import FACTS, GROUP, StoredResult, Value
from scara_kinetostatic.touches.left_out import parse_left_out

CHOICES = 'session', 'last', 'all'


_INPUTS: dict[str, tuple[Any, str]] = {
    'cell': ('', 'cell description (YAML file); empty: the one in the recordings'),
    'recording': ('', 'recording to calibrate from'),
    'recordings': (
        [],
        'recordings to calibrate from together; if recording is empty, too: those announced by the collector',
    ),
    'announced': (
        'session',
        'which of the recordings announced by the collector (session: the last one, with those before a restart of the '
        'collector; last: the last one; all: all since this node has started)',
    ),
    'leave_out': (
        [],
        'what to leave out: touches such as 5 or 10-14, those of one recording as touches_1:5, or a recording',
    ),
    'fixed': (
        [],
        'parameters to hold, such as l1=0.3302, g_ee (at its nominal value) or object_radius[disc_2].radius=0',
    ),
    'output': ('', 'folder for the results; empty: beside the last recording, with _calibration after its name'),
    'name': ('', 'name under which the result is kept: a folder in that of the results; empty: that folder itself'),
}
"""Default and description of the parameters that are text, or lists of texts."""
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
            which: one of `CHOICES`.
        """
        return list({'session': self._session, 'last': self._session[-1:], 'all': self._all}[which])


class CalibratorSettings:
    """Declares the parameters, refuses values that cannot be used, and makes a job of them.

    Args:
        node: whose parameters they are.
        announced: the recordings that the collector has announced.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
        ParameterError: a parameter is not valid.
    """

    def __init__(self, node: Node, announced: Announced) -> None:
        self._node = node
        self._announced = announced
        for name, (default, meaning) in _INPUTS.items():
            _check(name, declare.parameter(node, name, default, meaning, read_only=False))
        unfit = 'whether a result that is not fit for use replaces an earlier one in parameters and files'
        declare.parameter(node, 'publish_unfit', False, unfit, read_only=False)
        node.add_on_set_parameters_callback(_check_parameters)

    def __getitem__(self, name: str) -> Any:
        """The value of a parameter; of a list, the texts that are not empty."""
        value = self._node.get_parameter(name).value
        return _listed(value) if isinstance(value, (list, tuple)) else value

    @property
    def folder(self) -> Path:
        """For the results.

        Raises:
            ParameterError: it is not named, nor is a recording.
        """
        if named := self['output']:
            return declare.place('output', named) / self['name']
        last = declare.place('recording', self._recordings()[-1]).absolute()
        return last.with_name(f'{last.name}_calibration') / self['name']

    @property
    def stored(self) -> Path:
        """The folder of an earlier result, that of the parameter `name`.

        Raises:
            ParameterError: there is none.
        """
        folder = self.folder
        if (folder / parameter_file.NAME).is_file():
            return folder
        home = folder.parent if self['name'] else folder
        names = sorted(path.parent.name for path in home.glob(f'*/{parameter_file.NAME}') if path.parent.name != UNFIT)
        problem = f'there is no result {self["name"]!r} in {home}'
        raise ParameterError('parameter name', problem, f'there are {", ".join(names)}' if names else 'calibrate first')

    def job(self) -> Job:
        """What the parameters tell to do.

        Raises:
            InputError: no recording is named, or one is not there.
        """
        paths = [declare.place('recording', recording) for recording in self._recordings()]
        for path in paths:
            if not path.exists():
                raise RecordingError(path, 'there is no such recording', 'check the path')
        return Job(
            recordings=[str(path.absolute()) for path in paths],
            cell=str(declare.place('cell', self['cell'])) if self['cell'] else '',
            fixed=self['fixed'],
            left_out=self['leave_out'],
            output=str(self.folder),
            publish_unfit=self['publish_unfit'],
            name=self['name'],
        )

    def _recordings(self) -> list[str]:
        """Those named, else those that a collector has announced."""
        named = [*filter(None, [self['recording']]), *self['recordings']]
        chosen = named or self._announced.chosen(self['announced'])
        if not chosen:
            problem = 'no recording is named, and no collector has announced one'
            raise ParameterError('parameter recording', problem, 'set it')
        return list(chosen)


def _listed(value: Any) -> list[str]:
    return [str(text) for text in value or [] if str(text).strip()]


def _check(name: str, value: Any) -> None:
    """Check the value of a parameter.

    Raises:
        InputError: it makes no sense.
    """
    where = f'parameter {name}'
    if name == 'cell' and value:
        load_cell(declare.place(name, str(value)))
    elif name == 'announced' and value not in CHOICES:
        raise ParameterError(where, f'expected {", ".join(CHOICES)}, got {value!r}')
    elif name == 'name' and value and not re.fullmatch(r'[A-Za-z0-9_-][A-Za-z0-9._-]*', str(value)):
        raise ParameterError(where, f'expected letters, digits, . _ or -, got {value!r}')
    elif name == 'name' and value == UNFIT:
        raise ParameterError(where, f'{UNFIT!r} is the folder of results that are not fit for use', 'take another')
    elif name == 'leave_out':
        parse_left_out(_listed(value), where)
    elif name == 'fixed':
        for text in _listed(value):
            parse_fixed(text, f'{where}:')


def _check_parameters(parameters: list[Parameter]) -> SetParametersResult:
    """Refuses values that cannot be used."""
    try:
        for parameter in parameters:
            _check(parameter.name, parameter.value)
    except ScaraKinetostaticError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


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
