"""Lower bound of the number of touches for an accuracy, from the theory of optimal approximate designs.

An approximate design distributes the touches over the candidates by weights ξ, fractions and repetitions allowed: the
information of N touches is N Σ ξ_i I_i. The smallest possible largest variance of the tip is then φ*/N, and no real set
of N touches is better. φ* is bracketed. For any weights λ of the places, L = Σ λ_g T_gᵀT_g and C = (Σ ξ_i I_i)⁻¹, the
Cauchy–Schwarz inequality gives for every other design ξ'

    tr(L C(ξ')) ≥ tr(L C)² / max_i tr(C L C I_i),

for any ξ and λ; and the largest variance is no less than the mean weighted by λ. Hence N ≥ φ/target² with the right
side for φ. ξ and λ that make the bound tight are found by multiplicative iterations; sets for the exchange are drawn by
ξ.

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


class LowerBound(NamedTuple):
    """Bracket of φ*, and the approximate design found.

    Attributes:
        least: lower end: the largest variance of the tip with N touches is at least this over N, m².
        reached: upper end: that of the approximate design found, m².
        weights: of the candidates in that design, ξ, (n,).
    """

    least: float
    reached: float
    weights: Floats

    def number(self, target: float) -> int:
        """Number of touches below which no set reaches a largest standard deviation of the tip of `target`, m."""
        return int(np.ceil(self.least / target**2 - 1e-9))


def find_lower_bound(candidates: CandidateTouches, iterations: int = _ITERATIONS) -> LowerBound:
    """Brackets φ*.

    Args:
        candidates: the candidates and the tip.
        iterations: more make the bound tighter; it is valid after any number.
    """
    design = np.full(len(candidates.plan), 1 / len(candidates.plan))  # ξ
    places = np.full(candidates.quadric.shape[1], 1 / candidates.quadric.shape[1])  # λ
    least, reached = 0.0, np.inf
    for step in range(iterations):
        information = np.tensordot(design, candidates.information, axes=1) + _REGULARISATION * PRIOR
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=float)
        variance = candidates.variance(covariance)
        through = candidates.derivative @ covariance[:, candidates.rows]
        gain = np.einsum('nik,kl,nil->n', through, _unpack(candidates.quadric @ places), through, optimize=True)
        mean, largest = float(places @ variance), float(variance.max())
        least, reached = max(least, mean**2 / float(gain.max())), min(reached, largest)
        design = _normalised(design * np.sqrt(gain))
        places = _normalised(places * np.exp(_STEP_SIZE / np.sqrt(step + 1) * (variance / largest - 1)))
    return LowerBound(least, reached, design)


def _normalised(values: Floats) -> Floats:
    return values / values.sum()


def _unpack(packed: Floats) -> Floats:
    """The symmetric matrix of a vector made by `pack(…, twice=True)`."""
    k = int((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    lower = np.zeros((k, k))
    lower[np.tril_indices(k)] = packed
    return (lower + lower.T) / 2
