"""Circle, arc and line through the surface points of an outline, with residuals and uncertainty.

The residual e of a point is its distance along the normal; least squares over the parameters a, e = A a. The covariance
of a has three parts:

- by the calibration, A⁺ D Σ Dᵀ A⁺ᵀ, common to all points;
- by noise that changes along the slide, τ σ² (AᵀA)⁻¹ with σ the noise of a point and τ the number of neighbouring
  points whose errors are alike, from the correlation of the residuals along the passes;
- by noise that does not change, κ A⁺ B Bᵀ A⁺ᵀ with B the change of the points by one standard deviation of each
  measured quantity. The noise of a touch is a repeatability: how fast it changes along a slide is not known. The part κ
  of it that the residuals do not show, 1 - rms(e)² / mean(σ²), is taken as common to all points.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.compensation.uncertainty import DEPENDS
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, rms

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
            begin and the end of the slide decide: the length of a line, the ends of an arc.
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
    """

    shape: str
    outline: int
    values: tuple[FittedValue, ...]
    residual: Floats
    points: Mask
    misfit: float

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
        UnsupportedDataError: too few points, or they are on a straight line where a circle is asked for.
    """
    points = np.isin(contour.passes, contour.outlines[outline].passes)
    if points.sum() < FEWEST_POINTS:
        raise UnsupportedDataError(
            f'outline {outline} has {points.sum()} points, too few for a fit', 'slide for longer'
        )
    return SHAPES[shape](contour, arm, points, outline)


def _circle(contour: Contour, arm: CalibratedArm, points: Mask, outline: int) -> ShapeFit:
    return _round(contour, arm, points, outline, 'circle')


def _arc(contour: Contour, arm: CalibratedArm, points: Mask, outline: int) -> ShapeFit:
    fit = _round(contour, arm, points, outline, 'arc')
    offset = contour.surface[points] - (fit.value('center_x').value, fit.value('center_y').value)
    begin, end = _extent(np.arctan2(offset[:, 1], offset[:, 0]))
    ends = (FittedValue('begin', begin, np.nan, 'rad'), FittedValue('end', end, np.nan, 'rad'))
    return fit._replace(values=(*fit.values, *ends))


def _extent(angle: Floats) -> tuple[float, float]:
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
        raise UnsupportedDataError(f'outline {outline}: its points are on no circle', 'ask for a line')
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
        raise UnsupportedDataError(f'outline {outline}: its points are on no circle', 'ask for a line')
    side = np.sign(np.sum(design[:, :2] * contour.normal[points]))
    residual = side * (away - values[2])
    std = _stds(contour, arm, points, side * design, residual)
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
    std = _stds(contour, arm, points, np.column_stack([np.ones_like(distance), distance]), residual)
    angle = float(np.arctan2(normal[1], normal[0]))
    values = (
        FittedValue('x', float(origin[0]), float(std[0] * abs(normal[0])), 'm'),
        FittedValue('y', float(origin[1]), float(std[0] * abs(normal[1])), 'm'),
        FittedValue('normal_angle', angle, float(std[1]), 'rad'),
        FittedValue('length', float(np.ptp(distance)), np.nan, 'm'),
    )
    return ShapeFit('line', outline, values, residual, points, _misfit(contour, points, residual))


def _misfit(contour: Contour, points: Mask, residual: Floats) -> float:
    """Rms of the residuals in standard uncertainties; those by noise where no other is known."""
    std = np.where(np.isnan(contour.std_normal), contour.std_noise, contour.std_normal)[points]
    return rms(residual / np.maximum(std, 1e-12))


def _stds(contour: Contour, arm: CalibratedArm, points: Mask, design: Floats, residual: Floats) -> Floats:
    """Standard uncertainties of the parameters of a fit with a design matrix, (k,); NaN where one is not determined."""
    inverse = np.linalg.pinv(design)
    by_model = inverse @ contour.by_model[points]
    systematic = np.einsum('ij,jk,ik->i', by_model, arm.covariance, by_model)
    free = ((by_model @ arm.undetermined) ** 2).sum(axis=1)
    systematic[free > DEPENDS**2 * systematic] = np.nan
    common = arm.cell.uncertainty.radius * inverse.sum(axis=1)
    constant = inverse @ contour.by_noise[points]
    hidden = _constant_part(contour.by_noise[points], residual)
    alike = _correlated_points(residual, contour.passes[points])
    changing = alike * np.einsum('ij,j,ij->i', inverse, contour.std_noise[points] ** 2, inverse)
    noise = changing + hidden * (constant**2).sum(axis=1)
    return np.asarray(np.sqrt(systematic + common**2 + noise))


def _constant_part(by_noise: Floats, residual: Floats) -> float:
    """The part of the variance of the noise that residuals do not show, 0 to 1."""
    expected = float((by_noise**2).sum(axis=1).mean())
    return float(np.clip(1.0 - rms(residual) ** 2 / expected, 0.0, 1.0)) if expected > 0 else 0.0


def _correlated_points(residual: Floats, passes: Indices) -> float:
    """1 + 2 Σ ρ_k over the lags up to the first whose correlation ρ_k is not above 0, at least 1."""
    total, square = np.zeros(0), 0.0
    for number in np.unique(passes):
        part = residual[passes == number]
        lags = np.correlate(part, part, 'full')[len(part) - 1 :] if len(part) < 4000 else _by_fft(part)
        size = max(len(total), len(lags))
        total = np.pad(total, (0, size - len(total))) + np.pad(lags, (0, size - len(lags)))
        square += float(lags[0])
    if not square > 0:
        return 1.0
    correlation = total[1:] / square
    negative = np.flatnonzero(correlation <= 0)
    end = int(negative[0]) if len(negative) else len(correlation)
    return float(1.0 + 2.0 * correlation[:end].sum())


def _by_fft(values: Floats) -> Floats:
    """Sums of products of values a lag apart, for every lag."""
    size = 2 ** int(np.ceil(np.log2(2 * len(values))))
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum, size)[: len(values)])


SHAPES: dict[str, Callable[[Contour, CalibratedArm, Mask, int], ShapeFit]] = {
    'circle': _circle,
    'arc': _arc,
    'line': _line,
}
"""The fits by name."""
