"""The outcome of a verification and its grade: what its touches have against the calibration, and why agreement would
say little.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.grade import Assessment, Grade, Remark
from scara_kinetostatic.assessment.outcome import Recording
from scara_kinetostatic.assessment.thresholds import NOISE_OVERSTATED
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.monitoring.hypotheses import Explanation
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.sensitivity import Detectable

LEVEL = 1e-3
"""p-value below which the touches contradict the calibration. Source: of a thousand sound ones, one is refused."""
MOST_OUTLYING = 0.1
"""Part of the touches that may be outliers in a sound calibration. Source: `assessment.thresholds.MOST_REJECTED`."""
FEWEST = 6
"""Fewer touches say little: caution. Source: twelve numbers for twelve parameters."""
MOST_FORCE = 1.5
"""Force, in the largest of the calibration, from which on its compliances are extrapolated."""
LARGE = 2.0
"""Tip error, in what was expected, from which on a contradicted calibration is unfit, where no tolerance is stated.
Source: the systematic part is then 1.7 times all that is random.
"""


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
        chi_square: of all touches.
        degrees_of_freedom: two per touch.
        quantile: of the distribution of `chi_square` at `prediction_test.QUANTILE`.
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
        expected_errors: standard deviation expected of each, (n,), m.
        differing: recordings that contain another cell description, one sentence each.
        warnings: irregularities of the recordings.
    """

    record: CalibrationRecord
    cell: Cell
    recordings: tuple[Recording, ...]
    assessment: Assessment
    touches: int
    rejected: tuple[Rejection, ...]
    chi_square: float
    degrees_of_freedom: int
    quantile: float
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
    expected_errors: Floats
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
        beyond = 2 * excess > v.tolerance if v.tolerance else v.others_tip_error > LARGE * v.expected
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
    scatter = float(np.sqrt(v.chi_square / v.degrees_of_freedom))
    if v.p_value > 1 - LEVEL and scatter < NOISE_OVERSTATED:
        reason = f'the residuals are {scatter:.2g} times what is expected: a change may hide below the stated noise'
        found.append(Remark(Grade.CAUTION, reason, 'state noise and uncertainties as they are'))
    if largest_force > MOST_FORCE * v.record.arm.used.highest_force:
        highest = v.record.arm.used.highest_force
        reason = f'forces of up to {largest_force:.3g} N, and the calibration had {highest:.3g} N at most'
        found.append(Remark(Grade.CAUTION, reason, 'calibrate with the forces of the use'))
    return found
