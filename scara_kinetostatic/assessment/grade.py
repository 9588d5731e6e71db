"""The grade of a calibration: the criteria by which it may be used or not.

What the model lacks; whether the touches check the result; whether the parameters have values, and such as a robot can
have; where the result is an extrapolation; whether the uncertainty of the tip is small enough for the use that the cell
description states, and what dominates it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.assessment.evidence import NAMED, Decision, Evidence, Group, concentrations, likely, percent
from scara_kinetostatic.calibration.noise import reading_noise
from scara_kinetostatic.calibration.observations import (
    ASSUMED_PLACES,
    EARLIER,
    RIVALS,
    UNDETECTED,
    VALUE,
    DeclaredErrors,
)
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR, LEAST_WITHIN, tip_covariance
from scara_kinetostatic.calibration.uncertainty_budget import Item, nominal_uncertainty
from scara_kinetostatic.diagnosis.advice import contradicted, implausible_noise, large_noise, of_steps
from scara_kinetostatic.diagnosis.odds import UNNAMED
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.diagnosis.search import FOUND
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.robot import BaseTilt
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SizeMode
from scara_kinetostatic.model.kinematics import forward, forward_by_parameters
from scara_kinetostatic.model.parameters import MOMENTS, NAMES, UNITS
from scara_kinetostatic.model.quantities import displacement, percentage, quantity


class Grade(str, Enum):
    """The answer to "may I use these numbers?".

    The verdict of the diagnosis answers another question, whether the model is complete: a model error that was found
    and corrected leaves a result that is fit, and eight touches that fit perfectly do not make one.
    """

    FIT = 'fit'
    """Use it: the values hold within their standard uncertainties, and the touches have checked that."""
    CAUTION = 'caution'
    """Use it within the limits that the reasons state: elsewhere the values or their uncertainties may not hold."""
    UNFIT = 'unfit'
    """Do not use it: the tip or the force may be wrong by more than is stated, or nothing has checked them."""

    @property
    def severity(self) -> int:
        """0 of `FIT`, 1 of `CAUTION`, 2 of `UNFIT`."""
        return list(Grade).index(self)


class Remark(NamedTuple):
    """What one criterion says.

    Attributes:
        grade: the best grade that it leaves.
        reason: one clause, without a capital at its beginning unless it starts with a name.
        action: what to do, in the imperative; empty if nothing.
    """

    grade: Grade
    reason: str
    action: str = ''


caution, unfit = partial(Remark, Grade.CAUTION), partial(Remark, Grade.UNFIT)


@dataclass(frozen=True)
class Assessment:
    """The answer to "may I use these numbers?".

    Attributes:
        grade: ``fit``, ``caution`` or ``unfit``.
        reasons: why, the gravest first; what it was judged without comes last.
        actions: what to do, in the order of the reasons; empty where nothing is to be done.
    """

    grade: Grade
    reasons: tuple[str, ...]
    actions: tuple[str, ...]

    @classmethod
    def of(cls, remarks: Iterable[Remark], notes: Iterable[str] = ()) -> Assessment:
        """The assessment made of remarks, in the order of their severity, and of notes, which come last."""
        ordered = sorted(remarks, key=lambda remark: -remark.grade.severity)
        worst = max((remark.grade for remark in ordered), key=lambda grade: grade.severity, default=Grade.FIT)
        actions = dict.fromkeys(remark.action for remark in ordered if remark.action)
        return cls(worst, (*(remark.reason for remark in ordered), *notes), tuple(actions))

    @property
    def headline(self) -> str:
        """Grade and first reason, one line."""
        return f'{self.grade.value}: {self.reasons[0]}'


class Limits:
    """Every number that decides about a grade: meaning, source. What the grades mean says `Grade`.

    What they achieve is measured by `benchmark/assessment.py`: results that must not be fit, and good recordings
    that must.
    """

    leverage_caution: float = 0.9
    """Leverage of a touch above which an error of it hardly shows in its residual: caution. Source: redundancy numbers
    below 0.1 count as badly checked in adjustment theory (W. Förstner, Zeitschrift für Vermessungswesen 104 (1979)
    446).
    """
    leverage_unfit: float = 0.99
    """The same above which nothing checks the touch: unfit. Source: as before, redundancy numbers below 0.01."""
    least_freedoms: int = 10
    """Degrees of freedom below which the residuals say too little of the noise: caution. Source: GUM (JCGM 100), table
    E.1: a standard deviation from ten observations is itself uncertain by 24 %.
    """
    held_out_caution: float = 3.0
    """Force error on held-out touches, in those of the fit, above which touches do not predict each other well:
    caution. Source: least squares with 24 touches in an even plan give 1.9 at most, with 36 and more 1.6.
    """
    held_out_unfit: float = 6.0
    """The same above which the result is unfit. Source: twice the former."""
    left_out: float = 2.0
    """Error of the tip at objects left out of the fit over what is stated, above which the stated uncertainty is
    doubtful: caution. Source: convention, a factor of two.
    """
    negative: float = 4.0
    """Standard uncertainties below zero beyond which a compliance or backlash is negative: unfit. Source: of the six,
    none of which is below zero in truth, one then is in two of ten thousand calibrations at most; with estimated noise
    the quantile of Student's t of the same probability.
    """
    largest_gripper_backlash: float = 5e-4
    """Backlash of the gripper above which an error common to all radii, its exact alias, is the likelier reason:
    caution, m. Source: twice the largest that the paper measured (figure 4(d): 0.055 to 0.205 mm), and more than any
    sound gripper has.
    """
    concentration: float = 0.01
    """Probability by chance below which rejected touches are concentrated in one object, recording or span of time; of
    all such groups together (Bonferroni). Source: the accepted rate of false alarms of the diagnosis.
    """
    most_rejected: float = 0.1
    """Part of the touches rejected by the fit above which: caution. Source: up to it the standard uncertainties hold
    (`benchmark/statistics`, section outliers).
    """
    most_unusable: float = 1 / 3
    """Part of the touches found that are not used, for whatever reason, above which: caution. Source: convention."""
    fewest_verifying: int = 6
    """Touches below which agreement with a calibration says little: caution. Source: convention."""
    detectable_slip: float = 2e-4
    """Smallest slip of a joint's zero since the earlier calibration that the touches show, above which: caution, rad.
    Source: it moves the tip of a SCARA of 0.6 m by 0.1 mm, several times what a calibration leaves uncertain.
    """
    model_error_unfit: float = 2.0
    """Reduced chi-square above which an unexplained model error is larger than the noise, so that standard
    uncertainties say nothing of its bias: unfit, below caution. Source: noise alone gives 1, an error as large as it 2.
    """
    model_error_share: float = 0.5
    """The same where the noise is estimated and contains the error: part of the sum of squares of the residual that the
    most significant dependence explains.
    """
    noise_factor: float = 3.0
    """Residuals without a pattern, in stated noise, above which the noise is no statement of the cell: unfit, below
    caution. Source: such residuals enlarge the standard uncertainties, by a factor that their distribution must
    justify.
    """
    noise_overstated: float = 0.5
    """Residuals in stated noise below which standard uncertainties are too large to be of use: caution. Source: half.
    """
    better_upright: float = 0.5
    """Force error with gravity over that without, below which the arm stands upright: unfit. Source: half.
    """
    force_range: float = 1.5
    """Largest over smallest force of the touches below which other forces are an extrapolation: caution. Source: p_ee
    and g_ee need two levels; at 1.5 their columns are still nearly proportional.
    """
    extrapolation: float = 10.0
    """Largest standard uncertainty of the unloaded tip in the workspace, in the median of those at the touches, above
    which the touches cover too small a part of it: caution. Source: one order of magnitude; three discs in an even plan
    give 3.
    """


_STATE_TOLERANCE = 'state the accuracy that you need in the cell description, in m, as `tolerance: {tip: 5.0e-5}`'
_RECORD_MORE = 'record more touches, all round every disc, in both elbow postures and at three force levels'
_ESTIMATE_NOISE = 'leave the noise out of the cell description to have it estimated'
SLIP_SHOWN = 5.8
"""Standard deviations of a slip that shows in 95 of 100 cases: p = 1e-3 among 25 possible changes is at 4.1."""
GEOMETRY = 6
"""The first parameters are those of the unloaded arm."""


def assumed(evidence: Evidence) -> Iterator[Remark]:
    """Objects of whose place nothing is declared: what was assumed decides where the base is, and no touch shows it."""
    found, cell = evidence.assumed, evidence.final.cell
    if found is None:
        return
    names = cell.undeclared_places
    now, then = (quantity(size, 'm') for size in (evidence.tip_uncertainty.worst, found.if_three_times))
    reason = f'the places of {"the objects" if len(names) == len(cell.discs) else ", ".join(names)} are not declared'
    if not found.objects:
        reason += ' and count as exact: a displacement common to them shows in no touch'
    else:
        reason += f': {quantity(found.objects, "m")} are assumed'
        if math.isfinite(found.if_three_times):
            reason += f'; with three times as much the tip would be known to {then}'
            reason += f' instead of {now}' if now != then else ', as it is'
    action = 'state how well the places of the objects are known, in m, as `uncertainty: {center: 1.0e-5}` of each'
    yield caution(reason, action)


def less_known_than_nominal(evidence: Evidence) -> Iterator[Remark]:
    """A tip that is known no better than by the nominal values, and no tolerance for which that would do."""
    c, tip = evidence.final, evidence.tip_uncertainty
    if tip.at is None or evidence.conforms or tip.worst <= (nominal := nominal_uncertainty(c, tip.at)):
        return
    worst, known = quantity(tip.worst, 'm'), quantity(nominal, 'm')
    where = f'by the nominal values, as declared, to {known}'
    where = where if c.cell.uncertainty.nominal else f'and differs from that of the nominal arm by {known} at most'
    reason = f'the tip is known to {worst} only, {where}: the touches tell less than the data sheet'
    yield caution(reason, advice(evidence))


def mistaken(evidence: Evidence) -> Iterator[Remark]:
    """A mistake in the cell description or in the touches; a fit that did not converge."""
    if evidence.mistake is not None:
        yield unfit(evidence.mistake.text, evidence.mistake.action)
    if evidence.final.termination is not Termination.CONVERGED:
        yield unfit('the fit did not converge', evidence.final.termination.remedy)


def updated(evidence: Evidence) -> Iterator[Remark]:
    """Touches that contradict the calibration that was their prior, or are too few for that; its own grade."""
    earlier = evidence.earlier
    if earlier is None:
        return
    if earlier.contradiction:
        action = 'find out what changed, and free it by --free, or calibrate again from nothing'
        yield unfit(f'the touches contradict the earlier calibration: {earlier.contradiction}', action)
    hidden = {name: size for name, size in earlier.detectable.items() if size > Limits.detectable_slip}
    if hidden and not earlier.contradiction:
        sizes = [f'joint {name[-1]}{_below(size)}' for name, size in hidden.items()]
        reason = f'these touches would not show a slip since the earlier calibration of {" or ".join(sizes)}'
        yield caution(reason, 'make more touches, or touches farther apart')
    few = int(evidence.final.used.sum())
    if few < Limits.fewest_verifying and not earlier.freed:
        yield caution(f'{few} touches say little', f'make {Limits.fewest_verifying} or more, all round')
    if bad := len(evidence.final.used) - few:
        reason = f'{bad} of {few + bad} touches disagree with the others and are not used'
        yield caution(reason, 'find the reason in the list of rejected touches')
    for sentence in earlier.differing:
        yield caution(sentence, 'give the cell of the recording by --cell')
    if earlier.grade != Grade.FIT.value:
        yield caution(f'the earlier calibration was graded {earlier.grade}', 'follow the advice in its report')


def _below(size: float) -> str:
    return f' by less than {quantity(size, "rad")}' if np.isfinite(size) else ''


def negative(evidence: Evidence) -> Iterator[Remark]:
    """Compliances and backlashes below zero beyond their uncertainty."""
    radii = 'check the radii in the cell description: they reach to the centre of the tip'
    slip = 'preload every other touch: a joint that slips under load looks like a negative backlash'
    force = 'check the gain, the frame and the sign of the force sensor'
    checks = {'p_ee': force, 'p1': force, 'p2': force, 'g_ee': radii, 'g1': slip, 'g2': slip}
    c, bound = evidence.final, Limits.negative
    if c.noise_source == 'estimated':
        bound = -float(special.stdtrit(c.degrees_of_freedom, special.ndtr(-bound)))
    for name, check in checks.items():
        value, std = getattr(c.parameters, name), c.std_of(name)
        if std > 0 and value < -bound * std and not (name == 'g_ee' and evidence.mistake):
            stated = f'{name} is negative, {quantity(value, UNITS[name])} ± {quantity(std, UNITS[name])}'
            why = 'no robot is like that; something else is wrong that has the same effect'
            yield unfit(f'{stated}: {why}', check)


def forgotten_gravity(evidence: Evidence) -> Iterator[Remark]:
    """A cell without gravity whose touches fit much better with it: the arm stands upright."""
    c, d, before = evidence.final, evidence.diagnosis, evidence.calibration.force_error
    likely = d.inclusion.get(BaseTilt.name, 0.0) if d.verdict == 'ambiguous' else 1.0
    if d.verdict not in ('unexplained', 'ambiguous') or not likely or c.parameters.has_gravity or c.fixed:
        return
    for axis, found in evidence.upright.items():
        if found.force_error < Limits.better_upright * before:
            reason = f'with gravity along {axis} the force error is {found.force_error:.2g} N instead of {before:.2g} N'
            action = f'state `gravity` in the cell description, such as {list(found.parameters.gravity)}'
            action += ', and `robot.moments` where known'
            if likely < FOUND:
                yield caution(f'{reason}: the arm may stand upright ({percent(likely)} %)', f'if it does, {action}')
            else:
                yield unfit(f'{reason}: the arm stands upright', action)
            return


def upside_down(evidence: Evidence) -> Iterator[Remark]:
    """Static moments below zero: gravity points the other way, or a counterweight is heavier than the arm."""
    c, p = evidence.final, evidence.final.parameters
    names = [name for name in MOMENTS if name in p.names and getattr(p, name) < -Limits.negative * c.std_of(name)]
    if names:
        reason = f'{" and ".join(names)} negative: gravity is stated upside down, or counterweights outweigh the arm'
        action = 'check the sign of `gravity` in the cell description: its direction of fall, base frame'
        yield caution(reason, action)


def undetermined(evidence: Evidence) -> Iterator[Remark]:
    """Parameters without a value: unfit where the place of the unloaded tip depends on them."""
    c = evidence.final
    confounded = {name for group in c.identifiability.confounded for name in group}
    names = [name for name in c.parameters.names if name in confounded]
    if not names:
        return
    # 4: so many parameters without a value are more than some touches of a kind would mend
    action = _RECORD_MORE if len(names) > 4 else c.identifiability.advice
    if set(names) & set(NAMES[:GEOMETRY]):
        listed = 'any parameter' if len(names) == len(NAMES) else ', '.join(names)
        yield unfit(f'the touches do not determine {listed}, nor where the tip is', action)
        return
    size = np.hypot(*c.force[c.used].T)
    single = f'the touches do not determine {", ".join(names)} each by itself'
    at = f'the result holds at {size.min():.0f} to {size.max():.0f} N, as touched, and may not elsewhere'
    yield caution(f'{single}: {at}', action)


def checked(evidence: Evidence) -> Iterator[Remark]:
    """Touches that do not predict each other; objects that the others do not predict; touches that nothing checks; few
    degrees of freedom.
    """
    c, errors, leverages = evidence.final, evidence.comparison.extended, evidence.leverages
    ratio = errors.held_out / max(errors.force_error, c.noise.force_rms)
    if not ratio <= Limits.held_out_caution and not evidence.earlier:  # by it each was predicted
        held_out = f'touches that the fit has not seen are predicted with a force error of {errors.held_out:.2g} N'
        reason = f'{held_out}, those it has seen with {errors.force_error:.2g} N'
        yield (caution if ratio <= Limits.held_out_unfit else unfit)(reason, _RECORD_MORE)
    ratio = 0.0 if evidence.earlier else evidence.object_left_out
    if ratio > Limits.left_out:
        off = f'the tip is off by {ratio:.2g} times what is stated there'
        action = 'measure the places of the objects again, and declare how well they are known; touch more objects'
        yield caution(f'at each object, predicted without its touches, {off}', action)
    if number := int((leverages > Limits.leverage_caution).sum()):
        worst, largest = int(np.argmax(leverages)), leverages.max()
        touch = c.touches.index[np.flatnonzero(c.used)[worst]]
        reason = f'{number} of {len(leverages)} touches are not checked by the others: of an error of touch {touch} '
        reason += f'the parameters absorb {percentage(largest)}'
        action = f'touch again beside touch {touch}, and beside the others that decide alone'
        if evidence.earlier:  # what was freed is determined by as many touches as it needs, or by more
            yield caution(reason, f'make {"two" if number > 1 else "one"} more: a wrong one would go unnoticed')
            return
        yield (caution if largest <= Limits.leverage_unfit else unfit)(reason, _RECORD_MORE if number > 4 else action)
    if c.degrees_of_freedom < Limits.least_freedoms and not evidence.earlier:
        guess = c.noise_source == 'estimated'
        consequence = 'the estimated noise is a guess' if guess else 'they do not check the stated noise'
        few = f'{int(c.used.sum())} touches are few, with {c.degrees_of_freedom} degrees of freedom'
        yield caution(f'{few}: {consequence}', _RECORD_MORE)


def rejected(evidence: Evidence) -> Iterator[Remark]:
    """Touches that disagree: in one object, one recording or one span of time beyond chance, or simply many."""
    c = evidence.final
    bad, order = ~c.used, np.argsort(c.touches.order, kind='stable')
    groups = concentrations(bad[order], {'object': c.touches.disc[order], 'recording': c.touches.recording[order]})
    if groups and groups[0].p_value < Limits.concentration:
        yield _about_group(evidence, groups[0]._replace(members=groups[0].members[np.argsort(order)]))
    elif bad.sum() > Limits.most_rejected * len(bad):
        reason = f'{bad.sum()} of {len(bad)} touches disagree with the others and are not used'
        action = 'find the reason in the list of rejected touches, and record again'
        yield caution(f'{reason}; so many are rarely single mistakes', action)


def _about_group(evidence: Evidence, group: Group) -> Remark:
    """A concentration of rejected touches; unfit where the touches end with it, or may."""
    c = evidence.final
    share, chance = f'{group.rejected} of {(~c.used).sum()} rejected touches', f'p = {group.p_value:.1g} by chance'
    if group.kind == 'object':
        name = c.cell.discs[group.label].name
        reason = f'{share} are on {name} ({chance}): it is loose, has moved, or its shape or size is not as stated'
        return caution(reason, f'check that {name} is fixed, clean and round, and measure its place and radius again')
    order, numbers = c.touches.order, c.touches.index[group.members]
    ends = not bool((c.used & (order > order[group.members & ~c.used].max())).any())
    where, may_end = f'touch {numbers[0]} to {numbers[-1]}', ends
    if group.kind == 'recording':
        where, may_end = f'in recording {group.label + 1}', ends or not evidence.sequence_known
    reason = f'{share} are {where} ({chance}): something has changed there, such as base, tool, a zero or an object'
    reason += f'; the result {"is" if ends else "may be"} that of before' if may_end else ''
    return (unfit if may_end else caution)(reason, 'find out what changed, and record again without that')


def unusable(evidence: Evidence) -> Iterator[Remark]:
    """Touches that were found and cannot be used, for whatever reason, in all or in one recording; an unmet object."""
    c, rejected = evidence.final, evidence.rejected
    astray = sum(item.kind == 'no object' for item in rejected)
    missed = [disc.name for k, disc in enumerate(c.cell.discs) if not (c.touches.disc == k).any()]
    if missed and astray > Limits.most_rejected * evidence.found:
        names = ', '.join(missed)
        action = f'measure place and size of {names} again'
        yield caution(f'{astray} of {evidence.found} touches meet no object, and none {names}', action)
        return
    edges = [*evidence.first_touches, max(evidence.found, evidence.first_touches[-1])]
    numbers = np.histogram(np.array([item.index for item in rejected], dtype=np.intp), edges)[0]
    parts = [('', len(rejected), evidence.found)]
    parts += [(f'in recording {k + 1} ', int(n), edges[k + 1] - edges[k]) for k, n in enumerate(numbers)]
    for where, number, found in parts:
        if number > Limits.most_unusable * found:
            action = 'see in the list of rejected touches why; `inspect` shows them in the recording'
            yield caution(f'{where}{number} of {found} touches found are not used', action)
            return


def unexplained(evidence: Evidence) -> Iterator[Remark]:
    """A model error that no effect explains: what it does to the tip decides."""
    d, c = evidence.diagnosis, evidence.final
    for test in d.contradicted:
        action = f'correct the nominal value of {test.name}, or leave it out of uncertainty.nominal'
        yield caution(f'{contradicted(test)}: the result is without it', action)
    if d.verdict != 'unexplained' or (d.contradicted and not d.remaining and not d.found):
        return
    curves = [item.effect for item in d.found if not item.effect.is_physical]
    factor, stated = c.reduced_chi_square**0.5, c.noise_source == 'given'
    if implausible := implausible_noise(c):
        yield unfit(*implausible)
    elif d.remaining:
        tip, largest = evidence.comparison.extended.tip, d.remaining[0]
        is_small = c.reduced_chi_square <= Limits.model_error_unfit
        is_small = is_small if stated else largest.share <= Limits.model_error_share
        covered = 'contain it as undetected effects only' if c.has_undetected else 'do not cover its bias'
        reason = f'a model error is not explained; the residual is correlated with: {largest.name}; the touches are '
        reason += f'{quantity(tip.fitted, "m")} off (rms), {quantity(tip.noise, "m")} by noise; the stated '
        action = 'see `remaining_dependences` in calibration.json for what it depends on, mend it, and record again'
        yield (caution if is_small else unfit)(f'{reason}uncertainties {covered}', action)
    elif curves:
        reason = f'a model error of unknown cause is corrected by a fitted curve ({curves[0].description})'
        action = f'to identify the cause, record {curves[0].identified_by}'
        if held := ', '.join(evidence.calibration.fixed):
            action = f'estimate {held} as well: a wrong value looks like this'
        yield caution(f'{reason}: it holds where the touches are, and may not elsewhere', action)
    elif stated:
        reason = f'the residuals are {factor:.2g} times the stated noise, without a pattern; the uncertainties are '
        yield (caution if factor <= Limits.noise_factor else unfit)(f'{reason}multiplied by that', _ESTIMATE_NOISE)
    else:
        reason = 'the residuals are not distributed like noise, without a pattern: some touches are bad'
        yield caution(reason, 'record more touches')


def ambiguous(evidence: Evidence) -> Iterator[Remark]:
    """Rivals: the values hold whichever is there, the effects do not."""
    d = evidence.diagnosis
    if d.verdict == 'ambiguous':
        groups = '; '.join(rivals_in_words(d, group) for group in d.rivals)
        holds = 'parameters and uncertainties are valid whichever it is, the size of a cause only if it is the true one'
        reason = f'a model error was corrected; its cause is not determined: {groups}; {holds}'
        found = evidence.discrimination
        yield caution(reason, found.action if found else '')


def rivals_in_words(d: Diagnosis, group: Sequence[str]) -> str:
    """Rivals in one phrase with their probabilities, the first ones by name."""
    effects, most = d.effects_by_label(), 4
    titles = {label: effects[label].title if label in effects else label for label in group[:most]}
    names = [f'{title} ({percent(d.inclusion[x])} %)' if x in d.inclusion else title for x, title in titles.items()]
    return ' or '.join([*names, *([f'one of {len(group) - most} more'] if len(group) > most else [])])


def sets_in_words(d: Diagnosis) -> str:
    """The three likeliest sets of effects with their probabilities; what all sets have in common is not repeated."""
    effects, most = d.effects_by_label(), 3
    titles = {label: effect.title for label, effect in effects.items()} | {UNNAMED: 'something else'}
    common = set.intersection(*(set(item.effects) for item in d.probabilities))
    nothing, sets = 'nothing' if common else 'no gross error', list[tuple[str, float]]()
    for item in d.probabilities[:most]:
        names = [titles.get(label, label) for label in item.effects if label not in common]
        sets.append((' and '.join(names) or nothing, item.probability))
    left = 1 - sum(part for _, part in sets)
    said = likely([*sets, *[('others', left)] * (left > NAMED)])
    return f'{"What else may be missing" if common else "Probabilities"}: {said}'


def shifted(evidence: Evidence) -> Iterator[Remark]:
    """Something that shifted at a moment: corrected, but a cell in which things move."""
    for item in evidence.diagnosis.found:
        effect, values = item.effect, {value.name: value.value for value in item.values}
        if not (effect.is_stepwise and item.in_every_model):
            continue
        moment = _moment(evidence.final, values.get('moment', np.nan), effect)
        moment += '' if evidence.sequence_known else ', in the order given, as that in time is not known'
        if effect.on_object:
            what = f'{effect.target} has moved {moment}, {displacement(values["x"], values["y"])}: corrected'
            yield caution(what, f'fasten {effect.target}, measure its place again, and record again')
        else:
            what = f'{effect.title} {moment}: corrected; the result is that of after it'
            yield caution(what, f'find out why {effect.title}, and record again without that')


def _moment(c: Calibration, moment: float, effect: Effect) -> str:
    """The two touches between which a moment lies; of a disc, two of its own."""
    touches, own = c.touches, np.ones(len(c.touches), dtype=bool)
    if effect.on_object:
        own = touches.disc == [disc.name for disc in c.cell.discs].index(effect.target or '')
    before, after = own & (touches.order < moment), own & (touches.order > moment)
    if not (before.any() and after.any()):
        return 'at a moment'
    last = int(np.flatnonzero(before)[np.argmax(touches.order[before])])
    first = int(np.flatnonzero(after)[np.argmin(touches.order[after])])
    one, other = (int(touches.recording[k]) + 1 for k in (last, first))
    if one != other:
        return f'between recording {one} and {other}'
    return f'between touch {touches.index[last]} and {touches.index[first]}'


def noise(evidence: Evidence) -> Iterator[Remark]:
    """Noise that no robot has, or that the touches contradict."""
    c = evidence.final
    if large_noise(c) and evidence.diagnosis.verdict != 'unexplained':
        reason = f'the joints seem to repeat no better than {1e6 * c.noise.joint_rms:.0f} µrad: a model error may be '
        action = 'give the noise in the cell description if it is known'
        yield caution(f'{reason}counted as noise', action)
    factor = c.reduced_chi_square**0.5
    if c.noise_source == 'given' and factor < Limits.noise_overstated:
        reason = f'the residuals are {factor:.2g} times the stated noise'
        yield caution(f'{reason}: the uncertainties are stated too large by that', _ESTIMATE_NOISE)


def large_backlash(evidence: Evidence) -> Iterator[Remark]:
    """A backlash of the gripper that is rather an error of all radii."""
    value, std = evidence.final.parameters.g_ee, evidence.final.std_of('g_ee')
    if std > 0 and value - 2 * std > Limits.largest_gripper_backlash:
        size = quantity(value, 'm')
        reason = f'the backlash of the gripper, g_ee, is {size}: it has that much play, or all radii are stated {size} '
        action = 'check the radii in the cell description, and the gripper for play'
        yield caution(f'{reason}too large, which touches cannot distinguish', action)


def alike(evidence: Evidence) -> Iterator[Remark]:
    """An elbow posture that was not touched; forces that are all alike."""
    c = evidence.final
    if evidence.earlier:
        return
    touched, (left, right) = np.unique(c.touches.posture[c.used]), evidence.tip_uncertainty.alone
    if len(touched) == 1 and (left, right)[int(touched[0] < 0)] < 1:  # the limits leave the other elbow some place
        own, other, part = ('left', 'right', right) if touched[0] > 0 else ('right', 'left', left)
        of = f'the places of the {c.cell.region.title} that the arm can take'
        needed = f', and {percentage(part)} of {of} need it' if part else ''
        reason = f'all touches are with the elbow {own}: with the elbow {other} the result is an extrapolation that '
        action = f'use it with the elbow {own} only, or touch with the elbow {other}, too'
        yield caution(f'{reason}nothing has checked{needed}', action)
    size = np.hypot(*c.force[c.used].T)
    said = any({'p_ee', 'g_ee'} <= set(group) for group in c.identifiability.confounded)
    if size.max() < Limits.force_range * size.min() and not said:
        span = f'{size.min():.0f} to {size.max():.0f} N'
        reason = f'all touches are at {span}: at other forces the result is an extrapolation'
        yield caution(reason, f'touch with {size.min() / 2:.0f} N as well')


def places(evidence: Evidence) -> Iterator[Remark]:
    """Touches that cover a small part of the workspace."""
    c = evidence.final
    if any(set(group) & set(NAMES[:GEOMETRY]) for group in c.identifiability.confounded):
        return
    # all round the base, the elbow neither nearly stretched nor nearly folded
    angles = np.linspace(-np.pi, np.pi, 12, endpoint=False), np.deg2rad(np.linspace(20.0, 160.0, 8))
    first, second = (axis.ravel() for axis in np.meshgrid(*angles, indexing='ij'))
    postures = np.unique(c.touches.posture[c.used])
    joints = np.concatenate([np.stack([first, posture * second], axis=-1) for posture in postures])
    joints = joints[c.cell.region.holds(forward(c.parameters, joints)) & c.cell.can_take(joints)]
    touched, std = float(np.median(_tip_std(c, c.touches.joints[c.used]))), _tip_std(c, joints)
    worst = int(np.argmax(std)) if len(std) else -1
    if touched > 0 and worst >= 0 and std[worst] > Limits.extrapolation * touched:
        x, y = forward(c.parameters, joints[worst])
        sizes = f'{quantity(float(std[worst]), "m")} (1 σ), at the touches by {quantity(touched, "m")}'
        reason = f'the touches cover a small part of the workspace: at x {x:.2f} m, y {y:.2f} m'
        action = 'use it near the touches, or touch objects that are farther apart'
        yield caution(f'{reason} the tip is uncertain by {sizes}', action)


def _tip_std(c: Calibration, joints: Floats) -> Floats:
    """Standard uncertainty of the unloaded tip H(L̄, Q) in the direction where it is largest, (n,), m."""
    derivative = forward_by_parameters(c.parameters, joints)[..., :GEOMETRY]
    covariance = tip_covariance(derivative, c.covariance[:GEOMETRY, :GEOMETRY])
    return np.sqrt(np.clip(np.linalg.eigvalsh(covariance)[:, -1], 0.0, None))


def conformity(evidence: Evidence) -> Iterator[Remark]:
    """An expanded uncertainty of the tip beyond the tolerance, or too near to it to decide (ISO 14253-1).

    Unfit where it is beyond between the touches, or in more than half of the workspace.
    """
    cell, found, tip = evidence.final.cell, evidence.conformity, evidence.tip_uncertainty
    tolerance, region = cell.tolerance, cell.region.title
    if tolerance is None or evidence.conforms:
        return
    limit, worst = quantity(tolerance, 'm'), quantity(tip.worst, 'm')
    if found is None or tip.at is None:
        yield unfit(f'the uncertainty of the tip is not determined, the tolerance is {limit}')
        return
    reason = f'the expanded uncertainty of the tip is up to {worst} ({tip.coverage}), at {tip.at.title}'
    if tip.undetermined > 0:
        reason += f', and not determined in {percentage(tip.undetermined)} of the {region}'
    reason += f', the tolerance {limit}; it conforms in {percentage(found.share)} of the {region}'
    if found.decision is Decision.UNDECIDED:
        reason += f'; {quantity(found.low, "m")} to {quantity(found.high, "m")} is too near to decide'
    elif found.touched is Decision.CONFORMS:
        between = quantity(tip.worst_touched, 'm')
        reason += f', and wherever the joint angles are between those of the touches (up to {between})'
    beyond = found.touched is Decision.DOES_NOT_CONFORM or found.share < 0.5
    yield (unfit if beyond else caution)(reason, advice(evidence))


def stated_conformity(evidence: Evidence) -> str:
    """What may be said of the conformity with the tolerance, after 'conformity '; empty where nothing is stated."""
    found = evidence.conformity
    if found is None:
        return ''
    if found.decision is Decision.DOES_NOT_CONFORM:
        return 'excluded'
    if found.decision is Decision.UNDECIDED:
        return 'neither shown nor excluded'
    if evidence.diagnosis.verdict == 'unexplained':
        return 'cannot be stated: the cause of a model error is unknown'
    if DeclaredErrors.of(evidence.final.cell) is None and not evidence.final.has_undetected:
        return 'shown as far as noise goes: no uncertainties of discs and sensor are declared'
    if evidence.assumed:
        return 'shown for the assumed places of objects'
    return 'shown (ISO 14253-1)'


def advice(evidence: Evidence) -> str:
    """What to do about the kind of source that contributes most to the uncertainty of the tip, in the imperative."""
    kinds: dict[str, list[Item]] = {}
    for item in evidence.budget:
        kinds.setdefault(item.kind, []).append(item)
    items = max(kinds.values(), key=lambda alike: sum(item.tip**2 for item in alike))
    largest, d = max(items, key=lambda item: item.tip), evidence.diagnosis
    if largest.kind == RIVALS:
        found = evidence.discrimination if d.is_undecided else None
        return found.action if found else 'tell the possible causes apart: the choice among them dominates'
    if largest.kind == VALUE:
        label, _, name = largest.target.rpartition('.')
        return f'record {d.effects_by_label()[label].identified_by}: the choice of {name} dominates'
    if largest.label == EARLIER:
        return 'calibrate from nothing by more touches: what the earlier calibration left open dominates'
    if largest.label == ASSUMED_PLACES:
        return (
            'measure the places of the objects and declare how well they are known: what is assumed of them dominates'
        )
    elsewhere = ', elsewhere, with other forces and both elbows: effects too small to be found dominate'
    if largest.kind == UNDETECTED or largest.declared is None:
        return f'record more touches{elsewhere if largest.kind == UNDETECTED else ": noise dominates"}'
    every = largest._replace(label=f'{largest.kind}[{", ".join(item.target for item in items)}]')
    others = COVERAGE_FACTOR * math.hypot(*(item.tip for item in evidence.budget if item.kind != largest.kind))
    without = f'without that error the tip is known there to {quantity(others, "m")} (k = 2)'
    return f'determine the {every.title} more accurately: {without}'


CRITERIA = (
    *(assumed, less_known_than_nominal),
    *(updated, mistaken, negative, forgotten_gravity, upside_down, undetermined, rejected, checked),
    *(unexplained, ambiguous, shifted, noise, unusable, large_backlash, conformity, alike, places),
)
"""In the order in which equally grave reasons are given."""


def assess(evidence: Evidence) -> Assessment:
    """Whether a result may be used, why, and what to do.

    Args:
        evidence: the calibration with all that speaks for or against its use.
    """
    remarks = list[Remark]()
    for criterion in CRITERIA:
        remarks += criterion(evidence)
    if not remarks:
        of_tip = evidence.tip_uncertainty
        tip = f'the tip is known to {quantity(of_tip.worst, "m")} or better ({of_tip.coverage})'
        checks = f'{int(evidence.final.used.sum())} touches, each predicted by the others to '
        reason = f'{tip}, from {checks}{evidence.comparison.extended.held_out:.2g} N'
        remarks = [Remark(Grade.FIT, reason)]
    for item in evidence.diagnosis.found:  # what stands in the cell description is to be corrected there as well
        effect, values = item.effect, {value.name: value.value for value in item.values}
        if not item.in_every_model or not effect.is_physical or effect.is_stepwise:
            continue
        known = bool(values) and bool(np.isfinite(list(values.values())).all())
        sizes = np.abs(effect.amplitudes(np.array(list(values.values()))))
        # beyond three plausible sizes it is a mistake of the cell description
        most = 3.0 * np.array([parameter.scale for parameter in effect.parameters])
        large = known and len(sizes) == len(most) and bool((sizes > most).any())
        what = ', by more than an error of measurement: a mistake, corrected' if large else ': corrected'
        action = effect.correction(values) if known else ''
        remarks.append(Remark(Grade.CAUTION if large else Grade.FIT, f'{effect.title}{what} in this result', action))
    if evidence.final.cell.tolerance is None and not any(remark.action for remark in remarks):
        remarks[-1] = remarks[-1]._replace(action=_STATE_TOLERANCE)
    return Assessment.of(remarks, _notes(evidence))


def _notes(evidence: Evidence) -> Iterator[str]:
    """What the result was judged without."""
    c, tip = evidence.final, evidence.tip_uncertainty
    if c.fixed:
        yield f'held at given values, exact but for what the cell declares: {", ".join(c.fixed)}'
    if evidence.conforms and c.cell.tolerance is not None:
        most = f'the expanded uncertainty of the tip is at most {quantity(tip.worst, "m")} ({tip.coverage})'
        limit = f'all over the {c.cell.region.title}, the tolerance {quantity(c.cell.tolerance, "m")}'
        yield f'{most} {limit}: conformity {stated_conformity(evidence)}'
    if of_steps(c):
        coarser = float(reading_noise(c.cell, c.touches.joints).max())
        step, level = (quantity(size * coarser, 'rad') for size in (12.0**0.5, 1.0))
        yield f'the joint angles are read in steps of {step}, which is their noise: {level}; finer readings tell more'
    effects = c.cell.uncertainty.effects
    if effects.sizes is SizeMode.NONE:
        stated = ', '.join(name for name, size in effects.stated.items() if size)
        others = f' but {stated}' if stated else ''
        yield f'undetected effects{others} are left out: uncertainties are those of a robot without them'
    counted = 'as exact' if effects.sizes is SizeMode.NONE else 'with undetected errors'
    missing = [f'no uncertainties (discs, radii and sensor count {counted})'] * (DeclaredErrors.of(c.cell) is None)
    missing += ['no tolerance'] * (c.cell.tolerance is None)
    if missing:
        yield f'the cell description declares {" and ".join(missing)}'
    if tip.share < LEAST_WITHIN:
        left = f'robot.limits leave {percentage(tip.share, ".2g")} of the {c.cell.region.title} within reach'
        yield f'{left}: the uncertainty of the tip is that of these places'
