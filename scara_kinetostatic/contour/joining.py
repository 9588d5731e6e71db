"""Passes along the same surface, joined to outlines; closed ones are closed.

A pass belongs to an outline where its places lie on it, no farther than they are uncertain, with the same normal. There
both are averaged; where it goes on beyond an end of the outline, the outline grows. An outline whose end comes back
to its own begin is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, read_only

SPACING = 5e-4
"""Least distance of the nodes of an outline, m."""
_SAME_SIGMAS = 6.0
"""Two passes are of the same surface where they differ by less than this many standard deviations,"""
_SAME_DISTANCE = 3e-4
"""and this distance, m."""
_SAME_NORMAL = 0.8
"""Least product of their normals."""
_LONGEST_GAP = 3e-3
"""An outline whose ends are no farther apart, m, is closed."""
_CHUNK = 512


@dataclass(frozen=True)
class Outline:
    """An outline of the surface, in the direction of its passes.

    Attributes:
        points: nodes, (k, 2), m; the first is not repeated at the end.
        normals: outward unit vectors, (k, 2).
        std: standard uncertainty along the normal, (k,), m.
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


class _Course(NamedTuple):
    """Places along an outline with their distance along it; (n, ...) each."""

    along: Floats
    points: Floats
    normals: Floats
    std: Floats

    def sorted(self) -> _Course:
        order = np.argsort(self.along, kind='stable')
        return _Course(*(column[order] for column in self))


class _Part(NamedTuple):
    """An outline in the making.

    Attributes:
        course: its nodes.
        period: length of one turn, m; 0 where it is open.
        passes: numbers of its passes.
    """

    course: _Course
    period: float
    passes: tuple[int, ...]


def join_passes(passes: Sequence[tuple[Floats, Floats, Floats]]) -> tuple[Outline, ...]:
    """The outlines that passes make, the longest first.

    Args:
        passes: points (n, 2), m, normals (n, 2), standard uncertainties (n,), m, of each, in the order of travel.
    """
    courses = [_oriented(_Course(_lengths(points), points, normals, std)) for points, normals, std in passes]
    parts: list[_Part] = []
    for number in sorted(range(len(courses)), key=lambda k: -float(courses[k].along[-1])):
        _add(parts, courses[number], number)
    outlines = [Outline(*part.course[1:], bool(part.period), tuple(sorted(part.passes))) for part in parts]
    return tuple(sorted(outlines, key=lambda outline: -outline.length))


def _oriented(course: _Course) -> _Course:
    """The course with the object on its left: counter-clockwise about it."""
    step = np.gradient(course.points, axis=0)
    turn = step[:, 0] * course.normals[:, 1] - step[:, 1] * course.normals[:, 0]
    if np.sum(np.sign(turn)) <= 0:
        return course
    points, normals, std = course.points[::-1], course.normals[::-1], course.std[::-1]
    return _Course(_lengths(points), points, normals, std)


def _add(parts: list[_Part], course: _Course, number: int) -> None:
    """Joins a course to the part that it touches; it is a new part where there is none."""
    for place, (part, period, passes) in enumerate(parts):
        placed = _placed(part, period, course)
        if placed is not None:
            merged = _Course(*(np.concatenate(columns) for columns in zip(part, placed, strict=True))).sorted()
            parts[place] = _Part(*_closed(_thinned(merged, period), period), (*passes, number))
            return
    parts.append(_Part(*_closed(_thinned(course, 0.0), 0.0), (number,)))


def _placed(part: _Course, period: float, course: _Course) -> _Course | None:
    """The course with distances along a part; None where the two do not touch."""
    near = _nearest(part, course, period)
    same = near >= 0
    if same.sum() < 3:
        return None
    own = course.along
    first, last = np.flatnonzero(same)[[0, -1]]
    along = np.where(same, near, np.nan)
    if period:
        along[same] = np.unwrap(along[same], period=period)
    along[:first] = along[first] - (own[first] - own[:first])
    along[last + 1 :] = along[last] + (own[last + 1 :] - own[last])
    missing = np.isnan(along)
    along[missing] = np.interp(own[missing], own[~missing], along[~missing])
    return course._replace(along=along % period if period else along)


def _nearest(part: _Course, course: _Course, period: float) -> Floats:
    """Distance along a part of the place nearest to each point of a course, (n,), m; -1 where it is not the same."""
    points = np.concatenate([part.points, part.points[:1]]) if period else part.points
    along = np.append(part.along, period) if period else part.along
    base = float(along[0])
    begin, step = points[:-1], np.diff(points, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-30)
    found = np.full(len(course.points), -1.0)
    for first in range(0, len(found), _CHUNK):
        rows = slice(first, first + _CHUNK)
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
        limit = np.maximum(_SAME_DISTANCE, _SAME_SIGMAS * np.hypot(course.std[rows], part.std[best]))
        place = along[best] + inside[row, best] * (along[best + 1] - along[best]) - base
        found[rows] = np.where(least < limit, place, -1.0)
    return np.where(found >= 0, found + (0.0 if period else base), -1.0)


def _closed(course: _Course, period: float) -> tuple[_Course, float]:
    """The course closed where its end comes back to its begin; with the length of one turn, 0 where it is open."""
    if period:
        return course, period
    length = course.along[-1] - course.along[0]
    apart = np.hypot(*(course.points - course.points[0]).T)
    limit = max(_LONGEST_GAP, 2 * SPACING)
    back = (course.along - course.along[0] > 0.5 * length) & (apart < limit)
    back &= course.normals @ course.normals[0] > _SAME_NORMAL
    if length < 10 * limit or not back.any():
        return course, 0.0
    nearest = int(np.flatnonzero(back)[apart[back].argmin()])
    tangent = course.points[1] - course.points[0]
    tangent = tangent / np.hypot(*tangent)
    turn = float(course.along[nearest] - course.along[0] + (course.points[0] - course.points[nearest]) @ tangent)
    wrapped = course._replace(along=(course.along - course.along[0]) % turn).sorted()
    return _thinned(wrapped, turn), turn


def _thinned(course: _Course, period: float) -> _Course:
    """Means over cells of `SPACING` along the course, or of its own spacing where that is wider."""
    count = len(course.along)
    span = period or float(course.along[-1] - course.along[0])
    cells = max(3, int(min(span / SPACING, count)))
    width = span / cells if period else span / max(cells - 1, 1)
    origin = 0.0 if period else float(course.along[0]) - 0.5 * width
    cell = np.clip(np.floor((course.along - origin) / width).astype(np.intp), 0, cells - 1)
    weight = 1.0 / np.maximum(course.std, 1e-12) ** 2
    total = np.bincount(cell, weight, cells)
    used = total > 0

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(cell, weight * values, cells)[used] / total[used])

    points = np.column_stack([mean(column) for column in course.points.T])
    normals = np.column_stack([mean(column) for column in course.normals.T])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return _Course(mean(course.along), points, normals, mean(course.std))


def _lengths(points: Floats) -> Floats:
    """Distance along a polyline, (n,), m."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
