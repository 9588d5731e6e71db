"""The result of `contour`: what its page, its text and its JSON hold."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from scara_kinetostatic.contour.fits import ShapeFit
from scara_kinetostatic.contour.result import EXPECTED, Contour
from scara_kinetostatic.model.parameters import IN_MICRO, IN_MILLI
from scara_kinetostatic.model.quantities import FIT_UNITS, count, shown
from scara_kinetostatic.report.figure import SERIES, Margins, as_svg, new_figure
from scara_kinetostatic.report.page import Document, Figure, Note, Report, Section, Table, Verdict

_WIDTH = 920.0
"""Of the picture, pixels."""


def contour_report(contour: Contour, fits: Sequence[ShapeFit], calibration: str) -> Report:
    """What was measured, for the terminal and for `contour.html`.

    Args:
        contour: what was measured.
        fits: shapes through its outlines.
        calibration: name of the file of the calibration.
    """
    std, common = (IN_MICRO * float(np.nanmedian(each)) for each in (contour.std_normal, contour.std_systematic))
    first = contour.outlines[0]
    form = 'Closed outline' if first.closed else 'Open outline'
    more = f', and {count(len(contour.outlines) - 1, "other")}' if len(contour.outlines) > 1 else ''
    headline = f'{form} of {IN_MILLI * first.length:.1f} mm{more}, ± {2 * std:.0f} µm along its normal'
    seen = 'The surface in the base frame of the robot. '
    seen += f'The radius of the tip, {IN_MILLI * contour.tip_radius:.3f} mm, is taken off along the normal.'
    of_which = f'Standard uncertainty along the normal, {std:.1f} µm (median), of which {common:.1f} µm are common to '
    of_which += 'neighbouring points: calibration and radius of the tip. Noise of joint angles and force is the rest.'
    figures = Figure(partial(outline_picture, contour), seen), Note(of_which)
    return Report(
        title='Contour of an object by touch',
        answer=Verdict(headline, 'caution' if contour.warnings else 'good', _sentences(contour)),
        source=f'{contour.source}, with the calibration {calibration}',
        blocks=(Section('Outline', figures, shown='page'), *fit_sections(fits)),
        remarks=contour.warnings,
        footer='every point in contour.csv, the outlines in contour.svg and contour.dxf',
    )


def _sentences(contour: Contour) -> tuple[str, ...]:
    """What the recording holds, and friction."""
    low, high = np.quantile(np.hypot(*contour.force.T), (EXPECTED, 1 - EXPECTED))
    held = f'{count(len(contour), "point")} in {count(int(contour.passes.max()) + 1, "pass", "passes")}'
    held += f' under {low:.1f} to {high:.1f} N'
    held += '; ± is the expanded uncertainty (k = 2, about 95 %), median of all points.'
    coefficient, std, rotation, rotation_std = contour.friction
    turn, rest = f', apparent rotation of the force sensor {shown(rotation, rotation_std, "rad", FIT_UNITS).text}', '.'
    if np.isnan(rotation):
        turn, rest = '', ', if the force sensor is not turned: travel in one direction cannot distinguish the two. '
        rest += 'The normals come from the path of the tip and need neither.'
    return (held, f'Coefficient of friction {coefficient:.3f} ± {std:.3f}{turn} (standard uncertainty){rest}')


def fit_sections(fits: Sequence[ShapeFit]) -> list[Section]:
    """A table for the fits of one shape to one outline, a row for each, and what does not fit."""
    sections = []
    for outline, shape in dict.fromkeys((fit.outline, fit.shape) for fit in fits):
        rows, remarks = [], []
        own = [fit for fit in fits if (fit.outline, fit.shape) == (outline, shape)]
        for fit in own:
            name, values = 'the outline' if fit.piece is None else f'piece {fit.piece + 1}', []
            for item in fit.values.values():
                values.append(shown(*item, FIT_UNITS)._replace(unit='').text)
            rows.append((name, *values, f'{IN_MICRO * fit.rms:.1f}', f'{IN_MICRO * fit.largest:.1f}'))
            if not fit.fits:
                remark = f'Remark: {name} is no {shape}: the residuals are {fit.misfit:.0f} times the uncertainty of'
                remarks.append(f'{remark} the points (rms); the parameters and their uncertainties do not describe it.')
        heading = ('fit', *(name.replace('_', ' ') for name in own[0].values), 'rms', 'largest')
        units = ('', *(FIT_UNITS[item.unit].unit for item in own[0].values.values()), 'µm', 'µm')
        sections.append(Section(f'Outline {outline + 1}: {shape}', (Table(heading, units, tuple(rows)), *remarks)))
    return sections


def contour_document(contour: Contour, fits: Sequence[ShapeFit]) -> Document:
    """The contour as data, without its points."""
    friction = ('coefficient', 'std', 'sensor_rotation', 'sensor_rotation_std')
    fitted = []
    for fit in fits:
        found = {key: getattr(fit, key) for key in ('shape', 'outline', 'piece', 'values')}
        residual = {'residual': {'rms': fit.rms, 'largest': fit.largest}, 'misfit': fit.misfit, 'fits': fit.fits}
        fitted.append(found | residual)
    return {
        'schema': 'scara_kinetostatic/contour/1',
        'source': contour.source,
        'points': len(contour),
        'passes': int(contour.passes.max()) + 1,
        'tip_radius': contour.tip_radius,
        'std_normal': {'median': np.nanmedian(contour.std_normal), 'worst': np.nanmax(contour.std_normal)},
        'friction': dict(zip(friction, contour.friction, strict=True)),
        'outlines': [
            {'closed': o.closed, 'length': o.length, 'nodes': len(o.points), 'passes': o.passes}
            for o in contour.outlines
        ],
        'fits': fitted,
        'warnings': contour.warnings,
    }


def outline_picture(contour: Contour) -> Markup:
    """The outlines from above, in the base frame."""
    points = np.concatenate([outline.points for outline in contour.outlines])
    low, high = points.min(axis=0), points.max(axis=0)
    span = float((high - low).max())
    size = np.maximum(high - low, 0.2 * span) + 0.24 * span
    height = _WIDTH * min(float(size[1] / size[0]), 0.75)
    figure, (axes,) = new_figure(_WIDTH, height, margins=Margins())
    for outline in contour.outlines:
        x, y = IN_MILLI * outline.ring.T
        if outline.closed:
            axes.fill(x, y, color=SERIES[0], alpha=0.1, lw=0)
        axes.plot(x, y, color=SERIES[0], lw=1.6)
    axes.set(xlabel='x  [mm]', ylabel='y  [mm]', aspect='equal', adjustable='datalim')
    return as_svg(figure, 'outline', 'the outline from above')
