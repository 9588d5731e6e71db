"""The simulated motion of a recording, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.touches.load_history import last_movement


class Tick(NamedTuple):
    """The state at one tick; see `SimulatedMotion`."""

    joints: Floats
    force: Floats
    link2_angle: float
    touch: int
    phase: int
    progress: float


class SimulatedMotion(NamedTuple):
    """The motion, tick by tick, and at the end of each hold.

    Attributes:
        time: (k,), s.
        joints: motor angles, (k, 2), rad.
        force: of the tip on the discs, base frame, (k, 2), N.
        link2_angle: direction of link 2, (k,), rad.
        touch: number of the touch in the plan, (k,).
        phase: which of the simulation's `PHASES`, (k,).
        progress: completed part of a travel, 0 to 1, (k,).
        holds: tick at the end of each hold, (m,).
        approach: last movement of each joint before each hold, (m, 2), rad.
        press: the part of it in contact, from the first tick with a force on, (m, 2), rad.
        links: angles of the links at the end of each hold, without offsets, (m, 2), rad.
        speed: largest speed of any joint of the engine then, (m,), rad/s or m/s.
    """

    time: Floats
    joints: Floats
    force: Floats
    link2_angle: Floats
    touch: NDArray[np.intp]
    phase: NDArray[np.intp]
    progress: Floats
    holds: NDArray[np.intp]
    approach: Floats
    press: Floats
    links: Floats
    speed: Floats

    @classmethod
    def of(
        cls,
        ticks: Sequence[Tick],
        period: float,
        begins: Sequence[int],
        holds: Sequence[int],
        links: Floats,
        speed: Floats,
    ) -> SimulatedMotion:
        """From the ticks, a period in s apart; `begins` are the ticks from which on each hold was approached."""
        joints = np.array([tick.joints for tick in ticks])
        force = np.array([tick.force for tick in ticks])
        touching = [a + int(force[a:b].any(axis=1).argmax()) for a, b in zip(begins, holds, strict=True)]
        approach, press = (
            np.array([last_movement(joints[a:b], joints[b]) for a, b in zip(starts, holds, strict=True)])
            for starts in (begins, touching)
        )
        return cls(
            time=np.asarray(period * np.arange(1, len(ticks) + 1), dtype=float),
            joints=joints,
            force=force,
            link2_angle=np.array([tick.link2_angle for tick in ticks]),
            touch=np.array([tick.touch for tick in ticks]),
            phase=np.array([tick.phase for tick in ticks]),
            progress=np.array([tick.progress for tick in ticks]),
            holds=np.array(holds),
            approach=approach,
            press=press,
            links=links,
            speed=speed,
        )
