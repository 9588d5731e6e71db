"""What rejected touches say: that something moved, or that too many of them are bad.

Rejected touches are scattered by chance, or concentrated in one object, recording or span of time.
Given that K of N touches are rejected, and that each is as likely as any other, k or more of the n touches of a group
are among them with the hypergeometric probability P(X ≥ k). Over the groups of one kind, and over the kinds, the
probabilities are corrected by Bonferroni's inequality.

A span of time has no given place. It begins with a rejected touch; the m touches that follow hold k - 1 or more of the
other K - 1 rejected ones, of the other N - 1 touches, with the hypergeometric probability as well (a scan statistic
that begins at an event; J. Glaz, J. Naus, S. Wallenstein, Scan Statistics, 2001). It is corrected over all pairs of a
first and a last rejected touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Limits, Remark
from scara_kinetostatic.model.arrays import Floats, Indices, Mask


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
    if rejected.sum() < 2:
        return []
    found = [_span(rejected)]
    for kind, label in labels.items():
        values = np.unique(label)
        for value in values.tolist() if len(values) > 1 else ():
            members = label == value
            number = int((members & rejected).sum())
            p_value = hypergeometric_tail(number, len(rejected), int(members.sum()), int(rejected.sum()))
            found.append(Group(kind, value, members, number, len(values) * float(p_value)))
    kinds = len(labels) + 1
    corrected = [group._replace(p_value=min(1.0, kinds * min(1.0, group.p_value))) for group in found]
    return sorted(corrected, key=lambda group: group.p_value)


def _span(rejected: Mask, most: int = 200) -> Group:
    """The least probable span; it holds at most so many rejected touches."""
    places = np.flatnonzero(rejected)
    first, last = np.triu_indices(len(places), 1)
    near = last - first <= most
    first, last = first[near], last[near]
    width, number = places[last] - places[first], last - first
    p_values = hypergeometric_tail(number, len(rejected) - 1, width, len(places) - 1)
    best = int(np.argmin(p_values))
    members = np.zeros_like(rejected)
    members[places[first[best]] : places[last[best]] + 1] = True
    return Group('span', 0, members, int(number[best]) + 1, len(first) * float(p_values[best]))


def hypergeometric_tail(least: ArrayLike, total: int, drawn: ArrayLike, marked: int) -> Floats:
    """P(X ≥ least) of the number X of marked ones among those drawn from all without replacement, or slightly more.

    Beyond the mean the terms of the sum fall faster than a geometric series with the ratio of the first two, whose sum
    is returned; where they do not fall, 1.

    Args:
        least: k, at most n and K.
        total: N.
        drawn: n.
        marked: K.
    """
    k, n = np.asarray(least, dtype=float), np.asarray(drawn, dtype=float)
    rest = np.maximum(total - marked - n + k, 0.0)
    first = np.exp(_log_choose(marked, k) + _log_choose(total - marked, n - k) - _log_choose(total, n))
    ratio = (marked - k) * (n - k) / ((k + 1) * (rest + 1))
    tail = np.where(ratio < 1, first / np.maximum(1 - ratio, 1e-300), 1.0)
    return np.asarray(np.where(k <= 0, 1.0, np.minimum(tail, 1.0)))


def _log_choose(total: ArrayLike, drawn: ArrayLike) -> Floats:
    """Logarithm of a binomial coefficient."""
    total, drawn = np.asarray(total, dtype=float), np.asarray(drawn, dtype=float)
    return np.asarray(special.gammaln(total + 1) - special.gammaln(drawn + 1) - special.gammaln(total - drawn + 1))


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
        yield Remark(Grade.CAUTION, f'{reason}; so many are rarely single mistakes', action)


def _about_group(evidence: Evidence, group: Group) -> Remark:
    """A concentration of rejected touches; unfit where the touches end with it, or may."""
    c = evidence.final
    share, chance = f'{group.rejected} of {(~c.used).sum()} rejected touches', f'p = {group.p_value:.1g} by chance'
    if group.kind == 'object':
        name = c.cell.discs[group.label].name
        reason = f'{share} are on {name} ({chance}): it is loose, has moved, or its shape or size is not as stated'
        action = f'check that {name} is fixed, clean and round, and measure its place and radius again'
        return Remark(Grade.CAUTION, reason, action)
    order, numbers = c.touches.order, c.touches.index[group.members]
    ends = not bool((c.used & (order > order[group.members & ~c.used].max())).any())
    may_end = group.kind == 'recording' and not evidence.sequence_known
    where = f'in recording {group.label + 1}' if group.kind == 'recording' else f'touch {numbers[0]} to {numbers[-1]}'
    reason = f'{share} are {where} ({chance}): something has changed there, such as base, tool, a zero or an object'
    action = 'find out what changed, and record again without that'
    if ends or may_end:
        return Remark(Grade.UNFIT, f'{reason}; the result {"is" if ends else "may be"} that of before', action)
    return Remark(Grade.CAUTION, reason, action)


def unusable(evidence: Evidence) -> Iterator[Remark]:
    """Touches that were found and cannot be used, for whatever reason, in all or in one recording; an unmet object."""
    c, rejected = evidence.final, evidence.rejected
    astray = sum(item.kind == 'no object' for item in rejected)
    missed = [disc.name for k, disc in enumerate(c.cell.discs) if not (c.touches.disc == k).any()]
    if missed and astray > Limits.most_rejected * evidence.found:
        names = ', '.join(missed)
        action = f'measure place and size of {names} again'
        yield Remark(Grade.CAUTION, f'{astray} of {evidence.found} touches meet no object, and none {names}', action)
        return
    edges = [*evidence.first_touches, max(evidence.found, evidence.first_touches[-1])]
    numbers = np.histogram(np.array([item.index for item in rejected], dtype=np.intp), edges)[0]
    parts = [('', len(rejected), evidence.found)]
    parts += [(f'in recording {k + 1} ', int(n), edges[k + 1] - edges[k]) for k, n in enumerate(numbers)]
    for where, number, found in parts:
        if number > Limits.most_unusable * found:
            action = 'see in the list of rejected touches why; `inspect` shows them in the recording'
            yield Remark(Grade.CAUTION, f'{where}{number} of {found} touches found are not used', action)
            return
