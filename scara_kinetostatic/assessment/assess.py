"""The assessment: every criterion in turn, each of which may leave remarks."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from scara_kinetostatic.assessment import completeness, coverage, redundancy, rejections, tolerance, values
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Assessment, Grade, Remark
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.diagnosis.result import Found

CRITERIA: tuple[Callable[[Evidence], Iterator[Remark]], ...] = (
    values.mistake,
    redundancy.convergence,
    values.negative,
    values.undetermined,
    rejections.rejected,
    redundancy.held_out,
    redundancy.leverage,
    redundancy.freedoms,
    completeness.unexplained,
    completeness.ambiguous,
    completeness.shifted,
    completeness.noise,
    rejections.unusable,
    values.large_backlash,
    tolerance.conformity,
    coverage.postures,
    coverage.forces,
    coverage.places,
)
"""In the order in which equally grave reasons are given."""


def assess(evidence: Evidence) -> Assessment:
    """Whether a result may be used, why, and what to do.

    Args:
        evidence: the calibration with all that speaks for or against its use.
    """
    remarks = [remark for criterion in CRITERIA for remark in criterion(evidence)]
    remarks = remarks or [Remark(Grade.FIT, _nothing_against(evidence))]
    corrections = [Remark(Grade.FIT, reason, action) for reason, action in _corrections(evidence)]
    return Assessment.of([*remarks, *corrections], _notes(evidence))


def _nothing_against(evidence: Evidence) -> str:
    """The reason of a result that is fit."""
    errors = evidence.comparison.extended
    return (
        f'{int(evidence.final.used.sum())} touches determine all parameters and check them, by a force error of '
        f'{errors.held_out:.2g} N on touches that the fit has not seen'
    )


def _corrections(evidence: Evidence) -> Iterator[tuple[str, str]]:
    """Model errors that the result corrects; those of the cell description are to be corrected there as well."""
    for item in evidence.diagnosis.found:
        if item.in_every_model and item.effect.is_physical and not item.effect.is_stepwise:
            yield f'{item.effect.finding}: corrected in this result', _correction(item)


def _correction(item: Found) -> str:
    """What to measure again; empty where the cell description says nothing of it."""
    found = {value.name: value.value for value in item.values}
    if not found or not np.isfinite(list(found.values())).all():
        return ''
    return item.effect.correction(found)


def _notes(evidence: Evidence) -> Iterator[str]:
    """What the result was judged without."""
    c = evidence.final
    if c.fixed:
        yield f'held at given values, which count as exact: {", ".join(c.fixed)}'
    yield from tolerance.kept(evidence)
    missing = []
    if DeclaredErrors.of(c.cell) is None:
        missing.append('no uncertainties (discs, radii and sensor count as exact)')
    if c.cell.tolerance is None:
        missing.append('no tolerance')
    if missing:
        yield f'the cell description declares {" and ".join(missing)}'
