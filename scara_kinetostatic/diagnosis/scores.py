"""How single candidates score: significance, and the gain on touches held out.

The held-out score leaves out one touch after the other, in closed form: with H the projection on all columns of a
model and H_i its 2×2 block, the residual of a left-out touch is (I - H_i)⁻¹ e_i with covariance (I - H_i)⁻¹, so
minus twice its logarithmic predictive density is e_iᵀ (I - H_i)⁻¹ e_i / s² - ln det(I - H_i). More parameters pay
for themselves only if they predict touches that they have not seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from scara_kinetostatic.diagnosis.candidates import LEAST_INDEPENDENT_PART, Candidate, independent_part
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets

Floats = NDArray[np.float64]

FOUND = 40.0
"""Noncentrality at which an effect is found in all but a few of a hundred recordings."""
ROUNDING = 1e-8
"""Mean square of a whitened residual below which it is rounding error."""


class Score(NamedTuple):
    """One effect by itself.

    Attributes:
        candidate: the effect, and the way in which it would be present.
        p_value: of "it is not there", the search over its trials counted.
        share: part of the residual's sum of squares that it explains.
        gain: minus twice the logarithmic likelihood, less its price: what it gains by itself.
        held_out: gain of minus twice the logarithmic predictive density on touches left out, less 2 ln t for the
            search over t trials, which is not repeated; above 0 they are predicted better than by the twelve.
        new: largest part of a unit column of it that is new beside the twelve.
    """

    candidate: Candidate
    p_value: float
    share: float
    gain: float
    held_out: float
    independent_part: float


def score_singles(problem: Problem, scored_subsets: ScoredSubsets) -> tuple[Score, ...]:
    """Every effect by itself, in its best way, the best first."""
    nothing = held_out_deviance(problem, None, scored_subsets.scale)
    empty = next(subset for subset in scored_subsets.subsets if not subset.members)
    found: dict[str, Score] = {}
    for subset in scored_subsets.subsets:  # the best first
        if len(subset.members) != 1:
            continue
        candidate = scored_subsets.candidate_set.candidates[subset.members[0]]
        if candidate.effect.label in found:
            continue
        p_value, share = significance(problem, candidate)
        part = independent_part(problem, problem.columns(candidate.trial))[1]
        held_out = (
            nothing - held_out_deviance(problem, candidate.unit, scored_subsets.scale) - 2 * np.log(candidate.tried)
        )
        gain = empty.score - subset.score
        found[candidate.effect.label] = Score(candidate, p_value, share, gain, float(held_out), part)
    return tuple(found.values())


def undetected_bias(problem: Problem, candidate: Candidate, std: Floats) -> tuple[float, int]:
    """How far an effect that is just too small to be found may bend one of the twelve.

    This is the external reliability of adjustment theory (Baarda, A Testing Procedure for Use in Geodetic
    Networks, 1968): the effect has the size at which it would be found nearly always, noncentrality `FOUND`,
    and, of an effect with several parameters, the worst direction.

    Args:
        problem: the touches.
        candidate: the effect.
        std: standard deviations of the twelve, (12,); NaN or 0 where there is none.

    Returns:
        The shift in standard deviations, and the place of the parameter it moves most.
    """
    columns = problem.columns(candidate.trial)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    _, values, right = np.linalg.svd(columns - problem.base @ (problem.base.T @ columns), full_matrices=False)
    seen = values > LEAST_INDEPENDENT_PART
    shift = (problem.response @ columns) @ (right[seen].T / values[seen]) * np.sqrt(FOUND)
    moved = np.linalg.norm(shift, axis=1) / np.where(std > 0, std, np.inf)
    moved = np.nan_to_num(moved)
    return float(moved.max()), int(np.argmax(moved))


def significance(problem: Problem, candidate: Candidate) -> tuple[float, float]:
    """F-test of one candidate (Bonferroni over its trials), and the part of the sum of squares it explains."""
    total = float(problem.left @ problem.left)
    rank = candidate.unit.shape[1]
    freedoms = problem.freedoms - rank
    if freedoms < 1 or total < ROUNDING * len(problem.left):
        return 1.0, 0.0
    explained = float(np.sum((candidate.unit.T @ problem.left) ** 2))
    ratio = (explained / rank) / (max(total - explained, 1e-300) / freedoms)
    return min(1.0, candidate.tried * float(special.fdtrc(rank, freedoms, ratio))), explained / total


def held_out_deviance(problem: Problem, unit: Floats | None, scale: float) -> float:
    """Minus twice the logarithmic predictive density of all touches, each left out in turn.

    Args:
        problem: the touches.
        unit: columns beside the twelve, (2n, k); None for none.
        scale: s².
    """
    base, left = problem.base, problem.left
    if unit is not None:
        unit = orthonormal(unit, base)
        left = left - unit @ (unit.T @ left)
        base = np.concatenate([base, unit], axis=1)
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - np.einsum('nik,njk->nij', rows, rows)
    e = left.reshape(-1, 2)
    a, b, d = kept[:, 0, 0], kept[:, 0, 1], kept[:, 1, 1]
    det = np.maximum(a * d - b * b, 1e-6)
    distance = (d * e[:, 0] ** 2 - 2 * b * e[:, 0] * e[:, 1] + a * e[:, 1] ** 2) / det
    return float(np.sum(distance / scale - np.log(det)))
