"""What rejected touches say: that something moved, or that too many of them are bad."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.concentration import Group, concentrations
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.assessment.moved_object import MovedObject, find_moved_object
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.arrays import Mask
from scara_kinetostatic.model.quantity import displacement
from scara_kinetostatic.model.touch import TouchSet

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
    if groups and groups[0].p_value < thresholds.CONCENTRATION:
        yield _about_group(c, groups[0], int(bad.sum()), evidence.sequence_known)
    elif bad.sum() > thresholds.MOST_REJECTED * len(bad):
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
        if group.p_value < thresholds.CONSISTENT_CONCENTRATION:
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
    if total > thresholds.MOST_UNUSABLE * evidence.found:
        yield Remark(Grade.CAUTION, f'{total} of {evidence.found} touches found are not used', _INSPECT)
        return
    for recording, (number, found) in enumerate(evidence.unusable, 1):
        if number > thresholds.MOST_UNUSABLE * found:
            reason = f'in recording {recording} {number} of {found} touches found are not used'
            yield Remark(Grade.CAUTION, reason, _INSPECT)
