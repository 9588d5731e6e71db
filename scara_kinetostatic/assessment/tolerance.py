"""Whether the uncertainty of the tip is small enough for the use that the cell description states; what would help."""

from __future__ import annotations

from collections.abc import Iterator

from scara_kinetostatic.assessment.evidence import Decision, Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.calibration.declared_errors import RIVALS, DeclaredErrors
from scara_kinetostatic.calibration.uncertainty_budget import NOISE, Improvement, best_improvement, source_title
from scara_kinetostatic.diagnosis.result import Diagnosis

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
"""What to do about a source of uncertainty, by its kind: of what, and to which uncertainty."""


def conformity(evidence: Evidence) -> Iterator[Remark]:
    """An expanded uncertainty of the tip beyond the tolerance, or too near to it to decide (ISO 14253-1).

    Unfit where it is beyond between the touches, or in more than half of the workspace.
    """
    cell, found, tip = evidence.final.cell, evidence.conformity, evidence.tip_uncertainty
    tolerance, region = cell.tolerance, cell.region.title
    if tolerance is None or (found is not None and found.decision is Decision.CONFORMS):
        return
    limit, worst = quantity(tolerance, 'm'), quantity(tip.worst, 'm')
    if found is None or tip.at is None:
        yield Remark(Grade.UNFIT, f'the uncertainty of the tip is not determined, the tolerance is {limit}')
        return
    reason = f'the expanded uncertainty of the tip is up to {worst} (k = 2), at {tip.at.title}'
    if tip.undetermined > 0:
        reason += f', and not determined in {100 * tip.undetermined:.0f} % of the {region}'
    reason += f', the tolerance {limit}; it conforms in {100 * found.share:.0f} % of the {region}'
    if found.decision is Decision.UNDECIDED:
        reason += f'; {quantity(found.low, "m")} to {quantity(found.high, "m")} is too near to decide'
    elif found.touched is Decision.CONFORMS:
        between = quantity(tip.worst_touched, 'm')
        reason += f', and wherever the joint angles are between those of the touches (up to {between})'
    action = advice(evidence) or 'use it only where the tolerance is met'
    if evidence.improvements and not any(item.worst <= tolerance for item in evidence.improvements):
        action += f'; no single measurement meets the tolerance of {limit}'
    beyond = found.touched is Decision.DOES_NOT_CONFORM or found.share < 0.5
    yield Remark(Grade.UNFIT if beyond else Grade.CAUTION, reason, action)


def stated_conformity(evidence: Evidence) -> str:
    """What may be said of the conformity with the tolerance, after 'conformity '; empty where nothing is stated."""
    found = evidence.conformity
    if found is None:
        return ''
    if found.decision is Decision.DOES_NOT_CONFORM:
        return 'excluded'
    if found.decision is Decision.UNDECIDED:
        return 'neither shown nor excluded'
    if evidence.diagnosis.verdict == 'unexplained':
        return 'cannot be stated: the cause of a model error is unknown'
    if DeclaredErrors.of(evidence.final.cell) is None and not evidence.final.has_undetected:
        return 'shown as far as noise goes: no uncertainties of discs and sensor are declared'
    return 'shown (ISO 14253-1)'


def kept(evidence: Evidence) -> Iterator[str]:
    """A note where the tolerance is kept, or would be if no model error of unknown cause were there."""
    found, tolerance = evidence.conformity, evidence.final.cell.tolerance
    if tolerance is not None and found is not None and found.decision is Decision.CONFORMS:
        most = f'the expanded uncertainty of the tip is at most {quantity(evidence.tip_uncertainty.worst, "m")} (k = 2)'
        limit = f'all over the {evidence.final.cell.region.title}, the tolerance {quantity(tolerance, "m")}'
        yield f'{most} {limit}: conformity {stated_conformity(evidence)}'


def advice(evidence: Evidence) -> str:
    """The action that reduces the uncertainty of the tip most, one clause with numbers; empty if none is known."""
    worst = evidence.tip_uncertainty.worst
    if max(evidence.budget, key=lambda item: item.tip).label == RIVALS:
        touches, d = 'make the touches that tell the possible causes apart', evidence.diagnosis
        discriminate = to_discriminate(d) if d.discriminating == () else touches
        return f'{discriminate}: the choice among them dominates'
    best = best_improvement(evidence.improvements, worst, evidence.final.cell.tolerance)
    if best is None:
        return ''
    falls = f'from {quantity(worst, "m")} to {quantity(best.worst, "m")}'
    return f"{action(best)}: the tip's expanded uncertainty, where it is largest, falls {falls}"


def action(item: Improvement) -> str:
    """What to do, in the imperative: ``measure the place of disc_2 to 5 µm``."""
    if item.labels == (NOISE,):
        return f'record {item.wanted:.0f} touches of the same kind instead of {item.declared:.0f}'
    kind = item.labels[0].partition('[')[0]
    target = ', '.join(label.rstrip(']').partition('[')[2] for label in item.labels)
    size = f'{100 * item.wanted:g} %' if item.unit == '1' else quantity(item.wanted, item.unit)
    return _ACTIONS.get(kind, f'find out the {source_title(item.labels[0])} to {{1}}').format(target, size)


def to_discriminate(d: Diagnosis) -> str:
    """What tells rivals apart: touches or, where no touch would, another measurement; empty if nothing is known."""
    effects = d.effects_by_label()
    labels = [label for group in d.rivals for label in group[:4] if label in effects]
    if labels and d.discriminating == ():
        effect = effects[labels[0]]
        fixed = ' '.join(f"--fix '{effect.label}.{parameter.name}=VALUE'" for parameter in effect.parameters)
        return f'measure one of the causes by other means and hold it (true less stated, SI), such as by {fixed}'
    touches = dict.fromkeys(effects[label].identified_by for label in labels)
    return f'to tell the causes apart, record {"; or ".join(touches)}' if touches else ''
