"""A measured contour: points of the surface with their normals and uncertainties, and the outlines that they make.

**Friction** is the angle from the normal of the surface to the force, in the direction of travel. With Coulomb friction
the tip pushes the object along its travel with μ N, so that the angle is atan μ whatever the direction. A force sensor
that is turned by ρ, counter-clockwise, adds ρ where travel is clockwise about the object, -ρ else: travel in both
directions separates the two, travel in one direction does not.

**Files.** The CSV holds every point in the order of time, the drawings hold the passes joined to outlines. A DXF of
release 12 with POLYLINE entities is read by every CAD program; it has no entry for the unit, which is the millimetre
here, as in the SVG.

**Joining.** A pass belongs to an outline where its places lie on it, no farther than they are uncertain, with the same
normal. There both are averaged; where it goes on beyond an end of the outline, the outline grows, and may reach another
one. Passes that do not overlap stay apart. An outline whose end comes back to its own begin is closed there; what goes
on beyond is a second turn along it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.files.tables import csv_lines
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.parameters import MILLI
from scara_kinetostatic.model.quantities import percentage

TINY = 1e-12
"""Less than any length, time or curvature that counts: keeps a quotient finite."""
TOGETHER = 512
"""Points that are worked out together: what they need fits into the cache."""
SPACING = 0.5 * MILLI
"""Least distance of the nodes of an outline, m."""
_SAME_NORMAL = 0.8
"""Least product of the normals of points of two passes that are the same."""
_LONGEST_GAP = 3 * MILLI
"""An outline whose ends are no farther apart, m, is closed."""
_FEWEST_SAME = 3
"""So many points of two passes must be the same for them to be joined."""
NEAR, _SAME_STD = 0.3 * MILLI, 6.0
"""Points of two passes are the same where they are nearer to each other, m, or within so many standard deviations."""
EXPECTED = 0.05
"""Part of the points that may be beyond the forces of the calibration: the scatter of a force that is held."""


@dataclass(frozen=True)
class Polyline:
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


def join_passes(passes: Sequence[Stretch]) -> tuple[Polyline, ...]:
    """The outlines that passes make, the longest first."""
    parts: Parts = ()
    for number in sorted(range(len(passes)), key=lambda k: -lengths(passes[k].points)[-1]):
        parts, _ = add_pass(parts, passes[number], number)
    return tuple(sorted(outlines_of(parts), key=lambda outline: -outline.length))


def outlines_of(parts: Parts) -> tuple[Polyline, ...]:
    """The outlines, in the order in which they were begun."""
    return tuple(Polyline(*p.course[:3], bool(p.period), tuple(sorted({*p.passes}))) for p in parts)


def add_pass(parts: Parts, stretch: Stretch, number: int = 0) -> tuple[Parts, int]:
    """Joins a pass to the outline that it lies on; where there is none it is a new one.

    Args:
        parts: outlines in the making.
        stretch: the pass.
        number: of the pass.

    Returns:
        The outlines with it, and the number of the one that has it.
    """
    (x, y), (nx, ny) = np.gradient(stretch.points, axis=0).T, stretch.normals.T
    turn = x * ny - y * nx
    way = 1 if np.sum(np.sign(turn)) <= 0 else -1  # with the object on the left
    points, normals, std, noise = (column[::way] for column in stretch[:4])
    return _with_part(parts, _closed(Stretch(points, normals, std, noise, lengths(points)), (number,)))


def _with_part(parts: Parts, part: _Part) -> tuple[Parts, int]:
    """Joins an outline to those that it touches; the number of the result."""
    for place, other in enumerate(parts):
        if (merged := _merged(other, part)) is not None:
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
    merged, passes = both.select(np.argsort(both.along, kind='stable')), (*one.passes, *other.passes)
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
    begin, step, found = points[:-1], np.diff(points, axis=0), np.full(len(course.points), np.nan)
    square = np.maximum((step**2).sum(axis=1), TINY**2)
    for first in range(0, len(found) if len(begin) else 0, TOGETHER):
        rows = slice(first, first + TOGETHER)
        apart = course.points[rows, None] - begin
        share = np.einsum('ijk,jk->ij', apart, step) / square
        inside = np.clip(share, 0.0, 1.0)
        offset = apart - inside[..., None] * step
        distance = np.einsum('ijk,ijk->ij', offset, offset)
        agree = course.normals[rows] @ part.normals.T > _SAME_NORMAL
        distance[~agree[:, : len(begin)]] = np.inf
        best = distance.argmin(axis=1)
        row = np.arange(len(best))
        limit = np.maximum(NEAR, _SAME_STD * np.hypot(course.weighing[rows], part.weighing[best]))
        place = along[best] + inside[row, best] * (along[best + 1] - along[best])
        found[rows] = np.where(np.sqrt(distance[row, best]) < limit, place, np.nan)
    return found


def _closed(course: Stretch, passes: tuple[int, ...]) -> _Part:
    """The outline of a course: closed where it comes back to its begin, what is beyond joined to it; thinned."""
    end = _return(course)
    if end is None:
        return _Part(_thinned(course, 0.0), 0.0, passes)
    first, last = course.points[0], course.points[end]
    chord = course.points[min(_FEWEST_SAME, end)] - first
    gap = float((first - last) @ chord) / max(float(np.hypot(*chord)), TINY)
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
    weight = 1.0 / np.maximum(course.weighing, TINY) ** 2
    total = np.bincount(cell, weight, cells)
    used = total > 0

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(cell, weight * values, cells)[used] / total[used])

    points = np.column_stack([mean(column) for column in course.points.T])
    normals = np.column_stack([mean(column) for column in course.normals.T])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Stretch(points, normals, mean(course.std), mean(course.noise), mean(course.along))


def lengths(points: Floats) -> Floats:
    """Distance along a polyline, (n,), m."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))


class Friction(NamedTuple):
    """What the forces of a slide say of friction.

    Attributes:
        coefficient: μ; NaN where nothing is known.
        std: its standard uncertainty.
        rotation: apparent rotation of the force sensor, rad; NaN where travel is in one direction only.
        rotation_std: its standard uncertainty, rad.
    """

    coefficient: float
    std: float
    rotation: float
    rotation_std: float


def off_normal_angle(force: Floats, normal: Floats, along: Floats) -> Floats:
    """Angle from the inward normal to the force, positive towards the direction of travel, (n,), rad."""
    return np.asarray(np.arctan2((force * along).sum(axis=1), -(force * normal).sum(axis=1)))


def estimate_friction(
    force: Floats, normal: Floats, along: Floats, passes: Indices, angle_std: float, sensor_std: float
) -> Friction:
    """The coefficient of friction and, if possible, the rotation of the force sensor.

    Args:
        force: F on the object, (n, 2), N.
        normal: outward, (n, 2).
        along: direction of travel, (n, 2).
        passes: number of the pass, (n,).
        angle_std: standard deviation of the angle of the force in one pass, by its noise, rad.
        sensor_std: declared standard uncertainty of the rotation of the sensor, rad.
    """
    angle = off_normal_angle(force, normal, along)
    sense = np.sign(normal[:, 0] * along[:, 1] - normal[:, 1] * along[:, 0])
    each = [passes == number for number in np.unique(passes)]
    turns = np.array([np.median(angle[here]) for here in each])
    is_ahead = np.array([sense[here].sum() > 0 for here in each])
    ahead, back = turns[is_ahead], turns[~is_ahead]
    if len(ahead) and len(back):
        turn, rotation = (float(0.5 * (back.mean() + sign * ahead.mean())) for sign in (1, -1))
        std = rotation_std = 0.5 * angle_std * float(np.sqrt(1 / len(ahead) + 1 / len(back)))
    else:
        turn, rotation, rotation_std = float(turns.mean()), np.nan, np.nan
        std = float(np.hypot(angle_std / np.sqrt(len(turns)), sensor_std))
    return Friction(float(np.tan(turn)), std / np.cos(turn) ** 2, rotation, rotation_std)


@dataclass(frozen=True)
class Contour:
    """The surface along which a tip slid, at n instants in the order of time.

    Attributes:
        source: the recording.
        time: since the first stamp of the recording, (n,), s.
        surface: points of the surface, (n, 2), m, base frame.
        normal: outward unit vectors, (n, 2).
        std_systematic: standard uncertainty along the normal by the calibration and the tip, common to neighbouring
            points, (n,), m; NaN where the calibration does not determine it.
        std_noise: that of a point by the noise of the measurement and by its normal, (n,), m.
        force: F of the tip on the object, base frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        passes: number of the pass, (n,).
        by_model: change along the normal by each value of the model, (n, 12 + k).
        by_noise: change along the normal by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 4), m.
        friction: what the forces say of friction.
        inner_corner: whether the surface is hollow there and hardly wider than the tip, (n,): the tip touches on both
            sides, and the outline has its radius.
        tip_radius: m.
        zero: what the sensor reports without force, as it was taken for the last contact, (2,), N.
        warnings: one sentence each.
        contradiction: what in the forces cannot be, as by a wrong frame or sign of the sensor, one clause; empty else.

    Example:
        >>> import scara_kinetostatic as sk
        >>> arm = sk.diagnose('touches.csv', sk.load_cell('cell.yaml')).arm
        >>> contour = sk.trace_contour('slide.mcap', arm)
        >>> contour.surface.shape == contour.normal.shape == (len(contour), 2)
        True
        >>> bool((contour.std_normal < 2e-5).all())
        True
    """

    source: str
    time: Floats
    surface: Floats
    normal: Floats
    std_systematic: Floats
    std_noise: Floats
    force: Floats
    joints: Floats
    passes: Indices
    by_model: Floats
    by_noise: Floats
    friction: Friction
    inner_corner: Mask
    tip_radius: float
    zero: Floats
    warnings: tuple[str, ...]
    contradiction: str = ''

    def __len__(self) -> int:
        return len(self.time)

    @property
    def std_normal(self) -> Floats:
        """Standard uncertainty along the normal, (n,), m; NaN where the calibration does not determine it."""
        return np.hypot(self.std_systematic, self.std_noise)

    def stretch(self, which: Mask | Indices) -> Stretch:
        """The points that a mask or an array of positions picks, as a part of a pass."""
        return Stretch(self.surface[which], self.normal[which], self.std_normal[which], self.std_noise[which])

    @cached_property
    def outlines(self) -> tuple[Polyline, ...]:
        """The passes joined, the longest first."""
        return join_passes([self.stretch(self.passes == k) for k in range(int(self.passes.max()) + 1)])


NO_RADIUS = (
    'the cell description states no radius of the tip (tip: {radius: …}): the outline is that of the centre of the '
    'tip, not of the surface'
)


def remarks_on(contour: Contour, arm: CalibratedArm) -> tuple[str, ...]:
    """Poses beyond the calibration, uncertainties that are not known, assumptions; one sentence each."""
    size, used = np.hypot(*contour.force.T), arm.used
    beyond = (size < 0.5 * used.lowest_force) | (size > 1.1 * used.highest_force)
    other = ~np.isin(posture(arm.model.parameters, contour.joints), used.postures)
    range_of = f'{used.lowest_force:.0f} to {used.highest_force:.0f} N'
    remarks = [
        f'{percentage(max(part, 0.01))} of the points have {what}'
        for part, allowed, what in (
            (beyond.mean(), EXPECTED, f'a force beyond that of the calibration, {range_of}: the model is extrapolated'),
            (other.mean(), 0.0, 'an elbow posture without a touch of the calibration'),
            (np.isnan(contour.std_normal).mean(), 0.0, 'no stated uncertainty: the calibration does not determine it'),
        )
        if part > allowed
    ]
    step = np.hypot(*np.diff(contour.surface, axis=0).T)[np.diff(contour.passes) == 0]
    if len(step) and np.median(step) > MILLI:
        apart = (
            f'the points are {float(np.median(step)) / MILLI:.1f} mm apart: what lies between is not seen, and edges'
        )
        remarks.append(f'{apart} are cut off; slide slower or record joint states at a higher rate')
    if contour.inner_corner.any():
        corner = 'an inner corner is hardly wider than the tip: there the outline has the radius of the tip'
        remarks.append(f'{corner}, the object may be sharper')
    if assumed := Predictor(arm).assumptions:
        remarks.append(f'taken, as no recording says it: {assumed}')
    return (*remarks, *arm.reservations)


CSV, SVG, DXF = 'contour.csv', 'contour.svg', 'contour.dxf'
COLUMNS = ('time_s', 'x_m', 'y_m', 'nx', 'ny', 'std_normal_m', 'force_N')
LAYER = 'CONTOUR'
_DXF_BEGIN = (
    '999\ncontour in millimetres, base frame of the robot\n  0\nSECTION\n  2\nHEADER\n  9\n$ACADVER\n  1\nAC1009\n'
    '  0\nENDSEC\n  0\nSECTION\n  2\nENTITIES\n'
)
_BORDER, _STROKE = 0.05, 0.002
"""Blank border and width of a line, as a part of the picture."""


def csv_text(contour: Contour) -> str:
    """The points of the surface in the order of time."""
    size = np.hypot(*contour.force.T)
    points = (contour.time, *contour.surface.T, *contour.normal.T, contour.std_normal, size)
    rows = zip(COLUMNS, ('.6f', '.9f', '.9f', '.6f', '.6f', '.3e', '.4f'), points, strict=True)
    return csv_lines({name: [f'{value:{form}}' for value in values.tolist()] for name, form, values in rows})


def svg_text(outlines: Iterable[Polyline]) -> str:
    """The outlines in millimetres, y upwards; printed in their size."""
    every = [*outlines]
    points = np.concatenate([outline.points for outline in every]) / MILLI
    low, high = points.min(axis=0), points.max(axis=0)
    frame = _BORDER * float((high - low).max()) or 1.0
    width, height = high - low + 2 * frame
    left, top, paths = low[0] - frame, high[1] + frame, ''
    for outline in every:
        pairs = (f'{x - left:.4f} {top - y:.4f}' for x, y in (outline.points / MILLI).tolist())
        paths += f'<path d="M{" L".join(pairs)}{" Z" if outline.closed else ""}"/>\n'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">\n'
        f'<desc>Contour in millimetres; the upper left corner is at x = {left:.4f}, y = {top:.4f} in the base frame, '
        'y upwards.</desc>\n'
        f'<g fill="none" stroke="#000000" stroke-width="{_STROKE * max(width, height):.4f}" stroke-linejoin="round">\n'
        f'{paths}</g>\n</svg>\n'
    )


def dxf_text(outlines: Iterable[Polyline]) -> str:
    """The outlines as polylines of a DXF file, release 12, in millimetres."""
    lines = [_DXF_BEGIN]
    for outline in outlines:
        lines.append(f'  0\nPOLYLINE\n  8\n{LAYER}\n 66\n1\n 70\n{outline.closed:d}\n 10\n0.0\n 20\n0.0\n 30\n0.0\n')
        for x, y in (outline.points / MILLI).tolist():
            lines.append(f'  0\nVERTEX\n  8\n{LAYER}\n 10\n{x:.6f}\n 20\n{y:.6f}\n 30\n0.0\n')
        lines.append(f'  0\nSEQEND\n  8\n{LAYER}\n')
    return ''.join([*lines, '  0\nENDSEC\n  0\nEOF\n'])
