"""Contact forces of a robot with effects under commanded joint angles.

The simulated controller uses the base model: it commands Ḡ(S, F) without effects. The force that results is
F = A(Q, L̄) with the effects. A controller that presses until the sensor shows a force therefore commands a point
deeper, or less deep, than the base model gives. This depth is solved for at two forces, a light one and that of the
hold, and is linear in the force between them and beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact import Contact, contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.load_history import remembered, torques_of
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import padded_history, stacked_histories
from scara_kinetostatic.simulation.plan import CLEARANCE, Plan, check_numbers

Phase = IntEnum('Phase', 'TRAVEL PAUSE APPROACH PRESS EASE HOLD RELEASE RETRACT', start=0)
"""Of a touch."""


@dataclass(frozen=True)
class Timing:
    """Durations of the phases of a touch, s.

    Attributes:
        travel: shortest travel between two touches.
        pause: rest at the free pose before the approach.
        approach: from the free pose to the disc.
        press: from no force to the force of the hold, or to the peak beyond it.
        ease: from the peak down to the force of the hold, for touches with preload.
        hold: at rest under the force.
        release: back to no force.
        retract: back to the free pose.
        speed: largest mean speed of a joint during the travel, rad/s.
        clearance: distance of the free pose from the disc, m.

    Raises:
        ParameterError: a value that is not above 0 (0 is fine for the pause).
    """

    travel: float = 0.6
    pause: float = 0.1
    approach: float = 0.4
    press: float = 0.3
    ease: float = 0.2
    hold: float = 0.5
    release: float = 0.2
    retract: float = 0.2
    speed: float = 4.0
    clearance: float = CLEARANCE

    def __post_init__(self) -> None:
        check_numbers('timing', self, zero=('pause',))


def minimum_jerk(part: Floats) -> Floats:
    """10 s³ - 15 s⁴ + 6 s⁵: from 0 to 1, at rest at both ends."""
    return part**3 * (10.0 + part * (6.0 * part - 15.0))


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


Index = NDArray[np.intp]

LIGHT_FORCE = 0.05
"""The light force, over that of the hold."""
FORCE_TOLERANCE = 1e-3
"""Relative error of the force at which the iteration for a depth ends."""


@dataclass(frozen=True)
class ContactForces:
    """The contact forces of the touches of a plan.

    Attributes:
        cell: discs, gripper.
        truth: the simulated robot.
        plan: the m touches.
        metadata: what effects need to know of each touch in its hold besides.
        histories: the load before each stage of the touches, where it is known.
    """

    cell: Cell
    truth: ExtendedModel
    plan: Plan
    metadata: TouchMetadata
    histories: Histories | None = None

    def contact(
        self,
        touch: Index,
        joints: Floats,
        warm_start: Floats,
        tension: bool = False,
        metadata: TouchMetadata | None = None,
    ) -> Contact:
        """A(Q, L̄) at k moments of touches.

        Args:
            touch: number of the touch, (k,).
            joints: commanded Q, (k, 2), rad.
            warm_start: of several equilibria, the one nearest to this force is taken, (k, 2), N.
            tension: as in `model.contact.contact`.
            metadata: of the moments; None: those of the holds.
        """
        disc = self.plan.disc[touch]
        return contact(
            self.truth,
            joints,
            self.cell.centers[disc],
            self.cell.radii[disc],
            self.cell.gripper,
            tension=tension,
            warm_start=warm_start,
            metadata=self.metadata.select(touch) if metadata is None else metadata,
        )

    def force_over_time(self, touch: Index, joints: Floats, warm_start: Floats, phase: Index) -> Floats:
        """Force on the object at k moments in the order of time, (k, 2), N; zero outside contact.

        Where no equilibrium is found the force is interpolated in time.
        """
        metadata = self.metadata.select(touch)
        if self.histories is not None:
            stages = [part[touch] for part in self.histories]
            longest = max(part.shape[1] for part in stages)
            stages = [padded_history(part, joints, longest) for part in stages]
            before, after = (phase < Phase.EASE)[:, None, None], (phase > Phase.HOLD)[:, None, None]
            metadata = metadata._replace(history=np.where(before, stages[0], np.where(after, stages[2], stages[1])))
        found = self.contact(touch, joints, warm_start, metadata=metadata)
        force, at = found.force.copy(), np.arange(len(touch))
        if not found.solved.all() and found.solved.any():
            for axis in (0, 1):
                force[:, axis] = np.interp(at, at[found.solved], force[found.solved, axis])
        return force

    def command_depths(
        self,
        command: Callable[[Floats], Floats],
        relative_force: float,
        compliance: Floats,
        start: Floats | None = None,
    ) -> Floats:
        """Depths at which the force is reached, beyond those of the base model, (m,), m; by the secant method.

        Args:
            command: from depths (m,), m, to the Q commanded under the level, (m, 2), rad.
            relative_force: part of the force of the hold that is wanted.
            compliance: depth per force of the robot without effects, (m,), m/N.
            start: first depths, (m,), m.
        """
        wanted = relative_force * self.plan.force
        warm_start = -wanted[:, None] * self.plan.normal()
        depth = np.zeros(len(self.plan)) if start is None else start.copy()
        slope, todo = compliance.copy(), np.arange(len(self.plan))
        before = np.full((2, len(self.plan)), np.nan)
        for _ in range(30):
            force = self.contact(todo, command(depth)[todo], warm_start[todo], tension=True).magnitude
            off = np.abs(wanted[todo] - force) > FORCE_TOLERANCE * wanted[todo]
            todo, force = todo[off], force[off]
            if not len(todo):
                break
            step, rise = depth[todo] - before[0, todo], force - before[1, todo]
            known = np.abs(rise) > 1e-9  # false in the first pass
            bounds = compliance[todo] / 20.0, compliance[todo] * 20.0  # at most so much softer or stiffer
            slope[todo[known]] = np.clip(step / np.where(known, rise, 1.0), *bounds)[known]
            before[:, todo] = depth[todo], force
            depth[todo] += np.clip(slope[todo] * (wanted[todo] - force), -2e-3, 2e-3)
        return depth

    def peak_force(self, joints: Floats, histories: Histories) -> Floats:
        """Largest force on the object in each touch, (m, 2), N, for its joints (m, 2), rad.

        The planned one where no equilibrium is found.
        """
        beyond = (1.0 + self.plan.preload) * self.plan.force
        every, planned = np.arange(len(self.plan)), -beyond[:, None] * self.plan.normal()
        found = self.contact(every, joints, planned, metadata=self.metadata._replace(history=histories.press))
        return np.where(found.solved[:, None], found.force, planned)

    def with_histories(self, histories: Histories) -> ContactForces:
        """The same touches with other loads before them."""
        return replace(self, metadata=self.metadata._replace(history=histories.hold), histories=histories)

    def in_hold(self, joints: Floats) -> Contact:
        """A(Q, L̄) in each hold, for its joints (m, 2), rad."""
        return self.contact(np.arange(len(self.plan)), joints, -self.plan.force[:, None] * self.plan.normal())

    def off_plan(self, found: Contact, tolerance: float = 0.02) -> Mask:
        """Which touches have no equilibrium, or not the force that is planned but for a relative error, (m,)."""
        return ~(np.abs(found.magnitude - self.plan.force) <= tolerance * self.plan.force) | ~found.solved

    def hold_force(self, joints: Floats) -> Floats:
        """Force on the object in each hold, (m, 2), N.

        Args:
            joints: Q in each hold, (m, 2), rad.

        Raises:
            UnsupportedDataError: a touch has no equilibrium, or not the force that is planned.
        """
        found = self.in_hold(joints)
        is_smooth = all(effect.is_smooth for effect in self.truth.effects)
        # at kinks the commanded joints need not settle; the force is that of the joints as commanded
        off = self.off_plan(found) if is_smooth else self.off_plan(found, 0.1)
        if off.any():
            first = int(np.argmax(off))
            name = self.cell.discs[self.plan.disc[first]].name
            got = f'it comes to {found.magnitude[first]:.3g} N' if found.solved[first] else 'there is no equilibrium'
            raise UnsupportedDataError(
                f'the simulated robot cannot hold touch {first} of the plan, on {name!r}, '
                f'under {self.plan.force[first]:g} N: {got}',
                'leave the touch out, or simulate smaller effects',
            )
        return found.force
