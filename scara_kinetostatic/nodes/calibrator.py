"""Node `calibrator`: estimates the parameters of the model and its effects from a recording, on `~/calibrate`.

The recording is the one that the parameter `recording` names or, if that is
empty, the one that the collector has announced last on `collector/recording`.
The results become parameters of the node and files in the folder `output`,
where an earlier result is kept under its date. A calibration runs in a thread
of its own, so that the node answers meanwhile; there is only one at a time. One
that fails does not change the former results.
"""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path

from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.assessment.grade import Grade
from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.calibration.fixed import fixed_values, parse_fixed
from scara_kinetostatic.errors import ParameterError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.nodes import declare
from scara_kinetostatic.nodes.diagnostics import ERROR, OK, WARN, Condition, DiagnosticsPublisher
from scara_kinetostatic.nodes.results import ResultParameters, details, one_line
from scara_kinetostatic.nodes.runtime import run
from scara_kinetostatic.nodes.stream_subscription import LATCHED
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.report.parameter_file import effect_parameters

THREADS = 3
"""One calibrates, one refuses a second call, one serves parameters and timers."""


LEVELS = {Grade.FIT: OK, Grade.CAUTION: WARN, Grade.UNFIT: ERROR}
"""The level of the status after a calibration."""


class ShutDownError(ScaraKinetostaticError):
    """The node ended before the calibration did."""


class Calibrator(Node):
    """Calibrates on request.

    Raises:
        CellError: the cell description cannot be read, or is not valid.
    """

    def __init__(self) -> None:
        super().__init__('calibrator')
        cell = 'cell description (YAML file); empty: the one in the recording'
        _check_cell(declare.text(self, 'cell', '', cell, read_only=False))
        recording = 'recording to calibrate from; empty: the last one announced by the collector'
        declare.text(self, 'recording', '', recording, read_only=False)
        output = 'folder for the results; empty: beside the recording, with _calibration after its name'
        declare.text(self, 'output', '', output, read_only=False)
        fixed = 'parameters to hold, such as l1=0.3302, g_ee (at its nominal value) or object_radius[disc_2].radius=0'
        declare.texts(self, 'fixed', fixed, read_only=False)
        self._results = ResultParameters(self)
        self.add_on_set_parameters_callback(_check_parameters)
        self._announced = ''
        self._running = threading.Lock()
        self._closing = False
        self._condition = Condition(OK, 'no calibration yet', {})
        self.create_subscription(String, 'collector/recording', self._note_recording, LATCHED)
        self.create_service(Trigger, '~/calibrate', self._calibrate, callback_group=ReentrantCallbackGroup())
        DiagnosticsPublisher(self, 'calibration', lambda: self._condition)
        self.get_logger().info(f'ready; call {self.resolve_service_name("~/calibrate")}')

    def close(self) -> None:
        """Cancels a calibration that is running; results are written all or nothing."""
        self._closing = True

    def _note_recording(self, message: String) -> None:
        self._announced = message.data

    def _calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._running.acquire(blocking=False):
            response.message = 'a calibration is running already; call again when it is done'
            return response
        try:
            grade, response.message = self._run()
            response.success = grade is not Grade.UNFIT
            self._log(grade, response.message)
        except ScaraKinetostaticError as error:
            self._fail(response, str(error))
        except Exception as error:  # The node stays up, whatever happens in a calibration.
            self._fail(response, f'internal error: {type(error).__name__}: {error}')
            self.get_logger().debug(traceback.format_exc())
        finally:
            self._running.release()
        return response

    def _log(self, grade: Grade, message: str) -> None:
        """Logs a result at the level of its grade."""
        logger = self.get_logger()
        if grade is Grade.UNFIT:
            logger.error(message)
        elif grade is Grade.CAUTION:
            logger.warning(message)
        else:
            logger.info(message)

    def _fail(self, response: Trigger.Response, message: str) -> None:
        """Answers that there is no result."""
        response.message = message
        self._condition = Condition(ERROR, message, {})
        self.get_logger().error(message)

    def _run(self) -> tuple[Grade, str]:
        """One calibration, from the recording to the parameters.

        Returns:
            Its grade, and the result in one line.

        Raises:
            ScaraKinetostaticError: there is no result.
        """
        from scara_kinetostatic.report.write import write_results  # The plots take a second to load; the node need not.

        recording = self._recording()
        self._condition = Condition(WARN, f'calibrating from {recording}', {})
        cell = self._cell(recording)
        fixed = fixed_values(self._texts('fixed'), cell.nominal, 'parameter fixed:')
        outcome = calibrate_recordings([recording], cell, fixed=fixed, progress=self._progress)
        files = write_results(outcome, self._output(recording))
        final, effects = outcome.final, effect_parameters(outcome.diagnosis.found)
        self._results.publish(list(final.parameters.as_dict().values()), final.std, effects)
        message = '; '.join(filter(None, (one_line(outcome), f'written to {files.folder}', files.note)))
        grade = outcome.assessment.grade
        self._condition = Condition(LEVELS[grade], message, details(outcome))
        return grade, message

    def _progress(self, stage: str, share: float) -> None:
        """Raises if the node is being shut down."""
        if self._closing:
            raise ShutDownError('the node is being shut down')

    def _recording(self) -> Path:
        named = str(self.get_parameter('recording').value) or self._announced
        if not named:
            raise ParameterError(
                'parameter recording', 'no recording is named, and no collector has announced one', 'set it'
            )
        return declare.place('recording', named)

    def _texts(self, name: str) -> list[str]:
        return [str(text) for text in self.get_parameter(name).value or [] if str(text).strip()]

    def _cell(self, recording: Path) -> Cell:
        named = str(self.get_parameter('cell').value)
        if named:
            return load_cell(declare.place('cell', named))
        cell = embedded_cell(recording)
        if cell is None:
            raise ParameterError('parameter cell', f'{recording} contains no cell description', 'set the parameter')
        return cell

    def _output(self, recording: Path) -> Path:
        named = str(self.get_parameter('output').value)
        if named:
            return declare.place('output', named)
        return recording.absolute().with_name(f'{recording.absolute().name}_calibration')


def _check_cell(path: str) -> None:
    if path:
        load_cell(declare.place('cell', path))


def _check_parameters(parameters: list[Parameter]) -> SetParametersResult:
    """Refuses a cell description that cannot be used."""
    try:
        for parameter in parameters:
            if parameter.name == 'cell':
                _check_cell(str(parameter.value))
            if parameter.name == 'fixed':
                for text in (str(item) for item in parameter.value or [] if str(item).strip()):
                    parse_fixed(text, 'parameter fixed:')
    except ScaraKinetostaticError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


class WaitingExecutor(MultiThreadedExecutor):
    """Ends when the running callbacks have ended; its base class lets them run on after the node is destroyed."""

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Starts no further callback and waits for the running ones."""
        self._executor.shutdown(wait=True)
        return bool(super().shutdown(timeout_sec))


def main(args: Sequence[str] | None = None) -> int:
    """Runs the node; see `runtime.run` for the exit status."""
    return run(Calibrator, args, lambda: WaitingExecutor(THREADS))


if __name__ == '__main__':
    sys.exit(main())
