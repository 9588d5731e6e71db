"""From a recording of slides to the outline of the surface.

The centre of the tip is at S = H̄(Q, F) of the calibrated arm, and moves along the surface at the distance of the tip's
radius r: the normal n of its path is that of the surface, and the surface is at P = S - r n. So friction, which turns
the force, does not turn the normal; the force tells on which side the object is. The direction of travel is that of a
local fit (`path`). An error δ of the normal's angle moves P along the surface by r δ, and along the normal by
r δ²/2 only.

The standard uncertainty of P along n has three parts: the calibration's, nᵀ D Σ Dᵀ n with D = ∂S/∂L̄; the noise of a
touch, which does not average out along a slide, and the white noise of the samples; that of the normal and the tip's
radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.contour.contact import ContactSamples, contact_samples
from scara_kinetostatic.contour.friction import Friction, estimate_friction, off_normal_angle
from scara_kinetostatic.contour.joining import Outline, join_passes
from scara_kinetostatic.contour.path import direction_along, moving, passes_of, speed_of
from scara_kinetostatic.contour.tip import TipPlaces, measured_force, tip_places
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Sensor
from scara_kinetostatic.touches.signals import as_signals
from scara_kinetostatic.touches.streams import Streams

LARGEST_ANGLE = 1.2
"""Largest angle between force and normal of a contact, rad: beyond, the path is not that of a tip on a surface."""
END_SAMPLES = 3
"""Instants left out at both ends of a pass, where the tip comes or goes and its direction is known from one side."""
_JUMP = 1e-3
"""The tip jumps where it moves from one joint state to the next by more than this, m,"""
_JUMP_FACTOR = 8.0
"""and more than this many times its usual step."""


@dataclass(frozen=True)
class Contour:
    """The surface along which a tip slid, at n instants in the order of time.

    Attributes:
        source: the recording.
        time: since the first stamp of the recording, (n,), s.
        surface: points of the surface, (n, 2), m, base frame.
        normal: outward unit vectors, (n, 2).
        std_normal: standard uncertainty along the normal, (n,), m; NaN where the calibration does not determine it.
        std_systematic: the part of it that is common to neighbouring points, by the calibration and the tip, (n,), m.
        force: F of the tip on the object, base frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        tip: centre of the tip, (n, 2), m.
        passes: number of the pass, (n,).
        by_model: change along the normal by each value of the model, (n, 12 + k).
        outlines: the passes joined, the longest first.
        friction: what the forces say of friction.
        off_normal: angle from the inward normal to the force, towards the direction of travel, (n,), rad.
        tip_radius: m.
        lost: time without contact between the first and the last contact, s.
        stuck: time in contact without sliding, s.
        warnings: one sentence each.
    """

    source: str
    time: Floats
    surface: Floats
    normal: Floats
    std_normal: Floats
    std_systematic: Floats
    force: Floats
    joints: Floats
    tip: Floats
    passes: Indices
    by_model: Floats
    outlines: tuple[Outline, ...]
    friction: Friction
    off_normal: Floats
    tip_radius: float
    lost: float
    stuck: float
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)


def trace_contour(
    streams: Streams, arm: CalibratedArm, sensor: Sensor | None = None, tip_radius: float | None = None
) -> Contour:
    """The contour of the object along which the tip slides.

    Args:
        streams: the recording; it begins and ends with free motion.
        arm: the calibrated arm.
        sensor: frame and sign of the force sensor; None: as the calibration's cell has them.
        tip_radius: m; None: as the calibration's cell has it.

    Raises:
        UnsupportedDataError: the tip touches nothing, does not slide, or jumps; the calibration does not determine
            where it is.
    """
    sensor = sensor or arm.cell.sensor
    radius = arm.cell.tip_radius if tip_radius is None else tip_radius
    signals = as_signals(streams, arm.cell)
    if signals is None:
        raise UnsupportedDataError(f'{streams.source}: fewer than two samples of a topic', 'record a whole slide')
    samples = contact_samples(signals, streams.source)
    force = measured_force(arm, sensor, samples.joints, samples.force)
    places = tip_places(arm, samples.joints, force)
    if not np.isfinite(places.center).all():
        raise UnsupportedDataError(f'{streams.source}: there is no place of the tip for its joint angles and forces')
    if np.isnan(places.systematic).all():
        raise UnsupportedDataError(
            f'{streams.source}: the touches of the calibration do not determine where the tip is',
            'see the assessment in its report, and calibrate with the touches that it asks for',
        )
    number, stuck = _passes(samples, places.center, streams.source, signals.joints.period)
    contour = _surface(samples, places, force, number, arm, radius or 0.0, streams.source)
    return _with_remarks(contour, arm, radius, stuck, (*streams.warnings, *samples.warnings))


def _passes(samples: ContactSamples, center: Floats, source: str, period: float) -> tuple[Indices, float]:
    """Number of the pass of each instant, -1 where the tip sticks; and how long it does, s.

    Raises:
        UnsupportedDataError: the tip jumps, or does not slide at all.
    """
    contact = _split_at_gaps(samples, center, source, period)
    slides = moving(speed_of(samples.time, center, contact))
    number = passes_of(center, contact, slides)
    if not (number >= 0).any():
        reach = float(np.ptp(center, axis=0).max())
        raise UnsupportedDataError(
            f'{source}: the tip does not slide: in contact it moves by {1e3 * reach:.2g} mm',
            'record a slide of some millimetres at least; for touches use calibrate',
        )
    return number, float((~slides).sum() * period)


def _split_at_gaps(samples: ContactSamples, center: Floats, source: str, period: float) -> Indices:
    """Numbers of the contacts, a pause of the joint states as a loss of contact.

    Raises:
        UnsupportedDataError: the tip jumps while joint states come without a pause.
    """
    elapsed = np.diff(samples.time)
    step = np.hypot(*np.diff(center, axis=0).T)
    same = np.diff(samples.contact) == 0
    pause = elapsed > max(0.1, 5 * period)
    usual = float(np.median(step[same])) if same.any() else 0.0
    speed = step * period / np.maximum(elapsed, 0.2 * period)
    jumps = np.flatnonzero(same & ~pause & (speed > max(_JUMP, _JUMP_FACTOR * usual)))
    if len(jumps):
        k = int(jumps[0])
        more = f' and {len(jumps) - 1} more times' if len(jumps) > 1 else ''
        raise UnsupportedDataError(
            f'{source}: the tip jumps by {1e3 * step[k]:.2g} mm at {samples.time[k + 1]:.2f} s{more}, in contact',
            'check that the joint states are complete and stamped right, and slide without leaping over a gap',
        )
    return samples.contact + np.append(0, np.cumsum(pause & same))


def _surface(
    samples: ContactSamples,
    places: TipPlaces,
    force: Floats,
    number: Indices,
    arm: CalibratedArm,
    radius: float,
    source: str,
) -> Contour:
    """The surface at the instants of the passes."""
    count = len(samples.time)
    normal, along, angle_std, white = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count), np.zeros(count)
    ends = np.zeros(count, dtype=bool)
    for k in range(number.max() + 1):
        here = np.flatnonzero(number == k)
        found = direction_along(samples.time[here], places.center[here])
        along[here], angle_std[here], white[here] = found.along, found.std, found.white_noise
        left = np.column_stack([-found.along[:, 1], found.along[:, 0]])
        side = -np.sign(np.median((force[here] * left).sum(axis=1)))
        normal[here] = side * left
        ends[here[:END_SAMPLES]] = ends[here[-END_SAMPLES:]] = True
    used = (number >= 0) & ~ends
    off = np.where(used, off_normal_angle(force, normal, along), np.inf)
    across = np.abs(off) < LARGEST_ANGLE
    left_out = int((used & ~across).sum())
    used &= across
    if not used.any():
        problem = f'{source}: the force is nowhere across the motion of the tip'
        raise UnsupportedDataError(problem, 'check frame and sign of the force sensor in the cell description')
    n = normal[used]
    systematic = _along(places.systematic[used], n)
    noise = _along(places.noise[used], n) + white[used] ** 2
    own = (radius * angle_std[used] ** 2 / np.sqrt(2)) ** 2
    common = systematic + arm.cell.uncertainty.radius**2
    std = np.sqrt(common + noise + own)
    surface = places.center[used] - radius * n
    passes = np.unique(number[used], return_inverse=True)[1]
    weighing = np.where(np.isnan(std), np.sqrt(noise + own), std)
    size = float(np.median(np.hypot(*force[used].T)))
    friction = estimate_friction(
        force[used], n, along[used], passes, arm.noise.force_at(size) / size, arm.cell.uncertainty.force_rotation
    )
    return Contour(
        source=source,
        time=samples.time[used],
        surface=surface,
        normal=n,
        std_normal=std,
        std_systematic=np.sqrt(common),
        force=force[used],
        joints=samples.joints[used],
        tip=places.center[used],
        passes=passes,
        by_model=np.einsum('ni,nik->nk', n, places.by_model[used]),
        outlines=join_passes(
            [(surface[passes == k], n[passes == k], weighing[passes == k]) for k in range(passes.max() + 1)]
        ),
        friction=friction,
        off_normal=off[used],
        tip_radius=radius,
        lost=samples.lost,
        stuck=0.0,
        warnings=(f'{left_out} points left out: the force is not across the motion of the tip',) if left_out else (),
    )


def _along(covariance: Floats, normal: Floats) -> Floats:
    """nᵀ Σ n, (n,)."""
    return np.asarray(np.einsum('ni,nij,nj->n', normal, covariance, normal))


def _with_remarks(
    contour: Contour, arm: CalibratedArm, radius: float | None, stuck: float, warnings: Sequence[str]
) -> Contour:
    return replace(contour, stuck=stuck, warnings=(*warnings, *contour.warnings, *_remarks(contour, arm, radius)))


def _remarks(contour: Contour, arm: CalibratedArm, radius: float | None) -> list[str]:
    remarks = []
    if radius is None:
        remarks.append(
            'the cell description states no radius of the tip (tip: {radius: …}): the outline is that of the centre of '
            'the tip, not of the surface'
        )
    size = np.hypot(*contour.force.T)
    low, high = arm.used.lowest_force, arm.used.highest_force
    beyond = float(np.mean((size < 0.5 * low) | (size > 1.1 * high)))
    if beyond > 0.05:
        remarks.append(
            f'{100 * beyond:.0f} % of the points have a force outside of that of the calibration, '
            f'{low:.0f} to {high:.0f} N: there the model is extrapolated'
        )
    unknown = float(np.mean(np.isnan(contour.std_normal)))
    if unknown:
        remarks.append(
            f'{100 * unknown:.0f} % of the points have no stated uncertainty: the touches of the calibration do not '
            'determine the place of the tip there'
        )
    if arm.grade == 'unfit':
        remarks.append('the calibration is assessed as unfit for use: see its report')
    return remarks
