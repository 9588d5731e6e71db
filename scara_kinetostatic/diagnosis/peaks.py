"""Other frequencies that fit as well: an effect may have been found at the wrong one.

Of a slow wave the offsets and lengths take up the greater part, and what is left looks like another wave; of a small
one the neighbouring peak may be the higher by chance. So every frequency that the data do not rule out is fitted, and
the standard deviations must hold for all of them.
"""

from __future__ import annotations

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.alternatives import fit_variants
from scara_kinetostatic.diagnosis.candidates import Candidate, as_fitted, explained, gains, refined, scan_trials
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal, pose_problem
from scara_kinetostatic.diagnosis.refit import effect_values, start_from
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE
from scara_kinetostatic.effects.base import Effect

Floats = NDArray[np.float64]

GRID_LOSS = 0.2
"""Part of what a wave explains that may be missing at the frequency of the grid next to it, and some more."""
MOST = 4
"""Peaks that are fitted at most, the highest first."""
APART = 3.0
"""Standard deviations by which a frequency is another one."""


def fit_alternative_frequencies(extended: Calibration, in_every_model: Container[str]) -> list[Calibration]:
    """The touches of an extended model fitted with other frequencies of its effects that fit them as well.

    Args:
        extended: the fit with effects.
        proved: labels of effects that have no rivals; beside rivals, which draw a wave in part, a frequency is vague.
    """
    laws = [law for law in extended.model.effects if isinstance(law, Effect)]
    waves = [k for k, law in enumerate(laws) if law.grid_parameter and law.label in in_every_model]
    if not waves:
        return []
    problem = pose_problem(extended)
    values = effect_values(extended)
    found = [as_fitted(problem, law, part, 1) for law, (part, _) in zip(laws, values, strict=True)]
    variants = []
    for place in waves:
        frequency, std = (part[laws[place].grid_parameter_index] for part in values[place])
        for peak in _peaks(problem, found, place, max(1.0, extended.reduced_chi_square)):
            if abs(peak.trial.place - frequency) <= APART * std:
                continue
            start, _ = start_from(problem, [*found[:place], peak, *found[place + 1 :]])
            variants.append(start)
    return fit_variants(extended, variants)


def _peaks(problem: Problem, found: list[Candidate], place: int, scale: float) -> list[Candidate]:
    """The other frequencies of an effect that explain nearly as much, beside the other effects."""
    effect = found[place].effect
    trials = effect.trials(problem.touch_state, problem.force)
    others = [candidate.unit for k, candidate in enumerate(found) if k != place]
    beside = orthonormal(np.concatenate(others, axis=1)) if others else None
    scan = scan_trials(problem, effect, trials, len(trials))
    gained = gains(problem, scan, beside)
    low = np.concatenate([[-np.inf], gained, [-np.inf]])
    tops = np.flatnonzero((gained >= low[:-2]) & (gained >= low[2:]))
    most = float(gained.max())
    warm_start = [int(k) for k in tops if gained[k] > (1 - GRID_LOSS) * most - CREDIBLE * scale]
    peaks = [refined(problem, scan, k, beside) for k in warm_start]
    return sorted(peaks, key=lambda peak: -explained(problem, peak))[:MOST]
