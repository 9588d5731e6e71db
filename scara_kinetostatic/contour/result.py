"""A measured contour: points of the surface with their normals and uncertainties, and the outlines that they make.

**Friction** is the angle from the normal of the surface to the force, in the direction of travel. With Coulomb friction
the tip pushes the object along its travel with μ N, so that the angle is atan μ whatever the direction. A force sensor
that is turned by ρ, counter-clockwise, adds ρ where travel is clockwise about the object, -ρ else: travel in both
directions separates the two, travel in one direction does not.

**Files.** The CSV holds every point in the order of time, the drawings hold the passes joined to outlines. A DXF of
release 12 with POLYLINE entities is read by every CAD program; it has no entry for the unit, which is the millimetre
here, as in the SVG.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.contour.joining import Outline, Stretch, join_passes
from scara_kinetostatic.files.columns import csv_lines
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.plane import Plane


class Friction(NamedTuple):
    """What the forces of a slide say of friction.

    Attributes:
        coefficient: μ; NaN where nothing is known.
        std: its standard uncertainty.
        rotation: apparent rotation of the force sensor, rad; NaN where travel is in one direction only.
        rotation_std: its standard uncertainty, rad.
    """

    coefficient: float
    std: float
    rotation: float
    rotation_std: float


def off_normal_angle(force: Floats, normal: Floats, along: Floats) -> Floats:
    """Angle from the inward normal to the force, positive towards the direction of travel, (n,), rad."""
    return np.asarray(np.arctan2((force * along).sum(axis=1), -(force * normal).sum(axis=1)))


def estimate_friction(
    force: Floats, normal: Floats, along: Floats, passes: Indices, angle_std: float, sensor_std: float
) -> Friction:
    """The coefficient of friction and, if possible, the rotation of the force sensor.

    Args:
        force: F on the object, (n, 2), N.
        normal: outward, (n, 2).
        along: direction of travel, (n, 2).
        passes: number of the pass, (n,).
        angle_std: standard deviation of the angle of the force in one pass, by its noise, rad.
        sensor_std: declared standard uncertainty of the rotation of the sensor, rad.
    """
    angle = off_normal_angle(force, normal, along)
    sense = np.sign(normal[:, 0] * along[:, 1] - normal[:, 1] * along[:, 0])
    each = [passes == number for number in np.unique(passes)]
    turns = np.array([np.median(angle[here]) for here in each])
    is_ahead = np.array([sense[here].sum() > 0 for here in each])
    ahead, back = turns[is_ahead], turns[~is_ahead]
    if len(ahead) and len(back):
        turn, rotation = (float(0.5 * (back.mean() + sign * ahead.mean())) for sign in (1, -1))
        std = rotation_std = 0.5 * angle_std * float(np.sqrt(1 / len(ahead) + 1 / len(back)))
    else:
        turn, rotation, rotation_std = float(turns.mean()), np.nan, np.nan
        std = float(np.hypot(angle_std / np.sqrt(len(turns)), sensor_std))
    return Friction(float(np.tan(turn)), std / np.cos(turn) ** 2, rotation, rotation_std)


@dataclass(frozen=True)
class Contour:
    """The surface along which a tip slid, at n instants in the order of time.

    Attributes:
        source: the recording.
        time: since the first stamp of the recording, (n,), s.
        surface: points of the surface, (n, 2), m, base frame.
        normal: outward unit vectors, (n, 2).
        std_systematic: standard uncertainty along the normal by the calibration and the tip, common to neighbouring
            points, (n,), m; NaN where the calibration does not determine it.
        std_noise: that of a point by the noise of the measurement and by its normal, (n,), m.
        force: F of the tip on the object, base frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        passes: number of the pass, (n,).
        by_model: change along the normal by each value of the model, (n, 12 + k).
        by_noise: change along the normal by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 4), m.
        friction: what the forces say of friction.
        inner_corner: whether the surface is hollow there and hardly wider than the tip, (n,): the tip touches on both
            sides, and the outline has its radius.
        tip_radius: m.
        zero: what the sensor reports without force, as it was taken for the last contact, (2,), N.
        lost: time without contact between the first and the last contact, s.
        stuck: time in contact without sliding, s.
        warnings: one sentence each.

    Example:
        >>> import scara_kinetostatic as sk
        >>> arm = sk.CalibratedArm.of_outcome(sk.diagnose('touches.csv', sk.load_cell('cell.yaml')))
        >>> contour = sk.trace_contour('slide.mcap', arm)
        >>> contour.surface.shape == contour.normal.shape == (len(contour), 2)
        True
        >>> bool((contour.std_normal < 2e-5).all())
        True
    """

    source: str
    time: Floats
    surface: Floats
    normal: Floats
    std_systematic: Floats
    std_noise: Floats
    force: Floats
    joints: Floats
    passes: Indices
    by_model: Floats
    by_noise: Floats
    friction: Friction
    inner_corner: Mask
    tip_radius: float
    zero: Floats
    lost: float
    stuck: float
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def std_normal(self) -> Floats:
        """Standard uncertainty along the normal, (n,), m; NaN where the calibration does not determine it."""
        return np.hypot(self.std_systematic, self.std_noise)

    def stretch(self, which: Mask | Indices) -> Stretch:
        """The points that a mask or an array of positions picks, as a part of a pass."""
        return Stretch(self.surface[which], self.normal[which], self.std_normal[which], self.std_noise[which])

    @cached_property
    def outlines(self) -> tuple[Outline, ...]:
        """The passes joined, the longest first."""
        return join_passes([self.stretch(self.passes == k) for k in range(int(self.passes.max()) + 1)])


NO_RADIUS = (
    'the cell description states no radius of the tip (tip: {radius: …}): the outline is that of the centre of the '
    'tip, not of the surface'
)


def remarks_on(contour: Contour, arm: CalibratedArm) -> tuple[str, ...]:
    """Poses beyond the calibration, uncertainties that are not known, assumptions; one sentence each."""
    size, used = np.hypot(*contour.force.T), arm.used
    beyond = (size < 0.5 * used.lowest_force) | (size > 1.1 * used.highest_force)
    other = ~np.isin(posture(arm.model.parameters, contour.joints), used.postures)
    range_of = f'{used.lowest_force:.0f} to {used.highest_force:.0f} N'
    remarks = [
        f'{max(100 * part, 1):.0f} % of the points have {what}'
        for part, allowed, what in (
            (beyond.mean(), 0.05, f'a force beyond that of the calibration, {range_of}: the model is extrapolated'),
            (other.mean(), 0.0, 'an elbow posture without a touch of the calibration'),
            (np.isnan(contour.std_normal).mean(), 0.0, 'no stated uncertainty: the calibration does not determine it'),
        )
        if part > allowed
    ]
    step = np.hypot(*np.diff(contour.surface, axis=0).T)[np.diff(contour.passes) == 0]
    if len(step) and np.median(step) > 1e-3:
        remarks.append(
            f'the points are {1e3 * float(np.median(step)):.1f} mm apart: what lies between is not seen, and edges are '
            'cut off; slide slower or record joint states at a higher rate'
        )
    if contour.inner_corner.any():
        remarks.append(
            'an inner corner is hardly wider than the tip: there the outline has the radius of the tip, the object may '
            'be sharper'
        )
    assumed = Predictor(arm).assumptions
    return (*remarks, *([f'taken, as no recording says it: {assumed}'] if assumed else []), *arm.reservations)


CSV, SVG, DXF = 'contour.csv', 'contour.svg', 'contour.dxf'
COLUMNS = ('time_s', 'x_m', 'y_m', 'nx', 'ny', 'std_normal_m', 'force_N', 'deviation_m')
LAYER = 'CONTOUR'
_MILLI = 1e3


def csv_text(contour: Contour, deviation: Floats, plane: Plane) -> str:
    """The points of the surface in the order of time; their deviation from an object of the cell, (n,), m, or NaN.

    Where the plane is stated the points in the robot's frame follow.
    """
    size = np.hypot(*contour.force.T)
    points = (contour.time, *contour.surface.T, *contour.normal.T, contour.std_normal, size, deviation)
    forms = ('.6f', '.9f', '.9f', '.6f', '.6f', '.3e', '.4f', '.3e')
    columns = list(zip(COLUMNS, forms, points, strict=True))
    if plane.is_stated:
        names = ('robot_x_m', 'robot_y_m', 'robot_z_m')
        columns += zip(names, ('.9f',) * 3, plane.in_robot(contour.surface).T, strict=True)
    return csv_lines({name: [f'{value:{form}}' for value in values.tolist()] for name, form, values in columns})


def svg_text(outlines: Iterable[Outline]) -> str:
    """The outlines in millimetres, y upwards; printed in their size."""
    nodes = [(_MILLI * outline.points, outline.closed) for outline in outlines]
    points = np.concatenate([own for own, _ in nodes])
    low, high = points.min(axis=0), points.max(axis=0)
    frame = 0.05 * float((high - low).max()) or 1.0  # blank border
    width, height = high - low + 2 * frame
    left, top = low[0] - frame, high[1] + frame
    paths = ''
    for own, closed in nodes:
        pairs = (f'{x - left:.4f} {top - y:.4f}' for x, y in own.tolist())
        paths += f'<path d="M{" L".join(pairs)}{" Z" if closed else ""}"/>\n'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">\n'
        f'<desc>Contour in millimetres; the upper left corner is at x = {left:.4f}, y = {top:.4f} in the base frame, '
        'y upwards.</desc>\n'
        f'<g fill="none" stroke="#000000" stroke-width="{max(width, height) / 500:.4f}" stroke-linejoin="round">\n'
        f'{paths}</g>\n</svg>\n'
    )


def dxf_text(outlines: Iterable[Outline]) -> str:
    """The outlines as polylines of a DXF file, release 12, in millimetres."""
    pairs = [(999, 'contour in millimetres, base frame of the robot'), (0, 'SECTION'), (2, 'HEADER')]
    pairs += [(9, '$ACADVER'), (1, 'AC1009'), (0, 'ENDSEC'), (0, 'SECTION'), (2, 'ENTITIES')]
    for outline in outlines:
        pairs += [(0, 'POLYLINE'), (8, LAYER), (66, '1'), (70, '1' if outline.closed else '0')]
        pairs += [(10, '0.0'), (20, '0.0'), (30, '0.0')]
        for x, y in (_MILLI * outline.points).tolist():
            pairs += [(0, 'VERTEX'), (8, LAYER), (10, f'{x:.6f}'), (20, f'{y:.6f}'), (30, '0.0')]
        pairs += [(0, 'SEQEND'), (8, LAYER)]
    pairs += [(0, 'ENDSEC'), (0, 'EOF')]
    return ''.join(f'{code:3d}\n{value}\n' for code, value in pairs)
