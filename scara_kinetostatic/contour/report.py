"""The result of `contour`: what its page, its text and its JSON hold."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from scara_kinetostatic.contour import figures
from scara_kinetostatic.contour.fits import ShapeFit, joined_residuals
from scara_kinetostatic.contour.result import Contour, Friction
from scara_kinetostatic.contour.trace import shifts_along_normal, surfaces_of
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.report.content import Figure, Report, Section, Verdict
from scara_kinetostatic.report.json_file import Document
from scara_kinetostatic.report.quantities import PAGE_UNITS, count, shown
from scara_kinetostatic.report.table import Table

_MILLI, _MICRO = 1e3, 1e6


def contour_report(contour: Contour, arm: CalibratedArm, fits: Sequence[ShapeFit], calibration: str) -> Report:
    """What was measured, for the terminal and for `contour.html`.

    Args:
        contour: what was measured.
        arm: with what.
        fits: shapes through its outlines.
        calibration: name of the file of the calibration.
    """
    return Report(
        title='Contour of an object by touch',
        answer=Verdict(_headline(contour), 'caution' if contour.warnings else 'good', _sentences(contour)),
        source=f'{contour.source}, with the calibration {calibration}',
        blocks=(*_page_sections(contour, arm), *fit_sections(contour, fits)),
        remarks=tuple(contour.warnings),
        footer='every point in contour.csv, the outlines in contour.svg and contour.dxf',
    )


def _headline(contour: Contour) -> str:
    first = contour.outlines[0]
    form = 'Closed outline' if first.closed else 'Open outline'
    expanded = 2 * _MICRO * float(np.nanmedian(contour.std_normal))
    more = f', and {count(len(contour.outlines) - 1, "other")}' if len(contour.outlines) > 1 else ''
    return f'{form} of {_MILLI * first.length:.1f} mm{more}, ± {expanded:.0f} µm along its normal'


def _sentences(contour: Contour) -> tuple[str, ...]:
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
    return (*lines, _friction_sentence(contour.friction))


def _friction_sentence(friction: Friction) -> str:
    value = f'{friction.coefficient:.3f} ± {friction.std:.3f}'
    if friction.both_directions:
        turn = shown(friction.rotation, friction.rotation_std, 'rad', PAGE_UNITS).text
        return f'Coefficient of friction {value}, apparent rotation of the force sensor {turn} (standard uncertainty).'
    return (
        f'Coefficient of friction {value} (standard uncertainty), if the force sensor is not turned: travel in one '
        'direction cannot distinguish the two. The normals come from the path of the tip and need neither.'
    )


def _page_sections(contour: Contour, arm: CalibratedArm) -> list[Section]:
    surfaces = surfaces_of(contour, arm)
    nominal, rigid, _ = (_MILLI * rms(shift) for shift in shifts_along_normal(contour, surfaces))
    std, common = (_MICRO * float(np.nanmedian(each)) for each in (contour.std_normal, contour.std_systematic))
    outline = Figure(
        partial(figures.outline_picture, contour),
        'The surface in the base frame of the robot; arrows: force of the tip on the object. The radius of the tip, '
        f'{_MILLI * contour.tip_radius:.3f} mm, is taken off along the normal.',
    )
    comparison = Figure(
        partial(figures.comparison_picture, contour, surfaces),
        'The surface by the rigid models, relative to that of the deformable calibrated model, along the normal; '
        'positive: outside.',
    )
    quality = Figure(
        partial(figures.quality_picture, contour),
        'Above: standard uncertainty along the normal. Below: angle from the normal to the force, towards the '
        'direction of travel; dashed: friction angle.',
    )
    changed = (
        f'Without deflection the calibrated arm would put the surface {rigid:.3f} mm off (rms), the nominal arm '
        f'{nominal:.3f} mm.'
    )
    uncertain = (
        f'Standard uncertainty along the normal {std:.1f} µm (median), of which {common:.1f} µm are common to '
        'neighbouring points: calibration and radius of the tip. Noise of joint angles and force is the rest.'
    )
    return [
        Section('Outline', (outline,), shown='page'),
        Section('What the calibration and the compensation of the deflection change', (changed, comparison), 'page'),
        Section('Uncertainty and friction', (uncertain, quality), 'page'),
    ]


def fit_sections(contour: Contour, fits: Sequence[ShapeFit]) -> list[Section]:
    """The fits with their residuals, those of pieces of the same kind and outline together."""
    groups: list[tuple[tuple[ShapeFit, ...], str, Table]] = [
        ((fit,), f'{fit.shape.capitalize()} through outline {fit.outline + 1}', fit_table(fit))
        for fit in fits
        if fit.piece is None or fit.shape == 'circle'
    ]
    pieces = [fit for fit in fits if fit.piece is not None and fit.shape != 'circle']
    for outline, shape in dict.fromkeys((fit.outline, fit.shape) for fit in pieces):
        own = tuple(fit for fit in pieces if (fit.outline, fit.shape) == (outline, shape))
        groups.append((own, f'{shape.capitalize()}s of outline {outline + 1}', piece_table(own)))
    return [
        Section(
            title,
            (
                table,
                *(_misfit(fit) for fit in own if not fit.fits),
                Figure(
                    partial(figures.residual_picture, contour, joined_residuals(own), f'fit{number}'),
                    'Distance of the points from the fit along the normal, outside positive; grey: two standard '
                    'uncertainties of a point.',
                ),
            ),
        )
        for number, (own, title, table) in enumerate(groups)
    ]


def _misfit(fit: ShapeFit) -> str:
    what = 'the outline' if fit.piece is None else f'piece {fit.piece + 1}'
    return (
        f'Remark: {what} is no {fit.shape}: the residuals are {fit.misfit:.0f} times the uncertainty of the points '
        '(rms); the parameters and their uncertainties do not describe it.'
    )


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
        rows.append((str((fit.piece or 0) + 1), *values, f'{_MICRO * fit.rms:.1f}', f'{_MICRO * fit.largest:.1f}'))
    heading = ('piece', *(name.replace('_', ' ') for name in names), 'rms', 'largest')
    return Table(heading, ('', *scale, 'µm', 'µm'), tuple(rows))


def contour_document(contour: Contour, fits: Sequence[ShapeFit]) -> Document:
    """The contour as data, without its points."""
    f = contour.friction
    return {
        'schema': 'scara_kinetostatic/contour/1',
        'source': contour.source,
        'points': len(contour),
        'passes': int(contour.passes.max()) + 1,
        'tip_radius': contour.tip_radius,
        'std_normal': {'median': np.nanmedian(contour.std_normal), 'worst': np.nanmax(contour.std_normal)},
        'friction': {
            'coefficient': f.coefficient,
            'std': f.std,
            'sensor_rotation': f.rotation,
            'sensor_rotation_std': f.rotation_std,
        },
        'outlines': [
            {'closed': o.closed, 'length': o.length, 'nodes': len(o.points), 'passes': o.passes}
            for o in contour.outlines
        ],
        'left_out': {'no_sliding': contour.stuck, 'no_contact': contour.lost},
        'fits': [
            {
                'shape': fit.shape,
                'outline': fit.outline,
                'piece': fit.piece,
                'values': {v.name: {'value': v.value, 'std': v.std, 'unit': v.unit} for v in fit.values},
                'residual': {'rms': fit.rms, 'largest': fit.largest},
                'misfit': fit.misfit,
                'fits': fit.fits,
            }
            for fit in fits
        ],
        'warnings': contour.warnings,
    }
