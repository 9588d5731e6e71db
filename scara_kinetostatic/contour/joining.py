"""Passes along the same surface, joined to outlines; closed ones are closed.

A pass belongs to an outline where its places lie on it, no farther than they are uncertain, with the same normal. There
both are averaged; where it goes on beyond an end of the outline, the outline grows, and may reach another one. Passes
that do not overlap stay apart. An outline whose end comes back to its own begin is closed there; what goes on beyond is
a second turn along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, read_only

SPACING = 5e-4
"""Least distance of the nodes of an outline, m."""
_SAME_DISTANCE = 3e-4
"""Points of two passes that are so near to each other, m, or within six standard uncertainties, are the same."""
_SAME_NORMAL = 0.8
"""Least product of their normals."""
_LONGEST_GAP = 3e-3
"""An outline whose ends are no farther apart, m, is closed."""
_FEWEST_SAME = 3
"""So many points of two passes must be the same for them to be joined."""


@dataclass(frozen=True)
class Outline:
    """An outline of the surface, in the direction of its passes.

    Attributes:
        points: nodes, (k, 2), m; the first is not repeated at the end.
        normals: outward unit vectors, (k, 2).
        std: standard uncertainty along the normal, (k,), m; NaN where it is not known.
        closed: whether the last node is followed by the first.
        passes: numbers of the passes that it is joined from.
    """

    points: Floats
    normals: Floats
    std: Floats
    closed: bool
    passes: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        for name in ('points', 'normals', 'std'):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def length(self) -> float:
        """M."""
        return float(np.hypot(*np.diff(self.ring, axis=0).T).sum())

    @property
    def ring(self) -> Floats:
        """The nodes, the first one repeated at the end where the outline is closed."""
        return np.concatenate([self.points, self.points[:1]]) if self.closed else np.asarray(self.points)


class Stretch(NamedTuple):
    """A pass, or a part of one, in the order of travel.

    Attributes:
        points: of the surface, (n, 2), m.
        normals: outward unit vectors, (n, 2).
        std: standard uncertainty along the normal, (n,), m; NaN where it is not known.
        noise: the part of it by noise, (n,), m.
        along: distance along an outline, (n,), m; nothing for a pass of which that is not known.
    """

    points: Floats
    normals: Floats
    std: Floats
    noise: Floats
    along: Floats = np.empty(0)

    def select(self, which: slice | Indices) -> Stretch:
        """The places at some positions."""
        return Stretch(*(column[which] for column in self))

    @property
    def weighing(self) -> Floats:
        """Standard uncertainties by which points are weighed; that by noise where no other is known, (n,), m."""
        return np.where(np.isnan(self.std), self.noise, self.std)


class _Part(NamedTuple):
    """An outline in the making.

    Attributes:
        course: its nodes.
        period: length of one turn, m; 0 where it is open.
        passes: numbers of its passes.
    """

    course: Stretch
    period: float
    passes: tuple[int, ...]


Parts = tuple[_Part, ...]
"""Outlines in the making, in the order in which they were begun."""


def join_passes(passes: Sequence[Stretch]) -> tuple[Outline, ...]:
    """The outlines that passes make, the longest first."""
    parts: Parts = ()
    lengths = [float(_lengths(stretch.points)[-1]) for stretch in passes]
    for number in sorted(range(len(passes)), key=lambda k: -lengths[k]):
        parts, _ = add_pass(parts, passes[number], number)
    return tuple(sorted(outlines_of(parts), key=lambda outline: -outline.length))


def outlines_of(parts: Parts) -> tuple[Outline, ...]:
    """The outlines, in the order in which they were begun."""
    return tuple(Outline(*p.course[:3], bool(p.period), tuple(sorted(p.passes))) for p in parts)


def add_pass(parts: Parts, stretch: Stretch, number: int = 0) -> tuple[Parts, int]:
    """Joins a pass to the outline that it lies on; where there is none it is a new one.

    Args:
        parts: outlines in the making.
        stretch: the pass.
        number: of the pass.

    Returns:
        The outlines with it, and the number of the one that has it.
    """
    step = np.gradient(stretch.points, axis=0)
    turn = step[:, 0] * stretch.normals[:, 1] - step[:, 1] * stretch.normals[:, 0]
    way = 1 if np.sum(np.sign(turn)) <= 0 else -1  # with the object on the left
    points, normals, std, noise = (column[::way] for column in stretch[:4])
    return _with_part(parts, _closed(Stretch(points, normals, std, noise, _lengths(points)), (number,)))


def _with_part(parts: Parts, part: _Part) -> tuple[Parts, int]:
    """Joins an outline to those that it touches; the number of the result."""
    for place, other in enumerate(parts):
        merged = _merged(other, part)
        if merged is not None:
            found, at = _with_part(parts[:place] + parts[place + 1 :], merged)
            others, place = found[:at] + found[at + 1 :], min(at, place)
            return (*others[:place], found[at], *others[place:]), place
    return (*parts, part), len(parts)


def _merged(one: _Part, other: _Part) -> _Part | None:
    """Both outlines as one; None where they do not touch."""
    by_length = sorted((one, other), key=lambda part: part.course.along[0] - part.course.along[-1])
    base, added = by_length if by_length[0].period or not by_length[1].period else by_length[::-1]
    placed = _placed(base.course, base.period, added.course)
    if placed is None:
        return None
    both = Stretch(*(np.concatenate(pair) for pair in zip(base.course, placed, strict=True)))
    merged = both.select(np.argsort(both.along, kind='stable'))
    passes = tuple(dict.fromkeys((*one.passes, *other.passes)))
    return _Part(_thinned(merged, base.period), base.period, passes) if base.period else _closed(merged, passes)


def _placed(part: Stretch, period: float, course: Stretch) -> Stretch | None:
    """The course with distances along a part; None where the two do not touch."""
    near = _nearest(part, course, period)
    same = np.flatnonzero(np.isfinite(near))
    if len(same) < _FEWEST_SAME:
        return None
    own, found = course.along, near[same]
    if period:
        found = np.unwrap(found, period=period)
    else:  # a course that leaves the part at one end may come back at the other: it goes on from the first end
        leap = np.abs(np.diff(found - own[same])) > _LONGEST_GAP
        run = np.cumsum(np.append(0, leap))
        kept = run == np.bincount(run).argmax()
        same, found = same[kept], found[kept]
    along = np.interp(own, own[same], found)
    first, last = same[0], same[-1]
    along[:first] = along[first] - (own[first] - own[:first])
    along[last + 1 :] = along[last] + (own[last + 1 :] - own[last])
    return course._replace(along=along % period if period else along)


def _nearest(part: Stretch, course: Stretch, period: float) -> Floats:
    """Distance along a part of the place nearest to each point of a course, (n,), m; NaN where it is not the same."""
    points = np.concatenate([part.points, part.points[:1]]) if period else part.points
    along = np.append(part.along, part.along[0] + period) if period else part.along
    begin, step = points[:-1], np.diff(points, axis=0)
    if not len(begin):
        return np.full(len(course.points), np.nan)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    found = np.full(len(course.points), np.nan)
    for first in range(0, len(found), 512):  # worked out together
        rows = slice(first, first + 512)
        apart = course.points[rows, None] - begin
        share = np.einsum('ijk,jk->ij', apart, step) / square
        inside = np.clip(share, 0.0, 1.0)
        offset = apart - inside[..., None] * step
        distance = np.einsum('ijk,ijk->ij', offset, offset)
        agree = course.normals[rows] @ part.normals.T > _SAME_NORMAL
        distance[~agree[:, : len(begin)]] = np.inf
        best = distance.argmin(axis=1)
        row = np.arange(len(best))
        least = np.sqrt(distance[row, best])
        limit = np.maximum(_SAME_DISTANCE, 6.0 * np.hypot(course.weighing[rows], part.weighing[best]))
        place = along[best] + inside[row, best] * (along[best + 1] - along[best])
        found[rows] = np.where(least < limit, place, np.nan)
    return found


def _closed(course: Stretch, passes: tuple[int, ...]) -> _Part:
    """The outline of a course: closed where it comes back to its begin, what is beyond joined to it; thinned."""
    end = _return(course)
    if end is None:
        return _Part(_thinned(course, 0.0), 0.0, passes)
    first, last = course.points[0], course.points[end]
    chord = course.points[min(_FEWEST_SAME, end)] - first
    gap = float((first - last) @ chord) / max(float(np.hypot(*chord)), 1e-12)
    turn = float(course.along[end] - course.along[0]) + gap
    round_once, rest = course.select(slice(end + 1)), course.select(slice(end + 1, None))
    closed = _thinned(round_once._replace(along=(round_once.along - course.along[0]) % turn), turn)
    part = _Part(closed, turn, passes)
    return (_merged(part, _Part(rest, 0.0, passes)) if len(rest.along) else None) or part


def _return(course: Stretch) -> int | None:
    """Where a course comes back to its begin for the first time, an index; None where it does not."""
    apart, alike = np.hypot(*(course.points - course.points[0]).T), course.normals @ course.normals[0]
    left = np.flatnonzero((apart > 2 * _LONGEST_GAP) | (alike < -_SAME_NORMAL))  # round a thin pin: its other side
    back = (apart < _LONGEST_GAP) & (alike > _SAME_NORMAL)
    there = np.flatnonzero(back & (np.arange(len(back)) >= left[0])) if len(left) else left
    if not len(there):
        return None
    stay = there[there - there[0] == np.arange(len(there))]
    return int(stay[apart[stay].argmin()])


def _thinned(course: Stretch, period: float) -> Stretch:
    """Means over cells of `SPACING` along the course.

    The cells are those of before where a course has grown: means are not taken again of two of them.
    """
    width = period / np.ceil(period / SPACING) if period else SPACING
    cell = np.floor(course.along / width).astype(np.intp)
    cell = np.minimum(cell, round(period / width) - 1) if period else cell - cell.min()
    cells = int(cell.max()) + 1
    weight = 1.0 / np.maximum(course.weighing, 1e-12) ** 2
    total = np.bincount(cell, weight, cells)
    used = total > 0

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(cell, weight * values, cells)[used] / total[used])

    points = np.column_stack([mean(column) for column in course.points.T])
    normals = np.column_stack([mean(column) for column in course.normals.T])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Stretch(points, normals, mean(course.std), mean(course.noise), mean(course.along))


def _lengths(points: Floats) -> Floats:
    """Distance along a polyline, (n,), m."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
