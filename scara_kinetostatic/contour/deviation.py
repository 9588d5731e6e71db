"""How far a traced outline lies from the object of the cell along which the tip slid.

Nothing is fitted: both stand where calibration and cell description place them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.arrays import Floats, Indices, rms
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.outline import surfaces_of

NEAR = 5e-3
"""Most of an outline is no farther than this from the object that it is of, m; points beyond are not of the object."""


class Deviation(NamedTuple):
    """How far the points of an outline lie from an object of the cell.

    Attributes:
        outline: its number in the contour.
        object: name of the object.
        points: numbers of those points of the contour that are next to the object, (n,).
        distance: from the object, outside positive, (n,), m.
        std: standard uncertainty of each by the measurement, (n,), m; NaN where the calibration does not determine it.
        misfit: root mean square of the distances in standard uncertainties; about 1 where the object is as stated.
    """

    outline: int
    object: str
    points: Indices
    distance: Floats
    std: Floats
    misfit: float

    @property
    def rms(self) -> float:
        """Root mean square of the distances, m."""
        return rms(self.distance)

    @property
    def largest(self) -> int:
        """Place of the largest distance among the points."""
        return int(np.abs(self.distance).argmax())


def deviations(contour: Contour, cell: Cell) -> tuple[Deviation, ...]:
    """The deviations of those outlines that lie along an object of the cell, in their order.

    The centre of the tip is compared with the object grown by the radius of the tip: so an error of the normal does not
    count.

    Args:
        contour: the measured surface.
        cell: with the objects as stated; the radii of its discs contain `Cell.tip_radius`.
    """
    radius, found = contour.tip_radius, list[Deviation]()
    change = radius - (cell.tip_radius or 0.0)
    objects = [item._replace(radius=item.radius + change) if isinstance(item, Disc) else item for item in cell.discs]
    each = [surfaces_of([item], radius) for item in objects]
    for number, outline in enumerate(contour.outlines):
        nodes = outline.points + radius * outline.normals
        away = [float(np.median(surfaces.distances(nodes).min(axis=1))) for surfaces in each]
        nearest = int(np.argmin(away))
        if away[nearest] > NEAR:
            continue
        points, surfaces = np.flatnonzero(np.isin(contour.passes, outline.passes)), each[nearest]
        tips = contour.surface[points] + radius * contour.normal[points]
        distance, gap = surfaces.distances(tips), surfaces.gaps(tips)
        rows = np.arange(len(points)), distance.argmin(axis=1)
        distance, gap = distance[rows], gap[rows]
        beside = (distance < NEAR) & (distance < np.abs(gap) + 1e-9)  # not past an open end
        if beside.any():
            points, off = points[beside], gap[beside]
            misfit = rms(off / np.maximum(contour.stretch(points).weighing, 1e-12))
            found.append(Deviation(number, objects[nearest].name, points, off, contour.std_normal[points], misfit))
    return tuple(found)


def of_all_points(contour: Contour, found: Iterable[Deviation]) -> Floats:
    """The distance of each point of a contour, (N,), m; NaN of those that are not next to an object."""
    distance = np.full(len(contour), np.nan)
    for deviation in found:
        distance[deviation.points] = deviation.distance
    return distance
