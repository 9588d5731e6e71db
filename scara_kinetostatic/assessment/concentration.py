"""Whether rejected touches are scattered by chance, or concentrated in one object, recording or span of time.

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

from scara_kinetostatic.model.arrays import Floats, Indices, Mask

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
