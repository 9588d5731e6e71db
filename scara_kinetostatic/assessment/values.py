"""Whether the parameters have values, and such as a robot can have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import special

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.coverage import GEOMETRY
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.assessment.redundancy import MORE_TOUCHES
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.parameters import NAMES, UNITS

_NOT_NEGATIVE = ('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2')
_MANY = 4
"""So many parameters without a value are more than some touches of a kind would mend."""


def mistake(evidence: Evidence) -> Iterator[Remark]:
    """A mistake in the cell description or in the touches."""
    if evidence.mistake is not None:
        yield Remark(Grade.UNFIT, evidence.mistake.text, evidence.mistake.action)


def undetermined(evidence: Evidence) -> Iterator[Remark]:
    """Parameters without a value: unfit where the place of the unloaded tip depends on them."""
    c = evidence.final
    groups = [set(group) & set(NAMES) for group in c.identifiability.confounded]
    names = [name for name in NAMES if any(name in group for group in groups)]
    if not names:
        return
    action = MORE_TOUCHES if len(names) > _MANY else c.identifiability.advice
    if set(names) & set(NAMES[:GEOMETRY]):
        listed = 'any parameter' if len(names) == len(NAMES) else ', '.join(names)
        yield Remark(Grade.UNFIT, f'the touches do not determine {listed}, nor where the tip is', action)
        return
    size = np.hypot(*c.force[c.used].T)
    yield Remark(
        Grade.CAUTION,
        f'the touches do not determine {", ".join(names)} each by itself: the result holds at '
        f'{size.min():.0f} to {size.max():.0f} N, as touched, and may not elsewhere',
        action,
    )


def negative(evidence: Evidence) -> Iterator[Remark]:
    """Compliances and backlashes below zero beyond their uncertainty."""
    c = evidence.final
    bound = negative_bound(c)
    for name in _NOT_NEGATIVE:
        value, std = getattr(c.parameters, name), c.std_of(name)
        if std > 0 and value < -bound * std and not (name == 'g_ee' and evidence.mistake):
            yield Remark(
                Grade.UNFIT,
                f'{name} is negative, {quantity(value, UNITS[name])} ± {quantity(std, UNITS[name])}: no robot is like '
                'that; something else is wrong that has the same effect',
                _CHECKS[name],
            )


def negative_bound(c: Calibration) -> float:
    """Standard uncertainties below zero from which on a value is negative."""
    if c.noise_source == 'given':
        return thresholds.NEGATIVE
    probability = float(special.ndtr(-thresholds.NEGATIVE))
    return -float(special.stdtrit(c.degrees_of_freedom, probability))


_RADII = 'check the radii in the cell description: they reach to the centre of the tip'
_SLIP = 'preload every other touch: a joint that slips under load looks like a negative backlash'
_FORCE = 'check the gain, the frame and the sign of the force sensor'
_CHECKS = {'g_ee': _RADII, 'g1': _SLIP, 'g2': _SLIP, 'p_ee': _FORCE, 'p1': _FORCE, 'p2': _FORCE}
"""What to check where a value is negative."""


def large_backlash(evidence: Evidence) -> Iterator[Remark]:
    """A backlash of the gripper that is rather an error of all radii."""
    value, std = evidence.final.parameters.g_ee, evidence.final.std_of('g_ee')
    if std > 0 and value - 2 * std > thresholds.LARGEST_GRIPPER_BACKLASH:
        size = quantity(value, 'm')
        yield Remark(
            Grade.CAUTION,
            f'the backlash of the gripper, g_ee, is {size}: it has that much play, or all radii are stated {size} too '
            'large, which touches cannot distinguish',
            'check the radii in the cell description, and the gripper for play',
        )
