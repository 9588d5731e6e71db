"""Reproduction of section 5 of the paper, the result of the verb `paper`.

Section 5.1: the numbers printed there, the cell of figure 3, table 2 without and with noise, identifiability, and a
Monte Carlo study of both estimators. The settings are the paper's: three discs, npc = 12 points on each, f = 40 N, one
elbow posture, `gripper_sign: paper` (table 2 was computed with the sign as printed: 40 p_ee - g_ee is equal in its
first two columns, 40 p_ee + g_ee is not).

General gripper beside the base model: P = p_ee I + E in the frame of link 2. E has three parts besides the
isotropic one: a larger compliance across link 2 than along it (p22 - p11), principal axes that are rotated (p12 + p21),
and a part that does not conserve energy (p12 - p21). A displacement across link 2 proportional to the force across it
is also caused by a compliance of joint 2: p22 - p11 is an exact alias of l2² p2 (and half of it of p_ee). The other
parts have no alias.

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

    gap(φ) = √(gap_major² cos²(φ - axis) + gap_minor² sin²(φ - axis)),

an even, smooth function of the direction. By default the gap is largest along x and smallest along y, so that
directions 30° apart contain both ends of the measured range; the paper does not state their directions.

**Gap and half gap.** Values of backlash are gaps here, the jump of ΔS at F = 0, as those of figure 4(d) according to
section 5.2 ("the ΔS gap itself"); g of (6) and (7) is half of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import base_force, force_error, force_residual, project
from scara_kinetostatic.calibration.gauss_helmert import place_force, whiten_by
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, Cell, GripperSign, Noise, SensorFrame
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G_EE, NAMES, P_EE, PAPER_ACTUAL, PAPER_NOMINAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import Equations, State, touch_equations
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.studies.loops.dial_gauge import DialGaugeAnalysis, analyse_tables
from scara_kinetostatic.studies.loops.record import GRIPPER, JOINT1, JOINT2, PARTS, GaugeTable, Readings

DIRECTIONS = tuple(np.radians(np.arange(0, 360, 30)).tolist())


@dataclass(frozen=True)
class DialGaugeBench:
    """The simulated robot, by default with the values of figure 4(d) and table 1, and the errors of its readings.

    Attributes:
        p_ee: compliance of the gripper, m/N.
        gap_major: its largest gap over the directions, m.
        gap_minor: its smallest.
        axis: direction of the largest, rad.
        p: compliance of joint 1 and 2, rad/Nm.
        gap: of joint 1 and 2, rad.
        links: their lengths, m.
        noise: of the dial gauge, one standard deviation, m.
    """

    p_ee: float = 3.76e-5
    gap_major: float = 2.05e-4
    gap_minor: float = 5.49e-5
    axis: float = 0.0
    p: tuple[float, float] = (3.23e-5, 1.08e-4)
    gap: tuple[float, float] = (2.64e-4, 2.68e-4)
    links: tuple[float, float] = (0.33, 0.33)
    noise: float = 2e-6

    def gripper_gap(self, direction: ArrayLike) -> Floats:
        """Gap of the gripper along directions (rad), m."""
        turned = np.asarray(direction, dtype=float) - self.axis
        return np.hypot(self.gap_major * np.cos(turned), self.gap_minor * np.sin(turned))

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

    Loads are put on in steps of 5 N, and removed in the reverse order.
    """
    rise, cycles = np.arange(5.0, 41.0, 5.0), 3
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

    Raises:
        ParameterError: the sensor is in the tool frame, which the paper does not consider.
    """
    if cell.sensor.frame is not SensorFrame.BASE:
        raise ParameterError('sensor.frame', 'the algorithm of the paper takes forces in the base frame')
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
    return SCALES * scaled * min(1.0, 1.0 / max(longest, 1e-300)), rank


ESTIMATED = Parameters(
    2.500000e-3, -2.199999e-3, -1.700003e-3, 3.301999e-1, 6.999950e-4, 3.298000e-1,
    1.100712e-5, 1.100000e-5, 1.100017e-5, 9.528501e-5, 2.900022e-4, 2.899924e-4,
)  # fmt: skip
"""Table 2, "estimated values"."""

ESTIMATED_FROM_NOISE = Parameters(
    2.499527e-3, -2.202042e-3, -1.7480221e-3, 3.301951e-1, 7.120833e-4, 3.298156e-1,
    1.541640e-5, 7.951966e-6, 5.696328e-6, 2.829870e-4, 3.869342e-4, 3.744674e-4,
)  # fmt: skip
"""Table 2, "when random noise"."""

FORCE_ERROR = 4.491026e-5
"""e_f without noise, N."""
FORCE_ERROR_FROM_NOISE = 1.312684
"""e_f of the column with noise, N."""
FORCE = 40.0
"""f of figure 3, N."""

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3), gripper_sign=GripperSign.PAPER)
ONE_LEVEL = (FORCE,)
THREE_LEVELS = (FORCE / 4, FORCE / 2, FORCE)


def paper_touches(levels: tuple[float, ...], noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """The touches of figure 3, simulated with the "actual" robot of table 2.

    Args:
        levels: of the force, N.
        noise: of one touch; None: none.
        seed: of the noise.
    """
    plan = default_plan(CELL, per_disc=12, levels=levels, postures=(1,))  # npc of figure 3
    return simulate_touches(CELL, PAPER_ACTUAL, plan, noise or Noise(joint=0.0, force=0.0), seed)


class Run(NamedTuple):
    """One data set through both estimators: the algorithm of the paper, and `calibrate`."""

    paper: PaperFit
    weighted: Calibration


def run(levels: tuple[float, ...], noise: Noise | None = None, seed: int = 0) -> Run:
    """Simulates one data set, without noise by default, and estimates L̄ from L̄n by both algorithms."""
    touches, cell = paper_touches(levels, noise, seed), replace(CELL, noise=noise or CELL.noise)
    return Run(paper_calibrate(touches, cell), calibrate(touches, cell))


class LinearProblem(NamedTuple):
    """The estimation problem linearised at the truth, with the covariances of both estimators.

    Attributes:
        jacobian: J_L̄ (12) in units of `SCALES`, (2n, 12).
        by_joints: A_Q A_Qᵀ as a block-diagonal matrix, (2n, 2n), (N/rad)².
        rank: of J_L̄.
        unidentifiable: unit null vectors of J_L̄, (12, 12 - rank), in units of `SCALES`.
        identifiable: orthonormal complement, (12, rank).
    """

    jacobian: Floats
    by_joints: Floats
    rank: int
    unidentifiable: Floats
    identifiable: Floats

    def force_covariance(self, noise: Noise) -> Floats:
        """Covariance of F - A(Q, L̄): Σ_F + A_Q Σ_Q A_Qᵀ, (2n, 2n), N²."""
        return noise.force_rms**2 * np.eye(len(self.jacobian)) + noise.joint_rms**2 * self.by_joints

    def unweighted_gain(self) -> Floats:
        """J⁺ of (13) in units of `SCALES`, (12, 2n)."""
        u, values, vt = np.linalg.svd(self.jacobian, full_matrices=False)
        return (vt[: self.rank].T / values[: self.rank]) @ u[:, : self.rank].T

    def unweighted_covariance(self, noise: Noise) -> Floats:
        """Covariance of the paper's estimate, (12, 12), SI units."""
        gain = SCALES[:, None] * self.unweighted_gain()
        return gain @ self.force_covariance(noise) @ gain.T

    def weighted_covariance(self, noise: Noise) -> Floats:
        """Covariance of the weighted estimate, the Cramér–Rao bound, (12, 12), SI units."""
        root = np.linalg.cholesky(self.force_covariance(noise))
        triangle = np.linalg.qr(np.linalg.solve(root, self.jacobian @ self.identifiable), mode='r')
        half = SCALES[:, None] * (self.identifiable @ np.linalg.inv(triangle))
        return half @ half.T


def linearise_at_truth(levels: tuple[float, ...]) -> LinearProblem:
    """J_L̄ and A_Q of the touches without noise."""
    o = observe(paper_touches(levels), CELL)
    found = contact(PAPER_ACTUAL, o.joints, o.centers, o.radii, o.gripper, warm_start=o.force)
    derivatives = contact_derivatives(PAPER_ACTUAL, found)
    jacobian = (derivatives.parameters * SCALES).reshape(-1, len(NAMES))
    n = len(o.joints)
    blocks = np.zeros((n, 2, n, 2))
    blocks[np.arange(n), :, np.arange(n), :] = derivatives.joints @ derivatives.joints.swapaxes(1, 2)
    _, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    rank = int((values > 1e-9 * values[0]).sum())
    return LinearProblem(jacobian, blocks.reshape(2 * n, 2 * n), rank, vt[rank:].T, vt[:rank].T)


def expected_force_error(linear: LinearProblem, noise: Noise) -> tuple[float, float]:
    """Mean and standard deviation over data sets of e_f after the paper's fit, N, to first order; by random draws."""
    covariance = linear.force_covariance(noise)
    residual_maker = np.eye(len(covariance)) - linear.jacobian @ linear.unweighted_gain()
    values, vectors = np.linalg.eigh(residual_maker @ covariance @ residual_maker.T)
    draws = np.random.default_rng(0).normal(size=(len(covariance), 2000))
    residual = ((vectors * np.sqrt(np.clip(values, 0, None))) @ draws).reshape(-1, 2, 2000)
    force_errors = np.hypot(residual[:, 0], residual[:, 1]).mean(axis=0)
    return float(force_errors.mean()), float(force_errors.std())


def noise_for_force_error(linear: LinearProblem, ratio: float, force_error: float = FORCE_ERROR_FROM_NOISE) -> Noise:
    """The noise for which the expected e_f has a given value, with σ_q = ratio σ_f, ratio in rad/N."""
    unit, _ = expected_force_error(linear, Noise(joint=ratio, force=1.0))
    return Noise(joint=ratio * force_error / unit, force=force_error / unit)


class NoiseStudy(NamedTuple):
    """The noise of the third column of table 2 for one ratio of σ_q to σ_f.

    Attributes:
        noise: for which the expected e_f is that of the paper.
        force_error: expected e_f, N.
        force_error_std: its standard deviation over data sets, N.
        z: error of the paper's noisy column in identifiable directions, in units of the predicted std, (12,).
        chi_square: of that column with the rank as degrees of freedom, 11 with one force level.
    """

    noise: Noise
    force_error: float
    force_error_std: float
    z: Floats
    chi_square: float


def study_noise(linear: LinearProblem, ratio: float) -> NoiseStudy:
    """The paper's noisy estimates compared with the predicted covariance, for one ratio of σ_q to σ_f, rad/N."""
    noise = noise_for_force_error(linear, ratio)
    covariance, basis = linear.unweighted_covariance(noise), linear.identifiable
    error = basis.T @ ((ESTIMATED_FROM_NOISE.as_array() - PAPER_ACTUAL.as_array()) / SCALES)
    scaled = basis.T @ (covariance / np.outer(SCALES, SCALES)) @ basis
    z, chi_square = SCALES * (basis @ error) / np.sqrt(np.diag(covariance)), error @ np.linalg.solve(scaled, error)
    return NoiseStudy(noise, *expected_force_error(linear, noise), z, float(chi_square))


def determined_combination(values: Floats) -> float:
    """40 p_ee - g_ee, the combination that one force level of 40 N determines, m."""
    return float(FORCE * values[P_EE] - values[G_EE])


class Scatter(NamedTuple):
    """Standard deviations of one estimator over data sets; SI units, (12,) unless said otherwise.

    Attributes:
        runs: number of data sets.
        predicted: standard deviations predicted for this estimator.
        found: standard deviations over the data sets.
        bias: mean error.
        force_error: mean e_f (10) over the data sets, N.
        force_error_range: 2.5 % and 97.5 % quantiles of e_f, N.
    """

    runs: int
    predicted: Floats
    found: Floats
    bias: Floats
    force_error: float
    force_error_range: tuple[float, float]


def compare(
    levels: tuple[float, ...], noise: Noise, runs: int, progress: Callable[[int], None] = lambda done: None
) -> dict[str, Scatter]:
    """Runs both estimators on simulated data sets: the paper's unweighted one, `paper`, and the weighted one.

    Args:
        levels: force levels, N; with one level p_ee and g_ee are not determined.
        noise: of one touch; also given to the weighted estimator.
        runs: number of data sets.
        progress: receives the number of data sets done.
    """
    rows = []
    for seed in range(runs):
        fits = run(levels, noise, seed)
        rows.append([[*fit.parameters.as_array(), fit.force_error] for fit in fits])
        progress(seed + 1)
    linear, (paper, weighted) = linearise_at_truth(levels), np.swapaxes(rows, 0, 1)
    return {
        'paper': _scatter(paper, linear.unweighted_covariance(noise)),
        'weighted': _scatter(weighted, linear.weighted_covariance(noise)),
    }


def _scatter(rows: Floats, covariance: Floats) -> Scatter:
    """Of estimates and e_f, (runs, 13), with their predicted covariance."""
    error, force_error = rows[:, :12] - PAPER_ACTUAL.as_array(), float(rows[:, 12].mean())
    low, high = np.quantile(rows[:, 12], [0.025, 0.975]).tolist()
    predicted, found = np.sqrt(np.diag(covariance)), error.std(axis=0, ddof=1)
    return Scatter(len(rows), predicted, found, error.mean(axis=0), force_error, (low, high))


class GripperPart(NamedTuple):
    """Identifiability of one part of the general gripper by a set of touches.

    Attributes:
        part: such as ``p22 - p11``.
        explained_by_base_model: share of its effect on the touches that the base model reproduces, 0 to 1.
        std: standard deviation with which the touches determine it beside the base model, m/N; infinite
            for an exact alias.
        biases: bias of each parameter if the part is not modelled, per m/N of it.
    """

    part: str
    explained_by_base_model: float
    std: float
    biases: dict[str, float]


def excess_derivative(state: State, equations: Equations, gripper: GripperSign) -> Floats:
    """∂h/∂E of n touches, f and φ held: by the entries 11, 12, 21, 22 of E, (n, 2, 4).

    The force acts beside the rigid tip by what E moves it across the force, so that both lever arms change by as much.
    """
    arm, push = equations.rows.arm, gripper.factor * state.magnitude
    n = np.array([arm.links[1].real, -arm.links[1].imag])  # in the frame of link 2
    t = np.array([-n[1], n[0]])
    normal, tangent = ((push * side[:, None] * n).reshape(4, -1) for side in (n, t))
    found = normal + (1j + equations.moved(equations.rows.weight)) * tangent
    return np.stack([found.real, found.imag]).transpose(2, 0, 1)


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
    equations = touch_equations(parameters, o.contact_problem(a.joints), state)
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


def reproduce(runs: int = 1000, progress: Callable[[str, float], None] = lambda what, share: None) -> Reproduction:
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
