"""The parameters of the node `calibrator`, and the job that they describe."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from scara_kinetostatic.calibration.calibrate import parse_fixed
from scara_kinetostatic.errors import ParameterError, RecordingError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.announced import CHOICES, SESSION, Announced
from scara_kinetostatic.nodes.calibration_job import UNFIT, Job
from scara_kinetostatic.results import parameter_file
from scara_kinetostatic.touches.left_out import parse_left_out

_NAME = re.compile(r'[A-Za-z0-9_-][A-Za-z0-9._-]*')


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
        self._declare_inputs(node)
        output = 'folder for the results; empty: beside the last recording, with _calibration after its name'
        declare.text(node, 'output', '', output, read_only=False)
        name = 'name under which the result is kept: a folder in that of the results; empty: that folder itself'
        _check('name', declare.text(node, 'name', '', name, read_only=False))
        unfit = 'whether a result that is not fit for use replaces an earlier one in parameters and files'
        declare.switch(node, 'publish_unfit', False, unfit, read_only=False)
        node.add_on_set_parameters_callback(_check_parameters)

    @staticmethod
    def _declare_inputs(node: Node) -> None:
        cell = 'cell description (YAML file); empty: the one in the recordings'
        _check('cell', declare.text(node, 'cell', '', cell, read_only=False))
        declare.text(node, 'recording', '', 'recording to calibrate from', read_only=False)
        more = 'recordings to calibrate from together; if recording is empty, too: those announced by the collector'
        declare.texts(node, 'recordings', more, read_only=False)
        which = '; '.join(f'{choice}: {meaning}' for choice, meaning in CHOICES.items())
        announced = f'which of the recordings announced by the collector ({which})'
        _check('announced', declare.text(node, 'announced', SESSION, announced, read_only=False))
        left_out = (
            'what to leave out: touches such as 5 or 10-14, those of one recording as touches_1:5, or a recording'
        )
        _check('leave_out', declare.texts(node, 'leave_out', left_out, read_only=False))
        fixed = 'parameters to hold, such as l1=0.3302, g_ee (at its nominal value) or object_radius[disc_2].radius=0'
        _check('fixed', declare.texts(node, 'fixed', fixed, read_only=False))

    @property
    def name(self) -> str:
        """Of the result; empty where it has none."""
        return self._text('name')

    @property
    def publishes_unfit(self) -> bool:
        """Whether a result that is not fit for use replaces an earlier one."""
        return bool(self._node.get_parameter('publish_unfit').value)

    @property
    def folder(self) -> Path:
        """For the results.

        Raises:
            ParameterError: it is not named, nor is a recording.
        """
        if named := self._text('output'):
            return declare.place('output', named) / self.name
        last = declare.place('recording', self._recordings()[0][-1]).absolute()
        return last.with_name(f'{last.name}_calibration') / self.name

    @property
    def stored(self) -> Path:
        """The folder of an earlier result, that of the parameter `name`.

        Raises:
            ParameterError: there is none.
        """
        folder = self.folder
        if (folder / parameter_file.NAME).is_file():
            return folder
        home = folder.parent if self.name else folder
        names = sorted(path.parent.name for path in home.glob(f'*/{parameter_file.NAME}') if path.parent.name != UNFIT)
        problem = f'there is no result {self.name!r} in {home}' if self.name else f'there is no result in {home}'
        raise ParameterError('parameter name', problem, f'there are {", ".join(names)}' if names else 'calibrate first')

    def job(self) -> Job:
        """What the parameters tell to do.

        Raises:
            InputError: no recording is named, or one is not there.
        """
        recordings, joined = self._recordings()
        paths = [declare.place('recording', recording) for recording in recordings]
        for path in paths:
            if not path.exists():
                raise RecordingError(path, 'there is no such recording', 'check the path')
        cell = self._text('cell')
        return Job(
            recordings=list(map(str, paths)),
            joined=joined,
            cell=str(declare.place('cell', cell)) if cell else '',
            fixed=self._texts('fixed'),
            left_out=self._texts('leave_out'),
            output=str(self.folder),
            publish_unfit=self.publishes_unfit,
            name=self.name,
        )

    def _recordings(self) -> tuple[list[str], bool]:
        """The recordings, and whether they were put together without being named."""
        named = [*filter(None, [self._text('recording')]), *self._texts('recordings')]
        chosen = named or self._announced.chosen(self._text('announced'))
        if not chosen:
            raise ParameterError(
                'parameter recording', 'no recording is named, and no collector has announced one', 'set it'
            )
        return chosen, not named and len(chosen) > 1

    def _text(self, name: str) -> str:
        return str(self._node.get_parameter(name).value)

    def _texts(self, name: str) -> list[str]:
        return _listed(self._node.get_parameter(name).value)


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
    elif name == 'name' and value and not _NAME.fullmatch(str(value)):
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
