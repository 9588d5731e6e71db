"""Pictures of model errors: the residual of an effect before and after, and the bias of the base model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.diagnosis.comparison import Bias, EffectResidual
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.report.figure import FAINT, INK, LINE, PAPER, SERIES, WARN, as_svg, mark, new_figure

_WIDTH = 920.0
_FEW = 6
"""A variable with so few values is a category: its touches are drawn side by side."""
_ASIDE = 0.3
"""How far aside, as a part of the distance between categories."""
_WITHIN = 0.97
"""This part of the touches lies within the scale."""
NOTABLE = 2.0
"""A bias of so many standard deviations is drawn in the warning colour."""


_PAGE_UNITS = {'[rad]': ('[°]', math.degrees(1.0)), '[µrad]': ('[°]', math.degrees(1e-6)), '[µm]': ('[mm]', 1e-3)}
"""Of the axes: the unit of a page, and how much of it is one."""


def _in_page_units(found: EffectResidual) -> EffectResidual:
    """The same in the units of a page."""
    (x_label, per_x), (y_label, per_y) = map(_in_page_unit, (found.x_label, found.y_label))
    names = ('before', 'after', 'expected', 'std_before', 'std_after')
    values = {name: per_y * getattr(found, name) for name in names}
    return found._replace(x_label=x_label, y_label=y_label, x=per_x * found.x, **values)


def _in_page_unit(label: str) -> tuple[str, float]:
    """The label of an axis with the unit of a page, and the factor to it."""
    words, _, unit = label.rpartition(' ')
    name, factor = _PAGE_UNITS.get(unit, (unit, 1.0))
    return f'{words} {name}', factor


def residual_picture(found: EffectResidual, name: str, titles: tuple[str, str] = ('without it', 'with it')) -> Markup:
    """The deviation by an effect, estimated from each touch, without it in the model and with it, on the same axes."""
    found = _in_page_units(found)
    figure, axes = new_figure(_WIDTH, 300, columns=2, sharey=True, sharex=True)
    x = _side_by_side(found.x)
    kinds = len(x) > 0 and len(np.unique(found.x)) <= _FEW
    largest = _largest(found)
    sides = ((found.before, found.std_before), (found.after, found.std_after))
    for one, (deviation, std), title in zip(axes, sides, titles, strict=True):
        values = np.clip(deviation, -0.97 * largest, 0.97 * largest)
        one.axhline(0, color=FAINT, lw=0.9)
        one.vlines(x, values - std, values + std, color=LINE, lw=1.0, zorder=1)
        _scatter(one, found, x, values)
        one.set(title=title, xlabel=found.x_label, ylim=(-largest, largest))
        one.grid(visible=False, axis='x')
        if kinds:
            one.set_xticks(np.unique(found.x))
        else:
            one.xaxis.set_major_locator(MaxNLocator(7))
    if found.expected.any():  # an effect that only scatters leaves no pattern
        axes[0].plot(x, found.expected, '_', ms=8, mew=1.6, color=INK, zorder=4)
    axes[0].set(ylabel=found.y_label)
    return as_svg(figure, name, 'deviation by the effect, estimated from each touch, without it and with it')


def _largest(found: EffectResidual) -> float:
    """The end of the y axis: single outliers do not change it."""
    size = np.abs(np.concatenate([found.before, found.after, found.expected]))
    if not size.size:
        return 1.0
    usual = float(np.quantile(size, _WITHIN))
    return max(1.1 * min(float(size.max()), 1.6 * usual), 1e-9)


def _side_by_side(x: Floats) -> Floats:
    """Values of which there are few, spread out in the order of the touches."""
    kinds, which = np.unique(x, return_inverse=True)
    if len(kinds) > _FEW:
        return x
    apart = float(np.diff(kinds).min()) if len(kinds) > 1 else 1.0
    out = x.copy()
    for number in range(len(kinds)):
        members = np.flatnonzero(which == number)
        out[members] += apart * _ASIDE * np.linspace(-1, 1, len(members) + 2)[1:-1]
    return np.asarray(out)


def _scatter(axes: Axes, found: EffectResidual, x: Floats, values: Floats) -> None:
    """Touches by disc (colour and shape) and posture (full: left, hollow: right)."""
    for number in np.unique(found.disc):
        look = mark(int(number))
        for posture in (1, -1):
            chosen = (found.disc == number) & (found.posture == posture)
            fill = look.colour if posture > 0 else PAPER
            axes.plot(
                x[chosen], values[chosen], look.shape, ls='none', ms=4.4, mfc=fill, mec=look.colour, mew=1.0, zorder=3
            )


def bias_picture(rows: Sequence[Bias]) -> Markup:
    """Bias of each parameter of the base model, in standard deviations of that model."""
    figure, (axes,) = new_figure(_WIDTH, 300)
    places = np.arange(len(rows))
    shifts = np.array([row.in_std for row in rows])
    stds = np.array([row.std / row.base_std if row.base_std > 0 else np.nan for row in rows])
    axes.axhspan(-1, 1, color=SERIES[0], alpha=0.12, lw=0)
    axes.axhline(0, color=FAINT, lw=0.9)
    for place, shift, std in zip(places, shifts, stds, strict=True):
        if np.isfinite(shift):
            colour = WARN if abs(shift) > NOTABLE else SERIES[0]
            axes.plot([place, place], [0, shift], color=colour, lw=2.4, solid_capstyle='butt')
            axes.plot(place, shift, 'o', ms=6, mfc=colour, mec=PAPER, mew=0.8)
            axes.plot([place + 0.16] * 2, [shift - std, shift + std], color=FAINT, lw=1.0)
    axes.set_xticks(places, [row.name for row in rows])
    axes.set(ylabel='bias  [σ]')
    largest = float(np.nanmax(np.abs(shifts) + np.minimum(stds, 3.0), initial=1.5)) * 1.1
    axes.set_ylim(-largest, largest)
    axes.grid(visible=False, axis='x')
    axes.tick_params(axis='x', labelcolor=INK, length=0)
    return as_svg(figure, 'bias', 'bias of each parameter of the base model in standard deviations')
