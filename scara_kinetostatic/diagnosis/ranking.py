"""Each effect of the catalogue ranked by itself: significance, predictive gain, detection limit.

The predictive deviance leaves out one touch after the other, in closed form: with H the projection on all columns of a
model and H_i its 2×2 block, the residual of a left-out touch is (I - H_i)⁻¹ e_i with covariance s² (I - H_i)⁻¹, so
minus twice its logarithmic predictive density is e_iᵀ (I - H_i)⁻¹ e_i / s² - ln det(I - H_i) up to a constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.diagnosis.candidates import Candidate, independent_part
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets
from scara_kinetostatic.diagnosis.thresholds import INDEPENDENT_PART, NONCENTRALITY, ROUNDING
from scara_kinetostatic.model.arrays import Floats

_LEAST_DETERMINANT = 1e-6
"""Of I - H_i; less is that of a touch which alone determines a parameter."""


class Score(NamedTuple):
    """One effect by itself.

    Attributes:
        candidate: the effect, and the trial by which it would be present.
        p_value: of "it is not there", corrected for the search over its trials.
        share: part of the residual's sum of squares that it explains.
        gain: decrease of the penalised deviance.
        held_out: decrease of the predictive deviance on touches left out, less 2 ln t for the
            search over t trials, which is not repeated; above 0 they are predicted better than by the base model.
        independent_part: largest part of a unit column of it that is independent of the base model.
    """

    candidate: Candidate
    p_value: float
    share: float
    gain: float
    held_out: float
    independent_part: float


def score_singles(problem: Problem, scored_subsets: ScoredSubsets) -> tuple[Score, ...]:
    """Every effect by itself, by its best trial, the best first."""
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
    """Largest bias of a base parameter by an effect at the detection limit.

    This is the external reliability of adjustment theory (Baarda, A Testing Procedure for Use in Geodetic
    Networks, 1968): the effect has the size at which it would nearly always be found, `NONCENTRALITY`,
    and, if it has several parameters, the worst direction.

    Args:
        problem: the touches.
        candidate: the effect.
        std: standard deviations of the base parameters, (12,); NaN or 0 where there is none.

    Returns:
        The bias in standard deviations, and the index of the parameter.
    """
    columns = problem.columns(candidate.trial)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    _, values, right = np.linalg.svd(columns - problem.base @ (problem.base.T @ columns), full_matrices=False)
    identifiable = values > INDEPENDENT_PART
    bias = (problem.response @ columns) @ (right[identifiable].T / values[identifiable]) * np.sqrt(NONCENTRALITY)
    in_std = np.nan_to_num(np.linalg.norm(bias, axis=1) / np.where(std > 0, std, np.inf))
    return float(in_std.max()), int(np.argmax(in_std))


def significance(problem: Problem, candidate: Candidate) -> tuple[float, float]:
    """F-test of one candidate (Bonferroni over its trials), and the part of the sum of squares it explains.

    A fitted effect may add nothing that is independent of the base model; then it is not significant.
    """
    total = float(problem.left @ problem.left)
    rank = candidate.unit.shape[1]
    freedoms = problem.freedoms - rank
    if rank == 0 or freedoms < 1 or total < ROUNDING * len(problem.left):
        return 1.0, 0.0
    explained = float(np.sum((candidate.unit.T @ problem.left) ** 2))
    ratio = (explained / rank) / (max(total - explained, 1e-300) / freedoms)
    return min(1.0, candidate.tried * float(special.fdtrc(rank, freedoms, ratio))), explained / total


def held_out_deviance(problem: Problem, unit: Floats | None, scale: float) -> float:
    """Minus twice the logarithmic predictive density of all touches, each left out in turn.

    Args:
        problem: the touches.
        unit: columns of effects beside the base model, (2n, k); None for none.
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
    det = np.maximum(a * d - b * b, _LEAST_DETERMINANT)
    distance = (d * e[:, 0] ** 2 - 2 * b * e[:, 0] * e[:, 1] + a * e[:, 1] ** 2) / det
    return float(np.sum(distance / scale - np.log(det)))
