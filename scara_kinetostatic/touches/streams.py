"""The two streams of a recording, as arrays: joint angles and forces with their stamps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class JointStream:
    """Joint angles as they came.

    Attributes:
        stamp: header stamps, (n,), ns.
        position: q1, q2, (n, 2), rad.
    """

    stamp: NDArray[np.int64]
    position: NDArray[np.float64]


@dataclass(frozen=True)
class WrenchStream:
    """Forces as they came: sign, frame and zero are still the sensor's.

    Attributes:
        stamp: header stamps, (n,), ns.
        force: fx, fy, (n, 2), N.
    """

    stamp: NDArray[np.int64]
    force: NDArray[np.float64]


@dataclass(frozen=True)
class Streams:
    """Both streams of one recording.

    Attributes:
        source: the file or topic pair they come from, for messages.
        joints: joint angles.
        wrench: forces.
        warnings: what was dropped or mended on reading, one sentence each.
        topics: the names of both, where they are not those of the cell description.
        discarded: touches that were discarded while recording, each by a stamp within its hold, ns.
        turned: how the forces were turned by their `frame_id`; empty where they were not.
    """

    source: str
    joints: JointStream
    wrench: WrenchStream
    warnings: tuple[str, ...] = field(default=())
    topics: tuple[str, str] | None = None
    discarded: tuple[int, ...] = ()
    turned: str = ''
