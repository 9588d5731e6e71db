"""From a recording of slides to the outline of the surface.

The centre of the tip is at S = H̄(Q, F) of the calibrated arm, and moves along the surface at the distance of the tip's
radius r: the normal n of its path is that of the surface, and the surface is at P = S - r n. So friction, which turns
the force, does not turn the normal; the force tells on which side the object is. An error δ of the normal's angle moves
P along the surface by r δ, and along the normal by r δ²/2 only; at an edge, where the surface turns by more than that,
the first counts, too.

The direction of travel is the derivative of a local quadratic fit of the places over the time in motion. Of windows of
several lengths (`WINDOWS`) the longest is used whose direction agrees with those of the shorter ones: along a straight
edge the noise is averaged, at a corner the direction follows.

An error along the surface by the noise of joint angles and force counts there in the same way.

The standard uncertainty of P along n has three parts: the calibration's, nᵀ D Σ Dᵀ n with D = ∂S/∂L̄; the noise of a
touch, which does not average out along a slide, to which that of the smoothed force is added, and the white noise of
the places; that of the normal and the tip's radius.

**Contact.** The zero of the force sensor cannot be taken from where the arm moves most, as with touches: here it moves
in contact. It is the steady force at the begin of the recording, where the arm is free; each contact has the zero of
the free motion right before it, where there is one. The force is taken to the stamps of the joint states by a mean over
`SMOOTHING`. A slide lasts for longer than a touch: where the noise asks for it, contact is sought in a mean over up to
`LONGEST_SMOOTHING`.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scara_kinetostatic.contour.result import (
    NEAR,
    NO_RADIUS,
    TINY,
    TOGETHER,
    Contour,
    estimate_friction,
    off_normal_angle,
    remarks_on,
)
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model import kinetostatics
from scara_kinetostatic.model.arm import CalibratedArm, Predictor, force_on_object
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, interpolated
from scara_kinetostatic.model.cell import Sensor, SensorFrame, SensorSign
from scara_kinetostatic.model.extended_model import TouchMetadata
from scara_kinetostatic.model.kinematics import forward, posture, quarter_turn
from scara_kinetostatic.model.online import motion_senses
from scara_kinetostatic.model.parameters import MICRO, MILLI
from scara_kinetostatic.model.quantities import percentage
from scara_kinetostatic.touches.contacts import SHORTEST_FREE, find_contacts, tare_before
from scara_kinetostatic.touches.streams import SMOOTHING, Signals, Streams, as_signals, moving_mean, white_noise

LARGEST_ZERO = 2.0
"""A zero that is larger by more than this than another steady force, N, was taken in contact."""
LONGEST_SMOOTHING = 0.25
"""Of the force in which contact is sought, s."""


class ContactSamples(NamedTuple):
    """Instants in contact, at the stamps of the joint states.

    Attributes:
        time: since the start of the recording, (n,), s.
        joints: Q, (n, 2), rad.
        force: as the sensor reports it, less its zero, (n, 2), N.
        contact: number of the contact, (n,).
        begin: when each contact begins that the tip comes to, s.
        force_noise: standard deviation of the white noise of a component of the force, smoothed, N.
        zero: that of the last contact.
        warnings: what is unusual, one sentence each.
    """

    time: Floats
    joints: Floats
    force: Floats
    contact: Indices
    begin: Floats
    force_noise: float
    zero: Floats
    warnings: tuple[str, ...]


def contact_samples(signals: Signals, source: str, zero: Floats | None = None) -> ContactSamples:
    """The instants in contact.

    Args:
        signals: the recording.
        source: its name, for messages.
        zero: what the sensor reports without force, (2,), N, where it is known; None: from the recording.

    Raises:
        UnsupportedDataError: the tip never touches anything, or is never free.
    """
    zero = force_zero(signals, source) if zero is None else zero
    contacts = find_contacts(signals, zero, LONGEST_SMOOTHING)
    if not len(contacts.begin):
        reach = float(np.hypot(*(signals.filtered.value - zero).T).max())
        problem = f'{source}: the tip touches nothing: the force changes by {reach:.2g} N at most'
        remedy = 'record while the tip slides along the object, and begin and end with free motion'
        raise UnsupportedDataError(problem, remedy)
    time, joints = signals.joints.time, signals.joints.value
    width = 2 * round(0.5 * SMOOTHING / signals.wrench.period) + 1
    force = interpolated(time, signals.wrench.time, moving_mean(signals.filtered.value, width))
    # the begin and the end of a contact are left out: there a smoothed force contains some of the free motion
    margin = 0.5 * contacts.smoothing + SMOOTHING
    number = np.searchsorted(contacts.begin + margin, time, side='right') - 1
    number = np.where(time <= np.append(contacts.end - margin, -np.inf)[number], number, -1)
    own = zero
    for k, (begin, previous) in enumerate(zip(contacts.begin, [-np.inf, *contacts.end[:-1]], strict=True)):
        tare = tare_before(signals, begin, previous)
        own = zero if isinstance(tare, str) else tare.force
        force[number == k] -= own
    size = np.hypot(*force.T)
    typical = float(np.median(size[number >= 0])) if (number >= 0).any() else 0.0
    later = np.clip(np.searchsorted(signals.wrench.time, time), 1, len(signals.wrench.time) - 1)
    # nothing is interpolated over a pause
    is_near = np.diff(signals.wrench.time)[later - 1] <= signals.wrench.gap_limit
    used = (number >= 0) & (size > 0.3 * typical) & is_near
    if used.sum() < 2:
        problem = f'{source}: contact lasts for {int(used.sum())} joint states only'
        raise UnsupportedDataError(problem, 'slide for longer, or record joint states at a higher rate')
    weak = f'the force in contact, {typical:.1f} N, is close to the {contacts.threshold:.1f} N from which on contact is'
    weak += ' seen: parts may be missing or wrong; slide with more force'
    warnings = (*signals.warnings, *[weak][: typical <= 2 * contacts.threshold])
    # a contact that is lost in between counts as two
    breaks = np.append(True, ~used[:-1]) | np.append(True, np.diff(number) != 0)
    contact = (np.cumsum(breaks & used) - 1)[used]
    noise = white_noise(signals.wrench.value) / float(np.sqrt(width))
    return ContactSamples(time[used], joints[used], force[used], contact, contacts.begin, noise, own, warnings)


def force_zero(signals: Signals, source: str) -> Floats:
    """What the sensor reports without force, (2,), N: the first steady force, and all like it.

    Args:
        signals: the recording.
        source: its name, for messages.

    Raises:
        UnsupportedDataError: no steady force lasts long enough, or the recording begins in contact.
    """
    _, mean, steady, tolerance = _blocks(signals)
    problem, mean = '', mean[steady]
    if not len(mean):
        problem = f'the force is never steady for {SHORTEST_FREE:g} s: there is no zero of the force sensor'
    elif np.hypot(*(mean[0] - mean[-1])) >= tolerance:
        excess = float(np.hypot(*mean[0]) - np.hypot(*mean.T).min())
        problem = f'it begins in contact: later the force is {excess:.1f} N smaller' if excess > LARGEST_ZERO else ''
    if problem:
        raise UnsupportedDataError(f'{source}: {problem}', 'begin and end the recording with free motion')
    return np.asarray(np.median(mean[np.hypot(*(mean - mean[0]).T) < tolerance], axis=0))


def zero_if_free(signals: Signals, zero: Floats, places: Floats) -> Floats | None:
    """The zero of a part at whose end nothing is touched, (2,), N, though by another zero something is; else None.

    There the force stays, and the tip moves along the supposed force farther than anything rigid would let it.

    Args:
        signals: the part.
        zero: by which something is touched, (2,), N.
        places: of the tip at the stamps of the joint states, (n, 2), m; deflections do not matter.
    """
    time, mean, steady, tolerance = _blocks(signals)
    if not len(mean):
        return None
    other = np.flatnonzero(~steady | (np.hypot(*(mean - mean[-1]).T) > tolerance))
    if (first := int(other[-1]) + 1 if len(other) else 0) >= len(mean) - 1:
        return None
    found: Floats = np.median(mean[first:], axis=0)
    way = np.diff(interpolated(time[first:], signals.joints.time, places), axis=0)
    length, along = np.hypot(*way.T), np.abs(way @ (found - zero)) / max(float(np.hypot(*(found - zero))), TINY)
    counts = (length > NEAR) & (along > np.sqrt(0.5) * length)  # shorter: may be noise
    return found if float(along[counts].sum()) > 5 * MILLI else None


def _blocks(signals: Signals) -> tuple[Floats, Floats, Mask, float]:
    """The middle of intervals of `SHORTEST_FREE`, (k,), s; the mean force in each, (k, 2), N; in which it is steady,
    (k,); and the difference from which on means are not the same, N.
    """
    wrench, noise = signals.filtered, white_noise(signals.wrench.value)
    size = max(5, round(SHORTEST_FREE / wrench.period))
    count = len(wrench.time) // size
    blocks = wrench.value[: count * size].reshape(count, size, 2)
    scatter = blocks.std(axis=1).max(axis=1, initial=0.0)
    time = wrench.time[: count * size].reshape(count, size).mean(axis=1)
    steady = scatter <= 3 * noise + MICRO
    return time, blocks.mean(axis=1), steady, max(0.5, 4 * noise / float(np.sqrt(size)))


WINDOWS = (4 * MILLI, 2 * MILLI, MILLI, 0.5 * MILLI)
"""Half lengths of the windows along the path, m."""
FEWEST = 4
"""Samples on each side, at least."""
_AGREE = 3.0
"""Directions agree where they differ by at most this many standard deviations."""
_RUBBER = 1.0
"""Coefficient of friction; more is seldom, or a force that is turned."""
_LARGEST_ROTATION = 0.15
"""Of a force sensor that is in the frame that is stated, rad."""
_PERIODS = 5
"""Samples that are farther apart than so many periods of the joint states have a pause between them; those that are as
much closer count as so far apart.
"""
_CONTRADICTING = 0.25
"""Part of the points whose force contradicts the motion, from which on it is no slide of a tip on a surface."""


class Travel(NamedTuple):
    """The course of the tip along a surface at n instants.

    Attributes:
        normal: of the surface, outward unit vectors, (n, 2).
        along: direction of travel, unit vectors, (n, 2).
        angle_std: standard uncertainty of their angle, (n,), rad.
        convex: the largest curvature of the path about the object within the shortest window, less three standard
            deviations, not below 0, (n,), 1/m.
        hollow: that away from the object, as in a hole.
        white: standard deviation of one component of a place without smoothing, (n,), m.
        end: whether it is the begin or the end of a pass, where the direction is known from one side, (n,).
    """

    normal: Floats
    along: Floats
    angle_std: Floats
    convex: Floats
    hollow: Floats
    white: Floats
    end: Mask


def speed_of(time: Floats, places: Floats, contact: Indices) -> Floats:
    """Speed of the tip's centre, (n,), m/s: distance over twice `SMOOTHING` within one contact."""
    period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    half = max(1, round(SMOOTHING / period))
    first, last = np.searchsorted(contact, contact, 'left'), np.searchsorted(contact, contact, 'right') - 1
    index = np.arange(len(time))
    low, high = np.maximum(index - half, first), np.minimum(index + half, last)
    return np.asarray(np.hypot(*(places[high] - places[low]).T) / np.maximum(time[high] - time[low], TINY))


def passes_of(places: Floats, contact: Indices, slides: Mask) -> Indices:
    """Number of the pass of each place, -1 for none: (n,).

    A pass is a motion without loss of contact and without a reversal; a stick within it is left out.
    """
    number, used = np.full(len(places), -1), np.flatnonzero(slides)
    if not len(used):
        return number
    new_contact, gap = np.diff(contact[used]) != 0, np.diff(used) > 1
    index = np.arange(len(used))
    back, ahead = np.maximum(index - FEWEST, 0), np.minimum(index + FEWEST, len(used) - 1)
    before, after = places[used] - places[used[back]], places[used[ahead]] - places[used]
    reversal = gap & ((before[:-1] * after[1:]).sum(axis=1) < 0)
    number[used] = np.cumsum(np.append(True, new_contact | reversal)) - 1
    for k in range(number.max() + 1):
        here = np.flatnonzero(number == k)
        if np.hypot(*np.ptp(places[here], axis=0)) < 2 * MILLI or len(here) < 2 * FEWEST + 1:  # m
            number[here] = -1
    kept = np.unique(number[number >= 0])
    return np.where(number >= 0, np.searchsorted(kept, number), -1)


def course_of(time: Floats, places: Floats, force: Floats) -> Travel:
    """The course of one pass; the force tells on which side of the path the object is.

    Args:
        time: (n,), s, increasing; of the motion alone.
        places: of the tip's centre, (n, 2), m.
        force: F on the object, (n, 2), N.
    """
    count, steps = len(places), np.diff(time)
    clock = np.append(0.0, np.cumsum(np.minimum(steps, 3 * float(np.median(steps)))))
    length = float(np.hypot(*np.diff(places, axis=0).T).sum()) / max(count - 1, 1)
    halves = [min(max(round(half / max(length, TINY)), FEWEST), 400) for half in WINDOWS]
    # where the samples are sparse, a further window of two: its difference tells how far the others may be wrong
    halves = list(dict.fromkeys([*halves, 2] if FEWEST * length > WINDOWS[1] else halves))
    fits = [_local_fit(clock, places, min(half, (count - 1) // 2)) for half in halves]
    noise = 1.4826 * float(np.median(np.abs(fits[-1].residual)))
    angle, std = fits[-1].angle, fits[-1].slope_std * noise
    agreed, doubt = np.ones(count, dtype=bool), np.zeros(count)
    for fit in fits[-2::-1]:
        off = np.abs(np.angle(np.exp(1j * (fit.angle - angle))))
        doubt = np.where(agreed, off, doubt)  # the error of a fit to a bend grows with the window
        agreed &= off <= _AGREE * std + 3 * MILLI  # rad; covers errors that change slowly along the path
        angle, std = np.where(agreed, fit.angle, angle), np.where(agreed, fit.slope_std * noise, std)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    left = quarter_turn(along)
    side = 1.0 if np.median((force * left).sum(axis=1)) > 0 else -1.0
    convex, hollow = (_sure_curvature(fits[-1], way, noise, halves[-1]) for way in (side, -side))
    end = np.minimum(np.arange(count), np.arange(count)[::-1]) < 3
    return Travel(-side * left, along, np.hypot(std, doubt), convex, hollow, np.full(count, noise), end)


def _sure_curvature(fit: _LocalFit, side: float, noise: float, half: int) -> Floats:
    """The largest curvature to the left (side 1) or right (-1) near each place, less its uncertainty, (n,), 1/m."""
    sure = np.maximum(side * fit.curvature - _AGREE * noise * fit.curvature_std, 0.0)
    sure[:FEWEST], sure[-FEWEST:] = sure[FEWEST], sure[-FEWEST - 1]  # at the ends the windows are one-sided
    half = min(half, (len(sure) - 1) // 2)
    return np.asarray(sliding_window_view(np.pad(sure, half, mode='edge'), 2 * half + 1).max(axis=1))


class _LocalFit(NamedTuple):
    """A local quadratic fit at n places.

    Attributes:
        angle: of the derivative, (n,), rad.
        slope_std: standard deviation of that angle per metre of white noise, (n,), rad/m.
        curvature: positive to the left, (n,), 1/m.
        curvature_std: standard deviation of it per metre of white noise, (n,), 1/m².
        residual: of the places across the path, (n,), m.
    """

    angle: Floats
    slope_std: Floats
    curvature: Floats
    curvature_std: Floats
    residual: Floats


def _local_fit(clock: Floats, places: Floats, half: int) -> _LocalFit:
    """Quadratic fits in windows of `half` samples on each side, moved inwards at the ends.

    x ≈ a₀ + a₁ v + a₂ v², v the time from the row over the length of the window.
    """
    count, width, parts = len(places), 2 * half + 1, []
    for rows in np.array_split(np.arange(count), count // TOGETHER + 1):
        window = np.clip(rows - half, 0, count - width)[:, None] + np.arange(width)
        v = clock[window] - clock[rows, None]
        v /= np.maximum(v[:, -1:] - v[:, :1], TINY)
        powers, offset = np.stack([np.ones_like(v), v, v * v], axis=1), places[window] - places[rows][:, None]
        inverse = np.linalg.inv(powers @ powers.swapaxes(1, 2) + TINY * np.eye(3))
        value = inverse @ (powers @ offset)
        slope = value[:, 1]
        speed = np.maximum(np.hypot(*slope.T), TINY)
        across = quarter_turn(slope) / speed[:, None]
        leverage = np.clip(1.0 - inverse[:, 0, 0], 0.1, 1.0)
        residual = -(value[:, 0] * across).sum(axis=1) / np.sqrt(leverage)
        angle, slope_std = np.arctan2(slope[:, 1], slope[:, 0]), np.sqrt(inverse[:, 1, 1]) / speed
        curvature = 2.0 * (value[:, 2] * across).sum(axis=1) / speed**2
        parts.append((angle, slope_std, curvature, 2.0 * np.sqrt(inverse[:, 2, 2]) / speed**2, residual))
    return _LocalFit(*map(np.concatenate, zip(*parts, strict=True)))


def metadata_of(arm: CalibratedArm, joints: Floats) -> TouchMetadata:
    """What is known of poses that follow each other besides Q and F: posture and motion; they are after all touches.

    A model that changes with time is taken as at the end of the calibration, `Predictor.assumptions`.
    """
    plain = TouchMetadata.plain(len(joints))._replace(posture=posture(arm.model.parameters, joints))
    predictor = Predictor(arm)
    if predictor.depends_on_time:
        plain = plain._replace(time=np.full(len(joints), arm.used.duration))
    return plain._replace(approach=motion_senses(joints)) if predictor.effects_of('approach') else plain


class TipPlaces(NamedTuple):
    """Centre of the tip in n poses under load.

    Attributes:
        center: S, (n, 2), m; NaN where it was not found.
        by_model: ∂S/∂(values of the model), (n, 2, 12 + k).
        systematic: covariance of S by the calibration, (n, 2, 2), m²; NaN where the data do not determine it, or a
            joint is in a dead band of undetermined size.
        noise: covariance by the noise of joint angles and force and by the place of joints in their dead bands,
            (n, 2, 2), m².
        by_noise: change by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 2, 4), m.
    """

    center: Floats
    by_model: Floats
    systematic: Floats
    noise: Floats
    by_noise: Floats


def tip_places(arm: CalibratedArm, joints: Floats, force: Floats, force_noise: float = 0.0) -> TipPlaces:
    """S with its uncertainty for the calibrated model.

    Args:
        arm: the calibrated arm.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        force_noise: standard deviation of a component of the force besides the noise of a touch, N.
    """
    first, second = np.hypot(arm.noise.force_levels, force_noise).tolist()
    arm = replace(arm, noise=arm.noise._replace(force=(first, second)))
    law, f = Predictor(arm).law, kinetostatics.Force.of(force, arm.noise)
    found = kinetostatics.tip_under_load(law, joints, f, metadata_of(arm, joints))
    at = found.loading
    jacobian = kinetostatics.tip_by_joints(at, kinetostatics.inverse_of_rows(at, f))
    by_model = kinetostatics.tip_by_values(law, jacobian, at, f, found.state)
    spread = arm.spread
    by_noise, systematic = kinetostatics.tip_by_noise(law, jacobian, at, f), spread.tip(by_model)
    noise = by_noise @ by_noise.swapaxes(1, 2) + kinetostatics.band_covariance(spread.gaps, jacobian, at, f)
    known = np.isfinite(spread.with_dead_bands(systematic, jacobian, at, f)[:, :1, :1])
    return TipPlaces(found.tip, by_model, np.where(known, systematic, np.nan), noise, by_noise)


LARGEST_TIP = 100 * MILLI
"""Largest radius of a tip, m; more is one in millimetres."""


FRAME_OR_SIGN = 'check frame and sign of the force sensor in the cell description'
"""What to do where forces and motion contradict each other."""


class ForceError(UnsupportedDataError):
    """Forces and motion contradict each other, as by a wrong frame or sign of the force sensor."""


class JumpError(UnsupportedDataError):
    """The tip jumps while in contact; `what` says how far, without when."""

    def __init__(self, source: str, size: float, time: float) -> None:
        self.what = f'the tip jumps by {size / MILLI:.2g} mm, in contact'
        remedy = 'check that the joint states are complete and stamped right, and slide without leaping over a gap'
        super().__init__(f'{source}: {self.what}, at {time:.2f} s', remedy)


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
        ParameterError: the radius is not one of a tip.
        UnsupportedDataError: the tip touches nothing, does not slide, or jumps; the force contradicts its motion;
            the calibration does not determine where it is.
    """
    radius = arm.cell.tip_radius if tip_radius is None else tip_radius
    if radius is not None and not 0 <= radius <= LARGEST_TIP:
        raise ParameterError('radius of the tip', f'expected 0 to {LARGEST_TIP:g} m, got {radius:g}', 'it is in metres')
    signals = as_signals(replace(streams, joints=streams.joints.while_held(arm.cell)), arm.cell)
    if signals is None:
        raise UnsupportedDataError(f'{streams.source}: fewer than two samples of a topic', 'record a whole slide')
    stated, source = sensor or arm.cell.sensor, streams.source
    try:
        contour = _uncontradicted(trace_signals(signals, source, arm, stated, radius or 0.0))
    except ForceError as error:
        right = []
        for frame, sign in product(SensorFrame, SensorSign):
            other = stated._replace(frame=frame, sign=sign)
            with suppress(UnsupportedDataError):
                found = _uncontradicted(trace_signals(signals, source, arm, other, radius or 0.0))
                right.append((abs(found.friction.coefficient), other))
        friction, mended = min(right, key=lambda item: item[0], default=(np.inf, stated))
        if friction > _RUBBER:
            raise
        changed = [key for key in ('frame', 'sign') if getattr(mended, key) is not getattr(stated, key)]
        keys = ' and '.join(f'sensor.{key}: {getattr(mended, key).value}' for key in changed)
        remedy = f'{FRAME_OR_SIGN}, and how it is turned: {keys} would agree, with a friction of {friction:.2f}'
        raise ForceError(error.problem, remedy) from None
    remarks = *([] if radius is not None else [NO_RADIUS]), *remarks_on(contour, arm)
    return replace(contour, warnings=(*streams.warnings, *contour.warnings, *remarks))


def _uncontradicted(contour: Contour) -> Contour:
    """The contour.

    Raises:
        ForceError: its forces contradict its motion.
    """
    if contour.contradiction:
        raise ForceError(f'{contour.source}: {contour.contradiction}', FRAME_OR_SIGN)
    return contour


def trace_signals(
    signals: Signals, source: str, arm: CalibratedArm, sensor: Sensor, radius: float, zero: Floats | None = None
) -> Contour:
    """The contour in a part of a recording, without remarks on the calibration.

    Args:
        signals: the part.
        source: the recording, for messages.
        arm: the calibrated arm.
        sensor: frame and sign of the force sensor.
        radius: of the tip, m.
        zero: what the sensor reports without force, (2,), N, where it is known; None: from the part.

    Raises:
        UnsupportedDataError: as `trace_contour`, but for forces that contradict the motion (`Contour.contradiction`).
    """
    samples, measured = contact_samples(signals, source, zero), replace(arm, cell=replace(arm.cell, sensor=sensor))
    reported = -samples.force if sensor.sign is SensorSign.ON_ROBOT else samples.force
    force = force_on_object(measured, reported, samples.joints, metadata_of(arm, samples.joints))
    places = tip_places(arm, samples.joints, force, samples.force_noise)
    if not np.isfinite(places.center).all():
        raise UnsupportedDataError(f'{source}: there is no place of the tip for its joint angles and forces')
    if np.isnan(places.systematic).all():
        problem = f'{source}: the touches of the calibration do not determine where the tip is'
        remedy = 'see the assessment in its report, and calibrate with the touches that it asks for'
        raise UnsupportedDataError(problem, remedy)
    number = _passes(samples, places.center, source, signals.joints.period)
    rows = [np.flatnonzero(number == k) for k in range(number.max() + 1)]
    parts = [course_of(samples.time[here], places.center[here], force[here]) for here in rows]
    course, inside = Travel._make(map(np.concatenate, zip(*parts, strict=True))), np.concatenate(rows)
    is_across = _across(course, force[inside], number[inside], source)
    into = _motion_into_contact(signals, samples, force, arm)
    left_out = int((~course.end & ~is_across).sum())
    course, used = Travel._make(column[is_across] for column in course), inside[is_across]
    along, n, force, surface = course.along, course.normal, force[used], places.center[used]
    across, aside = (_along(places.noise[used], way) + course.white**2 for way in (n, along))
    aside = np.sqrt(aside + (radius * course.angle_std) ** 2)
    # the path turns away from the object within less than a part of the tip's radius
    inner_corner = course.hollow * radius > 4.0
    noise = across + _error_by_normal(course, aside, inner_corner, radius) ** 2
    common = _along(places.systematic[used], n) + arm.cell.uncertainty.radius**2
    force_std = arm.noise.force_at(size := float(np.median(np.hypot(*force.T)))) / size
    passes = np.unique(number[used], return_inverse=True)[1]
    friction = estimate_friction(force, n, along, passes, force_std, arm.cell.uncertainty.force_rotation)
    turned = _LARGEST_ROTATION + _AGREE * float(np.hypot(force_std, samples.force_noise / size))
    against = float((off_normal_angle(force, n, along) < -turned).mean())
    cut = [f'{left_out} points left out: the force is not across the motion of the tip'][:left_out]
    rough = [f'the coefficient of friction, {friction.coefficient:.2f}, is that of rubber: {FRAME_OR_SIGN}']
    return Contour(
        source=source,
        time=samples.time[used],
        surface=surface - radius * n,
        normal=n,
        std_systematic=np.sqrt(common),
        std_noise=np.sqrt(noise),
        force=force,
        joints=samples.joints[used],
        passes=passes,
        by_model=np.einsum('ni,nik->nk', n, places.by_model[used]),
        by_noise=np.einsum('ni,nik->nk', n, places.by_noise[used]),
        friction=friction,
        inner_corner=inner_corner,
        tip_radius=radius,
        zero=samples.zero,
        warnings=(*samples.warnings, *cut, *rough[: friction.coefficient > _RUBBER]),
        contradiction=_contradiction(*friction[:2], against, into),
    )


def _contradiction(friction: float, std: float, against: float, into: float) -> str:
    """What in the forces of a slide cannot be, one clause; empty where all can be.

    Args:
        friction: estimated coefficient.
        std: its standard uncertainty.
        against: part of the points whose force points against the travel.
        into: as of `_motion_into_contact`.
    """
    if into < -0.5:  # 120°; friction does not turn a force so far
        return 'the force points against the motion of the tip into contact'
    if friction < -_AGREE * std:
        return f'the coefficient of friction would be {friction:.3f} ± {std:.3f}, and friction is not negative'
    part = f'{percentage(against)} of the points'
    return f'the force points against the travel of the tip at {part}' * (against > _CONTRADICTING)


def _motion_into_contact(signals: Signals, samples: ContactSamples, force: Floats, arm: CalibratedArm) -> float:
    """Cosine of the angle from the last millimetre before a contact to the first force in it, the median of all
    contacts; NaN where none shows it.
    """
    time, place, found = signals.joints.time, forward(arm.model.parameters, signals.joints.value), []
    for at, first in zip(*(np.searchsorted(each, samples.begin) for each in (time, samples.time)), strict=True):
        if first < len(samples.time) and at < len(time):
            motion = place[at] - place[:at]
            if len(away := np.flatnonzero(np.hypot(*motion.T) > MILLI)):
                pair = motion[away[-1]], force[first]
                found.append(float(pair[0] @ pair[1] / np.prod(np.linalg.norm(pair, axis=1))))
    return float(np.median(found)) if found else float('nan')


def _passes(samples: ContactSamples, center: Floats, source: str, period: float) -> Indices:
    """Number of the pass of each instant, -1 where the tip sticks.

    Raises:
        UnsupportedDataError: the tip jumps while joint states come without a pause, or does not slide at all.
    """
    elapsed, step = np.diff(samples.time), np.hypot(*np.diff(center, axis=0).T)
    same, pause = np.diff(samples.contact) == 0, elapsed > max(0.1, _PERIODS * period)
    usual = float(np.median(step[same])) if same.any() else 0.0
    jumps = same & ~pause & (step * period / np.maximum(elapsed, period / _PERIODS) > max(MILLI, 8 * usual))
    if jumps.any():
        first = int(jumps.argmax())
        raise JumpError(source, float(step[first]), float(samples.time[first + 1]))
    contact = samples.contact + np.append(0, np.cumsum(pause & same))  # a pause is as a loss of contact
    speed = speed_of(samples.time, center, contact)
    slides = speed > 0.1 * np.quantile(speed, 0.75)  # rather than sticks
    number = passes_of(center, contact, slides)
    if not (number >= 0).any():
        remedy = 'record a slide of some millimetres at least; a recording of touches is for calibrate'
        raise UnsupportedDataError(f'{source}: the tip does not slide', remedy)
    return number


def _across(course: Travel, force: Floats, number: Indices, source: str) -> Mask:
    """Where the force is across the motion, (n,); without the ends of passes.

    Raises:
        ForceError: the force is nowhere across, or at many points not.
    """
    # rad; beyond, the path is not that of a tip on a surface
    across = ~course.end & (np.abs(off_normal_angle(force, course.normal, course.along)) < 1.2)
    part = 1 - float(across.sum() / max(int((~course.end).sum()), 1))
    passes = number.max() + 1
    total, bad = (np.bincount(number[some], minlength=passes) for some in (~course.end, ~course.end & ~across))
    across &= (bad <= _CONTRADICTING * total)[number]  # such a pass is none on a surface
    across &= np.bincount(number[across], minlength=passes)[number] > 1  # one point has no direction
    if part > 0.5 or not across.any():
        problem = f'{source}: the force is not across the motion of the tip at {percentage(part)} of the points'
        raise ForceError(problem, FRAME_OR_SIGN)
    return across


def _error_by_normal(course: Travel, aside: Floats, inner_corner: Mask, radius: float) -> Floats:
    """Standard uncertainty across the surface by that of the normal, δ, and along the surface, t, (n,), m.

    P moves by r δ²/√2 against the normal. Along the surface it moves by t, of which r δ is a part; this leaves a
    surface of radius ρ by t²/(2 ρ), and a sharp edge by t: here t²/(2 ρ + t), with ρ = 1/κ - r about the object and
    1/κ + r in a hollow. In an inner corner the tip touches on both sides and turns on the spot: ρ = 0.
    """
    about = np.maximum(1.0 / np.maximum(course.convex, TINY) - radius, 0.0)
    within = np.where(inner_corner, 0.0, 1.0 / np.maximum(course.hollow, TINY) + radius)
    across = aside**2 / np.maximum(2.0 * np.minimum(about, within) + aside, TINY)
    return np.hypot(radius * course.angle_std**2 / np.sqrt(2.0), across)


def _along(covariance: Floats, normal: Floats) -> Floats:
    """nᵀ Σ n, (n,)."""
    return np.asarray(np.einsum('ni,nij,nj->n', normal, covariance, normal))
