"""Circle, arc and line through the surface points of an outline.

The residual e of a point is its distance along the normal; least squares over the parameters a, e = A a.

**Uncertainty.** With e = A a for the residuals e along the normal and the parameters a, the covariance of a has three
parts:

- by the calibration, A⁺ D Σ Dᵀ A⁺ᵀ, common to all points;
- by noise that changes along the slide, τ σ² (AᵀA)⁻¹ with σ the noise of a point and τ the number of neighbouring
  points whose errors are alike, from the correlation of the residuals along the passes;
- by noise that changes more slowly. The noise of a touch is a repeatability: how fast it changes along a slide is not
  known. The part κ of it that the residuals do not show, 1 - rms(e)² / mean(σ²), may be constant or change as slowly as
  the shape does, which then takes it up: κ Σ A⁺ (b bᵀ ∘ R) A⁺ᵀ over the measured quantities, with b the change of the
  points by one standard deviation and R = exp(-(Δt / T)² / 2), T one of some parts of the time of the
  points, that for which it is largest.

**Pieces.** An outline is split into straight lines and arcs of circles, each fitted on its own. The nodes of the
outline, in their order, are divided so that

    Σ over pieces (λ + Σ (e / (m u))²)

is least, with e the distance of a node from the line or the circle of its piece, u its standard uncertainty, m = 3
and λ the penalty of a piece. The least sum for the first k nodes follows from those for fewer nodes
(dynamic programming, Bellman 1961); the sums of a stretch are differences of cumulative moments, about its own mean,
for a circle with the algebraic distance (‖p - c‖² - R²) / (2 R) (Kåsa 1976). The division says which points belong
together; the shapes and their uncertainties are those of the fits through these points, without those close to the
ends of a piece, which may belong to the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.result import TINY, TOGETHER, Contour, Polyline, lengths
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, correlated_samples, rms
from scara_kinetostatic.model.parameters import MICRO, MILLI

SHAPES = {
    'circle': (('center_x', 'm'), ('center_y', 'm'), ('radius', 'm')),
    'line': (('x', 'm'), ('y', 'm'), ('normal_angle', 'rad')),
}
"""What can be fitted: its parameters with their units."""
FEWEST_POINTS = 10
"""Fewer are not fitted."""
_LARGEST_RADIUS, _LARGEST_ARC = 1000.0, 10.0
"""Radius of a whole circle, and of an arc that is a piece, m, beyond which it is a line."""
_UNKNOWN_STD = 10 * MICRO
"""Standard uncertainty of a node where none is known, m."""


def parameter_stds(contour: Contour, arm: CalibratedArm, points: Mask, design: Floats, residual: Floats) -> Floats:
    """Standard uncertainties of the parameters of a fit with a design matrix, (k,); NaN where one is not determined."""
    inverse = np.linalg.pinv(design)
    by_model = inverse @ contour.by_model[points]
    systematic = np.einsum('ij,jk,ik->i', by_model, arm.covariance, by_model)
    free = ((by_model @ arm.undetermined) ** 2).sum(axis=1)
    systematic[free > systematic] = np.nan
    common = arm.cell.uncertainty.radius * inverse.sum(axis=1)
    slow = _slow_noise(np.asarray(inverse, dtype=np.float64), contour, points, residual)
    passes = contour.passes[points]
    alike = correlated_samples([residual[passes == number] for number in np.unique(passes)])
    changing = alike * np.einsum('ij,j,ij->i', inverse, contour.std_noise[points] ** 2, inverse)
    return np.asarray(np.sqrt(systematic + common**2 + changing + slow))


def _slow_noise(inverse: Floats, contour: Contour, points: Mask, residual: Floats) -> Floats:
    """Variances of the parameters by the noise that residuals do not show, (k,)."""
    by_noise, std, time = contour.by_noise[points], contour.std_noise[points], contour.time[points]
    hidden = min(max(1.0 - rms(residual) ** 2 / max(float((std**2).mean()), TINY**2), 0.0), 1.0)
    size = np.maximum(np.linalg.norm(by_noise, axis=1), TINY)
    loading = by_noise * (std / size)[:, None]
    group = np.arange(len(time)) * min(100, len(time)) // len(time)  # groups of neighbouring points
    count, terms = np.bincount(group), inverse.T[:, :, None] * loading[:, None, :]
    sums = np.add.reduceat(terms, np.searchsorted(group, np.arange(len(count))))
    middle = np.bincount(group, time) / count
    lag = (middle[:, None] - middle) / max(float(np.ptp(time)), TINY)
    alike = [np.exp(-0.5 * (lag / part) ** 2) for part in (0.25, 0.5, 1.0, np.inf)]  # parts of the time of all
    variances = [np.einsum('gkc,gh,hkc->k', sums, matrix, sums) for matrix in alike]
    return np.asarray(hidden * np.max(variances, axis=0))


class FittedValue(NamedTuple):
    """A parameter of a fit.

    Attributes:
        value: in its unit.
        std: its standard uncertainty; NaN where the touches of the calibration do not determine it. That of x and y of
            a line, the middle of its points, is across the line.
        unit: ``m`` or ``rad``.
    """

    value: float
    std: float
    unit: str


class ShapeFit(NamedTuple):
    """A shape through the points of an outline.

    Attributes:
        shape: ``circle`` or ``line``.
        outline: its number in the contour.
        values: parameters by name, such as ``radius``, with standard uncertainties.
        residual: of each point along the normal, outside positive, (n,), m.
        points: which points of the contour, (N,), n of them true.
        misfit: root mean square of the residuals in standard uncertainties of the points; about 1 where the points are
            on such a shape.
        piece: its number among the pieces of the outline (`fit_pieces`); None for the outline as a whole.
    """

    shape: str
    outline: int
    values: dict[str, FittedValue]
    residual: Floats
    points: Mask
    misfit: float
    piece: int | None = None

    @property
    def fits(self) -> bool:
        """Whether the points are on such a shape, by their uncertainty; where not, its parameters mean little."""
        # the noise along a slide is slow: its residuals scatter by more than that of single points
        return self.misfit < 3.0

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, m."""
        return rms(self.residual)

    @property
    def largest(self) -> float:
        """Largest residual, m."""
        return float(np.abs(self.residual).max())

    def value(self, name: str) -> FittedValue:
        """A parameter by its name."""
        return self.values[name]


def fit_shape(contour: Contour, arm: CalibratedArm, shape: str, outline: int = 0) -> ShapeFit:
    """The shape that fits the points of one outline best.

    Args:
        contour: the measured surface.
        arm: the calibrated arm of the contour.
        shape: ``circle`` or ``line``.
        outline: number of the outline, 0 for the longest.

    Raises:
        ParameterError: there is no such shape or outline.
        UnsupportedDataError: too few points, or they are on a straight line where a circle is asked for.
    """
    if shape not in SHAPES:
        raise ParameterError('shape', f'expected {", ".join(SHAPES)}, got {shape!r}')
    return _fit(contour, arm, _points_of(contour, outline), shape, outline)


def _points_of(contour: Contour, outline: int) -> Mask:
    """Which points of a contour make one of its outlines, (N,).

    Raises:
        ParameterError: there is no such outline.
    """
    count = len(contour.outlines)
    if not 0 <= outline < count:
        raise ParameterError('outline', f'expected 0 to {count - 1}, got {outline}', f'outlines found: {count}')
    return np.isin(contour.passes, contour.outlines[outline].passes)


def _fit(contour: Contour, arm: CalibratedArm, points: Mask, shape: str, outline: int) -> ShapeFit:
    """The shape that fits some points, a mask (N,), of an outline best.

    Raises:
        UnsupportedDataError: too few points, or they are on a straight line where a circle is asked for.
    """
    if points.sum() < FEWEST_POINTS:
        raise UnsupportedDataError(f'{points.sum()} points are too few for a fit', 'slide for longer')
    fit = _line if shape == 'line' else _round
    found, residual, design = fit(contour.surface[points], contour.normal[points])
    std = parameter_stds(contour, arm, points, design, residual)
    stds = std[[0, 0, 1]] if shape == 'line' else std
    values = {
        name: FittedValue(float(value), float(u), unit)
        for (name, unit), value, u in zip(SHAPES[shape], found, stds, strict=True)
    }
    misfit = rms(residual / np.maximum(contour.stretch(points).weighing, TINY))
    return ShapeFit(shape, outline, values, residual, points, misfit)


def _round(place: Floats, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """A circle: center and radius; residuals along the normals; their design matrix.

    Raises:
        UnsupportedDataError: the points are on no circle.
    """
    origin = place.mean(axis=0)
    x, y = (place - origin).T
    (a, b, c), _, rank, _ = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x * x + y * y, rcond=None)
    values = np.array([a, b, np.sqrt(max(c + a * a + b * b, 0.0))])
    for _ in range(50):
        away = np.hypot(x - values[0], y - values[1])
        design = np.column_stack([(x - values[0]) / away, (y - values[1]) / away, np.ones_like(x)])
        step = np.linalg.lstsq(design, away - values[2], rcond=None)[0]
        values = values + step
        if not np.abs(step).max() > TINY:
            break
    if rank < 3 or not np.isfinite(values).all() or values[2] > _LARGEST_RADIUS:
        raise UnsupportedDataError('its points are on no circle', 'ask for a line')
    away, side = np.hypot(x - values[0], y - values[1]), np.sign(np.sum(design[:, :2] * normal))
    return np.append(values[:2] + origin, values[2]), side * (away - values[2]), side * design


def _line(place: Floats, outward: Floats) -> tuple[Floats, Floats, Floats]:
    """A line: its middle, the angle of its normal; residuals along the normal; their design matrix."""
    origin = place.mean(axis=0)
    x, y = np.linalg.svd(place - origin, full_matrices=False)[2][0]
    normal = np.array([y, -x]) * (np.sign(np.sum(outward @ [y, -x])) or 1.0)
    across = np.array([-normal[1], normal[0]])
    distance = (place - origin) @ across
    found = np.append(origin, np.arctan2(normal[1], normal[0]))
    return found, (place - origin) @ normal, np.column_stack([np.ones_like(distance), distance])


def fit_pieces(contour: Contour, arm: CalibratedArm, outline: int = 0) -> tuple[ShapeFit, ...]:
    """The lines and arcs that make one outline.

    Args:
        contour: the measured surface.
        arm: the calibrated arm of the contour.
        outline: number of the outline, 0 for the longest.

    Returns:
        For each piece in its order along the outline, the object on the left, a fit ``line`` or ``circle`` with its
        number `piece`, through its points away from the ends. Pieces with too few points are left out.

    Raises:
        ParameterError: there is no such outline.
    """
    points = np.flatnonzero(_points_of(contour, outline))
    made = contour.outlines[outline]
    pieces = divided(made)
    label = np.full(len(made.points), -1)
    for number, (nodes, _) in enumerate(pieces):
        along = lengths(made.points[nodes])
        margin = min(1.5 * MILLI, 0.2 * float(along[-1])) if len(pieces) > 1 else 0.0  # left out at both ends
        label[nodes[(along >= margin) & (along <= along[-1] - margin)]] = number
    owner = label[_nearest_nodes(contour, points, made)]
    fits = []
    for number, (_, is_arc) in enumerate(pieces):
        own = np.isin(np.arange(len(contour)), points[owner == number])
        if own.sum() >= FEWEST_POINTS:
            fits.append(_fit(contour, arm, own, 'circle' if is_arc else 'line', outline)._replace(piece=number))
    return tuple(fits)


def _nearest_nodes(contour: Contour, points: Indices, outline: Polyline) -> Indices:
    """The node nearest to each point, with a like normal."""
    weight = 5 * MILLI  # points with opposite normals are taken to be farther apart by twice this length
    nodes = np.column_stack([outline.points, weight * outline.normals])
    wanted = np.column_stack([contour.surface[points], weight * contour.normal[points]])
    parts = np.array_split(wanted, len(wanted) // TOGETHER + 1)
    return np.concatenate([((nodes**2).sum(axis=1) - 2.0 * part @ nodes.T).argmin(axis=1) for part in parts])


def divided(outline: Polyline, most: int = 500) -> list[tuple[Indices, bool]]:
    """The division of an outline into lines and arcs; of a closed one, it begins at an end of a piece.

    Args:
        outline: the outline.
        most: of so many of its nodes ends of pieces are chosen.

    Returns:
        Of each piece the numbers of its nodes, in their order, and whether it is an arc.
    """
    count = len(outline.points)
    group = np.arange(count) * min(most, count) // count
    first = np.unique(group, return_index=True)[1]
    points, std = outline.points[first], np.nan_to_num(outline.std[first], nan=_UNKNOWN_STD)
    pieces, shift = _division(points, std), 0
    if outline.closed and len(pieces) > 1:
        shift = pieces[len(pieces) // 2][0]
        pieces = _division(np.roll(points, -shift, axis=0), np.roll(std, -shift))
    nodes = np.roll(np.arange(count), -first[shift])
    ends = np.append((np.roll(first, -shift) - first[shift]) % count, count)
    return [(nodes[ends[begin] : ends[end]], is_arc) for begin, end, is_arc in pieces]


def _division(points: Floats, std: Floats) -> list[tuple[int, int, bool]]:
    """The pieces of an open line of nodes: first node, the one after the last, whether it is an arc.

    Args:
        points: nodes, (n, 2), m.
        std: of each along the normal, (n,), m.
    """
    count, moments = len(points), _cumulative_moments(points - points.mean(axis=0), std)
    fewest = 4  # nodes of a piece
    least = np.concatenate([[0.0], np.full(count, np.inf)])
    begin, is_arc = np.zeros(count + 1, dtype=np.intp), np.zeros(count + 1, dtype=bool)
    for end in range(min(fewest, count), count + 1):
        starts = np.arange(max(end - fewest, 0) + 1)
        line, arc = _misfits(moments[end] - moments[starts])
        line, arc = line + 30.0, arc + 40.0  # λ: an arc has one value more, and every line is nearly an arc, too
        penalty = np.minimum(line, arc) + least[starts]
        begin[end] = best = int(penalty.argmin())
        least[end], is_arc[end] = penalty[best], arc[best] < line[best]
    pieces, end = [], count
    while end:
        pieces.append((int(begin[end]), end, bool(is_arc[end])))
        end = int(begin[end])
    return pieces[::-1]


def _cumulative_moments(points: Floats, std: Floats) -> Floats:
    """Sums of w (1, x, y, x², x y, y², z, x z, y z, z²) over the first k nodes, z = x² + y²: (n + 1, 10)."""
    x, y = points.T
    z, weight = x * x + y * y, (3.0 * np.maximum(std, MICRO)) ** -2  # on a shape: within three standard uncertainties
    terms = weight[:, None] * np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, z, x * z, y * z, z * z])
    return np.concatenate([np.zeros_like(terms[:1]), np.cumsum(terms, axis=0)])


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
        arc = np.where(np.isfinite(arc) & (radius < _LARGEST_ARC**2), arc, np.inf)
    return line, arc
