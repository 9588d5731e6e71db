"""A contour in words and numbers: for the terminal, and the sentences of its page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.fits import ShapeFit, joined_residuals
from scara_kinetostatic.contour.result import Contour, Friction
from scara_kinetostatic.render.json_file import Document
from scara_kinetostatic.render.quantities import PAGE_UNITS, count, shown
from scara_kinetostatic.render.table import Table

SCHEMA = 'scara_kinetostatic/contour/1'
_MILLI, _MICRO = 1e3, 1e6
COVERAGE_FACTOR = 2.0
"""k of the expanded uncertainty: about 95 %."""


def headline(contour: Contour) -> str:
    """What was found, in one line."""
    first = contour.outlines[0]
    form = 'Closed outline' if first.closed else 'Open outline'
    expanded = COVERAGE_FACTOR * _MICRO * float(np.nanmedian(contour.std_normal))
    more = f', and {count(len(contour.outlines) - 1, "other")}' if len(contour.outlines) > 1 else ''
    return f'{form} of {_MILLI * first.length:.1f} mm{more}, ± {expanded:.0f} µm along its normal'


def sentences(contour: Contour) -> list[str]:
    """What the recording holds and what was cut out."""
    size = np.hypot(*contour.force.T)
    low, high = np.quantile(size, (0.05, 0.95))
    lines = [
        f'{count(len(contour), "point")} in {count(int(contour.passes.max()) + 1, "pass", "passes")} under '
        f'{low:.1f} to {high:.1f} N; ± is the expanded uncertainty (k = 2, about 95 %), median of all points.'
    ]
    cut = [(contour.stuck, 'the tip did not slide'), (contour.lost, 'contact was lost')]
    parts = [f'{seconds:.2f} s in which {what}' for seconds, what in cut if seconds > 0]
    if parts:
        lines.append(f'Left out: {" and ".join(parts)}.')
    lines.append(friction_sentence(contour.friction))
    return lines


def friction_sentence(friction: Friction) -> str:
    """What the forces say of friction."""
    value = f'{friction.coefficient:.3f} ± {friction.std:.3f}'
    if friction.both_directions:
        turn = shown(friction.rotation, friction.rotation_std, 'rad', PAGE_UNITS).text
        return f'Coefficient of friction {value}, apparent rotation of the force sensor {turn} (standard uncertainty).'
    return (
        f'Coefficient of friction {value} (standard uncertainty), if the force sensor is not turned: travel in one '
        'direction cannot distinguish the two. The normals come from the path of the tip and need neither.'
    )


class FitSection(NamedTuple):
    """What is shown of one fit, or of all lines or arcs of an outline.

    Attributes:
        title: what was fitted.
        table: its values.
        remarks: one sentence each.
        fit: with the residuals of all its points.
    """

    title: str
    table: Table
    remarks: list[str]
    fit: ShapeFit


def fit_sections(fits: Sequence[ShapeFit]) -> list[FitSection]:
    """The fits, those of pieces of the same kind and outline together."""
    alone = [fit for fit in fits if fit.piece is None or fit.shape == 'circle']
    sections = [
        FitSection(f'{fit.shape.capitalize()} through outline {fit.outline + 1}', fit_table(fit), fit_remarks(fit), fit)
        for fit in alone
    ]
    pieces = [fit for fit in fits if fit.piece is not None and fit.shape != 'circle']
    for outline, shape in dict.fromkeys((fit.outline, fit.shape) for fit in pieces):
        own = [fit for fit in pieces if (fit.outline, fit.shape) == (outline, shape)]
        remarks = [remark for fit in own for remark in fit_remarks(fit)]
        title = f'{shape.capitalize()}s of outline {outline + 1}'
        sections.append(FitSection(title, piece_table(own), remarks, joined_residuals(own)))
    return sections


def fit_table(fit: ShapeFit) -> Table:
    """The parameters of a fit."""
    rows = []
    for item in fit.values:
        value, std, unit = shown(item.value, item.std, item.unit, PAGE_UNITS)
        rows.append((item.name.replace('_', ' '), f'{value} ± {std}' if std else value, unit))
    rows.append(('residuals, rms', f'{_MICRO * fit.rms:.1f}', 'µm'))
    rows.append(('residuals, largest', f'{_MICRO * fit.largest:.1f}', 'µm'))
    return Table(('quantity', 'value', 'unit'), ('',) * 3, tuple(rows))


def piece_table(fits: Sequence[ShapeFit]) -> Table:
    """The parameters of pieces of one shape, a row for each."""
    names = [item.name for item in fits[0].values]
    scale = [PAGE_UNITS[item.unit].unit for item in fits[0].values]
    rows = []
    for fit in fits:
        cells = [shown(item.value, item.std, item.unit, PAGE_UNITS) for item in fit.values]
        values = [f'{value} ± {std}' if std else f'{value}' for value, std, _ in cells]
        rows.append((_piece(fit), *values, f'{_MICRO * fit.rms:.1f}', f'{_MICRO * fit.largest:.1f}'))
    heading = ('piece', *(name.replace('_', ' ') for name in names), 'rms', 'largest')
    return Table(heading, ('', *scale, 'µm', 'µm'), tuple(rows))


def _piece(fit: ShapeFit) -> str:
    return '' if fit.piece is None else str(fit.piece + 1)


def fit_remarks(fit: ShapeFit) -> list[str]:
    """That the points are not on the shape; empty where they are."""
    if fit.fits:
        return []
    what = 'the outline' if fit.piece is None else f'piece {fit.piece + 1}'
    return [
        f'{what} is no {fit.shape}: the residuals are {fit.misfit:.0f} times the uncertainty of the points (rms); '
        'the parameters and their uncertainties do not describe it'
    ]


def text(contour: Contour, fits: Sequence[ShapeFit]) -> str:
    """The contour for a terminal."""
    parts = [headline(contour), *sentences(contour), *(f'Remark: {warning}' for warning in contour.warnings)]
    for section in fit_sections(fits):
        parts += ['', section.title, *section.table.lines()]
        parts += [f'Remark: {remark}.' for remark in section.remarks]
    return '\n'.join(parts)


def document(contour: Contour, fits: Sequence[ShapeFit]) -> Document:
    """The contour as plain JSON values, without its points."""
    f = contour.friction
    return {
        'schema': SCHEMA,
        'source': contour.source,
        'points': len(contour),
        'passes': int(contour.passes.max()) + 1,
        'tip_radius': contour.tip_radius,
        'std_normal': {
            'median': float(np.nanmedian(contour.std_normal)),
            'worst': float(np.nanmax(contour.std_normal)),
        },
        'friction': {
            'coefficient': _number(f.coefficient),
            'std': _number(f.std),
            'sensor_rotation': _number(f.rotation),
            'sensor_rotation_std': _number(f.rotation_std),
        },
        'outlines': [
            {'closed': o.closed, 'length': o.length, 'nodes': len(o.points), 'passes': list(o.passes)}
            for o in contour.outlines
        ],
        'left_out': {'no_sliding': contour.stuck, 'no_contact': contour.lost},
        'fits': [
            {
                'shape': fit.shape,
                'outline': fit.outline,
                'piece': fit.piece,
                'values': {v.name: {'value': v.value, 'std': _number(v.std), 'unit': v.unit} for v in fit.values},
                'residual': {'rms': fit.rms, 'largest': fit.largest},
                'misfit': fit.misfit,
                'fits': fit.fits,
            }
            for fit in fits
        ],
        'warnings': list(contour.warnings),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
