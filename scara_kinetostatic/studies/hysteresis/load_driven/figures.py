"""Figures of records driven by their load: the response over the load, and the residual over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.report.figure import FAINT, INK, LINE, SERIES, Margins, as_svg, new_figure
from scara_kinetostatic.report.quantities import Scale
from scara_kinetostatic.studies.hysteresis.units import Units

WIDTH, HEIGHT = 450.0, 300.0
_MARGINS = Margins(left=64, right=8, bottom=74, top=12)
_BEFORE, _AFTER = SERIES[1], SERIES[0]


class Curve(NamedTuple):
    """What the figures show of one record; arrays (n,), counted from rest.

    Attributes:
        time: s.
        load: N or Nm.
        response: m or rad.
        before: residual of law (6), m or rad.
        after: that of the selected law; None where none is selected.
        unloaded: time from which on the residual is judged, s.
        response_scale: unit of the response.
        error_scale: unit of the residuals.
    """

    time: Floats
    load: Floats
    response: Floats
    before: Floats
    after: Floats | None
    unloaded: float
    response_scale: Scale
    error_scale: Scale


def response_picture(curve: Curve, units: Units, name: str) -> Markup:
    """Response over load: measured, law (6), and the selected law.

    Args:
        curve: of one record.
        units: force and displacement, or torque and angle.
        name: identifier of the picture on the page.
    """
    figure, (axes,) = new_figure(WIDTH, HEIGHT, margins=_MARGINS)
    axes.plot(curve.load, curve.response_scale.per_si * curve.response, color=INK, lw=0.8, label='measured')
    for residual, colour, label in _laws(curve):
        predicted = curve.response_scale.per_si * (curve.response - residual)
        axes.plot(curve.load, predicted, color=colour, lw=1.5, label=label)
    axes.set(xlabel=f'{units.load}  [{units.si_unit("N")}]', ylabel=f'{units.response}  [{curve.response_scale.unit}]')
    _legend(axes)
    return as_svg(figure, name, f'{units.response} over {units.load}, measured and by both laws')


def residual_picture(curve: Curve, name: str) -> Markup:
    """Residual over time of law (6) and of the selected law, the predicted part shaded; arguments as above."""
    figure, (axes,) = new_figure(WIDTH, HEIGHT, margins=_MARGINS)
    axes.axvspan(curve.unloaded, curve.time[-1], color=LINE, lw=0, alpha=0.5)
    axes.axhline(0, color=FAINT, lw=0.9)
    for residual, colour, label in _laws(curve):
        axes.plot(curve.time, curve.error_scale.per_si * residual, color=colour, lw=1.0, label=label)
    axes.set(xlabel='time  [s]', ylabel=f'residual  [{curve.error_scale.unit}]')
    axes.set_xlim(curve.time[0], curve.time[-1])
    _legend(axes)
    return as_svg(figure, name, 'residual over time of both laws; the part after the load has gone is shaded')


def _laws(curve: Curve) -> list[tuple[Floats, str, str]]:
    laws = [(curve.before, _BEFORE, 'law (6)')]
    return laws if curve.after is None else [*laws, (np.asarray(curve.after), _AFTER, 'selected law')]


def _legend(axes: Axes) -> None:
    axes.legend(frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.19), ncols=3, handlelength=1.4)
