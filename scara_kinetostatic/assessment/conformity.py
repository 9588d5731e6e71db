"""Conformity of the tip's expanded uncertainty with a tolerance, with its guard band (ISO 14253-1).

The tolerance is the largest expanded uncertainty U = 2 u that the use allows. U is itself estimated where the noise is:
with the part u_A of noise from ν degrees of freedom and the rest u_B, the one-sided limits of 95 % of U are

    U± = 2 √(u_A² ν / χ²_ν(0.05 or 0.95) + u_B²),

and U - U-, U+ - U the guard bands. As ISO 14253-1 has it, conformity is shown where U+ is at most the tolerance, the
contrary where U- is beyond it; between, neither is shown. Where the noise is stated, and covers the residuals, both
guard bands are zero.

The effective degrees of freedom are those of Welch and Satterthwaite (GUM, JCGM 100, G.4.1): ν_eff = ν (u / u_A)⁴.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, TipUncertainty

_CONFIDENCE = 0.95
"""Of each guard band, one-sided: the usual one (ISO 14253-1)."""


class Decision(str, Enum):
    """What is decided about a tolerance."""

    CONFORMS = 'conforms'
    UNDECIDED = 'cannot be decided'
    DOES_NOT_CONFORM = 'does not conform'


class Conformity(NamedTuple):
    """The worst expanded uncertainty of the tip against a tolerance.

    Attributes:
        decision: about the whole workspace.
        tolerance: m.
        worst: U where it is largest, m.
        low: its lower limit, m.
        high: its upper limit, m.
        effective_freedoms: ν_eff; infinite where the noise is stated.
        share: part of the workspace where U is at most the tolerance, 0 to 1.
        touched: the decision where the joint angles are between those of the touches; None where no place is.
    """

    decision: Decision
    tolerance: float
    worst: float
    low: float
    high: float
    effective_freedoms: float
    share: float
    touched: Decision | None


def conformity(c: Calibration, tip: TipUncertainty) -> Conformity | None:
    """Compare with the tolerance of the cell.

    Args:
        c: the calibration.
        tip: its uncertainty of the tip.

    Returns:
        The comparison; None where the cell states no tolerance, or the uncertainty is not determined.
    """
    tolerance = c.cell.tolerance
    if tolerance is None or tip.at is None or not np.isfinite(tip.worst):
        return None
    u = tip.worst / COVERAGE_FACTOR
    noise = min(float(tip.at.gradient @ c.contributions[0].covariance @ tip.at.gradient), u**2)
    freedoms = c.degrees_of_freedom if c.noise_source == 'estimated' or c.enlargement > 1 else np.inf
    low, high = (_limit(u, noise, freedoms, part) for part in (_CONFIDENCE, 1 - _CONFIDENCE))
    values = np.concatenate([each.expanded.ravel() for each in tip.maps])
    values = values[np.isfinite(values)]
    parts = low / u / COVERAGE_FACTOR, high / u / COVERAGE_FACTOR
    between, decision = tip.worst_touched, _decide(low, high, tolerance)
    if tip.undetermined > 0 and decision is Decision.CONFORMS:
        decision = Decision.UNDECIDED
    return Conformity(
        decision=decision,
        tolerance=tolerance,
        worst=tip.worst,
        low=low,
        high=high,
        effective_freedoms=freedoms * (u**2 / noise) ** 2 if noise > 0 else np.inf,
        share=float(np.mean(values <= tolerance)) * (1 - tip.undetermined),
        touched=_decide(parts[0] * between, parts[1] * between, tolerance) if np.isfinite(between) else None,
    )


def _limit(u: float, noise: float, freedoms: float, part: float) -> float:
    """A limit of U: the noise part has the size that would be exceeded with a probability of `part`."""
    factor = 1.0 if np.isinf(freedoms) else freedoms / float(chdtri(freedoms, 1 - part))
    return COVERAGE_FACTOR * float(np.sqrt(max(u**2 - noise, 0.0) + noise * factor))


def _decide(low: float, high: float, tolerance: float) -> Decision:
    if high <= tolerance:
        return Decision.CONFORMS
    return Decision.DOES_NOT_CONFORM if low > tolerance else Decision.UNDECIDED
