"""The load before each hold of a plan: what joints with memory remember of the touches so far.

A touch is loaded from zero to its peak if it has a preload, to its hold, and back to zero. The memory goes from touch
to touch, from the relaxed state at the start of the recording.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.load_history import remembered, torques_of
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import stacked_histories


class PlannedLoads(NamedTuple):
    """Peak and hold of m touches; (m, 2) each.

    Attributes:
        peak_joints: Q under the largest force, rad.
        peak_force: that force, N.
        hold_joints: Q in the hold, rad.
        hold_force: F in the hold, N.
    """

    peak_joints: Floats
    peak_force: Floats
    hold_joints: Floats
    hold_force: Floats


class Histories(NamedTuple):
    """Histories at three stages of every touch, (m, K, 4) each, as in `TouchSet.history`.

    Attributes:
        press: before it.
        hold: before it, with the preload.
        release: before it, with the hold.
    """

    press: Floats
    hold: Floats
    release: Floats


def load_histories(
    loads: PlannedLoads,
    has_preload: Mask,
    parameters: Parameters,
    frame: SensorFrame = SensorFrame.BASE,
    repeated: bool = False,
) -> Histories:
    """The histories of the touches of a plan.

    Args:
        loads: peaks and holds in the order of time.
        has_preload: whether the peak is beyond the hold, (m,).
        parameters: L̄, which tells the torques that a memory keeps.
        frame: that of the forces.
        repeated: whether the joints come from another pass through the same plan instead of the relaxed state.
    """
    peaks = np.concatenate([loads.peak_joints, loads.peak_force], axis=1)
    holds = np.concatenate([loads.hold_joints, loads.hold_force], axis=1)
    points = np.stack([peaks, holds, holds * (1, 1, 0, 0)], axis=1).reshape(-1, 4)
    torques = [(first, second) for first, second in torques_of(parameters, points, frame).tolist()]
    stages: tuple[list[Floats], ...] = ([], [], [])
    memory: list[int] = []
    for turn in range(1 + repeated):
        for place in range(len(points)):
            if turn == repeated:
                stages[place % 3].append(points[memory])
            if place % 3 or has_preload[place // 3]:
                memory.append(place)
                memory = [memory[k] for k in remembered([torques[one] for one in memory])]
    return Histories(*(stacked_histories(stage, loads.hold_joints) for stage in stages))
