r"""The candidate touches, how some of them are chosen, and what holds of a set of them.

A candidate is a point on a disc, a posture and a force level. Points out of reach are left out, and touches whose line
of force passes close to a joint's axis: there the torque is so small that noise, or a geometry some millimetres off the
nominal one, decides on which flank of the backlash the joint rests, and the prediction would not hold for the touch
made. Under gravity, where that depends on the force, too, the calibration leaves touches out whose torques have no sure
sign.

For the choice alone every parameter has a prior: its plausible range (`RobotModel.scales`) as standard deviation. It
keeps all matrices regular, does not change what touches determine well, and bounds what they do not determine. The
reported numbers come from `prediction`, without this prior. What the cell description declares as uncertain is a prior
of another kind: it holds in the calibration, and in every number.

**Choice.** One criterion: tr(L C), with C the covariance with the touches chosen, and L = Σ λ_g T_gᵀT_g the tip's
derivatives T_g at all places with weights λ: a weighted mean of its variances. A touch with the whitened Jacobian J
changes C by -C Jᵀ (1 + J C Jᵀ)⁻¹ J C and so lowers the criterion by tr((1 + J C Jᵀ)⁻¹ J C L C Jᵀ): its gain, for all
candidates by a few matrix products. The touch of the largest gain is added, one after the other; then each is exchanged
(Fedorov) until that gains nothing. The next touches have those made in the information that they start from; a whole
plan starts from nothing.

**What counts** is the mean over the region; so it is for a plan, although that is for the largest variance, which is
no linear criterion. Where values count beside the tip, as parameters of which it is independent or effects that are
suspected, L has their places on its diagonal, too (`CandidateTouches.counting`).

What a set of touches has to have so that it checks itself: small leverages, and touches on every disc.

**Leverage.** The block of a touch on the diagonal of the hat matrix is H = J C Jᵀ, (2, 2), with C the covariance with
all touches. With λ its larger eigenvalue, the residual shows at least the part 1 - λ of an error of the touch. Without
the touch the covariance is C + C Jᵀ (I - H)⁻¹ J C, so that the standard deviation of any combination of parameters
becomes at most 1/√(1 - λ) times as large. In a set without a leverage above `MOST_LEVERAGE` no single touch is so
important that its loss makes a standard deviation more than 2.24 times as large: one bound on the leverages stands for
both. The trace of H is the criterion with L = JᵀJ: where a leverage is too large, the touch is added that lowers this
most.

**Discs.** A disc that was moved or measured wrongly shows in its own touches. Two find its new place, a third one
checks that.

Source: Förstner, Zeitschrift für Vermessungswesen 104 (1979) 446: the redundancy number 1 - λ; in adjustment practice
errors count as well detectable above 0.3, as hardly detectable below 0.1.

**Touches not seen**, which the assessment of a calibration asks for. With B the whitened derivative of a touch's
equations by its force, C' the covariance of a fit without the touch and J its whitened Jacobian, the error of its
predicted force has the covariance B⁻¹ (I + J C' Jᵀ) B⁻ᵀ; in a fit with the touch and the covariance C, the residual has
B⁻¹ (I - J C Jᵀ) B⁻ᵀ. As in the assessment, a fifth of the touches is left out at a time, and the error is compared with
that of the fit, or the noise of the force where that is larger. Averaged over random divisions of the touches.

Sources: Fedorov, Theory of Optimal Experiments (1972), chapter 3; Atkinson, Donev and Tobias, Optimum Experimental
Designs, with SAS (2007), chapters 10 (V- or I-optimality) and 21 (compound criteria).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.assessment.grade import Limits
from scara_kinetostatic.calibration.estimate import fewest_touches
from scara_kinetostatic.calibration.gauss_helmert import whiten_by
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import blocks, leverage
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.planning.prediction import RobotModel, exact_plan
from scara_kinetostatic.simulation.plan import Plan, default_plan

LEAST_ARM = 0.02
"""Smallest distance of the line of force from each joint's axis, m; well above usual errors of the nominal geometry."""
PER_DISC = 36
"""Points around a disc."""
PRELOAD = 0.3
"""Part of the force by which preloaded touches go beyond it."""


class CandidateTouches(NamedTuple):
    """Candidates and the tip whose variance counts; L̄ in `RobotModel.scales`, then m declared errors in theirs.

    Attributes:
        plan: the n candidates.
        derivative: whitened Jacobian J of each, (n, 2, 12 + m).
        information: JᵀJ of each, (n, 12 + m, 12 + m).
        rows: indices of the parameters on which the tip depends, (k,).
        quadric: TᵀT over these at each place, flat, (k², g).
        prior: information of that prior and of the choice's, (12 + m, 12 + m).
    """

    plan: Plan
    derivative: Floats
    information: Floats
    rows: NDArray[np.intp]
    quadric: Floats
    prior: Floats

    def variance(self, covariance: Floats) -> Floats:
        """Variance of the tip at each place for covariances of L̄ (…, 12, 12), (…, g), m²."""
        own = covariance[..., self.rows[:, None], self.rows]
        return np.asarray(own.reshape(*own.shape[:-2], -1) @ self.quadric)

    def information_of(self, chosen: Sequence[int]) -> Floats:
        """Information of a set of candidates and of the prior, (12 + m, 12 + m)."""
        return self.prior + self.information[list(chosen)].sum(axis=0)

    def covariance_without_each(self, chosen: Sequence[int]) -> Floats:
        """Covariance with a set of candidates but each of them in turn, (c, 12 + m, 12 + m)."""
        return _inverse(self.information_of(chosen) - self.information[list(chosen)])

    def leverages(self, chosen: Sequence[int]) -> Floats:
        """Leverage of each touch of a set, (c,)."""
        return leverage(self.derivative[list(chosen)], _inverse(self.information_of(chosen)))

    def counting(self, values: Indices, share: float, number: int = 0) -> CandidateTouches:
        """The same, of one place for all, with the variance of some values counting beside that of the tip.

        All in what they are with touches evenly distributed over all candidates, so that neither unit nor size of the
        values matters (a compound criterion).

        Args:
            values: which, indices of the 12 + m.
            share: of them in the criterion; 1 for these values alone.
            number: of these touches; 0 for what the prior alone leaves.
        """
        now = _inverse(number * self.information.mean(axis=0) + self.prior)
        rows = np.union1d(self.rows, values)
        squares = np.zeros((len(rows), len(rows)))
        tip, own = np.searchsorted(rows, self.rows), np.searchsorted(rows, values)
        squares[np.ix_(tip, tip)] = (1 - share) / self.variance(now)[0] * self.quadric.reshape(len(tip), -1)
        squares[own, own] += share / len(values) / now[values, values]
        return self._replace(rows=rows, quadric=squares.reshape(-1, 1))


def _inverse(information: Floats) -> Floats:
    """The covariance of an information, (…, k, k)."""
    return np.asarray(np.linalg.inv(information), dtype=float)


def candidate_plan(
    robot: RobotModel,
    levels: Sequence[float],
    postures: Sequence[int] = (1, -1),
    per_disc: int = PER_DISC,
    preload: float = 0.0,
) -> Plan:
    """All candidates in the robot's cell.

    Args:
        robot: the robot with its cell.
        levels: force levels, N.
        postures: of the elbow, +1 and -1.
        per_disc: points around a disc.
        preload: part of the force of preloaded touches, which are candidates beside those without; 0 for none.

    Raises:
        CellError: a disc has no point within reach.
        UnsupportedDataError: every point is excluded by its line of force.
    """
    points = default_plan(robot.cell, per_disc, levels[:1], postures)
    every = [replace(points, force=np.full(len(points), float(level))) for level in levels]
    sure = np.array([(exact_plan(robot, plan).arms >= LEAST_ARM).all(axis=1) for plan in every])
    if not sure.any():
        raise UnsupportedDataError(
            f'at every point within reach the line of force passes a joint axis at less than {LEAST_ARM} m',
            'move the discs, or allow both postures',
        )
    chosen = [plan.select(good) for plan, good in zip(every, sure, strict=True)]
    eased = [0.0, preload] if preload else [0.0]
    return Plan.joined([replace(plan, preload=np.full(len(plan), part)) for plan in chosen for part in eased])


def prepare_candidates(robot: RobotModel, plan: Plan, tip: Floats, *, mean: bool = False) -> CandidateTouches:
    """Candidates from a plan.

    Args:
        robot: the robot.
        plan: all touches to choose from.
        tip: its derivatives T (`prediction.tip_in_use`), whose variance is to be minimised.
        mean: whether that is its mean over the region (I-optimality), one place for all, or the largest.
    """
    derivative, values = scaled_rows(robot, plan), len(robot.model.names)
    scaled = tip * robot.all_scales[:values]
    rows = np.flatnonzero(np.abs(scaled).max(axis=(0, 1, 2)) > 0)
    places = scaled.shape[0] * scaled.shape[1]
    scaled = scaled[..., rows].reshape(1 if mean else places, -1, len(rows)) / (places**0.5 if mean else 1.0)
    quadric = (scaled.swapaxes(1, 2) @ scaled).reshape(len(scaled), -1).T.copy()
    information = np.einsum('nik,nil->nkl', derivative, derivative)
    prior = robot.declared_rows.T @ robot.declared_rows
    prior[:values, :values] += np.eye(values)
    return CandidateTouches(plan, derivative, information, rows, quadric, prior)


def scaled_rows(robot: RobotModel, plan: Plan, metadata: TouchMetadata | None = None) -> Floats:
    """Whitened Jacobian of the touches of a plan, (n, 2, 12 + k + m), in `RobotModel.all_scales`."""
    return exact_plan(robot, plan, metadata).point.whitened.jacobian * robot.all_scales


MOST_LEVERAGE = 0.8
"""Largest leverage in a set that checks itself: a fifth of any error of a touch shows in its residual."""
TOUCHES_PER_DISC = 3
"""Touches on each disc in a set that checks itself."""


MOST_HELD_OUT = Limits.held_out_caution / 1.15
"""Largest error of touches not seen, in that of the fit, in a set that checks itself. A result above the limit is
not fit without caution; the factor leaves room for the scatter of that error. Source: with twenty touches the simulated
error is 0.85 times the predicted one, and scatters by a sixth.
"""


def held_out_ratio(robot: RobotModel, plan: Plan, folds: int = 5, divisions: int = 20) -> float:
    """Force error on touches not seen, in that of the fit to all touches of a plan.

    Args:
        robot: the robot.
        plan: the touches.
        folds: one part of so many is left out at a time.
        divisions: random divisions of the touches over which the error is averaged.
    """
    exact, n = exact_plan(robot, plan), len(plan)
    rows = exact.point.whitened.jacobian * robot.all_scales
    by_force = np.linalg.inv(whiten_by(exact.point.linear.by_force, exact.point.whitened.root))
    weight = np.swapaxes(by_force, 1, 2) @ by_force
    information = np.einsum('nik,nil->nkl', rows, rows)
    together = information.sum(axis=0) + robot.declared_rows.T @ robot.declared_rows
    values = len(robot.model.names)
    together[:values, :values] += 1e-4 * np.eye(values)  # keeps fits of few touches regular

    def spread(which: NDArray[np.intp], covariance: Floats, sign: int) -> Floats:
        spread_of_each = np.eye(2) + sign * blocks(rows[which], covariance)
        return np.sqrt(np.einsum('nij,nji->n', weight[which], spread_of_each))

    fitted = float(spread(np.arange(n), np.linalg.inv(together), -1).mean())
    random, errors = np.random.default_rng(0), np.empty((divisions, n))
    for k in range(divisions):
        part = random.permutation(n) % folds
        for fold in range(folds):
            left = np.flatnonzero(part == fold)
            errors[k, left] = spread(left, np.linalg.inv(together - information[left].sum(axis=0)), 1)
    return float(errors.mean()) / max(fitted, robot.noise.force_rms)


MOST_TOUCHES = 200
"""Largest set that is searched for."""
FEWEST_TOUCHES = fewest_touches(len(NAMES))
"""Smallest number of touches with which the calibration estimates all parameters: two equations each."""


def largest_variance(candidates: CandidateTouches, chosen: Sequence[int]) -> float:
    """Largest variance of the tip over the workspace with a set, indices of candidates, m²."""
    return float(candidates.variance(_inverse(candidates.information_of(chosen))).max())


def variance_with_each(candidates: CandidateTouches, chosen: Sequence[int]) -> Floats:
    """The criterion with each candidate added to a set, (n,), m².

    Args:
        candidates: with one place for all.
        chosen: the set, indices of candidates.
    """
    covariance = _inverse(candidates.information_of(chosen))
    through = candidates.derivative @ covariance
    own_blocks = through @ candidates.derivative.swapaxes(1, 2)
    own = through[..., candidates.rows]
    squares = own @ candidates.quadric.reshape(len(candidates.rows), -1) @ own.swapaxes(1, 2)
    gain = np.trace(np.linalg.solve(np.eye(2) + own_blocks, squares), axis1=1, axis2=2)
    return np.asarray(candidates.variance(covariance)[0] - gain)


def choose(candidates: CandidateTouches, number: int, per_disc: int = 0) -> list[int]:
    """The touches that lower the criterion most: one added after the other, then exchanged; indices of candidates.

    Args:
        candidates: with one place for all.
        number: of touches; all where there are not more candidates.
        per_disc: smallest number of touches on each disc, as far as candidates and touches suffice.
    """
    discs = candidates.plan.disc
    least = np.minimum(np.bincount(discs), per_disc)

    def best_beside(others: list[int]) -> tuple[int, float]:
        """The touch to add to others, where discs lack touches one of theirs, and the criterion with it."""
        values = variance_with_each(candidates, others)
        lacks = least > np.bincount(discs[others], minlength=len(least))
        values[lacks.any() & ~lacks[discs]] = np.inf
        values[others] = np.inf
        found = int(np.argmin(values))
        return found, float(values[found])

    chosen, reached = list[int](), np.inf
    for _ in range(min(number, len(discs))):
        found, reached = best_beside(chosen)
        chosen.append(found)
    before = np.inf
    while reached < before * (1 - 1e-2):  # passes over all positions of the set
        before = reached
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            found, value = best_beside(others)
            if value < reached * (1 - 1e-3):
                chosen, reached = [*others[:place], found, *others[place:]], value
    return chosen


def checked(candidates: CandidateTouches, chosen: list[int]) -> list[int]:
    """A set with as many more touches as it takes until no leverage is above `MOST_LEVERAGE`."""
    values = np.arange(len(candidates.prior))
    while len(chosen) < len(candidates.plan):
        found = candidates.leverages(chosen)
        if found.max() <= MOST_LEVERAGE:
            break
        worst = candidates.information[chosen[int(np.argmax(found))]]
        variances = variance_with_each(candidates._replace(rows=values, quadric=worst.reshape(-1, 1)), chosen)
        variances[chosen] = np.inf
        chosen = [*chosen, int(np.argmin(variances))]
    return chosen


def without_each(robot: RobotModel, plan: Plan, tip: Floats) -> Floats:
    """Largest standard deviation of the tip without each touch of a plan, (n,), m."""
    of_plan = prepare_candidates(robot, plan, tip)
    return np.asarray(np.sqrt(of_plan.variance(of_plan.covariance_without_each(range(len(plan)))).max(axis=1)))
