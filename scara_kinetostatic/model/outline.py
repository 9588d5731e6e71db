"""Outlines of straight edges and arcs, and the surfaces on which the centre of the tip is in contact.

An outline is a polygon whose corners are rounded by `corner_radius`, closed and counter-clockwise, or open. The tip
touches it from the right-hand side of the direction of travel, the outside. The centre of the tip is then on the
outline grown by the tip's radius: straight segments and arcs, tangent-continuous but at inner corners into which the
tip does not reach: there the path is bent where the two grown edges meet, and the tip touches both.

**One equation for all.** The tip on a circle obeys H + (r + γ) n - S_c = 0 (11). A straight edge with outward normal N
and tangent T is a disc that may slide along T: only the part along N of the vector from its centre to the tip counts,

    N Nᵀ (H + γ n - S_c) + r n = 0,

along n: the tip lies on the edge, along t: n = -N, whatever the radius of that disc is. So a touch has a centre, a
radius and a tangent, which is zero on an arc. An inner corner is an arc of negative radius.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import TINY, Complexes, Floats, Indices, Mask, as_complex, pairs
from scara_kinetostatic.model.parameters import MICRO, MILLI, NANO

EDGE_RADIUS = 0.05
"""Radius of the disc that slides along a straight edge, m: weighs the direction of the force in the equations as the
disc of that size does; the solution does not depend on it."""
PER_ANGLE = 0.1
"""What an angle between force and normal counts beside a distance while the place is the nominal one, m/rad."""


class Outline(NamedTuple):
    """A calibration object of straight edges and rounded corners.

    Attributes:
        name: unique in the cell.
        corners: in the order of travel, the object on the left, base frame, m.
        corner_radius: of the rounded corners, m.
        is_open: whether it ends at the last corner, such as the edge of a table, instead of closing.
        center_std: standard uncertainty of each coordinate of its place, m; on the plate, where there is one.
        radius_std: of an offset of all its sides along their normals, m.
        angle_std: of its rotation about its reference point, the mean of the corners, rad.
        plate: name of the plate that carries it; empty if none.
        offset: of all its sides beyond the corners, such as that of a true object in a simulation, m.
    """

    name: str
    corners: tuple[tuple[float, float], ...]
    corner_radius: float = 0.0
    is_open: bool = False
    center_std: float = 0.0
    radius_std: float = 0.0
    angle_std: float = 0.0
    plate: str = ''
    offset: float = 0.0

    @property
    def is_closed(self) -> bool:
        """Whether it has an inside."""
        return not self.is_open

    @property
    def x(self) -> float:
        """Reference point, base frame, m."""
        return float(np.mean([corner[0] for corner in self.corners]))

    @property
    def y(self) -> float:
        """Reference point, base frame, m."""
        return float(np.mean([corner[1] for corner in self.corners]))

    @property
    def radius(self) -> float:
        """Largest distance of a corner from the reference point, m."""
        return float(np.hypot(*(np.array(self.corners) - (self.x, self.y)).T).max())

    def shape(self) -> Floats:
        """Its sides as a line, closed unless it is open, (k, 2), m."""
        line = boundary(surfaces_of([self], 0.0))
        return line if self.is_open else np.concatenate([line, line[:1]])

    def moved(self, shift: Sequence[float], angle: float = 0.0) -> Outline:
        """The same turned about its reference point by an angle, rad, then displaced, m."""
        turn, at = np.exp(1j * angle), complex(self.x, self.y)
        places = [at + turn * (complex(*corner) - at) + complex(*shift) for corner in self.corners]
        return self._replace(corners=tuple((place.real, place.imag) for place in places))


class Surfaces(NamedTuple):
    """The edges and arcs on which the centre of the tip is, E of them, object by object; a disc is one full arc.

    Attributes:
        object: number of the object in the cell, (E,).
        centers: (E, 2), m; of an edge beside its middle.
        radii: (E,), m; `EDGE_RADIUS` of an edge, negative of an inner corner.
        tangents: along an edge in the direction of travel, (E, 2); zero of an arc.
        normals: outward, in the middle, (E, 2).
        halves: half the length of an edge, m; half the angle of an arc, rad; (E,).
    """

    object: Indices
    centers: Floats
    radii: Floats
    tangents: Floats
    normals: Floats
    halves: Floats

    @property
    def is_edge(self) -> Mask:
        """Which are straight, (E,)."""
        return np.asarray(self.tangents.any(axis=1))

    def select(self, which: Mask | Indices) -> Surfaces:
        """Some of them."""
        return Surfaces(self.object[which], *(part[which] for part in self[1:]))

    def at(self, part: Floats) -> tuple[Floats, Floats]:
        """Places (E, 2), m, and outward normals, (E, 2), at parts -1 to 1 of each, (E,)."""
        along = np.where(self.is_edge, part * self.halves, 0.0)
        turn = np.exp(1j * np.where(self.is_edge, 0.0, np.sign(self.radii) * part * self.halves))
        normals = pairs(turn * as_complex(self.normals))
        return self.centers + self.radii[:, None] * normals + along[:, None] * self.tangents, normals

    def misses(self, tips: Floats, inward: Floats, per_angle: float) -> Floats:
        """How far touches are from each surface, (n, E, 2), m.

        Args:
            tips: centres of the tip, (n, 2), m.
            inward: directions of the forces, (n, 2).
            per_angle: what an angle between force and normal counts, m/rad.
        """
        out = -as_complex(inward)[:, None]
        middle, tangent, edge = as_complex(self.normals), as_complex(self.tangents), self.is_edge
        away = np.angle(out * middle.conj())
        within = np.clip(away, -self.halves, self.halves)
        normal = np.where(edge, middle, middle * np.exp(1j * within))
        off = as_complex(tips)[:, None] - as_complex(self.centers)
        along = np.clip((off * tangent.conj()).real, -self.halves, self.halves)
        miss = off - self.radii * normal - np.where(edge, along, 0.0) * tangent
        miss = miss + 1j * out * per_angle * np.where(edge, away, away - within)
        return np.stack([miss.real, miss.imag], axis=-1)

    def distances(self, tips: Floats) -> Floats:
        """Distances of places from each surface as a curve of finite length, (n, E), m, for places (n, 2), m."""
        off = as_complex(tips)[:, None] - as_complex(self.centers)
        middle, tangent, edge = as_complex(self.normals), as_complex(self.tangents), self.is_edge
        along = np.clip((off * tangent.conj()).real, -self.halves, self.halves)
        reach, half = self.radii * middle, np.exp(1j * np.where(edge, 0.0, self.halves))
        seen = off * middle.conj() * np.sign(self.radii)  # from the middle of the arc
        over = np.abs(np.abs(off) - np.abs(self.radii))
        ends = [np.abs(off - reach * end) for end in (half, half.conj())]
        within = seen.real >= np.abs(seen) * half.real
        of_arc = np.where(within, over, np.minimum(*ends))
        return np.where(edge, np.abs(off - reach - along * tangent), of_arc)

    def nearest(self, size: Floats, disc: Indices) -> Indices:
        """The surface of each touch's object, by its number (n,), with the smallest of sizes (n, E)."""
        return np.argmin(np.where(self.object == disc[:, None], size, np.inf), axis=1)

    def settled(self, tips: Floats, normals: Floats, disc: Indices) -> Indices:
        """Numbers of the touched surfaces, (n,), by tips and directions of the forces in a fit, (n, 2).

        What an angle between force and normal counts beside a distance is 1 mm/rad.
        """
        angle = np.arccos(np.clip(-normals @ self.normals.T, -1.0, 1.0))
        beside = np.maximum(angle - np.where(self.is_edge, 0.0, self.halves), 0.0)
        return self.nearest(self.distances(tips) + MILLI * beside, disc)

    def gaps(self, tips: Floats) -> Floats:
        """Distances of places (n, 2), m, from the whole line or circle of each surface, outside positive, (n, E), m."""
        off = tips[:, None] - self.centers
        away = np.where(self.radii < 0, -1.0, 1.0) * np.hypot(*off.transpose(2, 0, 1))
        return np.where(self.is_edge, (off * self.normals).sum(axis=-1), away) - self.radii

    @property
    def inner_corners(self) -> tuple[Indices, Indices]:
        """Both edges of each inner corner into which the tip does not reach, (c,) each."""
        begins, ends = (self.at(np.full(len(self.radii), part))[0] for part in (-1.0, 1.0))
        is_last = np.append(np.diff(self.object) != 0, True)
        after = np.where(is_last, np.searchsorted(self.object, self.object), np.arange(len(is_last)) + 1)
        (x, y), (u, v) = self.tangents.T, self.tangents[after].T
        meet = (x * v - y * u < -_STRAIGHT) & (np.hypot(*(ends - begins[after]).T) < NANO)
        return np.flatnonzero(meet), after[meet]

    def touch_both(self, tips: Floats, within: float) -> Mask:
        """Which places of the tip (n, 2), m, are within a distance of both edges of an inner corner, m."""
        away = self.distances(tips)
        return np.any(np.maximum(*(away[:, edges] for edges in self.inner_corners)) < within, axis=1)

    def places(self, object: Indices, angle: Floats) -> tuple[Indices, Floats]:
        """Surface and part of it, -1 to 1, of places along objects, (m,) each.

        A whole turn goes once round. The corners of an outline have a quarter of it.

        Args:
            object: numbers in the cell, (m,).
            angle: place along the object, of a disc its direction from the centre, rad, (m,).
        """
        surface, part = np.empty(len(object), dtype=np.intp), np.empty(len(object))
        for number in np.unique(object):
            own, here = np.flatnonzero(self.object == number), object == number
            edge, halves = self.is_edge[own], self.halves[own]
            length = np.where(edge, halves, 0.0)
            turn = np.where(edge, 0.0, halves)
            share = 0.25 if length.any() and turn.any() else float(turn.any())
            weight = (1 - share) * length / max(length.sum(), TINY) + share * turn / max(turn.sum(), TINY)
            ends = np.cumsum(weight)
            at = angle[here] / (2 * np.pi) % 1.0 * ends[-1]
            k = np.minimum(np.searchsorted(ends, at, side='right'), len(own) - 1)
            # touches keep 0.5 mm from the ends of an edge
            most = 1 - np.where(edge, np.minimum(5e-4 / np.maximum(halves, 1e-12), 0.2), 0.1 * (halves < np.pi))
            surface[here], part[here] = own[k], np.clip(2 * (at - ends[k]) / weight[k] + 1, -most[k], most[k])
        return surface, part

    def angles(self, object: Indices, tips: Floats, forces: Floats) -> Floats:
        """Places along objects that tips (m, 2), m, touch with forces on the object, (m, 2): see `places`; on an
        outline the nearest of many.

        Args:
            object: numbers in the cell, (m,).
            tips: centres of the tip.
            forces: their directions count.
        """
        found, turn = np.arctan2(-forces[:, 1], -forces[:, 0]), np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
        for number in np.unique(object):
            if (self.object == number).sum() > 1:
                here = object == number
                surface, part = self.places(np.full(len(turn), number), turn)
                away = tips[here][:, None] - self.select(surface).at(part)[0]
                found[here] = turn[np.argmin((away**2).sum(axis=2), axis=1)]
        return found


def surfaces_of(objects: Iterable[object], tip_radius: float | None) -> Surfaces:
    """The surfaces of discs and outlines in turn.

    Args:
        objects: `Disc`, whose radius contains that of the tip, or `Outline`.
        tip_radius: m; needed with an outline.
    """
    rows: list[tuple[int, complex, float, complex, complex, float]] = []
    for number, item in enumerate(objects):
        if isinstance(item, Outline):
            assert tip_radius is not None
            rows += [(number, *row) for row in _elements(item, tip_radius + item.offset)]
        else:
            # a whole turn begins at angle 0
            rows.append((number, complex(item.x, item.y), item.radius, 0j, -1 + 0j, np.pi))  # type: ignore[attr-defined]
    owner, center, radius, tangent, normal, half = (
        np.array(part) for part in (zip(*rows, strict=True) if rows else [()] * 6)
    )
    return Surfaces(owner.astype(np.intp), pairs(center), radius, pairs(tangent), pairs(normal), half)


@lru_cache(maxsize=64)
def known_surfaces(objects: tuple[object, ...], tip_radius: float | None) -> Surfaces:
    """`surfaces_of` of the objects of a cell, as read-only arrays."""
    found = surfaces_of(objects, tip_radius)
    for part in found:
        part.setflags(write=False)
    return found


def _elements(outline: Outline, tip_radius: float) -> list[tuple[complex, float, complex, complex, float]]:
    """Centre, radius, tangent, normal and half of each edge and rounded corner, in the order of travel."""
    point, tangent, length, turn, cut = edges_of(outline, tip_radius)
    rows: list[tuple[complex, float, complex, complex, float]] = []
    for k in range(len(tangent)):
        normal = -1j * tangent[k]
        begin, end = point[k] + cut[k] * tangent[k], point[k] + (length[k] - cut[k + 1]) * tangent[k]
        middle = (begin + end) / 2 + (tip_radius - EDGE_RADIUS) * normal
        rows.append((middle, EDGE_RADIUS, tangent[k], normal, abs(end - begin) / 2))
        angle = turn[k + 1]
        reached = angle > 0 or outline.corner_radius > tip_radius
        if abs(angle) > _STRAIGHT and reached and (k + 1 < len(tangent) or not outline.is_open):
            sense = np.sign(angle)
            center = end - sense * outline.corner_radius * normal
            rows.append(
                (center, sense * outline.corner_radius + tip_radius, 0j, normal * np.exp(0.5j * angle), abs(angle) / 2)
            )
    return rows


_STRAIGHT = NANO
"""Angle below which an outline does not turn at a corner, rad."""


def edges_of(outline: Outline, tip_radius: float = 0.0) -> tuple[Complexes, Complexes, Floats, Floats, Floats]:
    """Corners and, of each edge, unit tangent and length; where each edge begins and after the last: the angle by which
    the outline turns, and what its rounding takes of the edge, or of an inner corner the tip that does not reach in.
    """
    point = np.array([complex(*corner) for corner in outline.corners])
    edge: Complexes = (np.roll(point, -1) - point)[: len(point) - outline.is_open]
    length = np.abs(edge)
    with np.errstate(divide='ignore', invalid='ignore'):
        tangent = edge / length
    turn = np.zeros(len(edge) + 1)
    turn[1:-1] = np.angle(tangent[1:] * tangent[:-1].conj())
    if not outline.is_open:
        turn[0] = turn[-1] = np.angle(tangent[0] * tangent[-1].conj())
    radius = np.where(turn < 0, max(outline.corner_radius, tip_radius), outline.corner_radius)
    return point, tangent, length, turn, radius * np.tan(np.abs(turn) / 2)


def outline_problem(outline: Outline, tip_radius: float) -> tuple[str, str] | None:
    """Why an outline cannot be touched by a tip, and what to do; None where it can.

    Args:
        outline: any.
        tip_radius: m.
    """
    least = 2 if outline.is_open else 3
    if len(outline.corners) < least:
        return f'expected {least} corners or more, got {len(outline.corners)}', 'give each corner as [x, y]'
    point, _, length, turn, cut = edges_of(outline)
    if not (length > MICRO).all():
        return f'corner {int(np.argmin(length))} is given twice', 'give each corner once; the outline closes by itself'
    nearly = np.flatnonzero(np.abs(turn) > np.pi - MILLI)
    if len(nearly) or _crosses(point, not outline.is_open):
        return 'the outline crosses itself', 'give its corners in order, counter-clockwise'
    if not outline.is_open and (point.conj() * np.roll(point, -1)).imag.sum() < 0:
        return 'the outline runs clockwise', 'reverse the order of its corners'
    if (short := np.flatnonzero(cut[:-1] + cut[1:] >= length)).size:
        problem = f'corner_radius {outline.corner_radius:g} m is larger than edge {int(short[0])} allows'
        return problem, 'it is in m'
    cut, grown = edges_of(outline, tip_radius)[-1], surfaces_of([outline], tip_radius)
    places = np.concatenate([grown.at(np.full(len(grown.radii), part))[0] for part in np.linspace(-1, 1, 21)])
    bare = surfaces_of([outline], 0.0)
    nearest = bare.select(bare.is_edge).distances(places).min()
    if nearest < tip_radius * (1 - 1e-6) - 1e-12 or (cut[:-1] + cut[1:] >= length).any():
        return f'the tip of {tip_radius:g} m does not fit between its sides', 'give the part that it reaches, open'
    return None


def _crosses(point: Complexes, closed: bool) -> bool:
    """Whether edges that are not neighbours meet; corners as complex numbers, m."""
    end = np.roll(point, -1) if closed else point[1:]
    begin, (first, second) = point[: len(end)], np.triu_indices(len(end), 2)
    apart = (not closed) | (first > 0) | (second < len(end) - 1)
    a, b, c, d = begin[first], end[first], begin[second], end[second]
    along = [((p - a).conj() * (b - a)).real for p in (c, d)]
    beside = (np.minimum(*along) <= np.abs(b - a) ** 2) & (np.maximum(*along) >= 0)  # counts where all is on one line
    one, other = _sides(a, b, c, d)
    return bool((apart & beside & (one <= 0) & (other <= 0)).any())


def _sides(a: Complexes, b: Complexes, c: Complexes, d: Complexes) -> tuple[Floats, Floats]:
    """Below zero where c and d are on both sides of the line through a and b, and the other way round."""
    sides = [((q - p).conj() * (r - p)).imag for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))]
    return sides[0] * sides[1], sides[2] * sides[3]


def crosses(one: Floats, other: Floats) -> bool:
    """Whether two lines through places (k, 2), m, cross each other; where they merely meet, they do not."""
    (a, b), (c, d) = ((line[:-1], line[1:]) for line in (as_complex(one)[:, None], as_complex(other)))
    along, across = _sides(a, b, c, d)
    return bool(((along < 0) & (across < 0)).any())


def boundary(item: Surfaces, step: float = MILLI) -> Floats:
    """Places along the surfaces of one object, about `step` apart, (k, 2), m."""
    size = np.where(item.is_edge, item.halves, np.abs(item.radii) * item.halves)
    parts = [np.linspace(-1, 1, max(2, int(np.ceil(2 * s / step)) + 1)) for s in size]
    which = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return item.select(which).at(np.concatenate(parts))[0]


def inside(corners: Floats, places: Floats) -> Mask:
    """Whether places (n, 2) are within a closed polyline (k, 2), (n,)."""
    (x, y), (u, v) = corners.T, np.roll(corners, -1, axis=0).T
    above = places[:, 1:] < y
    crossed = above != (places[:, 1:] < v)
    with np.errstate(divide='ignore', invalid='ignore'):
        at = x + (places[:, 1:] - y) / (v - y) * (u - x)
    return np.asarray(np.sum(crossed & (places[:, :1] < at), axis=1) % 2 == 1)
