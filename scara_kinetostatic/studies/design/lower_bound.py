"""Lower bound of the number of touches for an accuracy, from the theory of optimal approximate designs.

An approximate design distributes the touches over the candidates by weights ξ, fractions and repetitions allowed: the
information of N touches is N Σ ξ_i I_i + P, with P the prior of the errors that the cell declares; P = 0 where it
declares none. No real set of N touches is better than the best approximate design. Its largest variance of the tip is
bounded from below: for any weights λ of the places, L = Σ λ_g T_gᵀT_g, and any symmetric C, the Cauchy–Schwarz
inequality gives for every design ξ', with covariance C' = (N Σ ξ'_i I_i + P)⁻¹,

    tr(L C') ≥ tr(L C)² / tr(C L C C'⁻¹) ≥ tr(L C)² / (N max_i tr(C L C I_i) + tr(C L C P)),

and the largest variance is no less than the mean weighted by λ. So N touches reach a variance v only if
N ≥ (tr(L C)²/v - tr(C L C P)) / max_i tr(C L C I_i). ξ, C = (N Σ ξ_i I_i + P)⁻¹ and λ that make the bound tight are
found by multiplicative iterations; every iteration leaves a bound, and the best one counts. With P = 0 the iterations
do not depend on N; else they are made for the number of touches that the accuracy takes, as far as it can be reached,
and the bound is less tight, but still valid, for other numbers.

Sets for the exchange are drawn by ξ.

Sources: Kiefer, Annals of Statistics 2 (1974) 849; Silvey, Titterington and Torsney, Communications in
Statistics A 7 (1978) 1379, for the iteration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.design.candidates import PRIOR, CandidateTouches

_ITERATIONS = 400
"""More iterations tighten the bound; it is valid after any number."""
_STEP_SIZE = 6.0
"""Step of the logarithms of the weights λ in the first iteration; it decreases with the root of the iterations."""
_REGULARISATION = 1e-9
"""Part of the prior that is added so that matrices are regular where the rank is less than 12."""
MOST_TOUCHES = 200
"""Largest set that is searched for."""
_FEWEST = 7
"""Smallest number of touches for which the iterations are made."""


class LowerBound(NamedTuple):
    """Bounds of the largest variance of the tip for all designs, and the approximate design found.

    Attributes:
        mean: tr(L C) of each iteration, (s,), m².
        gain: max_i tr(C L C I_i), (s,), m².
        prior: tr(C L C P), (s,), m²; 0 without declared uncertainties.
        reached: largest variance of the approximate design found, for `touches`, m².
        touches: number of touches for which the iterations were made; 1 without declared uncertainties.
        weights: of the candidates in that design, ξ, (n,).
    """

    mean: Floats
    gain: Floats
    prior: Floats
    reached: float
    touches: float
    weights: Floats

    def variance(self, number: float) -> float:
        """The largest variance of the tip with this many touches is at least this, m²."""
        return float((self.mean**2 / (number * self.gain + self.prior)).max())

    def number(self, target: float) -> int:
        """Number of touches below which no set reaches a largest standard deviation of the tip of `target`, m."""
        needed = float(((self.mean**2 / target**2 - self.prior) / self.gain).max())
        return max(0, int(np.ceil(needed - 1e-9)))


def find_lower_bound(candidates: CandidateTouches, target: float, iterations: int = _ITERATIONS) -> LowerBound:
    """Bounds the largest variance of the tip.

    Args:
        candidates: the candidates and the tip.
        target: largest standard deviation of the tip for which the bound is to be tight, m.
        iterations: more make the bound tighter; it is valid after any number.
    """
    number = _number_for(candidates, target) if len(candidates.declared) else 1.0
    declared = candidates.declared.T @ candidates.declared
    regular = declared.copy()
    regular[: len(PRIOR), : len(PRIOR)] += _REGULARISATION * PRIOR
    design = np.full(len(candidates.plan), 1 / len(candidates.plan))  # ξ
    places = np.full(candidates.quadric.shape[1], 1 / candidates.quadric.shape[1])  # λ
    bounds, reached = [], np.inf
    for step in range(iterations):
        information = number * np.tensordot(design, candidates.information, axes=1) + regular
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=float)
        variance = candidates.variance(covariance)
        squares = _unpack(candidates.quadric @ places)
        through = candidates.derivative @ covariance[:, candidates.rows]
        gain = np.einsum('nik,kl,nil->n', through, squares, through, optimize=True)
        known = candidates.declared @ covariance[:, candidates.rows]
        by_prior = float(np.einsum('pk,kl,pl->', known, squares, known))
        mean, largest = float(places @ variance), float(variance.max())
        bounds.append((mean, float(gain.max()), by_prior))
        reached = min(reached, largest)
        design = _normalised(design * np.sqrt(gain))
        places = _normalised(places * np.exp(_STEP_SIZE / np.sqrt(step + 1) * (variance / largest - 1)))
    mean_of_each, gain_of_each, prior_of_each = np.array(bounds).T
    return LowerBound(mean_of_each, gain_of_each, prior_of_each, reached, number, design)


def _number_for(candidates: CandidateTouches, target: float) -> float:
    """Number of touches, evenly distributed, that reach the target; `MOST_TOUCHES` where more would be needed."""
    mean = candidates.information.mean(axis=0)
    for number in np.geomspace(_FEWEST, MOST_TOUCHES, 24):
        covariance: Floats = np.asarray(np.linalg.inv(number * mean + candidates.prior), dtype=float)
        if candidates.variance(covariance).max() <= target**2:
            break
    return float(number)


def _normalised(values: Floats) -> Floats:
    return values / values.sum()


def _unpack(packed: Floats) -> Floats:
    """The symmetric matrix of a vector made by `pack(…, twice=True)`."""
    k = int((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    lower = np.zeros((k, k))
    lower[np.tril_indices(k)] = packed
    return (lower + lower.T) / 2
