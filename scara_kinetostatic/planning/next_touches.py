"""The touches to make next: those that lower the tip's uncertainty over the region most, in an order of short travel.

**Choice** (I-optimality). The covariance of all values, of the declared errors and of effects that nobody has decided
about follows from the touches made and those planned, linearised where they are expected. Of all candidates that can be
reached those are chosen (`candidate_touches`) that lower the mean variance of the tip over the region most, without and
under load. Candidates are points around the discs, both postures, three forces, with and without a preload: a preload
is planned where it shows friction.

**Effects not decided.** Every effect of the catalogue counts, with a prior: its typical size where the diagnosis
suspects it, else the size that the mixed model has found, or `UNSUSPECTED` of the typical one without such a fit; one
with a form, as a frequency, in its typical form. So touches are spread enough to find it, or to show how small it is.
The variance of the sizes that are suspected counts as much as that of the tip, both in what they are now: an effect
that does not move the tip, as a disc elsewhere, is decided, too.

**Rivals** are decided by the touches of `planning.discrimination`. What the choice between them contributes to the
uncertainty of the tip is predicted to go with the probability that is left to the less likely ones, to nothing where
one is likely to reach 95 %.

**Enough** is said where the expanded uncertainty (95 %) of the tip is at most the tolerance all over the region, or
where `MOST_TOUCHES` more would not bring it there: then what the cell declares as uncertain is the limit.

Source: Atkinson, Donev and Tobias, Optimum Experimental Designs, with SAS (2007), chapters 10 (V- or I-optimality) and
21 (compound criteria).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.assessment.evidence import Discrimination, Evidence
from scara_kinetostatic.assessment.grade import SLIP_SHOWN, Limits
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.observations import RIVALS, UNDETECTED, VALUE
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.calibration.uncertainty_budget import title_of
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import orthonormal
from scara_kinetostatic.model.arm import CalibratedArm, force_on_object
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.kinematics import jacobian, quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics, press_aside
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import MILLI, P_EE
from scara_kinetostatic.model.quantities import percentage, quantity
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.planning.candidate_touches import (
    MOST_TOUCHES,
    PRELOAD,
    CandidateTouches,
    candidate_plan,
    choose,
    prepare_candidates,
    scaled_rows,
)
from scara_kinetostatic.planning.discrimination import Rivals
from scara_kinetostatic.planning.motion import Roadmap, Space, Waypoints, Ways, short_order
from scara_kinetostatic.planning.prediction import RobotModel, contributions, is_size, tip_in_use
from scara_kinetostatic.simulation.plan import Plan

UNSUSPECTED = 0.01
"""Prior of an effect that nobody suspects, in its typical size: it spreads the touches. With a tenth, twelve touches
gain hardly more than even ones; from a hundredth to a tenth as many effects are found.
"""
USUAL_NUMBER = 12
"""Touches that are planned unless told."""
_SLIPS = 0.2
"""Part of a radius by which a press may drag the tip aside, beyond the end of an edge."""


class TipForecast(NamedTuple):
    """The largest expanded uncertainty (95 %) of the tip over the region, m.

    Attributes:
        now: of the calibration; None for the nominal arm, infinite where it is not determined.
        planned: predicted with the touches made and planned, in the ratio to what those made give.
        least: the same with `MOST_TOUCHES` more, evenly spread, and nothing undetected.
        limit: what of the declared uncertainties, or noise, contributes most to that.
        share: its part of the variance, 0 to 1.
        undetected: what effects not detected or decided contribute to `now` and, as large, to `planned`, m: more
            touches may show how small they are, or not.
    """

    now: float | None
    planned: float
    least: float
    limit: str
    share: float
    undetected: float

    def beyond(self, tolerance: float) -> str:
        """That more touches do not reach a tolerance, m, and what limits; empty where they do."""
        if self.least <= tolerance:
            return ''
        return (
            f'{MOST_TOUCHES} more touches leave the tip an expanded uncertainty of {quantity(self.least, "m")} (95 %)'
            f', the tolerance is {quantity(tolerance, "m")}: '
            f'{percentage(self.share)} of its variance is from {self.limit}'
        )


def known_or_infinite(worst: float | None, undetermined: float) -> float:
    """The largest expanded uncertainty of the tip, m; infinite where it is not determined all over the region."""
    return worst if worst is not None and undetermined <= 0 and worst < np.inf else np.inf  # not a number neither


def undecided_parts(worst: float, of_tip: Mapping[str, float]) -> tuple[float, float]:
    """What effects not detected or decided, and what the choice between possible causes contribute to the largest
    uncertainty of the tip, m, by rows of a budget. The latter is what the other rows do not: over several causes the
    tip is not normal, and the radius that holds with 95 % is not twice the root of the sum of squares.
    """
    squares = {label: (COVERAGE_FACTOR * part) ** 2 for label, part in of_tip.items() if np.isfinite(part)}
    undetected = sum(square for label, square in squares.items() if label.startswith((UNDETECTED, VALUE)))
    left = worst**2 - sum(square for label, square in squares.items() if label != RIVALS)
    return float(np.sqrt(undetected)), float(np.sqrt(left)) if RIVALS in of_tip and left > 0 else 0.0


class DecidingTouches(NamedTuple):
    """Touches that decide between the sets of effects, and what is expected of them.

    Attributes:
        outlook: in words and figures.
        chosen: places of the touches among the candidates, the most decisive first.
    """

    outlook: Discrimination
    chosen: list[int]


class PlannedTouches(NamedTuple):
    """Touches in the order in which to make them.

    Attributes:
        plan: the touches.
        reasons: why each is made.
        approach: where the tip begins to approach each.
        ways: between these places.
        order: stop of `ways` of each.
        left_out: what cannot be touched, a sentence for each disc.
        uncertainty: of the tip.
        chosen: places of the touches among the candidates.
    """

    plan: Plan
    reasons: list[str]
    approach: Waypoints
    ways: Ways
    order: list[int]
    left_out: list[str]
    uncertainty: TipForecast
    chosen: list[int]


@dataclass(frozen=True, eq=False)
class Planner:
    """What the touches are planned for.

    Attributes:
        arm: calibrated, or nominal; its cell has the limits of the joints.
        now: the largest expanded uncertainty of the calibrated tip, m; None for a nominal arm.
        touches: that were made; None for none.
        suspected: labels of the effects that the diagnosis suspects and has not decided about.
        given_up: places that are not to be touched: disc, direction from its centre, rad, and posture of each.
        undetected: the part of `now` that effects not detected or not decided contribute, m.
        rivals: the sets of effects that may be gross; None where there are no two.
        choice: the part of `now` that the choice between these contributes, m.
        sizes: of the undetected effects by label, in their typical size, as the mixed model has them.
        limit: the largest part of `now`, in words.
        freed: names of the values of the model that may have changed since the touches were made; None where the
            touches to come are no update of the calibration.
    """

    arm: CalibratedArm
    now: float | None = None
    touches: TouchSet | None = None
    suspected: frozenset[str] = frozenset()
    given_up: tuple[tuple[int, float, int], ...] = ()
    undetected: float = 0.0
    sizes: Mapping[str, float] = field(default_factory=dict)
    limit: str = 'not known'
    rivals: Rivals | None = None
    choice: float = 0.0
    freed: tuple[str, ...] | None = None

    @classmethod
    def of_outcome(cls, outcome: Outcome, given_up: tuple[tuple[int, float, int], ...] = ()) -> Planner:
        """What a calibration knows, and its touches."""
        return replace(cls.of_evidence(outcome, given_up), arm=outcome.arm)

    @classmethod
    def of_evidence(cls, outcome: Evidence, given_up: tuple[tuple[int, float, int], ...] = ()) -> Planner:
        """The same before it is assessed."""
        found, final, tip = outcome.diagnosis, outcome.final, outcome.tip_uncertainty
        doubtful = {item.effect.label for item in found.found if not item.is_found}
        sizes = dict[str, float]()
        if final.random is not None:
            for column, size in zip(final.random.columns, final.random.size, strict=True):
                part, label = size / abs(column.effect.typical[column.parameter]), column.effect.label
                sizes[label] = max(part, sizes.get(label, 0.0))
        of_tip, touches = {item.label: item.tip for item in outcome.budget}, final.touches.select(final.used)
        suspected = frozenset(doubtful.union(*map(set, found.rivals)))
        rivals = None if found.verdict == 'none' and not found.is_undecided else Rivals.of(final)
        planner = cls.of_statement(final.arm, tip.worst, tip.undetermined, of_tip, touches, suspected, rivals)
        return replace(planner, given_up=given_up, sizes=sizes)

    @classmethod
    def of_statement(
        cls,
        arm: CalibratedArm,
        worst: float | None,
        undetermined: float,
        of_tip: Mapping[str, float],
        touches: TouchSet | None,
        suspected: frozenset[str],
        rivals: Rivals | None = None,
    ) -> Planner:
        """By what a calibration states of the tip.

        Args:
            arm: as of `Planner`, like `touches`, `suspected` and `rivals`.
            worst: its largest expanded uncertainty, m; None where there is none.
            undetermined: the part of the region where it is not determined.
            of_tip: standard uncertainty of it by source, as of a budget, m.
            touches: that were made.
            suspected: effects.
            rivals: sets of effects.
        """
        undetected, choice = undecided_parts(worst or 0.0, of_tip)
        if rivals is None:
            undetected, choice = float(np.hypot(undetected, choice)), 0.0
        now = known_or_infinite(worst, undetermined)
        limit = title_of(max(of_tip, key=lambda label: float(np.nan_to_num(of_tip[label]))))
        return cls(arm, now, touches, suspected, (), undetected, {}, limit, rivals, choice)

    @cached_property
    def robot(self) -> RobotModel:
        """The robot, its effects those found and those undecided."""
        model, cell = self.arm.model, self.arm.cell
        own = cast(tuple[Effect, ...], self.arm.effects)
        declared, labels = RobotModel.of(cell).declared, {effect.label for effect in own}
        known = labels | (set(declared.places if declared else ()) - self.suspected)  # declared, but rather a mistake
        lasting = (effect for effect in catalogue(cell) if effect.is_physical and not effect.is_stepwise)
        undecided = [effect for effect in lasting if effect.label not in known]
        effects = (*own, *undecided)
        values = list(model.with_effects(effects).effect_values)
        sizes = [np.abs(effect.typical) + np.abs(found) for effect, found in zip(own, values, strict=False)]
        for k, effect in enumerate(undecided, len(own)):
            part = 1.0 if effect.label in self.suspected else self.sizes.get(effect.label, UNSUSPECTED)
            size = np.where(is_size(effect), part, 1.0) * np.abs(effect.typical)
            if effect.grid_parameter:  # linear about the effect in this form, which stays
                values[k] = tuple(size.tolist())
                size[effect.grid_parameter_index] = 0.0
            sizes.append(size)
        flat = tuple(np.concatenate([*sizes, []]).tolist())
        return RobotModel(cell, model.parameters, self.arm.noise, (), effects, tuple(values), flat)

    @cached_property
    def _in_doubt(self) -> Indices:
        """Which of the values are sizes of effects that are suspected."""
        effects = self.robot.effects
        doubt = [is_size(effect) & (effect.label in self.suspected) for effect in effects]
        return len(self.robot.parameters.names) + np.flatnonzero(np.concatenate([*doubt, np.zeros(0, dtype=bool)]))

    @cached_property
    def _values(self) -> int:
        """Number of the values of the arm's model, without undetected effects."""
        return len(self.robot.parameters.names) + sum(len(effect.parameters) for effect in self.arm.effects)

    @cached_property
    def _tip_of_all(self) -> Floats:
        """The tip by all values."""
        return tip_in_use(self.robot, float(np.mean(self.arm.cell.touch.force)))

    @cached_property
    def _tip(self) -> Floats:
        """The tip by those of the arm's model."""
        return self._tip_of_all[..., : self._values]

    def _largest(self, covariance: Floats) -> float:
        """Largest expanded uncertainty of the tip for a covariance of the arm's values, m."""
        variance = np.linalg.eigvalsh(self._tip @ covariance @ self._tip.swapaxes(-1, -2))[..., -1]
        return float(COVERAGE_FACTOR * np.sqrt(max(variance.max(), 0.0)))

    @cached_property
    def space(self) -> Space:
        """Where the tip may be: it keeps the clearance of the cell until the model is good enough to keep less, 3 mm
        beside three standard deviations of tip and discs.
        """
        cell = self.arm.cell
        return Space(cell, self.arm.model.parameters, min(cell.touch.clearance, 3 * MILLI + self._off))

    @property
    def _off(self) -> float:
        """Three standard deviations of tip and discs, m; infinite where a part may have changed."""
        known = np.inf if self.now is None or self.freed else self.now
        return 3 * (known / COVERAGE_FACTOR + self.arm.cell.surface_std)

    @property
    def doubt(self) -> float:
        """How far before its place a contact may come, m: half of what is searched; where the arm is known, a
        millimetre beside three standard deviations of tip and discs.
        """
        return min(0.5 * self.arm.cell.touch.search, MILLI + self._off)

    @cached_property
    def roadmap(self) -> Roadmap:
        """The ways in it."""
        return Roadmap(self.space)

    def approach(self, plan: Plan) -> Waypoints:
        """Where the tip begins to approach each touch."""
        off = self.space.clearance + MILLI
        return Waypoints(plan.contact(self.arm.cell) + off * plan.normal(self.arm.cell), plan.posture)

    def problems(self, plan: Plan) -> list[str]:
        """Why each touch of a plan cannot be made; empty where it can."""
        cell, p, start = self.arm.cell, self.arm.model.parameters, self.approach(plan)
        contact, normal = plan.contact(cell), plan.normal(cell)
        deep = contact - cell.touch.search * normal
        # where the largest force drags the rigid tip
        joints, force = self.space.joints(Waypoints(contact, plan.posture)), (1 + plan.preload) * plan.force
        moved = jacobian(p, joints) @ press_aside(p, joints, -force[:, None] * normal, plan.aside)[..., None]
        end, slid = contact + moved[..., 0], np.abs((moved[..., 0] * quarter_turn(normal)).sum(axis=1))
        stands = ~(self.space.beyond_limits(start) | self.space.beyond_limits(Waypoints(deep, plan.posture)))
        moves: Mask = np.asarray(stands.all(axis=1))
        moves[moves] = self.space.keeps_limits(start.select(moves), deep[moves])
        moves &= ~self.space.beyond_limits(Waypoints(end, plan.posture)).any(axis=1)
        clear = self.space.is_clear(start.tip, deep, but=plan.disc)
        clear &= self.space.is_clear(contact, end, but=plan.disc)
        good = np.flatnonzero(moves & clear)
        joined = np.zeros(len(plan), dtype=bool)
        joined[good] = self.roadmap.largest_part(start.select(good))
        disc, angle, posture = np.array(self.given_up, dtype=float).reshape(-1, 3).T[..., None]
        near_by = np.abs(wrap(plan.angle - angle)) < np.deg2rad(10)  # nearer nothing is touched
        left = ((plan.disc == disc) & (plan.posture == posture) & near_by).any(axis=0)
        surface, part = cell.surfaces.places(plan.disc, plan.angle)
        touched, size = cell.surfaces.select(surface), np.abs(cell.surfaces.radii[surface])
        to_end = np.where(touched.is_edge, (1 - np.abs(part)) * touched.halves, _SLIPS * size)
        # the tip of an arm of unknown geometry may pass beside a corner
        has_corners = np.array([isinstance(item, Outline) for item in cell.discs])[plan.disc]
        corner = has_corners & (np.where(touched.is_edge, to_end, size) < cell.touch.search)
        one, two = cell.joint_names
        within = f'within {self.space.clearance / MILLI:.1f} mm'
        cases = {
            'beyond touch.max_force': force > cell.touch.max_force,
            'given up': left,
            f'beyond the limits of {two}': ~stands[:, 1],
            f'beyond the limits of {one}': ~stands[:, 0] | ~moves,
            f'an object, the base or the end of the reach is {within}': ~clear,
            'the press would drag the tip off it': slid > np.maximum(to_end, _SLIPS * (cell.tip_radius or 0.0)),
            'a corner is nearer than touch.search, and the arm is not yet calibrated': corner
            & self.arm.undetermined[:P_EE].any(),
            'no way leads there': ~joined,
        }
        return [str(text) for text in np.select(list(cases.values()), list(cases), '')]

    @cached_property
    def _candidates(self) -> tuple[Plan, list[str]]:
        """The touches to choose from, and what was left out of each disc."""
        cell, levels = self.arm.cell, np.unique(np.linspace(*self.arm.cell.touch.force, 3)).tolist()
        anywhere = replace(self.robot, cell=replace(cell, limits=None))  # `problems` tells what they exclude
        every = candidate_plan(anywhere, levels, per_disc=24, preload=PRELOAD)
        if cell.limits is None:
            return every, []
        problems = np.array(self.problems(every))
        excluded: Mask = problems != ''
        if excluded.all():
            remedy = 'correct the limits, the obstacles, the clearance or the places of the discs'
            raise UnsupportedDataError(f'no touch can be reached: {_counted(problems)}', remedy)
        texts = []
        for number, disc in enumerate(cell.discs):
            here = every.disc == number
            if (excluded & here).any():
                left = f'{np.count_nonzero(excluded & here)} of {np.count_nonzero(here)} touches left out'
                texts.append(f'{disc.name}: {left}: {_counted(problems[here])}')
        return every.select(~excluded), texts

    @cached_property
    def _rows_made(self) -> Floats:
        """Whitened derivatives of the touches that were made by all values, (2n, v)."""
        t, arm, cell = self.touches, self.arm, self.arm.cell
        size = len(self.robot.all_scales)
        if t is None or not len(t):
            return np.zeros((0, size))
        metadata = TouchMetadata.of(t, cell.sensor.frame)
        force = force_on_object(arm, t.force, t.joints, metadata)
        tips = direct_kinetostatics(arm.model.parameters, t.joints, force, cell.gripper_sign)[0]
        plan = Plan(t.disc, cell.surfaces.angles(t.disc, tips, force), t.posture, np.hypot(*force.T))
        at = plan.contact(cell)
        pressed, _ = inverse_kinetostatics(arm.model.parameters, at, force, t.posture, cell.gripper_sign)
        there = np.asarray(np.isfinite(pressed).all(axis=1))
        return scaled_rows(self.robot, plan.select(there), metadata.select(there)).reshape(-1, size)

    @cached_property
    def _information_made(self) -> Floats:
        """Information of the touches that were made; those of what is freed had another value of it."""
        rows = self._rows_made.copy()
        if self.freed:
            names = self.robot.model.names
            places = [names.index(name) for name in self.freed]
            changed = orthonormal(rows[:, places])
            rows -= changed @ (changed.T @ rows)
            rows[:, places] = 0.0
        return np.asarray(rows.T @ rows)

    @cached_property
    def candidates(self) -> CandidateTouches:
        """The touches to choose from; the information of those made is part of the prior."""
        candidates = prepare_candidates(self.robot, self._candidates[0], self._tip_of_all, mean=True)
        candidates = candidates._replace(prior=candidates.prior + self._information_made)
        return candidates.counting(self._in_doubt, 0.5) if len(self._in_doubt) else candidates

    def accurate(self, number: int) -> PlannedTouches:
        """So many touches that lower the uncertainty of the tip most, and decide about what is suspected.

        Raises:
            UnsupportedDataError: no touch can be reached.
        """
        return self._arranged(choose(self.candidates, number))

    def fewest(self, most: int = USUAL_NUMBER) -> PlannedTouches:
        """The fewest touches, `most` at most, after which the tip is as well known as before but for a tenth, or to the
        tolerance, that check each other and show a slip of `Limits.detectable_slip` of a zero that is not freed; where
        nothing is freed no fewer than a verification needs.

        Raises:
            UnsupportedDataError: no touch can be reached.
        """
        enough = max(1.1 * (self.now or 0.0), self.arm.cell.tolerance or 0.0)
        for number in range(2 if self.freed else Limits.fewest_verifying, most + 1):
            chosen = choose(self.candidates, number)
            shows = all(slip <= Limits.detectable_slip for slip in self.smallest_slips(chosen).values())
            checks = self.candidates.leverages(chosen).max() <= Limits.leverage_caution
            if shows and checks and self._uncertainty(chosen).planned <= enough:
                break
        return self._arranged(chosen)

    def smallest_slips(self, chosen: list[int]) -> dict[str, float]:
        """The slips of the zeros that are not freed which chosen touches will show, rad (`SLIP_SHOWN`)."""
        prior = self.candidates.prior
        made, names = self.candidates.information_of(chosen) - prior, self.robot.model.names
        since = made - made @ np.linalg.solve(prior + made, made)
        zeros = [name for name in ('theta1', 'theta2') if name not in (self.freed or ())]
        places = [names.index(name) for name in zeros]
        std = self.robot.all_scales[places] / np.sqrt(np.maximum(np.diag(since)[places], 1e-30))
        return dict(zip(zeros, (SLIP_SHOWN * std).tolist(), strict=True))

    @cached_property
    def _rows(self) -> Floats:
        """Derivatives of the candidates by all values of the rivals, (n, 2, v)."""
        assert self.rivals is not None
        return self.rivals.rows(self._candidates[0])

    def decision(self, number: int = USUAL_NUMBER) -> DecidingTouches | None:
        """The touches that decide between the rivals, and what does where these do not; None where there are none, or
        one is as likely already as a decision needs.

        Raises:
            UnsupportedDataError: no touch can be reached.
        """
        rivals, plan = self.rivals, self._candidates[0]
        if rivals is None or rivals.is_decided:
            return None
        chosen = rivals.choose(self._rows, number)
        odds = rivals.share * rivals.probability
        expected, limit = (rivals.share * one.probability for one in rivals.outlook(self._rows, chosen))
        titles = tuple(plan.select(np.array(chosen)).titles(rivals.robot.cell))
        by_set = tuple(zip(rivals.labels, odds.tolist(), strict=True))
        found = Discrimination(by_set, titles, float(odds.max()), expected, MOST_TOUCHES, limit, ())
        return DecidingTouches(found if found.is_decisive else found._replace(remedies=rivals.remedies(plan)), chosen)

    def discriminating(self, decision: DecidingTouches, number: int) -> PlannedTouches:
        """The first so many of the touches that decide most."""
        return self._arranged(decision.chosen[:number], self._in_doubt)

    def _arranged(self, chosen: list[int], decided: Indices | None = None) -> PlannedTouches:
        """Chosen touches, which tell `decided` values, in the order of a short way."""
        plan = self.candidates.plan.select(np.array(chosen, dtype=np.intp))
        reasons = self._reasons(chosen, decided)
        own = self.approach(plan)
        ways = self.roadmap.ways(own)
        order = short_order(ways.lengths)
        at, texts, found = np.array(order), [reasons[k] for k in order], self._uncertainty(chosen)
        return PlannedTouches(plan.select(at), texts, own.select(at), ways, order, self._candidates[1], found, chosen)

    def _uncertainty(self, chosen: list[int]) -> TipForecast:
        """Of the tip by the arm's own model, without what is undecided."""
        candidates, count = self.candidates, self._values
        kept = np.r_[:count, len(self.robot.model.names) : len(candidates.prior)]
        scales = self.robot.all_scales[kept]

        def covariance(information: Floats) -> Floats:
            return np.asarray(scales[:, None] * np.linalg.inv(information[np.ix_(kept, kept)]) * scales)

        together = candidates.information_of(chosen)
        least = covariance(together + MOST_TOUCHES * candidates.information.mean(axis=0))
        own = least[:count, :count]
        known = candidates.prior - self._information_made + self._rows_made.T @ self._rows_made
        before, after = (self._largest(covariance(made)[:count, :count]) for made in (known, together))
        ratio, undetected = 1.0, 0.0
        if self.now is not None and np.isfinite(self.now):
            apart = self.undetected**2 + self.choice**2
            ratio, undetected = np.sqrt(max(self.now**2 - apart, 0.0)) / before, self.undetected
        parts = contributions(least, count, self.robot.declared, self._tip)
        limit = max(parts, key=lambda kind: parts[kind])
        share = parts[limit] ** 2 / sum(part**2 for part in parts.values())
        planned, many = float(np.hypot(ratio * after, undetected)), ratio * self._largest(own)
        if self.rivals is not None:
            soon, left = (self.choice * self.rivals.doubt_left(one) for one in self.rivals.outlook(self._rows, chosen))
            planned, alone = float(np.hypot(planned, soon)), many
            many = float(np.hypot(alone, left))
            if left > alone:
                limit, share = 'the choice between possible causes', (left / many) ** 2
        return TipForecast(np.inf if self.freed else self.now, planned, many, limit, share, undetected)

    def _reasons(self, chosen: list[int], among: Indices | None = None) -> list[str]:
        """What each touch of a set tells: the value, of all or of some, whose variance would grow most without it."""
        names, candidates = self.robot.model.names, self.candidates
        values = np.arange(len(names)) if among is None or not len(among) else among
        variance = np.diagonal(np.linalg.inv(candidates.information_of(chosen)))[values]
        without = np.diagonal(candidates.covariance_without_each(chosen), axis1=1, axis2=2)[:, values]
        found = []
        for k, best in zip(chosen, values[np.argmax(without / variance, axis=1)].tolist(), strict=True):
            verb = 'decides' if best >= self._values or best in self._in_doubt else 'sharpens'
            preload = f', preload {percentage(PRELOAD)}' if candidates.plan.preload[k] else ''
            found.append(f'{verb} {names[best].rpartition(".")[0] or names[best]}{preload}')
        return found


def discrimination_of(evidence: Evidence) -> Discrimination | None:
    """What decides between the sets of effects of a calibration, within reach; None where nothing is to be decided."""
    try:
        found = Planner.of_evidence(evidence).decision()
    except ScaraKinetostaticError:  # nothing can be touched
        return None
    return None if found is None else found.outlook


def _counted(problems: NDArray[np.str_]) -> str:
    """What excludes touches, with how many, the most frequent first."""
    return ', '.join(f'{many} {text}' for text, many in Counter(filter(None, problems.tolist())).most_common())
