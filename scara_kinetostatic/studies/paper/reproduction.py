"""All of the paper's section 5 in one go: what `scara-kinetostatic paper` shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from scara_kinetostatic.model.cell import PAPER_CELL, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.optimal_design import design
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.result import Design
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeStudy, study
from scara_kinetostatic.studies.dial_gauge.simulation import simulate_experiments
from scara_kinetostatic.studies.paper.general_gripper import Part, see_parts
from scara_kinetostatic.studies.paper.monte_carlo import Comparison, compare
from scara_kinetostatic.studies.paper.section_5_1 import (
    ONE_LEVEL,
    THREE_LEVELS,
    Linear,
    NoiseStudy,
    Run,
    least_joint_chi_square,
    linearise_at_truth,
    noise_for_force_error,
    run,
    study_noise,
)

Progress = Callable[[str, float], None]

RATIOS = (0.0, 1e-5, 3e-5, 1e-4, 1e-3)
"""Ratios σ_q/σ_f at which the noise behind table 2 is looked for, rad/N."""
STATED_RATIO = 1e-4
STATED_FORCE_ERROR = 1.3
"""Middle of the paper's range of e_f, N."""
RUNS = 1000


class Reproduction(NamedTuple):
    """What was found.

    Attributes:
        exact: one force level, no noise: table 2, first two columns, and figure 3.
        exact_levels: three force levels, no noise.
        noisy: one data set with noise, three force levels.
        one_level: the problem with one level linearised at the truth.
        noises: the noise behind the third column of table 2, for each of `RATIOS`.
        least_joint: smallest chi-square of that column over other contact points and postures.
        stated: the noise of `noisy` and `scatter`.
        scatter: both estimators over many data sets, three force levels.
        gripper: what touches show of the general gripper.
        gauge: section 5.2.
        design: how many touches the cell of figure 3 needs; None if it was not asked for.
    """

    exact: Run
    exact_levels: Run
    noisy: Run
    one_level: Linear
    noises: tuple[NoiseStudy, ...]
    least_joint: float
    stated: Noise
    scatter: Comparison
    gripper: tuple[Part, ...]
    gauge: DialGaugeStudy
    design: Design | None


def reproduce(
    runs: int = RUNS, progress: Progress | None = None, workers: int = 2, with_design: bool = True
) -> Reproduction:
    """Redo section 5.

    Args:
        runs: data sets of the scatter study.
        progress: told what is being done and how much of all is done, 0 to 1.
        workers: processes of the scatter study.
        with_design: whether to ask the design question as well.
    """
    tell = progress or _silent
    tell('table 2 and figure 3', 0.0)
    exact, exact_levels = run(ONE_LEVEL), run(THREE_LEVELS)
    tell('the noise behind table 2', 0.02)
    one_level = linearise_at_truth(ONE_LEVEL)
    noises = tuple(study_noise(one_level, ratio) for ratio in RATIOS)
    stated = noise_for_force_error(linearise_at_truth(THREE_LEVELS), STATED_RATIO, STATED_FORCE_ERROR)
    noisy = run(THREE_LEVELS, stated, seed=1)
    tell('the gauge experiments', 0.04)
    gauge = study([simulate_experiments()])
    tell('the general gripper', 0.05)
    cell = PAPER_CELL
    touches = simulate_touches(cell, PAPER_ACTUAL, default_plan(cell), Noise(0.0, 0.0))
    gripper = see_parts(touches, cell, PAPER_ACTUAL, cell.noise or stated)
    scatter = compare(
        THREE_LEVELS, stated, runs, lambda done: tell(f'data set {done} of {runs}', 0.06 + 0.6 * done / runs), workers
    )
    question = design(Robot.of(cell), tell=lambda what, part: tell(what, 0.66 + 0.3 * part)) if with_design else None
    tell('drawing', 0.97)
    return Reproduction(
        exact,
        exact_levels,
        noisy,
        one_level,
        noises,
        least_joint_chi_square(RATIOS),
        stated,
        scatter,
        gripper,
        gauge,
        question,
    )


def _silent(what: str, part: float) -> None:
    pass
