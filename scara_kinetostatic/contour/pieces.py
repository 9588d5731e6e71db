"""An outline split into straight lines and arcs of circles, each fitted on its own.

The nodes of the outline, in their order, are divided so that

    Σ over pieces (λ + Σ (e / (m u))²)

is least, with e the distance of a node from the line or the circle of its piece, u its standard uncertainty, m the
`TOLERANCE` and λ the penalty of a piece. The least sum for the first k nodes follows from those for fewer nodes
(dynamic programming, Bellman 1961); the sums of a stretch are differences of cumulative moments, about its own mean,
for a circle with the algebraic distance (‖p - c‖² - R²) / (2 R) (Kåsa 1976). The division says which points belong
together; the shapes and their uncertainties are those of `fits` through these points, without those close to the
ends of a piece, which may belong to the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.fits import FEWEST_POINTS, ShapeFit, extent, fit_points, outline_of, points_of
from scara_kinetostatic.contour.joining import Outline
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, Indices

TOLERANCE = 3.0
"""m: nodes are on a shape where they are no farther from it than this many standard uncertainties."""
LINE_PENALTY, ARC_PENALTY = 30.0, 40.0
"""λ: an arc has one value more, and every line is nearly an arc, too."""
FEWEST_NODES = 4
"""Of a piece."""
MOST_NODES = 500
"""Of an outline; where it has more, several are taken as one."""
_LARGEST_RADIUS = 10.0
"""A circle of a larger radius, m, is a line."""
_MARGIN, _MARGIN_PART = 1.5e-3, 0.2
"""Left out at both ends of a piece, m, but at most this part of its length."""
_UNKNOWN_STD, _LEAST_STD = 1e-5, 1e-6
"""Standard uncertainty of a node where none is known, and the least that is taken, m."""
_CHUNK = 512
_NORMALS = 5e-3
"""Points with opposite normals are taken to be farther apart by twice this length, m."""


class Piece(NamedTuple):
    """Some of the nodes of an outline, one after the other.

    Attributes:
        nodes: their numbers, in the order along the outline.
        is_arc: whether they are on an arc rather than on a line.
    """

    nodes: Indices
    is_arc: bool


def fit_pieces(contour: Contour, arm: CalibratedArm, outline: int = 0) -> tuple[ShapeFit, ...]:
    """The lines and arcs that make one outline.

    Args:
        contour: the measured surface.
        arm: the calibrated arm of the contour.
        outline: number of the outline, 0 for the longest.

    Returns:
        For each piece in its order along the outline, the object on the left, a fit ``line``, ``arc`` or, where the
        whole outline is one, ``circle``, with its number `piece`. Length and ends are those of the whole piece, the
        other values and the residuals those of its points away from the ends. Pieces with too few points are left out.

    Raises:
        ParameterError: there is no such outline.
    """
    made, points = outline_of(contour, outline), np.flatnonzero(points_of(contour, outline))
    pieces = divided(made)
    label = np.full(len(made.points), -1)
    for number, piece in enumerate(pieces):
        label[_core(piece, made) if len(pieces) > 1 else piece.nodes] = number
    owner = label[_nearest_nodes(contour, points, made)]
    fits = []
    for number, piece in enumerate(pieces):
        own = np.isin(np.arange(len(contour)), points[owner == number])
        if own.sum() >= FEWEST_POINTS:
            shape = ('circle' if made.closed and len(pieces) == 1 else 'arc') if piece.is_arc else 'line'
            fits.append(_of_whole(fit_points(contour, arm, own, shape, outline), made.points[piece.nodes], number))
    return tuple(fits)


def _of_whole(fit: ShapeFit, nodes: Floats, number: int) -> ShapeFit:
    """The fit with the length or the ends of the whole piece."""
    if fit.shape == 'line':
        angle = fit.value('normal_angle').value
        known = {'length': float(np.ptp(nodes @ np.array([-np.sin(angle), np.cos(angle)])))}
    elif fit.shape == 'arc':
        offset = nodes - (fit.value('center_x').value, fit.value('center_y').value)
        known = dict(zip(('begin', 'end'), extent(np.arctan2(offset[:, 1], offset[:, 0])), strict=True))
    else:
        known = {}
    values = tuple(item._replace(value=known.get(item.name, item.value)) for item in fit.values)
    return fit._replace(values=values, piece=number)


def _core(piece: Piece, outline: Outline) -> Indices:
    """The nodes of a piece without those close to its ends."""
    step = np.hypot(*np.diff(outline.points[piece.nodes], axis=0).T)
    along = np.append(0.0, np.cumsum(step))
    margin = min(_MARGIN, _MARGIN_PART * float(along[-1]))
    return piece.nodes[(along >= margin) & (along <= along[-1] - margin)]


def _nearest_nodes(contour: Contour, points: Indices, outline: Outline) -> Indices:
    """The node nearest to each point, with a like normal."""
    nodes = np.column_stack([outline.points, _NORMALS * outline.normals])
    wanted = np.column_stack([contour.surface[points], _NORMALS * contour.normal[points]])
    square, found = (nodes**2).sum(axis=1), []
    for first in range(0, len(wanted), _CHUNK):
        found.append((square - 2.0 * wanted[first : first + _CHUNK] @ nodes.T).argmin(axis=1))
    return np.concatenate(found)


def divided(outline: Outline) -> tuple[Piece, ...]:
    """The division of an outline into lines and arcs; of a closed one, it begins at an end of a piece."""
    count = len(outline.points)
    group = np.arange(count) * min(MOST_NODES, count) // count
    size = np.bincount(group).astype(np.float64)
    points = np.column_stack([np.bincount(group, column) / size for column in outline.points.T])
    std = np.bincount(group, np.nan_to_num(outline.std, nan=_UNKNOWN_STD)) / size
    pieces, shift = _division(points, std), 0
    if outline.closed and len(pieces) > 1:
        shift = pieces[len(pieces) // 2][0]
        pieces = _division(np.roll(points, -shift, axis=0), np.roll(std, -shift))
    order = np.roll(np.arange(len(points)), -shift)
    starts, stops = np.searchsorted(group, np.arange(len(points))), np.cumsum(size).astype(np.intp)
    nodes = [np.arange(starts[k], stops[k]) for k in order]
    return tuple(Piece(np.concatenate(nodes[begin:end]), is_arc) for begin, end, is_arc in pieces)


def _division(points: Floats, std: Floats) -> list[tuple[int, int, bool]]:
    """The pieces of an open line of nodes: first node, the one after the last, whether it is an arc."""
    count = len(points)
    moments = _cumulative_moments(points - points.mean(axis=0), std)
    least = np.concatenate([[0.0], np.full(count, np.inf)])
    begin, is_arc = np.zeros(count + 1, dtype=np.intp), np.zeros(count + 1, dtype=bool)
    for end in range(min(FEWEST_NODES, count), count + 1):
        starts = np.arange(max(end - FEWEST_NODES, 0) + 1)
        line, arc = _misfits(moments[end] - moments[starts])
        penalty = np.minimum(line + LINE_PENALTY, arc + ARC_PENALTY) + least[starts]
        begin[end] = best = int(penalty.argmin())
        least[end], is_arc[end] = penalty[best], arc[best] + ARC_PENALTY < line[best] + LINE_PENALTY
    pieces, end = [], count
    while end:
        pieces.append((int(begin[end]), end, bool(is_arc[end])))
        end = int(begin[end])
    return pieces[::-1]


def _cumulative_moments(points: Floats, std: Floats) -> Floats:
    """Sums of w (1, x, y, x², x y, y², z, x z, y z, z²) over the first k nodes, z = x² + y²: (n + 1, 10)."""
    x, y = points.T
    z, weight = x * x + y * y, (TOLERANCE * np.maximum(std, _LEAST_STD)) ** -2
    terms = weight[:, None] * np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, z, x * z, y * z, z * z])
    return np.concatenate([np.zeros((1, 10)), np.cumsum(terms, axis=0)])


def _misfits(moments: Floats) -> tuple[Floats, Floats]:
    """Sums of (e / (m u))² about the best line and the best circle of stretches, (k,) each, from moments, (k, 10)."""
    w, sx, sy, xx, xy, yy, sz, xz, yz, zz = moments.T
    x, y = sx / w, sy / w
    uu, uv, vv = xx - x * sx, xy - x * sy, yy - y * sy  # about the mean from here on
    k = x * x + y * y
    uz = (xz - x * sz) - 2 * x * uu - 2 * y * uv
    vz = (yz - y * sz) - 2 * x * uv - 2 * y * vv
    square = zz + 4 * (x * x * xx + y * y * yy + 2 * x * y * xy) + k * k * w
    square += 2 * k * sz - 4 * (x * xz + y * yz) - 4 * k * (x * sx + y * sy)
    line = np.maximum((uu + vv) / 2 - np.hypot((uu - vv) / 2, uv), 0.0)
    with np.errstate(divide='ignore', invalid='ignore'):
        scale = 1.0 / (uu * vv - uv * uv)
        a, b, c = scale * (vv * uz - uv * vz), scale * (uu * vz - uv * uz), (uu + vv) / w
        radius = c + (a * a + b * b) / 4
        arc = np.maximum(square - a * uz - b * vz - c * (uu + vv), 0.0) / (4 * radius)
        arc = np.where(np.isfinite(arc) & (radius < _LARGEST_RADIUS**2), arc, np.inf)
    return line, arc
