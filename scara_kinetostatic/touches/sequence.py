"""The order in time of several recordings: a shift is sought in it, and the result is that of after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.model.arrays import Indices
from scara_kinetostatic.touches.detection import Detection

UNKNOWN_SEQUENCE = "the recordings' order in time is not known, that of the command is taken"
"""What is said where something shifted and `sequence_of` gives None."""


def sequence_of(parts: Sequence[Detection]) -> Indices | None:
    """Numbers of the recordings in the order of time; None where a start is unknown or two of them overlap."""
    if len(parts) == 1:
        return np.zeros(1, dtype=np.intp)
    begins = np.array([part.start for part in parts], dtype=np.int64)
    lasts = [max((max(one.hold[1], one.contact[1]) for one in part.episodes), default=0.0) for part in parts]
    ends = begins + np.array([int(1e9 * last) for last in lasts], dtype=np.int64)
    order = np.argsort(begins, kind='stable')
    known = bool(np.all(begins > 0) and np.all(ends[order[:-1]] <= begins[order[1:]]))
    return order if known else None


def first_places(parts: Sequence[Detection], sequence: Indices) -> list[int]:
    """Of each recording, how many touches were found in those before it in a sequence."""
    found = np.array([part.found for part in parts], dtype=np.intp)
    first = np.zeros(len(parts), dtype=np.intp)
    first[sequence] = np.cumsum(found[sequence]) - found[sequence]
    return first.tolist()
