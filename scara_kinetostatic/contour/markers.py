"""A traced contour as geometric primitives: outlines, their uncertainty, known objects, the tip and its force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.contour.joining import Outline
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.files.urdf import CALIBRATED_COLOUR, Colour
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.outline import Outline as KnownOutline
from scara_kinetostatic.model.parameters import quantity
from scara_kinetostatic.report.markers import FOUND, TEXT, Primitive, Shape, label, object_markers, places
from scara_kinetostatic.touches.signals import runs

_BOUND: Colour = (*CALIBRATED_COLOUR[:3], 0.5)
_ABOVE = 0.012
"""Height at which a contour is drawn, m: above the objects."""


def outline_markers(outlines: Iterable[Outline], uncertainty_scale: float) -> list[Primitive]:
    """The outlines, and on both sides of each the bounds of its expanded uncertainty (k = 2), magnified.

    There are no bounds where the uncertainty is not known.
    """
    made = []
    for outline in outlines:
        ring = outline.ring
        closing = [*range(len(outline.points)), 0][: len(ring)]
        made.append(Primitive('outlines', Shape.STRIP, places(ring, _ABOVE), CALIBRATED_COLOUR, 0.002))
        expanded = COVERAGE_FACTOR * outline.std[closing]
        away = uncertainty_scale * expanded[:, None] * outline.normals[closing]
        for bound in (ring + away, ring - away):
            for begin, end in zip(*runs(np.asarray(np.isfinite(bound).all(axis=1))), strict=True):
                part = places(bound[begin : end + 1], _ABOVE)
                made += [Primitive('uncertainty', Shape.STRIP, part, _BOUND, 0.0008)] if end > begin else []
        if np.isfinite(expanded).any() and uncertainty_scale > 0:
            text = f'±{quantity(float(np.nanmedian(expanded)), "m")} (k = 2), × {uncertainty_scale:g}'
            x, y = outline.points[outline.points[:, 1].argmin()].tolist()
            made.append(label('uncertainty', (x, y - 0.03), text, TEXT))
    return made


def known_markers(discs: Sequence[Disc | KnownOutline], tip_radius: float) -> list[Primitive]:
    """The objects of the cell, as large as their surfaces; a disc is described by the place of the tip's centre."""
    return object_markers(
        [
            disc._replace(radius=disc.radius - tip_radius) if isinstance(disc, Disc) else disc
            for disc in discs
            if disc.radius > tip_radius
        ]
    )


def tip_markers(contour: Contour | None, force_scale: float) -> list[Primitive]:
    """The last place on the surface with the force of the tip there; none without contact."""
    if contour is None:
        return []
    at, force = contour.surface[-1], contour.force[-1]
    arrow = places([at - force_scale * force, at], _ABOVE)
    dot = Primitive('tip', Shape.DOT, places([at], _ABOVE), FOUND, 0.006)
    return [dot, Primitive('tip', Shape.ARROW, arrow, FOUND, 0.003)]
