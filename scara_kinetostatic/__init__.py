"""Kinetostatic calibration of a SCARA robot by touch, and what its twelve parameters lack.

The layers, from the top; each imports only from those below it (`test/test_architecture.py` holds that):

    nodes, cli             thin: ROS nodes and the command line convert, delegate, publish
    report                 an outcome as data, text, JSON, ROS parameter file, HTML
    pipeline               from recordings to the outcome
    recording, simulation, bags, touches in a stream; a cell that plays both topics;
    experiments, physics   the paper's studies, designs, gauge readings, loops; a cell in the engine MuJoCo
    diagnosis              is anything left in the residual? which effects explain it, and which rivals have they?
    calibration            from touches to the twelve parameters, and to those of effects beside them
    effects                what the twelve parameters lack, one physical effect per file, and the list of them
    model                  parameters, cell, touches, kinematics, kinetostatics, contact
    errors                 one root for all errors

`rclpy` is imported under `nodes` alone, `rosbags` and `mcap` under `recording` alone, `matplotlib` under
`report` alone, `mujoco` under `physics` alone. What is named here is the interface for other programs; it is
loaded on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scara_kinetostatic.bags.reader import read_streams
    from scara_kinetostatic.calibration.calibrate import calibrate
    from scara_kinetostatic.calibration.result import Calibration
    from scara_kinetostatic.diagnosis.diagnose import diagnose
    from scara_kinetostatic.diagnosis.outcome import Outcome
    from scara_kinetostatic.diagnosis.result import Diagnosis
    from scara_kinetostatic.effects.base import Effect
    from scara_kinetostatic.effects.registry import catalogue, register
    from scara_kinetostatic.errors import InputError, ScaraKinetostaticError, UnsupportedDataError
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.model.cell import Cell, Disc, Noise, Sensor
    from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, PAPER_MEASURED, PAPER_NOMINAL, Parameters
    from scara_kinetostatic.model.touch import TouchSet
    from scara_kinetostatic.pipeline import calibrate_recordings
    from scara_kinetostatic.report.document import as_document
    from scara_kinetostatic.report.write import write_results
    from scara_kinetostatic.touches.detection import Detection, find_touches

__version__ = '0.1.0'

_HOME = {
    'calibrate': 'calibration.calibrate',
    'Calibration': 'calibration.result',
    'diagnose': 'diagnosis.diagnose',
    'Diagnosis': 'diagnosis.result',
    'Effect': 'effects.base',
    'catalogue': 'effects.registry',
    'register': 'effects.registry',
    'InputError': 'errors',
    'ScaraKinetostaticError': 'errors',
    'UnsupportedDataError': 'errors',
    'Cell': 'model.cell',
    'Disc': 'model.cell',
    'Noise': 'model.cell',
    'Sensor': 'model.cell',
    'NAMES': 'model.parameters',
    'PAPER_ACTUAL': 'model.parameters',
    'PAPER_MEASURED': 'model.parameters',
    'PAPER_NOMINAL': 'model.parameters',
    'Parameters': 'model.parameters',
    'TouchSet': 'model.touch',
    'Outcome': 'diagnosis.outcome',
    'calibrate_recordings': 'pipeline',
    'load_cell': 'files.cell_file',
    'Detection': 'touches.detection',
    'find_touches': 'touches.detection',
    'read_streams': 'bags.reader',
    'as_document': 'report.document',
    'write_results': 'report.write',
}

__all__ = [
    'NAMES',
    'PAPER_ACTUAL',
    'PAPER_MEASURED',
    'PAPER_NOMINAL',
    'Calibration',
    'Cell',
    'Detection',
    'Diagnosis',
    'Disc',
    'Effect',
    'InputError',
    'Noise',
    'Outcome',
    'Parameters',
    'ScaraKinetostaticError',
    'Sensor',
    'TouchSet',
    'UnsupportedDataError',
    '__version__',
    'as_document',
    'calibrate',
    'calibrate_recordings',
    'catalogue',
    'diagnose',
    'find_touches',
    'load_cell',
    'read_streams',
    'register',
    'write_results',
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.{_HOME[name]}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(__all__) | set(globals()))
