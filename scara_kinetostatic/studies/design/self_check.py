"""What a set of touches has to have so that it checks itself: small leverages, and touches on every disc.

**Leverage.** The block of a touch on the diagonal of the hat matrix is H = J C Jᵀ, (2, 2), with J its whitened Jacobian
and C the covariance with all touches. With λ its larger eigenvalue, the residual shows at least the part 1 - λ of an
error of the touch. Without the touch the covariance is C + C Jᵀ (I - H)⁻¹ J C, so that the standard deviation of any
combination of parameters becomes at most 1/√(1 - λ) times as large. In a set without a leverage above `MOST_LEVERAGE`
no single touch is so important that its loss makes a standard deviation more than `LOSS_FACTOR` times as large: one
bound on the leverages stands for both.

**Touches not seen.** One touch lost is not all that the assessment of a calibration asks for: see `held_out`.

**Discs.** A disc that was moved or measured wrongly shows in its own touches. Two find its new place, a third one
checks that.

Source: Förstner, Zeitschrift für Vermessungswesen 104 (1979) 446: the redundancy number 1 - λ; in adjustment practice
errors count as well detectable above 0.3, as hardly detectable below 0.1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.design.candidates import CandidateTouches

MOST_LEVERAGE = 0.8
"""Largest leverage in a set that checks itself: a fifth of any error of a touch shows in its residual."""
LOSS_FACTOR = float(1 / np.sqrt(1 - MOST_LEVERAGE))
"""The factor by which the loss of one touch of such a set increases a standard deviation at most: 2.24."""
TOUCHES_PER_DISC = 3
"""Touches on each disc in a set that checks itself."""


def leverages(candidates: CandidateTouches, chosen: list[int]) -> Floats:
    """Leverage of each touch of a set, (m,)."""
    rows = candidates.derivative[chosen]
    covariance = np.linalg.inv(candidates.information_of(chosen))
    return _larger_eigenvalue(*_entries(np.einsum('nik,kl,njl->nij', rows, covariance, rows, optimize=True)))


def leverage_with_each(candidates: CandidateTouches, chosen: list[int]) -> Floats:
    """Largest leverage in a set (m,) with each candidate added, (n,).

    With a touch i the blocks become H_jj - G (I + H_ii)⁻¹ Gᵀ with G = J_j C J_iᵀ, and its own (I + H_ii)⁻¹ H_ii.
    """
    rows, every = candidates.derivative[chosen], candidates.derivative
    k = every.shape[2]
    through = every.reshape(-1, k) @ np.linalg.inv(candidates.information_of(chosen))
    a, b, c = _entries(np.einsum('nik,njk->nij', through.reshape(every.shape), every))
    largest = _larger_eigenvalue(a, b, c)
    l11 = np.sqrt(1 + a)  # Cholesky factor of I + H_ii
    l21 = b / l11
    l22 = np.sqrt(1 + c - l21**2)
    cross = (rows.reshape(-1, k) @ through.T).reshape(len(rows), 2, len(every), 2)
    first = cross[..., 0] / l11
    second = (cross[..., 1] - first * l21) / l22
    own = np.einsum('nik,njk->nij', through.reshape(every.shape)[chosen], rows)
    entries = (
        own[:, i, j, None] - first[:, i] * first[:, j] - second[:, i] * second[:, j]
        for i, j in ((0, 0), (1, 0), (1, 1))
    )
    others = _larger_eigenvalue(*entries).max(axis=0, initial=0.0)
    return np.maximum(largest / (1 + largest), others)


def penalty(leverage: Floats) -> Floats:
    """Factor on the variance for a leverage above the largest allowed one: by which the worst loss is worse."""
    return np.asarray(np.maximum(1.0, (1 - MOST_LEVERAGE) / np.maximum(1 - leverage, 1e-12)))


def least_on_discs(candidates: CandidateTouches, weights: Floats, number: int) -> NDArray[np.intp]:
    """Smallest number of touches on each disc in a set of a given number, (D,).

    Where there are more discs than the touches suffice for, those count that the approximate design touches most.

    Args:
        candidates: the candidates.
        weights: of the candidates in the approximate design, (n,).
        number: of touches in the set.
    """
    available = np.bincount(candidates.plan.disc)
    share = np.bincount(candidates.plan.disc, weights=weights)
    least = np.minimum(available, TOUCHES_PER_DISC)
    least[np.argsort(-share, kind='stable')[number // TOUCHES_PER_DISC :]] = 0
    return np.asarray(least)


def may_be_added(candidates: CandidateTouches, others: list[int], least: NDArray[np.intp]) -> Mask:
    """Candidates that leave enough touches on every disc when one is added to a set, (n,)."""
    missing = least > np.bincount(candidates.plan.disc[others], minlength=len(least))
    allowed = missing[candidates.plan.disc] if missing.any() else np.ones(len(candidates.plan), dtype=bool)
    allowed[others] = False
    return np.asarray(allowed)


def _entries(blocks: Floats) -> tuple[Floats, Floats, Floats]:
    return blocks[:, 0, 0], blocks[:, 1, 0], blocks[:, 1, 1]


def _larger_eigenvalue(a: Floats, b: Floats, c: Floats) -> Floats:
    """Of symmetric matrices [[a, b], [b, c]]."""
    return np.asarray((a + c) / 2 + np.hypot((a - c) / 2, b))
