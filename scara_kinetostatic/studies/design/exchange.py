"""Fedorov's exchange: a set of touches is improved by replacing one touch at a time.

The criterion is the largest variance of the tip over the workspace. Adding a touch changes the covariance C = I⁻¹ by -C
Jᵀ (1 + J C Jᵀ)⁻¹ J C, so that all candidates for one position in the set are evaluated by a few matrix products. The
largest variance is not smooth, and exchange stops early at its edges; a mean of high power of the variances is smooth
and is minimised first.

For a set that checks itself (`self_check`) the criterion is the largest variance after the loss of any one touch, times
a penalty for the largest leverage. An exchange is sought for the worst few losses and accepted if it lowers the
criterion over all of them; every disc keeps its touches.

Source: Fedorov, Theory of Optimal Experiments (1972), chapter 3.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.design.candidates import CandidateTouches, pack
from scara_kinetostatic.studies.design.self_check import leverage_with_each, leverages, may_be_added, penalty

Counts: TypeAlias = NDArray[np.intp]
"""A number for each disc."""

_LEAST_GAIN = 1e-4
"""Smallest relative decrease of the criterion for which touches are exchanged."""
_SWEEPS = 12
"""Largest number of passes over all positions of a set."""
_DOUBLINGS = 4
"""The smooth criterion is the mean of power 2**DOUBLINGS."""
_WORST_CASES = 3
"""Number of the worst losses for which an exchange is sought."""


def largest_variance(
    candidates: CandidateTouches, chosen: list[int], checked: bool = False, *, smooth: bool = False
) -> float:
    """Largest variance of the tip over the workspace, m².

    Args:
        candidates: the candidates.
        chosen: the set, indices of candidates.
        checked: whether the variance after the loss of the touch that matters most is meant, times the penalty for the
            largest leverage.
        smooth: whether the smooth criterion is meant.
    """
    largest = float(_criterion(candidates.variance(_inverse(_cases(candidates, chosen, checked))), smooth).max())
    return largest * float(penalty(leverages(candidates, chosen)).max()) if checked else largest


def improve(candidates: CandidateTouches, chosen: list[int], least: Counts | None = None) -> list[int]:
    """Exchanges touches until none lowers the smooth criterion, then the largest variance, then that with checks.

    Args:
        candidates: the candidates.
        chosen: the set to start from, indices of candidates.
        least: smallest number of touches on each disc, (D,), in a set that checks itself; None for any set.
    """
    chosen = _improve(candidates, chosen, _Stage(False, True), least)
    chosen = _improve(candidates, chosen, _Stage(False, False), least)
    return chosen if least is None else _improve(candidates, chosen, _Stage(True, False), least)


class _Stage(NamedTuple):
    checked: bool
    smooth: bool


def _improve(candidates: CandidateTouches, chosen: list[int], stage: _Stage, least: Counts | None) -> list[int]:
    checked, smooth = stage
    chosen, best = list(chosen), largest_variance(candidates, chosen, checked, smooth=smooth)
    for _ in range(_SWEEPS):
        before = best
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            values = variance_with_each(candidates, others, checked, smooth=smooth)
            values[chosen] = np.inf
            if least is not None:
                values[~may_be_added(candidates, others, least)] = np.inf
            found = int(np.argmin(values))
            if values[found] < best * (1 - _LEAST_GAIN):
                trial = [*others[:place], found, *others[place:]]
                reached = largest_variance(candidates, trial, True) if checked else float(values[found])
                if reached < best * (1 - _LEAST_GAIN):
                    chosen, best = trial, reached
        if best > before * (1 - 10 * _LEAST_GAIN):
            break
    return chosen


def variance_with_each(
    candidates: CandidateTouches, chosen: list[int], checked: bool = False, *, smooth: bool = False
) -> Floats:
    """The criterion with each candidate added to a set, (n,), m²; with checks a lower bound of it."""
    covariances = _inverse(_cases(candidates, chosen, checked))
    if checked:
        order = np.argsort(_criterion(candidates.variance(covariances), False))
        covariances = covariances[order[-_WORST_CASES:]]
    values = np.max([_criterion(_added(candidates, covariance), smooth) for covariance in covariances], axis=0)
    return np.asarray(values * penalty(leverage_with_each(candidates, chosen)) if checked else values)


def _inverse(information: Floats) -> Floats:
    return np.asarray(np.linalg.inv(information), dtype=float)


def _cases(candidates: CandidateTouches, chosen: list[int], checked: bool) -> Floats:
    """Information of the set, or, with checks, of the set without each of its touches, (c, 12 + m, 12 + m)."""
    together = candidates.information_of(chosen)[None]
    return together - candidates.information[chosen] if checked else together


def _added(candidates: CandidateTouches, covariance: Floats) -> Floats:
    """Variance of the tip at each place with each candidate added, (n, g), m²."""
    through = candidates.derivative @ covariance
    innovation = np.eye(2) + through @ np.swapaxes(candidates.derivative, 1, 2)
    root = np.linalg.cholesky(np.linalg.inv(innovation))
    gain = np.swapaxes(root, 1, 2) @ through[:, :, candidates.rows]
    less = candidates.traces(pack(np.swapaxes(gain, 1, 2) @ gain))
    return np.asarray(np.maximum(candidates.variance(covariance) - less, 0.0))


def _criterion(variance: Floats, smooth: bool) -> Floats:
    """The largest over the places, (…), or the smooth criterion."""
    largest = variance.max(axis=-1)
    if not smooth:
        return np.asarray(largest)
    part = variance / largest[..., None]
    for _ in range(_DOUBLINGS):
        part *= part
    return np.asarray(largest * part.mean(axis=-1) ** (0.5**_DOUBLINGS))
