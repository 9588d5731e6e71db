"""What a grade is, and an assessment made of remarks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from scara_kinetostatic.model.quantity import quantity as quantity


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
