"""Figures of the hysteresis analysis: laws over the loop, residuals over the distance, leave-one-out predictions."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.render.figure import FAINT, INK, SERIES, as_svg
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, Record
from scara_kinetostatic.studies.hysteresis.leave_one_out import IDENTIFICATION_SWEEPS
from scara_kinetostatic.studies.hysteresis.model_selection import CrossValidation
from scara_kinetostatic.studies.hysteresis.motion import Motion, Rows

WIDTH = 920.0
_MILLI, _KILO = 1e3, 1e-3
_RISING, _FALLING = SERIES[0], SERIES[1]
_BEFORE, _AFTER, _REFINED = SERIES[1], SERIES[0], SERIES[2]


def loop_picture(record: Record, name: str) -> Markup:
    """The later half of the sweeps, measured, and each law as fitted to the earlier half.

    Args:
        record: what to show.
        name: identifier of the picture on the page.
    """
    figure, panels = _panels(380)
    motion, selection = record.motion, record.selection
    rows = ~motion.earlier
    shown = [(selection.before, _BEFORE, 'law (6)')]
    after = [(selection.selected, _AFTER, 'selected law')] if selection.selected is not None else []
    if selection.selected is not None and selection.refined.law.name != selection.selected.law.name:
        after.append((selection.refined, _REFINED, 'refined'))
    for axes, laws in zip(panels, (shown, after), strict=True):
        axes.plot(_MILLI * motion.displacement[rows], _KILO * motion.force[rows], color=INK, lw=0.8, label='measured')
        for score, colour, label in laws:
            predicted = motion.force - score.halves[0].residual
            axes.plot(_MILLI * motion.displacement[rows], _KILO * predicted[rows], color=colour, lw=1.4, label=label)
        axes.set(xlabel='displacement  [mm]')
        _legend(axes)
    panels[0].set(ylabel='force  [kN]')
    return as_svg(figure, name, 'force over displacement of the sweeps held out, measured and predicted')


def residual_picture(record: Record, name: str) -> Markup:
    """Held-out residual over the distance since the reversal: law (6), and the refined law."""
    figure, panels = _panels(330)
    selection = record.selection
    names = ('before', 'refined' if '+' in selection.refined.law.name else 'after')
    for axes, score, label in zip(panels, (selection.before, selection.refined), names, strict=True):
        _residual(axes, record.motion, score)
        axes.axhline(0, color=FAINT, lw=0.9)
        axes.set(xlabel='distance since the reversal  [mm]')
        axes.set_title(f'{label}: rms {score.held_out_rms:.0f} N')
    panels[0].set(ylabel='held-out residual  [kN]')
    return as_svg(figure, name, 'residual on sweeps held out over the distance since the reversal, before and after')


def _residual(axes: Axes, motion: Motion, score: CrossValidation) -> None:
    for sense, colour, label in ((1, _RISING, 'rising'), (-1, _FALLING, 'falling')):
        first = True
        for k in np.flatnonzero(motion.sense[motion.edges[:-1]] == sense):
            if k == 0:
                continue
            rows = slice(motion.edges[k], motion.edges[k + 1])
            distance = _MILLI * motion.distance[rows]
            axes.plot(distance, _KILO * score.held_out[rows], color=colour, lw=0.8, label=label if first else None)
            first = False
    _legend(axes)


def prediction_picture(analysis: HysteresisAnalysis, name: str) -> Markup:
    """Each record as predicted from the others."""
    columns = len(analysis.leave_one_out)
    figure = Figure(figsize=(WIDTH / 72, 330 / 72), dpi=72, layout='constrained')
    panels = figure.subplots(1, columns, squeeze=False)[0]
    for axes, each in zip(panels, analysis.leave_one_out, strict=True):
        motion = analysis.records[each.record].motion
        rows = motion.sweep >= IDENTIFICATION_SWEEPS
        _both(axes, motion, each.residual, rows)
        axes.set(xlabel='displacement  [mm]')
        axes.set_title(f'{each.tension:g} from the others: rms {each.by_tension:.0f} N')
    panels[0].set(ylabel='force  [kN]')
    return as_svg(figure, name, 'force over displacement of each record, measured and predicted from the others')


def _both(axes: Axes, motion: Motion, residual: Floats, rows: Rows) -> None:
    displacement, force = _MILLI * motion.displacement[rows], _KILO * motion.force[rows]
    axes.plot(displacement, force, color=INK, lw=0.8, label='measured')
    axes.plot(displacement, force - _KILO * residual[rows], color=_AFTER, lw=1.4, label='predicted')
    _legend(axes)


def _panels(height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH / 72, height / 72), dpi=72, layout='constrained')
    return figure, list(figure.subplots(1, 2, sharey=True))


def _legend(axes: Axes) -> None:
    axes.legend(frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.15), ncols=3, handlelength=1.4)
