"""The part of a recording in which the tip is in contact: joint angles and force at the same instants.

The zero of the force sensor cannot be taken from where the arm moves most, as with touches: here it moves in contact.
It is the steady force at the begin of the recording, where the arm is free; each contact has the zero of the free
motion right before it, where there is one. The force is taken to the stamps of the joint states by a mean over
`SMOOTHING`. A slide lasts for longer than a touch: where the noise asks for it, contact is sought in a mean over up to
`LONGEST_SMOOTHING`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.touches.contacts import SHORTEST_FREE, find_contacts, tare_before
from scara_kinetostatic.touches.signals import SMOOTHING, Signals, moving_mean, white_noise

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
        force_noise: standard deviation of the white noise of a component of the force, smoothed, N.
        lost: time that contact was lost between the first and the last contact, s.
        zero: that of the last contact.
        warnings: what is unusual, one sentence each.
    """

    time: Floats
    joints: Floats
    force: Floats
    contact: Indices
    force_noise: float
    lost: float
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
        raise UnsupportedDataError(
            f'{source}: the tip touches nothing: the force changes by {reach:.2g} N at most',
            'record while the tip slides along the object, and begin and end with free motion',
        )
    time, joints = signals.joints.time, signals.joints.value
    width = 2 * round(0.5 * SMOOTHING / signals.wrench.period) + 1
    smooth = moving_mean(signals.filtered.value, width)
    force = np.column_stack([np.interp(time, signals.wrench.time, column) for column in smooth.T])
    # the begin and the end of a contact are left out: there a smoothed force contains some of the free motion
    margin = 0.5 * contacts.smoothing + SMOOTHING
    number = np.searchsorted(contacts.begin + margin, time, side='right') - 1
    number = np.where(time <= np.append(contacts.end - margin, -np.inf)[number], number, -1)
    previous, own = -np.inf, zero
    for k, (begin, end) in enumerate(zip(contacts.begin, contacts.end, strict=True)):
        tare = tare_before(signals, begin, previous)
        own = zero if isinstance(tare, str) else tare.force
        force[number == k] -= own
        previous = end
    size = np.hypot(*force.T)
    typical = float(np.median(size[number >= 0])) if (number >= 0).any() else 0.0
    later = np.clip(np.searchsorted(signals.wrench.time, time), 1, len(signals.wrench.time) - 1)
    # nothing is interpolated over a pause
    is_near = np.diff(signals.wrench.time)[later - 1] <= signals.wrench.gap_limit
    used = (number >= 0) & (size > 0.3 * typical) & is_near
    if used.sum() < 2:
        problem = f'{source}: contact lasts for {int(used.sum())} joint states only'
        raise UnsupportedDataError(problem, 'slide for longer, or record joint states at a higher rate')
    weak = (
        f'the force in contact, {typical:.1f} N, is close to the {contacts.threshold:.1f} N from which on contact is '
        'seen: parts may be missing or wrong; slide with more force'
    )
    warnings = [*signals.warnings, *[weak][: typical <= 2 * contacts.threshold]]
    first, last = np.flatnonzero(used)[[0, -1]]
    # a contact that is lost in between counts as two
    breaks = np.append(True, ~used[:-1]) | np.append(True, np.diff(number) != 0)
    return ContactSamples(
        time[used],
        joints[used],
        force[used],
        contact=(np.cumsum(breaks & used) - 1)[used],
        force_noise=white_noise(signals.wrench.value) / float(np.sqrt(width)),
        lost=float((~used[first:last]).sum() * signals.joints.period),
        zero=own,
        warnings=tuple(warnings),
    )


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
        if excess > LARGEST_ZERO:
            problem = f'it begins in contact: later the force is {excess:.1f} N smaller'
    if problem:
        raise UnsupportedDataError(f'{source}: {problem}', 'begin and end the recording with free motion')
    return np.asarray(np.median(mean[np.hypot(*(mean - mean[0]).T) < tolerance], axis=0))


def zero_if_free(signals: Signals, zero: Floats, tip: Floats) -> Floats | None:
    """The zero of a part at whose end nothing is touched, (2,), N, though by another zero something is; else None.

    There the force stays, and the tip moves along the supposed force farther than anything rigid would let it.

    Args:
        signals: the part.
        zero: by which something is touched, (2,), N.
        tip: places of the tip at the stamps of the joint states, (n, 2), m; deflections do not matter.
    """
    time, mean, steady, tolerance = _blocks(signals)
    if not len(mean):
        return None
    other = np.flatnonzero(~steady | (np.hypot(*(mean - mean[-1]).T) > tolerance))
    first = int(other[-1]) + 1 if len(other) else 0
    if first >= len(mean) - 1:
        return None
    found: Floats = np.median(mean[first:], axis=0)
    way = np.diff(np.column_stack([np.interp(time[first:], signals.joints.time, column) for column in tip.T]), axis=0)
    length, along = np.hypot(*way.T), np.abs(way @ (found - zero)) / max(float(np.hypot(*(found - zero))), 1e-9)
    counts = (length > 3e-4) & (along > np.sqrt(0.5) * length)  # shorter: may be noise
    return found if float(along[counts].sum()) > 5e-3 else None


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
    steady = scatter <= 3 * noise + 1e-6
    return time, blocks.mean(axis=1), steady, max(0.5, 4 * noise / float(np.sqrt(size)))
