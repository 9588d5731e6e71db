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

    cli, nodes     thin: the command line and ROS nodes convert, delegate, publish
    interface      the functions of this page
    studies        dial gauge, hysteresis, the paper
    running        a run of touches, without ROS
    monitoring     does a calibration still hold? verification, comparison, drift, history, archives
    results        what a calibration prints and writes: text, JSON, ROS parameter file, page
    pipeline       from recordings or touches to the outcome
    planning       the touches to make: design, the next ones, their order
    simulation     a simulated cell and its sensors
    contour        the outline of an object of unknown shape, from slides of the tip along it
    bags           recordings of all formats, read and written
    touches        from streams to touches, and the object each belongs to
    report         headline, sentences, tables, figures: to a terminal, to a page, to JSON, for every verb
    files          cell description, touch table, safe YAML, atomic writing
    assessment     may the result be used? grade, reasons, actions; the outcome of it all
    diagnosis      is the model complete? which effects explain the residual, and which rivals have they?
    calibration    from touches to the parameters, with their uncertainty
    effects        the physical effects that the base model lacks, by what they are of
    gaussian       linear models with Gaussian errors: least squares, priors, tests, variance components
    model          parameters, cell, touches, kinematics, kinetostatics, contact; a calibrated arm in use
    threads        one thread for linear algebra
    errors         one root for all errors
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from types import FunctionType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scara_kinetostatic.assessment.outcome import Outcome as Outcome
    from scara_kinetostatic.bags.reader import read_streams as read_streams
    from scara_kinetostatic.calibration.calibrate import calibrate as calibrate
    from scara_kinetostatic.calibration.result import Calibration as Calibration
    from scara_kinetostatic.contour.fits import fit_pieces as fit_pieces
    from scara_kinetostatic.contour.fits import fit_shape as fit_shape
    from scara_kinetostatic.contour.result import Contour as Contour
    from scara_kinetostatic.diagnosis.result import Diagnosis as Diagnosis
    from scara_kinetostatic.effects.base import Effect as Effect
    from scara_kinetostatic.effects.registry import catalogue as catalogue
    from scara_kinetostatic.effects.registry import register as register
    from scara_kinetostatic.errors import InputError as InputError
    from scara_kinetostatic.errors import ScaraKinetostaticError as ScaraKinetostaticError
    from scara_kinetostatic.errors import UnsupportedDataError as UnsupportedDataError
    from scara_kinetostatic.files.calibration_file import load_calibration as load_calibration
    from scara_kinetostatic.files.cell_file import load_cell as load_cell
    from scara_kinetostatic.interface import compensate as compensate
    from scara_kinetostatic.interface import diagnose as diagnose
    from scara_kinetostatic.interface import locate as locate
    from scara_kinetostatic.interface import make_touches as make_touches
    from scara_kinetostatic.interface import predict_force as predict_force
    from scara_kinetostatic.interface import read_touches as read_touches
    from scara_kinetostatic.interface import simulate as simulate
    from scara_kinetostatic.interface import trace_contour as trace_contour
    from scara_kinetostatic.model.arm import CalibratedArm as CalibratedArm
    from scara_kinetostatic.model.arm import JointAngles as JointAngles
    from scara_kinetostatic.model.arm import TipPosition as TipPosition
    from scara_kinetostatic.model.cell import Cell as Cell
    from scara_kinetostatic.model.cell import Disc as Disc
    from scara_kinetostatic.model.cell import Noise as Noise
    from scara_kinetostatic.model.cell import Sensor as Sensor
    from scara_kinetostatic.model.parameters import NAMES as NAMES
    from scara_kinetostatic.model.parameters import PAPER_ACTUAL as PAPER_ACTUAL
    from scara_kinetostatic.model.parameters import PAPER_MEASURED as PAPER_MEASURED
    from scara_kinetostatic.model.parameters import PAPER_NOMINAL as PAPER_NOMINAL
    from scara_kinetostatic.model.parameters import Parameters as Parameters
    from scara_kinetostatic.model.touch import TouchSet as TouchSet
    from scara_kinetostatic.pipeline import calibrate_recordings as calibrate_recordings
    from scara_kinetostatic.results.document import as_document as as_document
    from scara_kinetostatic.results.document import write_results as write_results
    from scara_kinetostatic.touches.detection import Detection as Detection
    from scara_kinetostatic.touches.detection import find_touches as find_touches

__version__ = '0.1.0'

_MORE = """
Detection Diagnosis Disc NAMES Noise PAPER_ACTUAL PAPER_MEASURED PAPER_NOMINAL Parameters ScaraKinetostaticError Sensor
as_document calibrate_recordings find_touches fit_pieces fit_shape read_streams
"""
"""Names that can be imported as well: parts of the others."""


@cache
def _homes() -> dict[str, str]:
    """The module of each name, as the imports above say for type checkers; they are done on first use."""
    import ast
    import pkgutil

    return {
        alias.name: node.module
        for node in ast.walk(ast.parse(pkgutil.get_data(__name__, '__init__.py') or b''))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(f'{__name__}.')
        for alias in node.names
    }


def __getattr__(name: str) -> Any:
    if name == '__all__':
        return ['__version__', *sorted(set(_homes()) - set(_MORE.split()))]
    home = _homes().get(name)
    if home is None:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    with import_module(f'{__name__}.errors').naming_missing_libraries():
        value = getattr(import_module(home), name)
    if isinstance(value, FunctionType):
        value = import_module(f'{__name__}.threads').one_thread(value)
        value.__module__ = __name__  # where pickle finds it
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__getattr__('__all__'), *globals()})
