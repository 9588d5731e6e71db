"""Kinetostatic calibration of a SCARA robot by touch, and the errors of its base model of twelve parameters.

From a recording to a compensated joint angle::

    import scara_kinetostatic as sk

    cell = sk.load_cell('cell.yaml')                          # nominal robot, discs, sensor
    outcome = sk.diagnose('recording.mcap', cell)             # touches found, calibrated, diagnosed
    print(outcome.verdict, outcome['l1'].value, outcome['l1'].std, outcome['l1'].unit)
    for label, parameters in outcome.effects.items():         # model errors found and corrected
        for name, estimate in parameters.items():
            print(label, name, estimate.value, estimate.std, estimate.unit)
    sk.write_results(outcome, 'result')                       # calibration.yaml, calibration.json, report.html

    angles = sk.compensate(outcome, [0.30, 0.20], force=[0.0, 30.0], elbow='right')
    print(angles.joints, angles.std)                          # rad, and their standard uncertainty
    tip = sk.locate(outcome, angles.joints, [0.0, 30.0])
    print(tip.position, tip.std)                              # back at the place, m

    arm = sk.load_calibration('result/calibration.json')      # later, elsewhere: the same without the recording
    print(sk.locate(arm, angles.joints, [0.0, 30.0]).position)

What `__all__` names is stable, typed and loaded on first use. The packages, from the top; each imports only from those
below it (`test/test_architecture.py` checks that):

    nodes, cli     thin: ROS nodes and the command line convert, delegate, publish
    interface      the functions of this page
    studies        design of recordings, dial gauge, hysteresis, the paper
    monitoring     does a calibration still hold? verification, comparison, drift, history, archives
    results        what a calibration prints and writes: text, JSON, ROS parameter file, page
    pipeline       from recordings or touches to the outcome
    simulation     a simulated cell and its sensors
    contour        the outline of an object of unknown shape, from slides of the tip along it
    bags           recordings of all formats, read and written
    touches        from streams to touches, and the object each belongs to
    report         headline, sentences, tables, figures: to a terminal, to a page, to JSON, for every verb
    files          cell description, touch table, safe YAML, atomic writing
    assessment     may the result be used? grade, reasons, actions; the outcome of it all
    diagnosis      is the model complete? which effects explain the residual, and which rivals have they?
    calibration    from touches to the parameters, with their uncertainty
    effects        the physical effects that the base model lacks, one per file
    model          parameters, cell, touches, kinematics, kinetostatics, contact; a calibrated arm in use
    errors         one root for all errors
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scara_kinetostatic.assessment.outcome import Outcome
    from scara_kinetostatic.bags.reader import read_streams as read_streams
    from scara_kinetostatic.calibration.calibrate import calibrate
    from scara_kinetostatic.calibration.result import Calibration
    from scara_kinetostatic.contour.fits import fit_pieces as fit_pieces
    from scara_kinetostatic.contour.fits import fit_shape as fit_shape
    from scara_kinetostatic.contour.result import Contour
    from scara_kinetostatic.diagnosis.result import Diagnosis as Diagnosis
    from scara_kinetostatic.effects.base import Effect
    from scara_kinetostatic.effects.registry import catalogue, register
    from scara_kinetostatic.errors import InputError, UnsupportedDataError
    from scara_kinetostatic.errors import ScaraKinetostaticError as ScaraKinetostaticError
    from scara_kinetostatic.files.calibration_file import load_calibration
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.interface import (
        compensate,
        diagnose,
        locate,
        make_touches,
        predict_force,
        read_touches,
        simulate,
        trace_contour,
    )
    from scara_kinetostatic.model.arm import CalibratedArm, JointAngles, TipPosition
    from scara_kinetostatic.model.cell import Cell
    from scara_kinetostatic.model.cell import Disc as Disc
    from scara_kinetostatic.model.cell import Noise as Noise
    from scara_kinetostatic.model.cell import Sensor as Sensor
    from scara_kinetostatic.model.parameters import NAMES as NAMES
    from scara_kinetostatic.model.parameters import PAPER_ACTUAL as PAPER_ACTUAL
    from scara_kinetostatic.model.parameters import PAPER_MEASURED as PAPER_MEASURED
    from scara_kinetostatic.model.parameters import PAPER_NOMINAL as PAPER_NOMINAL
    from scara_kinetostatic.model.parameters import Parameters as Parameters
    from scara_kinetostatic.model.touch import TouchSet
    from scara_kinetostatic.pipeline import calibrate_recordings as calibrate_recordings
    from scara_kinetostatic.results.document import as_document as as_document
    from scara_kinetostatic.results.write import write_results
    from scara_kinetostatic.touches.detection import Detection as Detection
    from scara_kinetostatic.touches.detection import find_touches as find_touches

__version__ = '0.1.0'

_HOME = {
    'CalibratedArm': 'model.arm',
    'Calibration': 'calibration.result',
    'Cell': 'model.cell',
    'Contour': 'contour.result',
    'Effect': 'effects.base',
    'InputError': 'errors',
    'JointAngles': 'model.arm',
    'Outcome': 'assessment.outcome',
    'TipPosition': 'model.arm',
    'TouchSet': 'model.touch',
    'UnsupportedDataError': 'errors',
    'calibrate': 'calibration.calibrate',
    'catalogue': 'effects.registry',
    'compensate': 'interface',
    'diagnose': 'interface',
    'load_calibration': 'files.calibration_file',
    'load_cell': 'files.cell_file',
    'locate': 'interface',
    'make_touches': 'interface',
    'predict_force': 'interface',
    'read_touches': 'interface',
    'register': 'effects.registry',
    'simulate': 'interface',
    'trace_contour': 'interface',
    'write_results': 'results.write',
}
_FORMER = {
    'Detection': 'touches.detection',
    'Diagnosis': 'diagnosis.result',
    'Disc': 'model.cell',
    'NAMES': 'model.parameters',
    'Noise': 'model.cell',
    'PAPER_ACTUAL': 'model.parameters',
    'PAPER_MEASURED': 'model.parameters',
    'PAPER_NOMINAL': 'model.parameters',
    'Parameters': 'model.parameters',
    'ScaraKinetostaticError': 'errors',
    'Sensor': 'model.cell',
    'as_document': 'results.document',
    'calibrate_recordings': 'pipeline',
    'find_touches': 'touches.detection',
    'fit_pieces': 'contour.pieces',
    'fit_shape': 'contour.fits',
    'read_streams': 'bags.reader',
}
"""Names of earlier versions and of parts of the above; they can be imported still."""

__all__ = [
    'CalibratedArm',
    'Calibration',
    'Cell',
    'Contour',
    'Effect',
    'InputError',
    'JointAngles',
    'Outcome',
    'TipPosition',
    'TouchSet',
    'UnsupportedDataError',
    '__version__',
    'calibrate',
    'catalogue',
    'compensate',
    'diagnose',
    'load_calibration',
    'load_cell',
    'locate',
    'make_touches',
    'predict_force',
    'read_touches',
    'register',
    'simulate',
    'trace_contour',
    'write_results',
]


def __getattr__(name: str) -> Any:
    home = _HOME.get(name) or _FORMER.get(name)
    if home is None:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    value = getattr(import_module(f'{__name__}.{home}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(__all__) | set(globals()))
