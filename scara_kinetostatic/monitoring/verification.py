"""Acceptance of a calibration: touches that it has not seen, held against its prediction.

All touches together are tested by a chi-square that contains the uncertainty of the calibration
(`linear.PredictionTest`). The error of the tip, the root mean square distance of the predicted tip from the circle that
it touches, is compared with what noise and uncertainty let expect.

**What the touches would have shown**, for each parameter the smallest change that contradicts the calibration: a change
d of one parameter gives the chi-square of all touches the noncentrality λ = d² Λ_jj (`linear.Evidence`). It is seen
with the probability `POWER` where λ lifts the noncentral chi-square beyond the quantile of the test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chndtrinc

from scara_kinetostatic.assessment.grade import LIMITS, Assessment, Grade, Remark
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.bags.reader import other_descriptions
from scara_kinetostatic.calibration.fit_point import base_force
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.model.touch import LATER, Rejection, TouchSet
from scara_kinetostatic.monitoring.hypotheses import Explanation, explanations, hypotheses_of, rivals
from scara_kinetostatic.monitoring.linear import (
    LINEAR,
    Evidence,
    Information,
    Measured,
    PredictionTest,
    State,
    measure,
    p_values,
    quantile,
)
from scara_kinetostatic.monitoring.record import (
    CalibrationRecord,
    check_same_arm,
    check_same_recorded,
    of_new_recordings,
)
from scara_kinetostatic.pipeline import gather_touches, recording_of
from scara_kinetostatic.touches.detection import Detection
from scara_kinetostatic.touches.table import cell_of_files

POWER = 0.95
"""Probability with which a change of the size that is stated is seen."""


class Detectable(NamedTuple):
    """The smallest change of one parameter that touches show.

    Attributes:
        name: of the parameter.
        unit: SI.
        change: its size; infinite where the touches say nothing of the parameter.
        tip: rms displacement of the predicted tip by it, at the touches of the calibration, m.
    """

    name: str
    unit: str
    change: float
    tip: float

    @property
    def text(self) -> str:
        """Parameter, change and displacement of the tip."""
        if not np.isfinite(self.change):
            return f'{self.name} of any size'
        return f'{self.name} by {quantity(self.change, self.unit)} (tip: {quantity(self.tip, "m")} rms)'


def detectable_changes(
    record: CalibrationRecord, state: State, evidence: Evidence, freedoms: int, level: float
) -> list[Detectable]:
    """For each parameter that the calibration estimated, those first whose undetected change moves the tip most.

    Args:
        record: the calibration.
        state: what may be off.
        evidence: of the touches.
        freedoms: of their chi-square.
        level: p-value below which they contradict the calibration.
    """
    noncentrality = float(chndtrinc(quantile(1 - level, freedoms, record.noise_freedoms), freedoms, 1 - POWER))
    diagonal = np.diag(evidence.matrix)
    found = []
    for place, name in enumerate(NAMES):
        if name in record.fixed:
            continue
        seen = diagonal[place] > 1e-9 * diagonal.max(initial=1e-12)
        change = float(state.scale[place] * np.sqrt(noncentrality / diagonal[place])) if seen else np.inf
        found.append(Detectable(name, UNITS[name], change, _moved(record, place, change)))
    return sorted(found, key=lambda item: -item.tip)


def _moved(record: CalibrationRecord, place: int, change: float) -> float:
    """Rms displacement of the predicted tip by a change of one value, m."""
    if not np.isfinite(change):
        return np.inf
    model = record.arm.model
    values = model.as_array().copy()
    values[place] += change
    return rms(record.tip_moved(record.arm, replace(record.arm, model=model.with_array(values))))


LEVEL = 1e-3
"""p-value below which the touches contradict the calibration. Source: of a thousand sound ones, one is refused."""
MOST_OUTLYING = 0.1
"""Part of the touches that may be outliers in a sound calibration. Source: `assessment.LIMITS.most_rejected`."""
FEWEST = 6
"""Fewer touches say little: caution. Source: twelve numbers for twelve parameters."""


class Outlying(NamedTuple):
    """A touch that the prediction does not explain.

    Attributes:
        touch: its number in the recordings.
        object: name of the object.
        distance: from the prediction, in standard deviations.
        tip_error: distance of the predicted tip from the circle of contact, m.
    """

    touch: int
    object: str
    distance: float
    tip_error: float


class Verification(NamedTuple):
    """The outcome of a verification.

    Attributes:
        record: the calibration.
        cell: in which the touches were made.
        recordings: what was verified with.
        assessment: grade, reasons, actions.
        touches: how many.
        rejected: touches that the detection rejected.
        test: of all touches.
        p_value: of the calibration being right.
        tip_error: rms distance of the predicted tip from the circle of contact, m.
        expected: the same expected from noise and the uncertainty of the calibration, m.
        nominal_tip_error: the same of the nominal parameters, m.
        others_p_value: the p-value without the outliers, where these are few; else `p_value`.
        others_tip_error: their tip error, m.
        outlying: single touches that contradict the prediction.
        ranking: what may have changed, the best first; empty where nothing contradicts.
        rivals: names of those that explain the touches about as well as the first.
        remaining_p_value: of nothing else having changed than the first says; 1 where nothing contradicts.
        detectable: the smallest change of each parameter that the touches show, that which moves the tip most first.
        seen: recordings that were part of the calibration.
        repeated: how many touches were part of it, whatever recording or table they come from.
        numbers: of the touches in the recordings, (n,).
        tip_errors: of each touch, (n,), m.
        differing: recordings that contain another cell description, one sentence each.
        warnings: irregularities of the recordings.
    """

    record: CalibrationRecord
    cell: Cell
    recordings: tuple[Recording, ...]
    assessment: Assessment
    touches: int
    rejected: tuple[Rejection, ...]
    test: PredictionTest
    p_value: float
    tip_error: float
    expected: float
    nominal_tip_error: float
    others_p_value: float
    others_tip_error: float
    outlying: tuple[Outlying, ...]
    ranking: tuple[Explanation, ...]
    rivals: tuple[str, ...]
    remaining_p_value: float
    detectable: tuple[Detectable, ...]
    seen: tuple[str, ...]
    repeated: int
    numbers: Indices
    tip_errors: Floats
    differing: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def few_outlie(self) -> bool:
        """Whether some touches are outliers, but no more than in a sound calibration."""
        return 0 < len(self.outlying) <= MOST_OUTLYING * self.touches

    @property
    def tolerance(self) -> float | None:
        """Of the tip, m: that of the cell in which the touches were made, or of the calibration."""
        return self.cell.tolerance or self.record.arm.cell.tolerance


def assess(v: Verification, largest_force: float) -> Assessment:
    """The grade with its reasons.

    Args:
        v: the verification; its own assessment does not count.
        largest_force: of its touches, N.
    """
    remarks = [*_contradiction(v), *_limits(v, largest_force)]
    if v.record.arm.grade in (Grade.CAUTION.value, Grade.UNFIT.value):
        reason = f'the calibration itself was graded {v.record.arm.grade}'
        remarks.append(Remark(Grade(v.record.arm.grade), reason, 'see its report'))
    agree = f'{v.touches} touches' if not remarks else 'the touches'
    note = f'{agree} agree with the calibration (p = {v.p_value:.2g}): {_size(v)}'
    return Assessment.of(remarks, [note] if v.p_value >= LEVEL else [])


def _size(v: Verification) -> str:
    error, expected = (quantity(value, 'm') for value in (v.others_tip_error, v.expected))
    return f'the error of the tip is {error} (rms), {expected} are expected'


def _contradiction(v: Verification) -> list[Remark]:
    """What the touches have against the calibration."""
    found = []
    if v.others_p_value < LEVEL:
        excess = np.sqrt(max(v.others_tip_error**2 - v.expected**2, 0.0))
        # the systematic part is then 1.7 times all that is random
        beyond = 2 * excess > v.tolerance if v.tolerance else v.others_tip_error > 2.0 * v.expected
        what, action = '', 'calibrate again'
        if v.remaining_p_value < LEVEL:
            what = f'; no single part explains it, the largest is: {v.ranking[0].hypothesis.title}'
            action = 'check that robot, objects and sensor are those of the calibration, then calibrate again'
        elif v.ranking:
            what = f'; most likely {v.ranking[0].hypothesis.title}'
        reason = f'the touches contradict the calibration: {_size(v)}{what}'
        found.append(Remark(Grade.UNFIT if beyond else Grade.CAUTION, reason, action))
    if v.few_outlie:
        reason = f'{len(v.outlying)} of {v.touches} touches are outliers'
        if v.others_p_value >= LEVEL:
            reason += f'; the others agree with the calibration (p = {v.others_p_value:.2g}): {_size(v)}'
        found.append(Remark(Grade.CAUTION, reason, 'look at the outliers'))
    return found


def _limits(v: Verification, largest_force: float) -> list[Remark]:
    """Why agreement would say little."""
    found = [Remark(Grade.CAUTION, sentence, 'give the cell of the recording by --cell') for sentence in v.differing]
    if v.seen:
        reason = f'{", ".join(v.seen)} was part of the calibration: touches that it has seen verify nothing'
        found.append(Remark(Grade.CAUTION, reason, 'verify with touches made after the calibration'))
    elif v.repeated:
        reason = f'{v.repeated} of {v.touches} touches were part of the calibration: they verify nothing'
        found.append(Remark(Grade.CAUTION, reason, 'verify with touches made after the calibration'))
    if v.touches < FEWEST:
        found.append(Remark(Grade.CAUTION, f'{v.touches} touches say little', f'make {FEWEST} or more, all round'))
    if v.tolerance and 2 * v.expected > v.tolerance:
        errors = f'twice the expected error of the tip is {quantity(2 * v.expected, "m")}'
        reason = f'these touches cannot show a tolerance of {quantity(v.tolerance, "m")}: {errors}'
        action = 'reduce the largest of noise, uncertainty of the objects and uncertainty of the calibration'
        found.append(Remark(Grade.CAUTION, reason, action))
    if v.tolerance and v.detectable and v.detectable[0].tip > v.tolerance:
        reason = f'the touches do not show a change of {v.detectable[0].text}, which is beyond the tolerance'
        found.append(Remark(Grade.CAUTION, reason, 'make more touches, all round all objects, at several forces'))
    scatter = float(np.sqrt(v.test.chi_square / v.test.freedoms))
    if v.p_value > 1 - LEVEL and scatter < LIMITS.noise_overstated:
        reason = f'the residuals are {scatter:.2g} times what is expected: a change may hide below the stated noise'
        found.append(Remark(Grade.CAUTION, reason, 'state noise and uncertainties as they are'))
    if largest_force > 1.5 * v.record.arm.used.highest_force:  # from here on compliances are extrapolated
        highest = v.record.arm.used.highest_force
        reason = f'forces of up to {largest_force:.3g} N, and the calibration had {highest:.3g} N at most'
        found.append(Remark(Grade.CAUTION, reason, 'calibrate with the forces of the use'))
    return found


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
    # the noise is that of the calibration, the tolerance what its use allows
    return other_descriptions(cell, [Path(path) for path in paths], 'the calibration', ('noise', 'tolerance'))


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
    outlying = test.p_values < 1e-3 / len(touches)  # the same for the largest of all touches (Bonferroni)
    few = 0 < outlying.sum() <= MOST_OUTLYING * len(touches)
    others = measured.select(~outlying) if few else measured
    others_test = PredictionTest.of(others, state.covariance, record.noise_freedoms) if few else test
    evidence = Evidence.of(Information.of(others), state.covariance)
    hypotheses = hypotheses_of(state, np.unique(touches.disc).tolist())
    ranking = explanations(evidence, state, hypotheses) if others_test.p_value < LEVEL else []
    nominal_tip_error, largest_force = _nominal(detection, cell)
    found = Verification(
        record=record,
        cell=cell,
        recordings=tuple(recordings),
        assessment=Assessment(Grade.FIT, (), ()),
        touches=len(touches),
        rejected=detection.rejected,
        test=test,
        p_value=test.p_value,
        tip_error=rms(measured.tip_error),
        expected=rms(test.expected),
        nominal_tip_error=nominal_tip_error,
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
        differing=tuple(differing),
        warnings=(*detection.warnings, *of_new_recordings(record)),
    )
    return found._replace(assessment=assess(found, largest_force))


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
        # by rounding in a table: two touches never agree so well
        found |= np.isfinite(own.query(np.hstack([touches.joints, force]), p=np.inf, distance_upper_bound=1e-6)[0])
    return int(found.sum())


def _nominal(detection: Detection, cell: Cell) -> tuple[float, float]:
    """Rms distance of the nominal tip under load from the circle of contact, m, and the largest force, N."""
    o, nominal = observe(detection.touches, cell), ExtendedModel(cell.nominal)
    force = base_force(o, nominal)
    tip, _ = direct_kinetostatics(nominal, o.joints, force, o.gripper)
    return rms(np.linalg.norm(tip - o.centers, axis=1) - o.radii), float(np.hypot(*force.T).max())
