"""`contour.html`: one self-contained page with the outline, its uncertainty and the fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scara_kinetostatic import __version__
from scara_kinetostatic.contour.fits import ShapeFit
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.contour.trace import shifts_along_normal, surfaces_of
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.render.figure import style
from scara_kinetostatic.render.page import page_template
from scara_kinetostatic.report import contour_figures as figures
from scara_kinetostatic.report import contour_text as text

NAME = 'contour.html'
_TEMPLATE = Path(__file__).parent / 'contour.html.j2'


def html_text(contour: Contour, arm: CalibratedArm, fits: Sequence[ShapeFit], calibration: str) -> str:
    """The page.

    Args:
        contour: what was measured.
        arm: with what.
        fits: shapes through its outlines.
        calibration: name of the file of the calibration.
    """
    surfaces = surfaces_of(contour, arm)
    shifts = [1e3 * rms(shift) for shift in shifts_along_normal(contour, surfaces)]
    with style():
        return page_template(_TEMPLATE).render(
            version=__version__,
            source=contour.source,
            calibration=calibration,
            headline=text.headline(contour),
            sentences=text.sentences(contour),
            warnings=contour.warnings,
            outline=figures.outline_picture(contour),
            shifts=shifts,
            comparison=figures.comparison_picture(contour, surfaces),
            quality=figures.quality_picture(contour),
            std=(1e6 * float(np.nanmedian(contour.std_normal)), 1e6 * float(np.nanmedian(contour.std_systematic))),
            tip_radius=1e3 * contour.tip_radius,
            fits=[
                (
                    section.title,
                    section.table,
                    section.remarks,
                    figures.residual_picture(contour, section.fit, f'fit{number}'),
                )
                for number, section in enumerate(text.fit_sections(fits))
            ],
        )
