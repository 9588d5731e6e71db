"""Acceptance of a calibration: touches that it has not seen, held against its prediction.

All touches together are tested by a chi-square that contains the uncertainty of the calibration
(`change.PredictionTest`). The error of the tip, the root mean square distance of the predicted tip from the circle that
it touches, is compared with what noise and uncertainty let expect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.grade import Assessment, Grade, Limits, Remark
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.bags.reader import other_descriptions
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.arrays import Floats, Indices, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.quantities import micrometres
from scara_kinetostatic.model.touch import LATER, Rejection, TouchSet
from scara_kinetostatic.monitoring.change import CalibratedState, Causes, PredictionTest, hypotheses_of, measure, ranked
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm, check_same_recorded
from scara_kinetostatic.pipeline import gather_touches, recordings_of
from scara_kinetostatic.touches.detection import Detection, cell_of_files

LEVEL = 1e-3
"""p-value below which the touches contradict the calibration. Source: of a thousand sound ones, one is refused."""


@dataclass(frozen=True)
class Outlying:
    """A touch that the prediction does not explain.

    Attributes:
        index: its number in the recordings.
        object: name of the object.
        distance: from the prediction, in standard deviations.
        tip_error: distance of the predicted tip from the circle of contact, m.
    """

    index: int
    object: str
    distance: float
    tip_error: float


class Verification(NamedTuple):
    """The outcome of a verification.

    Attributes:
        record: the calibration.
        tolerance: of the tip, m: that of the cell in which the touches were made, or of the calibration; None without.
        recordings: what was verified with.
        rejected: touches that the detection rejected.
        test: of all touches.
        expected: rms error of the tip that noise and the uncertainty of the calibration let expect, m.
        others: test of the touches without the outliers, where these are few; else `test`.
        others_tip_error: their rms tip error, m.
        outlying: single touches that contradict the prediction.
        causes: what may have changed; empty where nothing contradicts.
        untouched: objects of the cell without a touch.
        seen: recordings that were part of the calibration.
        repeated: how many touches were part of it, whatever recording or table they come from.
        largest_force: of the touches, N.
        numbers: of the touches in the recordings, (n,).
        tip_errors: of each touch, distance of the predicted tip from the circle of contact, (n,), m.
        differing: recordings that contain another cell description, one sentence each.
        warnings: irregularities of the recordings.
    """

    record: CalibrationRecord
    tolerance: float | None
    recordings: tuple[Recording, ...]
    rejected: tuple[Rejection, ...]
    test: PredictionTest
    expected: float
    others: PredictionTest
    others_tip_error: float
    outlying: tuple[Outlying, ...]
    causes: Causes
    untouched: tuple[str, ...]
    seen: tuple[str, ...]
    repeated: int
    largest_force: float
    numbers: Indices
    tip_errors: Floats
    differing: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def touches(self) -> int:
        """How many."""
        return len(self.numbers)

    @property
    def p_value(self) -> float:
        """Of the calibration being right."""
        return self.test.p_value

    @property
    def tip_error(self) -> float:
        """Rms distance of the predicted tip from the circle of contact, m."""
        return rms(self.tip_errors)

    @property
    def few_outlie(self) -> bool:
        """Whether some touches are outliers, but no more than in a sound calibration."""
        return self.others is not self.test

    @property
    def assessment(self) -> Assessment:
        """Grade, reasons, actions."""
        remarks = [Remark(*row[1:]) for row in _remarks(self) if row[0]]
        agree = f'{self.touches} touches' if not remarks else 'the touches'
        note = f'{agree} agree with the calibration (p = {self.p_value:.2g}): {_size(self)}'
        return Assessment.of(remarks, [note] if self.p_value >= LEVEL else [])


def _size(v: Verification) -> str:
    error, expected = map(micrometres, (v.others_tip_error, v.expected))
    return f'the error of the tip is {error} µm (rms), {expected} µm are expected'


def _or_by_few(v: Verification) -> str:
    """That a few touches are enough where parameters of the arm explain what has changed."""
    best, arm = v.causes.ranking[:1], v.record.arm
    if not best or v.causes.is_open(LEVEL) or not set(best[0].values) <= set(NAMES):
        return ''
    if arm.grade == Grade.UNFIT.value or arm.cell.nominal.has_gravity:  # it is no prior, or nothing can be freed
        return ''
    freed = ' '.join(f'--free {name}' for name in best[0].values)
    return f', or bring it up to date by a few touches: `calibrate --from {v.record.source} {freed}`'


def _remarks(v: Verification) -> Iterator[tuple[object, Grade, str, str]]:
    """Whether each remark holds, with its grade, reason and action: contradictions, then why agreement says little."""
    contradicts = v.others.p_value < LEVEL
    excess = np.sqrt(max(v.others_tip_error**2 - v.expected**2, 0.0))
    # the systematic part is then 1.7 times all that is random
    beyond = 2 * excess > v.tolerance if v.tolerance else v.others_tip_error > 2.0 * v.expected
    reason = f'the touches contradict the calibration: {_size(v)}'
    reason += f'; {v.causes.title(LEVEL)}' if v.causes.ranking else ''
    action = 'check that robot, objects and sensor are those of the calibration, then ' * v.causes.is_open(LEVEL)
    action += f'calibrate again{_or_by_few(v)}'
    yield contradicts, Grade.UNFIT if beyond else Grade.CAUTION, reason, action
    reason = f'outliers: {len(v.outlying)} of {v.touches} touches'
    agree = f'; the others agree with the calibration (p = {v.others.p_value:.2g}): {_size(v)}'
    yield v.few_outlie, Grade.CAUTION, reason + agree * (not contradicts), 'look at the outliers'
    for sentence in v.differing:
        yield True, Grade.CAUTION, sentence, 'give the cell of the recording by --cell'
    seen = ', '.join(v.seen) or f'{v.repeated} of {v.touches} touches'
    action = 'verify with touches made after the calibration'
    yield v.seen or v.repeated, Grade.CAUTION, f'part of the calibration: {seen}; that verifies nothing', action
    action = f'make {Limits.fewest_verifying} or more, all round'
    yield v.touches < Limits.fewest_verifying, Grade.CAUTION, f'{v.touches} touches say little', action
    tolerance, errors = v.tolerance or np.inf, micrometres(2 * v.expected)
    reason = f'these touches cannot show a tolerance of {micrometres(tolerance)} µm: twice the expected tip error'
    action = 'reduce the largest of noise, uncertainty of the objects and uncertainty of the calibration'
    yield 2 * v.expected > tolerance, Grade.CAUTION, f'{reason} is {errors} µm', action
    reason = f'there is no touch of {", ".join(v.untouched)}: what changed there is not seen'
    yield v.untouched and v.tolerance, Grade.CAUTION, reason, 'make touches all round all objects'
    highest = v.record.arm.used.highest_force  # from 1.5 times that on compliances are extrapolated
    reason = f'forces of up to {v.largest_force:.3g} N, and the calibration had {highest:.3g} N at most'
    yield v.largest_force > 1.5 * highest, Grade.CAUTION, reason, 'calibrate with the forces of the use'
    grade = v.record.arm.grade
    if grade in (Grade.CAUTION.value, Grade.UNFIT.value):
        yield True, Grade(grade), f'the calibration itself was graded {grade}', 'follow the advice in its report'


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
    used = cell_of_files(record.arm.cell if cell is None else cell, paths)
    detection = gather_touches(paths, used)
    recordings = recordings_of(detection, paths)
    differing: list[str] = []
    if cell is None:
        others = [Path(path) for path in paths if not is_touch_table(path)]
        for path in others:
            check_same_recorded(used, path, record.source)
        # the noise is that of the calibration, the tolerance what its use allows
        differing = other_descriptions(used, others, 'the calibration', ('noise', 'tolerance'))
    return verify(detection, record, used, recordings, differing)


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
    cell = cell or record.arm.cell
    check_same_arm(record.arm.cell, cell, record.source, 'the cell description')
    record = record.in_cell(cell)
    touches, noise = detection.touches.replace(order=np.full(len(detection.touches), LATER)), record.noise_freedoms
    state = CalibratedState.of(record, cell)
    measured = measure(touches, record, state)
    test = others_test = PredictionTest.of(measured, state.known, noise)
    outlies, others = test.p_values < LEVEL / len(touches), measured  # the same for the largest of all (Bonferroni)
    outlies &= outlies.mean() <= Limits.most_rejected  # more are no outliers: something has changed
    if outlies.any():
        others = measured.select(~outlies)
        others_test = PredictionTest.of(others, state.known, noise)
    causes = Causes()
    if others_test.p_value < LEVEL:
        evidence = state.known.change(others.information())
        hypotheses = hypotheses_of(state, np.unique(touches.disc).tolist())
        test_of_others = others_test.chi_square, others_test.freedoms, noise
        causes = Causes.of(ranked(hypotheses, evidence, state), test_of_others)
    effects = ', '.join(Predictor(record.arm).effects_of('time'))
    assumptions = [f'{effects}: time counts from the start of each recording, as in the calibration'] if effects else []
    columns = (touches.index, touches.disc, test.distances, measured.tip_error)
    rows = zip(*(column[outlies].tolist() for column in columns), strict=True)
    return Verification(
        record=record,
        tolerance=cell.tolerance or record.arm.cell.tolerance,
        recordings=tuple(recordings),
        rejected=detection.rejected,
        test=test,
        expected=rms(test.expected),
        others=others_test,
        others_tip_error=rms(others.tip_error),
        outlying=tuple(Outlying(index, cell.discs[disc].name, *numbers) for index, disc, *numbers in rows),
        causes=causes,
        untouched=tuple(disc.name for k, disc in enumerate(cell.discs) if k not in touches.disc),
        seen=tuple(item.path for item in recordings if item.sha256 in record.checksums),
        repeated=count_repeated(touches, record),
        largest_force=float(np.hypot(*touches.force.T).max()),
        numbers=touches.index,
        tip_errors=measured.tip_error,
        differing=tuple(differing),
        warnings=(*detection.warnings, *assumptions),
    )


def count_repeated(touches: TouchSet, record: CalibrationRecord) -> int:
    """How many touches are those of the calibration, as it was told or as it has corrected their forces."""
    own, known = record.joints, np.linalg.norm(record.forces, axis=1)
    alike = (np.abs(touches.joints[:, None] - own) < 1e-6).all(axis=2)  # rad, by rounding in a table
    gain = 1 + record.arm.sensor.gain
    size = np.linalg.norm(touches.force, axis=1)[:, None]
    # of the force, what undetected errors of the sensor correct in it: two touches never agree so well
    same = np.minimum(np.abs(size - known), np.abs(size / gain - known)) < 1e-3 * known
    return int((alike & same).any(axis=1).sum())
