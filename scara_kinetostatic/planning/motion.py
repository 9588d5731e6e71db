"""Where the tip may go: obstacles, limits of the joints, and the shortest way from one touch to the next.

Every obstacle is a set of edges with a radius; a disc is an edge without length. A straight move of the tip keeps clear
where its distance from every edge is at least the radius and the clearance. The limits of the joints are checked along
it, in one branch of angles; the first axis, and what is out of reach, are kept clear of. What moves is the tip: links
and housing are not part of this.

**Ways** are the shortest in the visibility graph of points around every obstacle, in both elbow postures. The posture
changes through the straight arm alone, along a line from the base, where the limits of both joints allow it: there the
tip goes out to the length of the arm and back. With a lift the tip passes over everything but the base.

Source: Lozano-Pérez and Wesley, Communications of the ACM 22 (1979) 560.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components, dijkstra

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.kinematics import forward, inverse, wrap
from scara_kinetostatic.model.outline import Outline, inside
from scara_kinetostatic.model.parameters import MICRO, Parameters
from scara_kinetostatic.simulation.plan import LIMIT_MARGIN, reach

_AROUND = 10
"""Points around a disc or a corner."""
_RAYS = 24
"""Directions in which the arm may be straightened."""


class Capsules(NamedTuple):
    """Straight edges with a radius each.

    Attributes:
        begin: (m, 2), m.
        end: (m, 2), m.
        radius: within which the tip touches, (m,), m.
        owner: number of the object, (m,); -1 of an obstacle.
    """

    begin: Floats
    end: Floats
    radius: Floats
    owner: Indices = np.zeros(0, dtype=np.intp)

    def distance(self, a: Floats, b: Floats) -> Floats:
        """Distance of the tip from each edge along straight moves from a to b, (n, 2), m: (n, m); negative inside."""
        a, b, c, d = a[:, None], b[:, None], self.begin[None], self.end[None]
        ends = [_from_line(a, c, d), _from_line(b, c, d), _from_line(c, a, b), _from_line(d, a, b)]
        crosses = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
        return np.where(crosses, 0.0, np.min(ends, axis=0)) - self.radius


def _from_line(point: Floats, begin: Floats, end: Floats) -> Floats:
    """Distance of points from the lines between two others."""
    along = end - begin
    square = (along**2).sum(axis=-1)
    part = np.clip(((point - begin) * along).sum(axis=-1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    off = begin + part[..., None] * along - point
    return np.hypot(off[..., 0], off[..., 1])


def _side(a: Floats, b: Floats, point: Floats) -> Floats:
    ab, ap = b - a, point - a
    return np.asarray(ab[..., 0] * ap[..., 1] - ab[..., 1] * ap[..., 0])


class Waypoints(NamedTuple):
    """Places of the tip with the posture of the elbow.

    Attributes:
        tip: (n, 2), m.
        posture: +1 or -1, (n,).
    """

    tip: Floats
    posture: Indices

    def select(self, which: Mask | Indices | slice) -> Waypoints:
        """Those that a mask, a slice or an array of positions picks."""
        return Waypoints(self.tip[which], self.posture[which])


@dataclass(frozen=True, eq=False)
class Space:
    """Where the tip may be.

    Attributes:
        cell: with the limits of the joints and the obstacles.
        parameters: L̄ by which joint angles are worked out.
        clearance: distance that the tip keeps from every object, m.
    """

    cell: Cell
    parameters: Parameters
    clearance: float

    @cached_property
    def limits(self) -> Floats:
        """Lower and upper limits that are kept, (2, 2), rad; at most one turn about their middle.

        Raises:
            CellError: the cell states none; or it has an open outline, whose other side is not known, and no lift.
        """
        if self.cell.lift is None and not all(disc.is_closed for disc in self.cell.discs):
            remedy = 'give robot.lift, or close the outline round the body'
            raise CellError('objects', 'what is behind an open outline is not known, and travel may lead there', remedy)
        if self.cell.limits is None:
            raise CellError('robot.limits', 'the limits of the joints are missing', 'add them: nothing is planned else')
        low, high = np.array(self.cell.limits).T
        middle = (low + high) / 2
        low, high = np.maximum(low, middle - np.pi), np.minimum(high, middle + np.pi)
        return np.array([low + LIMIT_MARGIN, high - LIMIT_MARGIN])

    @cached_property
    def _outlines(self) -> list[tuple[int, Floats]]:
        """Corners of what has an inside, with the number of the object, -1 of obstacles."""
        objects = [(k, disc) for k, disc in enumerate(self.cell.discs) if isinstance(disc, Outline)]
        known = [(k, np.array(disc.corners)) for k, disc in objects if disc.is_closed]
        return [*known, *((-1, np.array(outline)) for outline in self.cell.obstacles)]

    @cached_property
    def edges(self) -> Capsules:
        """Discs, then the edges of outlines and obstacles."""
        discs, outlines, tip = [], [], self.cell.tip_radius or 0.0
        for k, disc in enumerate(self.cell.discs):
            if isinstance(disc, Disc):
                center = np.array([[disc.x, disc.y]])
                discs.append((k, center, center, disc.radius))
            elif not disc.is_closed:
                outlines.append((k, np.array(disc.corners[:-1]), np.array(disc.corners[1:]), tip))
        closed = [(k, outline, np.roll(outline, -1, axis=0), tip) for k, outline in self._outlines]
        owner, begin, end, radius = zip(*discs, *closed, *outlines, strict=True)
        number = [len(each) for each in begin]
        every = np.concatenate(begin), np.concatenate(end), np.repeat(radius, number)
        return Capsules(*every, np.repeat(owner, number).astype(np.intp))

    @cached_property
    def _base(self) -> Capsules:
        p = self.parameters
        base = np.array([[p.x0, p.y0]])
        return Capsules(base, base, np.array(reach(p)[:1]))

    @property
    def reach(self) -> float:
        """Largest distance of the tip from the base, m."""
        return reach(self.parameters)[1]

    def joints(self, poses: Waypoints) -> Floats:
        """Joint angles of the arm without a load, in the turn of the limits, (n, 2), rad."""
        return self.in_turn(inverse(self.parameters, poses.tip, poses.posture))

    def in_turn(self, joints: Floats) -> Floats:
        """The same joint angles, (…, 2), rad, in the turn about the middle of the limits."""
        middle = self.limits.mean(axis=0)
        return np.asarray(middle + wrap(joints - middle))

    def is_within(self, joints: Floats) -> Mask:
        """Whether each joint angle, (…, 2), rad, is within the limits that are kept."""
        return np.asarray((joints >= self.limits[0]) & (joints <= self.limits[1]))

    def beyond_limits(self, poses: Waypoints) -> Mask:
        """Whether each joint is beyond its limits or the place out of reach, (n, 2)."""
        return ~self.is_within(self.joints(poses))

    def is_inside(self, tip: Floats, but: Indices | None = None) -> Mask:
        """Whether places (n, 2) are within an outline, (n,), other than that of an object, (n,)."""
        found = np.zeros(len(tip), dtype=bool)
        for owner, outline in self._outlines:
            within = inside(outline, tip)
            found |= within if but is None or owner < 0 else within & (but != owner)
        return found

    def object_at(self, tip: Floats) -> str:
        """What is nearer than the clearance to a place of the tip, (2,), or contains it; empty where nothing does."""
        at, discs = tip[None], self.cell.discs
        near = np.flatnonzero(self.edges.distance(at, at)[0] < self.clearance)
        owners = [int(owner) for owner in self.edges.owner[near] if owner >= 0]
        owners += [owner for owner, outline in self._outlines if owner >= 0 and inside(outline, at)[0]]
        if owners:
            return discs[owners[0]].name
        return 'an obstacle' if len(near) or self.is_inside(at)[0] else ''

    def is_clear(
        self, a: Floats, b: Floats, *, raised: bool = False, but: Indices | None = None, leaves: bool = False
    ) -> Mask:
        """Whether the tip keeps clear of everything on straight moves from a to b, (n, 2), m.

        Args:
            a: where they begin.
            b: where they end.
            raised: whether the tip is over all objects.
            but: numbers of the discs that may be touched, (n,); None for none.
            leaves: whether it may begin nearer to an object than the clearance: there it comes no nearer.
        """
        base = self._base.begin
        clear = (self._base.distance(a, b) >= 0).all(axis=1)
        clear &= np.maximum(np.hypot(*(a - base).T), np.hypot(*(b - base).T)) <= self.reach
        if raised:
            return np.asarray(clear)
        distance = self.edges.distance(a, b)
        if but is not None:
            distance[self.edges.owner == but[:, None]] = np.inf
        kept = np.minimum(self.clearance, self.edges.distance(a, a) - 1e-9) if leaves else self.clearance
        inside_any = self.is_inside(a, but) | self.is_inside(b, but)
        return np.asarray(clear & (distance >= kept).all(axis=1) & ~inside_any)

    def keeps_limits(self, a: Waypoints, b: Floats) -> Mask:
        """Whether both joints keep their limits, in one turn, on straight moves to places b, (n,)."""
        if not len(b):
            return np.zeros(0, dtype=bool)
        count = max(3, int(np.ceil(np.hypot(*(b - a.tip).T).max() / 0.01)) + 1)  # checked every centimetre
        part = np.linspace(0.0, 1.0, count)[:, None, None]
        places = (a.tip + part * (b - a.tip)).reshape(-1, 2)
        joints = self.joints(Waypoints(places, np.tile(a.posture, count))).reshape(count, -1, 2)
        one_turn = np.abs(np.diff(joints, axis=0)) < np.pi
        return np.asarray(self.is_within(joints).all(axis=(0, 2)) & one_turn.all(axis=(0, 2)))

    def may_move(self, a: Waypoints, b: Floats) -> Mask:
        """Whether the tip may travel straight to places b, (n,), with the lift where there is one."""
        allowed = self.is_clear(a.tip, b, raised=self.cell.lift is not None, leaves=True)
        some = np.flatnonzero(allowed)
        allowed[some] = self.keeps_limits(a.select(some), b[some])
        return allowed

    def may_change(self, tip: Floats) -> Mask:
        """Whether the posture may be changed at places near the reach, both joints moving in proportion, (n,)."""
        ones = np.ones(len(tip), dtype=np.intp)
        left, right = (self.joints(Waypoints(tip, side * ones)) for side in (1, -1))
        bad = self.beyond_limits(Waypoints(tip, ones)) | self.beyond_limits(Waypoints(tip, -ones))
        straight = -self.parameters.theta2 - left[:, 1]  # to q2 = -theta2, about which both are alike
        allowed = ~bad.any(axis=1) & np.isclose(right[:, 1] - left[:, 1], 2 * straight)
        allowed &= np.abs(right - left).max(axis=1, initial=0.0) < np.pi
        if self.cell.lift is None:
            part = np.linspace(0.0, 1.0, 101)[:, None, None]
            path = forward(self.parameters, left + part * (right - left)).reshape(-1, 2)
            apart = (self.edges.distance(path, path) >= self.clearance + 5e-4).all(axis=1) & ~self.is_inside(path)
            allowed &= apart.reshape(len(part), -1).all(axis=0)
        return np.asarray(allowed)


class Roadmap:
    """The points of a space by way of which the tip travels, and the moves between them.

    Args:
        space: where the tip may be.
    """

    def __init__(self, space: Space) -> None:
        self.space = space
        base, turns = space._base.begin, 2 * np.pi / _RAYS * np.arange(_RAYS)
        rays = base + (space.reach - MICRO) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
        rays = rays[space.may_change(rays)]
        p, bends = space.parameters, space.limits[:, 1] + space.parameters.theta2
        folded = np.sqrt(p.l1**2 + p.l2**2 + 2 * p.l1 * p.l2 * np.cos(bends))  # as far as the elbow bends
        corners = [_around(base, np.maximum(radius, space._base.radius)) for radius in folded]
        if space.cell.lift is None:
            e = space.edges
            corners.append(_around(e.begin, e.radius + space.clearance))
        places = np.concatenate([rays, *corners])
        self._rays = len(rays)
        self.via = Waypoints(np.tile(places, (2, 1)), np.repeat([1, -1], len(places)))
        stands = space.is_clear(self.via.tip, self.via.tip, raised=space.cell.lift is not None)
        self._stands = stands & ~space.beyond_limits(self.via).any(axis=1)
        n = len(places)
        self._costs = np.full((2 * n, 2 * n), np.inf)
        for first in (0, n):
            here = first + np.flatnonzero(self._stands[first : first + n])
            i, j = (here[k] for k in np.triu_indices(len(here), 1))
            self._connect(self._costs, i, j, self.via)
        ray = np.arange(self._rays)
        ray = ray[self._stands[ray] & self._stands[ray + n]]
        self._costs[ray, ray + n] = self._costs[ray + n, ray] = 0.3  # what a change of posture costs, m of travel

    def _connect(self, costs: Floats, i: Indices, j: Indices, every: Waypoints) -> None:
        """Enters the length of the moves between poses i and j that may be made."""
        may = self.space.may_move(every.select(i), every.tip[j])
        i, j = i[may], j[may]
        costs[i, j] = costs[j, i] = np.hypot(*(every.tip[i] - every.tip[j]).T)

    def _with(self, stops: Waypoints, most: int = 16) -> tuple[Waypoints, Floats]:
        """The points of the map and stops, and the costs between them: each stop is connected to the nearest points."""
        v, n = len(self.via.tip), len(stops.tip)
        costs = np.full((v + n, v + n), np.inf)
        costs[:v, :v] = self._costs
        every = Waypoints(np.concatenate([self.via.tip, stops.tip]), np.concatenate([self.via.posture, stops.posture]))
        away = np.hypot(*(stops.tip[:, None] - self.via.tip[None]).transpose(2, 0, 1))
        away[(stops.posture[:, None] != self.via.posture) | ~self._stands] = np.inf
        near = np.argsort(away, axis=1)[:, :most]
        i, j = np.repeat(np.arange(n), near.shape[1]), near.ravel()
        possible = np.isfinite(away[i, j])
        self._connect(costs, v + i[possible], j[possible], every)
        return every, costs

    def largest_part(self, stops: Waypoints) -> Mask:
        """Whether a stop is among the most that can be reached from each other, (n,)."""
        _, costs = self._with(stops)
        labels = connected_components(np.isfinite(costs), directed=False)[1][len(self.via.tip) :]
        return np.asarray(labels == np.bincount(labels).argmax()) if len(labels) else np.zeros(0, dtype=bool)

    def ways(self, stops: Waypoints) -> Ways:
        """The shortest ways between n places at which the tip may be."""
        every, costs = self._with(stops)
        v, (i, j) = len(self.via.tip), np.triu_indices(len(stops.tip), 1)
        same = stops.posture[i] == stops.posture[j]
        self._connect(costs, v + i[same], v + j[same], every)
        graph = np.where(np.isfinite(costs), np.maximum(costs, MICRO), 0.0)  # what is nearer to 0 makes no edge
        lengths, before = dijkstra(graph, indices=np.arange(v, len(costs)), return_predecessors=True)
        return Ways(every, v, lengths[:, v:], before)


class Ways(NamedTuple):
    """Shortest ways between n stops.

    Attributes:
        every: the points of the map, then the stops.
        first: number of the first stop among them.
        lengths: of the ways, with what changes of posture cost, (n, n), m; infinite where there is none.
        before: the point before each on the way from each stop, (n, v + n).
    """

    every: Waypoints
    first: int
    lengths: Floats
    before: Indices

    def stop(self, number: int) -> Waypoints:
        """One of the stops."""
        return self.every.select(slice(self.first + number, self.first + number + 1))

    def way(self, start: int, goal: int) -> Waypoints:
        """The places on the way from one stop to another, which is the last of them."""
        place, found = self.first + goal, []
        while place != self.first + start:
            found.append(place)
            place = int(self.before[start, place])
        return self.every.select(np.array(found[::-1], dtype=np.intp))


def _around(places: Floats, radius: Floats) -> Floats:
    """Points around places from which the tangents keep a radius, and a little more."""
    turns = 2 * np.pi / _AROUND * (np.arange(_AROUND) + 0.5)
    out = (1.001 * radius / np.cos(np.pi / _AROUND))[:, None, None]
    return np.asarray((places[:, None] + out * np.stack([np.cos(turns), np.sin(turns)], axis=-1)).reshape(-1, 2))


def short_order(lengths: Floats) -> list[int]:
    """An order of n stops with a short way: from each to the nearest, by the best of all beginnings.

    Args:
        lengths: between the stops, (n, n).
    """
    found = []
    for start in range(len(lengths)):
        order, left = [start], set(range(len(lengths))) - {start}
        while left:
            order.append(min(left, key=lambda k: float(lengths[order[-1], k])))
            left.remove(order[-1])
        found.append(order)
    return min(found, key=lambda order: float(lengths[order[:-1], order[1:]].sum()))
