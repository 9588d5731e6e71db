"""Outline of an unknown object from a slide along it.

Measures the outline of an object of unknown shape, from a recording in which
the tip slides along it under force. Deflection and backlash of the arm
are taken out by the calibrated model, the radius of the tip along the measured
normal; friction, lost contact and stick are considered; several passes are
joined and closed outlines closed. Writes into DIR

  contour.csv    time_s,x_m,y_m,nx,ny,std_normal_m,force_N: every point of the
                 surface, its outward normal, standard uncertainty along it
  contour.svg    the outlines in mm
  contour.dxf    the same as polylines (release 12, mm)
  contour.html   a page with figures

The recording begins and ends with free motion: it gives the force zero.

Example:
  scara-kinetostatic contour slide --calibration result/calibration.json --out contour
  scara-kinetostatic contour slide --calibration result/calibration.json --cell cell.yaml --fit circle --out contour
  scara-kinetostatic contour slide --calibration result/calibration.json --fit pieces --out contour
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from scara_kinetostatic.cli.shared_arguments import JSON, MAX_BYTES, SEVERAL, out_option, print_result, real
from scara_kinetostatic.errors import InputError, UnsupportedDataError

_CELL = 'topics, frame and sign of the sensor, radius of the tip (default: as in the calibration)'
_FIT = 'fit this shape to every outline; pieces: split it into lines and arcs and fit each; repeatable'
ARGUMENTS = (
    ('bag', 'BAG', Path, 'recording of joint states and wrenches'),
    ('--calibration', 'FILE', Path, 'calibration.json of this robot', {'required': True}),
    ('--cell', 'FILE', Path, _CELL),
    ('--tip-radius', 'M', real(0), 'radius of the tip, m (default: as the cell states it)'),
    ('--fit', '', ('pieces', 'circle', 'line'), _FIT, SEVERAL),
    out_option(required=True),
    JSON,
    MAX_BYTES,
)


def run(args: argparse.Namespace) -> None:
    """Measures the contour.

    Raises:
        InputError: the recording, the calibration or the cell is wrong, or DIR cannot be written.
        UnsupportedDataError: the tip touches nothing, does not slide, or jumps.
    """
    from scara_kinetostatic.bags.reader import read_streams
    from scara_kinetostatic.contour.fits import ShapeFit, fit_pieces, fit_shape
    from scara_kinetostatic.contour.report import contour_document, contour_report
    from scara_kinetostatic.contour.result import CSV, DXF, SVG, csv_text, dxf_text, svg_text
    from scara_kinetostatic.contour.trace import trace_contour
    from scara_kinetostatic.files.calibration_file import load_calibration
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.monitoring.record import check_same_arm, check_same_recorded
    from scara_kinetostatic.report.page import as_page, as_text

    arm = load_calibration(args.calibration)
    cell = load_cell(args.cell) if args.cell else arm.cell
    check_same_arm(arm.cell, cell, str(args.calibration), str(args.cell))
    if args.bag.resolve() == args.out.resolve():
        raise InputError(args.out, 'is the recording', 'choose another folder for --out')
    if args.cell is None:
        check_same_recorded(arm.cell, args.bag, str(args.calibration))
    radius = cell.tip_radius if args.tip_radius is None else args.tip_radius
    contour = trace_contour(read_streams(args.bag, cell), arm, cell.sensor, radius)
    fits: list[ShapeFit] = []
    failed: list[str] = []
    for shape in dict.fromkeys(args.fit):
        for number in range(len(contour.outlines)):
            try:
                if shape == 'pieces':
                    fits += fit_pieces(contour, arm, number)
                else:
                    fits.append(fit_shape(contour, arm, shape, number))
            except UnsupportedDataError as error:
                failed.append(f'no {shape} through outline {number + 1}: {error.problem}')
    contour = replace(contour, warnings=(*contour.warnings, *failed))
    report = contour_report(contour, fits, str(args.calibration))
    files = {
        CSV: csv_text(contour),
        SVG: svg_text(contour.outlines),
        DXF: dxf_text(contour.outlines),
        'contour.html': as_page(report),
    }
    document = contour_document(contour, fits)
    print_result(as_text(report), args.out, files, document if args.json else None)
