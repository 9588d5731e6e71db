"""Circle, arc and line through the surface points of an outline, with residuals and uncertainty.

The residual e of a point is its distance along the normal; least squares over the parameters a, e = A a.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.fit_uncertainty import parameter_stds
from scara_kinetostatic.contour.joining import Outline
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats, Mask, rms

FEWEST_POINTS = 10
LARGEST_MISFIT = 3.0
"""Residuals of a shape that the points are on, in standard uncertainties, rms: the noise along a slide is slow, so that
its residuals scatter by more than that of single points."""
_STEPS = 50
_ROUNDING = 1e-12
"""Change of a circle at which it is found, m."""


class FittedValue(NamedTuple):
    """A parameter of a fit.

    Attributes:
        name: such as ``radius``.
        value: in its unit.
        std: its standard uncertainty; NaN where the touches of the calibration do not determine it, and of what the
            begin and the end of the slide decide: the length of a line, the ends of an arc. That of x and y of a line,
            the middle of its points, is across the line.
        unit: ``m`` or ``rad``.
    """

    name: str
    value: float
    std: float
    unit: str


class ShapeFit(NamedTuple):
    """A shape through the points of an outline.

    Attributes:
        shape: ``circle``, ``arc`` or ``line``.
        outline: its number in the contour.
        values: parameters, with standard uncertainties.
        residual: of each point along the normal, outside positive, (n,), m.
        points: which points of the contour, (N,), n of them true.
        misfit: root mean square of the residuals in standard uncertainties of the points; about 1 where the points are
            on such a shape.
        piece: its number among the pieces of the outline (`fit_pieces`); None for the outline as a whole.
    """

    shape: str
    outline: int
    values: tuple[FittedValue, ...]
    residual: Floats
    points: Mask
    misfit: float
    piece: int | None = None

    @property
    def fits(self) -> bool:
        """Whether the points are on such a shape, by their uncertainty; where not, its parameters mean little."""
        return self.misfit < LARGEST_MISFIT

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
        return next(value for value in self.values if value.name == name)


def fit_shape(contour: Contour, arm: CalibratedArm, shape: str, outline: int = 0) -> ShapeFit:
    """The shape that fits the points of one outline best.

    Args:
        contour: the measured surface.
        arm: the calibrated arm of the contour.
        shape: ``circle``, ``arc`` or ``line``.
        outline: number of the outline, 0 for the longest.

    Raises:
        ParameterError: there is no such shape or outline.
        UnsupportedDataError: too few points, or they are on a straight line where a circle is asked for.
    """
    if shape not in SHAPES:
        raise ParameterError('shape', f'expected {", ".join(SHAPES)}, got {shape!r}')
    outline_of(contour, outline)
    return fit_points(contour, arm, points_of(contour, outline), shape, outline)


def outline_of(contour: Contour, outline: int) -> Outline:
    """An outline by its number.

    Raises:
        ParameterError: there is none.
    """
    count = len(contour.outlines)
    if not 0 <= outline < count:
        raise ParameterError('outline', f'expected 0 to {count - 1}, got {outline}', f'outlines found: {count}')
    return contour.outlines[outline]


def points_of(contour: Contour, outline: int) -> Mask:
    """Which points of a contour make one of its outlines, (N,)."""
    return np.isin(contour.passes, contour.outlines[outline].passes)


def fit_points(contour: Contour, arm: CalibratedArm, points: Mask, shape: str, outline: int) -> ShapeFit:
    """The shape that fits some points of an outline best.

    Args:
        contour: the measured surface.
        arm: the calibrated arm of the contour.
        points: which, (N,).
        shape: ``circle``, ``arc`` or ``line``.
        outline: the number of their outline.

    Raises:
        UnsupportedDataError: too few points, or they are on a straight line where a circle is asked for.
    """
    if points.sum() < FEWEST_POINTS:
        raise UnsupportedDataError(f'{points.sum()} points are too few for a fit', 'slide for longer')
    return SHAPES[shape](contour, arm, points, outline)


def joined_residuals(fits: Sequence[ShapeFit]) -> ShapeFit:
    """The points and residuals of several pieces of an outline as one; without values.

    Args:
        fits: of pieces that have no point in common, of one shape.
    """
    points = np.any([fit.points for fit in fits], axis=0)
    residual = np.zeros(len(points))
    for fit in fits:
        residual[fit.points] = fit.residual
    total = np.array([fit.misfit**2 for fit in fits]), np.array([fit.points.sum() for fit in fits])
    misfit = float(np.sqrt(np.average(total[0], weights=total[1])))
    return ShapeFit(fits[0].shape, fits[0].outline, (), residual[points], points, misfit)


def _circle(contour: Contour, arm: CalibratedArm, points: Mask, outline: int) -> ShapeFit:
    return _round(contour, arm, points, outline, 'circle')


def _arc(contour: Contour, arm: CalibratedArm, points: Mask, outline: int) -> ShapeFit:
    fit = _round(contour, arm, points, outline, 'arc')
    offset = contour.surface[points] - (fit.value('center_x').value, fit.value('center_y').value)
    begin, end = extent(np.arctan2(offset[:, 1], offset[:, 0]))
    ends = (FittedValue('begin', begin, np.nan, 'rad'), FittedValue('end', end, np.nan, 'rad'))
    return fit._replace(values=(*fit.values, *ends))


def extent(angle: Floats) -> tuple[float, float]:
    """The shortest arc that holds all angles, counter-clockwise from its begin, -π to π, rad."""
    ordered = np.sort(angle)
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * np.pi))
    last = int(gaps.argmax())
    begin = float(ordered[(last + 1) % len(ordered)])
    return begin, begin + 2 * np.pi - float(gaps[last])


def _round(contour: Contour, arm: CalibratedArm, points: Mask, outline: int, shape: str) -> ShapeFit:
    place = contour.surface[points]
    origin = place.mean(axis=0)
    x, y = (place - origin).T
    algebraic = np.linalg.lstsq(np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x * x + y * y, rcond=None)
    a, b, c = algebraic[0]
    if not np.isfinite(c) or algebraic[2] < 3:
        raise UnsupportedDataError('its points are on no circle', 'ask for a line')
    values = np.array([a, b, np.sqrt(max(c + a * a + b * b, 0.0))])
    for _ in range(_STEPS):
        away = np.hypot(x - values[0], y - values[1])
        design = np.column_stack([(x - values[0]) / away, (y - values[1]) / away, np.ones_like(x)])
        step = np.linalg.lstsq(design, away - values[2], rcond=None)[0]
        values = values + step
        if not np.abs(step).max() > _ROUNDING:
            break
    away = np.hypot(x - values[0], y - values[1])
    if not np.isfinite(values).all() or values[2] > 1e3:
        raise UnsupportedDataError('its points are on no circle', 'ask for a line')
    side = np.sign(np.sum(design[:, :2] * contour.normal[points]))
    residual = side * (away - values[2])
    std = parameter_stds(contour, arm, points, side * design, residual)
    found = (values[0] + origin[0], values[1] + origin[1], values[2])
    names = ('center_x', 'center_y', 'radius')
    return ShapeFit(
        shape,
        outline,
        tuple(FittedValue(n, float(v), float(s), 'm') for n, v, s in zip(names, found, std, strict=True)),
        residual,
        points,
        _misfit(contour, points, residual),
    )


def _line(contour: Contour, arm: CalibratedArm, points: Mask, outline: int) -> ShapeFit:
    place = contour.surface[points]
    origin = place.mean(axis=0)
    along = np.linalg.svd(place - origin, full_matrices=False)[2][0]
    normal = np.array([along[1], -along[0]])
    normal *= np.sign(np.sum(contour.normal[points] @ normal)) or 1.0
    residual = (place - origin) @ normal
    distance = (place - origin) @ np.array([-normal[1], normal[0]])
    std = parameter_stds(contour, arm, points, np.column_stack([np.ones_like(distance), distance]), residual)
    angle = float(np.arctan2(normal[1], normal[0]))
    values = (
        FittedValue('x', float(origin[0]), float(std[0]), 'm'),
        FittedValue('y', float(origin[1]), float(std[0]), 'm'),
        FittedValue('normal_angle', angle, float(std[1]), 'rad'),
        FittedValue('length', float(np.ptp(distance)), np.nan, 'm'),
    )
    return ShapeFit('line', outline, values, residual, points, _misfit(contour, points, residual))


def _misfit(contour: Contour, points: Mask, residual: Floats) -> float:
    """Rms of the residuals in standard uncertainties; those by noise where no other is known."""
    std = np.where(np.isnan(contour.std_normal), contour.std_noise, contour.std_normal)[points]
    return rms(residual / np.maximum(std, 1e-12))


SHAPES: dict[str, Callable[[Contour, CalibratedArm, Mask, int], ShapeFit]] = {
    'circle': _circle,
    'arc': _arc,
    'line': _line,
}
"""The fits by name."""
