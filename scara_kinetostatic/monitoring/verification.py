"""Acceptance of a calibration: touches that it has not seen, held against its prediction.

All touches together are tested by a chi-square that contains the uncertainty of the calibration (`prediction_test`).
The error of the tip, the root mean square distance of the predicted tip from the circle that it touches, is compared
with what noise and uncertainty let expect.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from scara_kinetostatic.assessment.grade import Assessment, Grade
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.bags.inputs import other_descriptions
from scara_kinetostatic.calibration.prediction import base_force, observe
from scara_kinetostatic.calibration.propagation import tip_under_force
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.touch_table import is_touch_table
from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import LATER, TouchSet
from scara_kinetostatic.monitoring.acceptance import LEVEL, MOST_OUTLYING, Outlying, Verification, assess
from scara_kinetostatic.monitoring.assumptions import of_new_recordings
from scara_kinetostatic.monitoring.hypotheses import Explanation, explanations, hypotheses_of, rivals
from scara_kinetostatic.monitoring.linear import LINEAR, Evidence, Information, Measured, State, measure
from scara_kinetostatic.monitoring.prediction_test import PredictionTest
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.same_robot import check_same_arm, check_same_recorded
from scara_kinetostatic.monitoring.sensitivity import detectable_changes
from scara_kinetostatic.monitoring.significance import p_values
from scara_kinetostatic.pipeline import gather_touches, recording_of
from scara_kinetostatic.touches.detection import Detection
from scara_kinetostatic.touches.table import cell_of_files

OUTLYING = 1e-3
"""The same for the largest of all touches (Bonferroni)."""
_OF_NO_EFFECT = ('noise', 'tolerance')
"""Parts of a cell description that touches do not depend on: the noise is that of the calibration, the tolerance what
its use allows.
"""
_SAME = 1e-6
"""Difference of joint angles, rad, and forces, N, by rounding in a table: two touches never agree so well."""


def verify_recordings(paths: Sequence[str | Path], record: CalibrationRecord, cell: Cell | None = None) -> Verification:
    """Read recordings and touch tables, find their touches, hold them against a calibration.

    Args:
        paths: the recordings, and tables of touches (`.csv`).
        record: the calibration.
        cell: in which they were made; by default that of the calibration.

    Raises:
        RecordingError: a recording or table cannot be read.
        InputError: tables together with recordings of a sensor in the tool frame; a recording of another robot.
        UnsupportedDataError: there is no touch.
    """
    tables = [path for path in paths if is_touch_table(path)]
    others = [path for path in paths if path not in tables]
    is_own = cell is None
    cell = cell_of_files(record.arm.cell if cell is None else cell, tables, others)
    detection = gather_touches(paths, cell)
    turned = detection.turned or ('',) * len(paths)
    rows = zip(paths, detection.starts, turned, strict=True)
    recordings = [recording_of(*row) for row in rows]
    differing = _other_cells(record, cell, others) if is_own else []
    return verify(detection, record, cell, recordings, differing)


def _other_cells(record: CalibrationRecord, cell: Cell, paths: Sequence[str | Path]) -> list[str]:
    """The recordings that contain another cell description than that of the calibration, one sentence each.

    Raises:
        InputError: one is of another robot.
    """
    for path in paths:
        check_same_recorded(cell, path, record.source)
    return other_descriptions(cell, [Path(path) for path in paths], 'the calibration', _OF_NO_EFFECT)


def _remaining(test: PredictionTest, ranking: Sequence[Explanation], record: CalibrationRecord) -> float:
    """p-value of nothing else having changed than the first hypothesis says; 1 where the error of linearisation may be
    what a large change leaves.
    """
    if not ranking:
        return 1.0
    freedoms = test.freedoms - len(ranking[0].change)
    left = max(test.chi_square - ranking[0].statistic, 0.0)
    if left < LINEAR * test.chi_square:
        return 1.0
    return float(p_values(left, max(freedoms, 0), record.noise_freedoms))


def verify(
    detection: Detection,
    record: CalibrationRecord,
    cell: Cell | None = None,
    recordings: Sequence[Recording] = (),
    differing: Sequence[str] = (),
) -> Verification:
    """Hold touches against a calibration.

    Args:
        detection: the touches, of `cell`.
        record: the calibration.
        cell: in which they were made; by default that of the calibration.
        recordings: where they come from.
        differing: which of these contain another cell description, one sentence each.

    Raises:
        UnsupportedDataError: there is no touch.
        InputError: a touch cannot be evaluated at the calibrated model, or the cell has another robot.
    """
    if not len(detection.touches):
        reason = f': {detection.rejected[0].reason}' if detection.rejected else ''
        raise UnsupportedDataError(f'no touch can be verified{reason}', 'see what `inspect` says about the recording')
    if cell is not None:
        check_same_arm(record.arm.cell, cell, record.source, 'the cell description', 'give the cell of this robot')
    cell = record.arm.cell if cell is None else cell
    touches = detection.touches.replace(order=np.full(len(detection.touches), LATER))
    state = State.of(record, cell)
    measured = measure(touches, record, state)
    test = PredictionTest.of(measured, state.covariance, record.noise_freedoms)
    outlying = test.p_values < OUTLYING / len(touches)
    few = 0 < outlying.sum() <= MOST_OUTLYING * len(touches)
    others = measured.select(~outlying) if few else measured
    others_test = PredictionTest.of(others, state.covariance, record.noise_freedoms) if few else test
    evidence = Evidence.of(Information.of(others), state.covariance)
    hypotheses = hypotheses_of(state, len(record.arm.model.names), np.unique(touches.disc).tolist())
    ranking = explanations(evidence, state, hypotheses) if others_test.p_value < LEVEL else []
    found = Verification(
        record=record,
        cell=cell,
        recordings=tuple(recordings),
        assessment=Assessment(Grade.FIT, (), ()),
        touches=len(touches),
        rejected=detection.rejected,
        chi_square=test.chi_square,
        degrees_of_freedom=test.freedoms,
        quantile=test.quantile,
        p_value=test.p_value,
        tip_error=rms(measured.tip_error),
        expected=rms(test.expected),
        nominal_tip_error=_nominal_tip_error(detection, cell),
        others_p_value=others_test.p_value,
        others_tip_error=rms(others.tip_error),
        outlying=_outlying(outlying, test, measured, touches, cell),
        ranking=tuple(ranking),
        rivals=tuple(rivals(ranking, evidence)),
        remaining_p_value=_remaining(others_test, ranking, record),
        detectable=tuple(detectable_changes(record, state, evidence, others.residual.size, LEVEL)),
        seen=tuple(item.path for item in recordings if item.sha256 in record.checksums),
        repeated=_repeated(touches, record, state),
        numbers=touches.index,
        tip_errors=measured.tip_error,
        expected_errors=test.expected,
        differing=tuple(differing),
        warnings=(*detection.warnings, *of_new_recordings(record)),
    )
    return found._replace(assessment=assess(found, float(_magnitudes(detection, cell).max())))


def _outlying(
    outlying: Mask, test: PredictionTest, measured: Measured, touches: TouchSet, cell: Cell
) -> tuple[Outlying, ...]:
    """The touches that their prediction does not explain."""
    which = np.flatnonzero(outlying).tolist()
    columns = (touches.index, touches.disc, test.distances, measured.tip_error)
    rows = zip(*(column[which].tolist() for column in columns), strict=True)
    return tuple(Outlying(index, cell.discs[disc].name, distance, error) for index, disc, distance, error in rows)


def _repeated(touches: TouchSet, record: CalibrationRecord, state: State) -> int:
    """How many touches are those of the calibration, their forces as reported or as it has corrected them."""
    own, found = cKDTree(np.hstack([record.touches.joints, record.forces])), np.zeros(len(touches), dtype=bool)
    for errors in (state.errors, 0.0 * state.errors):
        force = base_force(observe(touches, state.cell, errors), record.arm.model)
        found |= np.isfinite(own.query(np.hstack([touches.joints, force]), p=np.inf, distance_upper_bound=_SAME)[0])
    return int(found.sum())


def _magnitudes(detection: Detection, cell: Cell) -> Floats:
    force = base_force(observe(detection.touches, cell), ExtendedModel(cell.nominal))
    return np.hypot(force[:, 0], force[:, 1])


def _nominal_tip_error(detection: Detection, cell: Cell) -> float:
    """Rms distance of the nominal tip under load from the circle of contact, m."""
    o, nominal = observe(detection.touches, cell), ExtendedModel(cell.nominal)
    tip, _ = tip_under_force(nominal, o.joints, base_force(o, nominal), o.gripper)
    return rms(np.linalg.norm(tip - o.centers, axis=1) - o.radii)
