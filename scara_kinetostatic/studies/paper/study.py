"""Reproduction of section 5 of the paper as a whole, the result of the verb `paper`; and of the gripper of (7).

General gripper beside the twelve parameters: P = p_ee I + E in the frame of link 2. E has three parts besides the
isotropic one: a larger compliance across link 2 than along it (p22 - p11), principal axes that are rotated (p12 + p21),
and a part that does not conserve energy (p12 - p21). A displacement across link 2 proportional to the force across it
is also caused by a compliance of joint 2: p22 - p11 is an exact alias of l2² p2 (and half of it of p_ee). The other
parts have no alias.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.gauss_helmert import place_force, whiten_by
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import excess_derivative, touch_equations
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.design.optimal_design import Design, optimal_design
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeAnalysis, analyse_tables
from scara_kinetostatic.studies.dial_gauge.simulation import simulate_experiments
from scara_kinetostatic.studies.paper.table_2 import (
    ONE_LEVEL,
    THREE_LEVELS,
    Comparison,
    LinearProblem,
    NoiseStudy,
    Run,
    compare,
    least_chi_square,
    linearise_at_truth,
    noise_for_force_error,
    run,
    study_noise,
)

Progress = Callable[[str, float], None]

_RATIOS = (0.0, 1e-5, 3e-5, 1e-4, 1e-3)
"""Ratios σ_q/σ_f for which the noise of table 2 is determined, rad/N."""


class GripperPart(NamedTuple):
    """Identifiability of one part of the general gripper by a set of touches.

    Attributes:
        name: such as ``p22 - p11``.
        explained: share of its effect on the touches that the twelve parameters reproduce, 0 to 1.
        std: standard deviation with which the touches determine it beside the twelve parameters, m/N; infinite
            for an exact alias.
        biases: bias of each parameter if the part is not modelled, per m/N of it.
    """

    name: str
    explained: float
    std: float
    biases: dict[str, float]


def observable_parts(touches: TouchSet, cell: Cell, parameters: Parameters, noise: Noise) -> tuple[GripperPart, ...]:
    """Identifiability of each part of E.

    Args:
        touches: exact or measured; only their places count.
        cell: the cell.
        parameters: L̄ at which the equations are linearised.
        noise: of one touch.
    """
    observations = observe(touches, cell)
    point = project(observations, ExtendedModel(parameters), noise)
    a = point.adjusted
    state = place_force(observations, point.model, a.joints, a.force, a.state)
    o = observations
    equations = touch_equations(parameters, a.joints, o.centers, o.radii, state, o.gripper)
    entries = whiten_by(excess_derivative(state, equations, o.gripper), point.whitened.root)
    base = (point.whitened.derivative * SCALES).reshape(-1, len(NAMES))
    parts = {  # of E, by name: contribution of one unit to the entries 11, 12, 21, 22
        'p22 - p11': (-0.5, 0.0, 0.0, 0.5),
        'p12 + p21': (0.0, 0.5, 0.5, 0.0),
        'p12 - p21': (0.0, 0.5, -0.5, 0.0),
    }
    return tuple(_look(name, (entries @ np.array(weights)).ravel(), base) for name, weights in parts.items())


def _look(name: str, trace: Floats, base: Floats) -> GripperPart:
    found = np.linalg.lstsq(base, trace, rcond=1e-10)[0]
    left = trace - base @ found
    unidentifiable = float(np.linalg.norm(left))
    share = 1 - (unidentifiable / float(np.linalg.norm(trace))) ** 2
    noticeable = np.abs(found) * 1e-5 > 0.01  # bias by a part of 1e-5 m/N, as a share of the plausible range
    return GripperPart(
        name,
        share,
        1 / unidentifiable if share < 1 - 1e-12 else float('inf'),  # an exact alias, but for rounding
        {parameter: float(found[j] * SCALES[j]) for j, parameter in enumerate(NAMES) if noticeable[j]},
    )


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
    gripper: tuple[GripperPart, ...]
    dial_gauge: DialGaugeAnalysis
    design: Design | None


def reproduce(
    runs: int = 1000, progress: Progress | None = None, workers: int = 2, with_design: bool = True
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
    noise_ratio, force_error = 1e-4, 1.3  # σ_q/σ_f, rad/N; the middle of the paper's range of e_f, N
    noise = noise_for_force_error(linearise_at_truth(THREE_LEVELS), noise_ratio, force_error)
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
