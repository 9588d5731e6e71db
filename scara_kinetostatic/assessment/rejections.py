"""What rejected touches say: that something moved, or that too many of them are bad.

Rejected touches are scattered by chance, or concentrated in one object, recording or span of time.
Given that K of N touches are rejected, and that each is as likely as any other, k or more of the n touches of a group
are among them with the hypergeometric probability P(X ≥ k). Over the groups of one kind, and over the kinds, the
probabilities are corrected by Bonferroni's inequality.

A span of time has no given place. It begins with a rejected touch; the m touches that follow hold k - 1 or more of the
other K - 1 rejected ones, of the other N - 1 touches, with the hypergeometric probability as well (a scan statistic
that begins at an event; J. Glaz, J. Naus, S. Wallenstein, Scan Statistics, 2001). It is corrected over all pairs of a
first and a last rejected touch.

An object that moved: all touches are fitted together, with the displacement of the object in the rejected ones
estimated along. If none of them is rejected any more, and their distances are those of noise, the object stood there
when it was touched. Declared errors of its place and radius are common to all its touches: the displacement is that
from its true place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import LIMITS, Grade, Remark, quantity
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.effects.objects import ObjectPosition
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.effect_law import Shift, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.quantity import displacement
from scara_kinetostatic.model.touch import TouchSet

_FEWEST = 2
"""Rejected touches that can be concentrated."""
_MOST = 200
"""A span holds at most so many rejected touches."""


class Group(NamedTuple):
    """Touches that have something in common.

    Attributes:
        kind: ``object``, ``recording`` or ``span``.
        label: index of the object or recording; of a span 0.
        members: which touches belong to it, (n,).
        rejected: how many of them are rejected.
        p_value: probability by chance of as many, corrected for the search.
    """

    kind: str
    label: int
    members: Mask
    rejected: int
    p_value: float


def concentrations(rejected: Mask, labels: dict[str, Indices]) -> list[Group]:
    """The groups of touches with the probability that so many of them are rejected by chance, the least first.

    Args:
        rejected: which touches are rejected, in the order of time, (n,).
        labels: the kinds of groups: an index of each touch by the name of the kind, (n,) each.
    """
    if rejected.sum() < _FEWEST:
        return []
    kinds = len(labels) + 1
    found = [group for kind, label in labels.items() for group in _by_label(rejected, kind, label)]
    found += list(_spans(rejected))
    corrected = [group._replace(p_value=min(1.0, kinds * group.p_value)) for group in found]
    return sorted(corrected, key=lambda group: group.p_value)


def _by_label(rejected: Mask, kind: str, label: Indices) -> Iterator[Group]:
    """The groups of one kind; none where all touches are of one group."""
    values = np.unique(label)
    if len(values) < 2:
        return
    for value in values.tolist():
        members = label == value
        number = int((members & rejected).sum())
        p_value = hypergeometric_tail(number, len(rejected), int(members.sum()), int(rejected.sum()))
        yield Group(kind, value, members, number, min(1.0, len(values) * float(p_value)))


def _spans(rejected: Mask) -> Iterator[Group]:
    """The least probable span."""
    places = np.flatnonzero(rejected)
    first, last = np.triu_indices(len(places), 1)
    near = last - first <= _MOST
    first, last = first[near], last[near]
    width, number = places[last] - places[first], last - first
    p_values = hypergeometric_tail(number, len(rejected) - 1, width, len(places) - 1)
    best = int(np.argmin(p_values))
    members = np.zeros_like(rejected)
    members[places[first[best]] : places[last[best]] + 1] = True
    yield Group('span', 0, members, int(number[best]) + 1, min(1.0, len(first) * float(p_values[best])))


def hypergeometric_tail(least: ArrayLike, total: int, drawn: ArrayLike, marked: int) -> Floats:
    """P(X ≥ least) of the number X of marked ones among those drawn from all without replacement, or slightly more.

    Beyond the mean the terms of the sum fall faster than a geometric series with the ratio of the first two, whose sum
    is returned; where they do not fall, 1.

    Args:
        least: k.
        total: N.
        drawn: n.
        marked: K.
    """
    k, n = np.asarray(least, dtype=float), np.asarray(drawn, dtype=float)
    possible = (k <= np.minimum(n, marked)) & (k >= 0)
    kept = np.where(possible, k, 0.0)
    rest = np.maximum(total - marked - n + kept, 0.0)
    first = np.exp(_log_choose(marked, kept) + _log_choose(total - marked, n - kept) - _log_choose(total, n))
    ratio = (marked - kept) * (n - kept) / ((kept + 1) * (rest + 1))
    tail = np.where(ratio < 1, first / np.maximum(1 - ratio, 1e-300), 1.0)
    return np.asarray(np.where(k <= 0, 1.0, np.where(possible, np.minimum(tail, 1.0), 0.0)))


def _log_choose(total: ArrayLike, drawn: ArrayLike) -> Floats:
    """Logarithm of a binomial coefficient; -inf where more are drawn than there are."""
    total, drawn = np.asarray(total, dtype=float), np.asarray(drawn, dtype=float)
    with np.errstate(invalid='ignore'):
        value = special.gammaln(total + 1) - special.gammaln(drawn + 1) - special.gammaln(total - drawn + 1)
    return np.asarray(np.where((drawn < 0) | (drawn > total), -np.inf, value))


class MovedObject(NamedTuple):
    """An object that stood elsewhere for some touches.

    Attributes:
        disc: its index.
        x: displacement, m.
        y: the same.
        std: standard uncertainty of the displacement in its own direction, m.
        there: the rejected touches, which found it there, of all of the calibration, (n,).
        stated: those that found it where it is stated, and not there, (n,); others of the object agree with both.
    """

    disc: int
    x: float
    y: float
    std: float
    there: Mask
    stated: Mask


@dataclass(frozen=True)
class _Displaced(ObjectPosition):
    """The displacement of an object in some of its touches.

    Attributes:
        touches: places of these in the order of time.
    """

    touches: frozenset[int] = frozenset()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        there = self.acts_on(at)[:, None]
        return tuple(Shift(place=place * there) for place in self.places(at))

    def acts_on(self, at: TouchState) -> Mask:
        order = at.metadata.order
        return np.zeros(len(at.magnitude), dtype=bool) if order is None else np.isin(order, [*self.touches])


def find_moved_object(c: Calibration, disc: int) -> MovedObject | None:
    """The displacement of an object that explains its rejected touches; None where none does.

    Args:
        c: the calibration.
        disc: index of the object.
    """
    there = ~c.used & (c.touches.disc == disc)
    if there.sum() < LIMITS.fewest_moved:
        return None
    fit = _fit_displaced(c, disc, there)
    rejected = there[c.used | there]
    if fit is None or not fit.used[rejected].all():
        return None
    if special.chdtrc(2 * rejected.sum() - 2, np.sum(fit.standardized[rejected] ** 2)) < LIMITS.consistent:
        return None
    x, y = fit.model.effect_values[-1]
    unit = np.array([x, y]) / max(float(np.hypot(x, y)), 1e-300)
    values = slice(len(fit.model.names) - 2, len(fit.model.names))
    std = float(np.sqrt(unit @ fit.covariance[values, values] @ unit))
    return MovedObject(disc, x, y, std, there, _not_there(fit, c, disc))


def _fit_displaced(c: Calibration, disc: int, there: Mask) -> Calibration | None:
    """The fit of used and rejected touches, these with their object displaced; None where there is none."""
    effects = (*c.model.effects, _displaced(c, disc, there))
    start = ExtendedModel(c.parameters, effects, (*c.model.effect_values, (0.0, 0.0)))
    cell = replace(c.cell, noise=c.noise)
    try:
        return calibrate(c.touches.select(c.used | there), cell, effects, start=start, fixed=c.fixed)
    except ScaraKinetostaticError:
        return None


def _displaced(c: Calibration, disc: int, where: Mask) -> _Displaced:
    """The displacement of an object in some of its touches, (n,)."""
    touches = frozenset(c.touches.order[where].tolist())
    return _Displaced(f'{c.cell.discs[disc].name} displaced', disc, touches=touches)


def _not_there(fit: Calibration, c: Calibration, disc: int) -> Mask:
    """The used touches of an object that do not agree with its displaced place, (n,)."""
    own = c.touches.disc == disc
    places = np.flatnonzero(c.used & own)
    moved = np.zeros(len(c.used), dtype=bool)
    if len(places):
        model = replace(fit.model, effects=(*fit.model.effects[:-1], _displaced(c, disc, own)))
        point = project(observe(c.touches.select(places), fit.cell, fit.errors), model, fit.noise)
        moved[places] = special.chdtrc(2, point.distance) < LIMITS.consistent
    return moved


_INSPECT = 'see in the list of rejected touches why; `inspect` shows them in the recording'


def rejected(evidence: Evidence) -> Iterator[Remark]:
    """Touches that disagree: in one object, one recording or one span of time beyond chance, or simply many."""
    c = evidence.final
    bad = ~c.used
    groups = _groups(c, bad)
    moved = _moved_object(c, groups)
    if moved is not None:
        yield _about_moved_object(c, moved)
        bad = bad & ~moved.there
        groups = _groups(c, bad)
    if groups and groups[0].p_value < LIMITS.concentration:
        yield _about_group(c, groups[0], int(bad.sum()), evidence.sequence_known)
    elif bad.sum() > LIMITS.most_rejected * len(bad):
        yield Remark(
            Grade.CAUTION,
            f'{bad.sum()} of {len(bad)} touches disagree with the others and are not used: are the others right?',
            'find the reason in the list of rejected touches, and record again',
        )


def _groups(c: Calibration, bad: Mask) -> list[Group]:
    """Objects, recordings and a span of time, with the probability that so many of their touches are bad by chance."""
    order = np.argsort(c.touches.order, kind='stable')
    labels = {'object': c.touches.disc[order], 'recording': c.touches.recording[order]}
    back = np.argsort(order)
    return [group._replace(members=group.members[back]) for group in concentrations(bad[order], labels)]


def _moved_object(c: Calibration, groups: list[Group]) -> MovedObject | None:
    objects = [group for group in groups if group.kind == 'object']
    for group in objects:
        if group.p_value < LIMITS.consistent_concentration:
            moved = find_moved_object(c, group.label)
            if moved is not None:
                return moved
    return None


def _about_moved_object(c: Calibration, moved: MovedObject) -> Remark:
    name = c.cell.discs[moved.disc].name
    count = int(moved.there.sum())
    place = f'{displacement(moved.x, moved.y)} (± {quantity(moved.std, "m")})'
    return Remark(
        Grade.CAUTION,
        f'{name} {_when(c.touches, moved)}: its {count} rejected touches agree with each other if it stands {place}',
        f'fasten {name}, measure its place again, and record again',
    )


def _when(touches: TouchSet, moved: MovedObject) -> str:
    """When an object moved, as far as its touches tell."""
    in_turn = np.argsort(touches.order, kind='stable')
    stated, there = (in_turn[which[in_turn]] for which in (moved.stated, moved.there))
    if not len(stated):
        return 'is not where the cell description says'
    for earlier, later in ((stated, there), (there, stated)):
        if touches.order[earlier[-1]] < touches.order[later[0]]:
            return f'has moved {between(touches, int(earlier[-1]), int(later[0]))}'
    return f'was displaced at times from touch {touches.index[there[0]]} to touch {touches.index[there[-1]]}'


def between(touches: TouchSet, before: int, after: int) -> str:
    """The time between two touches in words; they are given by their places."""
    first, second = (int(touches.recording[k]) + 1 for k in (before, after))
    if first != second:
        return f'between recording {first} and {second}'
    return f'between touch {touches.index[before]} and {touches.index[after]}'


def _about_group(c: Calibration, group: Group, bad: int, sequence_known: bool) -> Remark:
    """A concentration that no displaced object explains; unfit where the touches end with it, or may."""
    share, chance = f'{group.rejected} of {bad} rejected touches', f'p = {group.p_value:.1g} by chance'
    if group.kind == 'object':
        name = c.cell.discs[group.label].name
        return Remark(
            Grade.CAUTION,
            f'{share} are on {name} ({chance}): it is loose, has moved, or its shape or size is not as stated',
            f'check {name}: is it fast, clean and round; measure its place and radius again',
        )
    order = c.touches.order
    ends = not bool((c.used & (order > order[group.members & ~c.used].max())).any())
    may_end = group.kind == 'recording' and not sequence_known
    numbers = c.touches.index[group.members]
    where = f'in recording {group.label + 1}' if group.kind == 'recording' else f'touch {numbers[0]} to {numbers[-1]}'
    return Remark(
        Grade.UNFIT if ends or may_end else Grade.CAUTION,
        f'{share} are {where} ({chance}): something has changed there, such as base, tool, a zero or an object'
        + _of_before(ends, may_end),
        'find out what changed, and record again without that',
    )


def _of_before(ends: bool, may_end: bool) -> str:
    if may_end:
        return "; the result may be that of before, as the recordings' order in time is not known"
    return '; the result is that of before' if ends else ''


def unusable(evidence: Evidence) -> Iterator[Remark]:
    """Touches that were found and cannot be used, for whatever reason, in all or in one recording."""
    total = len(evidence.rejected)
    if total > LIMITS.most_unusable * evidence.found:
        yield Remark(Grade.CAUTION, f'{total} of {evidence.found} touches found are not used', _INSPECT)
        return
    for recording, (number, found) in enumerate(evidence.unusable, 1):
        if number > LIMITS.most_unusable * found:
            reason = f'in recording {recording} {number} of {found} touches found are not used'
            yield Remark(Grade.CAUTION, reason, _INSPECT)
