"""A constant difference of the clocks that stamp joint states and wrenches, from the touches themselves.

The recording times may not show it: they may be shifted as the stamps are. But during a contact the joints rest, and
between contacts they move. Of the differences up to `_LARGEST` at which the joints move least during the contacts, that
one is taken which makes most contacts touches.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.detection import Detection, find_touches
from scara_kinetostatic.touches.segmentation import find_contacts
from scara_kinetostatic.touches.signals import Signals, as_signals, runs
from scara_kinetostatic.touches.streams import Streams

_LARGEST = 10.0
"""Largest difference that is looked for, s."""
_STEP = 0.05
"""Resolution of the difference, s."""
_USUAL = 0.7
"""Where at least this part of the contacts are touches the clocks are one."""
_APART = 0.5
"""Least distance of differences that are tried, s."""
_TRIED = 8
"""So many differences are tried."""
_LEAST = 0.2
"""Smaller differences leave most holds usable and are not told, s."""


def offset_touches(streams: Streams, cell: Cell, found: Detection) -> tuple[float, Detection] | None:
    """By how much the wrenches are stamped later than the joint states, s, and the touches without that difference.

    Args:
        streams: of a recording.
        cell: the cell.
        found: the touches as the streams are.

    Returns:
        None where most contacts are touches, or no difference makes most contacts touches.
    """
    signals = as_signals(streams, cell)
    if signals is None or _is_usual(found):
        return None
    tried = [(0.0, found)]
    tried += [(offset, _shifted(streams, cell, offset)) for offset in _offsets(signals)]
    offset, best = max(tried, key=lambda item: len(item[1].touches))
    return (offset, best) if abs(offset) > _LEAST and _is_usual(best) else None


def _is_usual(detection: Detection) -> bool:
    return len(detection.touches) >= _USUAL * detection.found


def _shifted(streams: Streams, cell: Cell, offset: float) -> Detection:
    """The touches with the wrenches stamped earlier by so many s."""
    stamp = streams.wrench.stamp - round(1e9 * offset)
    return find_touches(replace(streams, wrench=replace(streams.wrench, stamp=stamp)), cell)


def _offsets(signals: Signals) -> list[float]:
    """Differences at which the joints move less during the contacts than at those around them, s, the least first."""
    joints, contacts = signals.joints, find_contacts(signals)
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(joints.value, axis=0)).sum(axis=1))])
    steps = round(_LARGEST / _STEP)
    offsets = _STEP * np.arange(-steps, steps + 1)
    begin, end = (np.interp(time - offsets[:, None], joints.time, path) for time in (contacts.begin, contacts.end))
    moved = (end - begin).sum(axis=1)
    around = round(_APART / _STEP)
    least = sliding_window_view(np.pad(moved, around, mode='edge'), 2 * around + 1).min(axis=1)
    lows, ends = runs(moved <= least)
    middles = sorted(zip(lows, ends, strict=True), key=lambda run: moved[run[0]])[:_TRIED]
    return [float(offsets[(low + high) // 2]) for low, high in middles]
