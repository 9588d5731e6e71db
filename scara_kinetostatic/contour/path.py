"""The path of the tip's centre: its direction by local regression, its passes, where it sticks or jumps.

The direction of travel is the derivative of a local quadratic fit of the places over the time in motion. Of windows of
several lengths (`WINDOWS`) the longest is used whose direction agrees with those of the shorter ones: along a
straight edge the noise is averaged, at a corner the direction follows.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.kinematics import quarter_turn

WINDOWS = (4e-3, 2e-3, 1e-3, 0.5e-3)
"""Half lengths of the windows along the path, m."""
FEWEST = 4
"""Samples on each side, at least."""
_AGREE = 3.0
"""Directions agree where they differ by at most this many standard deviations."""


class Course(NamedTuple):
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
    """Speed of the tip's centre, (n,), m/s: distance over 60 ms within one contact."""
    period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    half = max(1, round(0.5 * 0.06 / period))
    first, last = np.searchsorted(contact, contact, 'left'), np.searchsorted(contact, contact, 'right') - 1
    index = np.arange(len(time))
    low, high = np.maximum(index - half, first), np.minimum(index + half, last)
    elapsed = np.maximum(time[high] - time[low], 1e-9)
    return np.asarray(np.hypot(*(places[high] - places[low]).T) / elapsed)


def passes_of(places: Floats, contact: Indices, slides: Mask) -> Indices:
    """Number of the pass of each place, -1 for none: (n,).

    A pass is a motion without loss of contact and without a reversal; a stick within it is left out.
    """
    number = np.full(len(places), -1)
    used = np.flatnonzero(slides)
    if not len(used):
        return number
    new_contact = np.diff(contact[used]) != 0
    gap = np.diff(used) > 1
    index = np.arange(len(used))
    back, ahead = np.maximum(index - FEWEST, 0), np.minimum(index + FEWEST, len(used) - 1)
    before, after = places[used] - places[used[back]], places[used[ahead]] - places[used]
    reversal = gap & ((before[:-1] * after[1:]).sum(axis=1) < 0)
    number[used] = np.cumsum(np.append(True, new_contact | reversal)) - 1
    for k in range(number.max() + 1):
        here = np.flatnonzero(number == k)
        if np.hypot(*np.ptp(places[here], axis=0)) < 2e-3 or len(here) < 2 * FEWEST + 1:  # m
            number[here] = -1
    kept = np.unique(number[number >= 0])
    return np.where(number >= 0, np.searchsorted(kept, number), -1)


def course_of(time: Floats, places: Floats, force: Floats) -> Course:
    """The course of one pass; the force tells on which side of the path the object is.

    Args:
        time: (n,), s, increasing; of the motion alone.
        places: of the tip's centre, (n, 2), m.
        force: F on the object, (n, 2), N.
    """
    count = len(places)
    steps = np.diff(time)
    period = float(np.median(steps))
    clock = np.append(0.0, np.cumsum(np.minimum(steps, 3 * period)))
    length = float(np.hypot(*np.diff(places, axis=0).T).sum()) / max(count - 1, 1)
    halves = [int(np.clip(round(half / max(length, 1e-9)), FEWEST, 400)) for half in WINDOWS]
    # where the samples are sparse, a further window of two: its difference tells how far the others may be wrong
    halves = list(dict.fromkeys([*halves, 2] if FEWEST * length > WINDOWS[1] else halves))
    fits = [_local_fit(clock, places, min(half, (count - 1) // 2)) for half in halves]
    noise = 1.4826 * float(np.median(np.abs(fits[-1].residual)))
    angle, std = fits[-1].angle, fits[-1].slope_std * noise
    agreed, doubt = np.ones(count, dtype=bool), np.zeros(count)
    for fit in fits[-2::-1]:
        off = np.abs(np.angle(np.exp(1j * (fit.angle - angle))))
        doubt = np.where(agreed, off, doubt)  # the error of a fit to a bend grows with the window
        agreed &= off <= _AGREE * std + 3e-3  # rad; covers errors that change slowly along the path
        angle, std = np.where(agreed, fit.angle, angle), np.where(agreed, fit.slope_std * noise, std)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    left = quarter_turn(along)
    side = 1.0 if np.median((force * left).sum(axis=1)) > 0 else -1.0
    convex, hollow = (_sure_curvature(fits[-1], way, noise, halves[-1]) for way in (side, -side))
    index = np.arange(count)
    end = np.minimum(index, index[::-1]) < 3
    return Course(-side * left, along, np.hypot(std, doubt), convex, hollow, np.full(count, noise), end)


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
    """Quadratic fits in windows of `half` samples on each side, moved inwards at the ends."""
    count, size = len(places), max(2 * half + 1, 512)  # worked out together at so many places
    parts = [
        _fit_part(clock, places, np.arange(first, min(first + size, count)), half) for first in range(0, count, size)
    ]
    return _LocalFit(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _fit_part(clock: Floats, places: Floats, rows: Indices, half: int) -> _LocalFit:
    """The fits at neighbouring rows: x ≈ a₀ + a₁ v + a₂ v², v the time from the row, by Σ vᵏ and Σ x vᵏ.

    The sums over windows are differences of cumulative sums; these are over few windows, about their middle, so that
    little is lost by rounding.
    """
    width = 2 * half + 1
    start = np.clip(rows - half, 0, len(places) - width)
    begin, end = int(start[0]), int(start[-1]) + width
    middle, center = int(rows[len(rows) // 2]), places[rows]
    scale = max(float(clock[end - 1] - clock[begin]) * width / (end - begin), 1e-9)
    u = (clock[begin:end] - clock[middle]) / scale
    powers = u[:, None] ** np.arange(5)
    offset = places[begin:end] - places[middle]
    moments = _window_sums(powers, start - begin, width)
    products = _window_sums((offset[:, None, :] * powers[:, :3, None]).reshape(-1, 6), start - begin, width)
    shift = _about(u[rows - begin])
    of_time = np.einsum('nij,nj->ni', shift, moments)
    of_place = np.einsum('nij,njc->nic', shift[:, :3, :3], products.reshape(-1, 3, 2))
    of_place -= of_time[:, :3, None] * (center - places[middle])[:, None, :]
    normal = of_time[:, np.add.outer(np.arange(3), np.arange(3))] + 1e-12 * np.eye(3)
    inverse = np.linalg.inv(normal)
    value = inverse @ of_place
    slope = value[:, 1]
    speed = np.maximum(np.hypot(*slope.T), 1e-12)
    across = quarter_turn(slope) / speed[:, None]
    leverage = np.clip(1.0 - inverse[:, 0, 0], 0.1, 1.0)
    residual = -(value[:, 0] * across).sum(axis=1) / np.sqrt(leverage)
    angle, slope_std = np.arctan2(slope[:, 1], slope[:, 0]), np.sqrt(inverse[:, 1, 1]) / speed
    curvature = 2.0 * (value[:, 2] * across).sum(axis=1) / speed**2
    curvature_std = 2.0 * np.sqrt(inverse[:, 2, 2]) / speed**2
    return _LocalFit(angle, slope_std, curvature, curvature_std, residual)


def _window_sums(values: Floats, start: Indices, width: int) -> Floats:
    """Sums of values (m, k) over windows that begin at rows `start`, (n,): (n, k)."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(sums[start + width] - sums[start])


def _about(origin: Floats) -> Floats:
    """Matrices that turn Σ uᵏ into Σ (u - o)ᵏ, k = 0 … 4, for origins o, (n,): (n, 5, 5)."""
    k = np.arange(5)
    power = np.subtract.outer(k, k)
    binomial = np.array([[comb(i, j) for j in k] for i in k])
    return np.asarray(np.where(power >= 0, binomial * (-origin[:, None, None]) ** np.maximum(power, 0), 0.0))
