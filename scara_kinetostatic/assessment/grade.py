"""What a grade is, and an assessment made of remarks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import NamedTuple

from scara_kinetostatic.model.parameters import quantity as quantity


class Grade(str, Enum):
    """The answer to "may I use these numbers?".

    The verdict of the diagnosis answers another question, whether the model is complete: a model error that was found
    and corrected leaves a result that is fit, and eight touches that fit perfectly do not make one.
    """

    FIT = 'fit'
    """Use it: the values hold within their standard uncertainties, and the touches have checked that."""
    CAUTION = 'caution'
    """Use it within the limits that the reasons state: elsewhere the values or their uncertainties may not hold."""
    UNFIT = 'unfit'
    """Do not use it: the tip or the force may be wrong by more than is stated, or nothing has checked them."""

    @property
    def severity(self) -> int:
        """0 of `FIT`, 1 of `CAUTION`, 2 of `UNFIT`."""
        return list(Grade).index(self)


class Remark(NamedTuple):
    """What one criterion says.

    Attributes:
        grade: the best grade that it leaves.
        reason: one clause, without a capital at its beginning unless it starts with a name.
        action: what to do, in the imperative; empty if nothing.
    """

    grade: Grade
    reason: str
    action: str = ''


caution, unfit = partial(Remark, Grade.CAUTION), partial(Remark, Grade.UNFIT)


@dataclass(frozen=True)
class Assessment:
    """The answer to "may I use these numbers?".

    Attributes:
        grade: ``fit``, ``caution`` or ``unfit``.
        reasons: why, the gravest first; what it was judged without comes last.
        actions: what to do, in the order of the reasons; empty where nothing is to be done.
    """

    grade: Grade
    reasons: tuple[str, ...]
    actions: tuple[str, ...]

    @classmethod
    def of(cls, remarks: Iterable[Remark], notes: Iterable[str] = ()) -> Assessment:
        """The assessment made of remarks, in the order of their severity, and of notes, which come last."""
        ordered = sorted(remarks, key=lambda remark: -remark.grade.severity)
        worst = max((remark.grade for remark in ordered), key=lambda grade: grade.severity, default=Grade.FIT)
        actions = dict.fromkeys(remark.action for remark in ordered if remark.action)
        return cls(worst, (*(remark.reason for remark in ordered), *notes), tuple(actions))

    @property
    def headline(self) -> str:
        """Grade and first reason, one line."""
        return f'{self.grade.value}: {self.reasons[0]}'


class Limits:
    """Every number that decides about a grade: meaning, source. What the grades mean says `Grade`.

    What they achieve is measured by `benchmark/assessment.py`: results that must not be fit, and good recordings
    that must.
    """

    leverage_caution: float = 0.9
    """Leverage of a touch above which an error of it hardly shows in its residual: caution. Source: redundancy numbers
    below 0.1 count as badly checked in adjustment theory (W. Förstner, Zeitschrift für Vermessungswesen 104 (1979)
    446).
    """
    leverage_unfit: float = 0.99
    """The same above which nothing checks the touch: unfit. Source: as before, redundancy numbers below 0.01."""
    least_freedoms: int = 10
    """Degrees of freedom below which the residuals say too little of the noise: caution. Source: GUM (JCGM 100), table
    E.1: a standard deviation from ten observations is itself uncertain by 24 %.
    """
    held_out_caution: float = 3.0
    """Force error on held-out touches, in those of the fit, above which touches do not predict each other well:
    caution. Source: least squares with 24 touches in an even plan give 1.9 at most, with 36 and more 1.6.
    """
    held_out_unfit: float = 6.0
    """The same above which the result is unfit. Source: twice the former."""
    left_out: float = 2.0
    """Error of the tip at objects left out of the fit over what is stated, above which the stated uncertainty is
    doubtful: caution. Source: convention, a factor of two.
    """
    negative: float = 4.0
    """Standard uncertainties below zero beyond which a compliance or backlash is negative: unfit. Source: of the six,
    none of which is below zero in truth, one then is in two of ten thousand calibrations at most; with estimated noise
    the quantile of Student's t of the same probability.
    """
    largest_gripper_backlash: float = 5e-4
    """Backlash of the gripper above which an error common to all radii, its exact alias, is the likelier reason:
    caution, m. Source: twice the largest that the paper measured (figure 4(d): 0.055 to 0.205 mm), and more than any
    sound gripper has.
    """
    concentration: float = 0.01
    """Probability by chance below which rejected touches are concentrated in one object, recording or span of time; of
    all such groups together (Bonferroni). Source: the accepted rate of false alarms of the diagnosis.
    """
    most_rejected: float = 0.1
    """Part of the touches rejected by the fit above which: caution. Source: up to it the standard uncertainties hold
    (`benchmark/statistics`, section outliers).
    """
    most_unusable: float = 1 / 3
    """Part of the touches found that are not used, for whatever reason, above which: caution. Source: convention."""
    model_error_unfit: float = 2.0
    """Reduced chi-square above which an unexplained model error is larger than the noise, so that standard
    uncertainties say nothing of its bias: unfit, below caution. Source: noise alone gives 1, an error as large as it 2.
    """
    model_error_share: float = 0.5
    """The same where the noise is estimated and contains the error: part of the sum of squares of the residual that the
    most significant dependence explains.
    """
    noise_factor: float = 3.0
    """Residuals without a pattern, in stated noise, above which the noise is no statement of the cell: unfit, below
    caution. Source: such residuals enlarge the standard uncertainties, by a factor that their distribution must
    justify.
    """
    noise_overstated: float = 0.5
    """Residuals in stated noise below which standard uncertainties are too large to be of use: caution. Source: half.
    """
    better_upright: float = 0.5
    """Force error with gravity over that without, below which the arm stands upright: unfit. Source: half.
    """
    force_range: float = 1.5
    """Largest over smallest force of the touches below which other forces are an extrapolation: caution. Source: p_ee
    and g_ee need two levels; at 1.5 their columns are still nearly proportional.
    """
    extrapolation: float = 10.0
    """Largest standard uncertainty of the unloaded tip in the workspace, in the median of those at the touches, above
    which the touches cover too small a part of it: caution. Source: one order of magnitude; three discs in an even plan
    give 3.
    """
