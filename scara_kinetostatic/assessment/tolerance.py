"""Whether the uncertainty of the tip is small enough for the use that the cell description states; what would help."""

from __future__ import annotations

from collections.abc import Iterator

from scara_kinetostatic.assessment.evidence import Conformity, Decision, Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.result import ALTERNATIVES
from scara_kinetostatic.calibration.uncertainty_budget import (
    MORE_TOUCHES,
    Improvement,
    best_improvement,
    source_title,
    uncertainty_budget,
)
from scara_kinetostatic.diagnosis.result import Diagnosis

_MOST_BEYOND = 0.5
"""Part of the workspace beyond the tolerance from which on a result is unfit."""
_ACTIONS = {
    'object_position': 'measure the place of {} to {}',
    'object_radius': 'measure the radius of {} to {}',
    'plate_position': 'measure where plate {} lies to {}',
    'plate_angle': 'measure the rotation of plate {} to {}',
    'radius': 'measure the radius of the tip to {1}',
    'force_gain': 'calibrate the gain of the force sensor to {1}',
    'force_rotation': 'measure the rotation of the force sensor to {1}',
    'nominal': 'find out {} to {}',
}
NOT_STATED = 'cannot be stated: the cause of a model error is unknown, and the uncertainties do not contain it'
"""Of conformity, where the verdict is ``unexplained``."""
_ONE_MM = 1e-3
"""Where the first of two lengths is in mm, the second is, too, m."""
_ALL = {
    'object_position': 'measure the places of all objects to {}',
    'object_radius': 'measure the radii of all objects to {}',
    'plate_position': 'measure where all plates lie to {}',
    'plate_angle': 'measure the rotations of all plates to {}',
}


def conformity(evidence: Evidence) -> Iterator[Remark]:
    """An expanded uncertainty of the tip beyond the tolerance, or too near to it to decide (ISO 14253-1).

    Unfit where it is beyond between the touches, or in more than half of the workspace.
    """
    tolerance, found = evidence.final.cell.tolerance, evidence.conformity
    if tolerance is None or (found is not None and found.decision is Decision.CONFORMS):
        return
    if found is None:
        reason = (
            f'whether the tip keeps the tolerance of {quantity(tolerance, "m")} cannot be decided: its uncertainty '
        )
        yield Remark(Grade.UNFIT, f'{reason}is not determined')
        return
    beyond = found.touched is Decision.DOES_NOT_CONFORM or found.share < 1 - _MOST_BEYOND
    grade = Grade.UNFIT if beyond else Grade.CAUTION
    action = advice(evidence) or 'use it only where the tolerance is met'
    yield Remark(grade, _reason(evidence, found), action + _not_enough(evidence, found))


def _not_enough(evidence: Evidence, found: Conformity) -> str:
    """That no single action meets the tolerance, and what does without the uncertainty of plates; empty if one does."""
    if not evidence.improvements or any(item.worst <= found.tolerance for item in evidence.improvements):
        return ''
    text = f'; no single measurement meets the tolerance of {quantity(found.tolerance, "m")}'
    if not any(plate.center_std or plate.angle_std for plate in evidence.final.cell.plates):
        return text
    relative = "leave out the plate's uncertainty: the result then holds relative to the plate"
    return f'{text}; or, if poses are taught on the plate, {relative}'


def _reason(evidence: Evidence, found: Conformity) -> str:
    worst, tolerance = quantity(found.worst, 'm'), quantity(found.tolerance, 'm')
    undetermined = evidence.tip_uncertainty.undetermined
    if undetermined > 0:
        where = f'in {100 * undetermined:.0f} % of the workspace'
        return f'the uncertainty of the tip is not determined {where}: it may be beyond the tolerance of {tolerance}'
    if found.decision is Decision.UNDECIDED:
        limits = f'{quantity(found.low, "m")} to {quantity(found.high, "m")}, {_why_a_range(evidence)}'
        near = f'too near the tolerance of {tolerance} to decide'
        return f'the expanded uncertainty of the tip is {worst} ({limits}): {near}'
    at = evidence.tip_uncertainty.at
    place = '' if at is None else f', at x {round(at.tip[0], 2) + 0.0:.2f} m, y {round(at.tip[1], 2) + 0.0:.2f} m'
    where = f'it conforms in {100 * found.share:.0f} % of the workspace'
    between = evidence.tip_uncertainty.worst_touched
    if found.touched is Decision.CONFORMS:
        where += f', and wherever the joint angles are between those of the touches (up to {quantity(between, "m")})'
    return f'the expanded uncertainty of the tip is up to {worst} (k = 2){place}, the tolerance {tolerance}; {where}'


def _why_a_range(evidence: Evidence) -> str:
    """Why the expanded uncertainty is itself uncertain."""
    stated = evidence.final.noise_source == 'given'
    return 'as the residuals are larger than the stated noise' if stated else 'as the noise is estimated'


def advice(evidence: Evidence) -> str:
    """The action that reduces the uncertainty of the tip most, one clause with numbers; empty if none is known."""
    worst, tolerance = evidence.tip_uncertainty.worst, evidence.final.cell.tolerance
    budget = uncertainty_budget(evidence.final, evidence.tip_uncertainty)
    if max(budget, key=lambda item: item.tip).label == ALTERNATIVES:
        if evidence.diagnosis.discriminating == ():
            return f'{to_discriminate(evidence.diagnosis)}: the choice among them dominates'
        return 'make the touches that tell the possible causes apart: the choice among them dominates'
    best = best_improvement(evidence.improvements, worst, tolerance)
    return '' if best is None else f'{action(best)}: {_fall(worst, best.worst)}'


def _fall(before: float, after: float) -> str:
    sizes = f'from {quantity(before, "m")} to {quantity(after, "m")}'
    if before >= _ONE_MM > after:
        sizes = f'from {1e3 * before:.2g} mm to {1e3 * after:.2g} mm'
    return f"the tip's expanded uncertainty, where it is largest, falls {sizes}"


def action(item: Improvement) -> str:
    """What to do, in the imperative: ``measure the place of disc_2 to 5 µm``."""
    if item.labels == (MORE_TOUCHES,):
        return f'record {item.wanted:.0f} touches of the same kind instead of {item.declared:.0f}'
    kind, _, target = item.labels[0].rstrip(']').partition('[')
    size = f'{100 * item.wanted:g} %' if item.unit == '1' else quantity(item.wanted, item.unit)
    if len(item.labels) > 1:
        return _ALL[kind].format(size)
    return _ACTIONS.get(kind, f'find out the {source_title(item.labels[0])} to {{1}}').format(target, size)


def kept(evidence: Evidence) -> Iterator[str]:
    """A note where the tolerance is kept, or would be if no model error of unknown cause were there."""
    found = evidence.conformity
    if found is None or found.decision is not Decision.CONFORMS:
        return
    if evidence.diagnosis.verdict == 'unexplained':
        yield f'conformity with the tolerance of {quantity(found.tolerance, "m")} {NOT_STATED}'
        return
    how = 'conforms (ISO 14253-1)'
    if DeclaredErrors.of(evidence.final.cell) is None:
        how = 'conforms as far as noise goes; no uncertainties of discs and sensor are declared'
    yield (
        f'the expanded uncertainty of the tip is at most {quantity(found.worst, "m")} (k = 2) all over the workspace, '
        f'the tolerance {quantity(found.tolerance, "m")}: it {how}'
    )


def to_discriminate(d: Diagnosis) -> str:
    """What tells rivals apart: touches or, where no touch would, another measurement; empty if nothing is known."""
    effects = d.effects_by_label()
    labels = [label for group in d.rivals for label in group[:4] if label in effects]
    if labels and d.discriminating == ():
        effect = effects[labels[0]]
        fixed = ' '.join(f"--fix '{effect.label}.{parameter.name}=VALUE'" for parameter in effect.parameters)
        return f'measure one of the possible causes by other means and hold it, such as by {fixed}'
    touches = dict.fromkeys(effects[label].identified_by for label in labels)
    return f'to tell the causes apart, record {"; or ".join(touches)}' if touches else ''
