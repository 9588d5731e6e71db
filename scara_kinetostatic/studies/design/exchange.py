"""Exchange of touches one by one (Fedorov): how good a set is, and how it is made better.

One touch changes the covariance C = I⁻¹ by -C Jᵀ (1 + J C Jᵀ)⁻¹ J C, so that all candidates for one place in the
set are judged in a few matrix products. The largest variance over the workspace has edges at which exchange gets
stuck; its stand-in, a mean of high power, has none. A set is improved by the stand-in first.

With a `spare`, the judgement is on what is left after the loss of the touch that is missed most; exchanges are
found among the few worst losses, and accepted by all.

Source: Fedorov, Theory of Optimal Experiments (1972), chapter 3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.studies.design.candidates import Pool, pack

Floats = NDArray[np.float64]

GAIN = 1e-4
"""An exchange that gains a smaller part is not worth it."""
SWEEPS = 12
DOUBLINGS = 4
"""The stand-in is the mean of power 2**DOUBLINGS."""
WORST = 3
"""So many of the worst losses are looked at when an exchange is sought."""


def largest_variance(pool: Pool, chosen: list[int], spare: int = 0, *, smooth: bool = False) -> float:
    """Largest variance of the tip over the workspace, m²; with a spare, after the worst loss."""
    return float(_judge(pool.variance(_inverse(_cases(pool, chosen, spare))), smooth).max())


def improve(pool: Pool, chosen: list[int], spare: int = 0, sweeps: int = SWEEPS) -> list[int]:
    """Exchange until nothing helps: by the stand-in, then by the largest variance, then with the spare."""
    for stage_spare, smooth in [(0, True), (0, False), (1, False)][: 2 + spare]:
        chosen = _improve(pool, chosen, stage_spare, smooth, sweeps)
    return chosen


def _improve(pool: Pool, chosen: list[int], spare: int, smooth: bool, sweeps: int) -> list[int]:
    chosen, best = list(chosen), largest_variance(pool, chosen, spare, smooth=smooth)
    for _ in range(sweeps):
        before = best
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            judged = with_each(pool, others, spare, smooth=smooth)
            judged[chosen] = np.inf
            found = int(np.argmin(judged))
            if judged[found] < best * (1 - GAIN):
                trial = [*others[:place], found, *others[place:]]
                reached = largest_variance(pool, trial, spare, smooth=smooth) if spare else float(judged[found])
                if reached < best * (1 - GAIN):
                    chosen, best = trial, reached
        if best > before * (1 - 10 * GAIN):
            break
    return chosen


def with_each(pool: Pool, chosen: list[int], spare: int = 0, *, smooth: bool = False) -> Floats:
    """The largest variance, m², that each candidate would bring if added, (n,); with a spare, an optimistic one."""
    covariances = _inverse(_cases(pool, chosen, spare))
    if spare:
        order = np.argsort(_judge(pool.variance(covariances), False))
        covariances = covariances[order[-WORST:]]
    judged = [_judge(_added(pool, covariance), smooth) for covariance in covariances]
    return np.asarray(np.max(judged, axis=0))


def _inverse(information: Floats) -> Floats:
    return np.asarray(np.linalg.inv(information), dtype=float)


def _cases(pool: Pool, chosen: list[int], spare: int) -> Floats:
    """The information that is left in each case that counts, (c, 12, 12)."""
    together = pool.of(chosen)[None]
    return together - pool.information[chosen] if spare else together


def _added(pool: Pool, covariance: Floats) -> Floats:
    """Variance of the tip at each place with each candidate added, (n, g), m²."""
    through = pool.derivative @ covariance
    spread = np.eye(2) + through @ np.swapaxes(pool.derivative, 1, 2)
    root = np.linalg.cholesky(np.linalg.inv(spread))
    gain = np.swapaxes(root, 1, 2) @ through[:, :, pool.rows]
    less = pool.traces(pack(np.swapaxes(gain, 1, 2) @ gain))
    return np.asarray(np.maximum(pool.variance(covariance) - less, 0.0))


def _judge(variance: Floats, smooth: bool) -> Floats:
    """The largest over the places, (…), or its stand-in."""
    largest = variance.max(axis=-1)
    if not smooth:
        return np.asarray(largest)
    part = variance / largest[..., None]
    for _ in range(DOUBLINGS):
        part *= part
    return np.asarray(largest * part.mean(axis=-1) ** (0.5**DOUBLINGS))
