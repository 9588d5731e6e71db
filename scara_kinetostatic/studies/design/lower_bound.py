"""How few touches can possibly do: a lower bound from the theory of optimal design.

Let touches be shared out over the candidates in any parts ξ, fractions and repetitions allowed: the information of
N touches is N Σ ξ_i I_i. The best largest variance of the tip is then φ*/N, and no real set of N touches is better.
φ* is bracketed. For any weights λ of the places, L = Σ λ_g T_gᵀT_g and C = (Σ ξ_i I_i)⁻¹, the Cauchy–Schwarz
inequality gives for every other share ξ'

    tr(L C(ξ')) ≥ tr(L C)² / max_i tr(C L C I_i),

whatever ξ and λ are; and the largest variance is no less than the mean by λ. Hence N ≥ φ/target² with the right side
for φ. ξ and λ that make the bound tight are found by multiplicative iterations; ξ also says from which candidates good
sets are drawn.

Sources: Kiefer, Annals of Statistics 2 (1974) 849; Silvey, Titterington and Torsney, Communications in
Statistics A 7 (1978) 1379, for the iteration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.studies.design.candidates import PRIOR, Pool

Floats = NDArray[np.float64]

ITERATIONS = 400
SPEED = 6.0
"""Of the weights of the places; falls with the root of the iterations."""
FAINT = 1e-9
"""Part of the prior that keeps matrices regular where the rank is less than 12."""


class Bound(NamedTuple):
    """What no set of touches can beat.

    Attributes:
        least: the largest variance of the tip with N touches is no less than this over N, m².
        reached: the same for the parts found: the truth lies between, m².
        parts: of the candidates, ξ, (n,).
    """

    least: float
    reached: float
    parts: Floats

    def number(self, target: float) -> int:
        """No fewer touches reach a largest standard deviation of the tip of `target`, m."""
        return int(np.ceil(self.least / target**2 - 1e-9))


def find_bound(pool: Pool, iterations: int = ITERATIONS) -> Bound:
    """Bracket φ*.

    Args:
        pool: the candidates and the places.
        iterations: more make the bound tighter; it is right after any number.
    """
    parts = np.full(len(pool.plan), 1 / len(pool.plan))
    weights = np.full(pool.quadric.shape[1], 1 / pool.quadric.shape[1])
    least, reached = 0.0, np.inf
    for step in range(iterations):
        information = np.tensordot(parts, pool.information, axes=1) + FAINT * PRIOR
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=float)
        variance = pool.variance(covariance)
        through = pool.derivative @ covariance[:, pool.rows]
        gain = np.einsum('nik,kl,nil->n', through, _square(pool.quadric @ weights), through, optimize=True)
        mean, largest = float(weights @ variance), float(variance.max())
        least, reached = max(least, mean**2 / float(gain.max())), min(reached, largest)
        parts = _shares(parts * np.sqrt(gain))
        weights = _shares(weights * np.exp(SPEED / np.sqrt(step + 1) * (variance / largest - 1)))
    return Bound(least, reached, parts)


def _shares(values: Floats) -> Floats:
    return values / values.sum()


def _square(packed: Floats) -> Floats:
    """The symmetric matrix that `pack(…, twice=True)` packed."""
    k = int((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    lower = np.zeros((k, k))
    lower[np.tril_indices(k)] = packed
    return (lower + lower.T) / 2
