"""Reproduction of section 5 of the paper as a whole, the result of the verb `paper`; and of the gripper of (7).

General gripper beside the base model: P = p_ee I + E in the frame of link 2. E has three parts besides the
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
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import excess_derivative, touch_equations
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.loops.dial_gauge import DialGaugeAnalysis, analyse_tables
from scara_kinetostatic.studies.loops.readings import GaugeTable
from scara_kinetostatic.studies.paper.dial_gauge import simulate_experiments
from scara_kinetostatic.studies.paper.table_2 import (
    ONE_LEVEL,
    THREE_LEVELS,
    NoiseStudy,
    Run,
    Scatter,
    compare,
    linearise_at_truth,
    noise_for_force_error,
    run,
    study_noise,
)

Progress = Callable[[str, float], None]


class GripperPart(NamedTuple):
    """Identifiability of one part of the general gripper by a set of touches.

    Attributes:
        name: such as ``p22 - p11``.
        explained: share of its effect on the touches that the base model reproduces, 0 to 1.
        std: standard deviation with which the touches determine it beside the base model, m/N; infinite
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
    found = []
    for name, weights in parts.items():
        trace = (entries @ np.array(weights)).ravel()
        biases = np.linalg.lstsq(base, trace, rcond=1e-10)[0]
        independent = float(np.linalg.norm(trace - base @ biases))
        share = 1 - (independent / float(np.linalg.norm(trace))) ** 2
        std = 1 / independent if share < 1 - 1e-12 else np.inf  # an exact alias, but for rounding
        noticeable = np.abs(biases) * 1e-5 > 0.01  # by a part of 1e-5 m/N, as a share of the plausible range
        named = {parameter: float(biases[j] * SCALES[j]) for j, parameter in enumerate(NAMES) if noticeable[j]}
        found.append(GripperPart(name, share, std, named))
    return tuple(found)


class Reproduction(NamedTuple):
    """Results of the reproduction.

    Attributes:
        exact: one force level, no noise: table 2, first two columns, and figure 3.
        exact_levels: three force levels, no noise.
        noisy: one data set with noise, three force levels.
        rank: with one force level.
        noises: the noise of the third column of table 2, for some ratios of σ_q to σ_f.
        noise: that of `noisy` and `monte_carlo`.
        monte_carlo: the estimators `paper` and `weighted` over many data sets, three force levels.
        gripper: identifiability of the general gripper.
        dial_gauge: the experiments of section 5.2.
    """

    exact: Run
    exact_levels: Run
    noisy: Run
    rank: int
    noises: tuple[NoiseStudy, ...]
    noise: Noise
    monte_carlo: dict[str, Scatter]
    gripper: tuple[GripperPart, ...]
    dial_gauge: DialGaugeAnalysis


def reproduce(runs: int = 1000, progress: Progress = lambda what, share: None) -> Reproduction:
    """Reproduces section 5.

    Args:
        runs: data sets of the Monte Carlo study.
        progress: receives what is being done and the share of all that is done, 0 to 1.
    """
    progress('table 2 and figure 3', 0.0)
    one_level = linearise_at_truth(ONE_LEVEL)
    noise_ratio, force_error = 1e-4, 1.3  # σ_q/σ_f, rad/N; the middle of the paper's range of e_f, N
    noise = noise_for_force_error(linearise_at_truth(THREE_LEVELS), noise_ratio, force_error)
    touches = simulate_touches(PAPER_CELL, PAPER_ACTUAL, default_plan(PAPER_CELL), Noise(0.0, 0.0))
    return Reproduction(
        exact=run(ONE_LEVEL),
        exact_levels=run(THREE_LEVELS),
        noisy=run(THREE_LEVELS, noise, seed=1),
        rank=one_level.rank,
        noises=tuple(study_noise(one_level, ratio) for ratio in (0.0, 1e-5, 3e-5, 1e-4, 1e-3)),
        noise=noise,
        monte_carlo=compare(
            THREE_LEVELS, noise, runs, lambda done: progress(f'data set {done} of {runs}', 0.05 + 0.9 * done / runs)
        ),
        gripper=observable_parts(touches, PAPER_CELL, PAPER_ACTUAL, PAPER_CELL.noise or noise),
        dial_gauge=analyse_tables([GaugeTable(simulate_experiments())]),
    )
