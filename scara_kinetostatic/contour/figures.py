"""Figures of a contour: the outline, what the compensation changes, uncertainty, angle of the force, residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from scara_kinetostatic.contour.fits import ShapeFit
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import Surfaces, shifts_along_normal
from scara_kinetostatic.model.arrays import Floats, Indices, rms
from scara_kinetostatic.report.figure import FAINT, INK, MICRO, SERIES, Margins, as_svg, new_figure

_WIDTH = 920.0
_MILLI = 1e3
_MOST_POINTS = 1500
"""Points of a curve that are drawn."""
_LINEAR = 1e-5
"""Errors up to this are on a linear scale, m."""
LABELS = ('rigid, nominal', 'rigid, calibrated', 'deformable, calibrated')
"""The models of `Surfaces`."""


def outline_picture(contour: Contour) -> Markup:
    """The outlines from above, in the base frame, with the direction of the force at some places."""
    points = np.concatenate([outline.points for outline in contour.outlines])
    low, high = points.min(axis=0), points.max(axis=0)
    span = float((high - low).max())
    size = np.maximum(high - low, 0.2 * span) + 0.24 * span
    height = _WIDTH * float(np.clip(size[1] / size[0], 0.3, 0.75))
    figure, (axes,) = new_figure(_WIDTH, height, margins=Margins())
    for outline in contour.outlines:
        x, y = _MILLI * outline.ring.T
        if outline.closed:
            axes.fill(x, y, color=SERIES[0], alpha=0.1, lw=0)
        axes.plot(x, y, color=SERIES[0], lw=1.6)
    arrows = np.linspace(0, len(contour) - 1, 24).astype(int)
    size_of = contour.force[arrows] / float(np.hypot(*contour.force.T).max())
    begin = contour.surface[arrows] - 0.1 * span * size_of
    axes.quiver(
        *(_MILLI * begin).T, *(_MILLI * 0.1 * span * size_of).T, color=FAINT, angles='xy', scale_units='xy', scale=1,
        width=0.0018, headwidth=5,
    )  # fmt: skip
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', adjustable='datalim')
    return as_svg(figure, 'outline', 'the outline from above with the forces on it')


def comparison_picture(contour: Contour, surfaces: Surfaces, name: str = 'comparison') -> Markup:
    """How far the surface by the rigid models is from that of the deformable one, along the path."""
    figure, (axes,) = new_figure(_WIDTH, 300, margins=Margins())
    shown = sampled(contour)
    along = _MILLI * distance_along(contour)[shown]
    shifts = shifts_along_normal(contour, surfaces)
    for shift, label, colour in zip(shifts[:2], LABELS, (SERIES[1], SERIES[3]), strict=False):
        _curve(axes, along, _MILLI * shift[shown], contour.passes[shown], colour, label)
    axes.axhline(0.0, color=SERIES[0], lw=1.6, label=LABELS[2])
    axes.set(xlabel='distance along the slide  [mm]', ylabel='surface  [mm]')
    axes.legend(loc='best', frameon=False, ncols=3)
    return as_svg(figure, name, 'shift of the surface along its normal by rigid models')


def quality_picture(contour: Contour) -> Markup:
    """Standard uncertainty along the normal, and the angle from the normal to the force, along the path."""
    figure, (upper, lower) = new_figure(_WIDTH, 380, rows=2, margins=Margins(), sharex=True)
    shown = sampled(contour)
    along, passes = _MILLI * distance_along(contour)[shown], contour.passes[shown]
    _curve(upper, along, MICRO * contour.std_normal[shown], passes, SERIES[0], 'all')
    _curve(upper, along, MICRO * contour.std_systematic[shown], passes, SERIES[2], 'calibration and tip alone')
    upper.set_ylim(bottom=0)
    upper.set(ylabel='u normal  [µm]')
    upper.legend(loc='best', frameon=False, ncols=2)
    _curve(lower, along, np.degrees(contour.off_normal[shown]), passes, SERIES[1], '')
    lower.axhline(np.degrees(np.arctan(contour.friction.coefficient)), color=INK, lw=0.9, ls=(0, (5, 3)))
    lower.set(xlabel='distance along the slide  [mm]', ylabel='force off normal  [°]')
    return as_svg(figure, 'quality', 'uncertainty and angle of the force along the slide')


def residual_picture(contour: Contour, fit: ShapeFit, name: str) -> Markup:
    """Residuals of a fit along the path."""
    figure, (axes,) = new_figure(_WIDTH, 240, margins=Margins())
    along = _MILLI * distance_along(contour)[fit.points]
    index = np.flatnonzero(fit.points)
    runs = np.cumsum(np.append(0, (np.diff(index) > 1) | (np.diff(contour.passes[index]) != 0)))
    shown = np.linspace(0, len(along) - 1, min(_MOST_POINTS, len(along))).astype(int)
    band = 2 * MICRO * contour.std_normal[fit.points][shown]
    axes.fill_between(along[shown], -band, band, color=FAINT, alpha=0.16, lw=0)
    _curve(axes, along[shown], MICRO * fit.residual[shown], runs[shown], SERIES[0], '')
    axes.set(xlabel='distance along the slide  [mm]', ylabel='residual  [µm]')
    return as_svg(figure, name, f'residuals of the {fit.shape}')


def distance_along(contour: Contour) -> Floats:
    """Distance slid along the surface up to each point, one pass after the other, (n,), m."""
    step = np.hypot(*np.diff(contour.surface, axis=0).T)
    step[np.diff(contour.passes) != 0] = 0.0
    return np.append(0.0, np.cumsum(step))


def sampled(contour: Contour) -> Indices:
    """The points that are drawn."""
    return np.linspace(0, len(contour) - 1, min(_MOST_POINTS, len(contour))).astype(np.intp)


def _curve(axes: Axes, along: Floats, values: Floats, passes: Indices, colour: str, label: str) -> None:
    """A curve that is broken between two passes."""
    breaks: Sequence[int] = (np.flatnonzero(np.diff(passes) != 0) + 1).tolist()
    axes.plot(np.insert(along, breaks, np.nan), np.insert(values, breaks, np.nan), color=colour, lw=1.2, label=label)


class ModelError(NamedTuple):
    """The error of the surface by one model.

    Attributes:
        label: of the model.
        error: along the true normal, outside positive, (n,), m.
    """

    label: str
    error: Floats


def error_picture(surface: Floats, normal: Floats, errors: Sequence[ModelError], magnified: float = 5.0) -> Markup:
    """Errors of several models on one slide whose true surface is known.

    Left: the outline with the errors magnified; right: the errors along the slide, a linear scale up to
    `_LINEAR`, beyond it logarithmic.

    Args:
        surface: true surface, (n, 2), m.
        normal: its outward normals, (n, 2).
        errors: of each model, the largest first.
        magnified: factor of the errors on the left.
    """
    figure, (left, right) = new_figure(_WIDTH, 360, columns=2, width_ratios=(0.74, 1.0))
    along = _MILLI * np.append(0.0, np.cumsum(np.hypot(*np.diff(surface, axis=0).T)))
    left.fill(*(_MILLI * surface).T, color=FAINT, alpha=0.13, lw=0)
    for (label, error), colour in zip(errors, (SERIES[1], SERIES[3], SERIES[4], SERIES[0]), strict=False):
        left.plot(*(_MILLI * (surface + magnified * error[:, None] * normal)).T, color=colour, lw=1.3)
        right.plot(along, _MILLI * error, color=colour, lw=1.1, label=f'{label}: {_length(rms(error))} rms')
    left.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', adjustable='datalim')
    left.set_title(f'outline, errors × {magnified:g}')
    right.set_yscale('symlog', linthresh=_MILLI * _LINEAR)
    ticks = (-10, -1, -0.1, -0.01, 0, 0.01, 0.1, 1, 10)
    right.set_yticks(ticks, [f'{tick:g}'.replace('-', '−') for tick in ticks])
    right.minorticks_off()
    right.set_ylim(-10, 10)
    right.set(xlabel='distance along the surface  [mm]', ylabel='error along the normal  [mm]')
    right.legend(loc='lower center', bbox_to_anchor=(0.46, 1.0), frameon=False, ncols=2, columnspacing=1.4)
    return as_svg(figure, 'contour_errors', 'error of the surface by each model')


def _length(value: float) -> str:
    return f'{_MILLI * value:.3g} mm' if value >= 1e-4 else f'{MICRO * value:.1f} µm'
