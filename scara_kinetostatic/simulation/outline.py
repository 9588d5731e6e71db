"""The outline of an object: straight edges, arcs of circles and of ellipses, one after the other.

The object is on the left of the direction of travel along its outline, the tip slides on the right of it: a closed
outline is counter-clockwise. With n the outward normal and r the radius of the tip, the centre of the tip is at
S = P + r n. At a sharp corner P stays while n turns, so that S moves on an arc around the corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats

SAMPLES = 4000
"""Places along a piece at which lengths and distances are worked out."""


class Edge(NamedTuple):
    """A straight edge.

    Attributes:
        begin: (x, y), m.
        end: (x, y), m.
    """

    begin: tuple[float, float]
    end: tuple[float, float]

    def at(self, part: Floats) -> tuple[Floats, Floats]:
        """Places at parts 0 to 1 of it, (k,), and outward unit vectors there: (k, 2) each, m."""
        begin, along = np.array(self.begin), np.subtract(self.end, self.begin)
        normal = np.array([along[1], -along[0]]) / np.hypot(*along)
        return begin + part[:, None] * along, np.broadcast_to(normal, (len(part), 2))


class Arc(NamedTuple):
    """An arc of a circle or of an ellipse.

    Attributes:
        center: (x, y), m.
        semi_axes: of the ellipse, m; equal ones of a circle may be zero (a sharp corner) or negative (hollow).
        rotation: of the first semi-axis from x, rad.
        begin: angle of the parametric form where it begins, rad.
        end: where it ends, rad; less than `begin` for a hollow arc.
    """

    center: tuple[float, float]
    semi_axes: tuple[float, float]
    rotation: float
    begin: float
    end: float

    def at(self, part: Floats) -> tuple[Floats, Floats]:
        """Places at parts 0 to 1 of it, (k,), and outward unit vectors there: (k, 2) each, m."""
        angle = self.begin + part * (self.end - self.begin)
        c, s, (a, b) = np.cos(angle), np.sin(angle), self.semi_axes
        normal = np.column_stack([c, s] if a == b else [b * c, a * s])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        along = np.cos(self.rotation), np.sin(self.rotation)
        turn = np.array([along, (-along[1], along[0])])
        return np.column_stack([a * c, b * s]) @ turn + self.center, normal @ turn


@dataclass(frozen=True)
class Outline:
    """The outline of an object.

    Attributes:
        pieces: one after the other.
        closed: whether the last one ends where the first one begins.
    """

    pieces: tuple[Edge | Arc, ...]
    closed: bool

    def at(self, place: Floats) -> tuple[Floats, Floats]:
        """The surface, (k, 2), m, and its outward unit vectors, (k, 2), at places (k,): number and part of the piece.

        Those of a closed outline repeat.
        """
        count = len(self.pieces)
        place = np.mod(place, count) if self.closed else np.clip(place, 0.0, count)
        number = np.minimum(place.astype(np.intp), count - 1)
        point, normal = np.empty((len(place), 2)), np.empty((len(place), 2))
        for k, piece in enumerate(self.pieces):
            here = number == k
            point[here], normal[here] = piece.at(place[here] - k)
        return point, normal


class Track(NamedTuple):
    """The path of the tip's centre along an outline.

    Attributes:
        places: on the outline, (k,); see `Outline.at`.
        travelled: length of the path up to each, (k,), m.
    """

    places: Floats
    travelled: Floats

    @classmethod
    def along(cls, outline: Outline, tip_radius: float) -> Track:
        """The path on the right of an outline.

        Raises:
            ParameterError: a hollow arc is narrower than the tip.
        """
        for piece in outline.pieces:
            if isinstance(piece, Arc) and piece.end < piece.begin and -piece.semi_axes[0] < tip_radius:
                problem = f'a hollow corner of radius {abs(piece.semi_axes[0]):g} m is narrower than the tip'
                raise ParameterError('outline', problem, f'give it the radius {tip_radius:g} m or more')
        places = np.arange(len(outline.pieces) * SAMPLES + 1) / SAMPLES
        point, normal = outline.at(places * (1 - 1e-15))
        steps = np.diff(point + tip_radius * normal, axis=0)
        return cls(places, np.append(0.0, np.cumsum(np.hypot(*steps.T))))

    @property
    def length(self) -> float:
        """Of the whole path, m."""
        return float(self.travelled[-1])

    def place(self, travelled: Floats) -> Floats:
        """The places after lengths of the path, (k,), m; a closed outline goes on behind its end."""
        # the end belongs to its turn: that of an open one is not its begin
        turns = np.ceil(travelled / self.length) - 1
        within = np.interp(travelled - turns * self.length, self.travelled, self.places)
        return np.asarray(turns * self.places[-1] + within)


def circle(center: tuple[float, float], radius: float) -> Outline:
    """The outline of a disc."""
    return ellipse(center, (radius, radius))


def ellipse(center: tuple[float, float], semi_axes: tuple[float, float], rotation: float = 0.0) -> Outline:
    """The outline of an ellipse, its first semi-axis turned by an angle in rad."""
    if not min(semi_axes) > 0:
        raise ParameterError('outline', f'expected a radius above 0 m, got {min(semi_axes):g}')
    return Outline((Arc(center, semi_axes, rotation, 0.0, 2 * np.pi),), closed=True)


def polygon(corners: ArrayLike, corner_radius: float = 0.0, closed: bool = True) -> Outline:
    """The outline of straight edges, its corners rounded.

    Args:
        corners: (k, 2), m, the object on the left.
        corner_radius: 0 for sharp corners, m.
        closed: whether an edge leads from the last corner to the first.

    Raises:
        ParameterError: too few corners, two at one place, or an edge too short for the roundings of its corners.
    """
    points = np.asarray(corners, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < (3 if closed else 2):
        raise ParameterError('outline', f'expected {3 if closed else 2} or more corners [x, y], got {len(points)}')
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    begins = points if closed else points[:-1]
    lengths = np.hypot(*(ends - begins).T)
    if not lengths.all():
        raise ParameterError('outline', 'two corners after each other are at the same place')
    along = (ends - begins) / lengths[:, None]
    after = np.roll(along, -1, axis=0)
    turns = np.arctan2(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0], (along * after).sum(axis=1))
    if not closed:
        turns[-1] = 0.0
    elif turns.sum() < 0:
        raise ParameterError('outline', 'the corners are clockwise', 'list them counter-clockwise')
    cut = corner_radius * np.tan(np.abs(turns) / 2)
    if np.any(cut + np.roll(cut, 1) > lengths):
        raise ParameterError('outline', f'an edge is too short for corners of radius {corner_radius:g} m')
    pieces: list[Edge | Arc] = []
    for begin, end, direction, turn, first, last in zip(begins, ends, along, turns, np.roll(cut, 1), cut, strict=True):
        foot = end - last * direction
        pieces.append(Edge(_pair(begin + first * direction), _pair(foot)))
        if turn:
            radius = np.sign(turn) * corner_radius
            angle = np.arctan2(-direction[0], direction[1])
            center = foot - radius * np.array([np.cos(angle), np.sin(angle)])
            pieces.append(Arc(_pair(center), (radius, radius), 0.0, angle, angle + turn))
    return Outline(tuple(pieces), closed)


def _pair(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])
