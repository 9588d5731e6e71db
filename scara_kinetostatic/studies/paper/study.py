"""Reproduction of section 5 of the paper, the result of the verb `paper`.

Section 5.1: the numbers printed there, the cell of figure 3, table 2 without and with noise, identifiability, and a
Monte Carlo study of both estimators. The settings are the paper's: three discs, npc = 12 points on each, f = 40 N, one
elbow posture, `gripper_sign: paper` (table 2 was computed with the sign as printed: 40 p_ee - g_ee is equal in its
first two columns, 40 p_ee + g_ee is not).

**Algorithm of section 4.3.** Pseudo-inverse steps on A(Q, L̄), unweighted (12)–(14).

    L̄_k = L̄_{k-1} + J_L̄⁺ ΔF,   ΔF = F - A(Q, L̄_{k-1}),   J_L̄ = ∂A/∂L̄

with the paper's two modifications: a step is shortened until the error index decreases, and its length is bounded.

**Additions to the paper's text.** At L̄n the tip misses most discs by more than its whole deflection: there A = 0 N and
∂A/∂L̄ = 0, and no step is defined. The touches are known to be contacts; they are therefore predicted with a two-sided
contact (`contact(..., tension=True)`), which equals A wherever the tip presses. The pseudo-inverse depends on the units
of the parameters: the columns are scaled by the plausible ranges, and singular values below 1e-7 of the largest are
set to zero.

**Experiments of section 5.2, simulated.** Both links of the robot are along y. Three set-ups:

- gripper: both joints locked, gauge at the end-effector, loads along several directions:
  ΔS = p_ee F + ½ gap(φ) sense (7);
- joint 2: joint 1 locked, load along x at the end, gauge at the end of link 2: with the lever l = l2,
  ΔS = l (p F l + ½ gap sense) (6);
- joint 1: joint 2 locked, likewise with the lever l1 + l2.

At the end of link 2 the gauge measures the joint alone.

**Backlash over the direction.** Figure 4(c) is not isotropic; (7) is. Here the dead zone of the gripper is an ellipse:
under a load along u, without friction, the tip is at the point of the ellipse that is farthest along u, so that the gap
between the two senses is the width of the ellipse,

    gap(φ) = √(gap_major² cos² φ + gap_minor² sin² φ),

an even, smooth function of the direction. The gap is largest along x and smallest along y, so that
directions 30° apart contain both ends of the measured range; the paper does not state their directions.

**Gap and half gap.** Values of backlash are gaps here, the jump of ΔS at F = 0, as those of figure 4(d) according to
section 5.2 ("the ΔS gap itself"); g of (6) and (7) is half of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import base_force, force_error, force_residual
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.arrays import TINY, Floats
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, Cell, GripperSign, Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import (
    G_EE,
    NAMES,
    P_EE,
    PAPER_ACTUAL,
    PAPER_MEASURED,
    PAPER_NOMINAL,
    Parameters,
)
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_derivatives import contact_derivatives
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.loops.dial_gauge import (
    GRIPPER,
    JOINT1,
    JOINT2,
    PARTS,
    DialGaugeAnalysis,
    Readings,
    analyse_runs,
)

NPC = 12
"""Points on each disc of figure 3; directions of the loads on the gripper."""
DIRECTIONS = tuple(np.linspace(0.0, 2 * np.pi, NPC, endpoint=False).tolist())
STEP, FORCE = 5.0, 40.0
"""Of the loads of the dial gauge experiments, and f of figure 3, N."""


@dataclass(frozen=True)
class DialGaugeBench:
    """The simulated robot, by default with the values of figure 4(d) and table 1, and the errors of its readings.

    Attributes:
        p_ee: compliance of the gripper, m/N.
        gap_major: its largest gap over the directions, m.
        gap_minor: its smallest.
        p: compliance of joint 1 and 2, rad/Nm.
        gap: of joint 1 and 2, rad.
        links: their lengths, m.
        noise: of the dial gauge, one standard deviation, m.
    """

    p_ee: float = PAPER_MEASURED.p_ee
    gap_major: float = 2.05e-4
    gap_minor: float = 5.49e-5
    p: tuple[float, float] = (PAPER_MEASURED.p1, PAPER_MEASURED.p2)
    gap: tuple[float, float] = (PAPER_MEASURED.g1, PAPER_MEASURED.g2)
    links: tuple[float, float] = (PAPER_NOMINAL.l1, PAPER_NOMINAL.l2)
    noise: float = 2e-6

    def gripper_gap(self, direction: ArrayLike) -> Floats:
        """Gap of the gripper along directions (rad), m."""
        return np.hypot(self.gap_major * np.cos(direction), self.gap_minor * np.sin(direction))

    def run(self, rng: np.random.Generator, part: str, direction: float = 0.0) -> Readings:
        """The experiment at the gripper along one direction, joints locked, or at joint 1 or 2, the other one locked.

        A joint is loaded along x at the end of the arm, which is stretched along y.
        """
        force, sense, cycle = load_cycles()
        compliance, gap, lever = self.p_ee, float(self.gripper_gap(direction)), np.nan
        if part != GRIPPER:
            joint, lever = PARTS.index(part) - 1, sum(self.links) if part == JOINT1 else self.links[1]
            compliance, gap = self.p[joint] * lever**2, self.gap[joint] * lever
        displacement = compliance * force + gap / 2 * sense + self.noise * rng.standard_normal(len(force))
        return Readings(force, displacement, cycle, part=part, direction=direction, lever=lever, source=part)


def load_cycles() -> tuple[Floats, Floats, Floats]:
    """Force, N, sense of the last load, and cycle of each row of a run, (n,): cycles with loads in both senses.

    Loads are put on in steps, and removed in the reverse order.
    """
    rise, cycles = STEP * np.arange(1.0, FORCE / STEP + 1), 3
    one = np.concatenate([rise, rise[-2::-1], [0.0]])
    force = np.concatenate([[0.0], np.tile(np.concatenate([one, -one]), cycles)])
    sense = np.concatenate([[0.0], np.tile(np.repeat([1.0, -1.0], len(one)), cycles)])
    return force, sense, np.concatenate([[1.0], np.repeat(np.arange(1.0, cycles + 1), 2 * len(one))])


def simulate_experiments(
    bench: DialGaugeBench | None = None, directions: Sequence[float] = DIRECTIONS, seed: int = 0
) -> tuple[Readings, ...]:
    """All of section 5.2: the gripper in every direction, joint 2, joint 1.

    Args:
        bench: robot and gauges.
        directions: of the positive load on the gripper, rad.
        seed: of the noise.
    """
    bench, rng = bench or DialGaugeBench(), np.random.default_rng(seed)
    gripper = [bench.run(rng, GRIPPER, direction) for direction in directions]
    return (*gripper, bench.run(rng, JOINT2), bench.run(rng, JOINT1))


class PaperFit(NamedTuple):
    """Result of the paper's algorithm.

    Attributes:
        parameters: the last L̄.
        force_error: e_f (10) there, unilateral contact, N.
        history: e_f at every iterate, the start first, unilateral contact, N.
        merit: the same with the two-sided contact, which the steps decrease.
        rank: number of singular values used in the last step.
    """

    parameters: Parameters
    force_error: float
    history: tuple[float, ...]
    merit: tuple[float, ...]
    rank: int

    @property
    def iterations(self) -> int:
        """Number of steps."""
        return len(self.merit) - 1


class _Iterate(NamedTuple):
    parameters: Parameters
    residual: Floats
    jacobian: Floats
    merit: float


def paper_calibrate(touches: TouchSet, cell: Cell) -> PaperFit:
    """The paper's algorithm on a set of touches.

    Args:
        touches: Q and F; the sensor in the base frame, as in the paper.
        cell: discs and sign of (7).
    """
    observations = observe(touches, cell)
    measured = base_force(observations, ExtendedModel(cell.nominal))

    def visit(parameters: Parameters) -> _Iterate:
        o = observations
        with np.errstate(all='ignore'):
            found = contact(parameters, o.joints, o.centers, o.radii, o.gripper, tension=True, warm_start=measured)
            jacobian = contact_derivatives(parameters, found).parameters
        residual = measured - found.force
        return _Iterate(parameters, residual, jacobian, force_error(residual))

    visited, rank = [visit(cell.nominal)], 0
    while len(visited) <= 30 and (len(visited) < 2 or visited[-2].merit - visited[-1].merit >= 1e-12):  # N
        at = visited[-1]
        step, rank = _pseudo_inverse_step(at)
        # the step, its half, its quarter, … until the error index decreases
        trials = (at.parameters.as_array() + 2.0**-halving * step for halving in range(13))
        lower = next((each for each in map(visit, map(Parameters.from_array, trials)) if each.merit < at.merit), None)
        if lower is None:
            break
        visited.append(lower)
    history = tuple(force_error(force_residual(observations, ExtendedModel(item.parameters))) for item in visited)
    return PaperFit(visited[-1].parameters, history[-1], history, tuple(item.merit for item in visited), rank)


def _pseudo_inverse_step(at: _Iterate) -> tuple[Floats, int]:
    """The step J⁺ ΔF (13) in scaled parameters, of which none changes by more than 1, and the rank used."""
    jacobian = (at.jacobian * SCALES).reshape(-1, len(SCALES))
    u, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    rank = int((values > 1e-7 * values[0]).sum())
    scaled = vt[:rank].T @ ((u.T @ at.residual.ravel())[:rank] / values[:rank])
    longest = float(np.abs(scaled).max())
    return SCALES * scaled * min(1.0, 1.0 / max(longest, TINY)), rank


ESTIMATED, ESTIMATED_FROM_NOISE = map(
    Parameters.from_array,
    np.loadtxt(Path(__file__).with_name('table_2.csv'), delimiter=',', skiprows=1, usecols=range(1, len(NAMES) + 1)),
)
"""Table 2, "estimated values", and "when random noise"."""

FORCE_ERROR = 4.491026e-5
"""e_f without noise, N."""
FORCE_ERROR_FROM_NOISE = 1.312684
"""e_f of the column with noise, N."""

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=PAPER_CELL.noise, gripper_sign=GripperSign.PAPER)
ONE_LEVEL = (FORCE,)
THREE_LEVELS = (FORCE / 4, FORCE / 2, FORCE)
NOISE = Noise(joint=4.76825e-5, force=0.476825)
"""With it the mean e_f of the paper's estimates is 1.3 N, the middle of the range that the paper states."""


def paper_touches(levels: tuple[float, ...], noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """The touches of figure 3, simulated with the "actual" robot of table 2.

    Args:
        levels: of the force, N.
        noise: of one touch; None: none.
        seed: of the noise.
    """
    plan = default_plan(CELL, per_disc=NPC, levels=levels, postures=(1,))
    return simulate_touches(CELL, PAPER_ACTUAL, plan, noise or Noise(joint=0.0, force=0.0), seed)


class BothFits(NamedTuple):
    """One data set through both estimators: the algorithm of the paper, and `calibrate`."""

    paper: PaperFit
    weighted: Calibration


def run(levels: tuple[float, ...], noise: Noise | None = None, seed: int = 0) -> BothFits:
    """Simulates one data set, without noise by default, and estimates L̄ from L̄n by both algorithms."""
    touches, cell = paper_touches(levels, noise, seed), replace(CELL, noise=noise or CELL.noise)
    return BothFits(paper_calibrate(touches, cell), calibrate(touches, cell))


def predicted_covariances(noise: Noise = NOISE) -> tuple[Floats, Floats]:
    """Covariances of the estimates from three force levels, (12, 12) each, SI units: the paper's, and the weighted one.

    With Σ = Σ_F + A_Q Σ_Q A_Qᵀ, linearised at the truth, J⁺ Σ J⁺ᵀ and the Cramér–Rao bound (Jᵀ Σ⁻¹ J)⁻¹.
    """
    o = observe(paper_touches(THREE_LEVELS), CELL)
    found = contact(PAPER_ACTUAL, o.joints, o.centers, o.radii, o.gripper, warm_start=o.force)
    derivatives = contact_derivatives(PAPER_ACTUAL, found)
    jacobian, by_joints = derivatives.parameters * SCALES, derivatives.joints
    root = np.linalg.cholesky(
        noise.force_rms**2 * np.eye(2) + noise.joint_rms**2 * by_joints @ by_joints.swapaxes(1, 2)
    )
    gain = np.linalg.pinv(jacobian.reshape(-1, len(NAMES))).reshape(len(NAMES), -1, 2)
    unweighted = np.einsum('knc,ncd->knd', gain, root).reshape(len(NAMES), -1)
    weighted = np.linalg.pinv(np.linalg.solve(root, jacobian).reshape(-1, len(NAMES)))
    scaled = [SCALES[:, None] * half for half in (unweighted, weighted)]
    return scaled[0] @ scaled[0].T, scaled[1] @ scaled[1].T


def determined_combination(values: Floats) -> float:
    """40 p_ee - g_ee, the combination that one force level of 40 N determines, m."""
    return float(FORCE * values[P_EE] - values[G_EE])


class Scatter(NamedTuple):
    """Standard deviations of one estimator over data sets; SI units, (12,) unless said otherwise.

    Attributes:
        runs: number of data sets.
        predicted: standard deviations predicted for this estimator.
        found: standard deviations over the data sets.
        force_error: mean e_f (10) over the data sets, N.
        force_error_range: 2.5 % and 97.5 % quantiles of e_f, N.
    """

    runs: int
    predicted: Floats
    found: Floats
    force_error: float
    force_error_range: tuple[float, float]


def compare(runs: int, progress: Callable[[int], None] = lambda done: None) -> dict[str, Scatter]:
    """Runs both estimators on simulated data sets: the paper's unweighted one, `paper`, and the weighted one.

    Args:
        runs: number of data sets.
        progress: receives the number of data sets done.
    """
    rows = []
    for seed in range(runs):
        fits = run(THREE_LEVELS, NOISE, seed)
        rows.append([[*fit.parameters.as_array(), fit.force_error] for fit in fits])
        progress(seed + 1)
    several = zip(('paper', 'weighted'), np.swapaxes(rows, 0, 1), predicted_covariances(), strict=True)
    return {name: _scatter(found, covariance) for name, found, covariance in several}


def _scatter(rows: Floats, covariance: Floats) -> Scatter:
    """Of estimates and e_f, (runs, 13), with their predicted covariance."""
    error, force_error = rows[:, :-1] - PAPER_ACTUAL.as_array(), float(rows[:, -1].mean())
    low, high = np.quantile(rows[:, -1], [0.025, 0.975]).tolist()
    predicted, found = np.sqrt(np.diag(covariance)), error.std(axis=0, ddof=1)
    return Scatter(len(rows), predicted, found, force_error, (low, high))


class Reproduction(NamedTuple):
    """Results of the reproduction.

    Attributes:
        exact: one force level, no noise: table 2, first two columns, and figure 3.
        exact_levels: three force levels, no noise.
        noisy: one data set with noise, three force levels.
        monte_carlo: the estimators `paper` and `weighted` over many data sets, three force levels.
        dial_gauge: the experiments of section 5.2.
    """

    exact: BothFits
    exact_levels: BothFits
    noisy: BothFits
    monte_carlo: dict[str, Scatter]
    dial_gauge: DialGaugeAnalysis


def reproduce(runs: int = 1000, progress: Callable[[str, float], None] = lambda what, share: None) -> Reproduction:
    """Reproduces section 5.

    Args:
        runs: data sets of the Monte Carlo study.
        progress: receives what is being done and the share of all that is done, 0 to 1.
    """
    progress('table 2 and figure 3', 0.0)
    return Reproduction(
        exact=run(ONE_LEVEL),
        exact_levels=run(THREE_LEVELS),
        noisy=run(THREE_LEVELS, NOISE, seed=1),
        monte_carlo=compare(runs, lambda done: progress(f'data set {done} of {runs}', 0.05 + 0.9 * done / runs)),
        dial_gauge=analyse_runs(simulate_experiments()),
    )
