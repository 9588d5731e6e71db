"""Monte Carlo study of both estimators: standard deviations found over many noisy data sets, and those predicted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.studies.paper.table_2 import LinearProblem, linearise_at_truth, run

_CHUNK = 25
"""Data sets that a process works on at a time."""


class Scatter(NamedTuple):
    """Standard deviations of one estimator over data sets; SI units, (12,) unless said otherwise.

    Attributes:
        noise: of one touch.
        runs: number of data sets.
        predicted: standard deviations predicted for this estimator.
        found: standard deviations over the data sets.
        bias: mean error.
        force_error: mean e_f (10) over the data sets, N.
        force_error_range: 2.5 % and 97.5 % quantiles of e_f, N.
    """

    noise: Noise
    runs: int
    predicted: Floats
    found: Floats
    bias: Floats
    force_error: float
    force_error_range: tuple[float, float]

    @property
    def sampling_error(self) -> float:
        """Relative standard deviation of a standard deviation found."""
        return float(1 / np.sqrt(2 * (self.runs - 1)))


class Comparison(NamedTuple):
    """Both estimators on the same data sets.

    Attributes:
        paper: the paper's unweighted estimator.
        weighted: the weighted one.
    """

    paper: Scatter
    weighted: Scatter

    @property
    def efficiency(self) -> Floats:
        """Variance of the weighted estimate over that of the unweighted one, (12,)."""
        return (self.weighted.found / self.paper.found) ** 2


def compare(
    levels: tuple[float, ...],
    noise: Noise,
    runs: int,
    progress: Callable[[int], None] | None = None,
    workers: int = 2,
) -> Comparison:
    """Runs both estimators on simulated data sets.

    Args:
        levels: force levels, N; with one level p_ee and g_ee are not determined.
        noise: of one touch; also given to the weighted estimator.
        runs: number of data sets.
        progress: receives the number of data sets done.
        workers: number of processes.
    """
    linear: LinearProblem = linearise_at_truth(levels)
    rows = np.concatenate(list(_collect(levels, noise, runs, progress, workers)))
    paper, weighted = rows[:, 0], rows[:, 1]
    return Comparison(
        _summarise(paper, noise, linear.unweighted_covariance(noise)),
        _summarise(weighted, noise, linear.weighted_covariance(noise)),
    )


def _collect(
    levels: tuple[float, ...], noise: Noise, runs: int, progress: Callable[[int], None] | None, workers: int
) -> Iterator[Floats]:
    seeds = [range(first, min(first + _CHUNK, runs)) for first in range(0, runs, _CHUNK)]
    done = 0
    with ProcessPoolExecutor(workers, mp_context=get_context('spawn')) as pool:
        for part in pool.map(_estimates, seeds, [levels] * len(seeds), [noise] * len(seeds)):
            done += len(part)
            if progress is not None:
                progress(done)
            yield part


def _estimates(seeds: range, levels: tuple[float, ...], noise: Noise) -> Floats:
    """Estimates and e_f of both estimators, (len(seeds), 2, 13)."""
    rows = []
    for seed in seeds:
        result = run(levels, noise, seed)
        rows.append(
            [
                [*result.paper.parameters.as_array(), result.paper.force_error],
                [*result.weighted.parameters.as_array(), result.weighted.force_error],
            ]
        )
    return np.array(rows)


def _summarise(rows: Floats, noise: Noise, covariance: Floats) -> Scatter:
    error = rows[:, :12] - PAPER_ACTUAL.as_array()
    low, high = np.quantile(rows[:, 12], [0.025, 0.975])
    return Scatter(
        noise=noise,
        runs=len(rows),
        predicted=np.sqrt(np.diag(covariance)),
        found=error.std(axis=0, ddof=1),
        bias=error.mean(axis=0),
        force_error=float(rows[:, 12].mean()),
        force_error_range=(float(low), float(high)),
    )
