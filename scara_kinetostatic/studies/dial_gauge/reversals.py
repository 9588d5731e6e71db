"""One reversal of a force–displacement loop: two elastic branches as straight lines, and the gap between them.

After a reversal the force decreases along an elastic branch, hardly changes inside the backlash, increases along the
other elastic branch, and reaches a plateau where the joint slips. With distance d since the reversal and force f, both
positive along the new motion:

- the level is the force inside the backlash, where f changes least over a share `_FLAT` of the way up; friction and the
  sensor's zero make it differ from 0. Both lines are extended to it. There is one level per loop and sense.
- each branch is the straight line d = a + p f through the samples within a window of force, given by two shares of the
  way from the level to the plateau; p of the branch after the gap is the compliance.
- the gap is the distance between both lines at the level.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate

_FLAT = 1 / 6
"""Share of the way up over which the smallest change of the force is sought."""
_RISEN = 0.75
"""Share of the plateau at which the way up ends."""
PROMINENCE = 0.03
"""Smallest prominence of a reversal, as a share of the range of the displacement."""
_FEWEST_SAMPLES = 2
"""Samples needed for a line; its uncertainty comes from the scatter pooled over all reversals of its sense."""
_COVERED = 0.6
"""Share of a window that the samples must cover."""
_SLIPPED = 0.6
"""Share of the plateau that the force must have reached before a reversal; otherwise it is not a full loop."""


class Reversal(NamedTuple):
    """One reversal.

    Attributes:
        time: s.
        displacement: where, m.
        sense: +1 if the displacement rises afterwards.
        speed: in the middle of the gap, m/s.
        force: at the reversal, positive along the motion before it, N.
        gap: m.
        compliance: after the gap, m/N.
        unloading: compliance before the gap, m/N.
        samples: number in the windows before and after the gap.
        crossings: distances from the reversal at which both lines meet the level, m.
    """

    time: float
    displacement: float
    sense: int
    speed: float
    force: float
    gap: Estimate
    compliance: Estimate
    unloading: Estimate
    samples: tuple[int, int]
    crossings: tuple[float, float]


class Sweep(NamedTuple):
    """The samples from one reversal to the next.

    Attributes:
        time: (n,), s.
        distance: since the reversal, (n,), m.
        force: positive along the motion, (n,), N.
        place: displacement at the reversal, m.
        sense: of the motion, +1 or -1.
    """

    time: Floats
    distance: Floats
    force: Floats
    place: float
    sense: int


class Line(NamedTuple):
    """The line d = a + p (f - level): a, p, their unscaled covariance, residual sum of squares, number of samples."""

    a: float
    p: float
    unscaled: Floats
    rss: float
    samples: int


def find_sweeps(time: Floats, displacement: Floats, force: Floats) -> list[Sweep]:
    """The record cut at the reversals, without what comes before the first."""
    least = PROMINENCE * float(np.ptp(displacement))
    peaks = [find_peaks(sign * displacement, prominence=least)[0] for sign in (1, -1)] if least > 0 else [[], []]
    turns = np.sort(np.concatenate(peaks)).astype(int)
    sweeps = []
    for first, last in zip(turns, [*turns[1:], len(time) - 1][: len(turns)], strict=True):
        rows = slice(first, last + 1)
        sense = 1 if displacement[last] > displacement[first] else -1
        distance, along = sense * (displacement[rows] - displacement[first]), sense * force[rows]
        sweeps.append(Sweep(time[rows], distance, along, float(displacement[first]), sense))
    return sweeps


def find_plateau(sweeps: list[Sweep]) -> float:
    """Force of slip, N: the median over the sweeps of the median over the second half of each."""
    medians = [float(np.median(s.force[s.distance > s.distance[-1] / 2])) for s in sweeps if s.distance[-1] > 0]
    return float(np.median(medians)) if medians else np.nan


def find_level(sweep: Sweep, plateau: float) -> float:
    """Force inside the backlash, N: where it changes least on the way up to the plateau."""
    risen = np.flatnonzero(sweep.force >= _RISEN * plateau)
    if not len(risen) or risen[0] < 2:
        return np.nan
    grid = np.linspace(0.0, sweep.distance[risen[0]], 601)
    force = np.interp(grid, np.maximum.accumulate(sweep.distance[: risen[0] + 1]), sweep.force[: risen[0] + 1])
    width = int(_FLAT * len(grid))
    start = int(np.argmin(force[width:] - force[:-width]))
    return float(force[start : start + width + 1].mean())


def fit_pair(
    sweep: Sweep, level: float, bottom: float, top: float, window: tuple[float, float]
) -> tuple[Line, Line] | str:
    """The lines before and after the gap, or the reason why they cannot be fitted."""
    if not bottom < level < top:
        return 'no gap between two branches'
    if sweep.force[0] > _SLIPPED * bottom:
        return 'no full loop: the force before it did not reach the plateau'
    first = np.flatnonzero(sweep.force > level + window[1] * (top - level))
    rise = slice(0, int(first[0])) if len(first) else slice(0, len(sweep.force))
    pair = []
    for end, name in ((bottom, 'before'), (top, 'after')):
        part = (sweep.force[rise] - level) / (end - level)
        rows = np.flatnonzero((part >= window[0]) & (part <= window[1]))
        if len(rows) < _FEWEST_SAMPLES:
            return f'{len(rows)} samples on the elastic branch {name} the gap'
        if np.ptp(part[rows]) < _COVERED * (window[1] - window[0]) * (1 - 1 / len(rows)):
            return f'the branch {name} the gap is not complete'
        pair.append(_line(sweep.force[rise][rows] - level, sweep.distance[rise][rows]))
    return pair[0], pair[1]


def _line(force: Floats, distance: Floats) -> Line:
    design = np.stack([np.ones_like(force), force], axis=1)
    basis, triangle = np.linalg.qr(design)
    inverse = np.linalg.inv(triangle)
    a, p = inverse @ (basis.T @ distance)
    residual = distance - basis @ (basis.T @ distance)
    return Line(float(a), float(p), inverse @ inverse.T, float(residual @ residual), len(force))


def pooled(lines: list[Line]) -> float:
    """Standard deviation of the residuals of several lines, m; NaN without degrees of freedom."""
    dof = sum(line.samples - 2 for line in lines)
    return float(np.sqrt(sum(line.rss for line in lines) / dof)) if dof > 0 else np.nan


def as_reversal(sweep: Sweep, before: Line, after: Line, sigma: tuple[float, float]) -> Reversal:
    """Gap and slopes of a sweep from its lines; `sigma`: residual standard deviation before and after the gap, m."""
    scale = np.array(sigma)
    std = np.sqrt(np.array([np.diag(before.unscaled), np.diag(after.unscaled)])) * scale[:, None]
    middle = (before.a + after.a) / 2
    speed = np.interp(middle, np.maximum.accumulate(sweep.distance), np.gradient(sweep.distance, sweep.time))
    return Reversal(
        time=float(sweep.time[0]),
        displacement=sweep.place,
        sense=sweep.sense,
        speed=float(speed),
        force=-float(sweep.force[0]),
        gap=Estimate(after.a - before.a, float(np.hypot(*std[:, 0]))),
        compliance=Estimate(after.p, float(std[1, 1])),
        unloading=Estimate(before.p, float(std[0, 1])),
        samples=(before.samples, after.samples),
        crossings=(before.a, after.a),
    )
