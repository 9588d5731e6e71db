"""The touches to make next: those that lower the tip's uncertainty over the region most, in an order of short travel.

**Choice** (I-optimality). The covariance of all values, of the declared errors and of effects that nobody has decided
about follows from the touches made and those planned, linearised where they are expected. Of all candidates that can be
reached the one is added that lowers the mean variance of the tip over the region most, without and under load; then
touches are exchanged as in `search`. Candidates are points around the discs, both postures, three forces, with and
without a preload: a preload is planned where it shows friction.

**Effects not decided.** Every effect of the catalogue counts, with a prior: its typical size where the diagnosis
suspects it, else the size that the mixed model has found, or `UNSUSPECTED` of the typical one without such a fit; one
with a form, as a frequency, in its typical form. So touches are spread enough to find it, or to show how small it is.
The variance of the sizes that are suspected counts as much as that of the tip, both in what they are now: an effect
that does not move the tip, as a disc elsewhere, is decided, too.

**Rivals** are decided by the touches at which their predictions differ most (`diagnosis.comparison`), each once, and by
those that lower the variance of their sizes in a model with all of them most.

**Enough** is said where the expanded uncertainty (k = 2) of the tip is at most the tolerance all over the region, or
where `MOST_TOUCHES` more would not bring it there: then what the cell declares as uncertain is the limit.

Source: Atkinson, Donev and Tobias, Optimum Experimental Designs, with SAS (2007), chapters 10 (V- or I-optimality), 20
(discrimination by a common model) and 21 (compound criteria).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.declared_errors import RIVALS, UNDETECTED
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.diagnosis.result import DiscriminatingTouch
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm, force_on_object
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.kinematics import jacobian, quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics, press_aside
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import quantity
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.planning.candidates import (
    MOST_TOUCHES,
    CandidateTouches,
    candidate_plan,
    declared_rows,
    improve,
    largest_variance,
    prepare_candidates,
    variance_with_each,
)
from scara_kinetostatic.planning.motion import Poses, Roadmap, Space, Ways, shortest_order
from scara_kinetostatic.planning.optimal_design import contributions
from scara_kinetostatic.planning.prediction import Robot, Tip, exact_plan, tip_in_use
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.plan_file import POSTURE_NAMES

UNSUSPECTED = 0.01
"""Prior of an effect that nobody suspects, in its typical size: it spreads the touches. With a tenth, twelve touches
gain hardly more than even ones; from a hundredth to a tenth as many effects are found.
"""
PRELOAD = 0.3
"""Part of the force by which preloaded touches go beyond it."""
_SLIPS = 0.2
"""Part of a radius by which a press may drag the tip aside, beyond the end of an edge."""


class Uncertainty(NamedTuple):
    """The largest expanded uncertainty (k = 2) of the tip over the region, m.

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
            f'{MOST_TOUCHES} more touches leave the tip an expanded uncertainty of {quantity(self.least, "m")} (k = 2)'
            f', the tolerance is {quantity(tolerance, "m")}: '
            f'{100 * self.share:.0f} % of its variance is from {self.limit}'
        )


def known_or_infinite(worst: float | None, undetermined: float) -> float:
    """The largest expanded uncertainty of the tip, m; infinite where it is not determined all over the region."""
    return worst if worst is not None and undetermined <= 0 and worst < np.inf else np.inf  # not a number neither


def undetected_part(of_tip: Mapping[str, float]) -> float:
    """What effects not detected or decided contribute to the largest uncertainty of the tip, m, by rows of a budget."""
    known = {label: part for label, part in of_tip.items() if part and np.isfinite(part)}
    parts = [part for label, part in known.items() if label.startswith((UNDETECTED, RIVALS))]
    return float(COVERAGE_FACTOR * np.sqrt(np.square(parts).sum()))


class PlannedTouches(NamedTuple):
    """Touches in the order in which to make them.

    Attributes:
        plan: the touches.
        reasons: why each is made.
        approach: where the tip begins to approach each.
        ways: between these places.
        order: stop of `ways` of each, from 1 on where stop 0 is the place to start from.
        left_out: what cannot be touched, a sentence for each disc or touch.
        uncertainty: of the tip.
    """

    plan: Plan
    reasons: list[str]
    approach: Poses
    ways: Ways
    order: list[int]
    left_out: list[str]
    uncertainty: Uncertainty

    def sentence(self, cell: Cell, k: int = 0) -> str:
        """One of the touches in words, such as ``disc_2 at 170°, left, 40 N, it sharpens l2``."""
        plan = self.plan
        where = f'{cell.discs[int(plan.disc[k])].name} at {np.degrees(plan.angle[k]) % 360:.0f}°'
        return f'{where}, {POSTURE_NAMES[int(plan.posture[k])]}, {plan.force[k]:.0f} N, it {self.reasons[k]}'


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
        sizes: of the undetected effects by label, in their typical size, as the mixed model has them.
    """

    arm: CalibratedArm
    now: float | None = None
    touches: TouchSet | None = None
    suspected: frozenset[str] = frozenset()
    given_up: tuple[tuple[int, float, int], ...] = ()
    undetected: float = 0.0
    sizes: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of_outcome(cls, outcome: Outcome, given_up: tuple[tuple[int, float, int], ...] = ()) -> Planner:
        """What a calibration knows, and its touches."""
        found, final, tip = outcome.diagnosis, outcome.final, outcome.tip_uncertainty
        doubtful = {item.effect.label for item in found.found if not item.is_found}
        now = known_or_infinite(tip.worst, tip.undetermined)
        suspected = frozenset(doubtful.union(*map(set, found.rivals)))
        undetected = undetected_part({item.label: item.tip for item in outcome.budget})
        sizes = dict[str, float]()
        if final.random is not None:
            for column, size in zip(final.random.columns, final.random.size, strict=True):
                part, label = size / abs(column.effect.typical[column.parameter]), column.effect.label
                sizes[label] = max(part, sizes.get(label, 0.0))
        return cls(outcome.arm, now, final.touches.select(final.used), suspected, given_up, undetected, sizes)

    @cached_property
    def robot(self) -> Robot:
        """The robot, its effects those found and those undecided."""
        model, cell = self.arm.model, self.arm.cell
        own = [effect for effect in self.arm.effects if isinstance(effect, Effect)]
        declared = Robot.of(cell).declared
        known = {effect.label for effect in own} | set(declared.places if declared else ())
        lasting = (effect for effect in catalogue(cell) if effect.is_physical and not effect.is_stepwise)
        undecided = [effect for effect in lasting if effect.label not in known]
        effects = (*own, *undecided)
        values = list(model.with_effects(effects).effect_values)
        sizes = [np.abs(effect.typical) + np.abs(found) for effect, found in zip(own, values, strict=False)]
        for k, effect in enumerate(undecided, len(own)):
            part = 1.0 if effect.label in self.suspected else self.sizes.get(effect.label, UNSUSPECTED)
            size = np.where(_is_size(effect), part, 1.0) * np.abs(effect.typical)
            if effect.grid_parameter:  # linear about the effect in this form, which stays
                values[k] = tuple(size.tolist())
                size[effect.grid_parameter_index] = 0.0
            sizes.append(size)
        flat = tuple(np.concatenate([*sizes, []]).tolist())
        return Robot(cell, model.parameters, self.arm.noise, (), effects, tuple(values), flat)

    @cached_property
    def _in_doubt(self) -> Indices:
        """Which of the values are sizes of effects that are suspected."""
        effects = self.robot.effects
        doubt = [_is_size(effect) & (effect.label in self.suspected) for effect in effects]
        return len(self.robot.parameters.names) + np.flatnonzero(np.concatenate([*doubt, np.zeros(0, dtype=bool)]))

    @cached_property
    def _values(self) -> int:
        """Number of the values of the arm's model, without undetected effects."""
        return len(self.robot.parameters.names) + sum(len(effect.parameters) for effect in self.arm.effects)

    @cached_property
    def _tip(self) -> Tip:
        return tip_in_use(self.robot, float(np.mean(self.arm.cell.touch.force)))

    def _expanded(self, covariance: Floats) -> Floats:
        """Expanded uncertainty of the tip at each place for a covariance of the arm's values, (g,), m."""
        derivative = self._tip.derivative[..., : self._values]
        variance = np.linalg.eigvalsh(derivative @ covariance @ derivative.swapaxes(-1, -2))[..., -1]
        return np.asarray(COVERAGE_FACTOR * np.sqrt(np.maximum(variance, 0.0).max(axis=1)))

    @cached_property
    def space(self) -> Space:
        """Where the tip may be: it keeps the clearance of the cell until the model is good enough to keep less, 3 mm
        beside three standard deviations of tip and discs.
        """
        cell = self.arm.cell
        return Space(cell, self.arm.model.parameters, min(cell.touch.clearance, 3e-3 + self._off))

    @property
    def _off(self) -> float:
        """Three standard deviations of tip and discs, m."""
        return np.inf if self.now is None else 3 * (self.now / COVERAGE_FACTOR + self.arm.cell.surface_std)

    @property
    def doubt(self) -> float:
        """How far before its place a contact may come, m: half of what is searched; where the arm is known, a
        millimetre beside three standard deviations of tip and discs.
        """
        return min(0.5 * self.arm.cell.touch.search, 1e-3 + self._off)

    @cached_property
    def roadmap(self) -> Roadmap:
        """The ways in it."""
        return Roadmap(self.space)

    def approach(self, plan: Plan) -> Poses:
        """Where the tip begins to approach each touch."""
        off = self.space.clearance + 1e-3
        return Poses(plan.contact(self.arm.cell) + off * plan.normal(self.arm.cell), plan.posture)

    def problems(self, plan: Plan) -> list[str]:
        """Why each touch of a plan cannot be made; empty where it can."""
        cell, start = self.arm.cell, self.approach(plan)
        deep = plan.contact(cell) - cell.touch.search * plan.normal(cell)
        stands = ~(self.space.beyond_limits(start) | self.space.beyond_limits(Poses(deep, plan.posture)))
        moves = np.zeros(len(plan), dtype=bool)
        both = np.flatnonzero(stands.all(axis=1))
        moves[both] = self.space.keeps_limits(start.select(both), deep[both])
        clear = self.space.is_clear(start.tip, deep, but=plan.disc)
        end, slid = self._dragged(plan.select(both))
        moves[both] &= ~self.space.beyond_limits(Poses(end, plan.posture[both])).any(axis=1)
        clear[both] &= self.space.is_clear(plan.contact(cell)[both], end, but=plan.disc[both])
        good = np.flatnonzero(moves & clear)
        joined = np.zeros(len(plan), dtype=bool)
        joined[good] = self.roadmap.largest_part(start.select(good))
        one, two = cell.joint_names
        left = np.zeros(len(plan), dtype=bool)
        for disc, angle, posture in self.given_up:
            near_by = np.abs(wrap(plan.angle - angle)) < np.deg2rad(10)  # nearer nothing is touched
            left |= (plan.disc == disc) & (plan.posture == posture) & near_by
        slipped = np.zeros(len(plan), dtype=bool)
        surface, part = cell.surfaces.places(plan.disc[both], plan.angle[both])
        touched = cell.surfaces.select(surface)
        to_end = np.where(touched.is_edge, (1 - np.abs(part)) * touched.halves, _SLIPS * np.abs(touched.radii))
        slipped[both] = slid > np.maximum(to_end, _SLIPS * (cell.tip_radius or 0.0))
        corner = np.zeros(len(plan), dtype=bool)
        if self.arm.undetermined[:6].any():  # the tip of an arm of unknown geometry may pass beside a corner
            room = np.where(touched.is_edge, to_end, np.abs(touched.radii))
            has_corners = np.array([isinstance(disc, Outline) for disc in cell.discs])[plan.disc[both]]
            corner[both] = has_corners & (room < cell.touch.search)
        within = f'within {1e3 * self.space.clearance:.1f} mm'
        cases = {
            'beyond touch.max_force': (1 + plan.preload) * plan.force > cell.touch.max_force,
            'given up': left,
            f'beyond the limits of {two}': ~stands[:, 1],
            f'beyond the limits of {one}': ~stands[:, 0] | ~moves,
            f'an object, the base or the end of the reach is {within}': ~clear,
            'the press would drag the tip off it': slipped,
            'a corner is nearer than touch.search, and the arm is not yet calibrated': corner,
            'no way leads there': ~joined,
        }
        return [str(text) for text in np.select(list(cases.values()), list(cases), '')]

    def _dragged(self, plan: Plan) -> tuple[Floats, Floats]:
        """Where the rigid tip is under the largest force, (n, 2), m, and how far aside, (n,), m."""
        p, contact, normal = self.arm.model.parameters, plan.contact(self.arm.cell), plan.normal(self.arm.cell)
        joints = self.space.joints(Poses(contact, plan.posture))
        force = -((1 + plan.preload) * plan.force)[:, None] * normal
        moved = (jacobian(p, joints) @ press_aside(p, joints, force, plan.aside)[..., None])[..., 0]
        return contact + moved, np.abs((moved * quarter_turn(normal)).sum(axis=1))

    @cached_property
    def _candidates(self) -> tuple[Plan, list[str]]:
        """The touches to choose from, and what was left out of each disc."""
        cell, found, texts = self.arm.cell, list[str](), list[str]()

        def keep(points: Plan) -> Mask:
            found[:] = self.problems(points)
            names = points.disc
            for number, disc in enumerate(cell.discs):
                here = [text for text, at in zip(found, names, strict=True) if at == number]
                count = Counter(filter(None, here))
                if count:
                    why = ', '.join(f'{many} {text}' for text, many in count.most_common())
                    texts.append(f'{disc.name}: {sum(count.values())} of {len(here)} places left out: {why}')
            return np.array([not text for text in found])

        low, high = cell.touch.force
        levels = np.unique(np.linspace(low, high, 3)).tolist()
        every = candidate_plan(self.robot, levels, per_disc=24, preload=PRELOAD, keep=keep)
        if not len(every):
            why = ', '.join(f'{many} {text}' for text, many in Counter(found).most_common())
            remedy = 'correct the limits, the obstacles, the clearance or the places of the discs'
            raise UnsupportedDataError(f'no touch can be reached: {why}', remedy)
        may = [not text for text in self.problems(every)]  # where the least force is good, more may not be
        return every.select(np.array(may)), texts

    @cached_property
    def _information_made(self) -> Floats:
        """Information of the touches that were made."""
        t, arm, cell = self.touches, self.arm, self.arm.cell
        size = len(declared_rows(self.robot)[0])
        if t is None or not len(t):
            return np.zeros((size, size))
        metadata = TouchMetadata.of(t, cell.sensor.frame)
        force = force_on_object(arm, t.force, t.joints, metadata)
        tips = direct_kinetostatics(arm.model.parameters, t.joints, force, cell.gripper)[0]
        plan = Plan(t.disc, cell.surfaces.angles(t.disc, tips, force), t.posture, np.hypot(*force.T))
        pressed = inverse_kinetostatics(arm.model.parameters, plan.contact(cell), force, t.posture, cell.gripper)[0]
        there = np.asarray(np.isfinite(pressed).all(axis=1))
        point = exact_plan(self.robot, plan.select(there), metadata.select(there)).point
        rows = (point.whitened.jacobian * declared_rows(self.robot)[0]).reshape(-1, size)
        return np.asarray(rows.T @ rows)

    @cached_property
    def candidates(self) -> CandidateTouches:
        """The touches to choose from; the information of those made is part of the prior."""
        candidates = prepare_candidates(self.robot, self._candidates[0], self._tip, mean=True)
        candidates = candidates._replace(prior=candidates.prior + self._information_made)
        return candidates.counting(self._in_doubt, 0.5) if len(self._in_doubt) else candidates

    @cached_property
    def present(self) -> float:
        """The largest expanded uncertainty of the tip over the region that the touches made lead to, m."""
        return self._uncertainty(self.candidates, []).planned

    def accurate(self, number: int, start: Poses | None = None) -> PlannedTouches:
        """The touches that lower the uncertainty of the tip most, and decide about what is suspected.

        Args:
            number: of touches.
            start: where the tip stands, one pose; None: anywhere.

        Raises:
            UnsupportedDataError: no touch can be reached, or none from there.
        """
        chosen = _best(self.candidates, number)
        plan = self.candidates.plan.select(np.array(chosen))
        reasons = self._reasons(self.candidates, chosen)
        return self._arranged(plan, reasons, self._candidates[1], self._uncertainty(self.candidates, chosen), start)

    def discriminating(
        self, touches: Sequence[DiscriminatingTouch], number: int, start: Poses | None = None
    ) -> PlannedTouches:
        """The touches that decide between rivals.

        Args:
            touches: that do, as the diagnosis found them.
            number: of touches.
            start: where the tip stands, one pose; None: anywhere.

        Raises:
            UnsupportedDataError: none of them can be reached, or none from there.
        """
        names = [disc.name for disc in self.arm.cell.discs]
        plan = Plan(
            np.array([names.index(touch.disc) for touch in touches], dtype=np.intp),
            np.array([touch.angle for touch in touches]),
            np.array([touch.posture for touch in touches], dtype=np.intp),
            np.array([touch.force for touch in touches]),
            np.array([PRELOAD * touch.is_unloaded for touch in touches]),
        )
        texts = self.problems(plan) if touches else []
        left = [f'{touch}: {text}' for touch, text in zip(touches, texts, strict=True) if text]
        there = [k for k, text in enumerate(texts) if not text][:number]
        reasons = [f'predictions differ by {touches[k].difference:.1f} N, {touches[k].in_std:.1f} σ' for k in there]
        plan, candidates = plan.select(np.array(there, dtype=np.intp)), self.candidates
        if there:
            planned = prepare_candidates(self.robot, plan, self._tip, mean=True).information.sum(axis=0)
            candidates = candidates._replace(prior=candidates.prior + planned)
        if len(self._in_doubt):
            candidates = candidates.counting(self._in_doubt, 1.0)
        more = _best(candidates, number - len(there))
        # 0.9: of the variance of what is suspected, in simulated cells a dozen touches left 0.5 to 0.8
        if not there and largest_variance(candidates, more) > 0.9:
            why = left[0] if left else 'more touches hardly sharpen what is suspected'
            raise UnsupportedDataError(f'no touch that decides can be reached: {why}', 'change the cell')
        reasons += self._reasons(candidates, more, self._in_doubt)
        every = Plan.joined([plan, candidates.plan.select(np.array(more, dtype=np.intp))])
        return self._arranged(every, reasons, left, self._uncertainty(candidates, more), start)

    def _arranged(
        self, plan: Plan, reasons: list[str], left_out: list[str], found: Uncertainty, start: Poses | None
    ) -> PlannedTouches:
        """The touches in the order of a short way."""
        own = self.approach(plan)
        begin = own.select(slice(0)) if start is None else start
        stops = Poses(np.concatenate([begin.tip, own.tip]), np.concatenate([begin.posture, own.posture]))
        ways, first = self.roadmap.ways(stops), len(begin.tip)
        if first and not np.isfinite(ways.lengths[0]).all():
            x, y = begin.tip[0]
            raise UnsupportedDataError(
                f'no way leads from ({x:.3f}, {y:.3f}) m to the touches',
                f'move the tip {1e3 * self.space.clearance:.1f} mm clear of everything, within the limits',
            )
        order = shortest_order(ways.lengths, first=0 if first else None)[first:]
        at = np.array(order) - first
        texts = [reasons[k] for k in at]
        return PlannedTouches(plan.select(at), texts, own.select(at), ways, order, left_out, found)

    def _uncertainty(self, candidates: CandidateTouches, chosen: list[int]) -> Uncertainty:
        """Of the tip by the arm's own model, without what is undecided."""
        values = len(self.robot.model.names)
        kept = np.r_[: self._values, values : len(candidates.prior)]
        scales = declared_rows(self.robot)[0][kept]

        def covariance(information: Floats) -> Floats:
            return np.asarray(scales[:, None] * np.linalg.inv(information[np.ix_(kept, kept)]) * scales)

        def largest(information: Floats) -> float:
            return float(self._expanded(covariance(information)[: self._values, : self._values]).max())

        ratio = 1.0
        if known := self.now is not None and np.isfinite(self.now):
            ratio = np.sqrt(max(self.now**2 - self.undetected**2, 0.0)) / largest(self.candidates.prior)
        undetected = self.undetected if known else 0.0
        every = candidates.information_of(chosen) + MOST_TOUCHES * candidates.information.mean(axis=0)
        least = covariance(every)
        by_source = []
        if self.robot.declared is not None:
            moved = least[: self._values] @ (candidates.declared[:, kept] / scales).T
            rows = self.robot.declared.prior.by_source()
            by_source = [(source, moved[:, where] @ moved[:, where].T) for source, where in rows]
        own = least[: self._values, : self._values]
        tip = self._tip._replace(derivative=self._tip.derivative[..., : self._values])
        parts = contributions(own, by_source, tip)
        limit = max(parts, key=lambda kind: parts[kind])
        share = parts[limit] ** 2 / sum(part**2 for part in parts.values())
        planned = float(np.hypot(ratio * largest(candidates.information_of(chosen)), undetected))
        return Uncertainty(self.now, planned, ratio * float(self._expanded(own).max()), limit, share, undetected)

    def _reasons(self, candidates: CandidateTouches, chosen: list[int], among: Indices | None = None) -> list[str]:
        """What each touch of a set tells: the value, of all or of some, whose variance would grow most without it."""
        names = self.robot.model.names
        values = np.arange(len(names)) if among is None or not len(among) else among
        together = candidates.information_of(chosen)
        variance = np.diagonal(np.linalg.inv(together))[values]
        found = []
        for k in chosen:
            without = np.diagonal(np.linalg.inv(together - candidates.information[k]))[values]
            best = int(values[np.argmax(without / variance)])
            verb = 'decides' if best >= self._values or best in self._in_doubt else 'sharpens'
            preload = f', preload {100 * PRELOAD:.0f} %' if candidates.plan.preload[k] else ''
            found.append(f'{verb} {names[best].rpartition(".")[0] or names[best]}{preload}')
        return found


def _is_size(effect: Effect) -> Mask:
    """Which of an effect's values are its size, the others its form, (k,)."""
    return np.asarray(effect.amplitudes(np.ones(len(effect.parameters))) != 0)


def _best(candidates: CandidateTouches, number: int) -> list[int]:
    """The set that lowers the criterion most: one added after the other, then exchanged."""
    chosen = list[int]()
    for _ in range(min(number, len(candidates.plan))):
        values = variance_with_each(candidates, chosen)
        values[chosen] = np.inf
        chosen.append(int(np.argmin(values)))
    return improve(candidates, chosen, least_gain=0.01)
