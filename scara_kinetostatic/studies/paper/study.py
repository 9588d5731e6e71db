"""Reproduction of section 5 of the paper as a whole, the result of the verb `paper`."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from scara_kinetostatic.model.cell import PAPER_CELL, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.optimal_design import Design, optimal_design
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeAnalysis, analyse_tables
from scara_kinetostatic.studies.dial_gauge.simulation import simulate_experiments
from scara_kinetostatic.studies.paper.general_gripper import Part, observable_parts
from scara_kinetostatic.studies.paper.monte_carlo import Comparison, compare
from scara_kinetostatic.studies.paper.table_2 import (
    ONE_LEVEL,
    THREE_LEVELS,
    LinearProblem,
    NoiseStudy,
    Run,
    least_chi_square,
    linearise_at_truth,
    noise_for_force_error,
    run,
    study_noise,
)

Progress = Callable[[str, float], None]

_RATIOS = (0.0, 1e-5, 3e-5, 1e-4, 1e-3)
"""Ratios σ_q/σ_f for which the noise of table 2 is determined, rad/N."""
_NOISE_RATIO = 1e-4
"""Ratio σ_q/σ_f of the noise of the Monte Carlo study, rad/N."""
_NOISY_FORCE_ERROR = 1.3
"""Middle of the paper's range of e_f, N."""
_RUNS = 1000


class Reproduction(NamedTuple):
    """Results of the reproduction.

    Attributes:
        exact: one force level, no noise: table 2, first two columns, and figure 3.
        exact_levels: three force levels, no noise.
        noisy: one data set with noise, three force levels.
        one_level: the problem with one level linearised at the truth.
        noises: the noise of the third column of table 2, for each of `_RATIOS`.
        least_joint: smallest chi-square of that column over other contact points and postures.
        noise: that of `noisy` and `monte_carlo`.
        monte_carlo: both estimators over many data sets, three force levels.
        gripper: identifiability of the general gripper.
        dial_gauge: the experiments of section 5.2.
        design: optimal design for the cell of figure 3; None if it was left out.
    """

    exact: Run
    exact_levels: Run
    noisy: Run
    one_level: LinearProblem
    noises: tuple[NoiseStudy, ...]
    least_joint: float
    noise: Noise
    monte_carlo: Comparison
    gripper: tuple[Part, ...]
    dial_gauge: DialGaugeAnalysis
    design: Design | None


def reproduce(
    runs: int = _RUNS, progress: Progress | None = None, workers: int = 2, with_design: bool = True
) -> Reproduction:
    """Reproduces section 5.

    Args:
        runs: data sets of the Monte Carlo study.
        progress: receives what is being done and the share of all that is done, 0 to 1.
        workers: processes of the Monte Carlo study.
        with_design: whether to work out the optimal design as well.
    """
    report = progress or (lambda what, part: None)
    report('table 2 and figure 3', 0.0)
    exact, exact_levels = run(ONE_LEVEL), run(THREE_LEVELS)
    report('the noise of table 2', 0.02)
    one_level = linearise_at_truth(ONE_LEVEL)
    noises = tuple(study_noise(one_level, ratio) for ratio in _RATIOS)
    noise = noise_for_force_error(linearise_at_truth(THREE_LEVELS), _NOISE_RATIO, _NOISY_FORCE_ERROR)
    noisy = run(THREE_LEVELS, noise, seed=1)
    report('the dial gauge experiments', 0.04)
    dial_gauge = analyse_tables([simulate_experiments()])
    report('the general gripper', 0.05)
    cell = PAPER_CELL
    touches = simulate_touches(cell, PAPER_ACTUAL, default_plan(cell), Noise(0.0, 0.0))
    gripper = observable_parts(touches, cell, PAPER_ACTUAL, cell.noise or noise)
    monte_carlo = compare(
        THREE_LEVELS, noise, runs, lambda done: report(f'data set {done} of {runs}', 0.06 + 0.6 * done / runs), workers
    )
    design = None
    if with_design:
        design = optimal_design(Robot.of(cell), report=lambda what, part: report(what, 0.66 + 0.3 * part))
    report('drawing', 0.97)
    return Reproduction(
        exact=exact,
        exact_levels=exact_levels,
        noisy=noisy,
        one_level=one_level,
        noises=noises,
        least_joint=least_chi_square(_RATIOS),
        noise=noise,
        monte_carlo=monte_carlo,
        gripper=gripper,
        dial_gauge=dial_gauge,
        design=design,
    )
